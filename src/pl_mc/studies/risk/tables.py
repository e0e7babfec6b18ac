"""The tables of an experiment about risk: exact for least squares, estimated for every other method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import VERTICAL, Judged
from pl_mc.engine import Execution, sample
from pl_mc.faults import Faults, no_fault, ramps, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.integrity_risk.budget.budget import risk_budget
from pl_mc.integrity_risk.k_factor.calibrate import calibrate
from pl_mc.integrity_risk.k_factor.calibrated import NO_LIMIT, LevelAxis, exact_rates
from pl_mc.integrity_risk.k_factor.worst_fault import neediest_fault
from pl_mc.integrity_risk.rare.risk import risk
from pl_mc.integrity_risk.worst.worst_case import worst_case
from pl_mc.methods import Ls, Method
from pl_mc.methods.capabilities import exact_law, k_of
from pl_mc.runtime.threads import in_order
from pl_mc.statistics.exact import LeastSquaresLaw
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.fault_fields import ListedFaults
from pl_mc.studies.risk.record import BudgetChoice, CalibrationChoice, CurveChoice, WorstChoice

EXACT = "exact"

# Every eighth point of a curve of multipliers is more than a figure shows.
_THINNED = slice(None, None, 8)

_CURVE_COLUMNS = (
    "satellite", "method", "event", "bias_m", "probability", "standard_error", "low", "high", "estimator",
    "subset_probability", "subset_standard_error", "evaluations", "warning",
)  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """What every part of a run has in common: one epoch, methods, the limit that decides, the seed, how it runs."""

    g: Geometry
    methods: tuple[Method, ...]
    judged: Judged
    seed: int
    execution: Execution

    def options(self, effort: CurveChoice | WorstChoice | CalibrationChoice) -> dict[str, Any]:
        """What an estimate is called with, and how much it may take."""
        return {
            **self.limits,
            "seed": self.seed,
            "target_cov": effort.target_cov,
            "max_evaluations": effort.max_evaluations,
        }

    @property
    def axis(self) -> LevelAxis:
        """Whose error and level they are."""
        return "vertical" if self.judged.axis == VERTICAL else "horizontal"

    @property
    def limits(self) -> dict[str, Any]:
        """Limits and axis, as arguments; the vertical is not named where it has a limit."""
        return {"alert": self.judged.alert} | ({} if self.axis == VERTICAL else {"axis": self.axis})

    def exact(self, faults: Faults, event: str, method: Ls, k: float | None = None) -> NDArray[np.float64]:
        """P(event) of least squares under each fault, with another multiplier where one is given."""
        k = k_of(method, self.axis) if k is None else k
        return exact_rates(self.g, faults, method, self.judged.alert, k, self.axis, event)


def is_exact(method: Method) -> TypeGuard[Ls]:
    """Whether everything about a method is exact: least squares with the level of its residuals."""
    return isinstance(method, Ls) and isinstance(exact_law(method), LeastSquaresLaw)


def curve_table(setting: Setting, choice: CurveChoice) -> pd.DataFrame:
    """P(event) against the bias of each satellite, one row per satellite, method, event and bias.

    Returns:
        ``satellite, method, event, bias_m, probability, standard_error, low, high, estimator, subset_probability,
        subset_standard_error, evaluations, warning``; exact rows have their probability as bounds.
    """
    parts = []
    satellites = np.array(choice.satellites, dtype=object)
    ramp = ramps(
        setting.g, satellites=choice.satellites, start_m=choice.start_m, stop_m=choice.stop_m, step_m=choice.step_m
    )
    for method in setting.methods:
        for event, sizes in (("misleading", choice.misleading_m), ("missed", choice.missed_m)):
            if is_exact(method):
                value = setting.exact(ramp, event, method)
                columns: dict[str, Any] = {"bias_m": ramp.scalar_bias_m, "method": method.name, "event": event}
                columns |= {"probability": value, "low": value, "high": value, "standard_error": 0.0}
                part = pd.DataFrame(columns | {"estimator": EXACT, "evaluations": 0, "warning": ""})
            elif sizes:
                part = risk(
                    setting.g, _each_size(setting.g, choice.satellites, sizes), event=event, method=method,
                    workers=setting.execution.workers, progress=setting.execution.progress,
                    **setting.options(choice),
                )  # fmt: skip
            else:
                continue
            parts.append(part.assign(satellite=np.repeat(satellites, len(part) // len(satellites))))
    return pd.concat(parts, ignore_index=True).reindex(columns=list(_CURVE_COLUMNS))


def worst_table(setting: Setting, choice: WorstChoice) -> pd.DataFrame:
    """The worst fault of every satellite under least squares, of chosen ones under other methods.

    Returns:
        The columns of `worst_case`, with ``event``; one row per method, event and satellite. ``evaluations`` is the
        number of scenarios behind all rows of a method and event; 0 where these are exact.
    """
    parts = []
    estimated = setting.g.names if choice.estimated == ("all",) else choice.estimated
    for method in setting.methods:
        exact = is_exact(method)
        for k, event in enumerate(choice.events if exact else choice.estimated_events if estimated else ()):
            options: dict[str, Any] = setting.limits | {"seed": setting.seed}
            if not exact:
                refine = choice.refined[k] if choice.refined else len(estimated)
                options = setting.options(choice) | {"satellites": list(estimated), "refine": refine}
            part = worst_case(setting.g, method=method, event=event, **options).assign(event=event)
            part["evaluations"] = sum(part.attrs.pop("evaluations", {}).values())
            parts.append(part)
    table = pd.concat([part.dropna(axis=1, how="all") for part in parts], ignore_index=True)
    for name in ("subset_probability", "subset_standard_error"):
        if "refined" in table and name not in table:
            table[name] = np.nan
    table["warning"] = table["warning"].fillna("") if "warning" in table else ""
    return table


def pair_table(setting: Setting, choice: WorstChoice) -> pd.DataFrame:
    """The worst pairs of satellites, the columns of `worst_case` with ``event``.

    Least squares is exact; of other methods all pairs are screened and the worst few estimated.
    """

    def run(task: tuple[Method, Any]) -> pd.DataFrame:
        method, event = task
        table = worst_case(setting.g, method=method, event=event, satellites=2, **setting.options(choice))
        spent = table.attrs.pop("evaluations", {})
        return table.assign(event=event, evaluations=sum(spent.values())).drop(columns=["epoch", "bias_m"])

    tasks = [(method, event) for event in choice.pair_events for method in setting.methods]
    parts = [table.dropna(axis=1, how="all") for _, table in in_order(run, tasks, setting.execution.threads)]
    return _stacked(parts, ["method", "event", "satellites"])


def step_table(setting: Setting, worst: pd.DataFrame, *, stop_m: float) -> pd.DataFrame:
    """Exact risk of least squares against the bias of the satellite with the largest worst case, in fine steps.

    Returns:
        ``event, satellite, bias_m, probability, method``.
    """
    parts = []
    for method in setting.methods:
        if not is_exact(method):
            continue
        for event, group in worst[worst.method == method.name].groupby("event", sort=False):
            top = group.loc[group.probability.idxmax()]
            if not np.isfinite(top.bias_m):
                continue
            # Twice as far as the peak, and three steps of the usual ramp at the least.
            last = min(max(2.0 * top.bias_m, 15.0), stop_m)
            sizes = np.unique(np.append(np.linspace(0.0, last, 301), np.arange(5.0, last + 1e-9, 5.0)))
            risks = setting.exact(_each_size(setting.g, [top.satellites], sizes), str(event), method)
            columns = {"event": event, "satellite": top.satellites, "bias_m": sizes, "probability": risks}
            parts.append(pd.DataFrame(columns).assign(method=method.name))
    return _stacked(parts, ["event", "satellite", "bias_m", "probability", "method"])


def budget_table(setting: Setting, choices: Sequence[tuple[BudgetChoice, Method]]) -> pd.DataFrame:
    """All budgets: the columns of `risk_budget` with ``budget``, its number, and what is asked of it."""
    parts = []
    for number, (choice, method) in enumerate(choices):
        options = choice.model_dump(exclude={"method", "sizes_m"})
        bias: Any = "worst" if choice.sizes_m is None else list(choice.sizes_m)
        table = risk_budget(setting.g, method=method, seed=setting.seed, bias=bias, **setting.limits, **options)
        front = {
            "budget": number,
            "method": method.name,
            "event": choice.event,
            "bias": "worst" if choice.sizes_m is None else "given sizes",
            "target": table.attrs["target"],
            "verdict": table.attrs["verdict"],
        }
        table.attrs = {}
        parts.append(table.assign(**front)[[*front, *table]])
    return _stacked(parts, ["budget", "method", "event"])


def calibration_table(setting: Setting, choice: CalibrationChoice) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The multiplier of every method for every fault and target, and the curves that they come from.

    Where the record has sizes, a further fault of each method is the single one, of these sizes on any satellite,
    that needs the largest multiplier at the smallest target (``asked`` says so).

    Returns:
        The rows of `calibrate` with ``asked``, and P(event) against the multiplier: ``method, asked, fault,
        k_vertical`` (or ``k_horizontal``), ``probability, low, high``, with the bounds of `calibrate`; for least
        squares exact, both bounds the probability itself.
    """
    tasks = [
        (method, asked, fault, target)
        for method in setting.methods
        for asked, fault, rare in _faults_of(setting, choice, method)
        for target in choice.targets
        if is_exact(method) or rare or choice.counts(target)
    ]

    def run(task: tuple[Method, str, Faults, float]) -> tuple[pd.DataFrame, list[pd.DataFrame]]:
        method, asked, fault, target = task
        table = calibrate(
            setting.g, method=method, target=target, faults=fault, event=choice.event,
            confidence=choice.confidence, draws=choice.draws(target), **setting.options(choice),
        )  # fmt: skip
        curves = [pd.DataFrame(curve).iloc[_THINNED].assign(asked=asked) for curve in table.attrs.pop("curves")]
        return table.assign(asked=asked), curves

    results = [result for _, result in in_order(run, tasks, setting.execution.threads)]
    table = pd.concat([part for part, _ in results], ignore_index=True)
    largest = table.groupby(["method", "target"])["k_high"].transform("max")
    table = table.assign(decides=table["k_high"] == largest)
    # Of least squares as far as its own multiplier, and as far again.
    exact = [
        _exact_curve(setting, method, fault, choice.event, 2.0 * float(part["k_high"].iloc[0])).assign(asked=asked)
        for (method, asked, fault, target), (part, _) in zip(tasks, results, strict=True)
        if is_exact(method) and target == min(choice.targets)
    ]
    columns = ["method", "asked", "fault", f"k_{setting.axis}", "probability", "low", "high"]
    return table, _stacked([*exact, *(curve for _, part in results for curve in part)], columns)[columns]


