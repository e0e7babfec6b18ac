"""What every method must do, whichever it is: the tests run over the registry and over a method made here.

Invariances hold between two computations of the same numbers in another order; their tolerance of 1e-9 is rounding
(1e-16) times the condition of a normal matrix (up to 1e4) and of ten reweightings.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pl_mc
from pl_mc import InputError
from pl_mc.engine import Execution
from pl_mc.kernels import least_squares, linear_model, protection_levels, start_from
from pl_mc.kernels.s_estimate import SOptions
from pl_mc.methods import METHODS, Igg3, Ls, Method, Outcome, as_methods, method
from pl_mc.methods.base import outcome_of
from pl_mc.statistics import binomial_p_value, chi2_threshold
from reference.problems import appendix_d, random_sky

TOLERANCE = 1e-9
NAMES = sorted(METHODS)
LANES = 16

# Every method has one of these, and has another default.
OPTIONS = {"k_vertical": 6.5, "b_nom_m": 0.5, "p_md": 0.01, "alpha_vertical": 1e-3}


@dataclasses.dataclass(frozen=True)
class CheckedLs:
    """Least squares whose chi-square test rejects a scenario, with levels inflated by a factor."""

    k_vertical: float = 5.33
    inflation: float = 1.5
    threshold: float = 20.515

    @property
    def name(self) -> str:
        return f"checked({self.inflation:g})"

    def prepare(self, model):
        return jnp.asarray(self.threshold, model.design.dtype)

    def solve(self, model, prepared, start) -> Outcome:
        estimate = least_squares(model, start)
        levels = protection_levels(estimate, k_vertical=self.k_vertical * self.inflation)
        outcome = outcome_of(estimate, levels)
        return dataclasses.replace(outcome, rejects=outcome.available & (start.square_sum > prepared))


# One program for all methods compiles in a third of the time, and unoptimised in half of that.
EVERY = (*(method(name) for name in NAMES), CheckedLs())


@functools.partial(jax.jit, static_argnames="methods", compiler_options={"xla_backend_optimization_level": 0})
def outcomes(methods, design, sigma_m, observed_m, in_view) -> list[Outcome]:
    model = linear_model(design, sigma_m, in_view)
    start = start_from(model, observed_m)
    return [of.solve(model, of.prepare(model), start) for of in methods]


# What was computed of the same arrays: a test of one method asks for all of them.
KNOWN: dict[tuple, list[Outcome]] = {}


def outcome(of, design, sigma_m, observed_m, in_view=None) -> Outcome:
    methods = EVERY if of in EVERY else (of,)
    given = design, sigma_m, observed_m, np.ones(len(sigma_m), bool) if in_view is None else in_view
    key = (methods, np.shape(design), *(np.asarray(array).tobytes() for array in given))
    if key not in KNOWN:
        KNOWN[key] = jax.tree.map(np.asarray, outcomes(methods, *given))
    return KNOWN[key][methods.index(of)]


@functools.cache
def scenarios():
    """The sky of Appendix D: noise, half of the lanes with 60 m on one satellite."""
    g, rng = appendix_d(), np.random.default_rng(30)
    observed = g.sigma_m[:, None] * rng.standard_normal((10, LANES))
    observed[rng.integers(0, 10, LANES // 2), np.arange(LANES // 2)] += 60.0
    return np.asarray(g.design), np.asarray(g.sigma_m), observed


def assert_same(found: Outcome, expected: Outcome, *, scale: float = 1.0) -> None:
    for name in ("error_m", "hpl_m", "vpl_m"):
        np.testing.assert_allclose(
            getattr(found, name), scale * np.asarray(getattr(expected, name)), rtol=TOLERANCE, atol=TOLERANCE * scale
        )
    np.testing.assert_array_equal(found.available, expected.available)
    np.testing.assert_array_equal(found.rejects, expected.rejects)


@pytest.fixture(params=[*NAMES, "made here"])
def any_method(request):
    return CheckedLs() if request.param == "made here" else method(request.param)


def test_signature(any_method):
    assert isinstance(any_method, Method)
    assert dataclasses.is_dataclass(any_method)
    assert any_method == dataclasses.replace(any_method)
    assert hash(any_method) == hash(dataclasses.replace(any_method))
    with pytest.raises(dataclasses.FrozenInstanceError):
        any_method.k_vertical = 1.0
    found = outcome(any_method, *scenarios())
    assert isinstance(found, Outcome)
    assert found.error_m.shape == (3, LANES)
    for name in ("hpl_m", "vpl_m", "available", "rejects"):
        assert getattr(found, name).shape == (LANES,), name
    assert found.available.dtype == found.rejects.dtype == bool
    assert np.all(found.available)
    assert np.all(found.vpl_m > 0)
    assert np.all(found.hpl_m > 0)


@pytest.mark.parametrize("name", NAMES)
def test_names(name):
    """The registry's name, and the options in which a method differs from its defaults."""
    assert method(name).name == name
    option, value = next((key, v) for key, v in OPTIONS.items() if hasattr(method(name), key))
    assert method(name, **{option: value}).name == f"{name}({option}={value})"
    assert method(name, **{option: getattr(method(name), option)}).name == name


