"""The multiplier that keeps a target, in an experiment about risk: under which faults, and at what price."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.engine import sample
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry import Geometry
from pl_mc.integrity_risk.k_factor.calibrate import calibrate
from pl_mc.integrity_risk.k_factor.order_statistics import NO_LIMIT
from pl_mc.integrity_risk.k_factor.record import exact_rates
from pl_mc.integrity_risk.k_factor.worst_fault import neediest_fault
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, k_of
from pl_mc.runtime.threads import cores, in_order
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.risk.tables import each_size


@dataclass(frozen=True)
class CalibrationCase:
    """What multipliers have to keep; the fields are explained at the experiment's record."""

    faults: Faults
    event: str
    targets: tuple[float, ...]
    confidence: float
    draws_per_event: float
    fewest_draws: int
    most_draws: int
    rare_faults: int
    worst_sizes_m: tuple[float, ...]
    target_cov: float
    max_evaluations: int

    @property
    def worst_label(self) -> str:
        """What the fault that is searched for is called."""
        return f"worst of {min(self.worst_sizes_m):g} to {max(self.worst_sizes_m):g} m"

    def counts(self, target: float) -> bool:
        """Whether a target is common enough to be counted."""
        return self._needed(target) <= self.most_draws

    def draws(self, target: float) -> int:
        """Draws for a target; so few that it is estimated where it would take too many."""
        return self._needed(target) if self.counts(target) else min(self.fewest_draws, math.ceil(1.0 / target))

    def _needed(self, target: float) -> int:
        return max(self.fewest_draws, math.ceil(self.draws_per_event / target))