def _faults_of(setting: Setting, choice: CalibrationChoice, method: Method) -> list[tuple[str, Faults, bool]]:
    """Faults by what was asked for, and whether targets that cannot be counted are estimated under them."""
    listed, _ = ListedFaults(biases=choice.faults).build(setting.g)
    faults = [(label, listed.only(k), k < choice.rare_faults) for k, label in enumerate(listed.labels)]
    if sizes := choice.worst_sizes_m:
        single = _each_size(setting.g, setting.g.names, sizes)
        worst = neediest_fault(
            setting.g, single, method=method, event=choice.event, alert=setting.judged.alert,
            target=min(choice.targets), seed=setting.seed, axis=setting.axis,
        )  # fmt: skip
        faults.append((f"worst of {min(sizes):g} to {max(sizes):g} m", single.only(worst), True))
    return faults


def _exact_curve(setting: Setting, method: Ls, fault: Faults, event: str, last: float) -> pd.DataFrame:
    """P(event) of least squares against the multiplier, in even steps up to the last."""
    multipliers = np.linspace(1.0, max(last, 2.0), 120)
    value = [float(setting.exact(fault, event, method, k)[0]) for k in multipliers]
    columns = {f"k_{setting.axis}": multipliers, "probability": value, "low": value, "high": value}
    return pd.DataFrame(columns).assign(method=method.name, fault=fault.labels[0])


