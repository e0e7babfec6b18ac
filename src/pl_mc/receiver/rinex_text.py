"""From a file on disk to the lines of a RINEX file: version, kind, header, and what the header says.

RTKLIB skips in silence what it cannot make sense of. A damaged file must not become a shorter series, so whatever
a RINEX file promises is checked before: its header here, its epochs in `pl_mc.receiver.observation_records`, its
ephemerides in `pl_mc.receiver.navigation_records`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError
from pl_mc.receiver.signals import signal_of
from pl_mc.runtime.unpacking import read_unpacked

_KINDS = {"O": "observation", "N": "navigation", "M": "meteorological", "C": "clock"}
_OTHER_KINDS_2 = {"G": "GLONASS navigation", "H": "geostationary navigation"}

_VERSIONS = (2, 3, 4)

# No header means a coordinate beyond this; the square of a larger one may be no number.
_FARTHEST_M = 1e9


@dataclass(frozen=True)
class RinexText:
    """The lines of a RINEX file.

    Attributes:
        path: the file, for messages.
        version: its version as it is written, ``3.04``.
        header: header lines, END OF HEADER included.
        body: the lines after it.
        ends_with_newline: whether the last line is complete.
    """

    path: Path
    version: str
    header: tuple[str, ...]
    body: tuple[str, ...]
    ends_with_newline: bool

    @property
    def generation(self) -> int:
        """2, 3 or 4."""
        return int(float(self.version))

    def labelled(self, label: str) -> list[str]:
        """The first 60 columns of each header line with that label."""
        return [line[:60] for line in self.header if line[60:].strip() == label]

    def where(self, index: int) -> str:
        """File and line number of a line of the body, for messages."""
        return f"{self.path}, line {len(self.header) + index + 1}"


def read_rinex_text(path: str | Path, kind: str) -> RinexText:
    """Read, decompress and split a RINEX file; plain, ``.gz``, Hatanaka-compressed or both.

    Args:
        path: the file.
        kind: ``observation`` or ``navigation``.

    Raises:
        InputError: the file is missing, empty, cut short, not RINEX, of another version or of another kind.
    """
    path = Path(path)
    content = read_unpacked(path)
    if b"\0" in content:
        raise InputError(f"{path}: it holds binary data and is not a RINEX file.")
    text = content.decode("latin-1")
    # Not splitlines, which also splits at control characters that no editor counts as the end of a line.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")
    first = lines[0]
    if first[60:].strip() != "RINEX VERSION / TYPE":
        raise InputError(f"{path}: it is not a RINEX file; its first line does not end in RINEX VERSION / TYPE.")
    version, letter = first[:9].strip(), first[20:21]
    if not re.fullmatch(r"\d+(\.\d*)?", version, flags=re.ASCII):
        raise InputError(f"{path}: its first line names no RINEX version.")
    if float(version) not in (n + k / 100 for n in _VERSIONS for k in range(100)):
        raise InputError(f"{path}: this is RINEX {version}, and RINEX 2, 3 or 4 is needed.")
    kinds = _KINDS if int(float(version)) > 2 else {**_OTHER_KINDS_2, **_KINDS}
    if kinds.get(letter) != kind:
        found = f"a RINEX {kinds[letter]} file" if letter in kinds else f"a RINEX file of type {letter!r}"
        hint = "; have the two been exchanged?" if letter in ("O", "N") else "."
        raise InputError(f"{path}: this is {found}, and the {kind} file is needed here{hint}")
    ends = [k for k, line in enumerate(lines) if line[60:].strip() == "END OF HEADER"]
    if not ends:
        raise InputError(f"{path}: its header has no END OF HEADER; the file is cut short or damaged.")
    split = ends[0] + 1
    for number, line in enumerate(lines[:split], start=1):
        if line.strip() and not line[60:].strip():
            raise InputError(f"{path}, line {number}: a line of the header has no label; the file is damaged.")
    return RinexText(path, version, tuple(lines[:split]), tuple(lines[split:]), text.endswith(("\n", "\r")))


def observed_codes(file: RinexText) -> dict[str, tuple[str, ...]]:
    """Observation codes of each system letter, from SYS / # / OBS TYPES of RINEX 3 and 4.

    Raises:
        InputError: the header lists none, or not as many as it says.
    """
    codes: dict[str, list[str]] = {}
    promised: dict[str, str] = {}
    letter = " "
    for line in file.labelled("SYS / # / OBS TYPES"):
        if line[0] != " ":
            letter, promised[line[0]] = line[0], line[3:6].strip()
        codes.setdefault(letter, []).extend(line[6:].split())
    if not codes:
        raise InputError(f"{file.path}: its header lists no SYS / # / OBS TYPES.")
    for key, listed in codes.items():
        if promised.get(key) != str(len(listed)):
            raise InputError(
                f"{file.path}: its header promises {promised.get(key) or 'no number of'} observation types of "
                f"system {key!r} and lists {len(listed)}; it is damaged."
            )
    return {key: tuple(value) for key, value in codes.items()}


def require_systems(file: RinexText, systems: Sequence[str]) -> None:
    """Raise `InputError` unless the observation file has the pseudoranges of all systems."""
    if file.generation == 2:
        require_gps_alone(file, systems)
        return
    codes = observed_codes(file)
    for letter in systems:
        usable = signal_of(letter).codes
        if letter not in codes:
            found = ", ".join(f"{key} ({SYSTEM_NAMES[key]})" if key in SYSTEM_NAMES else key for key in codes)
            raise InputError(f"{file.path}: it has no {SYSTEM_NAMES[letter]} ({letter}); its systems are {found}.")
        if not set(usable) & set(codes[letter]):
            raise InputError(
                f"{file.path}: it has no {' or '.join(usable)} pseudoranges of {SYSTEM_NAMES[letter]}; it has "
                f"{', '.join(codes[letter])}."
            )


def require_gps_alone(file: RinexText, systems: Sequence[str]) -> None:
    """Raise `InputError` if a system other than GPS is wanted of a RINEX 2 file."""
    others = [SYSTEM_NAMES[letter] for letter in systems if letter != "G"]
    if others:
        raise InputError(
            f"{file.path}: this is RINEX {file.version}, of which GPS alone is read, not {others[0]}; choose the "
            "systems G."
        )


def header_position_m(file: RinexText) -> NDArray[np.float64]:
    """(3,) APPROX POSITION XYZ of an observation file [m]; NaN where it is absent, unreadable or zero."""
    for line in file.labelled("APPROX POSITION XYZ"):
        try:
            position = np.array([float(part) for part in line.split()])
        except ValueError:
            continue
        if position.shape == (3,) and (np.abs(position) < _FARTHEST_M).all() and position.any():
            return position
    return np.full(3, np.nan)