def calibration_table(
    g: Geometry,
    case: CalibrationCase,
    *,
    methods: Sequence[Method],
    alert: AlertLimits,
    seed: int,
    workers: int | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The multiplier of every method for every fault and target, and the curves that they come from.

    Where the case has sizes, a further fault of each method is the single one, of these sizes on any satellite,
    that needs the largest multiplier at the smallest target (``asked`` says so).

    Returns:
        The rows of `calibrate` with ``asked``, and P(event) against the multiplier: ``method, asked, fault,
        k_vertical, probability, low, high``, with the bounds of `calibrate`; for least squares exact, both bounds
        the probability itself.
    """
    tasks = []
    single = each_size(g, g.names, case.worst_sizes_m) if case.worst_sizes_m else None
    for method in methods:
        asked = [(label, _one(case.faults, k), k < case.rare_faults) for k, label in enumerate(case.faults.labels)]
        if single is not None:
            k = neediest_fault(
                g, single, method=method, event=case.event, alert=alert, target=min(case.targets), seed=seed
            )
            asked.append((case.worst_label, _one(single, k), True))
        tasks += [
            (method, label, fault, target)
            for label, fault, rare in asked
            for target in case.targets
            if exact_law(method) or rare or case.counts(target)
        ]

    def run(task: tuple[Method, str, Faults, float]) -> tuple[pd.DataFrame, list[pd.DataFrame]]:
        method, label, fault, target = task
        table = calibrate(
            g, method=method, target=target, faults=fault, event=case.event, alert=alert,  # type: ignore[arg-type]
            confidence=case.confidence, draws=case.draws(target), seed=seed, target_cov=case.target_cov,
            max_evaluations=case.max_evaluations,
        )  # fmt: skip
        # Every eighth point of a curve is more than a figure shows.
        curves = [pd.DataFrame(one).iloc[::8].assign(asked=label) for one in table.attrs.pop("curves")]
        return table.assign(asked=label), curves

    threads = cores() if workers is None else workers
    found = [pair for _, pair in in_order(run, tasks, threads)]
    table = pd.concat([part for part, _ in found], ignore_index=True)
    largest = table.groupby(["method", "target"])["k_high"].transform("max")
    table = table.assign(decides=table["k_high"] == largest)
    # Of least squares as far as its own multiplier, and as far again.
    exact = [
        _exact_curve(g, method, fault, case.event, alert, 2.0 * float(part["k_high"].iloc[0])).assign(asked=label)
        for (method, label, fault, target), (part, _) in zip(tasks, found, strict=True)
        if exact_law(method) and target == min(case.targets)
    ]
    curves = [*exact, *(curve for _, part in found for curve in part)]
    columns = ["method", "asked", "fault", "k_vertical", "probability", "low", "high"]
    return table, pd.concat(curves, ignore_index=True)[columns] if curves else pd.DataFrame(columns=columns)


def _exact_curve(
    g: Geometry, method: Method, fault: Faults, event: str, alert: AlertLimits, last: float
) -> pd.DataFrame:
    """P(event) of a method with an exact law against the multiplier, in even steps up to the last."""
    k = np.linspace(1.0, max(last, 2.0), 120)
    value = [float(exact_rates(g, fault, method, alert, float(each))[f"{event}_rate"].iloc[0]) for each in k]
    columns = {"k_vertical": k, "probability": value, "low": value, "high": value}
    return pd.DataFrame(columns).assign(method=method.name, fault=fault.labels[0])


def _one(faults: Faults, k: int) -> Faults:
    return Faults(faults.bias_m[[k]], faults.names, (faults.labels[k],))


def equal_risk_table(
    g: Geometry,
    calibration: pd.DataFrame,
    *,
    satellite: str,
    biases_m: Sequence[float],
    draws: int,
    methods: Sequence[Method],
    alert: AlertLimits,
    seed: int,
) -> pd.DataFrame:
    """Alarm rates with the multiplier that keeps a target under all faults of a calibration, method by method.

    Returns:
        One row per method, target and bias (0 is fault-free): ``method, target, k_vertical, fault, bias_m, draws,
        alarm_rate, alarm_low, alarm_high``; exact for least squares.
    """
    faults = no_fault(g) + each_size(g, [satellite], [size for size in biases_m if size])
    # A target that was not sought under every fault compares nothing.
    sought = calibration.groupby(["method", "target"])["asked"].transform("nunique")
    known = calibration.groupby(["method", "target"])["k_vertical"].transform(lambda k: k.notna().all())
    complete = calibration[calibration.decides & known & (sought == calibration.asked.nunique())]
    decides = complete.drop_duplicates(["method", "target"])
    parts = []
    for method in methods:
        rows = decides[decides.method == method.name]
        if exact_law(method):
            for target, k in zip(rows.target, rows.k_high, strict=True):
                rate = exact_rates(g, faults, method, alert, max(k, 1e-6))["alarm_rate"].to_numpy()
                parts.append(_alarm_rows(method, target, k, faults, 0, rate, rate, rate))
            continue
        # One set of draws for all multipliers: the level is proportional to them.
        drawn = sample(g, faults, draws=draws, seed=seed, methods=(method,), alert=NO_LIMIT)
        unit_m = np.where(drawn["alarm"], np.inf, drawn["vpl_m"]) / k_of(method)
        for target, k in zip(rows.target, rows.k_high, strict=True):
            alarm = np.isinf(unit_m) | (k * unit_m > alert.vertical_m)
            count = pd.Series(alarm).groupby(drawn["fault"].to_numpy()).sum().loc[list(faults.labels)].to_numpy()
            low, high = clopper_pearson(count, draws)
            parts.append(_alarm_rows(method, target, k, faults, draws, count / draws, low, high))
    return pd.concat(parts, ignore_index=True)


def _alarm_rows(
    method: Method, target: float, k: float, faults: Faults, draws: int, rate: Any, low: Any, high: Any
) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "method": method.name,
            "target": target,
            "k_vertical": k,
            "fault": np.array(faults.labels, dtype=object),
            "bias_m": faults.scalar_bias_m,
            "draws": draws,
            "alarm_rate": rate,
            "alarm_low": low,
            "alarm_high": high,
        }
    )
