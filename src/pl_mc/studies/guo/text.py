"""What detectors say: false alarms first, then detection as it comes, and at equal false-alarm rates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.engine.detect_runs import LEVELS, NOMINAL
from pl_mc.report.document import Block, Paragraph, TextTable
from pl_mc.report.text import percent, rate_text
from pl_mc.studies.guo.paper import LETTERS, closest, paper_rate
from pl_mc.studies.guo.series import GuoSeries

if TYPE_CHECKING:
    from pl_mc.studies.guo.run import GuoExperiment

# Largest difference of rates at which a reading and a line of the paper are called close.
_CLOSE = 0.10


def summary(
    experiment: GuoExperiment, series: GuoSeries, detection: pd.DataFrame, hypotheses: pd.DataFrame
) -> tuple[Block, ...]:
    """The blocks of the summary; tables are those of their names."""
    g = series.geometry
    letters = np.array(g.systems)[g.satellite]
    gps, beidou = ((g.in_view & (letters == letter)).sum(axis=1) for letter in ("G", "C"))
    nominal, equal = (_rates(detection[detection.level == level]) for level in LEVELS)
    biases = sorted(bias for bias in detection.bias_m.unique() if bias)
    for test, letter in LETTERS.items():
        printed = [f"{100 * paper_rate(test, bias):.1f} %" for bias in biases]
        nominal.append([f"paper, {letter}", "as printed", "-", *printed])
    header = ["test", "reading", "P_FA measured", *(f"{bias:g} m" for bias in biases)]
    whose = "the receiver's own errors, fault-free" if series.real else "drawn noise without a fault"
    near = "; ".join(
        f"{row.test} ({row.reading}) and {row.line}, largest difference {100 * row.largest:.1f} points"
        for row in closest(hypotheses).itertuples()
        if row.largest < _CLOSE
    )
    return (
        Paragraph(
            f"{experiment.source.describe()}. {len(g)} epochs, {gps.min()}-{gps.max()} GPS and "
            f"{beidou.min()}-{beidou.max()} BeiDou satellites; the bias on the least detectable BeiDou satellite "
            f"(largest MDB) of each epoch. Nominal P_FA {percent(experiment.p_fa)} %, seed {experiment.seed}. "
            "Rates with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen. P_FA "
            f"is that of {whose}."
        ),
        Paragraph(
            "At the nominal thresholds, each with the false-alarm rate that it happens to have (not comparable):"
        ),
        TextTable.of(header, nominal),
        Paragraph("At thresholds of equal false-alarm rate (comparable):"),
        TextTable.of(header, equal),
        Paragraph(
            f"Lines of the paper that a reading comes within {100 * _CLOSE:g} points of at every bias: "
            f"{near or 'none'}."
        ),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: GuoExperiment) -> tuple[str, ...]:
    """Detection at the smallest bias, of the best and the worst reading; false alarms at nominal thresholds."""
    biased = tables["detection"][lambda table: table.bias_m > 0]
    bias = biased.bias_m.min()
    at = biased[biased.bias_m == bias]
    nominal, equal = at[at.level == NOMINAL], at[at.level != NOMINAL]
    best, worst = equal.loc[equal.detection_rate.idxmax()], equal.loc[equal.detection_rate.idxmin()]
    plain = min((row for _, row in nominal.iterrows()), key=lambda row: row.test != "chi2")
    least, most = nominal.loc[nominal.p_fa_measured.idxmin()], nominal.loc[nominal.p_fa_measured.idxmax()]
    return (
        f"At thresholds of equal false-alarm rate ({percent(experiment.p_fa)} % asked for) {_name(best)} finds a "
        f"bias of {bias:g} m most often, in {_detected(best)} of {int(best.epochs):,} epochs, and {_name(worst)} "
        f"least often, in {_detected(worst)}.",
        f"At its nominal threshold {_name(plain)} finds it in {_detected(plain)} and raises a false alarm in "
        f"{_false_alarms(plain)} of fault-free trials.",
        f"Nominal thresholds are not comparable: the false-alarm rates that they really have go from "
        f"{_false_alarms(least)} for {_name(least)} to {_false_alarms(most)} for {_name(most)}.",
    )


def _rates(level: pd.DataFrame) -> list[list[str]]:
    """False alarms and detections of each reading, bias by bias."""
    rows = []
    for (test, reading), group in level.groupby(["test", "reading"], sort=False):
        detected = [_detected(row) for row in group.itertuples() if row.bias_m]
        rows.append([str(test), str(reading), _false_alarms(group.iloc[0]), *detected])
    return rows


def _false_alarms(row: pd.Series) -> str:
    count = round(row.p_fa_measured * row.p_fa_trials)
    return rate_text(count, int(row.p_fa_trials), row.p_fa_low, row.p_fa_high)


def _detected(row: Any) -> str:
    return rate_text(int(row.detections), int(row.epochs), row.low, row.high)


def _name(row: pd.Series) -> str:
    return f"{row.test} ({row.reading})"
