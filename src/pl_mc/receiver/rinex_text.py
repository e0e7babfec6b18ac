"""From a file on disk to RINEX 3 text that is safe to hand on: decompression, header, and the shape of the records.

RTKLIB skips in silence what it cannot make sense of. A damaged file must not become a shorter series, so whatever
a RINEX file promises (satellites of an epoch, lines of a record, numbers in fields) is counted here first.
"""

from __future__ import annotations

import gzip
import re
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import hatanaka
import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError

_KINDS = {"O": "observation", "N": "navigation", "M": "meteorological", "C": "clock"}
_OTHER_COMPRESSION = {b"\x1f\x9d": ".Z", b"PK": ".zip", b"BZh": ".bz2", b"\xfd7zXZ": ".xz"}

# Satellites whose pseudoranges are of the code that one clock and one group delay belong to. RINEX 3.02 and some
# writers since name the codes of B1I after band 1.
PSEUDORANGE_CODES: Mapping[str, tuple[str, ...]] = {"G": ("C1C",), "C": ("C2I", "C1I")}

_EPOCH = re.compile(r"> (\d{4}) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d)((?:  \d| \d\d|\d{3})\.\d{7})  \d[ \d]{3}")
_NAVIGATION_EPOCH = re.compile(r"[A-Z][ \d]\d \d{4} [ \d]\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d")
_NAVIGATION_LINES = 8
_FIELD_WIDTH = 19
_VALUE_WIDTH = 16


@dataclass(frozen=True)
class RinexText:
    """The lines of a RINEX 3 file.

    Attributes:
        path: the file, for messages.
        header: header lines, END OF HEADER included.
        body: the lines after it.
        ends_with_newline: whether the last line is complete.
    """

    path: Path
    header: tuple[str, ...]
    body: tuple[str, ...]
    ends_with_newline: bool

    def labelled(self, label: str) -> list[str]:
        """The first 60 columns of each header line with that label."""
        return [line[:60] for line in self.header if line[60:].strip() == label]

    def text(self, body: Sequence[str] | None = None) -> str:
        """The whole file, or its header with other lines after it."""
        return "\n".join((*self.header, *(self.body if body is None else body), ""))


def read_rinex_text(path: str | Path, kind: str) -> RinexText:
    """Read, decompress and split a RINEX 3 file; plain, ``.gz``, Hatanaka-compressed or both.

    Args:
        path: the file.
        kind: ``observation`` or ``navigation``.

    Raises:
        InputError: the file is missing, empty, cut short, not RINEX, of another version or of another kind.
    """
    path = Path(path)
    content = _decompressed(path)
    if b"\0" in content:
        raise InputError(f"{path}: it holds binary data and is not a RINEX file.")
    text = content.decode("latin-1")
    # Not splitlines, which also splits at control characters that no editor counts as the end of a line.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")
    first = lines[0]
    if first[60:].strip() != "RINEX VERSION / TYPE":
        raise InputError(f"{path}: it is not a RINEX file; its first line does not end in RINEX VERSION / TYPE.")
    version, letter = first[:9].strip(), first[20:21]
    if not re.fullmatch(r"\d+(\.\d*)?", version):
        raise InputError(f"{path}: its first line names no RINEX version.")
    if int(float(version)) != 3:
        raise InputError(f"{path}: this is RINEX {version}, and RINEX 3 is needed.")
    if _KINDS.get(letter) != kind:
        found = f"a RINEX {_KINDS[letter]} file" if letter in _KINDS else f"a RINEX file of type {letter!r}"
        hint = "; have the two been exchanged?" if letter in "ON" else "."
        raise InputError(f"{path}: this is {found}, and the {kind} file is needed here{hint}")
    ends = [k for k, line in enumerate(lines) if line[60:].strip() == "END OF HEADER"]
    if not ends:
        raise InputError(f"{path}: its header has no END OF HEADER; the file is cut short or damaged.")
    split = ends[0] + 1
    return RinexText(path, tuple(lines[:split]), tuple(lines[split:]), text.endswith(("\n", "\r")))


