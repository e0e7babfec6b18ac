"""Reliability: published figures, identities, the power of the w-test at the MDB, and what has no check."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.statistics import (
    binomial_p_value,
    least_detectable,
    ls_quantities,
    noncentral_shift,
    reliability,
    reliability_matrix,
)

# ARAIM ADD v3.0 Appendix D geometry with W = 1 / C_int, computed elsewhere.
REDUNDANCY = (0.686552, 0.527214, 0.309345, 0.552657, 0.544048, 0.541127, 0.518285, 0.360606, 0.519245, 0.440920)


def test_baardas_shift() -> None:
    assert noncentral_shift(1e-3, 0.8) == pytest.approx(4.132147965, abs=5e-10)
    assert noncentral_shift(1e-3, 0.8) ** 2 == pytest.approx(17.0746468, abs=5e-8)


@pytest.mark.parametrize(("p_fa", "power"), [(1e-3, 0.8), (0.05, 0.95), (0.3, 0.31), (1e-8, 0.5)])
def test_the_shift_has_its_power_exactly(p_fa: float, power: float) -> None:
    limit = stats.norm.isf(p_fa / 2)
    shift = noncentral_shift(p_fa, power)
    assert stats.norm.sf(limit - shift) + stats.norm.cdf(-limit - shift) == pytest.approx(power, abs=1e-12)


def test_appendix_d(appendix_d: Geometry) -> None:
    table = reliability(appendix_d)
    assert list(table.columns) == ["name", "redundancy", "mdb_m", "vertical_effect_m", "slope"]
    np.testing.assert_allclose(table.redundancy, REDUNDANCY, atol=5e-7)
    assert table.redundancy.sum() == pytest.approx(5.0, abs=1e-12)
    np.testing.assert_allclose(table.mdb_m, 4.132147965 * appendix_d.sigma_m / np.sqrt(REDUNDANCY), rtol=2e-6)
    gain = np.abs(ls_quantities(appendix_d).gain)
    np.testing.assert_allclose(table.vertical_effect_m, gain * table.mdb_m, rtol=1e-12)
    np.testing.assert_allclose(table.slope * noncentral_shift(), table.vertical_effect_m, rtol=1e-12)


def test_the_slope_is_the_vertical_error_by_the_root_of_vpv(appendix_d: Geometry) -> None:
    whitened = appendix_d.design / appendix_d.sigma_m[:, None]
    for row, slope in enumerate(reliability(appendix_d).slope):
        target = np.zeros(10)
        target[row] = 7.0 / appendix_d.sigma_m[row]
        state = np.linalg.lstsq(whitened, target, rcond=None)[0]
        assert slope == pytest.approx(abs(state[2]) / np.linalg.norm(target - whitened @ state), rel=1e-9)


def test_the_w_test_finds_the_mdb_with_its_power(appendix_d: Geometry) -> None:
    """A simulation of |v_i| / (sigma_i sqrt(r_i)) beside the normal quantile, by NumPy alone."""
    draws, rng = 20_000, np.random.default_rng(20220801)
    whitened = appendix_d.design / appendix_d.sigma_m[:, None]
    project = np.eye(10) - whitened @ np.linalg.pinv(whitened)
    noise = rng.standard_normal((draws, 10))
    for p_fa, power in ((1e-3, 0.8), (0.05, 0.5)):
        limit = stats.norm.isf(p_fa / 2)
        for row, mdb in enumerate(reliability(appendix_d, p_fa=p_fa, power=power).mdb_m):
            bias = np.zeros(10)
            bias[row] = mdb / appendix_d.sigma_m[row]
            found = np.abs((noise + bias) @ project[row]) / np.sqrt(project[row, row]) > limit
            assert binomial_p_value(found.sum(), draws, power) > 1e-4


def test_the_matrix_maps_errors_to_residuals(appendix_d: Geometry, day: Geometry) -> None:
    matrix = reliability_matrix(appendix_d)
    rng = np.random.default_rng(1)
    errors = rng.standard_normal(10)
    weight = np.diag(1 / appendix_d.sigma_m**2)
    state = np.linalg.solve(appendix_d.design.T @ weight @ appendix_d.design, appendix_d.design.T @ weight @ errors)
    np.testing.assert_allclose(-matrix @ errors, appendix_d.design @ state - errors, atol=1e-12)
    np.testing.assert_allclose(matrix @ matrix, matrix, atol=1e-12)
    of_day = reliability_matrix(day)
    assert of_day.shape == (6, 12, 12)
    np.testing.assert_allclose(np.diagonal(of_day, axis1=1, axis2=2)[0], ls_quantities(day).redundancy[0], atol=1e-12)
    assert np.isnan(of_day[5]).all()


def test_a_series_has_a_row_for_each_satellite_in_view(day: Geometry) -> None:
    table = reliability(day)
    assert table.columns[0] == "epoch"
    assert len(table) == day.in_view.sum()
    np.testing.assert_allclose(table.groupby("epoch").redundancy.sum().iloc[:5], [7, 2, 2, 1, 0], atol=1e-9)
    # No redundancy: nothing is found, and only satellites that move the height hurt it.
    none = table[table.epoch == 104]
    assert np.isinf(none.mdb_m).all()
    assert np.isinf(none.vertical_effect_m).any()
    # Not determined: missing, not wrong.
    assert table[table.epoch == 105].drop(columns=["epoch", "name"]).isna().all().all()


def test_a_satellite_alone_in_its_system_cannot_be_checked_and_does_no_harm(appendix_d: Geometry) -> None:
    g = Geometry.from_arrays(
        appendix_d.design[[0, 1, 2, 3, 4, 5]], appendix_d.sigma_m[:6], "GGGGGE", appendix_d.names[:6]
    )
    lone = reliability(g).iloc[5]
    assert lone.redundancy == pytest.approx(0.0, abs=1e-12)
    assert np.isinf(lone.mdb_m)
    assert lone.vertical_effect_m == lone.slope == 0.0


def test_the_least_detectable_satellite(appendix_d: Geometry, day: Geometry) -> None:
    table = reliability(appendix_d)
    assert int(least_detectable(appendix_d)) == table.mdb_m.idxmax()
    galileo = table[table.name.str.startswith("E")]
    assert int(least_detectable(appendix_d, system="E")) == galileo.mdb_m.idxmax()
    rows = least_detectable(day, system="C")
    # GPS alone; nothing redundant; not determined. At epoch 3 the three others have redundancy.
    assert rows[[2, 4, 5]].tolist() == [-1, -1, -1]
    for epoch in (0, 1):
        mine = reliability(day[epoch])
        mine = mine[mine.name.str.startswith("C")]
        assert day.names[day.satellite[epoch, rows[epoch]]] == mine.name[mine.mdb_m.idxmax()]


def test_it_is_public(appendix_d: Geometry) -> None:
    assert pl_mc.reliability(appendix_d).equals(reliability(appendix_d))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"p_fa": 0.0}, "p_fa: it lies between 0 and 1"),
        ({"power": 1.0}, "power: it lies between 0 and 1"),
        ({"p_fa": 0.2, "power": 0.2}, "power: it lies above p_fa .0.2."),
    ],
)
def test_impossible_probabilities_are_refused(appendix_d: Geometry, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        reliability(appendix_d, **options)
