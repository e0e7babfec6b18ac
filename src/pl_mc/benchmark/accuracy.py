"""Exactness beside speed: against the NumPy form on the same observations, and single against double precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import pl_mc
from pl_mc.alert import LPV_200
from pl_mc.benchmark.batched_numpy import NumpyOutcome, events_of
from pl_mc.benchmark.problem import METHODS
from pl_mc.geometry.record import Geometry
from pl_mc.kernels.events import EVENTS
from pl_mc.statistics.intervals import clopper_pearson, shared_noise_bounds


@dataclass(frozen=True)
class Difference:
    """How far a computation (``what``) is from the NumPy form on the same observations.

    Attributes:
        quantity: ``VPL`` or ``vertical error``.
        scenarios: observations compared, those with a solution in both.
        median_m, largest_m: of the absolute differences [m].
        availability_differs: observations with a solution in one of the two alone.
    """

    what: str
    precision: str
    method: str
    quantity: str
    scenarios: int
    median_m: float
    largest_m: float
    availability_differs: int


@dataclass(frozen=True)
class Disagreement:
    """Observations on which single and double precision decide differently, with 95 % bounds of their share."""

    method: str
    event: str
    count: int
    scenarios: int
    low: float
    high: float


@dataclass(frozen=True)
class EventRate:
    """The rate of an event over the whole ramp in one precision, with 95 % bounds.

    Attributes:
        count: events seen; draws: draws of all faults; independent_draws: draws of noise behind them.
        rate, low, high: as `pl_mc.statistics.intervals.shared_noise_bounds` gives them.
    """

    method: str
    event: str
    precision: str
    count: int
    draws: int
    independent_draws: int
    rate: float
    low: float
    high: float


def solved(g: Geometry, errors_m: NDArray[np.float64], precision: str) -> dict[str, NumpyOutcome]:
    """`pl_mc.solve` of errors (s, n) [m], as many epochs of one geometry, method by method."""
    many = len(errors_m)
    series = Geometry.from_rows(
        design=np.repeat(g.design[None], many, axis=0), sigma_m=np.repeat(g.sigma_m[None], many, axis=0),
        in_view=np.ones(errors_m.shape, dtype=bool), names=g.names, systems=g.systems, clocks=g.clocks,
    )  # fmt: skip
    table = pl_mc.solve(series, errors_m, methods=METHODS, precision=precision)
    return {
        str(name): NumpyOutcome(
            rows.up_m.to_numpy(float),
            rows.vpl_m.to_numpy(float),
            rows.available.to_numpy(bool),
            rows.unconverged.to_numpy(bool),
        )
        for name, rows in table.groupby("method", sort=False)
    }


def differences(
    what: str, precision: str, found: Mapping[str, NumpyOutcome], reference: Mapping[str, NumpyOutcome]
) -> list[Difference]:
    """Each method's protection levels and errors against the reference."""
    rows = []
    for method, outcome in found.items():
        other = reference[method]
        both = outcome.available & other.available
        alone = int((outcome.available != other.available).sum())
        for quantity, field in (("VPL", "vpl_m"), ("vertical error", "vertical_error_m")):
            by_m = np.abs(getattr(outcome, field)[both] - getattr(other, field)[both])
            size = by_m if by_m.size else np.zeros(1)
            median, largest = float(np.median(size)), float(size.max())
            rows.append(Difference(what, precision, method, quantity, int(by_m.size), median, largest, alone))
    return rows


def disagreements(
    single: Mapping[str, NumpyOutcome], double: Mapping[str, NumpyOutcome], vertical_m: float = LPV_200.val_m
) -> list[Disagreement]:
    """How often each event happens in one precision alone, on the same observations."""
    rows = []
    for method, outcome in single.items():
        differ = events_of(outcome, vertical_m) != events_of(double[method], vertical_m)
        scenarios = differ.shape[1]
        for event, count in zip(EVENTS, differ.sum(axis=1).tolist(), strict=True):
            low, high = clopper_pearson(count, scenarios)
            rows.append(Disagreement(method, event.name, count, scenarios, float(low), float(high)))
    return rows


def event_rates(tables: Mapping[str, pd.DataFrame]) -> list[EventRate]:
    """The rates of a sweep's table for each precision, summed over its faults."""
    rows: list[EventRate] = []
    for precision, table in tables.items():
        for method, some in table.groupby("method", sort=False):
            draws, independent = int(some.draws.sum()), int(some.draws.max())
            for event in EVENTS:
                count = int(some[event.count].sum())
                # All faults saw the same draws of noise.
                low, high = shared_noise_bounds(count / draws, independent)
                whose = (str(method), event.name, precision, count, draws, independent)
                rows.append(EventRate(*whose, rate=count / draws, low=float(low), high=float(high)))
    return rows


def overlapping(rates: Sequence[EventRate]) -> tuple[int, int]:
    """How many pairs of intervals, single and double precision of one method and event, overlap; and all pairs."""
    by_key: dict[tuple[str, str], list[EventRate]] = {}
    for rate in rates:
        by_key.setdefault((rate.method, rate.event), []).append(rate)
    pairs = [pair for pair in by_key.values() if len(pair) == 2]
    return sum(max(a.low, b.low) <= min(a.high, b.high) for a, b in pairs), len(pairs)
