"""Parts of a task as Parquet files, written so that a process killed at any moment leaves whole files only.

The rows are the task's affair (`pl_mc.engine.part_task`). The file's metadata carry the part's number, the task,
the environment that counted it, and a checksum of all bytes of the file, so that each file speaks for itself: files
can be gathered from several folders, and one of another task or with a changed byte is known before it is used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Collection, Container, Iterator, Mapping
from pathlib import Path
from typing import Any, Generic

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pl_mc.engine.part_task import ASKED, WHERE, Identity, P, Task, differences, fingerprint, identity_of
from pl_mc.input_errors import InputError
from pl_mc.runtime.small_files import parsed_json, read_text
from pl_mc.runtime.whole_files import write_whole

_KEY = b"pl_mc"

# Parts take megabytes; what is larger is none, and is not read.
MOST_BYTES = 500_000_000

# The checksum in a file is that of its bytes with zeros in the checksum's place.
_NO_CHECKSUM = "0" * 64
_CHECKSUM = re.compile(rb'"sha256": "([0-9a-f]{64})"')


class BadPart(Exception):
    """A part file that cannot be used; the message says why."""


class CheckpointStore(Generic[P]):
    """A folder of part files that belong to one task.

    Args:
        folder: made when the first file is written.
        task: what is counted.
        numbers: the parts that are this process's to write; all of them unless given.
        resume: go on with what the folder holds; otherwise it may hold none of ``numbers``.
        any_machine: whether parts of other versions or machines are welcome.

    Attributes:
        elsewhere: environments, other than this one, of parts that were read.

    Raises:
        InputError: the folder holds parts of another task, or parts where none are expected.
    """

    def __init__(
        self, folder: Path, task: Task[P], *, numbers: Collection[int] | None = None, resume: bool,
        any_machine: bool = False,
    ) -> None:  # fmt: skip
        self.folder = folder
        self.task = task
        self.identity: Identity = identity_of(task)
        self.elsewhere: list[Mapping[str, Any]] = []
        self._asked = fingerprint(self.identity[ASKED])
        self._any_machine = any_machine
        self._shared = numbers is not None
        self._mine: Container[int] = range(task.part_count) if numbers is None else frozenset(numbers)
        stored = self.stored()
        mine = stored if numbers is None else [number for number in stored if number in self._mine]
        if mine and not resume:
            raise InputError(
                f"{folder}: {len(mine)} finished parts of an earlier run are here; resume it, or remove the folder "
                "to start anew."
            )
        self._record = folder / task.kind.record
        self._rewritten = False
        # Whatever stands there in the record's name, a pipe or a link without an end included.
        if stored and os.path.lexists(self._record):
            # Several machines may share a folder for their shares, or their parts may have been gathered in one.
            sections = (ASKED,) if any_machine or self._shared else (ASKED, WHERE)
            before = self._read_record()
            changed = differences(before or {}, self.identity, sections)
            # A record that a disk has damaged says nothing: each part names what it is of.
            self._rewritten = bool(changed) and self._has_parts(sections)
            if changed and not self._rewritten:
                why = "; ".join(changed) if before else "its record cannot be read, and no part is of this one"
                raise InputError(
                    f"{folder}: the parts here belong to another {task.kind.name}, which cannot be resumed "
                    f"({why}); remove the folder to start anew."
                )

    def begin(self) -> None:
        """Make the folder ready to be written: name the task, remove what killed processes left half written.

        Raises:
            InputError: it cannot be written.
        """
        with _told(self._record):
            self.folder.mkdir(parents=True, exist_ok=True)
            for path in self.folder.glob(".*"):
                if self._is_leftover(path.name):
                    path.unlink(missing_ok=True)
            if self._rewritten or not self.stored() or not self._record.is_file():
                write_whole(self._record, json.dumps(self.identity, indent=2) + "\n")

    def _read_record(self) -> Identity | None:
        """What the folder says it is of; nothing where it cannot be read."""
        try:
            found = parsed_json(read_text(self._record), path=self._record)
        except (OSError, InputError):
            return None
        sound = isinstance(found, dict) and all(isinstance(section, dict) for section in found.values())
        return found if sound else None

    def _has_parts(self, sections: Collection[str]) -> bool:
        """Whether a part file says that it is of this task, and of this environment where that is asked for."""
        for number in self.stored():
            with contextlib.suppress(BadPart):
                _, about = self._opened(number)
                if about["experiment"] == self._asked and (
                    WHERE not in sections or about["environment"] == self.identity[WHERE]
                ):
                    return True
        return False

    def _is_leftover(self, name: str) -> bool:
        if name.startswith(f".{self._record.name}."):
            # Another share may be about to write it.
            return not self._shared
        found = re.match(r"\.part-(\d+)\.parquet\.", name)
        return found is not None and (not self._shared or int(found[1]) in self._mine)

    def place(self, number: int) -> Path:
        """The file of a part."""
        return self.folder / f"part-{number:06d}.parquet"

    def stored(self) -> list[int]:
        """Numbers of the part files that are there, read or not."""
        return [number for number, _ in _part_files(self.folder)]

    def write(self, part: P) -> None:
        """Store a part.

        Raises:
            InputError: it cannot be written.
        """
        where = self.identity[WHERE]
        about = {"part": part.number, "experiment": self._asked, "environment": where, "sha256": _NO_CHECKSUM}
        table = self.task.part_rows(part)
        sink = pa.BufferOutputStream()
        with pq.ParquetWriter(sink, table.schema, compression="zstd") as writer:
            writer.write_table(table)
            writer.add_key_value_metadata({_KEY: json.dumps(about).encode()})
        with _told(self.place(part.number)):
            write_whole(self.place(part.number), _with_checksum(sink.getvalue().to_pybytes()))

    def read(self, number: int) -> P:
        """A stored part.

        Raises:
            BadPart: the file is not what was written, or it is of another task.
        """
        place = self.place(number)
        file, about = self._opened(number)
        held, where = about["part"], about["environment"]
        if about["experiment"] != self._asked:
            raise BadPart(f"{place}: a part of another {self.task.kind.name}")
        if held != number:
            raise BadPart(f"{place}: it holds part {held}")
        if where != self.identity[WHERE] and not self._any_machine:
            changed = differences({WHERE: where}, self.identity, (WHERE,))
            raise BadPart(f"{place}: counted in another environment ({'; '.join(changed)})")
        try:
            part = self.task.part_of(number, file.read())
        except (pa.ArrowException, AttributeError, KeyError, TypeError, ValueError) as error:
            raise BadPart(f"{place}: {_unlike(error)}") from None
        if where != self.identity[WHERE] and where not in self.elsewhere:
            self.elsewhere.append(where)
        return part

    def _opened(self, number: int) -> tuple[pq.ParquetFile, dict[str, Any]]:
        """A part file, whole to the byte, and what it says of itself; a `BadPart` where it is none."""
        place = self.place(number)
        content = _whole_content(place)
        try:
            file = pq.ParquetFile(pa.BufferReader(content))
            about = json.loads(file.metadata.metadata[_KEY])
            if not isinstance(about["environment"], dict):
                raise ValueError("it names no environment")
            return file, {key: about[key] for key in ("part", "experiment", "environment")}
        except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
            raise BadPart(f"{place}: {_unlike(error)}") from None

    def notes(self) -> list[str]:
        """A sentence about a record that was written anew, and for each other environment of parts that were read."""
        rewritten = f"{self._record}: it was damaged; the parts say what they are of, and it was written anew."
        return [rewritten] * self._rewritten + [
            f"{self.folder}: parts were counted in another environment "
            f"({'; '.join(differences({WHERE: where}, self.identity, (WHERE,)))}), where a single scenario at the "
            f"edge of {self.task.kind.edge} can count otherwise."
            for where in self.elsewhere
        ]


def read_rows(folder: Path) -> Iterator[pd.DataFrame]:
    """The rows of each part file of a folder, in order of the parts; a `BadPart` where one is not what was written."""
    for _, path in _part_files(folder):
        yield pq.ParquetFile(pa.BufferReader(_whole_content(path))).read().to_pandas()


def _whole_content(place: Path) -> bytes:
    """A part file, whole to the byte; a `BadPart` where it is none."""
    # A pipe without a writer would be waited for.
    if not place.is_file():
        raise BadPart(f"{place}: it is no regular file")
    try:
        too_large = place.stat().st_size > MOST_BYTES
        content = b"" if too_large else place.read_bytes()
    except OSError as error:
        raise BadPart(f"{place}: it cannot be read ({(error.strerror or str(error)).lower()})") from None
    if too_large:
        raise BadPart(f"{place}: it is larger than any part, {MOST_BYTES / 1e6:.0f} MB")
    # No other reader sees the bytes before they are known to be what was written.
    if not is_whole(content):
        raise BadPart(f"{place}: it is not what was written")
    return content


def _part_files(folder: Path) -> list[tuple[int, Path]]:
    """Numbers and places of the part files of a folder, in order."""
    found = ((re.fullmatch(r"part-(\d{6,})\.parquet", path.name), path) for path in folder.glob("part-*.parquet"))
    return sorted((int(match[1]), path) for match, path in found if match)


def _with_checksum(content: bytes) -> bytes:
    """A file as written with `_NO_CHECKSUM`, with its checksum."""
    (found,) = _CHECKSUM.finditer(content)
    total = hashlib.sha256(content).hexdigest().encode()
    return content[: found.start(1)] + total + content[found.end(1) :]


def is_whole(content: bytes) -> bool:
    """Whether a file has the checksum that it carries."""
    found = list(_CHECKSUM.finditer(content))
    if len(found) != 1:
        return False
    start, stop = found[0].span(1)
    blank = content[:start] + _NO_CHECKSUM.encode() + content[stop:]
    return hashlib.sha256(blank).hexdigest().encode() == found[0][1]


def _unlike(error: Exception) -> str:
    """Why a whole file is none of these parts: what a task says of its rows, or what else went wrong."""
    said = str(error) if type(error) is ValueError else type(error).__name__
    return f"not a part as this version writes it ({said})"


@contextlib.contextmanager
def _told(place: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(
            f"{place}: it cannot be written ({reason}); what was finished before is kept and can be resumed."
        ) from None
