"""Faults: labels that say what was biased, ramps that end where they should, and where a fault counts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pl_mc
from pl_mc import Faults, InputError
from pl_mc.faults import fault_label, ramp_sizes_m
from reference.problems import appendix_d, random_series


@pytest.fixture(scope="module")
def g():
    return appendix_d()


@pytest.fixture(scope="module")
def series():
    """Eight satellites, three epochs: G04 sets after the first, C08 rises at the last."""
    in_view = np.ones((3, 8), dtype=bool)
    in_view[1:, 3] = False
    in_view[:2, 7] = False
    return random_series(np.random.default_rng(1), in_view, "GGGGGCCC")


def test_labels(g):
    assert pl_mc.no_fault(g).labels == ("none",)
    assert pl_mc.biases(g, {"G02": 30.0}).labels == ("G02:+30m",)
    assert pl_mc.biases(g, {"E07": -20.5, "G02": 30.0}).labels == ("E07:-20.5m,G02:+30m",)
    assert pl_mc.biases(g, {"G02": 0.0}).labels == ("none",)
    assert pl_mc.biases(g, {}).labels == ("none",)
    assert fault_label({"G02": 0.1 + 0.2}) == "G02:+0.3m"


def test_biases_stand_at_their_satellites(g):
    faults = pl_mc.biases(g, {"E07": -20.5, "G02": 30.0})
    np.testing.assert_array_equal(faults.bias_m, [[0, 30, 0, 0, 0, 0, -20.5, 0, 0, 0]])
    assert faults.names == g.names
    assert len(faults) == 1


@pytest.mark.parametrize(
    ("start", "stop", "step", "sizes"),
    [
        (0, 100, 25, [0, 25, 50, 75, 100]),
        (5, 100, 40, [5, 45, 85]),
        (0, 0.3, 0.1, [0, 0.1, 0.2, 0.3]),
        (10, -10, -10, [10, 0, -10]),
        (7, 7, 1, [7]),
        (0, 1, 3, [0]),
    ],
)
def test_ramps_end_where_the_steps_meet_the_end(g, start, stop, step, sizes):
    np.testing.assert_allclose(ramp_sizes_m(start, stop, step), sizes, rtol=1e-15)
    faults = pl_mc.ramp(g, satellite="G03", start_m=start, stop_m=stop, step_m=step)
    np.testing.assert_allclose(faults.scalar_bias_m, sizes, rtol=1e-15)
    np.testing.assert_array_equal(np.delete(faults.bias_m, 2, axis=1), 0)


def test_ramps_go_satellite_by_satellite(g):
    faults = pl_mc.ramps(g, satellites=["E06", "G01"], start_m=0, stop_m=20, step_m=10)
    assert faults.labels == ("none", "E06:+10m", "E06:+20m", "none", "G01:+10m", "G01:+20m")


def test_the_scalar_bias_is_missing_where_several_satellites_are_faulted(g):
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G02": -30.0}) + pl_mc.biases(g, {"G02": 30.0, "E06": 1.0})
    np.testing.assert_array_equal(faults.scalar_bias_m, [0, -30, np.nan])
    assert faults.labels == ("none", "G02:-30m", "G02:+30m,E06:+1m")


def test_a_fault_counts_where_all_of_its_satellites_are_in_view(series):
    faults = (
        pl_mc.no_fault(series)
        + pl_mc.biases(series, {"G04": 5.0})
        + pl_mc.biases(series, {"C08": 5.0})
        + pl_mc.biases(series, {"G04": 5.0, "C08": 5.0})
        + pl_mc.biases(series, {"G01": 5.0, "C06": 5.0})
    )
    np.testing.assert_array_equal(
        faults.applies(series),
        [[True, True, False, False, True], [True, False, False, False, True], [True, False, True, False, True]],
    )


def test_a_single_epoch_has_one_row_of_them(g):
    np.testing.assert_array_equal(pl_mc.biases(g, {"G02": 1.0}).applies(g), [[True]])


def test_faults_are_immutable(g):
    with pytest.raises(dataclasses.FrozenInstanceError):
        pl_mc.no_fault(g).labels = ()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda g: pl_mc.biases(g, {"G3": 1.0}), "satellite: 'G3' is not in view .nearest: G03"),
        (lambda g: pl_mc.ramp(g, satellite="e06", start_m=0, stop_m=1, step_m=1), "nearest: E06"),
        (lambda g: pl_mc.biases(g, {"G02": np.nan}), "bias of G02: a finite number is needed"),
        (lambda g: pl_mc.biases(g, {"G02": np.inf}), "bias of G02: a finite number is needed"),
        (lambda g: pl_mc.ramp(g, satellite="G02", start_m=0, stop_m=10, step_m=0), "ramp: from 0 m to 10 m"),
        (lambda g: pl_mc.ramp(g, satellite="G02", start_m=0, stop_m=10, step_m=-1), "has to lead from the start"),
        (
            lambda g: pl_mc.ramp(g, satellite="G02", start_m=0, stop_m=np.inf, step_m=1),
            "ramp: stop_m: a finite number is needed",
        ),
        (lambda g: pl_mc.ramps(g, satellites=[], start_m=0, stop_m=1, step_m=1), "at least one fault is needed"),
        (lambda g: Faults.from_array(g, np.zeros((2, 9))), "rows of 10 biases are needed, not shape .2, 9."),
        (lambda g: Faults.from_array(g, np.zeros((1, 2, 10))), "rows of 10 biases are needed"),
        (lambda g: Faults.from_array(g, np.zeros((0, 10))), "at least one fault is needed"),
    ],
)
def test_faults_that_make_no_sense(g, make, words):
    with pytest.raises(InputError, match=words) as caught:
        make(g)
    assert "\n" not in str(caught.value)


def test_faults_of_another_geometry(g, series):
    with pytest.raises(InputError, match="only faults of the same geometry"):
        pl_mc.no_fault(g) + pl_mc.no_fault(series)
    with pytest.raises(InputError, match="made for other satellites"):
        pl_mc.no_fault(g).applies(series)


def test_a_label_is_its_fault(g):
    faults = pl_mc.pairs(g, 30.0, -12.5) + pl_mc.no_fault(g) + pl_mc.biases(g, {"E07": 1e-9, "G02": 123456.789})
    assert len(faults) == 45 + 2
    for k, label in enumerate(faults.labels):
        again = pl_mc.biases(g, label)
        np.testing.assert_array_equal(again.bias_m[0], faults.bias_m[k])
        assert again.labels == (label,)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G01+G03:+30m", {"G01": 30.0, "G03": 30.0}), ("G01:30", {"G01": 30.0}),
        (" G01:+1e1 m , E07:-.5m", {"G01": 10.0, "E07": -0.5}),
        ("G:+20m,E06:-3m", {**dict.fromkeys(("G01", "G02", "G03", "G04", "G05"), 20.0), "E06": -3.0}), ("none", {}),
    ],
)  # fmt: skip
def test_faults_as_text(g, text, expected):
    np.testing.assert_array_equal(pl_mc.biases(g, text).bias_m, pl_mc.biases(g, expected).bias_m)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("G01", "'G01' is no fault; the form is G02:.30m"), ("", "'' is no fault"), ("G01:+30m;G02:+3m", "is no fault"),
        ("G01:north", "is no fault"), ("G99:+30m", "'G99' is not in view"), ("C:+30m", "'C' is not in view"),
        ("G01:+30m,G01:+3m", "G01 is named twice"), ("G01+G01:+30m", "G01 is named twice"),
        ("G:+3m,G02:+4m", "G02 is named twice"), (30.0, "a table by satellite"), ("G01:+1e99m", "up to 1e.09"),
    ],
)  # fmt: skip
def test_text_that_is_no_fault(g, given, words):
    with pytest.raises(InputError, match=words):
        pl_mc.biases(g, given)
