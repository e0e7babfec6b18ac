"""Geometries that the tests of exact statistics share."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.geometry.record import Geometry

# ARAIM Algorithm Description Document v3.0, Appendix D: minus line of sight in east, north, up, and the variance
# of the integrity error model, C_int [m^2].
APPENDIX_D = (
    ("G01", 0.0225, 0.9951, -0.0966, 3.8865),
    ("G02", 0.6750, -0.6900, -0.2612, 1.4377),
    ("G03", 0.0723, -0.6601, -0.7477, 0.8604),
    ("G04", -0.9398, 0.2553, -0.2269, 1.6383),
    ("G05", -0.5907, -0.7539, -0.2877, 1.3229),
    ("E06", -0.3236, -0.0354, -0.9455, 0.8434),
    ("E07", -0.6748, 0.4356, -0.5957, 0.8963),
    ("E08", 0.0938, -0.7004, -0.7075, 0.8669),
    ("E09", 0.5571, 0.3088, -0.7709, 0.8573),
    ("E10", 0.6622, 0.6958, -0.2780, 1.3616),
)


@pytest.fixture(scope="session")
def appendix_d() -> Geometry:
    """Ten satellites, two systems, five degrees of freedom."""
    names = [row[0] for row in APPENDIX_D]
    clocks = [[name[0] == "G", name[0] == "E"] for name in names]
    design = np.column_stack([[row[1:4] for row in APPENDIX_D], clocks]).astype(float)
    sigma_m = np.sqrt([row[4] for row in APPENDIX_D])
    return Geometry.from_arrays(design, sigma_m, [name[0] for name in names], names)


@pytest.fixture(scope="session")
def day() -> Geometry:
    """Six epochs of twelve satellites of two systems, with every kind of view.

    Epoch 0: all. 1: seven, both systems. 2: GPS alone. 3: six satellites, one redundant. 4: five satellites and
    five unknowns. 5: three satellites.
    """
    rng = np.random.default_rng(20210101)
    elevation, azimuth = rng.uniform(0.3, 1.5, 12), rng.uniform(0.0, 2 * np.pi, 12)
    line = np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    clock = np.repeat(np.eye(2), 6, axis=0)
    in_view = np.zeros((6, 12), dtype=bool)
    in_view[0] = True
    in_view[1, [0, 2, 3, 5, 6, 8, 9]] = True
    in_view[2, :6] = True
    in_view[3, [0, 1, 2, 7, 8, 9]] = True
    in_view[4, [0, 1, 2, 7, 8]] = True
    in_view[5, [0, 1, 7]] = True
    return Geometry.from_rows(
        design=np.tile(np.hstack([-line, clock]), (6, 1, 1)),
        sigma_m=np.tile(0.5 / np.sin(elevation), (6, 1)),
        in_view=in_view,
        names=[f"G{k:02d}" for k in range(1, 7)] + [f"C{k:02d}" for k in range(1, 7)],
        systems=["G"] * 6 + ["C"] * 6,
        clocks=["G", "C"],
        epoch=np.arange(100, 106),
    )
