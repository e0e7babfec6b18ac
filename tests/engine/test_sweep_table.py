"""The table of a sweep: its columns, what its counts imply of each other, its bounds, and rows left out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.engine import EVENTS
from pl_mc.methods import Igg3
from reference.problems import appendix_d, random_series

COUNTS = [event.count for event in EVENTS]


@pytest.fixture(scope="module")
def series():
    """Four epochs: G02 out of view at the second, five satellites for five unknowns at the third, then none."""
    in_view = np.ones((4, 8), dtype=bool)
    in_view[1, 1] = False
    in_view[2, 2:5] = False
    in_view[3] = False
    return random_series(np.random.default_rng(60), in_view, "GGGGGCCC", noise=4.0)


@pytest.fixture(scope="module")
def table(series):
    faults = (
        pl_mc.no_fault(series)
        + pl_mc.biases(series, {"G02": 50.0})
        + pl_mc.biases(series, {"G02": 50.0, "C07": -50.0})
        + pl_mc.biases(series, {"C08": 300.0})
    )
    methods = ("ls", Igg3(iterations=2), Igg3(iterations=2, scale="apriori"))
    return pl_mc.sweep(series, faults, draws=1000, seed=61, methods=methods, by_epoch=True)


def test_columns(table):
    expected = ["epoch", "method", "fault", "bias_m", "draws"]
    expected += [
        "alarms",
        "hazards",
        "missed",
        "exceeded",
        "misleading",
        "false_alarms",
        "unavailable",
        "unconverged",
        "tied",
    ]
    for name in (
        "alarm",
        "hazard",
        "missed",
        "exceeded",
        "misleading",
        "false_alarm",
        "unavailable",
        "unconverged",
        "tied",
    ):
        expected += [f"{name}_rate", f"{name}_low", f"{name}_high"]
    assert list(table.columns) == expected
    assert all(table[count].dtype == np.int64 for count in [*COUNTS, "draws"])
    assert (table["draws"] == 1000).all()
    assert list(table.index) == list(range(len(table)))


def test_rows_come_by_epoch_then_method_then_fault(table):
    first = table[table["epoch"] == 0]
    labels = ["none", "G02:+50m", "G02:+50m,C07:-50m", "C08:+300m"]
    names = ["ls", "igg3(iterations=2)", "igg3(iterations=2,scale=apriori)"]
    assert first["fault"].tolist() == labels * 3
    assert first["method"].tolist() == [name for name in names for _ in labels]
    assert table["epoch"].is_monotonic_increasing
    np.testing.assert_array_equal(first["bias_m"], [0, 50, np.nan, 300] * 3)


def test_faults_out_of_view_give_no_row_and_a_note(table):
    rows = {epoch: sorted(set(part["fault"])) for epoch, part in table.groupby("epoch")}
    assert rows[1] == ["C08:+300m", "none"]
    assert rows[3] == ["none"]
    assert len(rows[0]) == len(rows[2]) == 4
    assert table.attrs["notes"] == [
        "G02: out of view at 2 of 4 epochs, which give no row.",
        "G02, C07: out of view at 2 of 4 epochs, which give no row.",
        "C08: out of view at 1 of 4 epochs, which give no row.",
    ]


def test_a_series_is_summed_over_its_epochs_unless_asked_otherwise(series, table):
    faults = pl_mc.no_fault(series) + pl_mc.biases(series, {"G02": 50.0})
    methods = ("ls", Igg3(iterations=2), Igg3(iterations=2, scale="apriori"))
    summed = pl_mc.sweep(series, faults, draws=1000, seed=61, methods=methods)
    assert list(summed.columns)[:5] == ["method", "fault", "bias_m", "epochs", "draws"]
    kept = table[table["fault"].isin(["none", "G02:+50m"])].groupby(["method", "fault"], sort=False)
    by_fault = summed.set_index(["method", "fault"])
    sums = kept[[*COUNTS, "draws"]].sum()
    np.testing.assert_array_equal(by_fault.loc[sums.index, [*COUNTS, "draws"]], sums)
    np.testing.assert_array_equal(by_fault.loc[sums.index, "epochs"], kept.size())
    interval = stats.binomtest(int(sums["alarms"].iloc[0]), int(sums["draws"].iloc[0])).proportion_ci(0.95, "exact")
    np.testing.assert_allclose(by_fault.loc[sums.index[0], ["alarm_low", "alarm_high"]].astype(float), interval)


def test_no_note_where_everything_is_in_view():
    g = appendix_d()
    assert pl_mc.sweep(g, pl_mc.no_fault(g), draws=3, seed=1, methods=("ls",)).attrs["notes"] == []


def test_counts_imply_each_other(table):
    t = table
    assert (t[COUNTS] >= 0).all(axis=None)
    assert (t[COUNTS].le(t["draws"], axis=0)).all(axis=None)
    assert (t["missed"] <= t["hazards"]).all()
    assert (t["misleading"] <= t["exceeded"]).all()
    assert (t["unavailable"] <= t["alarms"]).all()
    # No alarm means VPL <= VAL, so that what is missed is misleading too.
    assert (t["missed"] <= t["misleading"]).all()
    # An alarm is unavailable, false, or over a hazard; a hazard is missed or under an alarm.
    np.testing.assert_array_equal(t["alarms"], t["unavailable"] + t["false_alarms"] + t["hazards"] - t["missed"])
    assert (t["hazards"] + t["unavailable"] <= t["draws"]).all()


def test_epochs_without_redundancy_are_unavailable_and_nothing_else(table):
    lost = table[table["epoch"] >= 2]
    assert (lost["unavailable"] == lost["draws"]).all()
    assert (lost["alarms"] == lost["draws"]).all()
    assert (lost[["hazards", "missed", "exceeded", "misleading", "false_alarms"]] == 0).all(axis=None)
    seen = table[(table["epoch"] < 2) & (table["method"] == "ls")]
    assert (seen["unavailable"] == 0).all()


def test_a_collapse_of_the_weights_is_unavailable_and_nothing_else(table):
    """Scale 1 and 300 m: hardly any weight is left."""
    lost = table.query("method == 'igg3(iterations=2,scale=apriori)' and fault == 'C08:+300m' and epoch == 0").iloc[0]
    assert lost["unavailable"] > 900
    np.testing.assert_array_equal(
        lost["alarms"], lost["unavailable"] + lost["false_alarms"] + lost["hazards"] - lost["missed"]
    )
    if lost["unavailable"] == lost["draws"]:
        assert lost[["hazards", "missed", "exceeded", "misleading", "false_alarms"]].sum() == 0


def test_rates_and_their_bounds(table):
    for event in EVENTS:
        np.testing.assert_array_equal(table[f"{event.name}_rate"], table[event.count] / table["draws"])
        for k in range(0, len(table), 5):
            count, draws = int(table.loc[k, event.count]), int(table.loc[k, "draws"])
            interval = stats.binomtest(count, draws).proportion_ci(0.95, method="exact")
            found = table.loc[k, [f"{event.name}_low", f"{event.name}_high"]].astype(float)
            np.testing.assert_allclose(found, interval, rtol=1e-9, atol=1e-15)


def test_every_event_says_what_it_means():
    assert len({event.name for event in EVENTS}) == len(EVENTS) == len(set(COUNTS))
    assert all(event.meaning for event in EVENTS)


def test_a_progress_bar_goes_to_standard_error(capsys):
    g = appendix_d()
    pl_mc.sweep(g, pl_mc.no_fault(g), draws=3, seed=1, methods=("ls",), progress=True)
    assert capsys.readouterr().out == ""
