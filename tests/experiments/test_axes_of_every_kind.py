"""Kinds that judge by one axis at a time: series, noise, variants, tuning and risk by the horizontal limit."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.tuning import tune
from pl_mc.studies.tuning import STUDY

RAIL = {"name": "rail", "horizontal_m": 10.0}
BOTH = {"name": "both", "vertical_m": 15.0, "horizontal_m": 10.0}
WITH_AXIS = ("curves", "worst", "steps", "calibration", "multiplier_curves", "equal_risk")
EPOCH = {"epochs": 1, "epoch": 0}
GPS = EPOCH | {"constellations": ("GPS",), "without": ("G19",)}
# Three plain solutions are compiled and solved in a part of the time that settled ones take, and judged by the same
# axis.
PLAIN = {"name": "igg3", "iterations": 3}
METHODS = ("ls", pl_mc.igg3(iterations=3))
SERIES: dict[str, Any] = {
    "kind": "series", "title": "rail", "seed": 3, "compare": "static", "redraws": 1,
    "source": {"kind": "site", "epochs": 40}, "faults": {"windows": [[10, 29]], "highest_m": 60.0},
}  # fmt: skip
NOISE: dict[str, Any] = {
    "kind": "noise", "title": "rail", "draws": 600, "seed": 5, "geometry": EPOCH,
    "faults": {"satellite": "G12", "sizes_m": [20.0]}, "noises": ["gaussian", {"name": "student_t", "nu": 3.0}],
    "methods": ["ls", PLAIN], "rare": {"fewest_events": 1, "sizes_m": [20.0], "max_evaluations": 500_000},
    "exposure": {"taus_s": [5.0], "duration_s": 5.0, "draws": 256, "event": "alarm", "sizes_m": [20.0]},
}  # fmt: skip
VARIANTS: dict[str, Any] = {
    "kind": "variants", "title": "rail", "draws": 300, "weight_draws": 40, "seed": 3,
    "geometry": {"epochs": 4, "interval_s": 7200.0}, "faults": {"start_m": 20.0, "stop_m": 60.0, "step_m": 40.0},
    "variants": [{"group": "scale", "label": "apriori", "options": {"scale": "apriori", "iterations": 3}}],
}  # fmt: skip
RAMP = {"satellite": "G12", "start_m": 20.0, "stop_m": 40.0, "step_m": 20.0}
COMPARE: dict[str, Any] = {
    "kind": "compare", "title": "rail", "draws": 300, "seed": 3, "faults": RAMP, "methods": ["ls", "slope"],
    "geometry": {"epochs": 4, "interval_s": 7200.0, "epoch": 0}, "day": {"every": 2, "draws": 100, "equal_draws": 100},
    "equal": {"p_fa": 0.05, "draws": 300, "faults": RAMP | {"start_m": 4.0, "step_m": 18.0}, "methods": ["slope"]},
}  # fmt: skip
READINGS: dict[str, Any] = {
    "kind": "readings", "title": "rail", "seed": 3, "compare": "static", "redraws": 1,
    "source": SERIES["source"], "faults": SERIES["faults"], "readings": [{"varies": "base", "label": "defaults"}],
}  # fmt: skip
KINDS = {"series": SERIES, "noise": NOISE, "variants": VARIANTS}
# A table of each that names the axis, with the columns that its rows are told apart by.
TABLES = {"series": ("redraws",), "noise": ("rates", "factors", "exposures"), "variants": ("variants", "worst")}


def run(content: dict[str, Any], out: Path) -> Path:
    return run_experiment("one", build_experiment(content, source="test"), out).folder


def words_of(folder: Path) -> str:
    """All that a reader sees: the document with its captions, and the notes."""
    return (folder / "report.json").read_text() + (folder / "summary.md").read_text()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("kind", KINDS)
def test_a_horizontal_limit_alone_is_judged_and_nothing_else_is_said_to_be(kind: str, tmp_path: Path) -> None:
    folder = run(KINDS[kind] | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    # Errors of a series are told direction by direction, as the paper does.
    said = said.replace("Vertical errors over all epochs", "").replace("the vertical error ranges", "")
    assert not re.search(r"VAL|VPL|[Vv]ertical|VDOP|K_V", said)
    assert "HAL 10" in said
    assert "is not judged" not in said
    for name in TABLES[kind]:
        assert set(pd.read_csv(folder / f"{name}.csv").axis) == {HORIZONTAL}


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("kind", KINDS)
def test_the_vertical_that_is_asked_for_is_what_it_is_unasked_but_for_its_name(kind: str, tmp_path: Path) -> None:
    unasked = run(KINDS[kind] | {"alert": BOTH}, tmp_path / "unasked")
    asked = run(KINDS[kind] | {"alert": BOTH, "axes": "vertical"}, tmp_path / "asked")
    for name in TABLES[kind]:
        plain, named = (pd.read_csv(folder / f"{name}.csv") for folder in (unasked, asked))
        assert set(named.pop("axis")) == {VERTICAL}
        pd.testing.assert_frame_equal(plain, named)
    assert "horizontal alert limit of both, 10 m, is not judged" in words_of(unasked)


def test_a_series_counts_what_its_epochs_say(tmp_path: Path) -> None:
    for axis in (HORIZONTAL, EITHER):
        folder = run(SERIES | {"alert": BOTH, "axes": axis}, tmp_path / axis)
        epochs = pd.read_parquet(folder / "epochs.parquet")
        assert set(epochs.axis) == {axis}
        size_m = np.hypot(epochs.east_m, epochs.north_m)
        level, limit = epochs.hpl_m > 10.0, size_m > 10.0
        exceeded = size_m > epochs.hpl_m
        if axis == EITHER:
            level, limit = level | (epochs.vpl_m > 15.0), limit | (epochs.up_m.abs() > 15.0)
            exceeded |= epochs.up_m.abs() > epochs.vpl_m
        assert (epochs.alarm == (level | ~epochs.available)).all()
        counts = pd.read_csv(folder / "redraws.csv").query("redraw == 0").set_index("method")
        for method, rows in epochs[epochs.faulted].groupby("method"):
            assert counts.alarms[method] == rows.alarm.sum()
            assert counts.unalerted[method] == (limit & ~epochs.alarm)[rows.index].sum()
            assert counts.exceeded[method] == (exceeded & epochs.available)[rows.index].sum()
        # The figure of the levels has the name of what it shows.
        assert (folder / ("fig5_hpl.png" if axis == HORIZONTAL else "fig5_vpl_hpl.png")).is_file()


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made and not drawn, which takes longer than all the rest."""
    monkeypatch.setattr("pl_mc.report.files.save_figure", lambda *_: None)


