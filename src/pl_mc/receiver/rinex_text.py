"""From a file on disk to the lines of a RINEX file: unpacked, its kind and version known, its header apart."""

from __future__ import annotations

import os
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from pl_mc.input_errors import InputError, shown
from pl_mc.runtime import sidereon_adapter as library
from pl_mc.runtime.unpacking import LARGEST_BYTES, read_unzipped

_KINDS = {"O": "observation", "N": "navigation", "M": "meteorological", "C": "clock"}
# RINEX 2 has a kind of navigation file for each of the other systems.
_KINDS_2 = {**_KINDS, "G": "navigation", "H": "navigation"}

_LABEL = re.compile(r"[A-Z]{2}", re.ASCII)
_VERSION = re.compile(r"([234])(\.\d?\d?)?", re.ASCII)

# What compact records hold: differences, flags and changed satellites; no point and no small letter.
_DIFFERENCES = re.compile(r"[0-9A-Z &-]*", re.ASCII)

_COMPACT_EVENT = re.compile(r"(?:&.{27}|>.{30})[2-5](  \d| \d{2}|\d{3})", re.ASCII)

# Names that a note gives before it counts.
_NAMED_AT_MOST = 8


@dataclass(frozen=True)
class RinexText:
    """The lines of a RINEX file.

    Attributes:
        path: the file, for messages.
        version: its version as it is written, ``3.04``.
        header: header lines, END OF HEADER included.
        body: the lines after it.
        before: lines of the file before those of the body.
        ends_with_newline: whether the last line is complete.
        compact: whether it was Hatanaka-compressed.
    """

    path: Path
    version: str
    header: tuple[str, ...]
    body: tuple[str, ...]
    before: int
    ends_with_newline: bool
    compact: bool

    @property
    def generation(self) -> int:
        """2, 3 or 4."""
        return int(self.version[0])

    def labelled(self, labels: Collection[str]) -> list[str]:
        """The header lines with one of those labels."""
        return [line for line in self.header if label_of(line) in labels]

    def without_label(self) -> list[str]:
        """Header lines that have none, in words: what stands there may be an epoch or a record."""
        first = self.before - len(self.header) + 1
        odd = [k for k, line in enumerate(self.header) if line.strip() and not _LABEL.search(label_of(line))]
        return [f"line {first + k} (in the header, without a label)" for k in odd]

    def number(self, index: int) -> int:
        """Line number of a line of the body, for messages."""
        return self.before + index + 1


def label_of(line: str) -> str:
    """The label of a header line."""
    return line[60:].strip()


def is_observation_file(path: Path) -> bool:
    """Whether a file says in its first line that it holds observations; False where it cannot be read."""
    try:
        head = read_unzipped(path)[:400].decode("latin-1").removeprefix("ï»¿").lstrip("\r\n")
    except InputError:
        return False
    return "CRINEX VERS" in head[:82] or ("RINEX VERSION" in head[:80] and head[20:21] == "O")


def read_rinex_text(path: str | Path, kind: str) -> RinexText:
    """Read, unpack and split a RINEX file: as `read_unzipped`, and Hatanaka-compressed.

    A byte-order mark, blank lines before the header and any ends of lines are harmless; what is no ASCII becomes
    a question mark.

    Args:
        path: the file.
        kind: ``observation`` or ``navigation``.

    Raises:
        InputError: the file is missing, empty, not RINEX, of another version or of another kind.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{kind}: the path of a file is needed, not {shown(path)}.")
    path = Path(path)
    content = read_unzipped(path).removeprefix(b"\xef\xbb\xbf")
    text = content.decode("latin-1") if content.isascii() else content.decode("ascii", "replace").replace("\ufffd", "?")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise InputError(f"{path}: the file is empty.")
    whole, compact = text.endswith("\n"), "CRINEX VERS" in text.lstrip()[:80]
    if compact:
        text = _without_hatanaka(path, text.lstrip())
    # Not splitlines, which also splits at control characters that no editor counts as the end of a line.
    lines = text.removesuffix("\n").split("\n")
    start = next(k for k, line in enumerate(lines) if line.strip())
    first = lines[start]
    if label_of(first) != "RINEX VERSION / TYPE":
        binary = "it holds binary data and is not" if "\0" in first else "it is not"
        raise InputError(f"{path}: {binary} a RINEX file; its first line does not end in RINEX VERSION / TYPE.")
    version, letter = first[:9].strip(), first[20:21]
    if not re.fullmatch(r"\d+(\.\d*)?", version, re.ASCII):
        raise InputError(f"{path}: its first line names no RINEX version.")
    if not _VERSION.fullmatch(version):
        raise InputError(f"{path}: this is RINEX {version}, and RINEX 2, 3 or 4 is needed.")
    kinds = _KINDS_2 if version[0] == "2" else _KINDS
    if kinds.get(letter) != kind:
        found = f"a RINEX {kinds[letter]} file" if letter in kinds else f"a RINEX file of type {letter!r}"
        hint = "; have the two been exchanged?" if letter in ("O", "N") else "."
        raise InputError(f"{path}: this is {found}, and the {kind} file is needed here{hint}")
    ends = [k for k, line in enumerate(lines) if label_of(line) == "END OF HEADER"]
    if not ends:
        raise InputError(f"{path}: its header has no END OF HEADER; the file is cut short or damaged.")
    split = ends[0] + 1
    return RinexText(path, version, tuple(lines[start:split]), tuple(lines[split:]), split, whole, compact)


def listed(told: Collection[str]) -> str:
    """The first of some things, and how many more there are."""
    shown = ["".join(c if c.isprintable() else "?" for c in one) for one in list(told)[:_NAMED_AT_MOST]]
    return "; ".join(shown) + (f"; and {len(told) - len(shown)} more" if len(told) > len(shown) else "")


def _without_hatanaka(path: Path, text: str) -> str:
    """The RINEX text of a compact one, whose lines below the header hold nothing but differences.

    The library takes what it does not know for values that are missing.
    """
    lines = text.split("\n")
    end = next((k for k, line in enumerate(lines) if label_of(line) == "END OF HEADER"), len(lines))
    of_event = 0
    for number, line in enumerate(lines[end + 1 :], start=end + 2):
        # Epochs written in full, and header lines that an event brings, look like RINEX.
        if of_event:
            of_event -= 1
        elif event := _COMPACT_EVENT.match(line):
            of_event = int(event[1])
        elif not (line.startswith(("&", ">")) or _DIFFERENCES.fullmatch(line)):
            raise InputError(
                f"{path}, line {number}: this is no line of Hatanaka compression; the file is damaged, and in this "
                "form what follows the damage is lost."
            )
    try:
        text = library.without_hatanaka(text)
    except library.Unreadable as error:
        raise InputError(
            f"{path}: its Hatanaka compression cannot be undone ({error}); the file is cut short or damaged, and in "
            "this form what follows the damage is lost."
        ) from None
    if len(text) > LARGEST_BYTES:
        raise InputError(f"{path}: it unpacks to more than {LARGEST_BYTES / 1e9:g} GB, which no file of its kind does.")
    return text
