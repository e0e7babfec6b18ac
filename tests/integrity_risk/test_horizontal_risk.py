"""Risks and multipliers of the horizontal level, held to the exact law of least squares."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax import Array
from scipy import optimize

import pl_mc
from pl_mc.alert import AXES, EITHER, HORIZONTAL, VERTICAL, AlertLimits
from pl_mc.faults import biases, no_fault
from pl_mc.integrity_risk.rare.limit_state import RISK_EVENTS, limit_state, rotation
from pl_mc.kernels.events import EVENTS, events, limits_of
from pl_mc.methods import Igg3, Ls, Outcome, Sbas
from pl_mc.statistics import ls_quantities, ls_rates
from pl_mc.statistics.length import length_beyond
from reference.problems import appendix_d

pytestmark = pytest.mark.counting

RAIL = AlertLimits("rail", vertical_m=15.0, horizontal_m=10.0)
BEFORE = AlertLimits("rail", horizontal_m=10.0)
METRES = st.floats(0.0, 60.0)
NAMES = [event.name for event in EVENTS]
NEVER_REWEIGHTS = Igg3(k0=1e3, k1=2e3, iterations=1)


@jax.jit
def judged(outcome: Outcome) -> list[tuple[Array, Array]]:
    """Of every axis, which events happened and the limit states of those that have one."""
    limits = {VERTICAL: 15.0, HORIZONTAL: 10.0, EITHER: jnp.array([15.0, 10.0])}
    return [
        (
            events(outcome, jnp.asarray(limits_of(RAIL, np.float64)), axis),
            jnp.stack([limit_state(outcome, limits[axis], event, axis) for event in RISK_EVENTS]),
        )
        for axis in AXES
    ]


@given(
    error=st.tuples(METRES, METRES, METRES), levels=st.tuples(METRES, METRES), available=st.booleans(),
    rejects=st.booleans(),
)  # fmt: skip
def test_the_sign_is_the_event_on_every_axis(
    error: tuple[float, float, float], levels: tuple[float, float], available: bool, rejects: bool
) -> None:
    infinite = np.inf if not available else 0.0
    outcome = Outcome(
        error_m=np.array(error) + infinite, hpl_m=np.array(levels[0] + infinite),
        vpl_m=np.array(levels[1] + infinite), available=np.array(available), rejects=np.array(rejects),
    )  # fmt: skip
    for axis, (seen, values) in zip(AXES, jax.device_get(judged(outcome)), strict=True):
        happened = dict(zip(NAMES, seen, strict=True))
        for event, value in zip(RISK_EVENTS, values, strict=True):
            assert np.isfinite(value)
            if value != 0.0:
                assert (value > 0.0) == happened[event], (axis, event)


@pytest.mark.parametrize(("axis", "components"), [(VERTICAL, 1), (HORIZONTAL, 2), (EITHER, 3)])
def test_the_first_coordinates_hold_all_that_an_axis_feels(axis: str, components: int) -> None:
    g = appendix_d()
    bias = np.zeros(len(g.names))
    bias[2] = 7.0
    turned = rotation(g.design, g.sigma_m, g.in_view, bias, axis)
    assert turned.active == int(ls_quantities(g).dof) + components
    np.testing.assert_allclose(turned.matrix.T @ turned.matrix, np.eye(len(g.names)), atol=1e-12)
    quantities = ls_quantities(g)
    gains = {VERTICAL: [quantities.gain], HORIZONTAL: list(quantities.horizontal_gain)}
    gains[EITHER] = gains[VERTICAL] + gains[HORIZONTAL]
    for gain in gains[axis]:
        moved = (gain * g.sigma_m) @ turned.matrix
        np.testing.assert_allclose(moved[turned.active :], 0.0, atol=1e-12)


@pytest.fixture(scope="module")
def sky() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=1)[0]


@pytest.mark.parametrize(
    ("event", "bias_m", "hal_m"),
    [
        ("misleading", 0.0, 10.0),
        ("misleading", 6.0, 10.0),
        ("misleading", 10.0, 10.0),
        ("exceeded", 8.0, 10.0),
        ("missed", 4.0, 3.0),
        ("missed", 8.0, 6.0),
        ("alarm", 0.0, 12.0),
        ("alarm", 3.0, 16.0),
    ],
)
def test_risks_are_the_exact_ones(sky: pl_mc.Geometry, event: str, bias_m: float, hal_m: float) -> None:
    """From 1e-2 to 1e-13; the interval has 95 %, and four standard errors are seldom left."""
    alert = AlertLimits("near", horizontal_m=hal_m)
    fault = biases(sky, {"G12": bias_m}) if bias_m else no_fault(sky)
    exact = float(ls_rates(sky, fault, alert=alert, axis="horizontal")[f"{event}_rate"].iloc[0])
    row = pl_mc.risk(
        sky, fault, event=event, method="ls", seed=5, alert=alert, max_evaluations=2_000_000, target_cov=0.07,
        progress=False,
    ).iloc[0]  # fmt: skip
    assert row.axis == HORIZONTAL
    assert 1e-14 < exact < 0.5
    assert row.warning == "" or "coefficient of variation" in row.warning
    assert abs(np.log(row.probability / exact)) < 4.0 * row.standard_error / row.probability
    assert row.low < exact * 1.2
    assert row.high > exact / 1.2


def test_either_lies_between_its_parts_and_their_sum(sky: pl_mc.Geometry) -> None:
    fault = biases(sky, {"G12": 5.0})
    found = {
        axis: pl_mc.risk(
            sky, fault, event="misleading", method="ls", seed=3, alert=RAIL, axis=axis, max_evaluations=500_000,
            progress=False,
        ).iloc[0]
        for axis in AXES
    }  # fmt: skip
    parts = {
        axis: float(ls_rates(sky, fault, alert=RAIL, axis=axis).misleading_rate.iloc[0])  # type: ignore[arg-type]
        for axis in (VERTICAL, HORIZONTAL)
    }
    for axis, exact in parts.items():
        assert found[axis].low < exact < found[axis].high
    either = found[EITHER]
    # An alarm of the other level silences some of them.
    assert either.low < sum(parts.values())
    assert either.high > 0.5 * max(parts.values())


def test_the_axis_is_chosen_and_told(sky: pl_mc.Geometry) -> None:
    options = {"event": "alarm", "method": "ls", "seed": 1, "max_evaluations": 500_000, "progress": False}
    alone = pl_mc.risk(sky, no_fault(sky), alert=AlertLimits("both", 3.0, 2.0), **options)  # type: ignore[arg-type]
    assert "axis" not in alone
    assert "The horizontal alert limit of both, 2 m, is not judged" in alone.attrs["unjudged"]
    near = pl_mc.risk(sky, no_fault(sky), alert=AlertLimits("x", horizontal_m=2.0), **options)  # type: ignore[arg-type]
    assert near.axis.tolist() == [HORIZONTAL]
    assert near.attrs["unjudged"] == ""


def test_the_exact_multiplier_of_least_squares(sky: pl_mc.Geometry) -> None:
    for target in (1e-2, 5e-9, 1e-13):
        table = pl_mc.calibrate(sky, target=target, alert=BEFORE)
        k = float(table.k_horizontal.iloc[0])
        rates = ls_rates(sky, no_fault(sky), alert=BEFORE, axis="horizontal", k_horizontal=k)
        assert rates.exceeded_rate.iloc[0] == pytest.approx(target, rel=1e-6)
        assert "k_vertical" not in table
        assert table.inflation.iloc[0] == pytest.approx(k / 6.18)
    faulted = pl_mc.calibrate(
        sky, target=1e-7, faults=biases(sky, {"G12": 6.0}), event="misleading", alert=RAIL, axis="horizontal"
    )
    rates = ls_rates(
        sky, biases(sky, {"G12": 6.0}), alert=RAIL, axis="horizontal", k_horizontal=float(faulted.k_horizontal.iloc[0])
    )
    assert rates.misleading_rate.iloc[0] == pytest.approx(1e-7, rel=1e-6)
    assert faulted.alarm_rate_after.iloc[0] == pytest.approx(rates.alarm_rate.iloc[0], rel=1e-9)


@pytest.mark.parametrize("target", [1e-2, 1e-7])
def test_counted_and_rare_multipliers_hold_the_exact_one(sky: pl_mc.Geometry, target: float) -> None:
    exact = float(pl_mc.calibrate(sky, target=target, alert=BEFORE).k_horizontal.iloc[0])
    row = pl_mc.calibrate(
        sky, method=NEVER_REWEIGHTS, target=target, alert=BEFORE, draws=50_000, seed=4, confidence=0.999,
        max_evaluations=1_000_000,
    ).iloc[0]  # fmt: skip
    assert row.found == ("counting" if target == 1e-2 else "rare events")
    assert row.k_low < exact < row.k_high
    assert row.k_horizontal == pytest.approx(exact, rel=0.05)


def test_a_level_of_the_geometry_alone_has_the_quantile_of_the_length(sky: pl_mc.Geometry) -> None:
    """HPL = K d_major: K is where the length of a Gaussian vector with both standard deviations is exceeded."""
    variance = np.linalg.eigvalsh(ls_quantities(sky).horizontal_cofactor)
    ratio = np.sqrt(variance[:1] / variance[1:])
    quantile = optimize.brentq(
        lambda k: float(np.log(length_beyond([k], ratio, [0.0], [0.0])[1][0] / 1e-3)), 1.0, 10.0, xtol=1e-10
    )
    row = pl_mc.calibrate(
        sky, method=Sbas(), target=1e-3, alert=BEFORE, draws=100_000, seed=6, confidence=0.999
    ).iloc[0]  # fmt: skip
    assert row.k_low < quantile < row.k_high
    # Between one component alone and two alike (Rayleigh).
    assert 3.2905 < quantile < np.sqrt(-2.0 * np.log(1e-3))


def test_what_cannot_be(sky: pl_mc.Geometry) -> None:
    vertical, fault = AlertLimits("x", vertical_m=3.0), no_fault(sky)
    with pytest.raises(pl_mc.InputError, match="axis: horizontal needs a horizontal limit, and x has VAL 3 m alone"):
        pl_mc.risk(sky, fault, seed=1, alert=vertical, axis="horizontal")
    with pytest.raises(pl_mc.InputError, match="axis: horizontal needs a horizontal limit, and x has VAL 3 m alone"):
        pl_mc.calibrate(sky, alert=vertical, axis="horizontal")
    with pytest.raises(pl_mc.InputError, match="axis: vertical needs a vertical limit, and NPA has HAL 556 m alone"):
        pl_mc.risk(sky, fault, seed=1, alert="NPA", axis="vertical")
    with pytest.raises(pl_mc.InputError, match="axis: a multiplier belongs to one level; choose vertical or horizon"):
        pl_mc.calibrate(sky, axis="either")  # type: ignore[arg-type]
    with pytest.raises(pl_mc.InputError, match="axis: 'up' is unknown"):
        pl_mc.risk(sky, fault, seed=1, axis="up")
    with pytest.raises(pl_mc.InputError, match="axis: 3 is unknown"):
        pl_mc.calibrate(sky, axis=3)  # type: ignore[arg-type]
    assert Ls().k_horizontal == 6.18


def exact_at(g: pl_mc.Geometry, fault: str, event: str, alert: AlertLimits) -> float:
    return float(ls_rates(g, biases(g, fault), alert=alert, axis="horizontal")[f"{event}_rate"].iloc[0])


def test_the_worst_satellites_horizontally(sky: pl_mc.Geometry) -> None:
    """Estimates are the exact probabilities of the fault that was found, and no size of the satellite is worse."""
    names = ["G12", "C01"]
    table = pl_mc.worst_case(
        sky,
        method=NEVER_REWEIGHTS,
        satellites=names,
        event="misleading",
        alert=BEFORE,
        refine=2,
        seed=2,
        max_evaluations=2_000_000,
    )
    assert table.axis.tolist() == [HORIZONTAL] * 2
    assert sorted(table.satellites) == sorted(names)
    assert table.probability.is_monotonic_decreasing
    for row in table.itertuples():
        exact = exact_at(sky, row.fault, "misleading", BEFORE)
        assert abs(np.log(row.probability / exact)) < 4.0 * row.standard_error / row.probability
        sizes = np.linspace(0.5, 20.0, 14)
        faults = pl_mc.ramps(sky, satellites=[row.satellites], start_m=0.5, stop_m=20.0, step_m=1.5)
        rates = ls_rates(sky, faults, alert=BEFORE, axis="horizontal")
        assert len(rates) == len(sizes)
        assert exact > 0.9 * rates.misleading_rate.max()


def test_the_worst_pairs_horizontally(sky: pl_mc.Geometry) -> None:
    pairs = [("G12", "G22"), ("C01", "C04")]
    table = pl_mc.worst_case(
        sky, satellites=pairs, event="missed", alert=BEFORE, refine=1, seed=2, max_evaluations=2_000_000
    )
    row = table[table.refined].iloc[0]
    exact = exact_at(sky, row.fault, "missed", BEFORE)
    assert abs(np.log(row.probability / exact)) < 4.0 * row.standard_error / row.probability + 0.05


def test_a_budget_horizontally() -> None:
    """Eight satellites; every mode is between nothing and its prior, and the fault-free one is exact."""
    g, alert = appendix_d(), AlertLimits("near", horizontal_m=30.0)
    table = pl_mc.risk_budget(
        g, method="ls", event="misleading", alert=alert, bias=[10.0, 20.0], pairs=1, p_const=0.0, draws=8,
        max_evaluations=500_000, seed=3,
    )  # fmt: skip
    assert table.attrs["axis"] == HORIZONTAL
    free = table[table["mode"] == "fault_free"].iloc[0]
    rate = float(ls_rates(g, no_fault(g), alert=alert, axis="horizontal").misleading_rate.iloc[0])
    assert free.low < rate < free.high
    single = table[table["mode"] == "satellite"].iloc[0]
    name = single.failed
    faults = biases(g, {name: 10.0}) + biases(g, {name: 20.0})
    rates = ls_rates(g, faults, alert=alert, axis="horizontal").misleading_rate
    assert single.low <= rates.mean() <= single.high
    assert table.iloc[-1].risk_per_sample > 0


def test_worst_cases_that_cannot_be(sky: pl_mc.Geometry) -> None:
    with pytest.raises(pl_mc.InputError, match="alarm: 'chi2' is for exact worst cases of the vertical"):
        pl_mc.worst_case(sky, alert="NPA", alarm="chi2")
    for function in (pl_mc.worst_case, pl_mc.risk_budget):
        with pytest.raises(pl_mc.InputError, match="axis: either needs a vertical limit, and NPA has HAL 556 m alone"):
            function(sky, alert="NPA", axis="either")
