"""ARAIM against numbers that nobody in this project made.

Appendix D of the ARAIM Algorithm Description Document v3.0 prints VPL 19.2, HPL 14.5, EMT 7.8 and sigma_v,acc
1.47 m; an independent implementation gives the further digits. The printed HPL holds a tolerance of 0.05 m in each
axis. The 96 cases were computed with Stanford's MAAST for ARAIM.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pl_mc.araim
from reference.problems import VECTORS, appendix_d

# C_acc of Appendix D, in the order of its satellites [m^2].
C_ACC = np.array([3.5740, 1.1252, 0.5479, 1.3258, 1.0104, 0.5309, 0.5838, 0.5544, 0.5448, 1.0491])


@pytest.fixture(scope="module")
def example():
    g = appendix_d()
    p_const = {"G": 1e-4, "E": 1e-4}
    return pl_mc.araim.protection_levels(
        g.design, g.sigma_m**2, C_ACC, g.systems, 0.5, 1e-5, p_const, unmonitored="plain"
    )


def test_appendix_d(example):
    assert example.vpl_m == pytest.approx(19.2171, abs=5e-3)
    assert example.hpl_m == pytest.approx(14.4158, abs=5e-3)
    assert example.emt_m == pytest.approx(7.8194, abs=5e-3)
    assert example.sigma_v_acc_m == pytest.approx(1.46976, abs=1e-4)
    # All printed digits.
    assert example.p_not_monitored == pytest.approx(3.4496e-8, abs=5e-13)
    assert np.hypot(example.hpl_east_m + 0.05, example.hpl_north_m + 0.05) == pytest.approx(14.49, abs=5e-3)


def test_appendix_d_in_its_parts(example):
    """Twelve modes, Galileo's and GPS's first; the vertical multiplier of the thresholds is 5.1083."""
    g = appendix_d()
    assert example.excluded.shape == (12, 10)
    assert sorted(example.excluded.sum(axis=1)) == [1] * 10 + [5, 5]
    # Sigma of the separation, from the pseudoinverses with all satellites and without the first.
    root = 1 / g.sigma_m
    whole = (np.linalg.pinv(g.design * root[:, None]) * root)[2]
    part = np.insert((np.linalg.pinv((g.design * root[:, None])[1:]) * root[1:])[2], 0, 0.0)
    mode = np.flatnonzero((example.excluded.sum(axis=1) == 1) & example.excluded[:, 0])[0]
    separation = np.sqrt((part - whole) ** 2 @ C_ACC)
    assert example.threshold_m[mode, 2] / separation == pytest.approx(5.1083, abs=5e-5)
    assert stats.norm.isf(3.9e-6 / 24) == pytest.approx(5.1083, abs=5e-5)


def maast():
    """Design, variances and systems as batches padded with NaN, a mask, and the table of results."""
    rows = np.genfromtxt(VECTORS / "araim_maast_geometry.csv", delimiter=",", names=True)
    cases = np.genfromtxt(VECTORS / "araim_maast_cases.csv", delimiter=",", names=True)
    width = int((cases["n_gps"] + cases["n_gal"]).max())
    design = np.full((len(cases), width, 5), np.nan)
    variances = np.full((2, len(cases), width), np.nan)
    systems = np.full((len(cases), width), "G")
    in_view = np.zeros((len(cases), width), dtype=bool)
    for k, case in enumerate(cases["case"]):
        part = rows[rows["case"] == case]
        n = len(part)
        columns = [part["e"], part["n"], part["u"], 1 - part["galileo"], part["galileo"]]
        design[k, :n] = np.stack(columns, axis=1)
        variances[:, k, :n] = part["c_int_m2"], part["c_acc_m2"]
        systems[k, :n] = np.where(part["galileo"] == 1, "E", "G")
        in_view[k, :n] = True
    return design, variances, systems, in_view, cases


def test_maast():
    design, (c_int, c_acc), systems, in_view, cases = maast()
    assert len(cases) == 96
    np.testing.assert_array_equal((in_view & (systems == "E")).sum(axis=1), cases["n_gal"])
    p_const = {"G": 1e-8, "E": 1e-4}
    found = pl_mc.araim.protection_levels(design, c_int, c_acc, systems, 0.75, 1e-5, p_const, in_view=in_view)
    np.testing.assert_allclose(found.vpl_m, cases["vpl"], rtol=0, atol=5e-3)
    np.testing.assert_allclose(found.hpl_m, cases["hpl"], rtol=0, atol=5e-3)
    np.testing.assert_allclose(found.emt_m, cases["emt"], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.sigma_v_acc_m, cases["sig_acc_v"], rtol=0, atol=1e-5)
    # Seven printed digits.
    np.testing.assert_allclose(found.p_not_monitored, cases["p_not_monitored"], rtol=0, atol=5.1e-15)
    np.testing.assert_array_equal((found.probability > 0).sum(axis=1) + 1, cases["nsub"])
