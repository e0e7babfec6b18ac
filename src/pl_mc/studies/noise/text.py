"""What an experiment about noise models says: its summary and its answer."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pl_mc.geometry import Geometry
from pl_mc.noise_models import GAUSSIAN
from pl_mc.report.document import Block, Heading, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import EVENT_MEANS, event_text, method_key, metres, percent, rate_text
from pl_mc.statistics.least_squares import ls_quantities

if TYPE_CHECKING:
    from pl_mc.studies.noise.run import NoiseExperiment


def summary(experiment: NoiseExperiment, g: Geometry, tables: Mapping[str, pd.DataFrame]) -> tuple[Block, ...]:
    """One screen for every part, of the epoch and the tables by name."""
    factors, exposures = tables["factors"], tables["exposures"]
    quantities, alert, satellite = ls_quantities(g), experiment.alert_limits(), experiment.faults.satellite
    gain = float(quantities.gain[g.names.index(satellite)])
    rare, given = experiment.rare, experiment.exposure
    return (
        Paragraph(
            f"{len(g.names)} satellites, {int(quantities.dof)} redundant, VDOP {metres(float(quantities.vdop_m))} "
            f"m of least squares; alert limit {alert.name}, VAL {metres(alert.vertical_m)} m. "
            f"{int(factors.draws.iloc[0]):,} draws for each fault and noise model, seed {experiment.seed}, all "
            "models made from the same numbers. Whatever the noise, methods believe in Gaussian errors with the "
            f"satellites' sigma. A metre on {satellite} moves least squares {'up' if gain > 0 else 'down'} by "
            f"{abs(gain):.2f} m."
        ),
        Paragraph(
            "Rates with 95 % Clopper-Pearson bounds; in brackets the factor against Gaussian noise with the "
            "quotients of opposite bounds (least squares under Gaussian noise: the exact rate). `0 (< x %)` is the "
            "upper bound where nothing was seen."
        ),
        Heading("Alarms"),
        _rates(factors[factors.event == "alarm"]),
        Heading("Misleading: |vertical error| > VPL and no alarm"),
        _rates(factors[factors.event == "misleading"]),
        Heading(f"P({rare.event}) where the sweep counted fewer than {rare.fewest_events}"),
        Paragraph(
            "By `pl_mc.risk`: importance sampling checked by subset simulation, or plain counts; no number where "
            "they do not bear each other out."
        ),
        _risks(tables["risks"]) if len(tables["risks"]) else Paragraph("None."),
        Heading(f"{given.event} at least once in an exposure, Gauss-Markov errors"),
        *_exposures(exposures[exposures.event == given.event], given.assumed_samples),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: NoiseExperiment) -> tuple[str, ...]:
    """Each event under Gaussian noise and under the model that makes it most frequent."""
    rates, val_m = tables["rates"], experiment.alert_limits().vertical_m
    sentences = []
    for event, means in EVENT_MEANS.items():
        clauses = []
        for name, group in rates.groupby("method", sort=False):
            gaussian = group.noise == GAUSSIAN.name
            parts = []
            for part in (group[gaussian], group[~gaussian]):
                if part.empty:
                    continue
                row = part.loc[part[f"{event}_rate"].idxmax()]
                seen = row[f"{event}_rate"] > 0
                model = f"{row.noise}, the most" if seen else "any other model"
                under = GAUSSIAN.name if row.noise == GAUSSIAN.name else model
                parts.append(f"{event_text(row, event)}{f' at {row.fault}' if seen else ''} with {under}")
            clauses.append(f"{method_label(str(name))} {', '.join(parts)}")
        sentences.append(f"{means.format(val=val_m)}, at the worst fault: {'; '.join(clauses)}.")
    return tuple(sentences)


def fault_words(fault: str) -> str:
    """A fault's label, in words where there is none."""
    return "no fault" if fault == "none" else fault


def assumed_share(rows: pd.DataFrame, assumed: int) -> float:
    """What a budget makes of the rate per sample: the share of exposures of so many independent samples.

    The rate is pooled over all exposures of the rows, whose marginals are the same.
    """
    rate = rows.samples_with.sum() / (rows.exposures * rows.samples).sum()
    return -float(np.expm1(assumed * np.log1p(-rate)))


def _rates(rows: pd.DataFrame) -> TextTable:
    faults = list(dict.fromkeys(rows.fault))
    cells = []
    for (noise, method), group in rows.groupby(["noise", "method"], sort=False):
        by_fault = group.set_index("fault")
        cells.append([noise, method, *(_rate(by_fault.loc[fault]) for fault in faults)])
    return TextTable.of(["noise", "method", *map(fault_words, faults)], cells)


def _rate(row: pd.Series) -> str:
    text = rate_text(int(row["count"]), int(row.draws), row.low, row.high)
    certain = abs(row.factor - 1.0) < 5e-4 and row.rate > 0.99
    if row.noise == GAUSSIAN.name or certain:
        return text
    if np.isfinite(row.factor):
        return f"{text} (x{_short(row.factor)} [{_short(row.factor_low)}, {_short(row.factor_high)}])"
    return f"{text} (> x{_short(row.factor_low)})" if np.isfinite(row.factor_low) else text


def _short(value: float) -> str:
    if not np.isfinite(value):
        return "?"
    return f"{value:.3g}" if value < 1e4 else f"{value:.1e}"


def _risks(risks: pd.DataFrame) -> TextTable:
    rows = []
    for row in risks.itertuples():
        number = f"[{row.low:.1e}, {row.high:.1e}]"
        if np.isfinite(row.probability):
            number = f"{row.probability:.2e} [{row.low:.2e}, {row.high:.2e}]"
        rows.append([row.noise, row.method, row.fault, number, row.estimator, row.warning or "-"])
    return TextTable.of(["noise", "method", "fault", "probability [95 %]", "by", "warning"], rows)


def _exposures(rows: pd.DataFrame, assumed: int) -> tuple[Block, ...]:
    methods, first = list(dict.fromkeys(rows.method)), rows.iloc[0]
    cases = list(product(dict.fromkeys(rows.fault), methods))
    by_case = rows.set_index(["tau_s", "fault", "method"]).sort_index()
    cells = [
        [f"{tau:g}", *(_exposure(by_case.loc[tau, *case]) for case in cases)] for tau in dict.fromkeys(rows.tau_s)
    ]
    budget = [
        f"{percent(assumed_share(rows[(rows.fault == fault) & (rows.method == method)], assumed))} %"
        for fault, method in cases
    ]
    return (
        Paragraph(
            f"{int(first.samples)} samples an exposure, {int(first.exposures):,} exposures a cell; m is the number "
            "of independent samples that would have the same share (95 %; from ten exposures with the event on). "
            f"Last line: what the rate per sample, pooled over all lines, gives with {assumed} independent "
            f"samples. {method_key(methods)}"
        ),
        TextTable.of(
            ["tau [s]", *(f"{fault_words(fault)}, {method}" for fault, method in cases)],
            [*cells, [f"{assumed} independent", *budget]],
        ),
    )


def _exposure(row: pd.Series) -> str:
    share = rate_text(int(row.exposures_with), int(row.exposures), row.any_low, row.any_high)
    if not np.isfinite(row.effective_low):
        return share
    return f"{share}; m = {row.effective_samples:.3g} [{row.effective_low:.3g}, {row.effective_high:.3g}]"
