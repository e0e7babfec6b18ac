"""Fixes of a real day against RTKLIB's single-point solution, of one carrier and of two, with its own weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rtklib_fixes import Rtklib

from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.receiver import ReceiverSeries, read_receiver_series, read_truth
from pl_mc.receiver.corrections import klobuchar_delay_m
from pl_mc.receiver.signals import signals_of

WHOLE = "ESBC00DNK_R_20201770000_01D_30S_MO.crx.gz", "ESBC00DNK_R_20201770000_01D_MN.rnx.gz"
TRUTH_M = np.array([3582104.8991, 532590.1966, 5232755.2961])
TRUTH = read_truth(",".join(map(str, TRUTH_M)))
EVERY = 10
ALPHA, BETA = (4.6566e-09, 1.4901e-08, -5.9605e-08, -1.1921e-07), (8.1920e04, 9.8304e04, -6.5536e04, -5.2429e05)

# What RTKLIB combines of each system.
PAIRS = {"G": "L1+L2", "E": "E1+E5b", "C": "B1I+B2I"}


@pytest.fixture(scope="module")
def theirs(plain: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Rtklib]:
    """The day as RTKLIB has read it, by its systems."""
    folders = {systems: tmp_path_factory.mktemp(systems) for systems in ("GE", "GEC")}
    return {key: Rtklib(*map(plain, WHOLE), folder, key) for key, folder in folders.items()}


def fixes_m(series: ReceiverSeries, oracle: Rtklib, *, dual: bool) -> dict[float, tuple[NDArray[np.float64], int]]:
    """Least-squares errors in east, north, up with RTKLIB's weights [m], and numbers of satellites, by time."""
    g, found = series.geometry, {}
    latitude, longitude, _ = geodetic(TRUTH_M)
    factor = {letter: signals_of(letter)[0].ionosphere_factor() for letter in oracle.systems}
    for epoch in range(0, len(g), EVERY):
        rows = np.flatnonzero(g.in_view[epoch])
        time_s = float(g.time_gps_s[epoch])
        elevation = np.arcsin(-g.design[epoch, rows, 2])
        ionosphere_m = klobuchar_delay_m(
            time_gps_s=time_s, latitude_rad=latitude, longitude_rad=longitude, elevation_rad=elevation,
            azimuth_rad=np.arctan2(-g.design[epoch, rows, 0], -g.design[epoch, rows, 1]), alpha=ALPHA, beta=BETA,
        )  # fmt: skip
        names = [g.names[k] for k in g.satellite[epoch, rows]]
        weight = np.array([
            oracle.variance_m2(name, time_s, angle, factor[name[0]] * delay_m, dual=dual) ** -0.5
            for name, angle, delay_m in zip(names, elevation, ionosphere_m, strict=True)
        ])  # fmt: skip
        design = g.design[epoch, rows] * weight[:, None]
        found[time_s] = np.linalg.lstsq(design, series.errors_m[epoch, rows] * weight, rcond=None)[0][:3], len(rows)
    return found


@pytest.mark.parametrize("dual", [False, True], ids=["one carrier", "two carriers"])
@pytest.mark.parametrize("systems", ["GE", "GEC"])
def test_fixes_are_rtklibs_to_centimetres_with_its_weights(
    systems: str, dual: bool, theirs: dict[str, Rtklib], plain: Callable[[str], Path]
) -> None:
    series = read_receiver_series(
        *map(plain, WHOLE), TRUTH, systems=tuple(systems),
        signals=tuple(PAIRS[letter] for letter in systems) if dual else None,
        ionosphere="dual" if dual else "broadcast",
    )  # fmt: skip
    latitude, longitude, _ = geodetic(TRUTH_M)
    rotation = enu_rotation(latitude, longitude)
    fixes = theirs[systems].fixes(dual=dual, every=EVERY)
    their_m = {time_s: rotation @ (position_m - TRUTH_M) for time_s, (position_m, _) in fixes.items()}
    ours = fixes_m(series, theirs[systems], dual=dual)
    same = [time_s for time_s, (_, count) in fixes.items() if count == ours[time_s][1]]
    assert len(fixes) == 288
    assert len(same) > 270
    difference_m = np.array([ours[time_s][0] - their_m[time_s] for time_s in same])
    # Models are the same; a centimetre comes from where the atmosphere is taken at.
    assert np.abs(difference_m).max() < 0.02
    quantile_m = np.quantile(np.abs(np.array([fix for fix, _ in ours.values()])), 0.95, axis=0)
    np.testing.assert_allclose(quantile_m, np.quantile(np.abs(list(their_m.values())), 0.95, axis=0), rtol=0.02)
