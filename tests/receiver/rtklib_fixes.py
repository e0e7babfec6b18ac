"""RTKLIB's single-point solution (through pyrtklib), and the standard deviations that it believes in."""

from __future__ import annotations

import gzip
import itertools
import math
from pathlib import Path
from typing import Any

import hatanaka
import numpy as np
from numpy.typing import NDArray
from rtklib_oracle import _gps_s, _name, _of_version_3

# Codes of the carriers that RTKLIB takes for the first and second of each system: L1 and L2, E1 and E5b, B1I and B2I.
CODES = {"G": ("L1C", "L2W"), "E": ("L1C", "L7Q"), "C": ("L2I", "L7I")}
SYSTEMS = {"G": "SYS_GPS", "E": "SYS_GAL", "C": "SYS_CMP"}


class Rtklib:
    """A pair of files as RTKLIB has read it."""

    def __init__(self, observations: Path, navigation: Path, folder: Path, systems: str) -> None:
        import pyrtklib as rtklib

        self.rtklib: Any = rtklib
        paths = folder / "plain.obs", folder / "plain.nav"
        content = observations.read_bytes()
        content = gzip.decompress(content) if observations.suffix == ".gz" else content
        paths[0].write_bytes(hatanaka.crx2rnx(content) if b"CRINEX" in content[:80] else content)
        paths[1].write_text(_of_version_3(gzip.decompress(navigation.read_bytes()).decode()))
        self.read, self.sent = rtklib.obs_t(), rtklib.nav_t()
        station = rtklib.sta_t()
        wanted = " ".join(f"-{letter}{code}" for letter in systems for code in CODES[letter])
        rtklib.readrnx(str(paths[0]), 1, wanted, self.read, self.sent, station)
        rtklib.readrnx(str(paths[1]), 1, "", rtklib.obs_t(), self.sent, station)
        self.systems = systems
        self.ephemeris_m2: dict[tuple[float, str], float] = {}
        # Its clocks are those of I/NAV. Its group delays are those of the first record of a satellite that it has, were
        # it of F/NAV, which says 0 for that of E1 and E5b, and of hours before; here they are those in force.
        kept = [k for k in range(self.sent.n) if not self.sent.eph[k].code & 1 << 8]
        for place, k in enumerate(kept):
            self.sent.eph[place] = self.sent.eph[k]
        self.sent.n = len(kept)
        self.delays: dict[int, list[tuple[float, float]]] = {}
        self.first: dict[int, Any] = {}
        for k in range(self.sent.n):
            one = self.sent.eph[k]
            if one.code & 1 << 9:
                self.delays.setdefault(one.sat, []).append((_gps_s(one.toe), one.tgd[1]))
                self.first.setdefault(one.sat, one)

    def fixes(self, *, dual: bool, every: int) -> dict[float, tuple[NDArray[np.float64], int]]:
        """Earth-fixed positions [m] and numbers of satellites by time, of each ``every``-th epoch."""
        rtklib = self.rtklib
        option = rtklib.prcopt_default
        option.mode, option.nf, option.elmin = rtklib.PMODE_SINGLE, 2, math.radians(10.0)
        option.navsys = sum(getattr(rtklib, SYSTEMS[letter]) for letter in self.systems)
        option.ionoopt = rtklib.IONOOPT_IFLC if dual else rtklib.IONOOPT_BRDC
        option.tropopt, option.sateph = rtklib.TROPOPT_SAAS, rtklib.EPHOPT_BRDC
        starts = [0] + [k for k in range(1, self.read.n) if self._time_s(k) > self._time_s(k - 1)] + [self.read.n]
        found = {}
        for start, stop in list(itertools.pairwise(starts))[::every]:
            count = stop - start
            epoch = rtklib.Arr1Dobsd_t(count)
            for k in range(count):
                epoch[k] = self.read.data[start + k]
            time_s = self._time_s(start)
            self._keep_ephemeris_m2(epoch, count, time_s)
            for number, one in self.first.items():
                # Reference times of Galileo are past when they are sent.
                one.tgd[1] = max((pair for pair in self.delays[number] if pair[0] < time_s), default=(0.0, 0.0))[1]
            solution, said, azel = rtklib.sol_t(), rtklib.Arr1Dchar(1024), rtklib.Arr1Ddouble(2 * count)
            if rtklib.pntpos(epoch.ptr, count, self.sent, option, solution, azel, None, said):
                found[time_s] = np.array([solution.rr[k] for k in range(3)]), int(solution.ns)
        return found

    def _keep_ephemeris_m2(self, epoch: Any, count: int, time_s: float) -> None:
        rtklib = self.rtklib
        states, clocks = rtklib.Arr1Ddouble(6 * count), rtklib.Arr1Ddouble(2 * count)
        variances, health = rtklib.Arr1Ddouble(count), rtklib.Arr1Dint(count)
        args = (epoch.ptr, count, self.sent, rtklib.EPHOPT_BRDC, states, clocks, variances, health)
        rtklib.satposs(epoch[0].time, *args)
        for k in range(count):
            self.ephemeris_m2[time_s, _name(rtklib, epoch[k].sat)] = variances[k]

    def variance_m2(self, name: str, time_s: float, elevation_rad: float, ionosphere_m: float, *, dual: bool) -> float:
        """What RTKLIB believes of an error: code noise, ephemeris, code bias, ionosphere, troposphere.

        Args:
            name: of a satellite of an epoch that `fixes` has solved.
            time_s: GPS time [s].
            elevation_rad: its elevation [rad].
            ionosphere_m: the delay that was corrected, on its carrier [m].
            dual: whether two carriers are combined.
        """
        sine = math.sin(elevation_rad)
        noise_m2 = 0.3**2 * (1 + 1 / sine) * (9 if dual else 1)
        others_m2 = 0.0 if dual else 0.3**2 + (0.5 * ionosphere_m) ** 2
        return noise_m2 + others_m2 + (0.3 / (sine + 0.1)) ** 2 + self.ephemeris_m2[time_s, name]

    def _time_s(self, index: int) -> float:
        return _gps_s(self.read.data[index].time)
