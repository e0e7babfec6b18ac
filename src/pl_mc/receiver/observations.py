"""A day of a real receiver as a series `Geometry` with the pseudorange errors about a known position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.constants import FREQUENCY_B1I_HZ, FREQUENCY_L1_HZ
from pl_mc.error_models import DEFAULT_ERROR_MODEL, ErrorModel, Sky, as_error_model
from pl_mc.error_models.base import sigma_of_signal_m
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.record import EAST, NORTH, SYSTEM_NAMES, UP, Geometry
from pl_mc.input_errors import InputError, require_number
from pl_mc.receiver.corrections import bds_klobuchar_delay_m, klobuchar_delay_m, line_of_sight, troposphere_delay_m
from pl_mc.receiver.ionosphere_maps import IonosphereMaps
from pl_mc.receiver.notes import PLAUSIBLE_PSEUDORANGE_M, epoch_notes, event_notes, satellite_notes, truth_notes
from pl_mc.receiver.rinex import ReceiverData, gps_date, read_rinex
from pl_mc.receiver.truth import Truth

DEFAULT_MASK_DEG = 10.0

# A truth further from the header's approximate position than this belongs to another receiver.
LARGEST_HEADER_DISTANCE_M = 1e5

# Models of the ionosphere by the system that sends their coefficients, with the carrier [Hz] of their delays.
_IONOSPHERE = {"G": (klobuchar_delay_m, FREQUENCY_L1_HZ), "C": (bds_klobuchar_delay_m, FREQUENCY_B1I_HZ)}

# Near the horizon the atmosphere delays by some hundred metres; more is an orbit or a pseudorange that is damaged.
_MISFIT_M = 1e4


@dataclass(frozen=True)
class ReceiverSeries:
    """What a real receiver saw, ready to be analysed; e epochs, n rows, as in the geometry.

    Attributes:
        geometry: the series, linearised at the true positions, one clock column per system.
        errors_m: (e, n), pseudorange errors about the truth, 0 where padded [m]. The least-squares solution of
            an epoch's errors is its position error in east, north, up.
        truth_m: (e, 3), true Earth-fixed positions [m].
        signals: what was read of each system, such as ``GPS L1 C/A`` or ``Galileo E1 + E5a``.
        notes: sentences about what was left out, and why.
    """

    geometry: Geometry
    errors_m: NDArray[np.float64]
    truth_m: NDArray[np.float64]
    signals: tuple[str, ...]
    notes: tuple[str, ...]

    def residuals(self) -> pd.DataFrame:
        """Errors of the satellites in view without what they have in common with their system: the receiver's clock.

        One row per epoch and satellite, but for those that have their clock alone: ``epoch, time_gps_s, satellite,
        elevation_deg, sigma_m, error_m, whitened``. The clock of each is the mean of its system, weighted by
        1 / sigma^2; what a mean of few takes away of an error is given back, so that its variance is that of the
        error (1 / sqrt(1 - w / sum of w)). ``whitened`` is the error over sigma.
        """
        g = self.geometry
        weight = np.where(g.in_view, 1.0 / np.where(g.in_view, g.sigma_m, 1.0) ** 2, 0.0)
        clock = np.abs(g.design[..., 3:]) > 0
        of_system = np.einsum("enc,en->ec", clock, weight)
        mean_m = np.einsum("enc,en,en->ec", clock, weight, self.errors_m) / np.where(of_system > 0, of_system, 1.0)
        share = weight / np.maximum(np.einsum("enc,ec->en", clock, of_system), 1e-300)
        row, column = np.nonzero(g.in_view & (share < 1.0 - 1e-9))
        error_m = (self.errors_m - np.einsum("enc,ec->en", clock, mean_m))[row, column]
        error_m = error_m / np.sqrt(1.0 - share[row, column])
        sigma_m = g.sigma_m[row, column]
        return pd.DataFrame(
            {
                "epoch": g.epoch[row], "time_gps_s": g.time_gps_s[row],
                "satellite": np.array(g.names, dtype=object)[g.satellite[row, column]],
                "elevation_deg": np.degrees(np.arcsin(-g.design[row, column, UP])), "sigma_m": sigma_m,
                "error_m": error_m, "whitened": error_m / sigma_m,
            }
        )  # fmt: skip


def read_receiver_series(
    obs_path: str | Path | Sequence[str | Path],
    nav_path: str | Path | Sequence[str | Path],
    truth: Truth,
    *,
    systems: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    mask_deg: float = DEFAULT_MASK_DEG,
    error_model: str | ErrorModel = DEFAULT_ERROR_MODEL,
    ionosphere: str = "broadcast",
    snr_dbhz: float | None = None,
    ionex: str | Path | Sequence[str | Path] | None = None,
) -> ReceiverSeries:
    """Read RINEX files and take from each pseudorange everything that is known at the true position.

    Errors are pseudorange less (range with Earth rotation, less satellite clock, plus Saastamoinen troposphere,
    plus broadcast ionosphere). The receiver clock stays in them, but for the median of each epoch and system,
    which is taken away so that the numbers are small; this changes the clock unknowns and nothing else.

    Where two carriers are combined, sigma is that of the error model without its ionosphere and with its noise times
    the root of the sum of the squared coefficients: 2.98 for L1 and L2 of GPS, 2.59 for E1 and E5a. On one carrier
    outside the band of L1 and B1I its ionosphere is that of L1 times (f1/f)^2.

    A satellite is in view where it has a plausible pseudorange, a healthy ephemeris with a predicted accuracy within
    the window, and an elevation of at least the mask.

    Args:
        obs_path, nav_path: RINEX files, one or several of either, see `pl_mc.receiver.rinex.read_rinex`.
        truth: the true position or track, see `pl_mc.receiver.truth.read_truth`.
        systems: RINEX letters, G, C, E, R and J; clock columns come in this order. Unless given, those of the first
            three that are there.
        signals: which signals, or pairs of them, see `pl_mc.receiver.rinex.read_rinex`.
        mask_deg: lowest elevation [deg].
        error_model: a name or a model, for the standard deviations.
        ionosphere: ``broadcast``, ``none`` or ``dual``, see `pl_mc.receiver.rinex.read_rinex`.
        snr_dbhz: least strength of a signal that is read [dB-Hz]; any unless given.
        ionex: files of maps of the ionosphere (IONEX), in place of the broadcast coefficients.

    The position of a track is taken at the time that the receiver's clock shows, which is up to a millisecond off:
    centimetres for a car.

    Raises:
        InputError: what `read_rinex` refuses; a mask outside 0 to 90 degrees; a truth more than 100 km from the
            header's position; no epoch with a known position and a satellite in view.
    """
    if not 0 <= require_number(mask_deg, field="mask_deg") < 90:
        raise InputError(f"mask_deg: {mask_deg:g} is outside 0 to 90 degrees.")
    model = as_error_model(error_model)
    if ionex is not None and ionosphere != "broadcast":
        raise InputError(f"ionex: maps take the place of the ionosphere broadcast, not of {ionosphere}.")
    maps = None if ionex is None else IonosphereMaps(ionex)
    ionosphere = ionosphere if maps is None else "maps"
    data = read_rinex(obs_path, nav_path, systems=systems, signals=signals, ionosphere=ionosphere, snr_dbhz=snr_dbhz)
    # How sentences call the files.
    obs_path = obs_path if isinstance(obs_path, str | Path) else " and ".join(map(str, obs_path))
    clocks = tuple(dict.fromkeys(data.systems)) if systems is None else tuple(systems)
    truth_m, known = truth.at(data.time_gps_s)
    _require_usable_truth(obs_path, truth, truth_m, known, data)
    epochs = np.flatnonzero(known)
    truth_m = truth_m[known]

    latitude, longitude, height = geodetic(truth_m)
    range_m, unit = line_of_sight(data.satellite_position_m[known], truth_m[:, None, :])
    unit = np.einsum("eij,emj->emi", enu_rotation(latitude, longitude), unit)
    elevation = np.arcsin(np.clip(unit[..., UP], -1.0, 1.0))
    azimuth = np.arctan2(unit[..., EAST], unit[..., NORTH])
    pseudorange_m = data.pseudorange_m[known]
    plausible = (pseudorange_m >= PLAUSIBLE_PSEUDORANGE_M[0]) & (pseudorange_m <= PLAUSIBLE_PSEUDORANGE_M[1])
    # A comparison with NaN (no ephemeris) is False; the error models have no figures for the horizon itself.
    in_view = plausible & (elevation >= np.radians(mask_deg)) & (elevation > 0)
    if not in_view.any():
        nothing = np.zeros(in_view.shape)
        told = (*data.notes, *satellite_notes(data, known, plausible, nothing > 0, nothing))
        raise InputError(
            f"{obs_path}: no epoch can be used; no satellite with pseudorange and ephemeris is {mask_deg:g} "
            f"degrees or more above the horizon of the true position ({truth.source}). {' '.join(told)}".rstrip()
        )

    row, column = np.nonzero(in_view)
    sky = Sky(
        orbit=np.array(data.orbits)[column],
        elevation_rad=elevation[in_view],
        azimuth_rad=azimuth[in_view],
        latitude_rad=latitude[row],
        longitude_rad=longitude[row],
        satellite=np.array(data.names)[column],
    )
    sigma_m = np.ones(in_view.shape)
    observables = [data.observables[data.systems[k]] for k in column]
    sigma_m[in_view] = sigma_of_signal_m(
        model, sky, noise=np.array([one.noise for one in observables]),
        ionosphere=np.array([one.ionosphere for one in observables]),
    )  # fmt: skip
    delay_m = _atmosphere_m(data, data.time_gps_s[known][row], column, sky, height[row], maps)
    raw_m = pseudorange_m - range_m + data.satellite_clock_m[known]
    error_m = np.zeros(in_view.shape)
    error_m[in_view] = raw_m[in_view] - delay_m
    misfit = _misfit_below(raw_m, plausible, in_view, data.systems)
    error_m = _without_medians(error_m, in_view, data.systems)

    clock = np.array([[float(letter == system) for system in clocks] for letter in data.systems])
    design = np.concatenate([-unit, np.broadcast_to(clock, (*in_view.shape, len(clocks)))], axis=-1)
    g = Geometry.from_rows(
        design=design,
        sigma_m=sigma_m,
        in_view=in_view,
        names=data.names,
        systems=data.systems,
        clocks=clocks,
        epoch=epochs,
        time_gps_s=data.time_gps_s[known],
    )
    kept = np.array([data.names.index(name) for name in g.names])
    packed = np.where(g.in_view, np.take_along_axis(error_m[:, kept], g.satellite, axis=1), 0.0)
    notes = (
        *event_notes(data.events, truth),
        *truth_notes(g, packed, truth),
        *data.notes,
        *epoch_notes(data, known, in_view, clocks),
        *satellite_notes(data, known, plausible, misfit, error_m),
    )
    read = tuple(f"{SYSTEM_NAMES[letter]} {data.observables[letter].name}" for letter in clocks)
    return ReceiverSeries(geometry=g, errors_m=packed, truth_m=truth_m, signals=read, notes=notes)


def _atmosphere_m(
    data: ReceiverData, time_gps_s: NDArray, column: NDArray, sky: Sky, height_m: NDArray, maps: IonosphereMaps | None
) -> NDArray[np.float64]:
    """Ionospheric and tropospheric delay of each satellite in view [m]."""
    troposphere_m = troposphere_delay_m(
        latitude_rad=sky.latitude_rad, height_m=height_m, elevation_rad=sky.elevation_rad
    )
    if not data.ionosphere and maps is None:
        return troposphere_m
    angles: Any = {
        name: getattr(sky, name) for name in ("latitude_rad", "longitude_rad", "azimuth_rad", "elevation_rad")
    }
    if maps is not None:
        carrier_hz, ionosphere_m = FREQUENCY_L1_HZ, maps.delay_m(time_gps_s, **angles)
    else:
        model, carrier_hz = _IONOSPHERE[data.ionosphere]
        ionosphere_m = model(time_gps_s=time_gps_s, **angles, alpha=data.klobuchar_alpha, beta=data.klobuchar_beta)
    factors = {letter: one.signals[0].ionosphere_factor(carrier_hz) for letter, one in data.observables.items()}
    factor = np.array([factors[letter] for letter in data.systems])[column]
    return factor * ionosphere_m + troposphere_m


def _without_medians(
    error_m: NDArray[np.float64], in_view: NDArray[np.bool_], systems: Sequence[str]
) -> NDArray[np.float64]:
    """Errors less the median of the satellites in view of the same epoch and system."""
    result = error_m.copy()
    for letter in set(systems):
        mine = in_view & (np.array(systems) == letter)
        some = mine.any(axis=1)
        median = np.zeros(len(error_m))
        median[some] = np.nanmedian(np.where(mine, error_m, np.nan)[some], axis=1)
        result = np.where(mine, result - median[:, None], result)
    return result


def _misfit_below(
    raw_m: NDArray[np.float64], plausible: NDArray[np.bool_], in_view: NDArray[np.bool_], systems: Sequence[str]
) -> NDArray[np.bool_]:
    """Which satellites below the mask have a pseudorange that no clock common to their system explains."""
    misfit = np.zeros(in_view.shape, dtype=bool)
    for letter in set(systems):
        mine = np.array(systems) == letter
        some = (in_view & mine).any(axis=1)
        if not some.any():
            continue
        clock_m = np.nanmedian(np.where(in_view & mine, raw_m, np.nan)[some], axis=1)
        below = plausible & mine & ~in_view & np.isfinite(raw_m)
        misfit[some] |= below[some] & (np.abs(np.nan_to_num(raw_m[some]) - clock_m[:, None]) > _MISFIT_M)
    return misfit


def _require_usable_truth(
    obs_path: object, truth: Truth, truth_m: NDArray, known: NDArray[np.bool_], data: ReceiverData
) -> None:
    if not known.any():
        raise InputError(
            f"{truth.source}: the track ({gps_date(truth.time_gps_s[0])}) gives no position at any epoch of "
            f"{obs_path} ({gps_date(data.time_gps_s[0])})."
        )
    distance_m = float(np.linalg.norm(truth_m[known][0] - data.header_position_m))
    if distance_m > LARGEST_HEADER_DISTANCE_M:
        raise InputError(
            f"truth: {truth.source} is {distance_m / 1e3:.0f} km from the approximate position in the header of "
            f"{obs_path}; it belongs to another receiver."
        )
