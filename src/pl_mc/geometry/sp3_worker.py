"""Where satellites are at given times, by RTKLIB's reader and interpolation of SP3 files (through pyrtklib).

It is run as a program of its own, ``python sp3_worker.py FOLDER G01,G02,...``, and imports nothing of this package:
a fault in the C code must end a child process and not the analysis. `pl_mc.geometry.sp3` checks the file, writes
its parts into the folder, starts this program and reads its result.

To exchange the library, rewrite this file and keep the array that `interpolated_m` returns.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

EXIT_NO_LIBRARY = 3

# Files in the folder: times [s since 1980-01-06, GPS time], result, and one SP3 file for each system letter.
TIMES, RESULT = "time_gps_s.npy", "position_m.npy"

_WEEK_S = 604_800.0


def main(arguments: list[str]) -> int:
    """Read the SP3 files and the times of a folder, write the positions there; returns the exit code."""
    folder, names = Path(arguments[0]), arguments[1].split(",")
    try:
        import pyrtklib
    except ImportError as error:
        sys.stderr.write(str(error))
        return EXIT_NO_LIBRARY
    np.save(folder / RESULT, interpolated_m(pyrtklib, folder, names, np.load(folder / TIMES)))
    return 0


def interpolated_m(
    rtklib: Any, folder: Path, names: Sequence[str], time_gps_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Earth-fixed positions (e, m, 3) at e times of m satellites [m]; NaN where RTKLIB has none.

    RTKLIB (``peph2pos``) turns the eleven positions around a time into axes that stand as the Earth stands at that
    time, and puts a polynomial of degree ten through each coordinate. It gives no position if one of the eleven is
    missing. Antenna offsets and travel time are not applied.
    """
    result = np.full((len(time_gps_s), len(names), 3), np.nan)
    moments = [rtklib.gpst2time(int(week), float(second)) for week, second in zip(*_weeks(time_gps_s), strict=True)]
    orbits: dict[str, Any] = {}
    position, clock, variance = rtklib.Arr1Ddouble(6), rtklib.Arr1Ddouble(2), rtklib.Arr1Ddouble(1)
    for column, name in enumerate(names):
        letter = name[0]
        if letter not in orbits:
            # RTKLIB reads two digits of the number of satellites: a file for each system, none of which has 100.
            orbits[letter] = rtklib.nav_t()
            rtklib.readsp3(str(folder / f"{letter}.sp3"), orbits[letter], 0)
        number = rtklib.satid2no(name)
        for row, moment in enumerate(moments):
            if rtklib.peph2pos(moment, number, orbits[letter], 0, position, clock, variance):
                result[row, column] = position[0], position[1], position[2]
    return result


def _weeks(time_gps_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    week, second = np.divmod(time_gps_s, _WEEK_S)
    return week, second


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
