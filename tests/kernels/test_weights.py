"""Weight functions: their published values, their ends, and gradients that stay finite everywhere."""

from __future__ import annotations

import jax
import numpy as np
import pytest
import statsmodels.api as sm

from pl_mc import InputError
from pl_mc.kernels import HuberWeight, Igg3Weight, IrlsOptions, TukeyWeight
from pl_mc.kernels.weights import DanishWeight, HampelWeight, L1Weight
from reference.igg3_numpy import igg3_weight


@pytest.mark.parametrize(
    ("u", "w"),
    [
        (0.0, 1.0),
        (1.5, 1.0),
        # k0 / u ((k1 - u) / (k1 - k0))^2 by hand: 0.75 (3 / 3.5)^2, 0.5 (2 / 3.5)^2, 0.375 (1 / 3.5)^2.
        (2.0, 0.75 * 36 / 49),
        (3.0, 0.5 * 16 / 49),
        (4.0, 0.375 * 4 / 49),
        (5.0, 0.0),
        (5.000001, 0.0),
        (1e12, 0.0),
    ],
)
def test_igg3_weight(u, w):
    np.testing.assert_allclose(Igg3Weight()(np.asarray(u)), w, rtol=1e-14)
    np.testing.assert_allclose(igg3_weight(u), w, rtol=1e-14)


@pytest.mark.parametrize(("k0", "k1"), [(1.5, 5.0), (1.0, 3.0), (2.5, 8.0)])
def test_igg3_weight_is_the_reference_s_and_falls(k0, k1):
    u = np.linspace(0, 10, 2001)
    found = np.asarray(Igg3Weight(k0, k1)(u))
    np.testing.assert_allclose(found, [igg3_weight(x, k0, k1) for x in u], atol=1e-15)
    assert np.all(np.diff(found) <= 0)
    # Continuous: steps of 0.005 change it by no more than its largest slope, 1/k0 + 2/(k1 - k0), allows.
    assert np.abs(np.diff(found)).max() < 0.005 * (1 / k0 + 2 / (k1 - k0))


def test_huber_and_tukey_weights():
    np.testing.assert_allclose(HuberWeight()(np.array([0.0, 1.345, 2.69, 1e9])), [1, 1, 0.5, 1.345e-9], rtol=1e-14)
    np.testing.assert_allclose(TukeyWeight()(np.array([0.0, 4.685 / 2, 4.685, 1e9])), [1, 0.5625, 0, 0], atol=1e-15)


@pytest.mark.parametrize(("a", "b", "c"), [(2.0, 4.0, 8.0), (1.7, 3.4, 8.5), (2.0, 2.0, 3.0)])
def test_hampel_weight_is_that_of_statsmodels(a, b, c):
    u = np.linspace(0, 10, 501)
    np.testing.assert_allclose(HampelWeight(a, b, c)(u), sm.robust.norms.Hampel(a, b, c).weights(u), atol=1e-15)


def test_danish_weight():
    # By hand: nothing up to c, e^-1 at 2 c, e^-4 at 3 c, and no step at c.
    u = np.array([0.0, 2.0, 4.0, 6.0, 2.0 + 1e-9])
    np.testing.assert_allclose(DanishWeight()(u), [1, 1, np.exp(-1), np.exp(-4), 1], rtol=1e-14)
    assert 0 < DanishWeight()(np.array(1e9)) < 1e-30


def test_l1_weight_makes_the_square_sum_one_of_absolute_values():
    u = np.array([0.0, 1e-4, 0.5, 3.0, 1e9])
    found = np.asarray(L1Weight()(u))
    np.testing.assert_allclose(found * u**2, 1e-4 * u, rtol=1e-14)
    assert found.max() == 1


@pytest.mark.parametrize(
    "weight", [Igg3Weight(), HuberWeight(), TukeyWeight(), HampelWeight(), DanishWeight(), L1Weight()]
)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_weights_keep_the_type_and_have_finite_gradients(weight, dtype):
    u = np.array([0.0, 0.1, 1.345, 1.5, 2.0, 4.685, 5.0, 6.0, 1e8], dtype)
    values = weight(u)
    assert values.dtype == dtype
    assert np.all((values >= 0) & (values <= 1))
    assert np.isfinite(jax.vmap(jax.grad(weight))(u)).all()


@pytest.mark.parametrize(("k0", "k1"), [(0.0, 5.0), (-1.0, 5.0), (5.0, 5.0), (6.0, 5.0), (1.5, np.inf), (np.nan, 5.0)])
def test_thresholds_that_make_no_sense(k0, k1):
    with pytest.raises(InputError, match=r"igg3: 0 < k0 < k1"):
        Igg3Weight(k0, k1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: HampelWeight(a=0.0), "hampel: 0 < a <= b < c is needed"),
        (lambda: HampelWeight(a=True), "hampel: 0 < a <= b < c is needed, not a = True"),
        (lambda: Igg3Weight(k0=True), "igg3: 0 < k0 < k1 is needed, not k0 = True"),
        (lambda: HampelWeight(b=8.0), "hampel: 0 < a <= b < c is needed"),
        (lambda: HampelWeight(c=np.inf), "hampel: 0 < a <= b < c is needed"),
        (lambda: DanishWeight(-1.0), "danish: c"),
        (lambda: L1Weight(0.0), "l1: eps"),
    ],
)
def test_constants_that_make_no_sense(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scale": "a priori"}, "scale: 'a priori' is unknown .nearest: apriori"),
        ({"cofactor": "faultfree"}, "cofactor: 'faultfree' is unknown .nearest: fault_free"),
        ({"redundancy": "keep"}, "redundancy: 'keep' is unknown .nearest: kept"),
        ({"iterations": 0}, "iterations: a whole number of at least 1"),
        ({"iterations": 2.5}, "iterations: a whole number of at least 1"),
    ],
)
def test_options_that_do_not_exist(options, words):
    with pytest.raises(InputError, match=words):
        IrlsOptions(**options)
