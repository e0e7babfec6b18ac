"""What runs of fault detectors say in three sentences: compared at equal false-alarm rates, and as they come."""

from __future__ import annotations

import pandas as pd

from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import percent, rate_text


def guo_answer(run: RunFolder) -> tuple[str, ...]:
    """Detection at the smallest bias, of the best and the worst reading; false alarms at nominal thresholds."""
    table = run.tables["detection"]
    biased = table[table.bias_m > 0]
    bias = biased.bias_m.min()
    at = biased[biased.bias_m == bias]
    equal, nominal = at[at.level != "nominal"], at[at.level == "nominal"]
    best, worst = equal.loc[equal.detection_rate.idxmax()], equal.loc[equal.detection_rate.idxmin()]
    chi2 = nominal[nominal.test == "chi2"]
    plain = (chi2 if len(chi2) else nominal).iloc[0]
    least, most = nominal.loc[nominal.p_fa_measured.idxmin()], nominal.loc[nominal.p_fa_measured.idxmax()]
    aimed = float(run.experiment.get("p_fa", plain.p_fa_nominal))
    return (
        f"At thresholds of equal false-alarm rate ({percent(aimed)} % asked for) {_name(best)} finds a bias of "
        f"{bias:g} m "
        f"most often, in {_rate(best)} of {int(best.epochs):,} epochs, and {_name(worst)} least often, in "
        f"{_rate(worst)}.",
        f"At its nominal threshold {_name(plain)} finds it in {_rate(plain)} and raises a false alarm in "
        f"{_false_alarms(plain)} of fault-free trials.",
        f"Nominal thresholds are not comparable: the false-alarm rates that they really have go from "
        f"{_false_alarms(least)} for {_name(least)} to {_false_alarms(most)} for {_name(most)}.",
    )


def _false_alarms(row: pd.Series) -> str:
    count = round(row.p_fa_measured * row.p_fa_trials)
    return rate_text(count, int(row.p_fa_trials), row.p_fa_low, row.p_fa_high)


def _name(row: pd.Series) -> str:
    return f"{row.test} ({row.reading})"


def _rate(row: pd.Series) -> str:
    return rate_text(int(row.detections), int(row.epochs), row.low, row.high)
