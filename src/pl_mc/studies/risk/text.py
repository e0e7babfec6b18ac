"""The summary of an experiment about risk: what is proven, at what confidence, for which scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.constants import K_VERTICAL
from pl_mc.geometry import Geometry
from pl_mc.methods import Method
from pl_mc.report.figures import method_label
from pl_mc.report.text import markdown_table, percent

_EXACT = "exact"
_BIASES = {"worst": "the worst bias of every mode", "given sizes": "biases of given sizes"}


@dataclass
class RiskTables:
    """The tables of one run; their columns are explained where they are made."""

    curves: pd.DataFrame
    worst: pd.DataFrame
    budgets: pd.DataFrame
    calibration: pd.DataFrame
    multiplier_curves: pd.DataFrame = field(default_factory=pd.DataFrame)
    pairs: pd.DataFrame = field(default_factory=pd.DataFrame)
    equal_risk: pd.DataFrame = field(default_factory=pd.DataFrame)


def risk_text(value: float, low: float, high: float, *, exact: bool = False) -> str:
    """``1.2e-07 [1.0e-07, 1.5e-07]``; an upper bound where there is no more, the number alone where it is exact."""
    if exact:
        return f"{value:.3g}" if value > 1e-30 else "< 1e-30"
    if np.isnan(value):
        return f"no number; in [{low:.2g}, {high:.2g}]" if low > 0 else f"< {high:.2g}"
    return f"{value:.3g} [{low:.3g}, {high:.3g}]"


def risk_summary(
    tables: RiskTables,
    g: Geometry,
    *,
    methods: Sequence[Method],
    alert: AlertLimits,
    title: str,
    seed: int,
    noise_scale: float,
    confidence: float,
) -> str:
    """The summary in Markdown."""
    lines = [
        f"# {title}",
        "",
        f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns; sigma times "
        f"{noise_scale:g}, Gaussian errors, independent of each other. {alert.name}, VAL {alert.vertical_m:g} m, "
        f"seed {seed}. Least squares is exact; estimates have 95 % intervals, and a warning where their two "
        "estimators do not bear each other out. missed: |vertical error| > VAL and no alarm. misleading: |vertical "
        "error| > PL and no alarm. Nothing here holds for another geometry, noise or scale.",
        "",
        "## What is proven about the levels",
        "",
        *(f"- {sentence}" for method in methods for sentence in _proven(tables, method, confidence)),
        "",
        "## The worst bias on one satellite",
        "",
        _worst_text(tables.worst),
        "",
        "grid: the largest on a ramp of 5, 10, ..., 100 m; for estimates a rough value from the search, which may "
        "lie above the refined one by chance. about: the largest that the search saw, without an estimate of its "
        "own. (!): with a warning.",
        *_searched_text(tables.worst),
        "",
        "## The multiplier that keeps a target",
        "",
        _calibration_text(tables.calibration),
        "",
        f"K: the best value; bounds each at {100 * confidence:g} %: the upper one keeps the target, the lower one "
        "does not. alarms: at the upper bound, under the fault of the row. rare events: from the curve of P "
        "against K that subset simulation gives; check: P at the best value by importance sampling with other "
        "random numbers. (!): with a warning; no K where the two disagree.",
        *_checks(tables.calibration),
        "",
        "## Alarms at equal risk",
        "",
        "Each method with the multiplier that keeps the target under every fault of the table above, for targets "
        "that were sought under all of them. Without a fault an alarm is a price; under one it may be wanted, or "
        "not where the estimate is good in spite of it.",
        "",
        _equal_text(tables.equal_risk),
    ]
    if len(tables.pairs):
        lines += ["", "## The worst pairs", "", *_pair_text(tables.pairs)]
    if len(tables.budgets):
        lines += ["", "## Risk budgets", "", *_budget_text(tables.budgets)]
    warned = [
        f"- {row.method}, {row.event}, {row.satellite} {row.bias_m:g} m: {row.warning}."
        for row in tables.curves.itertuples()
        if row.warning
    ]
    if warned:
        lines += ["", "## Estimates with a warning", "", *warned]
    labels = [f"{one.name}: {method_label(one.name)}" for one in methods if method_label(one.name) != one.name]
    lines += ["", "; ".join(labels) + "."] if labels else []
    return "\n".join(lines) + "\n"


def _proven(tables: RiskTables, method: Method, confidence: float) -> list[str]:
    """Sentences about one method, each with its number, interval and denominator or estimator."""
    name, scale = method_label(method.name), getattr(method, "scale", None)
    k = float(getattr(method, "k_vertical", K_VERTICAL))
    what = f"{name}, K {k:g}" + (f", scale `{scale}`" if scale else "")
    said = []
    for event in ("misleading", "missed"):
        rows = tables.worst[(tables.worst.method == method.name) & (tables.worst.event == event)]
        if not rows.empty and rows.probability.notna().any():
            top = rows.loc[rows.probability.idxmax()]
            exact = top.low == top.high
            number = risk_text(top.probability, top.low, top.high, exact=exact)
            how = "exactly" if exact else "estimated, 95 % interval" + _second(top)
            least = f" at least {top.low / 1e-7:.3g} times 1e-7" if event == "misleading" and top.low > 1e-7 else ""
            where = f"{top.fault or 'none'}, {len(rows)} satellites searched"
            said.append(f"{what}: P({event}) under the worst single bias ({where}) is {number} ({how})"
                        + (f":{least}." if least else "."))  # fmt: skip
            continue
        seen = tables.curves[(tables.curves.method == method.name) & (tables.curves.event == event)]
        seen = seen[seen.estimator != _EXACT]
        if not seen.empty:
            sound = seen[(seen.warning == "") & seen.probability.notna()]
            where = f"{len(seen)} biases on {', '.join(dict.fromkeys(seen.satellite))}"
            if len(sound):
                top = sound.loc[sound.probability.idxmax()]
                said.append(
                    f"{what}: the largest P({event}) without a warning among {where} is "
                    f"{risk_text(top.probability, top.low, top.high)} ({top.satellite} {top.bias_m:g} m); "
                    f"{len(seen) - len(sound)} of the {len(seen)} estimates have a warning. The worst was not "
                    "searched for."
                )
            else:
                said.append(
                    f"{what}: P({event}) is not known at any of {where}; the largest upper bound is "
                    f"{seen.high.max():.2g}."
                )
    rows = tables.calibration[tables.calibration.method == method.name]
    for asked, group in rows.groupby("asked", sort=False):
        last = group.loc[group.target.idxmin()]
        own = "" if last.fault == asked else f" ({last.fault})"
        where = "fault-free" if asked == "none" else f"under {asked}{own}"
        found = "exactly" if last.found == _EXACT else f"{last.found}, each bound at {100 * confidence:g} %"
        doubt = f"; in doubt: {last.warning}" if last.warning else ""
        rarer = "; smaller targets were not sought" if last.target > tables.calibration.target.min() else ""
        if np.isnan(last.k_vertical):
            said.append(
                f"{what}: no multiplier is known for P({last.event}) of {last.target:g}, {where}{doubt}{rarer}."
            )
            continue
        said.append(
            f"{what}: for P({last.event}) of {last.target:g} per sample, {where}, K has to be {_k_text(last)} "
            f"({found}){doubt}{rarer}."
        )
    return said


def _second(row: Any) -> str:
    """What the second estimator says of a row of `worst_case`, where one ran."""
    value = getattr(row, "subset_probability", np.nan)
    return f"; the second estimator: {value:.3g} +- {row.subset_standard_error:.2g}" if value > 0 else ""


def _searched_text(worst: pd.DataFrame) -> list[str]:
    """What the search by estimates looked at, what may have been passed over, and its warnings."""
    rows = worst[worst.refined.notna()] if "refined" in worst else worst[:0]
    if rows.empty:
        return []
    lines = [
        "Searched by estimates: sizes from 1 to 150 m, by curves over all of them; both signs are equally bad. A "
        "part of the event that no population met, or a peak narrower than the steps between the sizes, may have "
        "been passed over; nothing bounds it."
    ]
    for (event, method), part in rows.groupby(["event", "method"], sort=False):
        refined = part[part.refined.astype(bool)]
        lines.append(
            f"- {event}, {method}: {int(part.evaluations.iloc[0]):,} scenarios, {len(part)} satellites, "
            f"{len(refined)} of them with a last estimate."
        )
        for row in part[part.warning != ""].itertuples():
            lines.append(f"  - {row.satellites}: {row.warning}.")
        for row in refined[refined.subset_probability > 0].itertuples():
            number = risk_text(row.probability, row.low, row.high)
            lines.append(f"  - {row.satellites} {row.bias_m:.1f} m: {number}{_second(row)}.")
    return ["", *lines[:1], "", *lines[1:]]


def _k_text(row: Any) -> str:
    if row.found == _EXACT:
        return f"{row.k_vertical:.4g}"
    if np.isnan(row.k_vertical):
        return "no number"
    return f"{row.k_vertical:.4g} [{row.k_low:.4g}, {row.k_high:.4g}]"


def _worst_text(worst: pd.DataFrame) -> str:
    keys = list(dict.fromkeys(zip(worst.event, worst.method, strict=True)))
    names = list(dict.fromkeys(worst.sort_values("probability", ascending=False).satellites))
    rows = []
    for name in names:
        cells = [name]
        for event, method in keys:
            part = worst[(worst.event == event) & (worst.method == method) & (worst.satellites == name)]
            if part.empty:
                cells += ["not searched", ""]
                continue
            row = part.iloc[0]
            exact = row.low == row.high
            size = "" if np.isnan(row.bias_m) else f" at {row.bias_m:.1f} m"
            mark = " (!)" if row.warning else ""
            number = risk_text(row.probability, row.low, row.high, exact=exact)
            if not exact and not row.refined:
                number = f"about {row.probability:.1g}" if row.probability > 0 else number
            cells += [number + size + mark]
            grid = row.grid_probability
            cells += [f"{grid:.2g}" if grid > 1e-30 else "< 1e-30" if grid >= 0 else ""]
        rows.append(cells)
    header = ["satellite"]
    for event, method in keys:
        header += [f"{event}, {method}", "grid"]
    return markdown_table(header, rows)


def _calibration_text(calibration: pd.DataFrame) -> str:
    methods = list(dict.fromkeys(calibration.method))
    rows = []
    for (asked, target), group in calibration.groupby(["asked", "target"], sort=False):
        cells = [str(asked), f"{target:g}"]
        for method in methods:
            part = group[group.method == method]
            if part.empty:
                cells += ["not sought", "", ""]
                continue
            row = part.iloc[0]
            mark = " (!)" if row.warning else ""
            own = "" if row.fault == asked else f", {row.fault}"
            cells += [_k_text(row) + mark, f"{row.found}{own}", _alarms(row)]
        rows.append(cells)
    header = ["fault", "target"]
    for method in methods:
        header += [f"K, {method}", "found", "alarms"]
    return markdown_table(header, rows)


def _checks(calibration: pd.DataFrame) -> list[str]:
    """What the second estimator says of every multiplier that comes from a curve, and what is in doubt."""
    rows = calibration[(calibration.check_probability > 0) | (calibration.warning != "")]
    lines = []
    for row in rows.itertuples():
        if row.check_probability > 0 and not np.isnan(row.k_vertical):
            text = f"P {risk_text(row.check_probability, row.check_low, row.check_high)} at K {row.k_vertical:.4g}"
        else:
            text = "no multiplier"
        doubt = f" (!) {row.warning}" if row.warning else ""
        lines.append(f"- check, {row.method}, {row.fault}, target {row.target:g}: {text}.{doubt}")
    return ["", *lines] if lines else []


def _pair_text(pairs: pd.DataFrame) -> list[str]:
    """The few worst pairs of each method and event."""
    rows = []
    for (event, method), group in pairs.groupby(["event", "method"], sort=False):
        known = group[group.probability.notna()].head(3)
        for row in known.itertuples():
            exact = row.low == row.high
            rows.append(
                [
                    str(event), str(method), row.satellites, f"{row.bias_1_m:.1f}, {row.bias_2_m:.1f}",
                    risk_text(row.probability, row.low, row.high, exact=exact),
                    "exact" if exact else f"{int(row.evaluations):,} scenarios, {len(group)} pairs",
                ]
            )  # fmt: skip
    table = markdown_table(["event", "method", "pair", "biases [m]", "probability", "found"], rows)
    note = (
        "Least squares is exact. For other methods every pair is screened by the limit state of 1024 draws, the "
        "best of them by small populations of subset simulation, and the three best estimated with noise of their "
        "own; a worse fault may have been passed over."
    )
    return [table, "", note]


def _alarms(row: Any) -> str:
    if row.found == _EXACT:
        return _rate(row.alarm_rate_after)
    if np.isnan(row.k_vertical):
        return ""
    if row.alarm_rate_after == 0:
        return f"0 (< {percent(row.alarm_rate_after_high)} %)"
    low, high = percent(row.alarm_rate_after_low), percent(row.alarm_rate_after_high)
    return f"{percent(row.alarm_rate_after)} % [{low}, {high}]"


def _rate(rate: float) -> str:
    return f"{percent(rate)} %" if rate > 1e-30 else "< 1e-28 %"


def _equal_text(table: pd.DataFrame) -> str:
    faults = list(dict.fromkeys(table.fault))
    rows = []
    for (target, method), group in table.groupby(["target", "method"], sort=False):
        group = group.set_index("fault")
        cells = [f"{target:g}", str(method), f"{group.k_vertical.iloc[0]:.4g}"]
        for fault in faults:
            row = group.loc[fault]
            if row.draws == 0:
                cells.append(_rate(row.alarm_rate))
            elif row.alarm_rate == 0:
                cells.append(f"0 (< {percent(row.alarm_high)} %)")
            else:
                cells.append(f"{percent(row.alarm_rate)} % [{percent(row.alarm_low)}, {percent(row.alarm_high)}]")
        rows.append(cells)
    rows.sort(key=lambda cells: -float(cells[0]))
    return markdown_table(["target", "method", "K", *(f"alarms, {fault}" for fault in faults)], rows)


def _budget_text(budgets: pd.DataFrame) -> list[str]:
    """One table per budget, modes summed by kind."""
    lines = []
    for _, group in budgets.groupby("budget", sort=False):
        first = group.iloc[0]
        total = group[group["mode"] == "total"].iloc[0]
        rows = []
        for kind, part in group.groupby("mode", sort=False):
            worst = part.loc[part.risk_per_approach.idxmax()]
            risk, low, high = (part[name].sum() for name in ("risk_per_approach", "risk_low", "risk_high"))
            exact = low == high
            rows.append(
                [
                    kind,
                    len(part),
                    f"{part.prior.sum():.3g}",
                    risk_text(risk, low, high, exact=exact),
                    "" if len(part) == 1 else worst.failed,
                    ", ".join(dict.fromkeys(part.found)),
                ]
            )
        known = total.risk_low == total.risk_high
        whole = risk_text(total.risk_per_approach, total.risk_low, total.risk_high, exact=known)
        lines += [
            f"{method_label(first.method)}, P({first.event}), {_BIASES[first.bias]}: {whole} per approach against "
            f"{first.target:g}: **{first.verdict}**.",
            "",
            markdown_table(["mode", "number", "prior", "risk per approach", "largest", "found"], rows),
            "",
        ]
    return lines
