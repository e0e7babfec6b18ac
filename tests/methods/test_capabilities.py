"""What methods can do beside `solve`: methods made here in every analysis, each against a built-in one."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc import InputError
from pl_mc.kernels import LeastSquaresSolution, LinearModel, least_squares, linear_model, protection_levels, start_from
from pl_mc.methods import METHODS, GatedIgg3, Igg3, LeaveOneOut, Ls, MaxDop, Outcome, Parity, Sbas, Slope, WTest
from pl_mc.methods import capabilities as can
from pl_mc.methods.base import outcome_of
from pl_mc.statistics.exact import LeastSquaresLaw
from pl_mc.time_ramps import SequentialParity
from reference.problems import appendix_d

PROTOCOLS = {
    "levels_from_geometry": can.LevelsFromGeometry,
    "batched_levels": can.BatchedLevels,
    "statistic": can.Statistic,
    "exact_law": can.ExactLaw,
    "scales_with_k": can.ScalesWithK,
}
SUMMED = SequentialParity((50.0,))
M_ESTIMATES = ("igg3", "igg3_gated", "huber", "tukey", "hampel", "danish", "l1", "mm")
TABLE = {name: {"scales_with_k"} for name in M_ESTIMATES} | {
    "ls": {"exact_law", "levels_from_geometry", "scales_with_k"},
    "araim": {"levels_from_geometry", "batched_levels", "statistic"},
    "separated": set(),
    "ibpl": set(),
    "slope": {"levels_from_geometry", "statistic"},
    "range_comparison": {"levels_from_geometry", "statistic"},
    "nioraim": {"levels_from_geometry"},
    "sbas": {"levels_from_geometry", "scales_with_k"},
    "max_dop": {"levels_from_geometry", "statistic", "scales_with_k"},
    "parity": {"levels_from_geometry", "statistic", "scales_with_k"},
    "w_test": {"levels_from_geometry", "statistic", "scales_with_k"},
    "leave_one_out": {"statistic", "scales_with_k"},
}


@pytest.fixture(autouse=True)
def strict_types():
    """Analyses as users run them."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.mark.parametrize("name", sorted(METHODS))
def test_every_registered_method_declares_what_it_should(name: str) -> None:
    made = METHODS[name]()
    assert {key for key, protocol in PROTOCOLS.items() if isinstance(made, protocol)} == TABLE[name]
    for key in TABLE[name]:
        # A member that a subclass has no right to any more would be there, and not declared.
        if key not in ("levels_from_geometry", "scales_with_k"):
            assert can.declared(made, key) is not None


