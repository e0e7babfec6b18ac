"""Methods by short names: what tells them apart; and numbers in one form."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from pl_mc.report.run_folder import number_text
from pl_mc.report.short_names import hidden_options, methods_in, options_of, short_names
from pl_mc.report.text import percent, probability_text


def test_options_are_split_where_they_end() -> None:
    assert options_of("ls") == ("ls", ())
    assert options_of("igg3(k0=2,k1=6)") == ("igg3", ("k0=2", "k1=6"))
    assert options_of("a(b=(1,2),c=[3,4],d=x(y=1,z=2))") == ("a", ("b=(1,2)", "c=[3,4]", "d=x(y=1,z=2)"))
    # Not of this form: the name of a run behind that of a method, a file.
    for name in ("igg3(k1=3) (other)", "esbc-2020-177-rtklib.pos.gz", "Huber (small)"):
        assert options_of(name) == (name, ())


def test_a_short_name_says_what_tells_methods_apart() -> None:
    long = "w_test(alpha=0.00085966165196832,exclusions=0,final=local,p_fa=0.001,p_md=0.0001)"
    other = "w_test(alpha=0.00085966165196832,exclusions=1,final=local,p_fa=0.001,p_md=0.0001)"
    short = short_names(["ls", "tukey", "tukey(scale=mad_floored)", long, other, "slope(p_fa=0.001)"])
    assert short == {
        "ls": "ls",
        "tukey": "tukey",
        "tukey(scale=mad_floored)": "tukey(scale=mad_floored)",
        long: "w_test(exclusions=0, ...)",
        other: "w_test(exclusions=1, ...)",
        # It is short as it is.
        "slope(p_fa=0.001)": "slope(p_fa=0.001)",
    }
    assert [whole for _, whole in hidden_options(short)] == [long, other]
    # Numbers that three digits do not tell apart stay whole.
    close = [f"l1(eps=0.0001234{k},level_scale=floored)" for k in (1, 2)]
    assert short_names(close) == {name: name for name in close}
    apart = short_names([close[0], "l1(eps=0.5,level_scale=floored)"])
    assert list(apart.values()) == ["l1(eps=0.000123, ...)", "l1(eps=0.5, ...)"]
    tables = [pd.DataFrame({"method": ["ls", None, long]}), pd.DataFrame({"test": ["chi2"]})]
    assert methods_in(tables) == {"ls": "ls", long: "w_test(...)"}


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.0, "0"), (0, "0"), (5.0, "5"), (9_999, "9999"), (10_000, "10,000"), (0.25, "0.25"), (9.1996353, "9.19964"),
     (0.001, "0.001"), (0.0001, "1e-4"), (1e-7, "1e-7"), (1.2749e-7, "1.2749e-7"), (-2.5e-9, "-2.5e-9"),
     (1_234_567.0, "1.23457e6"), (999_999.4, "999999"), (math.inf, "inf"), (np.int64(20_000), "20,000"),
     (np.float64(1e-12), "1e-12")],
)  # fmt: skip
def test_numbers_have_one_form(value: float, said: str) -> None:
    assert number_text(value) == said


def test_rates_and_probabilities_have_it_too() -> None:
    assert percent(1.27e-6) == "1.27e-4"
    assert percent(3.196e-13) == "3.20e-11"
    assert percent(0.25) == "25"
    assert probability_text(8e-5) == "8e-5"
    assert probability_text(2.5e-14) == "2.5e-14"
