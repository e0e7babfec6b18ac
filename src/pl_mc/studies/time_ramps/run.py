"""Experiments of the kind ``time-ramps``: errors that grow on one satellite, and how long they stay unseen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from pydantic import Field, field_validator

from pl_mc.alert import HORIZONTAL, VERTICAL, Judged
from pl_mc.engine import Execution
from pl_mc.faults import NO_FAULT, parse_fault, require_satellite
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3
from pl_mc.report.document import Block, Heading, Paragraph, Summary, TextTable
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.report.text import metres, rate_text, row_rate, span
from pl_mc.runtime.progress import with_progress
from pl_mc.statistics import ls_quantities
from pl_mc.studies.spec import ByOneLevel, NamedChoice, SimulatedGeometry
from pl_mc.studies.strict import once
from pl_mc.studies.study import Check, Work, refuse
from pl_mc.studies.time_ramps.figures import alert_figure, late_figure, same_methods
from pl_mc.studies.time_ramps.levels import level_blocks, level_sentence, levels_figure, levels_of_banks
from pl_mc.time_ramps import sequential, time_to_alert
from pl_mc.time_ramps.passes import Test
from pl_mc.time_ramps.timing import LIMITS_S, require_calibration, require_onset

# Scales of IGG-III that are no smaller than the root mean square of the residuals.
_OF_THE_RESIDUALS = ("posterior", "posterior_floored")

# Epochs that a test solves a second, from the seconds of the shipped experiment's manifest, on two cores.
_EPOCHS_PER_S = 2.0e6

# Columns of the rate of false alarms: its count, of how many, and how the names of its bounds begin.
_FALSE = ("false_alarms", "false_alarm_passes", "false_alarm_")

# Of passes, the share that may be late where a method counts as alerting in time.
_FEW_LATE = 0.01


class SequentialChoice(NamedChoice):
    """A sequential test by name; every further field is an option of that test."""

    def build(self) -> Any:
        """The test's record."""
        return sequential(self.name, **self.options)


class TimeRampsExperiment(ByOneLevel):
    """Ramps of several rates on one satellite over a pass, at equal false-alarm rates; see `pl_mc.time_to_alert`.

    Attributes:
        sequential: sequential tests to compare with the methods, each a table with a name (sequential_parity,
            kalman or filter_bank, whose levels are compared too) and options of its own.
        satellite: the satellite whose error grows, in view throughout.
        rates_m_per_s: rates of the ramp [m/s]; 0 for the fault-free pass.
        taus_s: correlation times of the correlated part of the errors [s]; 0 for white errors.
        share: share of the correlated part in the variance of an error.
        smoothing_s: time constant of the carrier smoothing of the code noise [s]; 0 for none.
        onset_s: time before the ramp, in which windows and filters fill [s].
        draws: passes for each rate and correlation time.
        calibration_draws: fault-free passes for the thresholds, and as many to count false alarms.
        p_fa: false-alarm probability of a pass, the same for every method.
    """

    double_alone: ClassVar[bool] = True

    kind: Literal["time-ramps"] = "time-ramps"
    geometry: SimulatedGeometry
    satellite: str
    rates_m_per_s: Annotated[tuple[Annotated[float, Field(allow_inf_nan=False)], ...], Field(min_length=1)]
    taus_s: Annotated[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...], Field(min_length=1)]
    share: float = Field(default=0.5, ge=0, le=0.999)
    smoothing_s: float = Field(default=0.0, ge=0, le=3600)
    onset_s: float = Field(default=300.0, gt=0)
    draws: int = Field(ge=1)
    calibration_draws: int = Field(default=4000, ge=100)
    p_fa: float = Field(default=0.01, gt=0, lt=1)
    sequential: tuple[SequentialChoice, ...] = tuple(
        SequentialChoice(name=name) for name in ("sequential_parity", "kalman")
    )

    _once = field_validator("rates_m_per_s", "taus_s")(once)

    def tests(self) -> tuple[Test, ...]:
        """Methods and sequential tests, made records."""
        return (*self.method_records(), *(choice.build() for choice in self.sequential))


