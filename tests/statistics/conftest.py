"""Geometries that the tests of exact statistics share."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.geometry.record import Geometry
from reference.problems import appendix_d as appendix_d_geometry


@pytest.fixture(scope="session")
def appendix_d() -> Geometry:
    """Ten satellites, two systems, five degrees of freedom."""
    return appendix_d_geometry()


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
