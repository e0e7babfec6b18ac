"""What a Stanford diagram says: the counts of its regions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import pandas as pd

from pl_mc.engine.stanford import REGIONS, StanfordCounts
from pl_mc.geometry import Geometry
from pl_mc.report.document import Block, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import method_key, rate_text

if TYPE_CHECKING:
    from pl_mc.studies.stanford.run import StanfordExperiment

_MEANS = {
    "misleading": "The vertical error is beyond the protection level but within the alert limit, without alarm",
    "hazardously misleading": "It is beyond the alert limit without alarm (hazardously misleading)",
    "system unavailable": "The protection level is above the alert limit (an alarm)",
}


def summary(
    experiment: StanfordExperiment, g: Geometry, counts: StanfordCounts, regions: pd.DataFrame
) -> tuple[Block, ...]:
    """The blocks of the summary; ``regions`` is the table of that name."""
    alert, sizes = experiment.alert_limits(), experiment.faults
    rows = []
    for region in REGIONS:
        part = regions[regions.region == region].set_index("method")
        cells = [region]
        for method in counts.methods:
            row = part.loc[method]
            cells += [f"{int(row['count']):,}", _rate(row)]
        rows.append(cells)
    what = (
        "fault-free"
        if sizes is None
        else f"{sizes.start_m:g} to {sizes.stop_m:g} m in steps of {sizes.step_m:g} m on "
        f"{', '.join(experiment.satellites) or 'every satellite'} in turn, each size as often as the others"
    )
    epochs = f"{len(g)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    return (
        Paragraph(
            f"{epochs}, {what}; {experiment.draws:,} draws each, seed {experiment.seed}, sigma times "
            f"{experiment.noise_scale:g}: {counts.scenarios:,} scenarios a method. {alert.name}, VAL "
            f"{alert.vertical_m:g} m. Rates over all scenarios with 95 % bounds that count each noise draw once "
            f"({counts.independent_draws:,}), since all faults of an epoch share its noise. They are means over "
            "the faults of this run, not risks of a flight: a fault has no probability here."
        ),
        TextTable.of(["region", *(f"{word}, {m}" for m in counts.methods for word in ("count", "rate"))], rows),
        Paragraph(
            "system unavailable: VPL > VAL, an alarm. misleading: error beyond the level without an alarm, but "
            "within VAL. hazardously misleading: beyond VAL, which is a missed detection. Together they are what a "
            "sweep calls misleading."
        ),
        Paragraph(method_key(counts.methods)),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: StanfordExperiment) -> tuple[str, ...]:
    """How often misleading, hazardously misleading and unavailable."""
    regions = tables["regions"]
    sentences = []
    for region, means in _MEANS.items():
        rows = regions[regions.region == region]
        parts = [f"{method_label(str(row['method']))} in {_rate(row)}" for _, row in rows.iterrows()]
        sentences.append(f"{means}: {'; '.join(parts)} of all scenarios.")
    return tuple(sentences)


def _rate(row: pd.Series) -> str:
    return rate_text(int(row["count"]), int(row["scenarios"]), row["low"], row["high"])
