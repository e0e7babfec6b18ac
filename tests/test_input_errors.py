"""What cannot be computed is refused in one sentence that names the argument and the nearest thing that works."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

import numpy as np
import pytest

import pl_mc
from pl_mc import AlertLimits, InputError
from pl_mc.detectors.registry import DETECTORS
from pl_mc.input_errors import nearest, require_choice
from pl_mc.methods import Ls
from pl_mc.methods.registry import METHODS
from pl_mc.noise_models.gauss_markov import GaussMarkov
from pl_mc.noise_models.registry import NOISE_MODELS
from pl_mc.time_ramps import SEQUENTIAL
from reference.problems import appendix_d, random_series

G = appendix_d()
OTHER = random_series(np.random.default_rng(70), np.ones((2, 8), bool), "GGGGGCCC")
VALID = {"g": G, "faults": pl_mc.no_fault(G), "draws": 10, "seed": 1}

BAD = [
    ({"draws": 0}, "draws: a whole number from 1 to 274877906944 is needed, not 0"),
    ({"draws": -5}, "draws: a whole number"),
    ({"draws": 1000.5}, "draws: a whole number from 1 to 274877906944 is needed, not 1000.5"),
    ({"draws": "1e4"}, "draws: a whole number"),
    ({"draws": True}, "draws: a whole number"),
    ({"seed": -1}, "seed: a whole number from 0 to 4294967295 is needed, not -1"),
    ({"seed": 2**32}, "seed: a whole number from 0 to 4294967295"),
    ({"seed": None}, "seed: a whole number"),
    ({"methods": ("lss",)}, "method: 'lss' is unknown .nearest: ls"),
    ({"methods": "igg33"}, "method: 'igg33' is unknown .nearest: igg3"),
    ({"methods": (pl_mc.igg3,)}, r"methods: Igg3 is a class and no method; Igg3\(\) makes one"),
    ({"methods": pl_mc.igg3}, r"methods: Igg3 is a class and no method; Igg3\(\) makes one"),
    ({"methods": 7}, "methods: a sequence of methods is needed, not 7"),
    ({"methods": ()}, "methods: at least one method"),
    ({"methods": (1.0,)}, "methods: 1.0 is no method"),
    ({"methods": ("ls", Ls())}, "methods: ls is asked for twice"),
    ({"faults": pl_mc.no_fault(OTHER)}, "faults: they were made for other satellites"),
    ({"faults": np.zeros((1, 10))}, "faults: use ramp, biases or no_fault to make faults; ndarray"),
    ({"g": G.design}, "geometry: a pl_mc Geometry is needed, not ndarray"),
    ({"alert": 35.0}, "alert: alert limits such as pl_mc.LPV_200 are needed, not float"),
    ({"alert": "LPV200"}, "alert: 'LPV200' is unknown .nearest: LPV-200"),
    ({"alert": "RNP"}, "alert: 'RNP' is unknown .nearest: NPA, RNP 0.3, RNP 0.1"),
    ({"precision": "float16"}, "precision: 'float16' is unknown .nearest: float"),
]


@pytest.mark.parametrize(("change", "words"), BAD)
@pytest.mark.parametrize("function", [pl_mc.sweep, pl_mc.sample])
def test_sweeps_that_cannot_be(function, change, words):
    with pytest.raises(InputError, match=words) as caught:
        function(**(VALID | change))
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize("workers", [0, -1, 1.5])
def test_workers(workers):
    with pytest.raises(InputError, match="workers: a whole number of at least 1"):
        pl_mc.sweep(**VALID, workers=workers)


@pytest.mark.parametrize(
    ("errors_m", "words"),
    [
        (np.full(10, np.nan), "errors_m: the error of every satellite in view is a finite number"),
        (np.full(10, np.inf), "errors_m: the error of every satellite in view is a finite number"),
        (np.zeros((2, 10)), r"errors_m: the shape \(10,\) is needed, not \(2, 10\)"),
    ],
)
def test_errors_that_cannot_be_solved(errors_m, words):
    with pytest.raises(InputError, match=words):
        pl_mc.solve(G, errors_m)


def test_other_bad_choices_of_solve():
    with pytest.raises(InputError, match=r"method: 'igg33' is unknown .nearest: igg3"):
        pl_mc.solve(G, np.zeros(10), methods=("igg33",))
    with pytest.raises(InputError, match="precision: 'double' is unknown"):
        pl_mc.solve(G, np.zeros(10), precision="double")


@pytest.mark.parametrize("limit", [0.0, -35.0, np.inf, np.nan])
@pytest.mark.parametrize("field", ["vertical_m", "horizontal_m"])
def test_alert_limits(field, limit):
    with pytest.raises(InputError, match=f"alert.{field}: an alert limit is positive and finite"):
        dataclasses.replace(AlertLimits("x", vertical_m=35.0, horizontal_m=40.0), **{field: limit})


def test_nearest_words():
    assert nearest("g02", ["G01", "G02", "C11"]).startswith("nearest: G02")
    assert nearest("zzz", ["G01", "C11"]) == "valid: G01, C11"
    assert nearest("zzz", map(str, range(20))).endswith("11, ...")
    assert nearest("x", []) == "there is none to choose from"
    assert require_choice("ls", ["ls", "igg3"], field="method") == "ls"
    assert issubclass(InputError, ValueError)


RECORDS = [*METHODS.items(), *DETECTORS.items(), *NOISE_MODELS.items(), *SEQUENTIAL.items()]
FURTHER = [
    (AlertLimits, {"name": "mine", "vertical_m": 10.0}), (pl_mc.RiskBudget, {}), (pl_mc.araim.Ism, {"b_nom_m": 0.5}),
    (GaussMarkov, {"tau_s": 10.0}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "record"), RECORDS)
def test_an_unknown_option_of_a_record_is_named_with_the_nearest(name: str, record: type) -> None:
    with pytest.raises(pl_mc.InputError, match=rf"{name}: the option 'zzz' is unknown \((valid|nearest|there is none)"):
        record(zzz=1)
    options = [field.name for field in dataclasses.fields(record) if field.init]
    for option in options[:1]:
        with pytest.raises(pl_mc.InputError, match=rf"the option '{option}x' is unknown \(.*{option}"):
            record(**{f"{option}x": 1})
    # Their signature is what it was.
    assert list(inspect.signature(record).parameters) == options


@pytest.mark.parametrize(("record", "options"), FURTHER)
def test_other_records_refuse_an_unknown_option_likewise(record: type, options: dict[str, Any]) -> None:
    with pytest.raises(pl_mc.InputError, match="the option 'zzz' is unknown"):
        record(**options, zzz=1)
    made = record(**options)
    with pytest.raises(pl_mc.InputError, match="the option 'zzz' is unknown"):
        dataclasses.replace(made, zzz=1)
    assert dataclasses.replace(made) == made


def test_correlation_times_of_exposures_stand_once() -> None:
    g = pl_mc.simulate(site="CUT0", epochs=1)[0]
    with pytest.raises(pl_mc.InputError, match="tau_s: one row of different correlation times is needed"):
        pl_mc.exposure(g, pl_mc.no_fault(g), tau_s=[10.0, 10.0], draws=256, seed=1)
