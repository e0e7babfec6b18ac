"""What a sweep says in each of its views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from pl_mc.geometry import Geometry
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.report.document import Block, Paragraph, TextTable
from pl_mc.report.text import event_sentences, event_text, method_key, metres, percent
from pl_mc.statistics import fault_free_exceeded
from pl_mc.studies.sweep.record import SweepExperiment

EVENTS = ("alarm", "missed", "misleading")


def answer(tables: Mapping[str, pd.DataFrame], experiment: SweepExperiment) -> tuple[str, ...]:
    """At which fault each event is most frequent, method by method."""
    table = tables[{"faults": "rates", "satellites": "ramp_satellites", "map": "by_bias"}[experiment.view]]
    if experiment.view == "map":
        table = table.assign(fault=table.bias_m.map("{:g} m on any satellite".format))
    return event_sentences(table, experiment.alert_limits())


def faults_summary(
    experiment: SweepExperiment, g: Geometry, rates: pd.DataFrame, exact: pd.DataFrame, noise: NoiseModel
) -> tuple[Block, ...]:
    """The summary fault by fault; ``exact`` are the rates of least squares in closed form, epoch by epoch."""
    alert, series = experiment.alert_limits(), g.as_series()
    epochs = f"{len(series)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    count = series.satellite_count
    satellites = f"{count.min()}" if count.min() == count.max() else f"{count.min()}-{count.max()}"
    alarm = exact.groupby("fault", sort=False).alarm_rate.mean()
    named, of_exact = ("", "") if noise == GAUSSIAN else (f", noise {noise.name}", ", gaussian")
    return (
        Paragraph(
            f"Geometry: {epochs}, {satellites} satellites, {series.design.shape[2]} unknowns, error model "
            f"{experiment.geometry.error_model}{named}. Alert limit: {alert.name}, VAL "
            f"{metres(alert.val_m)} m. {experiment.draws:,} draws a fault and epoch, seed {experiment.seed}. "
            "Rates with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen."
        ),
        _rate_table(
            rates, "fault", EVENTS, "fault",
            beside=[f"alarm, LS exact{of_exact}"],
            beside_of=lambda fault: [f"{100 * alarm[fault]:.4g} %" if fault in alarm else "-"],
        ),
        Paragraph(
            "alarm: VPL > VAL, or no solution. missed: |vertical error| > VAL and no alarm. misleading: |vertical "
            "error| > VPL and no alarm."
        ),
        Paragraph(method_key(rates.method.unique())),
    )  # fmt: skip


def satellites_summary(
    experiment: SweepExperiment, g: Geometry, ramp: pd.DataFrame, exact: pd.DataFrame, satellites: pd.DataFrame
) -> tuple[Block, ...]:
    """The summary of a ramp on one satellite and on every other; ``exact`` are rates of least squares."""
    alert, by_fault = experiment.alert_limits(), exact.set_index("fault")
    worst = []
    for method, group in satellites.groupby("method", sort=False):
        for event in EVENTS:
            row = group.loc[group[f"{event}_rate"].idxmax()]
            worst.append([method, event, row.fault if row[f"{event}_rate"] else "any", event_text(row, event)])
    dof = int(g.satellite_count - g.unknown_count)
    return (
        Paragraph(
            f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns. {alert.name}, VAL "
            f"{alert.vertical_m:g} m. {experiment.draws:,} draws a bias, seed {experiment.seed}; 95 % "
            "Clopper-Pearson bounds. error > PL: |vertical error| > VPL, alarm or not."
        ),
        _rate_table(
            ramp, "fault", {"alarm": "alarm", "exceeded": "error > PL"}, "fault",
            beside=["alarm, LS exact", "error > PL, LS exact"],
            beside_of=lambda fault: [
                f"{percent(by_fault.alarm_rate[fault])} %", _tiny(by_fault.exceeded_rate[fault])
            ],
        ),
        Paragraph(
            f"Fault-free, LS, exact: P(|vertical error| > VPL) = {fault_free_exceeded(dof):.3e} (Student's t with "
            f"{dof} degrees of freedom), against the 1e-7 that K_V = 5.33 stands for."
        ),
        Paragraph(
            f"The same ramp on each of the {g.satellite_count} satellites, {experiment.draws_per_satellite:,} "
            "draws a bias: the fault at which each event is most frequent."
        ),
        TextTable.of(["method", "event", "fault", "rate"], worst),
    )  # fmt: skip


def map_summary(
    experiment: SweepExperiment, g: Geometry, by_bias: pd.DataFrame, by_satellite: pd.DataFrame
) -> tuple[Block, ...]:
    """The summary of a map."""
    alert = experiment.alert_limits()
    methods = list(dict.fromkeys(by_bias.method))
    scenarios = int(by_bias[by_bias.method == methods[0]].draws.sum())
    by_bias, by_satellite = (
        table.sort_values(key, kind="stable") for key, table in (("bias_m", by_bias), ("satellite", by_satellite))
    )
    return (
        Paragraph(
            f"{len(g)} epochs, every satellite in view in turn, {experiment.draws:,} draws each: {scenarios:,} "
            f"scenarios a method, seed {experiment.seed}. {alert.name}, VAL {alert.vertical_m:g} m. Rates over all "
            "epochs with 95 % bounds that count each noise draw once, since all faults of an epoch share its noise."
        ),
        _rate_table(by_bias, "bias_m", EVENTS, "bias [m]", word="{:g}".format),
        _rate_table(by_satellite, "satellite", EVENTS, "satellite"),
        Paragraph(method_key(methods)),
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
