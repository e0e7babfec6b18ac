"""The method with an integrity support message: everywhere the levels that the function has, and its sentences."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.araim import LPV_200, Ism, protection_levels
from pl_mc.error_models import error_model
from pl_mc.ism import codes_of
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods.araim import Araim

# Single satellites of their own, priors by constellation that differ by four decades.
OURS = Ism(
    sigma_ura_m={"G": 1.0, "E": 0.75, "G02": 2.0, "G14": 0.5, "E08": 1.5},
    sigma_ure_m={"G": 0.5, "E": 0.5, "G02": 1.0, "E22": 0.25},
    b_nom_m={"G": 0.5, "E": 0.75, "E14": 1.0},
    p_sat={"G": 1e-5, "E": 3e-5, "G22": 1e-4, "E21": 2e-6},
    p_const={"G": 1e-8, "E": 1e-4},
    name="ours",
)
# Pairs are to be monitored, some of them held by others, and not all have a prior.
FREQUENT = dataclasses.replace(
    OURS, name="frequent", p_sat={"G": 1e-4, "E": 3e-4, "G10": 0.0}, p_const={"G": 1e-4, "E": 1e-5}
)
SAME = Ism(b_nom_m=0.75, p_sat=1e-5, p_const=1e-4, name="same")
METHODS = (Araim(ism=OURS), Araim(ism=FREQUENT, unmonitored="plain"), Araim(), Araim(ism=SAME))


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    """Three hours of the 24 + 24 satellites, every twenty minutes, with the errors of C_int."""
    return pl_mc.simulate(
        site="JFNG", constellations="ADD-24+24", epochs=10, interval_s=1200.0, mask_deg=5.0,
        error_model=error_model("dual_frequency", ism=OURS),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rows(series) -> dict[str, pd.DataFrame]:
    """The levels of the series by each method."""
    table = pl_mc.solve(series, np.zeros(series.sigma_m.shape), methods=METHODS)
    return {name: table[table.method == name] for name in table.method.unique()}


def levels_of(g: pl_mc.Geometry, ism: Ism, unmonitored: str = "contained"):
    return protection_levels(g.design, g.sigma_m**2, systems=g.systems, names=g.names, ism=ism, unmonitored=unmonitored)


def test_a_series_has_the_levels_of_the_function(series, rows):
    """Row by row and epoch by epoch, whatever satellites come and go; pairs and their shares as the host has them.

    1e-8 is the bisection's 2e-10 of a bracket.
    """
    names = [method.name for method in METHODS]
    assert names == [
        "araim(ism=ours)", "araim(unmonitored=plain,ism=frequent)", "araim", "araim(ism=same)",
    ]  # fmt: skip
    assert list(rows) == names
    for k, one in enumerate(series):
        found = levels_of(one, OURS)
        assert rows[names[0]].vpl_m.iloc[k] == pytest.approx(found.vpl_m, rel=1e-8)
        assert rows[names[0]].hpl_m.iloc[k] == pytest.approx(found.hpl_m, rel=1e-8)
    assert (np.diff(rows[names[0]].vpl_m) != 0).all()
    assert (rows[names[0]].vpl_m.to_numpy() != rows["araim"].vpl_m.to_numpy()).all()


@jax.tree_util.Partial(jax.jit, static_argnames="of")
def prepared(design, sigma_m, codes, *, of):
    model = linear_model(design, sigma_m, satellite=codes)
    made = of.prepare(model)
    return made, of.solve(model, made, start_from(model, sigma_m[:, None] * 0.0))


@pytest.mark.parametrize(
    ("p_sat", "unmonitored"),
    [
        (1e-5, "plain"),
        (5e-5, "contained"),
        ({"G": 2e-5, "E": 1e-5, "G10": 1e-4}, "contained"),
        ({"G": 1e-5, "E": 4e-5, "E21": 0.0}, "plain"),
    ],
)
def test_pairs_of_unequal_priors(series, p_sat, unmonitored):
    """Where no three faults at a time are needed the function and the method agree, thresholds and all."""
    ism = dataclasses.replace(OURS, p_sat=p_sat)
    g, of = series[0], Araim(ism=ism, unmonitored=unmonitored)
    _, outcome = prepared(g.design, g.sigma_m, codes_of(g.names, g.systems), of=of)
    found = levels_of(g, ism, unmonitored)
    assert outcome.vpl_m[0] == pytest.approx(found.vpl_m, rel=1e-8)
    assert outcome.hpl_m[0] == pytest.approx(found.hpl_m, rel=1e-8)
    assert np.isfinite(found.vpl_m)


def test_an_ism_that_says_the_same_of_all_is_the_options(rows):
    """Bit for bit but for rounding: the same modes by letters as by clocks."""
    ours, theirs = rows["araim"], rows["araim(ism=same)"]
    np.testing.assert_allclose(ours.vpl_m, theirs.vpl_m, rtol=1e-9)
    np.testing.assert_allclose(ours.hpl_m, theirs.hpl_m, rtol=1e-9)


def test_thresholds_have_the_variance_of_accuracy(series):
    """A separation under C_acc exceeds its threshold as often as its share says: the threshold is K_fa sigma_ss."""
    g = series[0]
    found = levels_of(g, OURS)
    ura, ure = (OURS.values(field, g.names, g.systems) for field in ("sigma_ura_m", "sigma_ure_m"))
    explicit = protection_levels(
        g.design, g.sigma_m**2, g.sigma_m**2 - ura**2 + ure**2, g.systems,
        OURS.values("b_nom_m", g.names, g.systems), OURS.values("p_sat", g.names, g.systems),
        {"G": 1e-8, "E": 1e-4},
    )  # fmt: skip
    np.testing.assert_allclose(found.threshold_m, explicit.threshold_m, rtol=1e-12)
    kept, _ = prepared(g.design, g.sigma_m, codes_of(g.names, g.systems), of=Araim(ism=OURS))
    limits = np.asarray(kept.whole.limit_m)[np.isfinite(kept.whole.limit_m)]
    theirs = explicit.threshold_m[np.isfinite(explicit.threshold_m)]
    np.testing.assert_allclose(np.sort(limits), np.sort(theirs), rtol=1e-8, atol=1e-12)


def test_everywhere(series, tmp_path):
    """Sweep, sample, detect, service volume, risk: the method goes by the names of the satellites in all of them."""
    path = tmp_path / "ours.csv"
    fields = ("sigma_ura_m", "sigma_ure_m", "b_nom_m", "p_sat", "p_const")
    names = sorted({name for field in fields for name, _ in getattr(OURS, field)})
    lines = [[name, *(str(dict(getattr(OURS, field)).get(name, "")) for field in fields)] for name in names]
    path.write_text("\n".join(",".join(line) for line in [["satellite", *fields], *lines]))
    method, g = Araim(ism=str(path)), series[0]
    assert method.name == "araim(ism=ours.csv)"
    assert dataclasses.replace(method.ism, name="ours") == OURS
    levels = levels_of(g, OURS)
    told = pl_mc.sample(g, pl_mc.no_fault(g), draws=3, seed=1, methods=(method,))
    np.testing.assert_allclose(told.vpl_m, levels.vpl_m, rtol=1e-8)
    val = pl_mc.AlertLimits("own", vertical_m=float(levels.vpl_m) - 1e-3)
    swept = pl_mc.sweep(g, pl_mc.no_fault(g), draws=50, seed=1, methods=(method, Araim()), alert=val)
    assert swept.alarms.tolist()[0] == 50
    faults = pl_mc.biases(g, {g.names[0]: 60.0})
    power = pl_mc.detect(g, faults, tests=(method,), draws=200, seed=1, calibration_draws=2000, p_fa=0.01)
    assert (power.detection_rate > 0.99).all()
    rare = pl_mc.risk(g, pl_mc.no_fault(g), event="alarm", method=method, alert=val, seed=1, max_evaluations=500_000)
    assert rare.probability.iloc[0] > 0.999


def test_service_volume():
    """The levels of the function at every user and time of a grid: each limit between two of them serves one."""
    options = {"constellations": "ADD-24+24", "mask_deg": 5.0, "start": "2017-11-15T00:00:00"}
    options |= {"error_model": error_model("dual_frequency", ism=OURS)}
    users = pl_mc.simulate(site=(-60.0, -150.0, 0.0), epochs=2, interval_s=600.0, **options)
    levels = sorted(float(levels_of(one, OURS).vpl_m) for one in users)
    assert levels[1] - levels[0] > 0.1
    between = pl_mc.AlertLimits("between", vertical_m=sum(levels) / 2.0, horizontal_m=1e3)
    above = pl_mc.AlertLimits("above", vertical_m=levels[1] + 1e-6, horizontal_m=1e3)
    found = pl_mc.service_volume(
        **options, step_deg=60.0, step_s=600.0, duration_s=1200.0, methods=(Araim(ism=OURS),), progress=False,
        operations=(between, above),
    )  # fmt: skip
    here = found.sites.query("latitude_deg == -60 and longitude_deg == -150").set_index("operation").available
    assert here.to_dict() == {"between": 1, "above": 2}


G = pl_mc.simulate(site="JFNG", constellations="ADD-24+24", epochs=1, error_model=error_model("dual_frequency"))[0]


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: Araim(ism={"sigma_ura": 1}), "araim: ism: 'sigma_ura' is no field"),
        (
            lambda: Araim(ism=3),
            "araim: ism: an Ism, a table of its fields, or the path of a CSV file, is needed, not 3",
        ),
        (lambda: Araim(ism="none.csv"), "ism: none.csv: there is no such file"),
        (lambda: Araim(ism={"p_sat": 1e-5}, p_sat=1e-4), "araim: p_sat: the ism has p_sat, which says it"),
        (lambda: Araim(ism=OURS, b_nom_m=0.5), "araim: b_nom_m: the ism has b_nom_m"),
        (lambda: Araim(ism=OURS, accuracy_ratio=0.5), "araim: accuracy_ratio: the ism has sigma_ure_m"),
        (
            lambda: pl_mc.solve(G, 0 * G.sigma_m, methods=(Araim(ism=OURS),)),
            "ism: sigma_ura_m: .* m of [GE].. is more than its sigma in the geometry, .*nearest: an error model",
        ),
        (
            lambda: pl_mc.sweep(
                G, pl_mc.no_fault(G), draws=1, seed=1, methods=(Araim(ism={"p_sat": {"G": 1e-5, "E01": 1e-5}}),)
            ),
            "ism: p_sat: there is no value for E.. or for its constellation E .nearest: E01",
        ),
        (
            lambda: pl_mc.risk(G, pl_mc.no_fault(G), event="alarm", method=Araim(ism={"p_const": {"G": 1e-8}}), seed=1),
            "ism: p_const: there is no value for constellation E .valid: G",
        ),
        (
            lambda: jax.eval_shape(lambda *rows: Araim(ism=OURS).prepare(linear_model(*rows)), G.design, G.sigma_m),
            "araim: ism: this model names no satellites",
        ),
        (
            lambda: pl_mc.solve(G, 0 * G.sigma_m, methods=(Araim(ism=OURS), Araim(ism=dict(OURS.as_dict())))),
            "methods: araim.ism=ours. is asked for twice",
        ),
    ],
)
def test_sentences(act, words):
    with pytest.raises(pl_mc.InputError, match=words):
        act()


def test_what_the_ism_leaves_out_the_options_say():
    of = Araim(ism=Ism(b_nom_m=0.0, name="biases"), p_sat=2e-5, p_const=1e-5)
    _, outcome = prepared(G.design, G.sigma_m, codes_of(G.names, G.systems), of=of)
    found = protection_levels(
        G.design, G.sigma_m**2, G.sigma_m**2, G.systems, 0.0, 2e-5, {"G": 1e-5, "E": 1e-5}, LPV_200
    )
    assert outcome.vpl_m[0] == pytest.approx(found.vpl_m, rel=1e-8)