@pytest.mark.usefixtures("undrawn")
def test_a_comparison_horizontally(tmp_path: Path) -> None:
    folder = run(COMPARE | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    # Its tables of levels have both.
    assert not re.search(r"VAL|VPL|[Vv]ertical|VDOP|K_V", said)
    assert "HPL > HAL, or the method's test" in said
    assert "HPL <= HAL without a fault" in said
    for name in ("rates", "overview", "means", "equal", "equal_means", "day_rates", "day_equal_rates"):
        assert set(pd.read_csv(folder / f"{name}.csv").axis) == {HORIZONTAL}
    series = pl_mc.simulate(epochs=4, interval_s=7200.0)
    compared(folder, series[0], pl_mc.AlertLimits("rail", horizontal_m=10.0), HORIZONTAL)
    # The geometries and their satellites, from the covariance of the position.
    gains = [np.linalg.pinv(one.design / one.sigma_m[:, None])[:2] / one.sigma_m for one in series]
    spread = [np.linalg.norm(gain * one.sigma_m) for gain, one in zip(gains, series, strict=True)]
    table = pd.read_csv(folder / "geometries.csv").set_index("geometry")
    for name, k in (("strongest", int(np.argmin(spread))), ("weakest", int(np.argmax(spread)))):
        assert table.epoch[name] == k
        assert table.faulted[name] == series[k].names[int(np.hypot(*gains[k]).argmax())]
        assert table.hdop_min_m[name] == pytest.approx(spread[k])


@pytest.mark.usefixtures("undrawn")
def test_a_comparison_by_either_limit(tmp_path: Path) -> None:
    folder = run(COMPARE | {"alert": BOTH, "axes": EITHER, "day": None, "equal": None}, tmp_path / "out")
    g, alert = pl_mc.simulate(epochs=1)[0], pl_mc.AlertLimits("both", vertical_m=15.0, horizontal_m=10.0)
    compared(folder, g, alert, EITHER)
    position = np.linalg.inv((g.design / g.sigma_m[:, None] ** 2).T @ g.design)[:3, :3]
    assert f"PDOP {np.sqrt(np.trace(position)):.3f} m" in words_of(folder)
    assert "VPL > VAL or HPL > HAL, or the method's test" in words_of(folder)
    assert "is not judged" not in words_of(folder)


def compared(folder: Path, g: pl_mc.Geometry, alert: pl_mc.AlertLimits, axis: str) -> None:
    """Events of a comparison are those of the sweep, and what is available is within all limits that there are."""
    faults = pl_mc.no_fault(g) + pl_mc.ramp(g, satellite="G12", start_m=20.0, stop_m=40.0, step_m=20.0)
    options: dict[str, Any] = {"draws": 300, "seed": 3, "methods": ("ls", "slope"), "alert": alert}
    swept = pl_mc.sweep(g, faults, axes=axis, progress=False, **options)
    rates = pd.read_csv(folder / "rates.csv", keep_default_na=False)
    assert set(rates.axis) == {axis}
    for event in ("alarms", "missed", "misleading", "hazards"):
        assert rates[event].tolist() == swept[event].tolist()
    overview = pd.read_csv(folder / "overview.csv")
    overview = overview if "geometry" not in overview else overview[overview.geometry == "epoch 0"]
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), **options)
    within = (drawn.vpl_m <= alert.val_m) & (drawn.hpl_m <= alert.hal_m)
    assert overview.set_index("method").within.to_dict() == within.groupby(drawn.method).sum().to_dict()


