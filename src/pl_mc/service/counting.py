"""Counts of service by site, method and operation, and the tables that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.service.continuity import Duration, continuity, joined, run_counts
from pl_mc.service.sky import WorldGrid
from pl_mc.statistics.intervals import clopper_pearson, rate_columns, shared_noise_bounds

# Shares of the time at which levels are told: a level that is not exceeded half of it, and 99 % of it.
QUANTILES = (("50", 0.50), ("99", 0.99))

# Availability from which a place counts as covered.
COVERED = 0.995

# The array that is a sum over sites; the others have a row for each.
_OF_ALL_SITES = "by_epoch"


@dataclass
class ServiceCounts:
    """Counts that grow batch by batch.

    Attributes:
        available: (sites, methods, operations), scenarios with service.
        scenarios: (methods,), scenarios at each site: epochs times draws, or epochs where one draw tells all.
        exact: (methods,), whether the levels depend on the geometry alone.
        may_lose, may_gain: (sites, methods, operations), for such methods: epochs whose following step holds a loss
            or a gain of service at an unknown moment; that after the last epoch may hold either.
        by_epoch: (epochs, methods, operations), share of the Earth's area with service, mean over draws.
        runs: by j, starts and stays (sites, methods, operations) of `run_counts`.
        levels_m: (sites, methods, 2, quantiles), HPL and VPL that are not exceeded in shares of the scenarios [m].
    """

    available: NDArray[np.int64]
    scenarios: NDArray[np.int64]
    exact: NDArray[np.bool_]
    may_lose: NDArray[np.int64]
    may_gain: NDArray[np.int64]
    by_epoch: FloatArray
    runs: dict[int, tuple[NDArray[np.int64], NDArray[np.int64]]]
    levels_m: FloatArray

    @classmethod
    def of(
        cls, sites: int, epochs: int, draws: int, exact: Sequence[bool], operations: int,
        durations: Sequence[Duration],
    ) -> ServiceCounts:  # fmt: skip
        """Nothing counted yet; ``exact`` by method: a single draw tells all."""
        shape = (sites, len(exact), operations)
        wanted = sorted({j for one in durations for j in one.runs})
        return cls(
            available=np.zeros(shape, dtype=np.int64),
            scenarios=epochs * np.where(exact, 1, draws).astype(np.int64),
            exact=np.asarray(exact, dtype=bool),
            may_lose=np.zeros(shape, dtype=np.int64),
            may_gain=np.zeros(shape, dtype=np.int64),
            by_epoch=np.zeros((epochs, *shape[1:])),
            runs={j: (np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)) for j in wanted},
            levels_m=np.full((sites, len(exact), 2, len(QUANTILES)), np.inf),
        )

    def add(
        self, sites: slice, weight: FloatArray, levels: Sequence[tuple[FloatArray, FloatArray]],
        operations: Sequence[AlertLimits],
    ) -> None:  # fmt: skip
        """Count the levels (sites, epochs, draws) of some sites, HPL and VPL of each method."""
        for m, (hpl, vpl) in enumerate(levels):
            for part, level in enumerate((hpl, vpl)):
                flat = level.reshape(len(level), -1)
                # Of the levels themselves: between a number and infinity there is nothing to interpolate.
                shares = [share for _, share in QUANTILES]
                self.levels_m[sites, m, part] = np.quantile(flat, shares, axis=1, method="inverted_cdf").T
            for o, limits in enumerate(operations):
                serves = (hpl <= limits.hal_m) & (vpl <= limits.val_m)
                self.available[sites, m, o] = serves.sum(axis=(1, 2))
                self.by_epoch[:, m, o] += weight @ serves.mean(axis=2)
                if self.exact[m]:
                    now, then = serves[:, :-1, 0], serves[:, 1:, 0]
                    self.may_lose[sites, m, o] = (now & ~then).sum(axis=1) + serves[:, -1, 0]
                    self.may_gain[sites, m, o] = (~now & then).sum(axis=1) + ~serves[:, -1, 0]
                for j, (started, stayed) in self.runs.items():
                    started[sites, m, o], stayed[sites, m, o] = run_counts(serves, j)

    def join(self, sites: slice, part: ServiceCounts) -> None:
        """Put in the counts of some sites."""
        mine = self.arrays()
        for name, array in part.arrays().items():
            if name == _OF_ALL_SITES:
                mine[name] += array
            else:
                mine[name][sites] = array

    def arrays(self) -> dict[str, NDArray]:
        """What was counted, by name; not copies."""
        names = ("available", "may_lose", "may_gain", _OF_ALL_SITES, "levels_m")
        found: dict[str, NDArray] = {name: getattr(self, name) for name in names}
        for j, (started, stayed) in self.runs.items():
            found |= {f"started_{j}": started, f"stayed_{j}": stayed}
        return found

    def fill(self, arrays: Mapping[str, NDArray]) -> None:
        """Put in what `arrays` gave; a `ValueError` where names or shapes do not fit."""
        mine = self.arrays()
        if {name: one.shape for name, one in mine.items()} != {name: one.shape for name, one in arrays.items()}:
            raise ValueError("counts of other sites, methods, operations or epochs")
        for name, array in arrays.items():
            mine[name][...] = array

    def availability_bounds(self, m: int, o: int) -> tuple[FloatArray, FloatArray]:
        """(sites,), bounds of the availability of a method for an operation.

        With noise: 95 % bounds after Clopper and Pearson over the draws at these epochs (draws of different epochs
        have different rates, which makes their sum vary less than that of equal ones, so the bounds are wide
        enough). Without noise an epoch stands for the step after it, in which service may change once, at an
        unknown moment: it is the share of the time within these bounds, if no outage lies between two epochs.
        """
        available, scenarios = self.available[:, m, o], int(self.scenarios[m])
        if not self.exact[m]:
            return clopper_pearson(available, scenarios)
        low = (available - self.may_lose[:, m, o]) / scenarios
        return low, (available + self.may_gain[:, m, o]) / scenarios


def weighted_rate(
    weight: FloatArray, events: NDArray, trials: NDArray, *, shared: int = 1, confidence: float = 0.95
) -> tuple[float, float, float]:
    """Area-weighted rate over sites and its bounds; NaN, 0 and 1 without trials.

    Bounds are those of as many independent trials as have the variance of the weighted mean (Kish's effective
    number), as `pl_mc.statistics.intervals.shared_noise_bounds` takes them. Arrays are (sites,); of ``shared``
    trials of a site, on end, that share draws no more than one is independent.
    """
    total = float(weight @ trials)
    if total == 0.0:
        return float("nan"), 0.0, 1.0
    rate = min(float(weight @ events) / total, 1.0)
    effective = np.floor(total**2 / float(weight**2 @ trials) / shared * (1.0 + 1e-12))
    low, high = shared_noise_bounds(rate, effective, confidence)
    return rate, float(low), float(high)


def site_table(
    counts: ServiceCounts, grid: WorldGrid, methods: Sequence[str], operations: Sequence[str],
    durations: Sequence[Duration],
) -> pd.DataFrame:  # fmt: skip
    """One row per site, method and operation: availability and continuity with counts and bounds."""
    parts = []
    for (m, method), (o, operation) in product(enumerate(methods), enumerate(operations)):
        available, scenarios = counts.available[:, m, o], int(counts.scenarios[m])
        columns = place_columns(grid) | {"method": method, "operation": operation}
        columns |= {"scenarios": scenarios, "available": available}
        columns |= rate_columns("availability", available / scenarios, *counts.availability_bounds(m, o))
        here = {j: (started[:, m, o], stayed[:, m, o]) for j, (started, stayed) in counts.runs.items()}
        for one in durations:
            columns |= dict(zip(_run_names(one), here[one.runs[-1]], strict=True))
            rates = continuity(one, here, exact=bool(counts.exact[m]))
            columns |= rate_columns(f"continuity_{one.label}", *rates)
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def world_table(
    counts: ServiceCounts, grid: WorldGrid, methods: Sequence[str], operations: Sequence[str],
    durations: Sequence[Duration],
) -> pd.DataFrame:  # fmt: skip
    """One row per method and operation, over the whole Earth: area-weighted rates, coverage, the worst site.

    ``coverage``: share of the area of sites whose availability is `COVERED` or more; its bounds are the shares of
    sites whose lower and whose upper bound is.
    """
    weight = grid.weight
    rows = []
    for (m, method), (o, operation) in product(enumerate(methods), enumerate(operations)):
        available = counts.available[:, m, o]
        trials = np.full(len(grid), counts.scenarios[m])
        rate, low, high = weighted_rate(weight, available, trials)
        by_site = available / trials
        lowest, highest = counts.availability_bounds(m, o)
        if counts.exact[m]:
            low, high = float(weight @ lowest), min(float(weight @ highest), 1.0)
        worst = int(np.argmin(by_site))
        row: dict[str, object] = {
            "method": method,
            "operation": operation,
            "scenarios": int(trials.sum()),
            "available": int(available.sum()),
            **rate_columns("availability", rate, low, high),
            "coverage_sites": int((by_site >= COVERED).sum()),
            "sites": len(grid),
            **rate_columns("coverage", *(float(weight @ (of >= COVERED)) for of in (by_site, lowest, highest))),
            "worst_rate": float(by_site[worst]),
            "worst_latitude_deg": float(grid.latitude_deg[worst]),
            "worst_longitude_deg": float(grid.longitude_deg[worst]),
        }
        here = {j: (started[:, m, o], stayed[:, m, o]) for j, (started, stayed) in counts.runs.items()}
        for one in durations:
            rates = {}
            for j in one.runs:
                begun, kept = here[j]
                found = weighted_rate(weight, kept, begun, shared=j, confidence=one.confidence)
                # Without noise there is nothing that bounds could be about: see `pl_mc.service.continuity`.
                rates[j] = tuple(np.asarray(part) for part in ((found[0],) * 3 if counts.exact[m] else found))
            row |= {name: int(part.sum()) for name, part in zip(_run_names(one), here[one.runs[-1]], strict=True)}
            row |= rate_columns(f"continuity_{one.label}", *map(float, joined(one, rates)))
        rows.append(row)
    return pd.DataFrame(rows)


def level_table(counts: ServiceCounts, grid: WorldGrid, methods: Sequence[str]) -> pd.DataFrame:
    """One row per site and method: levels not exceeded in 50 % and in 99 % of the scenarios [m]."""
    parts = []
    for m, method in enumerate(methods):
        columns = place_columns(grid) | {"method": method}
        for part, level in enumerate(("hpl", "vpl")):
            columns |= {f"{level}_{q}_m": counts.levels_m[:, m, part, k] for k, (q, _) in enumerate(QUANTILES)}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def epoch_table(
    counts: ServiceCounts, time_gps_s: FloatArray, methods: Sequence[str], operations: Sequence[str]
) -> pd.DataFrame:
    """One row per epoch, method and operation: share of the Earth's area with service."""
    parts = [
        pd.DataFrame(
            {
                "time_gps_s": time_gps_s,
                "method": method,
                "operation": operation,
                "area_share": np.minimum(counts.by_epoch[:, m, o], 1.0),
            }
        )
        for (m, method), (o, operation) in product(enumerate(methods), enumerate(operations))
    ]
    return pd.concat(parts, ignore_index=True)


def place_columns(grid: WorldGrid) -> dict[str, object]:
    """Number and place of each site."""
    return {"site": np.arange(len(grid)), "latitude_deg": grid.latitude_deg, "longitude_deg": grid.longitude_deg}


def _run_names(one: Duration) -> tuple[str, str]:
    return f"started_{one.label}", f"stayed_{one.label}"
