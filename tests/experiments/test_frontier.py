"""The frontier: geometries of a sky, methods at equal risk, one multiplier for all, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

import pl_mc
from pl_mc.engine import Execution
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.given_residuals import contributions, draws
from pl_mc.integrity_risk.given_residuals.draws import EpochParts
from pl_mc.methods import method
from pl_mc.report.figures import in_common_look
from pl_mc.statistics import ls_quantities
from pl_mc.studies.frontier import STUDY
from pl_mc.studies.frontier.figures import frontier_figure
from pl_mc.studies.frontier.one_number import by_slope, largest_slope, one_number
from pl_mc.studies.frontier.record import FrontierExperiment, Sky
from pl_mc.studies.frontier.run import _stopped

FEW = {
    "title": "few",
    "draws": 1024,
    "seed": 3,
    "sizes_m": [10.0, 100.0],
    "limits_m": [10.0],
    "sigma_factors": [1.25],
    "biases_m": [0.5],
    "noises": [{"name": "student_t", "nu": 4.0}],
    "correlations": [0.2],
    "angles_deg": [30.0],
    "pair_priors": [1e-10, 1e-8],
    "skies": [{"name": "a day", "site": "CUT0", "count": 2, "stressed": 1, "constellations": ["GPS", "BDS-2"]}],
    "methods": [
        {"name": "ls", "level_scale": "floored"},
        {"name": "separated", "estimate": "midrange", "p_const": 0.0},
    ],
}

NOTHING_WRONG = {"noises": [], "correlations": [], "angles_deg": [], "pair_priors": []}


@pytest.fixture(scope="module", autouse=True)
def small_tiles() -> Iterator[None]:
    """Half of a larger tile would be filled up: grids have 256 draws of a fault here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(draws, "_TILE", 256)
        yield


@pytest.fixture(scope="module")
def found():
    return STUDY.found(FrontierExperiment.model_validate(FEW), Execution(progress=False))


def test_methods_stand_at_equal_risk(found) -> None:
    tables = found.data
    geometries, frontier = tables["geometries"], tables["frontier"]
    assert len(geometries) == 4
    scaled = geometries[geometries.method.str.startswith("ls")]
    np.testing.assert_allclose(scaled.risk, scaled.allowed, rtol=2e-3)
    np.testing.assert_allclose(scaled.contribution_fault_free + scaled.contribution_single, scaled.risk, rtol=1e-9)
    own = geometries[geometries.method.str.startswith("separated")]
    assert own.k.isna().all()
    assert (own.risk_high < own.allowed).all()
    # 100 m on one satellite: the floored level of least squares grows with it, the separated one does not.
    assert (scaled.alarm_rate_100m == 1.0).all()
    assert (own.alarm_rate_100m == 0.0).all()
    assert frontier.level_mean_m.is_monotonic_increasing
    row = frontier[frontier.method.str.startswith("ls")].iloc[0]
    np.testing.assert_allclose(row.discontinuity, scaled.discontinuity.mean())
    np.testing.assert_allclose(scaled.discontinuity, scaled.satellites * 1e-5, rtol=1e-3)


@pytest.mark.counting
def test_exclusions_and_faults_of_several_satellites() -> None:
    """A large fault is excluded, and seldom another satellite."""
    sky = FEW["skies"][0] | {"count": 1, "stressed": 0}
    araim = {"name": "araim", "exclusion": "satellites", "p_const": 0.0, "b_nom_m": 0.0}
    changed = {"skies": [sky], "methods": [araim], "besides": ["pairs", "constellations"]}
    tables = STUDY.found(
        FrontierExperiment.model_validate(FEW | NOTHING_WRONG | changed), Execution(progress=False)
    ).data
    row = tables["frontier"].iloc[0]
    assert row.exclusion_rate_100m + row.wrong_exclusion_rate_100m + row.alarm_rate_100m == pytest.approx(1.0)
    assert row.exclusion_rate_100m > 0.95
    assert row.exclusion_rate_100m > 100 * row.wrong_exclusion_rate_100m
    besides = tables["besides"].set_index("faults")
    assert besides.index.tolist() == ["pairs", "all of G", "all of C"]
    satellites = int(tables["geometries"].satellites.iloc[0])
    pairs, others = besides.loc["pairs"], besides.iloc[1:]
    assert pairs.sets == satellites * (satellites - 1) // 2
    # At most the prior of all pairs; no constellation has a test.
    assert 0 < pairs.contribution <= pairs.sets * 1e-10
    assert (others.sets == 1).all()
    assert (others.probability > pairs.error).all()
    assert others.contribution.isna().all()


