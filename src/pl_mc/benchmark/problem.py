"""The problem that is timed: 24 satellites of two systems, and a ramp of biases on one of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import pl_mc
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.methods import Igg3, Ls

SATELLITES = 24
FAULTED = "G08"
MASK_DEG = 10.0

# Standard deviation of a pseudorange at the zenith [m]; it grows with 1 / sqrt(sin elevation).
ZENITH_SIGMA_M = 1.0

# Ten plain iterations, whatever the default is: the work stays the same from version to version.
ROBUST = Igg3(iterations=10)
METHODS = (Ls(), ROBUST)

# What users pay: estimates that have settled, beside plain solutions that leave a thousandth of the draws unsettled.
PLAIN_ITERATIONS = 40
SETTLED_METHODS, PLAIN_METHODS = (Ls(), Igg3()), (Ls(), Igg3(iterations=PLAIN_ITERATIONS))

DESCRIPTION = (
    "24 satellites (12 GPS, 12 BeiDou), 5 unknowns, 20 biases of 5 to 100 m on one satellite; least squares and "
    "IGG-III with 10 iterations and the default scale, protection levels, nine kinds of events"
)


def reference_geometry(n: int = SATELLITES) -> Geometry:
    """One epoch with ``n`` satellites, GPS and BeiDou in turn, spread evenly over the sky above 10 degrees."""
    place = np.arange(n)
    lowest = np.sin(np.radians(MASK_DEG))
    # Steps of equal area in elevation and of the golden angle in azimuth leave neither gap nor cluster.
    up = lowest + (1.0 - lowest) * (place + 0.5) / n
    azimuth = place * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - up**2)
    systems = ["GC"[k % 2] for k in place]
    clocks = [[float(system == letter) for system in systems] for letter in "GC"]
    design = np.column_stack([-level * np.sin(azimuth), -level * np.cos(azimuth), -up, *clocks])
    names = [f"{system}{k // 2 + 1:02d}" for k, system in enumerate(systems)]
    return Geometry.from_arrays(design, ZENITH_SIGMA_M / np.sqrt(up), systems, names)


def reference_faults(g: Geometry) -> Faults:
    """The 20 biases."""
    return pl_mc.ramp(g, satellite=FAULTED, start_m=5.0, stop_m=100.0, step_m=5.0)


def reference_errors_m(g: Geometry, scenarios: int, *, seed: int) -> NDArray[np.float64]:
    """(scenarios, n), noise of each satellite's sigma plus the biases in turn [m]."""
    noise = np.random.default_rng(seed).standard_normal((scenarios, g.design.shape[0])) * g.sigma_m
    bias_m = reference_faults(g).bias_m
    return noise + bias_m[np.arange(scenarios) % len(bias_m)]
