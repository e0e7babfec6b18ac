"""Levels with an integrity support message: against MAAST's numbers, against arguments, and what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import pl_mc
from pl_mc.araim import Ism, protection_levels
from pl_mc.error_models import error_model
from reference.problems import VECTORS, appendix_d

# The settings of MAAST's 96 cases, see test_araim_vectors.
MAAST = Ism(sigma_ura_m=1.0, sigma_ure_m=2.0 / 3.0, b_nom_m=0.75, p_sat=1e-5, p_const={"G": 1e-8, "E": 1e-4})
CASES = np.genfromtxt(VECTORS / "araim_maast_cases.csv", delimiter=",", names=True)
# Time and place of twelve of them.
PLACES = np.genfromtxt(
    Path(__file__).parents[1] / "geometry" / "maast_rows.csv", delimiter=",", skip_header=2, names=True
)
TIMED = {int(row["case"]): row for row in PLACES}
COLUMNS = {"vpl_m": "vpl", "hpl_m": "hpl", "emt_m": "emt", "sigma_v_acc_m": "sig_acc_v"}


def sky_of(place) -> pl_mc.Geometry:
    """The 24 + 24 satellites over the place of a case at its time, with the errors of C_int; mask 5 deg."""
    start = np.datetime64("2017-11-15T00:00:00") + np.timedelta64(int(place["t_s"]), "s")
    site = (float(place["lat_deg"]), float(place["lon_deg"]), 0.0)
    model = error_model("dual_frequency", ism=MAAST)
    return pl_mc.simulate(
        site=site, start=start, constellations="ADD-24+24", epochs=1, mask_deg=5.0, error_model=model
    )[0]


@pytest.mark.parametrize("case", [case for case in CASES if int(case["case"]) in TIMED], ids=lambda c: f"{c['case']:g}")
def test_from_a_name_and_a_table_to_the_levels_of_maast(case):
    """Constellation, errors, ISM and levels, all by name: 5 mm, as from MAAST's own design rows."""
    g = sky_of(TIMED[int(case["case"])])
    assert [g.systems.count(letter) for letter in "GE"] == [case["n_gps"], case["n_gal"]]
    found = protection_levels(g.design, g.sigma_m**2, systems=g.systems, names=g.names, ism=MAAST)
    for field, column in COLUMNS.items():
        assert getattr(found, field) == pytest.approx(case[column], abs=5e-3), field
    assert found.p_not_monitored == pytest.approx(case["p_not_monitored"], abs=5.1e-15)
    assert (found.probability > 0).sum() + 1 == case["nsub"]


G = appendix_d()
# Appendix D: C_int - C_acc is 0.3125 m^2 for every satellite, URA 0.75 m and URE 0.5 m; of single satellites too.
NOISE_M2 = G.sigma_m**2 - 0.75**2
OURS = Ism(
    sigma_ura_m={"G": 0.75, "E": 0.75, "G02": 2.0},
    sigma_ure_m={"G": 0.5, "E": 0.5, "G02": 1.0, "E07": 0.25},
    b_nom_m={"G": 0.5, "E": 0.75, "E09": 1.0},
    p_sat={"G": 1e-5, "E": 3e-5, "G01": 1e-4},
    p_const={"G": 1e-8, "E": 1e-4},
)
ARGUMENTS = {
    "c_int": NOISE_M2 + np.where(np.array(G.names) == "G02", 4.0, 0.75**2),
    "c_acc": NOISE_M2 + np.array([{"G02": 1.0, "E07": 0.0625}.get(name, 0.25) for name in G.names]),
    "b_nom": [0.5] * 5 + [0.75] * 3 + [1.0, 0.75],
    "p_sat": [1e-4] + [1e-5] * 4 + [3e-5] * 5,
    "p_const": {"G": 1e-8, "E": 1e-4},
}
SAID = {"design": G.design, "systems": G.systems}


