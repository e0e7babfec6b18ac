"""Corrections against RTKLIB's own functions and against values that follow from the formulas by hand."""

from __future__ import annotations

import math

import numpy as np
import pyrtklib as rtklib
import pytest
from receiver_files import ALPHA, BETA, WEEK, C, rtk_array

from pl_mc.receiver.corrections import bds_klobuchar_delay_m, klobuchar_delay_m, line_of_sight, troposphere_delay_m
from pl_mc.receiver.signals import signals_of

SKIES = np.random.default_rng(7).uniform(
    [0.0, -np.pi / 2, -np.pi, 0.0, np.radians(3.0), -50.0],
    [604_800.0, np.pi / 2, np.pi, 2 * np.pi, np.pi / 2, 9_000.0],
    size=(400, 6),
)


def test_klobuchar_is_rtklibs() -> None:
    sow, latitude, longitude, azimuth, elevation, _ = SKIES.T
    ours = klobuchar_delay_m(
        time_gps_s=WEEK * 604_800.0 + sow,
        latitude_rad=latitude,
        longitude_rad=longitude,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        alpha=ALPHA,
        beta=BETA,
    )
    theirs = [
        rtklib.ionmodel(
            rtklib.gpst2time(WEEK, s), rtk_array((*ALPHA, *BETA)), rtk_array((lat, lon, h)), rtk_array((a, e))
        )
        for s, lat, lon, a, e, h in SKIES
    ]
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-9)


def test_klobuchar_at_night_is_five_nanoseconds_times_the_obliquity() -> None:
    # At the zenith the factor is 1 + 16 (0.53 - 0.5)^3.
    delay = klobuchar_delay_m(
        time_gps_s=7200.0, latitude_rad=0.0, longitude_rad=0.0, azimuth_rad=0.0, elevation_rad=np.pi / 2,
        alpha=ALPHA, beta=BETA,
    )  # fmt: skip
    assert delay == pytest.approx(5e-9 * C * (1 + 16 * 0.03**3), rel=1e-12)


def bds_delay_m(sow: float, lat: float, lon: float, azimuth: float, elevation: float) -> float:
    """BDS-SIS-ICD-2.1, 5.2.4.7, one direction at a call, with coefficients of a real day."""
    alpha = (1.1176e-08, 2.9802e-08, -4.1723e-07, 6.5565e-07)
    beta = (1.1059e05, -3.2768e04, -2.2938e06, 4.5875e06)
    cosine = 6378.0 / (6378.0 + 375.0) * math.cos(elevation)
    psi = math.pi / 2 - elevation - math.asin(cosine)
    phi = math.asin(math.sin(lat) * math.cos(psi) + math.cos(lat) * math.sin(psi) * math.cos(azimuth))
    turn = math.asin(math.sin(psi) * math.sin(azimuth) / math.cos(phi))
    local = (sow - 14.0 + (lon + turn) * 43_200.0 / math.pi) % 86_400.0
    amplitude = max(sum(a * abs(phi / math.pi) ** k for k, a in enumerate(alpha)), 0.0)
    period = min(max(sum(b * abs(phi / math.pi) ** k for k, b in enumerate(beta)), 72_000.0), 172_800.0)
    vertical = 5e-9
    if abs(local - 50_400.0) < period / 4:
        vertical += amplitude * math.cos(2 * math.pi * (local - 50_400.0) / period)
    return C * vertical / math.sqrt(1 - cosine**2)


def test_the_model_of_beidou_is_that_of_its_document() -> None:
    skies = SKIES[np.abs(SKIES[:, 1]) < 1.3]
    sow, latitude, longitude, azimuth, elevation, _ = skies.T
    ours = bds_klobuchar_delay_m(
        time_gps_s=WEEK * 604_800.0 + sow, latitude_rad=latitude, longitude_rad=longitude, azimuth_rad=azimuth,
        elevation_rad=elevation, alpha=(1.1176e-08, 2.9802e-08, -4.1723e-07, 6.5565e-07),
        beta=(1.1059e05, -3.2768e04, -2.2938e06, 4.5875e06),
    )  # fmt: skip
    np.testing.assert_allclose(ours, [bds_delay_m(*sky[:5]) for sky in skies], rtol=1e-9, atol=1e-6)
    assert ours.min() >= 5e-9 * C
    assert ours.max() > 5.0


def test_the_ionosphere_scales_with_the_square_of_the_frequency() -> None:
    assert signals_of("G")[0].ionosphere_factor() == 1.0
    assert signals_of("C")[0].ionosphere_factor() == pytest.approx((1575.42 / 1561.098) ** 2, rel=1e-14)


def test_saastamoinen_is_rtklibs() -> None:
    _, latitude, longitude, azimuth, elevation, height = SKIES.T
    ours = troposphere_delay_m(latitude_rad=latitude, height_m=height, elevation_rad=elevation)
    when = rtklib.gpst2time(WEEK, 0.0)
    theirs = [
        rtklib.tropmodel(when, rtk_array((lat, lon, h)), rtk_array((a, e)), 0.7)
        for lat, lon, a, e, h in zip(latitude, longitude, azimuth, elevation, height, strict=True)
    ]
    # RTKLIB uses a rounded pi in the zenith distance of this model; hence not rounding error.
    np.testing.assert_allclose(ours, theirs, rtol=1e-7)


@pytest.mark.parametrize(("height_m", "elevation_rad"), [(-101.0, 1.0), (10_001.0, 1.0), (0.0, 0.0), (0.0, -0.1)])
def test_there_is_no_troposphere_outside_the_model(height_m: float, elevation_rad: float) -> None:
    assert troposphere_delay_m(latitude_rad=0.5, height_m=height_m, elevation_rad=elevation_rad) == 0.0


def test_line_of_sight_agrees_with_the_first_order_formula_of_the_rotation() -> None:
    receiver = np.array([3582104.8991, 532590.1966, 5232755.2961])
    satellites = np.array([[21_815_349.0, -13_786_112.0, -5_530_031.0], [1.2e7, 1.9e7, 1.4e7], [-2e6, 5e6, 2.6e7]])
    range_m, unit = line_of_sight(satellites, receiver)
    rotation = 7.2921151467e-5 / C * (satellites[:, 0] * receiver[1] - satellites[:, 1] * receiver[0])
    straight = np.linalg.norm(satellites - receiver, axis=1)
    # The terms of second order in the angle of rotation, 6e-6 rad, are below a millimetre.
    np.testing.assert_allclose(range_m, straight + rotation, atol=1e-3)
    assert np.abs(rotation).max() > 10
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0, rtol=1e-14)


def test_line_of_sight_broadcasts_over_epochs_and_satellites() -> None:
    rng = np.random.default_rng(3)
    satellites, receivers = 2e7 + 1e6 * rng.normal(size=(4, 5, 3)), 3e6 + 1e3 * rng.normal(size=(4, 3))
    range_m, unit = line_of_sight(satellites, receivers[:, None, :])
    assert range_m.shape == (4, 5)
    one, direction = line_of_sight(satellites[2, 3], receivers[2])
    assert range_m[2, 3] == one
    np.testing.assert_array_equal(unit[2, 3], direction)