def observed_codes(file: RinexText) -> dict[str, tuple[str, ...]]:
    """Observation codes of each system letter, from SYS / # / OBS TYPES.

    Raises:
        InputError: the header lists none.
    """
    codes: dict[str, list[str]] = {}
    letter = " "
    for line in file.labelled("SYS / # / OBS TYPES"):
        letter = line[0] if line[0] != " " else letter
        codes.setdefault(letter, []).extend(line[6:].split())
    if not codes:
        raise InputError(f"{file.path}: its header lists no SYS / # / OBS TYPES.")
    return {key: tuple(value) for key, value in codes.items()}


def require_systems(file: RinexText, systems: Sequence[str]) -> None:
    """Raise `InputError` unless the observation file has the pseudoranges of all systems."""
    codes = observed_codes(file)
    for letter in systems:
        usable = PSEUDORANGE_CODES[letter]
        if letter not in codes:
            found = ", ".join(f"{key} ({SYSTEM_NAMES[key]})" if key in SYSTEM_NAMES else key for key in codes)
            raise InputError(f"{file.path}: it has no {SYSTEM_NAMES[letter]} ({letter}); its systems are {found}.")
        if not set(usable) & set(codes[letter]):
            raise InputError(
                f"{file.path}: it has no {' or '.join(usable)} pseudoranges of {SYSTEM_NAMES[letter]}; it has "
                f"{', '.join(codes[letter])}."
            )


def header_position_m(file: RinexText) -> NDArray[np.float64]:
    """(3,) APPROX POSITION XYZ of an observation file [m]; NaN where it is absent, unreadable or zero."""
    for line in file.labelled("APPROX POSITION XYZ"):
        try:
            position = np.array([float(part) for part in line.split()])
        except ValueError:
            continue
        if position.shape == (3,) and np.isfinite(position).all() and position.any():
            return position
    return np.full(3, np.nan)


def checked_observations(file: RinexText) -> tuple[str, int]:
    """The text of an observation file whose epochs are complete and in order, and the number of its epochs.

    The codes of B1I come out under the one name C2I.

    Raises:
        InputError: an epoch with other than its number of lines, an epoch line that cannot be read, times that
            do not increase; with the number of the line.
    """
    due, epochs, opened = 0, 0, 0
    previous: tuple[float, ...] = ()
    for number, line in enumerate(file.body, start=len(file.header) + 1):
        where = f"{file.path}, line {number}"
        if line.startswith(">"):
            if due:
                raise InputError(
                    f"{where}: the epoch of line {opened} lacks {due} of its satellites; the file is damaged."
                )
            opened, (flag, due) = number, _flag_and_count(line, where)
            if flag > 1:
                continue
            match = _EPOCH.match(line)
            if match is None:
                raise InputError(f"{where}: the time of the epoch cannot be read.")
            time = tuple(float(part) for part in match.groups())
            if time <= previous:
                raise InputError(f"{where}: its epoch does not come after the one before.")
            previous, epochs = time, epochs + 1
        elif due:
            due -= 1
        elif line.strip():
            raise InputError(f"{where}: a line that belongs to no epoch; the file is damaged.")
    if due or not (file.ends_with_newline or _ends_between_values(file.body)):
        raise InputError(f"{file.path}: the file is cut short; its last epoch (line {opened}) is not complete.")
    if not epochs:
        raise InputError(f"{file.path}: the file has a header and no epochs.")
    return _with_one_name_for_b1i(file).text(), epochs


