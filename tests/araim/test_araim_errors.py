"""What cannot be used is answered with one sentence that names the field and the rule."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pl_mc.araim
from pl_mc import InputError
from pl_mc.araim import LPV_200, Budget
from reference.problems import appendix_d

G = appendix_d()
GIVEN = {
    "design": G.design,
    "c_int": G.sigma_m**2,
    "c_acc": G.sigma_m**2,
    "systems": G.systems,
    "b_nom": 0.5,
    "p_sat": 1e-5,
    "p_const": {"G": 1e-4, "E": 1e-4},
}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"design": G.design[0]}, r"design: the shape \(n, t\) or \(g, n, t\) .* not \(5,\)"),
        ({"design": G.design[:, :3]}, r"design: .* at least one clock is needed, not \(10, 3\)"),
        ({"design": np.where(G.design == 1, np.nan, G.design)}, "design: the rows .* finite"),
        ({"design": "north"}, "design: it cannot be read as an array"),
        ({"c_int": G.sigma_m[:9] ** 2}, r"c_int: its shape is \(\), \(10,\) or \(1, 10\), .* not \(9,\)"),
        ({"c_int": np.full(10, np.nan)}, "c_int: a variance is finite and positive"),
        ({"c_acc": -(G.sigma_m**2)}, "c_acc: a variance is finite and positive"),
        ({"c_acc": np.ones((10, 10))}, "c_acc: the errors of the satellites are independent"),
        ({"systems": "GGGGG"}, "systems: one RINEX letter for each of the 10 rows"),
        ({"systems": "GGGGGXXXXX"}, "systems: 'X' is unknown .valid: G, C, E, R"),
        ({"p_const": {"G": 1e-4}}, "p_const: there is no probability of 'E' .*G"),
        ({"p_const": 1e-4}, "p_const: a mapping from letter to probability"),
        ({"p_const": {"G": 1e-4, "E": -1e-4}}, r"p_const\['E'\]: a prior probability lies between 0 and 1"),
        ({"p_const": {"G": np.nan, "E": 1e-4}}, r"p_const\['G'\]: a finite number"),
        ({"p_sat": -1e-5}, "p_sat: a prior probability lies between 0 and 1"),
        ({"p_sat": np.nan}, "p_sat: a prior probability lies between 0 and 1"),
        ({"p_sat": 1.0}, "p_sat: a prior probability lies between 0 and 1"),
        (
            {"p_sat": 2e-2, "p_const": {"G": 0.0, "E": 0.0}},
            "p_sat: with 10 faults this probable, combinations of 5 .* smaller probabilities",
        ),
        ({"b_nom": -0.5}, "b_nom: a nominal bias is .* not negative"),
        ({"budget": "LPV-20"}, "budget: 'LPV-20' is unknown .nearest: LPV-200"),
        (
            {"budget": 3},
            "budget: a budget such as pl_mc.araim.LPV_200, its name or a table of its fields is needed, not 3",
        ),
        ({"budget": {"p_fa": 1}}, "budget: 'p_fa' is unknown .nearest: p_emt|budget: 'p_fa' is unknown"),
        ({"budget": {"name": "own"}}, "budget: p_hmi_vertical is missing .nearest: the name of a budget, LPV-200"),
        ({"unmonitored": "contain"}, "unmonitored: 'contain' is unknown .nearest: contained"),
        ({"in_view": np.ones(9, dtype=bool)}, r"in_view: its shape is"),
    ],
)
def test_sentences(changed, words, monkeypatch):
    # Long lists take long to make; a short limit shows the same sentence.
    monkeypatch.setattr(pl_mc.araim.modes, "LARGEST_LIST", 250)
    with pytest.raises(InputError, match=words) as caught:
        pl_mc.araim.protection_levels(**(GIVEN | changed))
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("p_hmi_vertical", 0.0, "budget.p_hmi_vertical: a positive number"),
        ("p_emt", float("nan"), "budget.p_emt: a finite number"),
        ("p_threshold", 1.0, "budget.p_threshold: a probability below 1"),
    ],
)
def test_budgets(field, value, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(LPV_200, **{field: value})
    assert isinstance(LPV_200, Budget)
    assert str(LPV_200) == "LPV-200"