def equal_risk_table(setting: Setting, choice: CalibrationChoice, calibration: pd.DataFrame) -> pd.DataFrame:
    """Alarm rates with the multiplier that keeps a target under all faults of a calibration, method by method.

    Returns:
        One row per method, target and bias (0 is fault-free): ``method, target, k_vertical`` (or ``k_horizontal``),
        ``fault, bias_m, draws, alarm_rate, alarm_low, alarm_high``; exact for least squares.
    """
    g, draws, axis = setting.g, choice.alarm_draws, setting.axis
    ((pl, _, limit_m),) = setting.judged.levels
    faults = no_fault(g) + _each_size(g, [choice.alarm_satellite], [size for size in choice.alarm_biases_m if size])
    # A target that was not sought under every fault compares nothing.
    sought = calibration.groupby(["method", "target"])["asked"].transform("nunique")
    known = calibration.groupby(["method", "target"])[f"k_{axis}"].transform(lambda k: k.notna().all())
    complete = calibration[calibration.decides & known & (sought == calibration.asked.nunique())]
    decides = complete.drop_duplicates(["method", "target"])
    parts = []
    for method in setting.methods:
        exact = method if is_exact(method) else None
        if exact is None:
            # One set of draws for all multipliers: the level is proportional to them.
            drawn = sample(g, faults, draws=draws, seed=setting.seed, methods=(method,), alert=NO_LIMIT)
            unit_m = np.where(drawn["alarm"], np.inf, drawn[f"{pl}_m"]) / k_of(method, axis)
        rows = decides[decides.method == method.name]
        for target, k in zip(rows.target, rows.k_high, strict=True):
            rate: Any
            if exact is not None:
                rate = low = high = setting.exact(faults, "alarm", exact, max(k, 1e-6))
            else:
                alarm = pd.Series(np.isinf(unit_m) | (k * unit_m > limit_m)).groupby(drawn["fault"].to_numpy())
                count = alarm.sum().loc[list(faults.labels)].to_numpy()
                rate, (low, high) = count / draws, clopper_pearson(count, draws)
            columns: dict[str, Any] = {"method": method.name, "target": target, f"k_{axis}": k}
            columns |= {"fault": np.array(faults.labels, dtype=object), "bias_m": faults.scalar_bias_m}
            columns |= {"draws": draws if exact is None else 0}
            columns |= {"alarm_rate": rate, "alarm_low": low, "alarm_high": high}
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def _stacked(parts: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    """All rows; of no parts the columns alone."""
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(columns))


def _each_size(g: Geometry, satellites: Sequence[str], sizes: Sequence[float] | np.ndarray) -> Faults:
    """Every size on each satellite, satellite by satellite."""
    rows = np.zeros((len(satellites), len(sizes), len(g.names)))
    for k, name in enumerate(satellites):
        rows[k, :, require_satellite(g, name)] = sizes
    return Faults.from_array(g, rows.reshape(-1, len(g.names)))
