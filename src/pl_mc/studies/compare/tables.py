"""Tables of a comparison of methods: what each does at its worst, tests at one false-alarm rate, and orders.

Orders are those of mean rates over a ramp, with bounds, and pairs whose order holds from geometry to geometry.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.engine import sample
from pl_mc.faults import no_fault
from pl_mc.report.text import grouped
from pl_mc.statistics.intervals import binomial_p_value, clopper_pearson, shared_noise_bounds
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment

EVENTS_COMPARED = ("alarm", "missed", "misleading", "hazard")

# A measured false-alarm rate is another one than p_fa where a test at this level, shared by all tests, says so.
_LEVEL = 0.05


@dataclass(frozen=True)
class EqualTables:
    """Tests at one false-alarm rate.

    Attributes:
        rates: of their sweep, fault-free case included.
        tests: see `equal_table`.
        p_fa: the rate.
    """

    rates: pd.DataFrame
    tests: pd.DataFrame
    p_fa: float

    @property
    def comparable(self) -> pd.DataFrame:
        """The rates of the tests whose measured false-alarm rate fits."""
        return self.rates[self.rates.method.isin(self.tests.method[self.tests.fits])]

    def telling_fault(self) -> str | None:
        """The fault under which the best of the comparable tests is nearest to one half, which tells them apart.

        None without such a test.
        """
        faulted = self.comparable[self.comparable.fault != "none"]
        if faulted.empty:
            return None
        return str((faulted.groupby("fault", sort=False).alarm_rate.max() - 0.5).abs().idxmin())


@dataclass(frozen=True)
class Comparison:
    """Counts of one geometry or of several, that of the experiment in front.

    Attributes:
        geometries: a row about each, see `pl_mc.studies.compare.day.Place`.
        own_rates: of all methods at the experiment's own geometry.
        rates, overview: of all methods at all geometries, with a column ``geometry``.
        equal: tests at one false-alarm rate, by geometry.
        epochs: counts of every epoch of the sampled day: epoch, fault, bias_m, method, draws, counts.
    """

    geometries: pd.DataFrame
    own_rates: pd.DataFrame
    rates: pd.DataFrame
    overview: pd.DataFrame
    equal: Mapping[str, EqualTables]
    epochs: pd.DataFrame

    @property
    def names(self) -> list[str]:
        """The geometries."""
        return [str(name) for name in self.geometries.geometry]

    @property
    def reference(self) -> str:
        """The experiment's own geometry."""
        return self.names[0]

    @property
    def dilution(self) -> str:
        """What geometries are ranked by, ``VDOP``."""
        return next(name[:4].upper() for name in self.geometries if name.endswith("dop_min_m"))

    def dilution_m(self, row: Any) -> tuple[float, float]:
        """The smallest and the largest dilution of a row of `geometries` [m]."""
        return tuple(getattr(row, f"{self.dilution.lower()}_{end}_m") for end in ("min", "max"))

    @property
    def methods(self) -> list[str]:
        """The methods, in order."""
        return list(dict.fromkeys(self.rates.method))

    @property
    def tests(self) -> list[str]:
        """Short names of the tests of all geometries, in order."""
        return short_names(self.equal)

    def own(self, table: pd.DataFrame) -> pd.DataFrame:
        """The rows of the experiment's own geometry."""
        return table[table.geometry == self.reference].drop(columns="geometry")

    def means(self) -> pd.DataFrame:
        """Rates averaged over the biases, see `mean_rates`."""
        return mean_rates(self.rates, EVENTS_COMPARED)

    def equal_means(self) -> pd.DataFrame:
        """Those of the comparable tests, by their short names."""
        rates = joined({name: part.comparable for name, part in self.equal.items()})
        return mean_rates(rates.assign(method=rates.method.map(short_name)), ("alarm", "misleading"))