@pytest.mark.usefixtures("undrawn")
def test_readings_horizontally_are_their_series(tmp_path: Path) -> None:
    folder = run(READINGS | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    assert not re.search(r"VAL|VPL|[Vv]ertical|VDOP|K_V|vpl", said)
    assert "Alarm: HPL > HAL (rail, HAL 10 m), or no solution." in said
    readings = pd.read_csv(folder / "readings.csv")
    assert set(readings.axis) == set(pd.read_csv(folder / "distances.csv").axis) == {HORIZONTAL}
    series = run(SERIES | {"alert": RAIL}, tmp_path / "series")
    redraws = pd.read_csv(series / "redraws.csv")
    assert readings.alarms.tolist() == redraws.alarms.tolist()
    assert readings.unalerted.tolist() == redraws.unalerted.tolist()
    medians = pd.read_parquet(series / "epochs.parquet").query("not faulted").groupby("method", sort=False).hpl_m
    assert readings[readings.redraw == 0].median_clean_hpl_m.tolist() == pytest.approx(medians.median().tolist())


@pytest.mark.usefixtures("without_figures")
def test_noise_models_horizontally_are_the_sweeps_and_exposures(tmp_path: Path) -> None:
    folder = run(NOISE | {"alert": RAIL}, tmp_path / "out")
    g = pl_mc.simulate(epochs=1)[0]
    faults, alert = pl_mc.no_fault(g) + pl_mc.biases(g, {"G12": 20.0}), pl_mc.AlertLimits("rail", horizontal_m=10.0)
    swept = pl_mc.sweep(g, faults, draws=600, seed=5, alert=alert, methods=METHODS, progress=False)
    exact = pl_mc.exact.ls_rates(g, faults, alert=alert, axis="horizontal")
    factors = pd.read_csv(folder / "factors.csv").query("noise == 'gaussian' and event == 'alarm'")
    assert factors["count"].tolist() == swept.alarms.tolist()
    np.testing.assert_allclose(factors.gaussian_rate[factors.method == "ls"], exact.alarm_rate, rtol=1e-9)
    counted = pl_mc.exposure(
        g, faults.only(1), tau_s=[5.0], draws=256, seed=5, duration_s=5.0, alert=alert, methods=METHODS, progress=False
    )
    stored = pd.read_csv(folder / "exposures.csv")
    assert stored.exposures_with.tolist() == counted.exposures_with.tolist()
    assert set(pd.read_csv(folder / "risks.csv").axis) == {HORIZONTAL}


@pytest.mark.usefixtures("without_figures")
def test_variants_are_faulted_where_the_horizontal_error_moves_most(tmp_path: Path) -> None:
    folder = run(VARIANTS | {"alert": RAIL}, tmp_path / "out")
    faults = pd.read_csv(folder / "faults.csv").set_index(["geometry", "fault_class"])
    series = pl_mc.simulate(**VARIANTS["geometry"])
    found = pl_mc.statistics.ls_quantities(series)
    for geometry, pick in (("strongest", np.argmin), ("weakest", np.argmax)):
        epoch = int(pick(found.hdop_m))
        g = series[epoch]
        gains = pl_mc.statistics.ls_quantities(g).horizontal_gain
        reach = np.hypot(*gains)
        row = faults.loc[(geometry, "largest influence")]
        assert row.epoch == epoch
        assert row.satellites == g.names[int(reach.argmax())]
        assert row.horizontal_metres_per_metre == pytest.approx(reach.max())
        one, other = faults.loc[(geometry, "double")].satellites.split()
        together = np.hypot(*gains[:, [g.names.index(one), g.names.index(other)]].sum(axis=1))
        assert faults.loc[(geometry, "double")].horizontal_metres_per_metre == pytest.approx(together)
        assert together >= reach.max()


@pytest.mark.parametrize("content", [*KINDS.values(), COMPARE, READINGS], ids=lambda content: content["kind"])
def test_one_axis_at_a_time(content: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="axes: this kind of experiment judges by one axis at a time"):
        build_experiment(content | {"alert": BOTH, "axes": [VERTICAL, HORIZONTAL]}, source="test")
    with pytest.raises(InputError, match="axes: horizontal needs a horizontal limit"):
        build_experiment(content | {"alert": {"vertical_m": 15}, "axes": HORIZONTAL}, source="test")


def test_variants_have_one_error_and_one_level() -> None:
    with pytest.raises(InputError, match="axes: this kind of experiment has one error and one level"):
        build_experiment(VARIANTS | {"alert": BOTH, "axes": EITHER}, source="test")


def test_exposures_of_either_limit_hold_those_of_both() -> None:
    g = pl_mc.simulate(epochs=1)[0]
    alert = pl_mc.AlertLimits("both", vertical_m=15.0, horizontal_m=10.0)
    options: dict[str, Any] = {"tau_s": 5.0, "draws": 512, "seed": 5, "duration_s": 5.0, "alert": alert}
    options |= {"methods": METHODS}
    fault = pl_mc.biases(g, {"G12": 12.0})
    found = {
        axis: pl_mc.exposure(g, fault, axis=axis, progress=False, **options) for axis in (VERTICAL, HORIZONTAL, EITHER)
    }
    unasked = pl_mc.exposure(g, fault, progress=False, **options)
    pd.testing.assert_frame_equal(unasked, found[VERTICAL].drop(columns="axis"))
    assert "is not judged" in unasked.attrs["unjudged"]
    seen = {axis: table[table.event == "alarm"].exposures_with.to_numpy() for axis, table in found.items()}
    assert (seen[EITHER] >= np.maximum(seen[VERTICAL], seen[HORIZONTAL])).all()
    assert (seen[EITHER] <= seen[VERTICAL] + seen[HORIZONTAL]).all()
    assert seen[EITHER][0] > 0
    with pytest.raises(InputError, match="axis: horizontal needs a horizontal limit"):
        pl_mc.exposure(g, fault, axis="horizontal", **options | {"alert": pl_mc.AlertLimits("up", vertical_m=3.0)})


TUNING: dict[str, Any] = {
    "kind": "tuning", "title": "rail", "seed": 5, "geometry": GPS,
    "targets": [1e-2], "methods": ["ls", PLAIN], "faults": [{"G22": 5.0}], "draws": 4096,
    "search_draws": 1024, "steps": 1, "objectives": ["hpl"], "max_evaluations": 500_000,
}  # fmt: skip
RISK: dict[str, Any] = {
    "kind": "risk", "title": "rail", "seed": 5, "noise_scale": 3.0, "geometry": GPS,
    "worst": {"events": ["misleading"]}, "methods": ["ls", PLAIN],
    "curves": {"satellites": ["G22"], "step_m": 25.0, "misleading_m": [12.5], "target_cov": 0.3},
    "budgets": [],
    "calibration": {
        "targets": [1e-2], "faults": [{}, {"G22": 12.5}], "fewest_draws": 2000, "alarm_satellite": "G22",
        "alarm_biases_m": [0.0, 20.0], "alarm_draws": 300, "worst_sizes_m": [10.0],
    },
}  # fmt: skip


@pytest.mark.usefixtures("undrawn")
def test_tuned_limits_horizontally(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[tune.__module__], "_STARTS", ())
    folder = run(TUNING | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    assert not re.search(r"VAL|VPL|[Vv]ertical|vpl|K_V", said)
    assert "HAL 10" in said
    assert "mean HPL" in said
    table = pd.read_csv(folder / "tuned.csv", keep_default_na=False, na_values=[""])
    assert set(table.axis) == {HORIZONTAL}
    rows = table[table.tuned_for != "alarms"].set_index("limits")
    g = pl_mc.simulate(epochs=1, constellations=("GPS",), without=("G19",))[0]
    faults, alert = pl_mc.biases(g, {"G22": 5.0}), pl_mc.AlertLimits("rail", horizontal_m=10.0)
    least = pl_mc.calibrate(g, method="ls", target=1e-2, faults=faults, event="misleading", alert=alert)
    assert rows.k_horizontal["exact"] == pytest.approx(least.k_horizontal[0], rel=1e-9)
    # Mean level of least squares against draws with that multiplier.
    ls = pl_mc.methods.Ls(k_horizontal=float(least.k_horizontal[0]))
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), draws=20_000, seed=3, methods=(ls,), alert=alert)
    error = drawn.hpl_m.std() / np.sqrt(len(drawn))
    assert abs(drawn.hpl_m.mean() - rows.hpl_m["exact"]) < 4.0 * error
    assert abs(drawn.alarm.mean() - rows.alarm_rate["exact"]) < 0.02
    # The robust estimate's multiplier keeps the target: other draws bear it out, within four standard errors of both.
    robust = pl_mc.methods.Igg3(iterations=3, k_horizontal=rows.k_best["start"])
    counted = pl_mc.sweep(g, faults, draws=20_000, seed=9, methods=(robust,), alert=alert, progress=False)
    spread = 4.0 * np.sqrt(1e-2 / 4096 + 1e-2 / 20_000)
    assert abs(counted.misleading_rate[0] - 1e-2) < spread


