"""The model of two-frequency code, alone and with the sigma_URA of an ISM, against Stanford's MAAST for ARAIM."""

from __future__ import annotations

import numpy as np
import pytest

import pl_mc
from pl_mc.araim import Ism
from pl_mc.error_models import Sky, error_model
from pl_mc.error_models.atmosphere import troposphere_sigma_m
from pl_mc.error_models.base import sigma_of_signal_m
from reference.problems import VECTORS

# C_int and C_acc of 96 cases, with URA 1 m and URE 2/3 m; see tests/araim.
ROWS = np.genfromtxt(VECTORS / "araim_maast_geometry.csv", delimiter=",", names=True)
ORBITS = np.where(ROWS["galileo"] == 1, "GAL", "GPS")
# sin of the elevation is minus the third column, which has nine digits.
SKY = Sky(ORBITS, np.arcsin(-ROWS["u"]), 0.0, 0.0, 0.0)


def test_variances_are_those_of_maast():
    """1e-7 m^2 is what nine digits of the line of sight leave at 5 degrees."""
    for ura_m, column in ((1.0, "c_int_m2"), (2.0 / 3.0, "c_acc_m2")):
        model = error_model("dual_frequency", ism=Ism(sigma_ura_m=ura_m))
        np.testing.assert_allclose(model.sigma_m(SKY) ** 2, ROWS[column], rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("orbit", "elevation_deg", "user_m"),
    [
        # 2.58832 sqrt((0.13 + 0.53 e^-0.5)^2 + (0.15 + 0.43 e^(-5/6.9))^2), and at the zenith.
        ("GPS", 5.0, 1.49188),
        ("GPS", 90.0, 0.513882),
        # Lines of the table, and half way between two.
        ("GAL", 5.0, 0.4529),
        ("GAL", 12.5, 0.5 * (0.3553 + 0.3063)),
        ("GAL", 90.0, 0.2277),
    ],
)
def test_user_errors(orbit, elevation_deg, user_m):
    sky = Sky(orbit, np.radians(elevation_deg), 0.0, 0.0, 0.0)
    assert error_model("dual_frequency").user_sigma_m(sky.checked()) == pytest.approx(user_m, rel=1e-5)


def test_another_combination_scales_the_noise_alone():
    """Half the amplification halves sigma_user; the troposphere and what an ISM says stay."""
    sky = Sky(["GPS", "GAL"], np.radians([20.0, 50.0]), 0.0, 0.0, 0.0, satellite=["G01", "E02"])
    plain, troposphere_m = error_model("dual_frequency"), troposphere_sigma_m(sky.elevation_rad)
    amplification = np.hypot(154**2, 115**2) / (154**2 - 115**2)
    same = sigma_of_signal_m(plain, sky, noise=np.full(2, amplification), ionosphere=np.zeros(2))
    np.testing.assert_allclose(same, plain.sigma_m(sky), rtol=1e-12)
    half = sigma_of_signal_m(plain, sky, noise=np.full(2, amplification / 2), ionosphere=np.zeros(2))
    np.testing.assert_allclose(half**2, (same**2 - troposphere_m**2) / 4 + troposphere_m**2, rtol=1e-12)
    with_ura = error_model("dual_frequency", ism=Ism(sigma_ura_m=2.0))
    found = sigma_of_signal_m(with_ura, sky, noise=np.full(2, amplification / 2), ionosphere=np.zeros(2))
    np.testing.assert_allclose(found**2, half**2 + 4.0, rtol=1e-12)


def test_satellite_by_satellite():
    """URA under its own name for G02, of the constellation for the others; every model takes an ISM."""
    ism = {"sigma_ura_m": {"G": 1.0, "G02": 3.0, "E": 2.0}}
    sky = Sky(["GPS", "GPS", "GAL"], 0.8, 0.0, 0.0, 0.0, satellite=["G01", "G02", "E01"])
    for name in ("dual_frequency", "residual", "constant"):
        alone, with_ism = error_model(name), error_model(name, ism=ism)
        np.testing.assert_allclose(with_ism.sigma_m(sky) ** 2 - alone.sigma_m(sky) ** 2, [1.0, 9.0, 4.0])
        assert with_ism.name == f"{name}(ism=own)"
        assert with_ism.describe()["ism"]["sigma_ura_m"] == {"E": 2.0, "G": 1.0, "G02": 3.0}


def test_names_tell_systems_of_one_class_apart():
    """QZSS satellites have the errors of GPS, and an orbit and clock promise of their own."""
    sky = Sky(["GPS", "GPS"], 0.8, 0.0, 0.0, 0.0, satellite=["G01", "J02"])
    ism = {"sigma_ura_m": {"G": 1.0, "J": 2.0}}
    added = error_model("residual", ism=ism).sigma_m(sky) ** 2 - error_model("residual").sigma_m(sky) ** 2
    np.testing.assert_allclose(added, [1.0, 4.0])


def test_a_simulated_sky_has_names(tmp_path):
    path = tmp_path / "ism.csv"
    path.write_text("satellite,sigma_ura_m\nG,1\nE,1\nG05,2.5\n")
    options = {"site": "CUT0", "constellations": "ADD-24+24", "epochs": 60, "interval_s": 600.0, "mask_deg": 5.0}
    plain = pl_mc.simulate(**options, error_model="dual_frequency")
    ours = pl_mc.simulate(**options, error_model=error_model("dual_frequency", ism=path))
    added = (ours.sigma_m**2 - plain.sigma_m**2)[plain.in_view]
    fifth = (np.array(plain.names)[plain.satellite] == "G05")[plain.in_view]
    assert fifth.any()
    np.testing.assert_allclose(added, np.where(fifth, 6.25, 1.0))


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: pl_mc.simulate(epochs=1, error_model="dual_frequency"), "no figures for 'BDS-.* .valid: GPS, GAL"),
        (
            lambda: pl_mc.simulate(
                epochs=200, interval_s=300.0, constellations="GAL", mask_deg=0.0, error_model="dual_frequency"
            ),
            "a Galileo satellite is at .* its table begins at 5 deg; mask_deg: nearest: 5",
        ),
        (lambda: error_model("dual_frequency", sigma=1.0), "error model 'dual_frequency': it has no options"),
        (lambda: error_model("dual_frequency", ism=Ism(p_sat=1e-5)), "ism: sigma_ura_m: it is needed here"),
        (
            lambda: pl_mc.simulate(
                epochs=1, constellations="ADD-24+24", error_model=error_model("none", ism={"sigma_ura_m": {"G": 1.0}})
            ),
            "ism: sigma_ura_m: there is no value for E.. or for its constellation E .nearest: |valid: G",
        ),
        (
            lambda: error_model("none", ism={"sigma_ura_m": {"G": 1.0, "G07": 2.0}}).sigma_m(Sky("GPS", 1, 0, 0, 0)),
            "ism tells G07 from others, and the sky names no satellites",
        ),
    ],
)
def test_what_is_refused(act, words):
    with pytest.raises(pl_mc.InputError, match=words):
        act()
