"""By which limit a sweep decides: vertical, horizontal, or either of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import AXES, EITHER, HORIZONTAL, OPERATIONS, VERTICAL, as_axes, as_limits, unjudged_note
from pl_mc.engine import EVENTS
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Outcome
from pl_mc.statistics import binomial_p_value, ls_rates
from reference import small_sweep as small

COUNTS = [event.count for event in EVENTS]
RAIL = pl_mc.AlertLimits("rail", vertical_m=15.0, horizontal_m=10.0)


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return small.run(axes=AXES, alert=RAIL)


def test_the_vertical_alone_is_what_it_was(table: pd.DataFrame) -> None:
    alone, named = small.run(alert=RAIL), small.run(axes="vertical", alert=RAIL)
    assert "axis" not in alone
    assert list(named.columns[:2]) == ["method", "axis"]
    for other in (named, table[table.axis == VERTICAL].reset_index(drop=True)):
        pd.testing.assert_frame_equal(other.drop(columns="axis"), alone)
    assert "The horizontal alert limit of rail, 10 m, is not judged" in alone.attrs["unjudged"]
    assert table.attrs["unjudged"] == ""
    beside = small.run(alert=RAIL, axes=HORIZONTAL)
    assert "The vertical alert limit of rail, 15 m, is not judged" in beside.attrs["unjudged"]


def test_counts_are_those_of_the_outcomes_one_by_one() -> None:
    g, faults = small.SERIES[0], small.FAULTS
    options = {"draws": 300, "seed": 2, "alert": RAIL, "methods": small.METHODS}
    found = pl_mc.sweep(g, faults, axes=AXES, progress=False, **options)
    drawn = pl_mc.sample(g, faults, axis=EITHER, **options)
    across = np.hypot(drawn.east_m, drawn.north_m)
    seen = {
        VERTICAL: (drawn.up_m.abs() > RAIL.val_m, drawn.up_m.abs() > drawn.vpl_m, drawn.vpl_m > RAIL.val_m),
        HORIZONTAL: (across > RAIL.hal_m, across > drawn.hpl_m, drawn.hpl_m > RAIL.hal_m),
    }
    seen[EITHER] = tuple(a | b for a, b in zip(seen[VERTICAL], seen[HORIZONTAL], strict=True))
    for axis, (hazard, exceeded, beyond) in seen.items():
        alarm = ~drawn.available | beyond
        if axis == EITHER:
            pd.testing.assert_series_equal(drawn.alarm, alarm, check_names=False)
        of = pd.DataFrame({
            "method": drawn.method, "fault": drawn.fault, "alarms": alarm, "hazards": hazard, "missed": hazard & ~alarm,
            "exceeded": exceeded, "misleading": exceeded & ~alarm, "false_alarms": drawn.available & alarm & ~hazard,
            "unavailable": ~drawn.available, "unconverged": drawn.unconverged, "tied": drawn.tied,
        })  # fmt: skip
        expected = of.groupby(["method", "fault"], sort=False)[COUNTS].sum()
        got = found[found.axis == axis].set_index(["method", "fault"])[COUNTS]
        pd.testing.assert_frame_equal(got, expected.loc[got.index], check_dtype=False)
    assert (found.hazards > 0).any()
    assert found.misleading.sum() > 0


def test_either_lies_between_its_parts_and_their_sum(table: pd.DataFrame) -> None:
    vertical, horizontal, either = (table[table.axis == axis].set_index(["method", "fault"])[COUNTS] for axis in AXES)
    both = vertical + horizontal
    for count in ("alarms", "hazards", "exceeded"):
        assert (np.maximum(vertical, horizontal)[count] <= either[count]).all()
        assert (either[count] <= both[count]).all()
    for count in ("missed", "misleading"):
        assert (either[count] <= both[count]).all()
    for count in ("unavailable", "unconverged", "tied"):
        assert vertical[count].equals(horizontal[count])
        assert vertical[count].equals(either[count])


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_least_squares_has_its_exact_horizontal_rates(noise: float) -> None:
    """Several geometries and biases; the smallest of some hundred p-values is seldom below 1e-6."""
    series = pl_mc.simulate(epochs=12, interval_s=7200.0)
    series = dataclasses.replace(series, sigma_m=noise * series.sigma_m)
    names = [series.names[k] for k in np.argsort(-series.in_view.sum(axis=0), kind="stable")[:2]]
    faults = pl_mc.no_fault(series)
    for name in names:
        for bias_m in (4.0, 9.0, 30.0):
            faults = faults + pl_mc.biases(series, {name: noise * bias_m})
    alert = pl_mc.AlertLimits("near", horizontal_m=noise * 3.0)
    found = pl_mc.sweep(
        series, faults, draws=8 * LANES, seed=5, methods=pl_mc.ls(k_horizontal=1.2), alert=alert, by_epoch=True,
        progress=False,
    )  # fmt: skip
    exact = ls_rates(series, faults, alert=alert, axis="horizontal", k_horizontal=1.2)
    both = found.merge(exact, on=["epoch", "fault"], suffixes=("", "_exact"))
    assert len(both) == len(found) == len(exact)
    for event in ("alarm", "hazard", "missed", "exceeded", "misleading", "false_alarm"):
        count = {one.name: one.count for one in EVENTS}[event]
        value = binomial_p_value(both[count], both.draws, np.minimum(both[f"{event}_rate_exact"], 1.0))
        assert value.min() > 1e-6, event
        assert both[count].sum() > 20, event


def test_the_rail_case() -> None:
    """An error of 26 m sideways on a limit of 10 m, which no vertical limit sees; and the limit counts."""
    g = pl_mc.simulate(epochs=1)[0]
    fault = pl_mc.biases(g, {"G12": 60.0})
    alarms = {}
    for limit_m in (1e-3, 10.0, 1e3):
        alert = pl_mc.AlertLimits("rail", horizontal_m=limit_m)
        found = pl_mc.sweep(g, fault, draws=512, seed=1, methods="ls", alert=alert, progress=False).iloc[0]
        assert found.axis == HORIZONTAL
        alarms[limit_m] = found.alarms
    assert alarms[1e-3] == alarms[10.0] == 512
    assert alarms[1e3] == 0
    errors_m = np.where(np.array(g.names) == "G12", 60.0, 0.0)
    assert not pl_mc.solve(g, errors_m, methods="ls", alert="RNP 0.1").alarm.iloc[0]
    assert pl_mc.solve(g, errors_m, methods="ls", alert=RAIL, axis="horizontal").alarm.iloc[0]


def test_parts_of_another_axis_are_another_sweep_s(tmp_path) -> None:
    with small.cut(2):
        small.run(folder=tmp_path / "vertical", methods=("ls",))
        first = small.run(folder=tmp_path / "both", axes=AXES, methods=("ls",))
        for part in list((tmp_path / "both").glob("part-*.parquet"))[::2]:
            part.unlink()
        again = small.run(folder=tmp_path / "both", axes=AXES, methods=("ls",), resume=True)
        pd.testing.assert_frame_equal(again, first)
        with pytest.raises(pl_mc.InputError, match="axes"):
            small.run(folder=tmp_path / "vertical", axes=AXES, methods=("ls",), resume=True)
    assert small.task().asked().keys() < small.task(axes=AXES).asked().keys()


BAD = [
    ({"alert": "NPA", "axes": "vertical"}, "axes: vertical needs a vertical limit, and NPA has HAL 556 m alone"),
    ({"alert": pl_mc.AlertLimits("x", vertical_m=3), "axes": "either"}, "axes: either needs a horizontal limit"),
    ({"axes": ()}, "axes: at least one is needed .of vertical, horizontal, either"),
    ({"axes": ("vertical", "vertical")}, "axes: each axis is judged once"),
    ({"axes": "up"}, "axes: 'up' is unknown"),
    ({"axes": 3}, "axes: a sequence of axes is needed"),
]


@pytest.mark.parametrize(("change", "words"), BAD)
def test_bad_axes(change: dict, words: str) -> None:
    with pytest.raises(pl_mc.InputError, match=words):
        small.run(**change)


def test_one_axis_at_a_time() -> None:
    """Where one alarm is told there is one axis; the sentence names the option."""
    g = small.SERIES[0]
    for axis, words in ((AXES[:2], "axis: "), ("up", "axis: 'up' is unknown"), (3, "axis: 3 is unknown")):
        with pytest.raises(pl_mc.InputError, match=words):
            pl_mc.solve(g, np.zeros(len(g.names)), axis=axis)  # type: ignore[arg-type]
        with pytest.raises(pl_mc.InputError, match=words):
            pl_mc.sample(g, pl_mc.no_fault(g), draws=3, seed=1, axis=axis)  # type: ignore[arg-type]


def test_limits() -> None:
    with pytest.raises(pl_mc.InputError, match="alert: mine has no limit; vertical_m, horizontal_m or both"):
        pl_mc.AlertLimits("mine")
    assert as_axes(None, OPERATIONS["RNP 0.3"]) == (HORIZONTAL,)
    assert as_axes(None, OPERATIONS["CAT-I"]) == (VERTICAL,)
    assert OPERATIONS["RNP 0.1"].words == "HAL 185 m"
    assert unjudged_note(OPERATIONS["RNP 0.1"], (HORIZONTAL,)) == ""
    # Names as they are written elsewhere, in another case and with blanks for hyphens.
    for name, meant in (
        ("CAT I", "CAT-I"), ("CAT II/IIIA", "CAT-II"), ("cat iiib", "CAT-IIIB"), ("lpv 200", "LPV-200"),
        ("RNP-0.3", "RNP 0.3"), ("En-route", "en-route"), ("Terminal", "terminal"), ("rnp 0.1", "RNP 0.1"),
        ("LPV", "APV-I"), ("CAT IIIA", "CAT-II"), ("NPA / RNP 0.3", "NPA"), ("continental", "en-route"),
    ):  # fmt: skip
        assert as_limits(name) is OPERATIONS[meant]
    with pytest.raises(pl_mc.InputError, match="alert: 'CAT IV' is unknown"):
        as_limits("CAT IV")


@dataclasses.dataclass(frozen=True)
class VerticalAlone:
    """Least squares without a horizontal level."""

    k_vertical: float = 5.33
    name: str = "vertical_alone"
    scales_with_k = "k_vertical"

    def prepare(self, model: LinearModel) -> tuple[()]:
        return ()

    def solve(self, model: LinearModel, prepared: object, start: LeastSquaresSolution) -> Outcome:
        outcome = pl_mc.ls(k_vertical=self.k_vertical).solve(model, (), start)
        return dataclasses.replace(outcome, hpl_m=None)  # type: ignore[arg-type]


def test_a_method_without_a_horizontal_level_is_judged_vertically_alone() -> None:
    g, faults, method = small.SERIES[0], small.FAULTS, VerticalAlone()
    options = {"draws": 64, "seed": 1, "alert": RAIL, "progress": False}
    counts = [pl_mc.sweep(g, faults, methods=one, **options)[COUNTS] for one in (method, "ls")]  # type: ignore[arg-type]
    pd.testing.assert_frame_equal(*counts)
    assert pl_mc.solve(g, np.zeros(len(g.names)), methods=method).hpl_m.isna().all()
    words = "axes: vertical_alone has no horizontal level, so that {} cannot decide"
    for axis in (HORIZONTAL, EITHER):
        with pytest.raises(pl_mc.InputError, match=words.format(axis)):
            pl_mc.sweep(g, faults, methods=method, axes=axis, **options)  # type: ignore[arg-type]
        with pytest.raises(pl_mc.InputError, match=words.format(axis)):
            pl_mc.solve(g, np.zeros(len(g.names)), methods=method, alert=RAIL, axis=axis)
    with pytest.raises(
        pl_mc.InputError, match="'k_horizontal' is no field of this dataclass, the multiplier of its ho"
    ):
        pl_mc.calibrate(g, method=method, alert=RAIL, axis="horizontal")
