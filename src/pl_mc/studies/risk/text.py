"""What an experiment about risk says: what is proven, at what confidence, for which scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import HORIZONTAL, Judged
from pl_mc.geometry import Geometry
from pl_mc.methods import Method
from pl_mc.methods.capabilities import k_of
from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import method_key, percent, probability_text
from pl_mc.studies.risk.record import RiskExperiment
from pl_mc.studies.risk.tables import EXACT

_EVENTS = {"misleading": "misleading information", "missed": "missed detection", "alarm": "alarm"}
_BIASES = {"worst": "the worst bias of every mode", "given sizes": "biases of given sizes"}
# Columns that are called by their axis, under one name.
_EITHER = {"k_vertical": "k", "k_horizontal": "k"}


def summary(
    tables: Mapping[str, pd.DataFrame], experiment: RiskExperiment, g: Geometry, methods: Sequence[Method]
) -> tuple[Block, ...]:
    """The blocks of the summary.

    Args:
        tables: those of the run by name; their columns are explained where they are made.
        experiment: the record.
        g: the epoch.
        methods: of the experiment and of the calibration.
    """
    judged, confidence = experiment.decides, experiment.calibration.confidence
    tables = {name: table.rename(columns=_EITHER) for name, table in tables.items()}
    (called,) = judged.called
    labelled = [method.name for method in methods if method_label(method.name) != method.name]
    return (
        Paragraph(
            f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns; sigma times "
            f"{experiment.noise_scale:g}, Gaussian errors, independent of each other. {judged.alert.name}, "
            f"{judged.limits()}, seed {experiment.seed}. Least squares is exact; estimates have 95 % "
            "intervals, and a warning where their two estimators do not bear each other out. missed: "
            f"{judged.beyond_limit} and no alarm. misleading: {called.size} > PL and no alarm. Nothing here holds for "
            "another geometry, noise or scale."
        ),
        Heading("What is proven about the levels"),
        Bullets(tuple(sentence for method in methods for sentence in _proven(tables, method, judged, confidence))),
        Heading("The worst bias on one satellite"),
        _worst_biases(tables["worst"]),
        Paragraph(
            "grid: the largest on a ramp of 5, 10, ..., 100 m; for estimates a rough value from the search, which "
            "may lie above the refined one by chance. about: the largest that the search saw, without an estimate "
            "of its own. (!): with a warning."
        ),
        *_searched(tables["worst"]),
        Heading("The multiplier that keeps a target"),
        _multipliers(tables["calibration"]),
        Paragraph(
            f"K: the best value; bounds each at {100 * confidence:g} %: the upper one keeps the target, the lower "
            "one does not. alarms: at the upper bound, under the fault of the row. rare events: from the curve of "
            "P against K that subset simulation gives; check: P at the best value by importance sampling with "
            "other random numbers. (!): with a warning; no K where the two disagree."
        ),
        *_list(_checks(tables["calibration"])),
        Heading("Alarms at equal risk"),
        Paragraph(
            "Each method with the multiplier that keeps the target under every fault of the table above, for "
            "targets that were sought under all of them. Without a fault an alarm is a price; under one it may be "
            "wanted, or not where the estimate is good in spite of it."
        ),
        _equal_risk(tables["equal_risk"]),
        *_pairs(tables["pairs"], judged.axis),
        *_budgets(tables["budgets"], judged.axis),
        *_list(
            (
                f"{row.method}, {row.event}, {row.satellite} {row.bias_m:g} m: {row.warning}."
                for row in tables["curves"].itertuples()
                if row.warning
            ),
            "Estimates with a warning",
        ),
        *((Paragraph(method_key(labelled, judged.axis)),) if labelled else ()),
    )


def risk_text(value: float, low: float, high: float) -> str:
    """``1.2e-07 [1.0e-07, 1.5e-07]``; an upper bound where there is no more, the number alone where it is exact."""
    if low == high:
        return probability_text(value) if value > 1e-30 else "< 1e-30"
    if np.isnan(value):
        return f"no number; in [{low:.2g}, {high:.2g}]" if low > 0 else f"< {high:.2g}"
    return f"{probability_text(value)} [{probability_text(low)}, {probability_text(high)}]"


def _risk(row: Any) -> str:
    return risk_text(row.probability, row.low, row.high)


def _alarms(rate: float, low: float, high: float) -> str:
    """A share of alarms; an upper bound where none was counted, the number alone where it is exact."""
    if low == high:
        return f"{percent(rate)} %" if rate > 1e-30 else "< 1e-28 %"
    return f"0 (< {percent(high)} %)" if rate == 0 else f"{percent(rate)} % [{percent(low)}, {percent(high)}]"


def _list(items: Iterator[str], heading: str = "") -> tuple[Block, ...]:
    """A list, below its heading; nothing where it has no item."""
    found = tuple(items)
    above = (Heading(heading),) if heading else ()
    return (*above, Bullets(found)) if found else ()


def _of(table: pd.DataFrame, **values: object) -> pd.DataFrame:
    """The rows that have these values."""
    for name, value in values.items():
        table = table[table[name] == value]
    return table


def _groups(table: pd.DataFrame, *names: str) -> Any:
    """Groups of rows in the order in which they come."""
    return table.groupby(list(names) if len(names) > 1 else names[0], sort=False)


def _proven(tables: Mapping[str, pd.DataFrame], method: Method, judged: Judged, confidence: float) -> Iterator[str]:
    """Sentences about one method, each with its number, interval and denominator or estimator."""
    (called,) = judged.called
    scale, k = getattr(method, "scale", None), k_of(method, judged.axis)
    what = f"{method_label(method.name, judged.axis)}, K {k:g}" + (f", scale `{scale}`" if scale else "")
    for event in ("misleading", "missed"):
        rows = _of(tables["worst"], method=method.name, event=event)
        seen = _of(tables["curves"], method=method.name, event=event)
        seen = seen[seen.estimator != EXACT]
        if rows.probability.notna().any():
            top = rows.loc[rows.probability.idxmax()]
            how = "exactly" if top.low == top.high else "estimated, 95 % interval" + _second(top)
            beyond = event == "misleading" and top.low > called.promise
            least = f": at least {top.low / called.promise:.3g} times {called.promised}" if beyond else ""
            yield (
                f"{what}: P({event}) under the worst single bias ({top.fault or 'none'}, {len(rows)} satellites "
                f"searched) is {_risk(top)} ({how}){least}."
            )
        elif len(seen):
            sound = seen[(seen.warning == "") & seen.probability.notna()]
            where = f"{len(seen)} biases on {', '.join(dict.fromkeys(seen.satellite))}"
            if len(sound):
                top = sound.loc[sound.probability.idxmax()]
                yield (
                    f"{what}: the largest P({event}) without a warning among {where} is {_risk(top)} "
                    f"({top.satellite} {top.bias_m:g} m); {len(seen) - len(sound)} of the {len(seen)} estimates "
                    "have a warning. The worst was not searched for."
                )
            else:
                bound = f"the largest upper bound is {seen.high.max():.2g}"
                yield f"{what}: P({event}) is not known at any of {where}; {bound}."
    calibration = tables["calibration"]
    for asked, group in _groups(_of(calibration, method=method.name), "asked"):
        last = group.loc[group.target.idxmin()]
        own = "" if last.fault == asked else f" ({last.fault})"
        where = "fault-free" if asked == "none" else f"under {asked}{own}"
        doubt = f"; in doubt: {last.warning}" if last.warning else ""
        rarer = "; smaller targets were not sought" if last.target > calibration.target.min() else ""
        if np.isnan(last.k):
            yield f"{what}: no multiplier is known for P({last.event}) of {last.target:g}, {where}{doubt}{rarer}."
            continue
        how = "exactly" if last.found == EXACT else f"{last.found}, each bound at {100 * confidence:g} %"
        yield (
            f"{what}: for P({last.event}) of {last.target:g} per sample, {where}, K has to be {_k_text(last)} "
            f"({how}){doubt}{rarer}."
        )


def _second(row: Any) -> str:
    """What the second estimator says of a row of `worst_case`, where one ran."""
    value = getattr(row, "subset_probability", np.nan)
    return f"; the second estimator: {value:.3g} +- {row.subset_standard_error:.2g}" if value > 0 else ""


def _k_text(row: Any) -> str:
    if row.found == EXACT:
        return f"{row.k:.4g}"
    bounds = f"[{row.k_low:.4g}, {row.k_high:.4g}]"
    return "no number" if np.isnan(row.k) else f"{row.k:.4g} {bounds}"


def _worst_biases(worst: pd.DataFrame) -> TextTable:
    keys = [key for key, _ in _groups(worst, "event", "method")]
    rows = []
    for name in dict.fromkeys(worst.sort_values("probability", ascending=False).satellites):
        cells = [name]
        for event, method in keys:
            part = _of(worst, event=event, method=method, satellites=name)
            if part.empty:
                cells += ["not searched", ""]
                continue
            row = part.iloc[0]
            rough = row.low != row.high and not row.refined and row.probability > 0
            number = f"about {row.probability:.1g}" if rough else _risk(row)
            size = "" if np.isnan(row.bias_m) else f" at {row.bias_m:.1f} m"
            grid = row.grid_probability
            cells.append(number + size + (" (!)" if row.warning else ""))
            cells.append(f"{grid:.2g}" if grid > 1e-30 else "< 1e-30" if grid >= 0 else "")
        rows.append(cells)
    return TextTable.of(["satellite", *(word for key in keys for word in (", ".join(key), "grid"))], rows)


def _searched(worst: pd.DataFrame) -> tuple[Block, ...]:
    """What the search by estimates looked at, what may have been passed over, and its warnings."""
    rows = worst[worst.refined.notna()] if "refined" in worst else worst[:0]
    items: list[str | Bullets] = []
    for (event, method), part in _groups(rows, "event", "method"):
        refined = part[part.refined.astype(bool)]
        items.append(
            f"{event}, {method}: {int(part.evaluations.iloc[0]):,} scenarios, {len(part)} satellites, "
            f"{len(refined)} of them with a last estimate."
        )
        further = [f"{row.satellites}: {row.warning}." for row in part[part.warning != ""].itertuples()]
        for row in refined[refined.subset_probability > 0].itertuples():
            further.append(f"{row.satellites} {row.bias_m:.1f} m: {_risk(row)}{_second(row)}.")
        items += [Bullets(tuple(further))] if further else []
    if not items:
        return ()
    about = (
        "Searched by estimates: sizes from 1 to 150 m, by curves over all of them; both signs are equally bad. A "
        "part of the event that no population met, or a peak narrower than the steps between the sizes, may have "
        "been passed over; nothing bounds it."
    )
    return Paragraph(about), Bullets(tuple(items))


def _multipliers(calibration: pd.DataFrame) -> TextTable:
    methods = list(dict.fromkeys(calibration.method))
    rows = []
    for (asked, target), group in _groups(calibration, "asked", "target"):
        cells = [asked, f"{target:g}"]
        for method in methods:
            part = _of(group, method=method)
            if part.empty:
                cells += ["not sought", "", ""]
                continue
            row = part.iloc[0]
            own = "" if row.fault == asked else f", {row.fault}"
            cells += [_k_text(row) + (" (!)" if row.warning else ""), f"{row.found}{own}"]
            known = row.found == EXACT or not np.isnan(row.k)
            bounds = row.alarm_rate_after_low, row.alarm_rate_after_high
            cells.append(_alarms(row.alarm_rate_after, *bounds) if known else "")
        rows.append(cells)
    columns = (word for method in methods for word in (f"K, {method}", "found", "alarms"))
    return TextTable.of(["fault", "target", *columns], rows)


def _checks(calibration: pd.DataFrame) -> Iterator[str]:
    """What the second estimator says of every multiplier that comes from a curve, and what is in doubt."""
    rows = calibration[(calibration.check_probability > 0) | (calibration.warning != "")]
    for row in rows.itertuples():
        text = "no multiplier"
        if row.check_probability > 0 and not np.isnan(row.k):
            risk = risk_text(row.check_probability, row.check_low, row.check_high)
            text = f"P {risk} at K {row.k:.4g}"
        doubt = f" (!) {row.warning}" if row.warning else ""
        yield f"check, {row.method}, {row.fault}, target {row.target:g}: {text}.{doubt}"


def _equal_risk(table: pd.DataFrame) -> TextTable:
    faults = list(dict.fromkeys(table.fault))
    rows = []
    for (target, method), group in _groups(table, "target", "method"):
        by_fault = group.set_index("fault").loc[faults]
        alarms = [_alarms(row.alarm_rate, row.alarm_low, row.alarm_high) for row in by_fault.itertuples()]
        rows.append([f"{target:g}", method, f"{group.k.iloc[0]:.4g}", *alarms])
    rows.sort(key=lambda cells: -float(cells[0]))
    return TextTable.of(["target", "method", "K", *(f"alarms, {fault}" for fault in faults)], rows)


def _pairs(pairs: pd.DataFrame, axis: str) -> tuple[Block, ...]:
    """The few worst pairs of each method and event."""
    if pairs.empty:
        return ()
    rows = []
    for (event, method), group in _groups(pairs, "event", "method"):
        for row in group[group.probability.notna()].head(3).itertuples():
            spent = f"{int(row.evaluations):,} scenarios, {len(group)} pairs"
            how = EXACT if row.low == row.high else spent
            biases = f"{row.bias_1_m:.1f}, {row.bias_2_m:.1f}"
            rows.append([event, method, row.satellites, biases, _risk(row), how])
    exactly = "Of each method" if axis == HORIZONTAL else "Least squares is exact. For other methods"
    return (
        Heading("The worst pairs"),
        TextTable.of(["event", "method", "pair", "biases [m]", "probability", "found"], rows),
        Paragraph(
            f"{exactly} every pair is screened by the limit state of 1024 draws, "
            "the best of them by small populations of subset simulation, and the three best estimated with noise "
            "of their own; a worse fault may have been passed over."
        ),
    )


def _budgets(budgets: pd.DataFrame, axis: str) -> tuple[Block, ...]:
    """One table per budget, modes summed by kind."""
    if budgets.empty:
        return ()
    blocks: list[Block] = [Heading("Risk budgets")]
    for _, group in _groups(budgets, "budget"):
        total = _of(group, mode="total").iloc[0]
        rows = []
        for kind, part in _groups(group, "mode"):
            risk = risk_text(*(part[name].sum() for name in ("risk_per_approach", "risk_low", "risk_high")))
            largest = "" if len(part) == 1 else part.loc[part.risk_per_approach.idxmax()].failed
            how = ", ".join(dict.fromkeys(part.found))
            rows.append([kind, len(part), f"{part.prior.sum():.3g}", risk, largest, how])
        whole = risk_text(total.risk_per_approach, total.risk_low, total.risk_high)
        blocks += [
            Paragraph(
                f"{method_label(total.method, axis)}, P({total.event}), {_BIASES[total.bias]}: {whole} per approach "
                f"against {total.target:g}: **{total.verdict}**."
            ),
            TextTable.of(["mode", "number", "prior", "risk per approach", "largest", "found"], rows),
        ]
    return tuple(blocks)


def answer(tables: Mapping[str, pd.DataFrame], experiment: RiskExperiment) -> tuple[str, ...]:
    """The likeliest fault of each method, the totals of the budgets against their target, the multipliers."""
    worst, budgets, calibration = tables["worst"], tables["budgets"], tables["calibration"].rename(columns=_EITHER)
    axis = experiment.decides.axis
    faults = []
    for (event, method), group in _groups(worst[worst.probability.notna()], "event", "method"):
        row = group.loc[group.probability.idxmax()]
        bounds = "(exact)" if row.low == row.high else f"[{_number(row.low)}, {_number(row.high)}]"
        what = f"{method_label(method, axis)}, {_EVENTS[event]}"
        faults.append(f"{what}: {_number(row.probability)} {bounds} at {row.fault}")
    totals = [
        f"{method_label(row.method, axis)}, {_EVENTS[row.event]}, {_number(row.risk_per_approach)} "
        f"[{_number(row.risk_low)}, {_number(row.risk_high)}] against {row.target:g}, {row.verdict}"
        for row in (_of(budgets, mode="total") if "mode" in budgets else budgets).itertuples()
    ]
    needs = []
    for method, group in _groups(calibration[calibration.k.notna()], "method"):
        rarest = group[group.target == group.target.min()]
        row = rarest.loc[rarest.k.idxmax()]
        # Infinite bounds are those of a multiplier that two estimates disagree about.
        bounds = "" if row.k_low == row.k_high else f" [{row.k_low:.4g}, {row.k_high:.4g}]"
        under = "without a fault" if row.fault == "none" else f"under {row.fault}"
        kept = f"{_EVENTS.get(row.event, row.event)} at {row.target:g} {under}"
        needs.append(f"{method_label(method, axis)} needs K = {row.k:.4g}{bounds} to keep {kept}")
    return (
        f"The worst fault of one satellite ({'; '.join(faults)})." if faults else "No worst fault was found.",
        f"Risk per approach over the fault modes: {'; '.join(totals)}." if totals else "No budget was asked for.",
        f"The multiplier of the protection level: {'; '.join(needs)}." if needs else "No multiplier was found.",
    )


def _number(value: float) -> str:
    return probability_text(value) if value > 1e-30 or value == 0 else "below 1e-30"
