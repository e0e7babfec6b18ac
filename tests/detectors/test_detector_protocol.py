"""What every detector must do, whichever it is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pl_mc import InputError
from pl_mc.detectors import DETECTORS, Chi2, Detector, MeanCheck, as_detectors, detector
from pl_mc.engine import examine
from reference.problems import random_geometry

NAMES = sorted(DETECTORS)


def geometry(seed: int = 1):
    g = random_geometry(np.random.default_rng(seed), counts=(8, 9))
    # The third constellation of the random skies stands for BeiDou here.
    return dataclasses.replace(
        g, systems=tuple("G" * 8 + "C" * 9), names=tuple(f"{'G' if k < 8 else 'C'}{k + 1:02d}" for k in range(17)),
        clocks=("G", "C"),
    )  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_signature(name: str) -> None:
    test = detector(name)
    assert isinstance(test, Detector)
    assert test == dataclasses.replace(test)
    assert hash(test) == hash(dataclasses.replace(test))
    assert test.test == test.name == name
    assert test.label == test.reading
    with pytest.raises(dataclasses.FrozenInstanceError):
        test.reading = "other"


def test_names_tell_options_apart() -> None:
    made = [
        Chi2(), Chi2("divided"), Chi2("divided", variances_m2=(1.0, 2.0)), MeanCheck(), MeanCheck("shared_clock"),
        MeanCheck("shared_clock", shift="kept"), MeanCheck(one_sided=True), MeanCheck(variances_m2=(1.0, 2.0)),
    ]  # fmt: skip
    assert len({test.name for test in made}) == len({(test.test, test.label) for test in made}) == len(made)
    assert made[1].name == "chi2(divided)"
    assert made[5].label == "shared_clock, shift kept"


@pytest.mark.parametrize("name", NAMES)
def test_a_large_bias_is_found_named_and_measured(name: str) -> None:
    g = geometry()
    errors = np.zeros(17)
    errors[11] = 1e3
    found = examine(g, errors, tests=(name,)).iloc[0]
    assert found.decision
    assert found.suspect == "C12"
    assert found.error_m == pytest.approx(1e3, rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_no_error_no_decision(name: str) -> None:
    found = examine(geometry(), np.zeros(17), tests=(name,)).iloc[0]
    assert not found.decision
    assert found.statistic == pytest.approx(0.0, abs=1e-12)


def test_examine_is_vpv_against_the_quantile() -> None:
    g = geometry(2)
    errors = g.sigma_m * np.random.default_rng(3).standard_normal(17)
    found = examine(g, errors, tests=("chi2", Chi2("divided")), p_fa=1e-3)
    whitened, target = g.design / g.sigma_m[:, None], errors / g.sigma_m
    residual = target - whitened @ np.linalg.lstsq(whitened, target, rcond=None)[0]
    variance = np.where(np.array(g.systems) == "G", 2.5, 4.5)
    np.testing.assert_allclose(found.statistic, [residual @ residual, residual**2 @ (1 / variance)], rtol=1e-10)
    # RTKLIB's table of chi-square thresholds stops at one decimal: 31.9, 32.9 for 11, 12 degrees of freedom.
    np.testing.assert_allclose(found.threshold, 32.909, atol=1e-3)


def test_unknown_names_and_options_are_refused() -> None:
    for call, words in (
        (lambda: detector("chi"), "test: 'chi' is unknown .nearest: chi2"),
        (lambda: detector("chi2", readings="x"), "option 'readings' is unknown .nearest: reading"),
        (lambda: as_detectors("chi3"), "test: 'chi3' is unknown .nearest: chi2"),
        (lambda: as_detectors(()), "at least one test"),
        (lambda: as_detectors(("chi2", "chi2")), "asked for twice"),
        (lambda: as_detectors((3,)), "3 is no test"),
        (lambda: as_detectors(None), "tests: a sequence of tests is needed"),
        (lambda: as_detectors((Chi2,)), r"Chi2 is a class and no test; Chi2\(\) makes one"),
        (lambda: Chi2("posterior"), "chi2.reading"),
    ):
        with pytest.raises(InputError, match=words):
            call()