@pytest.mark.parametrize(
    ("ism", "given"),
    [
        (OURS, {"noise_m2": NOISE_M2}),
        (OURS, {"c_int": ARGUMENTS["c_int"]}),
        (dataclasses.replace(OURS, p_sat=None, p_const=None), {"noise_m2": NOISE_M2} | {
            field: ARGUMENTS[field] for field in ("p_sat", "p_const")
        }),
        (dataclasses.replace(OURS, sigma_ure_m=None), {field: ARGUMENTS[field] for field in ("c_int", "c_acc")}),
        (dataclasses.replace(OURS, sigma_ura_m=None, sigma_ure_m=None), {
            field: ARGUMENTS[field] for field in ("c_int", "c_acc")
        }),
        (dataclasses.replace(OURS, sigma_ure_m=None), {"noise_m2": NOISE_M2, "c_acc": ARGUMENTS["c_acc"]}),
    ],
    ids=["noise", "c_int", "no priors", "no ure", "no sigmas", "noise and c_acc"],
)  # fmt: skip
def test_an_ism_is_its_numbers(ism, given):
    """Satellite by satellite, whatever part of the arguments it says; one geometry and a batch."""
    expected = protection_levels(**SAID, **ARGUMENTS)
    found = protection_levels(**SAID, names=G.names, ism=ism, **given)
    two = protection_levels(np.stack([G.design] * 2), systems=G.systems, names=G.names, ism=ism, **given)
    for field in ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m", "p_not_monitored"):
        assert getattr(found, field) == pytest.approx(getattr(expected, field), rel=1e-9), field
        np.testing.assert_allclose(getattr(two, field), [getattr(expected, field)] * 2, rtol=1e-9)
    assert np.isfinite(found.vpl_m)


def test_rows_out_of_view_need_nothing():
    """A padded row has no name and no value."""
    design = np.concatenate([G.design, np.full((1, 5), np.nan)])
    seen = np.arange(11) < 10
    padded = protection_levels(
        design, np.append(ARGUMENTS["c_int"], np.nan), systems=[*G.systems, "R"], names=[*G.names, ""], ism=OURS,
        in_view=seen,
    )  # fmt: skip
    assert padded.vpl_m == pytest.approx(protection_levels(**SAID, **ARGUMENTS).vpl_m, rel=1e-9)


WHOLE = {"ism": OURS, "names": G.names, "noise_m2": NOISE_M2}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (WHOLE | {"c_int": 1.0}, "noise_m2: c_int is given too, which holds it"),
        (WHOLE | {"c_acc": 1.0}, "c_acc: the ISM has sigma_ure_m, which says it"),
        (WHOLE | {"b_nom": 1.0}, "b_nom: the ISM has b_nom_m, which says it"),
        (WHOLE | {"p_const": {"G": 0, "E": 0}}, "p_const: the ISM has p_const, which says it"),
        (WHOLE | {"names": None}, "names: the ISM tells .* from others in .*; names of satellites are needed"),
        (WHOLE | {"names": G.names[1:]}, "names: a name for each of the 10 rows is needed"),
        (WHOLE | {"names": [1] * 10}, "names: a name for each of the 10 rows is needed"),
        (WHOLE | {"noise_m2": -1.0}, "noise_m2: -1 m.2 for G01 cannot be used; a variance is not negative .nearest: 0"),
        (
            WHOLE | {"noise_m2": None, "c_int": 1.0},
            "c_int: 1 m.2 for G02 .* square of sigma_ura_m, .* of the same ism .nearest: 4",
        ),
        (WHOLE | {"noise_m2": None}, "c_int: it is needed where no ism with noise_m2 says it"),
        (WHOLE | {"ism": {"p_sat": 1e-5}, "noise_m2": 1.0}, "ism: sigma_ura_m: it is needed here"),
        (WHOLE | {"ism": Ism(sigma_ura_m=1, b_nom_m=1)}, "c_acc: it is needed where no ism with noise_m2 says it"),
        (WHOLE | {"ism": dataclasses.replace(OURS, p_const={"G": 1e-8})}, "p_const: .* no value for constellation E"),
        (
            WHOLE | {"ism": dataclasses.replace(OURS, p_sat={"G": 1e-5})},
            "p_sat: there is no value for E0. or for its co",
        ),
        (WHOLE | {"ism": None, "names": None}, "noise_m2: it belongs to an ism, and there is none"),
        ({"noise_m2": 1.0}, "noise_m2: it belongs to an ism, and there is none"),
        ({"c_int": 1.0, "c_acc": 1.0, "b_nom": 1.0, "p_sat": 1e-5}, "p_const: it is needed where no ism says it"),
        ({"c_int": 1.0, "c_acc": 1.0, "p_const": {}}, "b_nom: it is needed where no ism says it"),
    ],
)
def test_what_is_said_twice_or_not_at_all(given, words):
    with pytest.raises(pl_mc.InputError, match=words):
        protection_levels(**SAID, **given)