def run(experiment: TimeRampsExperiment, execution: Execution) -> Findings:
    """Times to alert at every rate and correlation time, and the geometry through the pass."""
    g, judged, tests, axis = experiment.geometry.build(), experiment.decides, experiment.tests(), experiment.level_axis
    taus = with_progress(
        iter(experiment.taus_s), total=len(experiment.taus_s), what="Correlation times", show=execution.progress
    )
    tables = [
        time_to_alert(
            g, experiment.satellite, experiment.rates_m_per_s, tests, tau_s=tau_s, draws=experiment.draws,
            seed=experiment.seed, share=experiment.share, smoothing_s=experiment.smoothing_s,
            onset_s=experiment.onset_s, p_fa=experiment.p_fa, calibration_draws=experiment.calibration_draws,
            alert=judged.alert, axis=axis, progress=False,
        )
        for tau_s in taus
    ]  # fmt: skip
    levels = levels_of_banks(
        g, experiment.satellite, experiment.rates_m_per_s, tests, experiment.taus_s, share=experiment.share,
        smoothing_s=experiment.smoothing_s, onset_s=experiment.onset_s, alert=judged.alert,
    )  # fmt: skip
    table = pd.concat(tables, ignore_index=True)
    if axis == VERTICAL and experiment.asked_axes() is None:
        table = table.drop(columns="axis")
    shown, geometry = comparable(table), _through_the_pass(g, experiment.satellite, axis)
    if shown.empty:
        raise InputError("methods: none of them can be brought to the false-alarm rate p_fa in this geometry.")
    left_out = tuple(
        f"{method}: it has no solution in more than {100 * experiment.p_fa:g} % of fault-free passes, so that no "
        "threshold keeps the false-alarm rate; it is in the table and left out of the comparison."
        for method in dict.fromkeys(table.method)
        if method not in set(shown.method)
    )
    return Findings(
        summary=summary(shown, geometry, experiment) + (() if levels is None else tuple(level_blocks(levels, judged))),
        tables=(
            Table("time_to_alert", table),
            *(() if levels is None else (Table("levels", levels),)),
            Table("geometry", geometry),
        ),
        notes=g.notes + left_out + notes_on_igg3(experiment, int(geometry.redundant.max())),
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: TimeRampsExperiment) -> tuple[Picture, ...]:
    """Errors and delays at the alarm, late alarms, and levels where there are any."""
    judged, title = experiment.decides, experiment.title
    made = (
        Picture(
            "time_to_alert", "Error at the alarm, and its delay after the hazard begins, by the rate of the ramp.",
            lambda: alert_figure(comparable(stored["time_to_alert"]), judged=judged, title=title),
        ),
        Picture(
            "late_alerts", "How often the alarm comes later than 6, 10 and 30 s after the hazard begins.",
            lambda: late_figure(comparable(stored["time_to_alert"]), title=title),
        ),
    )  # fmt: skip
    levels = Picture(
        "levels", "What the levels let pass under ramps of each rate, exactly, and how soon their tests alarm.",
        lambda: levels_figure(stored["levels"], judged=judged, title=title),
    )  # fmt: skip
    return (*made, levels) if "levels" in stored else made


def work(experiment: TimeRampsExperiment) -> Work:
    """Epochs solved: passes of every rate and those of the calibration, by every test, at every correlation."""
    passes = len(experiment.rates_m_per_s) * experiment.draws + 2 * experiment.calibration_draws
    solved = len(experiment.taus_s) * passes * experiment.geometry.epochs * len(experiment.tests())
    return Work(None, solved / _EPOCHS_PER_S)


def checks(experiment: TimeRampsExperiment, g: Geometry | None) -> Iterator[Check]:
    """Passes enough for the thresholds; and in the series a time before the ramp, and the satellite."""
    yield "calibration_draws", lambda: require_calibration(experiment.calibration_draws, experiment.p_fa)
    if g is None:
        return
    if not g.is_series:
        yield "geometry.epoch", lambda: refuse("a ramp in time needs a series of epochs; leave it out.")
        return
    yield "onset_s", lambda: require_onset(experiment.onset_s, experiment.geometry.interval_s, len(g))
    yield "satellite", lambda: require_satellite(g, experiment.satellite)


