"""Delays of the ionosphere by maps of its electron content (IONEX 1.0, Schaer, Gurtner & Feltens 1998)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import FREQUENCY_L1_HZ
from pl_mc.input_errors import InputError, require_path
from pl_mc.runtime import sidereon_adapter as library
from pl_mc.runtime.unpacking import read_unzipped


class IonosphereMaps:
    """One or several IONEX files, of which at each time the first counts that covers it.

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
        self.products = []
        for path in self.paths:
            try:
                self.products.append(library.ionosphere_maps(read_unzipped(path)))
            except library.Unreadable as error:
                raise InputError(f"{path}: it cannot be read as maps of the ionosphere, IONEX ({error}).") from None

    def delay_m(
        self, time_gps_s: NDArray[np.float64], *, latitude_rad: NDArray[np.float64],
        longitude_rad: NDArray[np.float64], azimuth_rad: NDArray[np.float64], elevation_rad: NDArray[np.float64],
    ) -> NDArray[np.float64]:  # fmt: skip
        """(k,), delays on L1 [m], between maps in time and over their grid, by their own mapping function.

        Raises:
            InputError: a time or a place that no file covers.
        """
        angles = np.degrees(np.stack([latitude_rad, longitude_rad, azimuth_rad % (2 * np.pi), elevation_rad], axis=-1))
        requests = np.column_stack([angles, time_gps_s]).tolist()
        found = library.slant_delays_m(self.products[0], requests, FREQUENCY_L1_HZ)
        for product in self.products[1:]:
            left = [k for k, one in enumerate(found) if isinstance(one, str)]
            again = library.slant_delays_m(product, [requests[k] for k in left], FREQUENCY_L1_HZ)
            for k, one in zip(left, again, strict=True):
                found[k] = one
        refused = next((one for one in found if isinstance(one, str)), None)
        if refused is not None:
            named = " and ".join(map(str, self.paths))
            raise InputError(f"{named}: the maps do not cover the observations ({refused}); give those of all days.")
        return np.array(found, dtype=np.float64)
