"""Delays of the ionosphere by maps of its electron content (IONEX 1.0, Schaer, Gurtner & Feltens 1998)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import FREQUENCY_L1_HZ
from pl_mc.input_errors import InputError, require_path
from pl_mc.runtime import sidereon_adapter as library
from pl_mc.runtime.unpacking import read_unzipped

# The sun, which the electrons follow, goes round the Earth in a day.
_SUN_DEG_S = 360.0 / 86_400.0

# Maps of two files, one after the other, may be so many steps of one file apart.
_STEPS_BETWEEN_FILES = 1.5

# Rays that are asked for at once, so that they take little memory.
_RAYS_AT_ONCE = 50_000


class IonosphereMaps:
    """The maps of one or several IONEX files in the order of time; of several of one time that of the first file.

    Args:
        paths: the files, packed or not.

    Raises:
        InputError: a file that cannot be read.
    """

    def __init__(self, paths: str | Path | Sequence[str | Path]) -> None:
        several = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
        if not several:
            raise InputError("ionex: a file of maps is needed, and none is given.")
        self.paths = [require_path(path, field="ionex") for path in several]
        products: dict[int, Any] = {}
        self.longest_step_s = 0
        for path in self.paths:
            try:
                product = library.ionosphere_maps(read_unzipped(path))
            except library.Unreadable as error:
                raise InputError(f"{path}: it cannot be read as maps of the ionosphere, IONEX ({error}).") from None
            times_s = library.map_times_s(product)
            products = dict.fromkeys(times_s, product) | products
            self.longest_step_s = max([self.longest_step_s, *np.diff(times_s).tolist()])
        self.time_s = np.array(sorted(products))
        self.products = [products[time_s] for time_s in self.time_s.tolist()]

    def delay_m(
        self, time_gps_s: NDArray[np.float64], *, latitude_rad: NDArray[np.float64],
        longitude_rad: NDArray[np.float64], azimuth_rad: NDArray[np.float64], elevation_rad: NDArray[np.float64],
    ) -> NDArray[np.float64]:  # fmt: skip
        """(k,), delays on L1 [m], over the grid of maps and by their own mapping function.

        Between two maps in time both are turned with the sun and weighted, the third of the ways in IONEX 1.0; maps
        that do not go round the Earth are weighted as they stand.

        Raises:
            InputError: a time or a place that no file covers.
        """
        epochs_s, epoch = np.unique(time_gps_s, return_inverse=True)
        utc_s = np.array([library.utc_j2000_s(one) for one in epochs_s.tolist()])[epoch]
        after = np.searchsorted(self.time_s, utc_s).clip(max=self.time_s.size - 1)
        before = np.where(self.time_s[after] > utc_s, (after - 1).clip(0), after)
        self._require_covered(utc_s, before, after)
        step_s = self.time_s[after] - self.time_s[before]
        part = np.where(step_s > 0, (utc_s - self.time_s[before]) / np.where(step_s > 0, step_s, 1), 1.0)
        rays_deg = np.degrees(
            np.stack([latitude_rad, longitude_rad, azimuth_rad % (2 * np.pi), elevation_rad], axis=-1)
        )
        delay_m = np.zeros(utc_s.size)
        for k in np.union1d(before, after).tolist():
            weight = np.where(after == k, part, np.where(before == k, 1.0 - part, 0.0))
            used = np.flatnonzero(weight)
            turn_deg = _SUN_DEG_S * (utc_s - self.time_s[k]) if library.goes_round(self.products[k]) else 0.0 * utc_s
            for start in range(0, used.size, _RAYS_AT_ONCE):
                rows = used[start : start + _RAYS_AT_ONCE]
                rays = rays_deg[rows]
                rays[:, 1] = (rays[:, 1] + turn_deg[rows] + 180.0) % 360.0 - 180.0
                delay_m[rows] += weight[rows] * self._by_map(k, rays)
        return delay_m

    def _by_map(self, k: int, rays_deg: NDArray[np.float64]) -> NDArray[np.float64]:
        """Delays of rays by one map [m]."""
        time_s = int(self.time_s[k])
        found = library.slant_delays_m(self.products[k], time_s, rays_deg.tolist(), FREQUENCY_L1_HZ)
        refused = next((one for one in found if isinstance(one, str)), None)
        if refused is not None:
            raise InputError(
                f"{self._named()}: the map of {_clock(time_s)} UTC has no value where a satellite is seen ({refused}); "
                "maps of the whole Earth without gaps are needed there."
            )
        return np.array(found, dtype=np.float64)

    def _require_covered(self, utc_s: NDArray[np.float64], before: NDArray[np.int64], after: NDArray[np.int64]) -> None:
        """Raise `InputError` for a time before the first or after the last map, or between two that are far apart."""
        first, last = self.time_s[before], self.time_s[after]
        far = last - first > _STEPS_BETWEEN_FILES * self.longest_step_s
        outside = np.flatnonzero((first > utc_s) | (last < utc_s) | far)
        if outside.size:
            span = f"{_clock(self.time_s[0])} to {_clock(self.time_s[-1])}"
            raise InputError(
                f"{self._named()}: the maps do not cover the observations; {_clock(utc_s[outside[0]])} UTC is not "
                f"within them, which are of {span}; give those of all days."
            )

    def _named(self) -> str:
        return " and ".join(map(str, self.paths))


def _clock(utc_j2000_s: float) -> str:
    return f"{datetime(2000, 1, 1, 12) + timedelta(seconds=float(utc_j2000_s)):%Y-%m-%d %H:%M:%S}"
