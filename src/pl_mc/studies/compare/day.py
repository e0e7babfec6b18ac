"""Further geometries for a comparison of methods: the strongest, median, weakest of a series, and a sample of it.

The question is whether an order of methods that one epoch shows holds over a day. At every epoch that satellite is
faulted whose bias moves least squares most there on the axis that decides, so that geometries are compared under the
fault that matters most in each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import special

from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.methods import Method, WTest
from pl_mc.methods.w_test import LOCAL
from pl_mc.statistics.least_squares import LsQuantities, ls_quantities
from pl_mc.studies.fault_fields import RampFaults
from pl_mc.studies.spec import epochs_at
from pl_mc.studies.strict import Strict

FloatArray = NDArray[np.float64]

# The sample's name, and that of the satellite that is faulted in it, another one at every epoch.
DAY, WORST = "day", "worst"

# What geometries are ranked by on each axis, and how a bias moves the position there.
DILUTION = {VERTICAL: "VDOP", HORIZONTAL: "HDOP", EITHER: "PDOP"}
DIRECTION = {VERTICAL: "in the vertical", HORIZONTAL: "horizontally", EITHER: "in all three directions together"}

# Fault-free draws behind the significance of a w-test, in all, and how many are drawn at a time.
_CALIBRATION, _AT_ONCE = 1_000_000, 50_000


class DayChoice(Strict):
    """Further geometries of the series: its strongest, median and weakest epoch, and epochs in equal steps.

    Attributes:
        every: step from one sampled epoch to the next.
        draws: noise draws for each fault at each sampled epoch.
        equal_draws: the same for the tests at one false-alarm rate.
    """

    every: int = Field(default=60, ge=1)
    draws: int = Field(default=2_000, ge=1)
    equal_draws: int = Field(default=5_000, ge=1)


@dataclass(frozen=True)
class Place:
    """A geometry that methods are compared at, with the satellite that is faulted.

    Attributes:
        name: ``epoch 545`` of the experiment's own; else ``strongest``, ``median``, ``weakest`` or ``day``.
        g: an epoch; or the sample, where at each epoch the faulted satellite has the name `WORST`.
        satellite: the faulted satellite's name in ``g``; None where it is the one that the ramp asks for.
        true_names: that satellite's own name at each epoch.
        axis: the axis that decides.
    """

    name: str
    g: Geometry
    satellite: str | None
    true_names: tuple[str, ...]
    axis: str = VERTICAL

    def faults(self, sizes: RampFaults) -> Faults:
        """The fault-free case, and a ramp of these sizes on the satellite."""
        ramp = sizes if self.satellite is None else sizes.model_copy(update={"satellite": self.satellite})
        return no_fault(self.g) + ramp.build(self.g)[0]

    def about(self) -> dict[str, object]:
        """A row of a table: epochs, satellites, redundancy, dilution (smallest to largest of a sample)."""
        quantities, series = ls_quantities(self.g), self.g.as_series()
        seen, redundant = series.in_view.sum(axis=1), np.atleast_1d(quantities.dof)
        row: dict[str, object] = {"geometry": self.name, "epochs": len(series)}
        row["epoch"] = int(series.epoch[0]) if len(series) == 1 else -1
        dilution_m, _ = dilution_and_reach(quantities, self.axis)
        ranges = {
            "satellites_{}": seen, "redundant_{}": redundant, f"{DILUTION[self.axis].lower()}_{{}}_m": dilution_m,
        }  # fmt: skip
        for name, values in ranges.items():
            row |= {name.format("min"): values.min().item(), name.format("max"): values.max().item()}
        return row | {"faulted": " ".join(dict.fromkeys(self.true_names))}


def dilution_and_reach(quantities: LsQuantities, axis: str) -> tuple[FloatArray, FloatArray]:
    """(...), a dilution of precision of least squares [m], and (..., n), how far a metre of bias moves it [m]."""
    vertical, horizontal = np.abs(np.nan_to_num(quantities.gain)), np.nan_to_num(quantities.horizontal_gain)
    across = np.hypot(horizontal[..., 0, :], horizontal[..., 1, :])
    vdop_m, hdop_m = np.asarray(quantities.vdop_m), np.asarray(quantities.hdop_m)
    if axis == EITHER:
        return np.hypot(vdop_m, hdop_m), np.hypot(vertical, across)
    return (vdop_m, vertical) if axis == VERTICAL else (hdop_m, across)


def further_geometries(series: Geometry, every: int, axis: str = VERTICAL) -> tuple[Place, ...]:
    """The strongest, median and weakest epoch by the dilution on an axis, and epochs in steps of ``every``.

    Only epochs with redundancy count; of two in the middle the stronger is the median.

    Raises:
        InputError: no epoch has redundancy, or the sample holds one without.
    """
    quantities = ls_quantities(series)
    sound = np.flatnonzero(quantities.available)
    if not series.is_series or sound.size < 3:
        raise InputError("day: at least three epochs with redundant satellites are needed; take a longer series.")
    dilution_m, reach = dilution_and_reach(quantities, axis)
    order = sound[np.argsort(dilution_m[sound], kind="stable")]
    picked = {"strongest": order[0], "median": order[(len(order) - 1) // 2], "weakest": order[-1]}
    rows = np.argmax(np.where(series.in_view, reach, -1.0), axis=1)
    names = [series.names[series.satellite[k, rows[k]]] for k in range(len(series))]
    # As series of one epoch they have the same number of rows, so that one compiled function serves all.
    made = [Place(name, series[k : k + 1], names[k], (names[k],), axis) for name, k in picked.items()]
    sampled = np.intersect1d(np.arange(0, len(series), every), sound)
    if not sampled.size:
        raise InputError(f"day.every: no epoch with redundant satellites is in the sample; nearest: {every // 2}.")
    # The faulted satellite gets a name of its own, so that one ramp is a fault of every epoch.
    satellite = series.satellite[sampled].copy()
    satellite[np.arange(len(sampled)), rows[sampled]] = len(series.names)
    day = dataclasses.replace(
        epochs_at(series, sampled), satellite=satellite, names=(*series.names, WORST),
        systems=(*series.systems, series.systems[0]),
    )  # fmt: skip
    return (*made, Place(DAY, day, WORST, tuple(names[k] for k in sampled), axis))


def comparable_elsewhere(records: Iterable[Method], p_fa: float, g: Geometry, seed: int) -> tuple[Method, ...]:
    """The tests that keep the false-alarm rate in another geometry.

    Those whose p_fa is the rate itself have an exact threshold everywhere. A w-test without exclusions gets the
    significance at which the largest of its satellites' |w| keeps the rate there. Tests with a setting of their
    own, which is one geometry's, are left out.

    Args:
        records: the tests.
        p_fa: the rate.
        g: one epoch, or a sample over whose epochs the rate is kept together.
        seed: of the fault-free draws behind that significance; they are other ones than the sweep's.
    """
    comparable: list[Method] = []
    for test in records:
        if isinstance(test, WTest):
            if test.exclusions == 0 and test.final == LOCAL:
                comparable.append(dataclasses.replace(test, alpha=significance_of_largest(g, p_fa, seed)))
        elif getattr(test, "p_fa", None) == p_fa:
            comparable.append(test)
    return tuple(comparable)


def significance_of_largest(g: Geometry, p_fa: float, seed: int) -> float:
    """The significance of one satellite's w-test at which the largest |w| is beyond its quantile with ``p_fa``.

    From about a million fault-free draws in all: the relative standard error of the rate is 1 / sqrt(1e6 p_fa).
    """
    series = g.as_series()
    basis = ls_quantities(series).basis
    each = -(-_CALIBRATION // len(series))
    rng = np.random.default_rng([seed, 1])
    largest = [part for k in range(len(series)) for part in _largest_w(basis[k], series.in_view[k], each, rng)]
    quantile = float(np.quantile(np.concatenate(largest), 1.0 - p_fa))
    return float(2.0 * special.ndtr(-quantile))


def _largest_w(
    basis: FloatArray, seen: NDArray[np.bool_], draws: int, rng: np.random.Generator
) -> Iterator[FloatArray]:
    """Largest |e_i| / sqrt(r_i) of whitened residuals e, draw by draw."""
    basis = basis[seen]
    redundancy = 1.0 - (basis**2).sum(axis=1)
    # A satellite that is not checked by others has no test.
    inverse = np.where(redundancy > 1e-9, 1.0 / np.sqrt(np.maximum(redundancy, 1e-9)), 0.0)
    for first in range(0, draws, _AT_ONCE):
        noise = rng.standard_normal((min(_AT_ONCE, draws - first), len(basis)))
        residuals = noise - (noise @ basis) @ basis.T
        yield np.abs(residuals * inverse).max(axis=1)