def test_continuity_is_that_of_the_function(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the methods that have an exposure; what exclusion spares."""
    # The sizes that levels are held against have nothing to do with continuity.
    monkeypatch.setattr(contributions, "_ROOTS", contributions._ROOTS[::10])
    ism = {
        "name": "rates", "b_nom_m": 0.5, "r_sat_per_h": 1e-5, "mfd_sat_h": 1.0, "r_const_per_h": {"G": 1e-8, "E": 1e-4},
        "mfd_const_h": 1.0,
    }  # fmt: skip
    timed = {"name": "araim", "standard": "v4.2", "budget": "LPV-200 v4.2", "ism": ism}
    sky = {
        "name": "world",
        "count": 1,
        "mask_deg": 20,
        "constellations": ["ADD-24+24"],
        "error_model": "dual_frequency",
    }
    changed = {"skies": [sky], "methods": [{"name": "ls"}, timed, timed | {"exclusion": "satellites"}]}
    experiment = FrontierExperiment.model_validate(FEW | NOTHING_WRONG | changed | {"continuity": 8e-5})
    result = STUDY.found(experiment, Execution(progress=False))
    table = result.data["continuity"]
    detection, exclusion = experiment.method_records()[1:]
    assert table.method.unique().tolist() == [detection.name, exclusion.name]
    assert table.faults.tolist() == ["no fault", "satellites", "constellations", "total"] * 2
    (g,) = experiment.skies[0].geometries(3)
    own = pl_mc.continuity(g, (detection,), sizes_m=(10.0, 100.0), seed=3)
    parts = table[table.method == detection.name].set_index("faults").contribution
    assert parts["satellites"] == pytest.approx(own[own.fault.isin(g.names)].contribution.sum())
    assert parts["total"] == pytest.approx(own.contribution.iloc[-1])
    spared = table[table.method == exclusion.name].set_index("faults").contribution
    assert spared["satellites"] < 0.1 * parts["satellites"]
    assert spared["constellations"] == parts["constellations"]
    text = "\n".join(str(block) for block in result.summary)
    assert "8e-05 may be interrupted in all" in text
    checks = dict(STUDY.checks(FrontierExperiment.model_validate(FEW | {"continuity": 1e-4}), None))
    with pytest.raises(InputError, match="none of the methods has an exposure"):
        checks["continuity"]()


def test_wrong_assumptions_cost_risk(found) -> None:
    """A Gaussian tail at 5.3 sigma with a sigma that is a quarter larger is a hundred times as probable."""
    stress = found.data["stress"].set_index(["method", "assumption"])
    ls = stress.loc["ls(level_scale=floored)"]
    assert 20 < ls.loc["sigma times 1.25", "times"] < 400
    assert 1 < ls.loc["nominal biases of 0.5 m more", "times"] < 1000
    assert ls.loc["student_t(nu=4,match=sigma)", "times"] > 20
    assert ls.loc["correlation 0.2 of all satellites", "times"] > 1
    for _, rows in stress.groupby("method"):
        pairs = rows.xs("pairs of faults, prior 1e-10 each", level="assumption").iloc[0]
        more = rows.xs("pairs of faults, prior 1e-08 each", level="assumption").iloc[0]
        # As much more as the prior is, of what pairs add.
        np.testing.assert_allclose(
            more.risk - pairs.risk_as_assumed, 100 * (pairs.risk - pairs.risk_as_assumed), rtol=1e-6
        )
        assert more.risk > pairs.risk


def test_estimates_that_stop_early() -> None:
    """Those that iterate, and those around which a level is separated; at the multiplier of settled ones."""
    assert _stopped(method("igg3"), 3).name == "igg3(iterations=3)"
    assert _stopped(method("separated"), 3).estimate.name == "igg3(iterations=3)"
    assert [_stopped(one, 3) for one in (method("ls"), method("separated", estimate="ls"), method("araim"))] == [
        None
    ] * 3
    assert _stopped(method("separated", estimate="midrange"), 3) is None
    none = ("noises", "correlations", "angles_deg", "pair_priors", "biases_m", "sigma_factors")
    changed = {"skies": [FEW["skies"][0] | {"count": 1}], "methods": [{"name": "igg3", "level_scale": "floored"}]}
    changed |= {key: [] for key in none} | {"iterations": [2]}
    stress = STUDY.found(FrontierExperiment.model_validate(FEW | changed), Execution(progress=False)).data["stress"]
    assert stress.assumption.tolist() == ["2 plain iterations"]
    assert 0.05 < stress.times[0] < 0.7


def test_the_answer_names_the_smallest_level(found) -> None:
    experiment = FrontierExperiment.model_validate(FEW)
    smallest, silent, judged = STUDY.answer(found.data, experiment)
    best = found.data["frontier"].iloc[0]
    assert f"{best.method} with {best.level_mean_m:.3g} m (a day; alarms in 100 % of draws with 100 m" in smallest
    assert "separated(estimate=midrange,p_const=0) with" in silent
    assert "1 sky of 2 geometries" in judged
    assert {picture.name for picture in STUDY.pictures(found.data, experiment)} == {"frontier", "multipliers"}


def test_the_legend_of_many_methods_stands_within_the_figure_of_one_sky() -> None:
    names = [f"separated(estimate=midrange,p_const=0,b_nom_m=0.{k:02d})" for k in range(15)]
    frontier = pd.DataFrame({"sky": "s", "method": names, "allowed": 8e-8, "level_mean_m": 8.0})
    curves = pd.DataFrame({"sky": "s", "method": names, "factor": 1.0, "level_m": 8.0, "risk": 1e-8})
    figure = in_common_look(frontier_figure)(curves, frontier, axis="vertical", title="t")
    figure.canvas.draw()
    (legend,) = figure.legends
    box, whole = legend.get_window_extent(), figure.bbox
    assert whole.x0 <= box.x0 < box.x1 <= whole.x1
    assert whole.y0 <= box.y0 < box.y1 <= whole.y1


def test_random_users_are_spread_by_area() -> None:
    sky = Sky(name="all", count=40)
    geometries = sky.geometries(7)
    again = sky.geometries(7)
    assert len(geometries) == 40
    for one, other in zip(geometries, again, strict=True):
        np.testing.assert_array_equal(one.design, other.design)
    assert not np.array_equal(geometries[0].sigma_m, sky.geometries(8)[0].sigma_m)
    counts = [int(g.satellite_count) for g in geometries]
    assert len(set(counts)) > 3


def test_one_number_is_the_largest_and_its_share_that_of_order_statistics() -> None:
    k = np.concatenate([np.linspace(5.0, 5.5, 298), [6.0]])
    table = pd.DataFrame(
        {"sky": "s", "method": "m", "geometry": range(299), "k": k, "k_low": k - 0.01, "k_high": k + 0.01}
    )
    (row,) = one_number(table).itertuples()
    assert row.k == pytest.approx(6.01)
    # 299 without exception: 99 % with 95 % confidence.
    assert row.share_kept == pytest.approx(0.99, abs=5e-5)
    assert row.k_of_even == pytest.approx(6.01)
    assert (row.odd, row.odd_beyond) == (149, 0)
    # Where the largest is among the rest it is beyond what the others would have chosen.
    (row,) = one_number(table.assign(geometry=[*np.setdiff1d(range(299), [1]), 1])).itertuples()
    assert row.k_of_even == pytest.approx(5.51)
    assert row.odd_beyond == 1


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"budget": {"targt": 1.0}}, "budget", "'targt' is unknown"),
        ({"skies": [FEW["skies"][0] | {"methods": ["lss"]}]}, "skies", "lss"),
        ({"skies": [FEW["skies"][0] | {"constellations": ["GPX"]}]}, "skies", "GPX"),
        ({"budget": {"p_const": 1e-4}}, "skies", "nothing is left"),
        ({"noises": [{"name": "empirical", "file": "x.csv"}]}, "noises", "x.csv"),
        ({"noises": [{"name": "nominal_bias"}]}, "noises", "nearest: student_t"),
        ({"budget": {"p_sat": 2.0}}, "skies", "p_sat: a prior probability"),
        ({"skies": [FEW["skies"][0] | {"site": "world", "start": "soon"}]}, "skies", "a day: start"),
    ],
)
def test_refusals(change, field, words) -> None:
    experiment = FrontierExperiment.model_validate(FEW | change)
    caught = []
    for name, act in STUDY.checks(experiment, None):
        try:
            act()
        except InputError as error:
            caught.append((name, str(error)))
    assert [name for name, _ in caught] == [field]
    assert words in caught[0][1]


@pytest.mark.parametrize(
    "change", [{"sizes_m": []}, {"biases_m": [-1.0]}, {"sigma_factors": [0.0]}, {"skies": [FEW["skies"][0]] * 2}]
)
def test_what_no_record_takes(change) -> None:
    with pytest.raises(ValidationError):
        FrontierExperiment.model_validate(FEW | change)


def test_a_method_without_a_solution_keeps_nothing() -> None:
    """One constellation whose fault is probable: no level of separation."""
    sky = {"name": "gps", "site": "CUT0", "count": 1, "stressed": 1, "constellations": ["GPS"]}
    lone = FEW | {"skies": [sky], "methods": [{"name": "separated", "estimate": "midrange"}]}
    experiment = FrontierExperiment.model_validate(lone)
    found = STUDY.found(experiment, Execution(progress=False))
    assert found.data["frontier"].kept.tolist() == [0]
    assert STUDY.answer(found.data, experiment)[0].endswith("at every geometry: none; none at gps.")


def test_a_formula_finds_the_law_of_half_and_is_held_against_the_rest() -> None:
    rng = np.random.default_rng(4)
    slope, dof = rng.uniform(1.0, 3.0, 200), rng.integers(4, 20, 200)
    law = 1.7 - 0.2 * slope + 0.15 * slope**2 + 0.3 / dof
    table = pd.DataFrame({"sky": "s", "method": "m", "geometry": range(200), "slope": slope, "dof": dof, "k": 1.0})
    (row,) = by_slope(table.assign(k_high=np.exp(law))).itertuples()
    np.testing.assert_allclose(
        [row.constant, row.of_slope, row.of_square, row.of_dof], [1.7, -0.2, 0.15, 0.3], atol=1e-9
    )
    assert (row.margin, row.explained, row.odd) == (pytest.approx(1.0), pytest.approx(1.0), 100)
    assert row.k_mean == pytest.approx(np.exp(law).mean())
    # Where the even ones scatter the margin covers the worst of them; odd ones beyond it are counted.
    scatter = np.where(np.arange(200) % 2 == 0, rng.uniform(-0.01, 0.01, 200), 0.0)
    scatter[[5, 7, 9]] = 0.05
    (row,) = by_slope(table.assign(k_high=np.exp(law + scatter))).itertuples()
    assert 1.005 < row.margin < 1.02
    assert row.odd_beyond == 3
    # Of few geometries, or where one has no multiplier, there is none.
    assert by_slope(table.assign(k_high=np.exp(law)).head(39)).empty
    assert by_slope(table.assign(k_high=np.where(slope > 2.9, np.inf, 2.0))).empty


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_the_largest_slope_is_that_of_a_bias_on_one_satellite(axis: str) -> None:
    g = Sky(name="a day", site="CUT0", count=1, constellations=("GPS", "BDS-2")).geometries(1)[0]
    quantities = ls_quantities(g)
    parts = EpochParts.of(g, axis)
    assert parts is not None
    gain = quantities.gain if axis == "vertical" else quantities.horizontal_gain
    error = np.abs(gain) if axis == "vertical" else np.linalg.norm(gain, axis=0)
    trace = np.sqrt(quantities.redundancy) / g.sigma_m
    sigma = quantities.vdop_m if axis == "vertical" else np.sqrt(np.linalg.eigvalsh(quantities.horizontal_cofactor)[-1])
    assert largest_slope(parts) == pytest.approx(float((error / trace).max() / sigma), rel=1e-9)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"correlations": [0.1, 0.1]}, "0.1 stands there twice"),
        ({"pair_priors": [1e-9, 1e-9]}, "1e-09 stands there twice"),
        ({"angles_deg": [True]}, "numbers are needed"),
        ({"iterations": [True]}, "numbers are needed"),
        ({"angles_deg": [1e308]}, "less than or equal to 1000000"),
        ({"skies": [{"name": "a day", "site": "CUT0", "count": 2}]}, "noises does nothing where no sky has stressed"),
        (
            {"skies": [{"name": "a day", "site": "CUT0", "count": 2, "stressed": 3}]},
            "stressed is at most count, 2, not 3",
        ),
    ],
)
def test_what_would_count_twice_or_do_nothing(changed, words) -> None:
    with pytest.raises(ValidationError, match=words):
        FrontierExperiment.model_validate(FEW | changed)


def test_early_ends_of_methods_without_iterations() -> None:
    experiment = FrontierExperiment.model_validate(FEW | {"iterations": [2]})
    with pytest.raises(InputError, match="iterations: none of the methods has iterations"):
        STUDY.found(experiment, Execution(progress=False))
    checks = dict(STUDY.checks(experiment, None))
    with pytest.raises(InputError, match="iterations: none of the methods"):
        checks["iterations"]()