def test_names_tell_options_apart():
    assert Igg3(k1=4.0, scale="apriori").name == "igg3(k1=4,scale=apriori)"
    assert Igg3(iterations=3).name == "igg3(iterations=3)"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_types_are_kept(any_method, dtype):
    # Types are known before anything is compiled.
    arrays = (*(x.astype(dtype) for x in scenarios()), np.ones(10, bool))
    found = outcomes.eval_shape(EVERY, *arrays)[EVERY.index(any_method)]
    assert found.error_m.dtype == found.hpl_m.dtype == found.vpl_m.dtype == dtype


def test_padding_changes_nothing(any_method):
    design, sigma, observed = scenarios()
    rows = np.array([0, 2, 3, 4, 6, 7, 8, 10, 11, 13])
    wide, wide_sigma, wide_observed = np.full((14, 6), np.nan), np.full(14, np.nan), np.zeros((14, LANES))
    wide[rows], wide_sigma[rows], wide_observed[rows] = np.pad(design, ((0, 0), (0, 1))), sigma, observed
    in_view = np.isin(np.arange(14), rows)
    assert_same(
        outcome(any_method, wide, wide_sigma, wide_observed, in_view), outcome(any_method, design, sigma, observed)
    )


@pytest.mark.parametrize(("satellites", "available"), [([], False), ([0, 1, 5, 6], False), ([0, 1, 2, 5, 6], False),
                                                       ([0, 1, 2, 3, 5, 6], True), ([0, 1, 2, 3, 4], True),
                                                       ([0, 1, 2, 3], False)])  # fmt: skip