def checked_navigation(file: RinexText, systems: Sequence[str]) -> str:
    """The text of a navigation file, cut to complete records of the systems.

    Raises:
        InputError: a record with other than eight lines, a field that is not a number (with the line), or no
            record of a system.
    """
    kept: list[str] = []
    seen: dict[str, None] = {}
    starts = [k for k, line in enumerate(file.body) if line[:1].strip()]
    end = len(file.body)
    while end and not file.body[end - 1].strip():
        end -= 1
    if any(line.strip() for line in file.body[: starts[0] if starts else end]):
        raise InputError(f"{file.path}, line {len(file.header) + 1}: a line that belongs to no record.")
    for start, stop in zip(starts, [*starts, end][1:], strict=True):
        record, number = file.body[start:stop], len(file.header) + start + 1
        letter = record[0][0]
        if not _NAVIGATION_EPOCH.match(record[0]):
            raise InputError(f"{file.path}, line {number}: this is no start of a navigation record.")
        seen[letter] = None
        if letter not in systems:
            continue
        if len(record) != _NAVIGATION_LINES:
            ending = "; the file is cut short." if stop == end and len(record) < _NAVIGATION_LINES else "."
            raise InputError(
                f"{file.path}, line {number}: the record of {record[0][:3]} has {len(record)} lines, and "
                f"{_NAVIGATION_LINES} are needed{ending}"
            )
        for offset, line in enumerate(record):
            _require_numbers(line[23:] if offset == 0 else line[4:], f"{file.path}, line {number + offset}")
        kept.extend(record)
    for letter in systems:
        if letter not in seen:
            found = ", ".join(SYSTEM_NAMES.get(key, key) for key in seen) or "none"
            raise InputError(f"{file.path}: it has no ephemeris of {SYSTEM_NAMES[letter]}; its systems: {found}.")
    return file.text(kept)


def _decompressed(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}).") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: this cannot be the name of a file.") from None
    if content.startswith(b"\x1f\x8b"):
        try:
            content = gzip.decompress(content)
        except (EOFError, zlib.error, gzip.BadGzipFile):
            raise InputError(f"{path}: the gzip file is cut short or damaged.") from None
    for magic, suffix in _OTHER_COMPRESSION.items():
        if content.startswith(magic):
            raise InputError(f"{path}: {suffix} files are not read; RINEX comes plain, as .gz, .crx or .crx.gz.")
    if not content.strip():
        raise InputError(f"{path}: the file is empty.")
    if b"CRINEX VERS" in content[:80]:
        content = _without_hatanaka(path, content)
    return content


def _without_hatanaka(path: Path, content: bytes) -> bytes:
    try:
        # The decompressor warns where it loses data; a shorter series is not what the user gave.
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            return hatanaka.crx2rnx(content)
    except (hatanaka.HatanakaException, UserWarning, OSError) as error:
        reason = " ".join(str(error).split()).removeprefix("crx2rnx: ").split(". ")[0].rstrip(".")
        raise InputError(
            f"{path}: its Hatanaka compression cannot be undone ({reason or 'no reason given'})."
        ) from None


def _flag_and_count(line: str, where: str) -> tuple[int, int]:
    """Epoch flag and number of lines that follow."""
    flag, count = line[31:32], line[32:35].strip() or "0"
    if not (flag.isdigit() and count.isdigit() and flag.isascii() and count.isascii()):
        raise InputError(f"{where}: the epoch line has no flag and number of satellites where they belong.")
    return int(flag), int(count)


def _ends_between_values(body: Sequence[str]) -> bool:
    """Whether the last line ends where a value does: a name of 3 columns, then 14 of value and 2 of flags each."""
    length = len(body[-1]) if body else 0
    return length == 0 or (length >= 3 and (length - 3) % _VALUE_WIDTH in (0, _VALUE_WIDTH - 2, _VALUE_WIDTH - 1))


def _require_numbers(fields: str, where: str) -> None:
    for start in range(0, len(fields.rstrip()), _FIELD_WIDTH):
        field = fields[start : start + _FIELD_WIDTH].strip()
        try:
            good = not field or bool(np.isfinite(float(field.replace("D", "E").replace("d", "e"))))
        except ValueError:
            good = False
        if not good:
            raise InputError(f"{where}: {field!r} is not a number.")


def _with_one_name_for_b1i(file: RinexText) -> RinexText:
    codes = observed_codes(file).get("C", ())
    if "C2I" in codes or "C1I" not in codes:
        return file
    letter, header = " ", []
    for line in file.header:
        if line[60:].strip() == "SYS / # / OBS TYPES":
            letter = line[0] if line[0] != " " else letter
            if letter == "C":
                line = re.sub(r"\b([CLDS])1I\b", r"\g<1>2I", line[:60]) + line[60:]
        header.append(line)
    return RinexText(file.path, tuple(header), file.body, file.ends_with_newline)