def with_faults(content: Mapping[str, Any], texts: Sequence[str]) -> dict[str, Any]:
    """The fields of a file whose ramps are these faults: in time, of one satellite, all from the same epoch on."""
    first, *_ = ramps = [part for text in texts for part in parse_fault(text) or (None,)]
    for ramp in ramps:
        alike = ramp and first and (ramp.of, ramp.first_epoch) == (first.of, first.first_epoch)
        if not (ramp and alike and ramp.per_second) or ramp.drawn or ramp.last_epoch is not None or len(ramp.of) > 1:
            raise InputError(
                f"--fault: {ramp or NO_FAULT}: time-ramps takes ramps of one satellite that begin together and go on "
                "to the end, such as G15:+0.1m/s."
            )
    given = content.get("geometry")
    interval_s = given.get("interval_s", 30.0) if isinstance(given, Mapping) else 30.0
    begin = {} if first is None or first.first_epoch is None else {"onset_s": first.first_epoch * interval_s}
    return {"satellite": first and first.of[0], "rates_m_per_s": [ramp.numbers[0] for ramp in ramps if ramp]} | begin


def notes_on_igg3(experiment: TimeRampsExperiment, redundant: int) -> tuple[str, ...]:
    """Where IGG-III cannot but be least squares.

    With r redundant satellites no residual is beyond sqrt(r) times its own standard deviation if the scale is that
    of the same residuals: v_i^2 / q_i is the part of v'Pv along one direction. Below k0 every weight is one.
    """
    limit = np.sqrt(redundant)
    same = [
        record.name
        for record in experiment.method_records()
        if isinstance(record, Igg3) and record.start == "ls" and record.scale in _OF_THE_RESIDUALS
        and record.k0 >= limit
    ]  # fmt: skip
    if not same:
        return ()
    return (
        f"{', '.join(same)}: with {redundant} redundant satellites it is least squares by construction. Its "
        "residuals are divided by a scale that they make themselves, so that none is beyond the root of the number "
        f"of redundant satellites, {limit:.3g}, which its limit k0 is not below: no weight is ever changed. What "
        "is said of it here says nothing of IGG-III where more satellites are in view.",
    )