def test_availability(any_method, satellites, available):
    """t + 1 satellites are needed, t without the clocks that nothing observes; Galileo begins with number 5.

    Levels that rest on what is known before need t of them alone.
    """
    if any_method.name in ("araim", "separated"):
        # They have no level where the fault of a constellation is probable and leaves no position.
        any_method = method(any_method.name, p_const=0.0)
    if any_method == method("sbas"):
        available = satellites not in ([], [0, 1, 5, 6])
    found = outcome(any_method, *scenarios(), np.isin(np.arange(10), satellites))
    for values in (found.vpl_m, found.hpl_m, found.error_m):
        assert not np.isnan(values).any()
    if available:
        # A robust method may still find a faulted scenario undetermined.
        assert np.all(found.available[LANES // 2 :])
    else:
        assert not found.available.any()
        assert np.isinf(found.vpl_m).all()
        assert np.isinf(found.hpl_m).all()
        assert not found.rejects.any()
    assert np.all(np.isinf(found.vpl_m) == ~found.available)


@given(order=st.permutations(range(10)))
@settings(max_examples=10)
def test_the_order_of_the_satellites_does_not_matter(order):
    design, sigma, observed = scenarios()
    order = np.array(order)
    for name in NAMES:
        found = outcome(method(name), design[order], sigma[order], observed[order])
        assert_same(found, outcome(method(name), design, sigma, observed))


@pytest.mark.parametrize("scale", ["posterior_floored", "apriori", "posterior", "mad", "mad_floored"])
def test_everything_in_metres_scales_with_sigma(scale):
    """Sigma and observations times three: residuals in units of sigma, and so all weights, stay as they are."""
    design, sigma, observed = scenarios()
    for of in (Ls(), Igg3(scale=scale, iterations=3)):
        assert_same(outcome(of, design, 3 * sigma, 3 * observed), outcome(of, design, sigma, observed), scale=3.0)


def test_a_turn_about_the_vertical_turns_the_error_alone(any_method):
    design, sigma, observed = scenarios()
    turn = 0.7
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    turned = np.hstack([design[:, :3] @ rotation.T, design[:, 3:]])
    found, expected = outcome(any_method, turned, sigma, observed), outcome(any_method, design, sigma, observed)
    np.testing.assert_allclose(found.vpl_m, expected.vpl_m, rtol=TOLERANCE)
    if any_method.name not in ("araim", "separated"):
        # Their horizontal level puts levels along two axes together, so that it depends on these.
        np.testing.assert_allclose(found.hpl_m, expected.hpl_m, rtol=TOLERANCE)
    np.testing.assert_allclose(found.error_m, rotation @ np.asarray(expected.error_m), rtol=0, atol=TOLERANCE)


def test_an_error_that_a_system_shares_changes_nothing_but_its_clock(any_method):
    design, sigma, observed = scenarios()
    shared = np.where(design[:, 3:4] > 0, 1e5, -3e4)
    found = outcome(any_method, design, sigma, observed + shared)
    expected = outcome(any_method, design, sigma, observed)
    # Rounding now is relative to 1e5 m.
    np.testing.assert_allclose(found.error_m, expected.error_m, rtol=0, atol=1e5 * TOLERANCE)
    np.testing.assert_allclose(found.vpl_m, expected.vpl_m, rtol=1e-6)


def test_without_reweighting_the_robust_estimate_is_least_squares():
    """Thresholds that no residual reaches: every weight stays one."""
    far = Igg3(k0=1e3, k1=2e3)
    assert_same(outcome(far, *scenarios()), outcome(Ls(), *scenarios()))


def test_the_k_factors_multiply():
    for cls in (Ls, functools.partial(Igg3, iterations=10)):
        plain, other = outcome(cls(), *scenarios()), outcome(cls(k_vertical=10.66, k_horizontal=3.09), *scenarios())
        np.testing.assert_allclose(other.vpl_m, 2 * plain.vpl_m, rtol=1e-14)
        np.testing.assert_allclose(other.hpl_m, plain.hpl_m / 2, rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: method("igg"), "method: 'igg' is unknown .nearest: igg3"),
        (lambda: method("LS"), "method: 'LS' is unknown .nearest: ls"),
        (lambda: method("igg3", k2=4.0), "method igg3: the option 'k2' is unknown .nearest: k"),
        (lambda: method("ls", k_verticall=4.0), "option 'k_verticall' is unknown .nearest: k_vertical"),
        (lambda: method("igg3", scale="apiori"), "scale: 'apiori' is unknown .nearest: apriori"),
        (lambda: method("igg3", k0=5.0, k1=1.5), "igg3: 0 < k0 < k1 is needed"),
        (lambda: method("igg3", iterations=0), "iterations: a whole number of at least 1"),
        (lambda: method("igg3", iterations=15, acceleration="aitken"), "acceleration: .* iterations of at least 16"),
        (lambda: as_methods(3), "methods: .*needed, not 3"),
        (lambda: as_methods(()), "methods: at least one method"),
        (lambda: as_methods((3,)), "methods: 3 is no method .valid names: ls, igg3"),
        (lambda: as_methods(("ls", Ls())), "methods: ls is asked for twice"),
        (lambda: as_methods({"igg3": {"k0": 2.0}}), "methods: a sequence of methods is needed, not"),
    ],
)
def test_options_that_do_not_exist(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_whole_numbers_are_held_as_such():
    """1.0 and 1e0 are 1 wherever a whole number is asked for; as a float it broke the loops that are as long."""
    held = (
        method("w_test", exclusions=1.0).exclusions,
        method("nioraim", iterations=3.0).iterations,
        method("igg3", iterations=1e1).options.iterations,
        SOptions(5.0).steps,
        *Execution(workers=2.0, devices=1.0, shard=(1.0, 2.0)).shard,
    )
    assert held == (1, 3, 10, 5, 1, 2)
    assert {type(number) for number in held} == {int}


def test_a_new_method_runs_through_the_sweep():
    """Nothing but the record above is needed; its chi-square test gives the exact rates of such a test."""
    g = appendix_d(noise=3.0)
    faults = pl_mc.ramp(g, satellite="G03", start_m=0.0, stop_m=30.0, step_m=10.0)
    threshold = float(chi2_threshold(5, 1e-3))
    # A level so small that it never alarms leaves the test alone to decide.
    silent = CheckedLs(inflation=1e-9, threshold=threshold)
    loud = CheckedLs(inflation=1.5, threshold=threshold)
    with jax.numpy_dtype_promotion("standard"):
        table = pl_mc.sweep(g, faults, draws=4000, seed=3, methods=(silent, loud, Ls(k_vertical=1.5 * 5.33)), workers=1)
    silent_rows, loud_rows, ls_rows = (table[table["method"] == name] for name in table["method"].unique())
    exact = pl_mc.exact.ls_rates(g, faults, alarm="chi2", p_fa=1e-3)
    p_values = binomial_p_value(silent_rows["alarms"], silent_rows["draws"], exact["alarm_rate"])
    # Four tests at a family-wise level of 1e-6.
    assert p_values.min() > 1e-6 / len(faults)
    assert np.all(loud_rows["alarms"].to_numpy() >= ls_rows["alarms"].to_numpy())
    assert np.all(loud_rows["alarms"].to_numpy() >= silent_rows["alarms"].to_numpy())
    np.testing.assert_array_equal(loud_rows["exceeded"], ls_rows["exceeded"])
    np.testing.assert_array_equal(loud_rows["hazards"], ls_rows["hazards"])


def test_a_lone_satellite_takes_part_in_every_method(any_method):
    design, sigma, _ = random_sky(np.random.default_rng(12), counts=(7, 1))
    observed = 0.5 * sigma[:, None] * np.random.default_rng(13).standard_normal((8, LANES))
    # Padded to the shape that is compiled already.
    design, observed = (np.pad(one, ((0, 2), (0, 0))) for one in (design, observed))
    sigma = np.pad(sigma, (0, 2), constant_values=1.0)
    with_it, without = (outcome(any_method, design, sigma, observed, np.arange(10) < n) for n in (8, 7))
    assert_same(with_it, without)