@pytest.mark.parametrize(
    ("method", "from_geometry", "multiplier"),
    [
        (Ls(), False, "k_vertical"),
        (Igg3(), False, "k_vertical"),
        (GatedIgg3(), False, "k_vertical"),
        (Sbas(), True, "k_vertical"),
        (Slope(), True, None),
        (Parity(), True, None),
        (Parity(form="sigma"), True, "k_vertical"),
        (Parity(form="sigma", exclude=True), False, "k_vertical"),
        (WTest(), False, "k_vertical"),
        (WTest(exclusions=0), True, "k_vertical"),
        (WTest(exclusions=0, variance="posterior"), False, "k_vertical"),
        (WTest(exclusions=0, form="reliability", variance="posterior"), True, None),
        (MaxDop(), True, None),
        (MaxDop(form="subset"), True, "k_vertical"),
        (LeaveOneOut(), False, None),
        (LeaveOneOut(form="sigma"), False, "k_vertical"),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_options_decide(method: Any, from_geometry: bool, multiplier: str | None) -> None:
    assert can.levels_from_geometry(method) == from_geometry
    assert can.scales_with_k(method) == multiplier
    if multiplier is not None:
        assert can.k_of(can.with_k(method, 2.5)) == 2.5


@dataclass(frozen=True)
class Bare:
    """Least squares that declares nothing."""

    inflation: float = 1.0

    @property
    def name(self) -> str:
        return "bare"

    def prepare(self, model: LinearModel) -> Any:
        return ()

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        estimate = least_squares(model, start)
        return outcome_of(estimate, protection_levels(estimate, k_vertical=5.33 * self.inflation))


@dataclass(frozen=True)
class Exact(Bare):
    """The same with its law: the level is 5.33 times the inflation."""

    scales_with_k = "inflation"
    name = "exact"

    @property
    def exact_law(self) -> LeastSquaresLaw:
        return LeastSquaresLaw(5.33 * self.inflation)


@dataclass(frozen=True)
class Scaled:
    """IGG-III behind other names."""

    k: float = 5.33
    name: str = field(default="scaled", init=False)
    scales_with_k = "k"

    def prepare(self, model: LinearModel) -> Any:
        return ()

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        return Igg3(k_vertical=self.k, iterations=10).solve(model, prepared, start)


@dataclass(frozen=True)
class Checked:
    """The chi-square test of the residuals, and levels that nothing reaches."""

    p_fa: float = 1e-3
    name: str = field(default="checked", init=False)

    def prepare(self, model: LinearModel) -> Any:
        return Slope(p_fa=self.p_fa).prepare(model)[0]

    def statistic(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> jax.Array:
        return start.square_sum / prepared

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        outcome = Ls().solve(model, (), start)
        return replace(outcome, rejects=outcome.available & (self.statistic(model, prepared, start) > 1.0))


@dataclass(frozen=True)
class Quiet:
    """Levels of the geometry alone."""

    name: str = field(default="quiet", init=False)
    levels_from_geometry = True

    def prepare(self, model: LinearModel) -> Any:
        return Sbas().prepare(model)

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        return Sbas().solve(model, prepared, start)


def assert_equal_but_for_the_name(table: pd.DataFrame, expected: pd.DataFrame, *names: str) -> None:
    left, right = (part.drop(columns=["method", *names]).reset_index(drop=True) for part in (table, expected))
    pd.testing.assert_frame_equal(left, right, check_exact=True)


def test_an_own_exact_law_is_exact_everywhere() -> None:
    g = appendix_d()
    options = {"target": 1e-7, "faults": pl_mc.no_fault(g) + pl_mc.biases(g, {"G03": 20.0}), "event": "misleading"}
    own, built_in = (pl_mc.calibrate(g, method=one, **options) for one in (Exact(), "ls"))
    assert (own["found"] == "exact").all()
    for name in ("k_vertical", "k_low", "k_high"):
        # The field is the share of 5.33.
        assert (own[name] * 5.33).to_numpy() == pytest.approx(built_in[name].to_numpy(), rel=1e-9)
    fault_free = pl_mc.calibrate(g, method=Exact(), target=1e-7)["k_vertical"][0]
    assert fault_free * 5.33 == pytest.approx(45.207, abs=5e-4)
    for alarm in ("pl", "chi2"):
        worst = [pl_mc.worst_case(g, method=one, alarm=alarm) for one in (Exact(1.2), Ls(k_vertical=5.33 * 1.2))]
        assert_equal_but_for_the_name(*worst)
        budget = [pl_mc.risk_budget(g, method=one, alarm=alarm) for one in (Exact(), "ls")]
        pd.testing.assert_frame_equal(*budget, check_exact=True)


def test_an_own_level_that_scales_with_k_is_calibrated_by_its_field() -> None:
    g = appendix_d()
    own, built_in = (pl_mc.calibrate(g, method=one, target=1e-2, draws=3000) for one in (Scaled(), Igg3(iterations=10)))
    assert_equal_but_for_the_name(own, built_in)


@dataclass(frozen=True)
class Summed:
    """A sequential test: residuals summed over 50 s."""

    name: str = field(default="summed", init=False)

    def plan(self, *arguments: Any) -> Any:
        return SUMMED.plan(*arguments)


def test_own_statistics_and_levels_find_a_ramp_as_the_built_in_ones_do() -> None:
    g = pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", epochs=21, interval_s=10.0)
    methods = (Summed(), Checked(), Slope(p_fa=1e-3), Scaled(), SUMMED, Igg3(iterations=10))
    table = pl_mc.time_to_alert(
        g, g[0].names[0], [2.0], methods, draws=64, calibration_draws=200, p_fa=0.05, onset_s=50.0, progress=False
    )
    summed, checked, slope, scaled, built_in, igg3 = (table[table.method == one.name] for one in methods)
    assert slope.detected.item() > 32
    assert_equal_but_for_the_name(checked, slope)
    assert_equal_but_for_the_name(scaled, igg3)
    assert_equal_but_for_the_name(summed, built_in)


def test_a_test_beside_a_level_rejects_whatever_the_multiplier_is() -> None:
    g = pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", epochs=21, interval_s=10.0)
    options = {"draws": 64, "calibration_draws": 200, "p_fa": 0.05, "onset_s": 50.0, "progress": False}
    strict, deaf = GatedIgg3(p_fa=0.5, gate="ls"), GatedIgg3(p_fa=1e-12, gate="ls")
    table = pl_mc.time_to_alert(g, g[0].names[0], [0.0], (strict, deaf, Igg3()), **options).set_index("method")
    assert table.threshold[strict.name] == float("inf")
    assert table.false_alarm_rate[strict.name] == 1.0
    # The same estimate in another program.
    assert table.threshold[deaf.name] == pytest.approx(table.threshold["igg3"], rel=1e-12)


def test_the_test_of_a_method_stands_beside_detectors() -> None:
    g = appendix_d()
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G03": 8.0})
    table = pl_mc.detect(
        g,
        faults,
        tests=("chi2", "slope", Checked(), "w_test"),
        draws=2000,
        seed=4,
        calibration_draws=2000,
        p_fa=1e-3,
    )  # fmt: skip
    chi2, slope, checked, w_test = (table[table.test == name] for name in table.test.unique())
    assert list(table.test.unique()) == ["chi2", "slope", "checked", "w_test"]
    for name in ("detections", "identified_rate", "p_fa_measured"):
        # The same statistic over another constant; the nominal threshold of the test made here has the same P_FA.
        pd.testing.assert_series_equal(checked[name], chi2[name], check_index=False)
        equal = [part[part.level == "equal_p_fa"][name] for part in (slope, chi2)]
        pd.testing.assert_series_equal(*equal, check_index=False)
    nominal = table[table.level == "nominal"].groupby("test").p_fa_nominal.first()
    assert nominal["chi2"] == 1e-3
    assert nominal[["slope", "checked", "w_test"]].isna().all()
    assert (checked[checked.level == "nominal"].threshold == 1.0).all()
    assert w_test.detections.max() > 0


def test_own_levels_without_noise_take_one_draw() -> None:
    volume = pl_mc.service_volume(
        step_deg=90.0, step_s=43200.0, methods=(Quiet(), "sbas", Bare()), draws=3, progress=False
    )
    assert volume.exact == ("quiet", "sbas")
    quiet, sbas = (volume.levels[volume.levels.method == name] for name in ("quiet", "sbas"))
    assert_equal_but_for_the_name(quiet, sbas)


@dataclass(frozen=True)
class Doubled(Ls):
    """A subclass with another level."""

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        outcome = super().solve(model, prepared, start)
        return replace(outcome, vpl_m=2.0 * outcome.vpl_m)


@dataclass(frozen=True)
class Careful(Ls):
    """A subclass with another default alone."""

    k_vertical: float = 7.0


def test_a_subclass_with_another_solve_has_none_of_its_capabilities() -> None:
    assert can.exact_law(Doubled()) is None
    assert can.scales_with_k(Doubled()) is None
    assert can.exact_law(Careful()) == LeastSquaresLaw(7.0)
    assert can.scales_with_k(Careful()) == "k_vertical"
    with pytest.raises(InputError, match="has no scales_with_k"):
        pl_mc.calibrate(appendix_d(), method=Doubled())


@dataclass(frozen=True)
class Wrong(Bare):
    """It names a field that it does not have."""

    scales_with_k = "k"


NO_LAW = "bare has no exact_law, the LeastSquaresLaw that its rates follow exactly (methods that have: ls)."
SEQUENCE = {"satellite": "G01", "rates_m_per_s": [1.0]}


@pytest.mark.parametrize(
    ("act", "sentence"),
    [
        (
            lambda g: pl_mc.calibrate(g, method=Bare()),
            "method: bare has no scales_with_k, the name of the field that its vertical level is a multiple of "
            "(methods that have: ls, igg3, igg3_gated, w_test, sbas, huber, tukey, hampel, danish, l1, mm; with "
            "other options max_dop, parity, leave_one_out).",
        ),
        (
            lambda g: pl_mc.calibrate(g, method=Wrong()),
            "method: bare: scales_with_k: 'k' is no field of this dataclass.",
        ),
        (
            lambda g: pl_mc.worst_case(g, method=Bare(), alarm="chi2"),
            f"alarm: 'chi2' is for exact laws, 'pl' for estimates too: {NO_LAW}",
        ),
        (
            lambda g: pl_mc.risk_budget(g, method=Bare(), alarm="chi2"),
            f"alarm: 'chi2' is for exact laws, 'pl' for estimates too: {NO_LAW}",
        ),
        (
            lambda g: pl_mc.detect(g, pl_mc.no_fault(g), tests=("chi2", Bare()), draws=1, seed=0),
            "tests: bare has no statistic(model, prepared, start), its test statistic over the threshold (methods "
            "that have: araim, slope, max_dop, parity, w_test, leave_one_out, range_comparison, chi2, mean_check).",
        ),
        (
            lambda _: pl_mc.time_to_alert(_series(), methods=(Bare(),), **SEQUENCE),
            "methods: bare has no statistic(model, prepared, start), its test statistic over the threshold, nor "
            "scales_with_k, the name of the field that its vertical level is a multiple of (methods that have: ls, "
            "igg3, igg3_gated, araim, slope, max_dop, parity, w_test, leave_one_out, range_comparison, huber, "
            "tukey, hampel, danish, l1, mm, sequential_parity, kalman, filter_bank).",
        ),
    ],
)
def test_a_method_that_lacks_something_is_told_what_in_one_sentence(act: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        act(appendix_d())
    assert str(caught.value) == sentence


def _series() -> pl_mc.Geometry:
    return pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", epochs=5, interval_s=10.0)


def test_every_method_is_examined_in_the_service_volume_the_budget_and_the_worst_case() -> None:
    """They need nothing, so that a method without any capability is estimated or drawn like the built-in ones."""
    g = appendix_d()
    found = pl_mc.worst_case(g, method=Bare(), satellites=["G03"], estimator=_never)
    assert found.method.tolist() == ["bare"]
    budget = pl_mc.risk_budget(g, method=Bare(), estimator=_never, pairs=0)
    assert (budget["found"][:-2] != "exact").all()


def _never(faults: pl_mc.Faults, target_cov: float, seed: int) -> pd.DataFrame:
    columns = dict.fromkeys(("probability", "standard_error", "low", "high"), 0.0)
    return pd.DataFrame([columns | {"warning": ""}] * len(faults))


def test_a_statistic_is_above_one_where_its_test_rejects() -> None:
    """Noise, and half of the lanes with 15 m on a satellite; nothing is excluded."""
    methods = [
        METHODS[name]() for name in TABLE if "statistic" in TABLE[name] and name not in ("w_test", "leave_one_out")
    ]
    methods.append(WTest(exclusions=0, final="local"))
    g, rng = appendix_d(), np.random.default_rng(8)
    observed_m = g.sigma_m[:, None] * rng.standard_normal((10, 64))
    observed_m[2, 32:] += 15.0

    @functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
    def run(observed_m: jax.Array) -> list[tuple[jax.Array, jax.Array]]:
        model = linear_model(jnp.asarray(g.design), jnp.asarray(g.sigma_m), jnp.asarray(g.in_view))
        start = start_from(model, observed_m)
        made = [(method, method.prepare(model)) for method in methods]
        return [(m.statistic(model, p, start), m.solve(model, p, start).rejects) for m, p in made]

    for method, (ratio, rejects) in zip(methods, run(observed_m), strict=True):
        assert 8 < np.sum(rejects) < 56, method.name
        np.testing.assert_array_equal(np.asarray(ratio) > 1.0, rejects, err_msg=method.name)
