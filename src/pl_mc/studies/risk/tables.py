"""The tables of an experiment about risk: exact for methods with an exact law, estimated for every other one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.faults import Faults, ramps, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.integrity_risk.budget.budget import risk_budget
from pl_mc.integrity_risk.rare.risk import risk
from pl_mc.integrity_risk.worst.worst_case import worst_case
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law
from pl_mc.runtime.threads import cores, in_order

EXACT = "exact"
CURVE_EVENTS = ("misleading", "missed")


@dataclass(frozen=True)
class BudgetCase:
    """One budget: a method, and options of `risk_budget`."""

    method: Method
    options: dict[str, Any]


def curve_table(
    g: Geometry,
    *,
    satellites: Sequence[str],
    start_m: float,
    stop_m: float,
    step_m: float,
    misleading_m: Sequence[float],
    missed_m: Sequence[float],
    target_cov: float,
    max_evaluations: int,
    methods: Sequence[Method],
    alert: AlertLimits,
    seed: int,
    workers: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """P(event) against the bias of each satellite, one row per satellite, method, event and bias.

    Returns:
        ``satellite, method, event, bias_m, probability, standard_error, low, high, estimator, subset_probability,
        subset_standard_error, evaluations, warning``; exact rows have their probability as bounds.
    """
    parts = []
    faults = ramps(g, satellites=satellites, start_m=start_m, stop_m=stop_m, step_m=step_m)
    owner = np.repeat(np.array(satellites, dtype=object), len(faults) // len(satellites))
    size = faults.bias_m.sum(axis=1)
    for method in methods:
        for event in CURVE_EVENTS:
            if law := exact_law(method):
                value = law.rates(g, faults, alert)[f"{event}_rate"].to_numpy()
                columns: dict[str, object] = {"satellite": owner, "bias_m": size}
                columns |= {"probability": value, "standard_error": 0.0, "low": value, "high": value}
                columns |= {"estimator": EXACT, "evaluations": 0, "warning": ""}
                parts.append(pd.DataFrame(columns).assign(method=method.name, event=event))
                continue
            sizes = misleading_m if event == "misleading" else missed_m
            if not sizes:
                continue
            table = risk(
                g, each_size(g, satellites, sizes), seed=seed, event=event, method=method, target_cov=target_cov,
                alert=alert, max_evaluations=max_evaluations, workers=workers, progress=progress,
            )  # fmt: skip
            parts.append(table.assign(satellite=np.repeat(np.array(satellites, dtype=object), len(sizes))))
    columns_wanted = [
        "satellite", "method", "event", "bias_m", "probability", "standard_error", "low", "high", "estimator",
        "subset_probability", "subset_standard_error", "evaluations", "warning",
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True).reindex(columns=columns_wanted)


def worst_table(
    g: Geometry,
    *,
    events: Sequence[str],
    estimated: Sequence[str],
    estimated_events: Sequence[str],
    refined: Sequence[int],
    target_cov: float,
    max_evaluations: int,
    methods: Sequence[Method],
    alert: AlertLimits,
    seed: int,
) -> pd.DataFrame:
    """The worst fault of every satellite under least squares, of chosen ones under other methods.

    Of the latter ``refined`` of the worst satellites get a last estimate, for each event; all unless given.

    Returns:
        The columns of `worst_case`, with ``event``; one row per method, event and satellite. ``evaluations`` is the
        number of scenarios behind all rows of a method and event; 0 where these are exact.
    """
    found = []
    for method in methods:
        for k, event in enumerate(events if exact_law(method) else estimated_events):
            options: dict[str, Any] = {"method": method, "event": event, "alert": alert, "seed": seed}
            if not exact_law(method):
                if not estimated:
                    continue
                options |= {"satellites": list(estimated), "refine": refined[k] if refined else len(estimated)}
                options |= {"target_cov": target_cov, "max_evaluations": max_evaluations}
            part = worst_case(g, **options).assign(event=event)
            part["evaluations"] = sum(part.attrs.pop("evaluations", {}).values())
            found.append(part)
    table = pd.concat([part.dropna(axis=1, how="all") for part in found], ignore_index=True)
    for name in ("subset_probability", "subset_standard_error"):
        if "refined" in table and name not in table:
            table[name] = np.nan
    if "warning" not in table:
        table["warning"] = ""
    table["warning"] = table["warning"].fillna("")
    return table


def pair_table(
    g: Geometry,
    *,
    events: Sequence[str],
    target_cov: float,
    max_evaluations: int,
    methods: Sequence[Method],
    alert: AlertLimits,
    seed: int,
    workers: int | None = None,
) -> pd.DataFrame:
    """The worst pairs of satellites, the columns of `worst_case` with ``event``.

    Least squares is exact; of other methods all pairs are screened and the worst few estimated.
    """
    tasks = [(method, event) for event in events for method in methods]

    def run(task: tuple[Method, str]) -> pd.DataFrame:
        method, event = task
        table = worst_case(
            g, method=method, event=event, satellites=2, alert=alert, seed=seed,  # type: ignore[arg-type]
            target_cov=target_cov, max_evaluations=max_evaluations,
        )  # fmt: skip
        spent = table.attrs.pop("evaluations", {})
        return table.assign(event=event, evaluations=sum(spent.values())).drop(columns=["epoch", "bias_m"])

    threads = cores() if workers is None else workers
    found = [table.dropna(axis=1, how="all") for _, table in in_order(run, tasks, threads)]
    return pd.concat(found, ignore_index=True) if found else pd.DataFrame(columns=["method", "event", "satellites"])


def step_table(
    g: Geometry, worst: pd.DataFrame, *, methods: Sequence[Method], alert: AlertLimits, stop_m: float
) -> pd.DataFrame:
    """Exact risk of least squares against the bias of the satellite with the largest worst case, in fine steps.

    Returns:
        ``event, satellite, bias_m, probability``.
    """
    parts = []
    for method in methods:
        law = exact_law(method)
        if law is None:
            continue
        for event, group in worst[worst.method == method.name].groupby("event", sort=False):
            top = group.loc[group.probability.idxmax()]
            if not np.isfinite(top.bias_m):
                continue
            # Twice as far as the peak, and three steps of the usual ramp at the least.
            last = min(max(2.0 * top.bias_m, 15.0), stop_m)
            sizes = np.unique(np.append(np.linspace(0.0, last, 301), np.arange(5.0, last + 1e-9, 5.0)))
            faults = each_size(g, [top.satellites], sizes)
            rates = law.rates(g, faults, alert)[f"{event}_rate"]
            columns = {"event": event, "satellite": top.satellites, "bias_m": sizes, "probability": rates}
            parts.append(pd.DataFrame(columns).assign(method=method.name))
    empty = pd.DataFrame(columns=["event", "satellite", "bias_m", "probability", "method"])
    return pd.concat(parts, ignore_index=True) if parts else empty


def budget_table(g: Geometry, cases: Sequence[BudgetCase], *, alert: AlertLimits, seed: int) -> pd.DataFrame:
    """All budgets: the columns of `risk_budget` with ``budget`` (number), ``method, event, target, verdict``."""
    parts = []
    for number, case in enumerate(cases):
        table = risk_budget(g, method=case.method, alert=alert, seed=seed, **case.options)
        verdict, target = table.attrs["verdict"], table.attrs["target"]
        table.attrs = {}
        for place, (name, value) in enumerate(
            {
                "budget": number,
                "method": case.method.name,
                "event": case.options["event"],
                "bias": "worst" if case.options["bias"] == "worst" else "given sizes",
                "target": target,
                "verdict": verdict,
            }.items()
        ):
            table.insert(place, name, value)
        parts.append(table)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["budget", "method", "event"])


def each_size(g: Geometry, satellites: Sequence[str], sizes: Sequence[float] | np.ndarray) -> Faults:
    """Every size on each satellite, satellite by satellite."""
    rows = np.zeros((len(satellites), len(sizes), len(g.names)))
    for k, name in enumerate(satellites):
        rows[k, :, require_satellite(g, name)] = sizes
    return Faults.from_array(g, rows.reshape(-1, len(g.names)))
