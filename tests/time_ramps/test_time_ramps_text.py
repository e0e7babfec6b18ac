"""What a run of ramps in time finds in words, and where IGG-III cannot but be least squares."""

from __future__ import annotations

import numpy as np
import pandas as pd

import pl_mc
from pl_mc.alert import Judged
from pl_mc.experiments.loading import load_experiment
from pl_mc.report.document import Paragraph, TextTable
from pl_mc.statistics import clopper_pearson
from pl_mc.studies.time_ramps.run import findings, notes_on_igg3

PASSES = 1000


def table() -> pd.DataFrame:
    """Two methods under a slow and a fast ramp: one late in 3 % of the slow passes, one never."""
    rows = []
    for method, late, error in (("a", (30, 0), (12.0, 15.0)), ("b", (0, 0), (3.0, 9.0))):
        for rate, count, middle in zip((0.01, 1.0), late, error, strict=True):
            row = {"tau_s": 0.0, "rate_m_per_s": rate, "method": method, "passes": PASSES, "hazards": PASSES}
            for limit, number in ((6, count), (10, count), (30, 0)):
                low, high = clopper_pearson(number, PASSES)
                row |= {
                    f"late_{limit}": number, f"late_{limit}_rate": number / PASSES, f"late_{limit}_low": float(low),
                    f"late_{limit}_high": float(high), f"undecided_{limit}": 0,
                }  # fmt: skip
            row |= {f"error_at_alert_50{end}_m": middle + step for end, step in (("", 0), ("_low", -1), ("_high", 1))}
            rows.append(row)
    return pd.DataFrame(rows)


def test_findings_say_who_alerts_in_time_where_and_at_which_error() -> None:
    explained, compared = findings(table(), judged=Judged(pl_mc.LPV_200))
    assert isinstance(explained, Paragraph)
    assert isinstance(compared, TextTable)
    assert "late in less than 1 % of passes" in explained.text
    first, second = (dict(zip(compared.header, row, strict=True)) for row in compared.rows)
    assert (first["in time, 6 s"], second["in time, 6 s"]) == ("1 m/s", "every rate")
    # By 30 s nobody is late.
    assert first["in time, 30 s"] == second["in time, 30 s"] == "every rate"
    assert first["most late by 6 s"].endswith("(30 of 1,000), 0.01 m/s")
    assert second["most late by 6 s"] == "0 (< 0.368 %) (0 of 1,000)"
    assert first["error at the alarm"] == "12.00 m [11.00, 13.00] at 0.01 m/s to 15.00 m [14.00, 16.00] at 1 m/s"
    nothing = findings(table().assign(hazards=0), judged=Judged(pl_mc.LPV_200))
    assert nothing == [Paragraph("White errors: no ramp took the vertical error beyond 35 m.")]


def test_igg3_is_least_squares_where_two_satellites_are_redundant() -> None:
    """To the last draw, under a bias that any of its weights would feel; and not with three redundant ones."""
    experiment = load_experiment("time-ramps")[1]
    (note,) = notes_on_igg3(experiment, 2)
    assert note.startswith("igg3: with 2 redundant satellites it is least squares by construction")
    assert notes_on_igg3(experiment, 3) == ()
    g = experiment.geometry.model_copy(update={"epoch": 300}).build()
    assert g.satellite_count - g.unknown_count == 2
    drawn = pl_mc.sample(g, pl_mc.biases(g, {"G11": 40.0}), draws=200, seed=1, methods=("ls", "igg3"))
    errors = {name: rows.up_m.to_numpy() for name, rows in drawn.groupby("method")}
    np.testing.assert_allclose(errors["igg3"], errors["ls"], rtol=1e-9)
