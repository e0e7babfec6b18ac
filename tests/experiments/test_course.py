"""The course of errors and levels that the page draws: parts of the time, gaps, units."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pl_mc.report.charts import charts_of
from pl_mc.report.document import TableEntry
from pl_mc.studies.observe.course import course_table


def epochs(times_s: np.ndarray, method: str = "ls") -> pd.DataFrame:
    """Errors that count up with the epochs; the last one is not available."""
    k = np.arange(times_s.size)
    return pd.DataFrame({
        "time": pd.Timestamp("2020-06-25") + pd.to_timedelta(times_s, unit="s"), "method": method,
        "east_m": 3.0 * k, "north_m": 4.0 * k, "up_m": -1.0 * k, "vpl_m": 10.0 + k, "hpl_m": 20.0 + k,
        "available": k < times_s.size - 1,
    })  # fmt: skip


def test_few_epochs_are_each_a_part() -> None:
    table = course_table(pd.concat([epochs(np.arange(10.0)), epochs(np.arange(10.0), "igg3")]))
    assert list(dict.fromkeys(table.data.curve)) == [
        "least squares, error", "least squares, level", "IGG-III, error", "IGG-III, level"
    ]  # fmt: skip
    error, level = (table.data[table.data.curve == f"least squares, {what}"] for what in ("error", "level"))
    assert error.time.tolist() == list(range(9))
    assert error.vertical_m.tolist() == error.vertical_low_m.tolist() == error.vertical_high_m.tolist()
    np.testing.assert_array_equal(error.vertical_m, np.arange(9.0))
    np.testing.assert_array_equal(error.horizontal_m, 5.0 * np.arange(9.0))
    np.testing.assert_array_equal(level.horizontal_m, 20.0 + np.arange(9.0))
    assert table.chart is not None
    assert table.chart.title == "Errors and levels in time, each epoch"
    assert table.chart.x_label == "time since 2020-06-25 00:00:00 [s]"


def test_a_long_day_becomes_equal_parts_that_hold_all_of_it() -> None:
    table = course_table(epochs(np.arange(86_401.0)))
    error = table.data[table.data.curve == "least squares, error"]
    assert len(error) == 240
    assert error.epochs.sum() == 86_400
    # Six minutes each, of which the errors count up by one a second.
    np.testing.assert_array_equal(error.vertical_low_m, 360.0 * np.arange(240))
    np.testing.assert_array_equal(error.vertical_high_m, 360.0 * np.arange(240) + 359.0)
    np.testing.assert_allclose(error.vertical_m, 360.0 * np.arange(240) + 179.5)
    np.testing.assert_allclose(error.time, 0.05 + 0.1 * np.arange(240))
    assert table.chart is not None
    assert table.chart.gap == pytest.approx(0.15)
    (chart,) = charts_of([TableEntry("course", table.chart)], {"course": table.data}, val_m=35.0, hal_m=40.0)
    assert chart["quantities"] == [
        {"label": f"{axis}, median and range [m]", "rate": False, "bounds": "smallest to largest"}
        for axis in ("vertical", "horizontal")
    ]
    assert chart["gap"] == pytest.approx(0.15)
    assert chart["x"].endswith("[h]")


def test_what_has_no_level_has_an_error_alone() -> None:
    table = epochs(np.arange(2000.0))
    table["vpl_m"] = np.inf
    found = course_table(table).data
    assert found[found.curve == "least squares, level"].vertical_m.isna().all()
    assert found[found.curve == "least squares, error"].vertical_m.notna().all()