def _through_the_pass(g: Geometry, satellite: str, axis: str) -> pd.DataFrame:
    """About every minute: satellites, redundancy, and what the faulted satellite does to the position on an axis."""
    rows = []
    for k in range(0, len(g), max(1, len(g) // 36)):
        epoch = g[k]
        redundant = int(epoch.satellite_count - epoch.unknown_count)
        if satellite not in epoch.names or redundant <= 0:
            continue
        place, quantities = epoch.names.index(satellite), ls_quantities(epoch)
        redundancy = float(redundancy_numbers(epoch)[place])
        gain, dop_m = float(quantities.gain[place]), float(quantities.vdop_m)
        if axis == HORIZONTAL:
            gain, dop_m = float(np.hypot(*quantities.horizontal_gain[:, place])), float(quantities.hdop_m)
        sigma = float(epoch.sigma_m[place])
        slope_m = abs(gain) * sigma / float(np.sqrt(redundancy)) if redundancy > 1e-9 else np.inf
        counts = int(epoch.epoch), int(epoch.satellite_count), redundant
        rows.append((*counts, sigma, redundancy, gain, slope_m, dop_m))
    columns = ["epoch", "satellites", "redundant", "sigma_m", "redundancy", f"{axis}_metres_per_metre"]
    spread = "sigma_up_m" if axis == VERTICAL else "sigma_horizontal_m"
    return pd.DataFrame(rows, columns=[*columns, "slope_m", spread])


def comparable(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of methods that a threshold could bring to the common false-alarm rate."""
    never = set(table.method[~np.isfinite(table.threshold)])
    return table[~table.method.isin(never)]


def summary(table: pd.DataFrame, geometry: pd.DataFrame, experiment: TimeRampsExperiment) -> Summary:
    """The findings, and for every correlation time how late alarms were.

    Args:
        table: see `pl_mc.time_to_alert`, of one or several correlation times.
        geometry: the faulted satellite through the pass.
        experiment: the record.
    """
    first, judged, p_fa = table.iloc[0], experiment.decides, experiment.p_fa
    (called,) = judged.called
    low, high, passes = geometry.slope_m.min(), geometry.slope_m.max(), int(first.false_alarm_passes)
    seen, redundant = (span(part.min(), part.max(), " to ") for part in (geometry.satellites, geometry.redundant))
    blocks: list[Block | str] = [
        f"{seen} satellites, {redundant} redundant. The error of {experiment.satellite} grows from "
        f"{experiment.onset_s:g} s on, for {first.monitored_s:g} s; its {judged.axis} slope (error per unit of test "
        f"statistic) is {metres(low)} to {metres(high)} m. {judged.alert.name}, {judged.limits()}. "
        f"{int(first.passes):,} passes a rate, seed {experiment.seed}; every method sees the same errors, of which "
        f"a share of {first['share']:g} of the variance is correlated (tau), the rest "
        + (f"code noise smoothed over {experiment.smoothing_s:g} s." if experiment.smoothing_s else "white."),
        f"Thresholds: at most {100 * p_fa:g} % of {passes:,} fault-free passes with an alarm, so that they "
        f"rest on {int(p_fa * first.false_alarm_passes)} of them; counted again on {passes:,} others. An alarm "
        f"is late if the {called.error} passed {called.limit} more than 6 s (10 s, 30 s) before it. Rates with 95 % "
        "Clopper-Pearson bounds. Methods on one line have the same numbers throughout.",
        Heading("Findings"),
        *findings(table, judged=judged),
    ]
    for tau, rows in table.groupby("tau_s", sort=False):
        rates, groups = _dangerous(rows), _by_rate(rows, same_methods(table))
        named = [f"{rate:g} m/s" for rate in rates]
        lates = [
            [name, row_rate(own.iloc[0], *_FALSE), *(_lates(own.loc[rate]) for rate in rates)] for name, own in groups
        ]
        times = [[name, *(_times(own.loc[rate]) for rate in rates)] for name, own in groups]
        blocks += [
            Heading(_heading(float(tau))),
            "False alarms, and alarms too late:",
            TextTable.of(
                ["method", "false alarms a pass", *(f"{rate}: late by 6 / 10 / 30 s" for rate in named)], lates
            ),
            f"Median and 95 % point of the time from the first error beyond {called.limit} to the alarm [s] "
            "(negative: the alarm came first; >: later than the end of the pass), then the median error at the alarm "
            "[m]:",
            TextTable.of(["method", *named], times),
        ]
    return tuple(blocks)


def findings(table: pd.DataFrame, *, judged: Judged) -> list[Block]:
    """What was measured, for each correlation time: who alerts in time at which rates, and the error at the alarm.

    Args:
        table: of methods at one false-alarm rate.
        judged: the axis with its limit.
    """
    blocks: list[Block] = []
    (called,), ((_, _, limit_m),) = judged.called, judged.levels
    groups = same_methods(table)
    header = ["method", *(f"in time, {limit} s" for limit in LIMITS_S), "most late by 6 s", "error at the alarm"]
    for tau, rows in table.groupby("tau_s", sort=False):
        rates, head = _dangerous(rows), _heading(float(tau))
        if not rates:
            blocks.append(Paragraph(f"{head}: no ramp took the {called.error} beyond {limit_m:g} m."))
            continue
        shown = ", ".join(f"{rate:g}" for rate in rates)
        blocks += [
            Paragraph(
                f"{head}, rates of {shown} m/s. In time: late in less than {100 * _FEW_LATE:g} % of passes (95 % "
                f"upper bound, {int(rows.passes.min()):,} passes a rate); the largest share of late passes, with "
                f"its rate; the smallest and the largest of the median {called.error}s at the alarm."
            ),
            TextTable.of(header, [_finding(name, own.loc[rates]) for name, own in _by_rate(rows, groups)]),
        ]
    return blocks


def answer(tables: Mapping[str, pd.DataFrame], experiment: TimeRampsExperiment) -> tuple[str, ...]:
    """How slow ramps, fast ramps (or levels) and false alarms went, at the largest correlation time."""
    table = comparable(tables["time_to_alert"])
    tau = float(table.tau_s.max())
    rows = table[(table.tau_s == tau) & (table.hazards > 0)]
    first, judged = table.iloc[0], experiment.decides
    (called,), ((_, _, limit),) = judged.called, judged.levels
    passes = f"{int(first.false_alarm_passes):,}"
    sentences = [
        f"Every method got a threshold with {100 * experiment.p_fa:g} % false alarms a pass of "
        f"{first.monitored_s / 60:g} min, set on {passes} fault-free passes; counted on {passes} others there were "
        f"between {100 * table.false_alarm_rate.min():.2f} % and {100 * table.false_alarm_rate.max():.2f} %."
    ]
    if rows.empty:
        return (*sentences, f"No ramp took the {called.error} beyond the alert limit.")
    groups = {group[0]: " = ".join(group) for group in same_methods(table)}
    ends = ((rows.rate_m_per_s.min(), "slowest"), (rows.rate_m_per_s.max(), "fastest"))
    for rate, kind in ends[:1] if "levels" in tables else ends:
        chosen = rows[(rows.rate_m_per_s == rate) & rows.method.isin(list(groups))].set_index("method")
        late = chosen.late_6_rate
        best = [text for name, text in groups.items() if name in late.index[late == late.min()]]
        sentences.append(
            f"In the {kind} ramp that became dangerous, {rate:g} m/s with tau {tau:g} s, the alarm came more "
            f"than 6 s after the alert limit of {limit:g} m was passed in {_late_text(chosen.loc[late.idxmin()])} "
            f"of passes with {'; '.join(best)}, the best, and in {_late_text(chosen.loc[late.idxmax()])} with "
            f"{groups[late.idxmax()]}, the worst."
        )
    return (*sentences, *([level_sentence(tables["levels"])] if "levels" in tables else []))


def _by_rate(rows: pd.DataFrame, groups: list[tuple[str, ...]]) -> list[tuple[str, pd.DataFrame]]:
    """Groups of `same_methods` with their rows by the rate of the ramp."""
    return [(", ".join(group), rows[rows.method == group[0]].set_index("rate_m_per_s")) for group in groups]


def _dangerous(rows: pd.DataFrame) -> list[float]:
    """Rates under which some pass had an error beyond the limit."""
    return [float(rate) for rate, own in rows.groupby("rate_m_per_s", sort=False) if own.hazards.max() > 0]


def _finding(name: str, own: pd.DataFrame) -> list[str]:
    """One line of the findings: a method at one correlation time, its rows by rate."""
    rates = [float(rate) for rate in own.index]
    in_time = [_rates(list(own.index[own[f"late_{limit}_high"] < _FEW_LATE]), rates) for limit in LIMITS_S]
    rate = own.late_6_rate.idxmax()
    row = own.loc[rate]
    at = f", {rate:g} m/s" if row.late_6 > 0 else ""
    late = f"{_late_text(row)} ({int(row.late_6):,} of {int(row.passes - row.undecided_6):,}){at}"
    known = own.error_at_alert_50_m[np.isfinite(own.error_at_alert_50_m)]
    ends = [] if known.empty else [known.idxmin(), known.idxmax()]
    errors = [f"{_error_text(own.loc[end])} at {end:g} m/s" for end in dict.fromkeys(ends)]
    return [name, *in_time, late, " to ".join(errors) or "no alarm in half of the passes"]


def _rates(kept: list[float], rates: list[float]) -> str:
    """``every rate``, ``from 0.1 m/s on``, ``0.1, 0.5 m/s``, ``no rate``."""
    if not kept:
        return "no rate"
    if kept == rates:
        return "every rate"
    if kept == rates[-len(kept) :]:
        return f"from {kept[0]:g} m/s on" if len(kept) > 1 else f"{kept[0]:g} m/s"
    return f"{', '.join(f'{rate:g}' for rate in kept)} m/s"


def _error_text(row: Any) -> str:
    """The median error at the alarm with its bounds."""
    bounds = (float(row[f"error_at_alert_50_{end}_m"]) for end in ("low", "high"))
    low, high = (metres(bound) if np.isfinite(bound) else ">" for bound in bounds)
    return f"{metres(float(row.error_at_alert_50_m))} m [{low}, {high}]"


def _late_text(row: Any) -> str:
    """The rate of alarms later than 6 s."""
    return rate_text(int(row.late_6), int(row.passes - row.undecided_6), row.late_6_low, row.late_6_high)


def _lates(row: Any) -> str:
    """The rates of alarms later than 6, 10 and 30 s, the first with its bounds."""
    if row.late_6 == 0:
        return _late_text(row)
    later = ["0" if row[f"late_{k}"] == 0 else f"{100 * row[f'late_{k}_rate']:.3g}" for k in LIMITS_S[1:]]
    left = "" if row.undecided_30 == 0 else f", {int(row.undecided_30)} cut off by the end"
    return f"{' / '.join([_late_text(row), *later])} %{left}"


def _times(row: Any) -> str:
    """Median and 95 % point of the delay, and the error at the alarm."""
    middle, most = (_seconds(row[f"alert_after_hazard_{q}_s"]) for q in (50, 95))
    return f"{middle}, {most}; {metres(float(row.error_at_alert_50_m))}"


def _seconds(value: float) -> str:
    if math.isnan(value):
        return "-"
    return ">" if math.isinf(value) else f"{value:g}"


def _heading(tau: float) -> str:
    return "White errors" if tau == 0 else f"Correlation time {tau:g} s"