def test_a_level_of_the_other_axis_is_no_objective() -> None:
    g = pl_mc.simulate(epochs=1)[0]
    with pytest.raises(InputError, match=r"objective: 'vpl' is unknown .*hpl"):
        pl_mc.tune(g, alert="NPA", objective="vpl")
    with pytest.raises(InputError, match="axis: one error and one level are tuned; choose vertical or horizontal"):
        pl_mc.tune(g, axis="either")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"parameters: 'k_vertical' is unknown"):
        pl_mc.tune(g, alert="NPA", parameters=("k_vertical",))
    content = TUNING | {"alert": RAIL, "objectives": ["vpl"]}
    record = build_experiment(content, source="test")
    found = dict(STUDY.checks(record, None))
    with pytest.raises(InputError, match="objectives: 'vpl' is unknown"):
        found["objectives"]()


@pytest.mark.usefixtures("undrawn")
def test_risks_horizontally(tmp_path: Path) -> None:
    folder = run(RISK | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    assert not re.search(r"VAL|VPL|[Vv]ertical|K_V|5\.33", said)
    assert "HAL 10" in said
    tables = {name: pd.read_csv(folder / f"{name}.csv", keep_default_na=False, na_values=[""]) for name in WITH_AXIS}
    for name, table in tables.items():
        assert set(table.axis) == {HORIZONTAL}, name
    g = pl_mc.simulate(epochs=1, constellations=("GPS",), without=("G19",))[0]
    tripled = dataclasses.replace(g, sigma_m=3.0 * g.sigma_m)
    alert = pl_mc.AlertLimits("rail", horizontal_m=10.0)
    ramp = pl_mc.ramps(tripled, satellites=["G22"], start_m=0.0, stop_m=100.0, step_m=25.0)
    rates = pl_mc.exact.ls_rates(tripled, ramp, alert=alert, axis="horizontal")
    curve = tables["curves"].query("method == 'ls' and event == 'misleading'")
    np.testing.assert_allclose(curve.probability, rates.misleading_rate, rtol=1e-9)
    worst = pl_mc.worst_case(tripled, event="misleading", alert=alert)
    stored = tables["worst"].query("method == 'ls' and event == 'misleading'")
    np.testing.assert_allclose(stored.probability, worst.probability, rtol=1e-9)
    needs = tables["calibration"].query("method == 'ls' and asked == 'none'").set_index("target")
    expected = pl_mc.calibrate(tripled, method="ls", target=1e-2, event="misleading", alert=alert).k_horizontal[0]
    assert needs.k_horizontal[1e-2] == pytest.approx(expected, rel=1e-9)