def joined(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Tables of geometries as one, with a column ``geometry``."""
    return pd.concat([table.assign(geometry=name) for name, table in tables.items()], ignore_index=True)


def fault_free_table(experiment: Experiment, planned: PlannedSweep) -> pd.DataFrame:
    """What methods say where nothing is wrong, draw by draw of the sweep's own noise, at one epoch or at several.

    Returns:
        ``method, draws, within`` (levels within the alert limits that there are), the share with its bounds, and
        quantiles of the levels [m].
    """
    series, alert = planned.g.as_series(), experiment.alert_limits()
    # Epoch by epoch, of which no more is kept than levels.
    drawn = [
        sample(
            series[k : k + 1], no_fault(series), draws=planned.draws, seed=experiment.seed,
            methods=planned.methods_of(experiment), alert=alert, precision=experiment.precision,
        )[["method", "vpl_m", "hpl_m"]]
        for k in range(len(series))
    ]  # fmt: skip
    outcomes = pd.concat(drawn, ignore_index=True)
    # Missing levels, those of an unavailable solution, are within nothing.
    outcomes["within"] = (outcomes.vpl_m <= alert.val_m) & (outcomes.hpl_m <= alert.hal_m)
    groups = outcomes.groupby("method", sort=False)
    table = groups["within"].agg(draws="size", within="sum", availability="mean").reset_index()
    table["availability_low"], table["availability_high"] = clopper_pearson(table.within, table.draws)
    for level, percent in product(("vpl", "hpl"), (50, 95)):
        quantiles = groups[f"{level}_m"].agg(lambda levels, part=percent / 100: levels.quantile(part))
        table[f"{level}_{percent}_m"] = quantiles.to_numpy()
    return table


def overview_table(rates: pd.DataFrame, fault_free: pd.DataFrame) -> pd.DataFrame:
    """One row per method: fault-free alarms, availability and levels, and each event at the bias that is worst.

    Args:
        rates: of a sweep whose first fault is none.
        fault_free: see `fault_free_table`.
    """
    parts, nothing = ("rate", "low", "high"), rates[rates.fault == "none"].set_index("method")
    columns = [f"{event}_{part}" for event in ("alarm", "misleading") for part in parts]
    table = nothing[columns].add_prefix("fault_free_")
    for event in EVENTS_COMPARED[1:]:
        most = worst(rates[rates.fault != "none"], event).set_index("method")
        table[f"{event}_bias_m"] = most.bias_m.where(most[f"{event}_rate"] > 0)
        table = table.join(most[[f"{event}_{part}" for part in parts]])
    return table.reset_index().merge(fault_free, on="method", how="left", sort=False)


def equal_table(rates: pd.DataFrame, p_fa: float) -> pd.DataFrame:
    """One row per test: its measured false alarms, and whether they fit the rate that all were set to.

    ``fits``: an exact binomial test does not reject p_fa at a level of 5 % for all tests together.
    """
    nothing = rates[rates.fault == "none"]
    table = nothing[["method", "draws", "alarms", "alarm_rate", "alarm_low", "alarm_high"]].reset_index(drop=True)
    table["p_value"] = binomial_p_value(table.alarms, table.draws, np.full(len(table), p_fa))
    table["fits"] = table.p_value >= _LEVEL / len(table)
    return table


def worst(rates: pd.DataFrame, event: str) -> pd.DataFrame:
    """Of each method the row in which an event is most frequent."""
    return rates.loc[rates.groupby("method", sort=False)[f"{event}_rate"].idxmax()]


def same_curves(rates: pd.DataFrame, event: str) -> dict[tuple[str, ...], pd.DataFrame]:
    """The rows of one method for each set of methods that share all counts of an event, by their names."""
    by_name = rates.groupby("method", sort=False)[f"{event}_rate"]
    groups = grouped((tuple(counts), str(name)) for name, counts in by_name)
    return {tuple(names): rates[rates.method == names[0]] for names in groups.values()}


def short_name(name: str) -> str:
    """A name without the settings that give it its false-alarm rate, which the table has."""
    base, _, options = name.partition("(")
    parts = options.removesuffix(")").split(",")
    kept = [part for part in parts if part and not part.startswith(("p_fa=", "alpha="))]
    return f"{base}({', '.join(kept)})" if kept else base


def short_names(equal: Mapping[str, EqualTables]) -> list[str]:
    """Short names of the tests of all geometries, in order."""
    return list(dict.fromkeys(short_name(name) for part in equal.values() for name in part.tests.method))


def mean_rates(rates: pd.DataFrame, events: Iterable[str]) -> pd.DataFrame:
    """A row per geometry, method and event: its rate averaged over the biases of the ramp, with 95 % bounds.

    All biases of a geometry and all methods see the same noise, so that the draws behind a mean are those of one
    bias (`pl_mc.statistics.intervals.shared_noise_bounds`); epochs of a sample have noise of their own.

    Args:
        rates: of sweeps, with a column ``geometry``.
        events: the events.
    """
    faulted = rates[rates.fault != "none"]
    grouped = faulted.groupby(["geometry", "method"], sort=False)
    draws = grouped.draws.min()
    parts = []
    for event in events:
        rate = grouped[f"{event}_rate"].mean()
        low, high = shared_noise_bounds(rate.to_numpy(), draws.to_numpy())
        part = rate.rename("rate").to_frame().assign(low=low, high=high, draws=draws, event=event).reset_index()
        part["rank"] = part.groupby("geometry", sort=False)["rate"].rank(method="average")
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def orders(means: pd.DataFrame, event: str, first: str, second: str) -> tuple[list[tuple[str, str]], ...]:
    """Pairs of methods that are told apart in both of two geometries: in the same order, and turned.

    Told apart: their bounds do not overlap. The noise that methods share makes their difference smaller than that
    of independent draws, so fewer pairs are told apart than could be. Pairs have the smaller rate of ``first`` in
    front.
    """
    rows = means[means.event == event].set_index("method")
    here, there = rows[rows.geometry == first], rows[rows.geometry == second]
    methods = [name for name in here.index if name in there.index]
    pairs = [(a, b) for a, b in product(methods, methods) if here.high[a] < here.low[b]]
    same = [(a, b) for a, b in pairs if there.high[a] < there.low[b]]
    return same, [(a, b) for a, b in pairs if there.high[b] < there.low[a]]
