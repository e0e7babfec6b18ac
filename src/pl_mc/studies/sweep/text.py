"""What a sweep says in each of its views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL, Judged
from pl_mc.geometry import Geometry
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.report.document import Block, Heading, Paragraph, TextTable
from pl_mc.report.text import event_sentences, event_text, method_key, metres, percent
from pl_mc.statistics import fault_free_exceeded
from pl_mc.studies.sweep.record import SweepExperiment

EVENTS = ("alarm", "missed", "misleading")


def answer(tables: Mapping[str, pd.DataFrame], experiment: SweepExperiment) -> tuple[str, ...]:
    """At which fault each event is most frequent, method by method."""
    table = tables[{"faults": "rates", "satellites": "ramp_satellites", "map": "by_bias"}[experiment.view]]
    if experiment.view == "map":
        table = table.assign(fault=table.bias_m.map("{:g} m on any satellite".format))
    said = [event_sentences(of_axis(table, judged), judged) for judged in experiment.judged()]
    # Event by event, each on all axes.
    return tuple(dict.fromkeys(sentence for sentences in zip(*said, strict=True) for sentence in sentences))


def of_axis(table: pd.DataFrame, judged: Judged) -> pd.DataFrame:
    """The rows of an axis, of a table that names axes where the vertical one does not decide alone."""
    return table[table["axis"] == judged.axis] if "axis" in table else table


def heads(judged: Sequence[Judged], blocks: Callable[[Judged], Sequence[Block]]) -> tuple[Block, ...]:
    """The blocks of each axis, below headings where there are several."""
    if len(judged) == 1:
        return tuple(blocks(judged[0]))
    titles = {VERTICAL: "Judged vertically", HORIZONTAL: "Judged horizontally", EITHER: "Judged by either limit"}
    return tuple(block for one in judged for block in (Heading(titles[one.axis]), *blocks(one)))


def axis_of_labels(judged: Sequence[Judged]) -> str:
    """Whose level the labels of methods name."""
    return judged[0].axis if len(judged) == 1 else EITHER


def _limits(judged: Sequence[Judged], form: Callable[[float], str] = "{:g}".format) -> str:
    """The limits that decide, each once."""
    return ", ".join(dict.fromkeys(words for one in judged for words in one.limits(form).split(", ")))


def _exact_alarm(alarm: pd.Series, fault: str) -> str:
    """A rate in closed form, which a fault that is drawn has not."""
    return f"{100 * alarm[fault]:.4g} %" if fault in alarm else "-"


def faults_summary(
    experiment: SweepExperiment, g: Geometry, rates: pd.DataFrame, exact: pd.DataFrame, noise: NoiseModel
) -> tuple[Block, ...]:
    """The summary fault by fault; ``exact`` are the rates of least squares in closed form, epoch by epoch."""
    alert, series, judged = experiment.alert_limits(), g.as_series(), experiment.judged()
    epochs = f"{len(series)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    count = series.satellite_count
    satellites = f"{count.min()}" if count.min() == count.max() else f"{count.min()}-{count.max()}"
    named, of_exact = ("", "") if noise == GAUSSIAN else (f", noise {noise.name}", ", gaussian")

    def of_one(one: Judged) -> tuple[Block, ...]:
        alarm = of_axis(exact, one).groupby("fault", sort=False).alarm_rate.mean()
        return (
            _rate_table(
                of_axis(rates, one), "fault", EVENTS, "fault",
                beside=[f"alarm, LS exact{of_exact}"] if len(alarm) else [],
                beside_of=lambda fault: [_exact_alarm(alarm, fault)] if len(alarm) else [],
            ),
            Paragraph(
                f"alarm: {one.alarm}, or no solution. missed: {one.beyond_limit} and no alarm. misleading: "
                f"{one.beyond_level} and no alarm."
            ),
        )  # fmt: skip

    return (
        Paragraph(
            f"Geometry: {epochs}, {satellites} satellites, {series.design.shape[2]} unknowns, error model "
            f"{experiment.geometry.error_model}{named}. Alert limit: {alert.name}, "
            f"{_limits(judged, metres)}. {experiment.draws:,} draws a fault and epoch, seed {experiment.seed}. "
            "Rates with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen."
        ),
        *heads(judged, of_one),
        Paragraph(method_key(rates.method.unique(), axis_of_labels(judged))),
    )


def satellites_summary(
    experiment: SweepExperiment, g: Geometry, ramp: pd.DataFrame, exact: pd.DataFrame, satellites: pd.DataFrame
) -> tuple[Block, ...]:
    """The summary of a ramp on one satellite and on every other; ``exact`` are rates of least squares."""
    alert, judged = experiment.alert_limits(), experiment.judged()
    dof = int(g.satellite_count - g.unknown_count)

    def of_one(one: Judged) -> list[Block]:
        by_fault = of_axis(exact, one).set_index("fault")
        worst = []
        for method, group in of_axis(satellites, one).groupby("method", sort=False):
            for event in EVENTS:
                row = group.loc[group[f"{event}_rate"].idxmax()]
                worst.append([method, event, row.fault if row[f"{event}_rate"] else "any", event_text(row, event)])
        known = bool(len(by_fault))
        blocks: list[Block] = [
            _rate_table(
                of_axis(ramp, one), "fault", {"alarm": "alarm", "exceeded": "error > PL"}, "fault",
                beside=["alarm, LS exact", "error > PL, LS exact"] if known else [],
                beside_of=lambda fault: [
                    f"{percent(by_fault.alarm_rate[fault])} %", _tiny(by_fault.exceeded_rate[fault])
                ] if known else [],
            ),
        ]  # fmt: skip
        if known:
            (called,) = one.called
            rate, law = by_fault.exceeded_rate["none"], "Gaussian vector beside a chi-square"
            if one.axis == VERTICAL:
                rate, law = fault_free_exceeded(dof), "Student's t"
            blocks.append(
                Paragraph(
                    f"Fault-free, LS, exact: P({one.beyond_level}) = {rate:.3e} ({law} with {dof} degrees of "
                    f"freedom), against the {called.promised} that {called.multiplier} stands for."
                )
            )
        told = Paragraph(
            f"The same ramp on each of the {g.satellite_count} satellites, {experiment.draws_per_satellite:,} "
            "draws a bias: the fault at which each event is most frequent."
        )
        return [*blocks, told, TextTable.of(["method", "event", "fault", "rate"], worst)]

    beyond = "; ".join(one.beyond_level for one in judged)
    return (
        Paragraph(
            f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns. {alert.name}, "
            f"{_limits(judged)}. {experiment.draws:,} draws a bias, seed {experiment.seed}; 95 % "
            f"Clopper-Pearson bounds. error > PL: {beyond}, alarm or not."
        ),
        *heads(judged, of_one),
    )


def map_summary(
    experiment: SweepExperiment, g: Geometry, by_bias: pd.DataFrame, by_satellite: pd.DataFrame
) -> tuple[Block, ...]:
    """The summary of a map."""
    alert, judged = experiment.alert_limits(), experiment.judged()
    methods = list(dict.fromkeys(by_bias.method))
    first = of_axis(by_bias, judged[0])
    scenarios = int(first[first.method == methods[0]].draws.sum())
    by_bias, by_satellite = (
        table.sort_values(key, kind="stable") for key, table in (("bias_m", by_bias), ("satellite", by_satellite))
    )
    return (
        Paragraph(
            f"{len(g)} epochs, every satellite in view in turn, {experiment.draws:,} draws each: {scenarios:,} "
            f"scenarios a method, seed {experiment.seed}. {alert.name}, {_limits(judged)}. Rates over all "
            "epochs with 95 % bounds that count each noise draw once, since all faults of an epoch share its noise."
        ),
        *heads(
            judged,
            lambda one: (
                _rate_table(of_axis(by_bias, one), "bias_m", EVENTS, "bias [m]", word="{:g}".format),
                _rate_table(of_axis(by_satellite, one), "satellite", EVENTS, "satellite"),
            ),
        ),
        Paragraph(method_key(methods, axis_of_labels(judged))),
    )


def _rate_table(
    rates: pd.DataFrame,
    key: str,
    events: Sequence[str] | Mapping[str, str],
    heading: str,
    *,
    word: Callable[[Any], str] = str,
    beside: Sequence[str] = (),
    beside_of: Callable[[Any], Iterable[str]] = lambda _: (),
) -> TextTable:
    """Rates of events, a row for each value of ``key`` and a column for each method and event.

    Args:
        rates: a sweep's table.
        key: column of the rows, headed ``heading``, whose values ``word`` writes.
        events: the events, or what to call each.
        beside: headings of further columns, whose cells ``beside_of`` tells from the value.
    """
    names = events.values() if isinstance(events, Mapping) else events
    header = [heading, *(f"{name}, {method}" for method in dict.fromkeys(rates.method) for name in names), *beside]
    rows = []
    for value, group in rates.groupby(key, sort=False):
        cells = [event_text(row, event) for row in group.itertuples() for event in events]
        rows.append([word(value), *cells, *beside_of(value)])
    return TextTable.of(header, rows)


def _tiny(rate: float) -> str:
    """A rate whose order of magnitude matters; below 1e-30 it is nothing."""
    return f"{rate:.2e}" if rate > 1e-30 else "< 1e-30"
