"""Simulation of a geometry over a site or a track: nominal constellations, GPS of an almanac, or precise orbits."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.error_models import ErrorModel, Sky, as_error_model
from pl_mc.geometry.almanac import almanac_slots
from pl_mc.geometry.constellations import SETS, constellation_slots
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.orbits import satellite_positions_m
from pl_mc.geometry.record import POSITION_UNKNOWNS, SYSTEM_NAMES, UP, Geometry, as_words
from pl_mc.geometry.sites import DEFAULT_SITE, checked_positions_m, site_position_m
from pl_mc.geometry.sp3 import PreciseOrbits, sp3_orbits
from pl_mc.input_errors import InputError, require_number, shown

DEFAULT_EPOCHS = 2880

# Positions of 40 satellites at so many epochs fill gigabytes: what is more is a slip of the hand.
MOST_EPOCHS = 1_000_000

# Three centuries: beyond, nothing that is known of the orbits holds.
_LONGEST_SERIES_S = 1e10


@ordinary_arithmetic
def simulate(
    *,
    site: str | ArrayLike | None = None,
    track_m: ArrayLike | None = None,
    start: str | date | np.datetime64 = "2017-11-21T00:00:00",
    epochs: int | None = None,
    interval_s: float = 30.0,
    mask_deg: float = 10.0,
    visible: ArrayLike | None = None,
    constellations: str | Sequence[str] = ("GPS", "BDS-2"),
    without: str | Sequence[str] = (),
    almanac: str | Path | None = None,
    sp3: str | Path | None = None,
    error_model: str | ErrorModel = "residual",
) -> Geometry:
    """The satellites of nominal constellations as a user sees them, epoch by epoch.

    Args:
        site: where a standing user is: a name of `pl_mc.geometry.sites.SITES`, Earth-fixed "X,Y,Z" or
            three numbers [m], or latitude, longitude [deg] and height [m]; CUT0 where neither site nor track is given.
        track_m: (epochs, 3), Earth-fixed positions of a moving user instead of a site [m].
        start: first epoch in GPS time, ISO 8601 without time zone.
        epochs: number of epochs, up to a million; 2880 over a site, as many as the track has otherwise.
        interval_s: time from one epoch to the next [s].
        mask_deg: elevation below which a satellite does not count, 0 to below 90 [deg].
        visible: (epochs, m), False where a satellite is hidden for reasons other than the mask; m counts the
            satellites of `constellation_slots(constellations, without)`, or those of the SP3 file.
        constellations: names of `pl_mc.geometry.constellations.CONSTELLATIONS`, or ``ADD-24+24`` alone: the GPS and
            Galileo satellites of the ARAIM description.
        without: satellites that are switched off.
        almanac: a YUMA or SEM file, whose healthy satellites take the place of the nominal GPS.
        sp3: an SP3 file, plain or packed, whose satellites take the place of all nominal ones, at its positions
            interpolated; not together with an almanac. All epochs lie within those of the file. C01 to C18 are
            BDS-2, C19 to C63 BDS-3. A satellite is out of view at epochs that need a position which the file leaves
            out, gives as 0 or 999999.999999, or marks as one during a manoeuvre, or which lies on no orbit with
            those beside it: from five and a half intervals before it to as many after it. ``notes`` of the result
            says so.
        error_model: name of an error model, or an object that serves as one.

    Returns:
        A series of epochs. There is one clock for each system in view at any epoch, in the order G, C, E, R;
        BeiDou-2 and BeiDou-3 share one. A satellite alone in its system keeps its row.

    Raises:
        InputError: an option that cannot be used, or no satellite in view at any epoch.

    Example:
        >>> import pl_mc
        >>> pl_mc.simulate(site="CUT0", start="2017-11-21", epochs=3, interval_s=60.0)
        Geometry(3 epochs, 16 satellites at once, 16 in all: GPS, BeiDou)
    """
    first_gps_s = gps_seconds(start)
    wanted, off = (
        (words,) if isinstance(words, str) else as_words(field, words)
        for field, words in (("constellations", constellations), ("without", without))
    )
    if sp3 is not None and almanac is not None:
        raise InputError("sp3: an almanac is given too; the satellites come from one of the two files.")
    for name in [] if sp3 is None and almanac is None else [name for name in wanted if name in SETS]:
        raise InputError(
            f"constellations: {name} is nominal as a whole; for the satellites of a file name them one by one, such as "
            "GPS and GAL."
        )
    real = None if almanac is None else almanac_slots(almanac, first_gps_s)
    # The satellites of an SP3 file are its own: of the nominal ones the names of constellations alone are checked.
    slots = constellation_slots(wanted, () if sp3 is not None else off, gps_slots=real)
    if not isinstance(error_model, str | ErrorModel):
        raise InputError(f"error model: a name or an error model is needed, not {shown(error_model)}.")
    model = as_error_model(error_model)
    position, epochs = _positions_m(site, track_m, epochs)
    mask_deg = require_number(mask_deg, field="mask_deg")
    if not 0.0 <= mask_deg < 90.0:
        nearest_valid = "0" if mask_deg < 0 else "below 90"
        raise InputError(
            f"mask_deg: {mask_deg:g} deg is outside the range from 0 to below 90 deg; nearest: {nearest_valid}."
        )
    interval_s = require_number(interval_s, field="interval_s")
    if interval_s <= 0:
        raise InputError(f"interval_s: {interval_s:g} s; the time between epochs is over zero, as in 30 s.")
    if interval_s * epochs > _LONGEST_SERIES_S:
        raise InputError(
            f"interval_s: {epochs} epochs every {interval_s:g} s last {interval_s * epochs:.3g} s; at most "
            f"{_LONGEST_SERIES_S:g} s can be simulated."
        )
    time_gps_s = first_gps_s + interval_s * np.arange(epochs)

    # One epoch keeps its axis, whatever the conversion makes of an axis of length one.
    latitude, longitude = (np.reshape(angle, epochs) for angle in geodetic(position)[:2])
    if sp3 is not None:
        satellites = sp3_orbits(sp3, time_gps_s, constellations=wanted, without=off)
    else:
        satellites = PreciseOrbits(
            names=tuple(slot.name for slot in slots),
            orbits=tuple(slot.orbit for slot in slots),
            position_m=satellite_positions_m(slots, time_gps_s),
        )
    sight = satellites.position_m - position[:, None]
    sight = sight / np.linalg.norm(sight, axis=-1, keepdims=True)
    enu = np.einsum("eij,emj->emi", enu_rotation(latitude, longitude), sight)
    # On the horizon itself sigma is infinite, so a mask of zero still needs a satellite above it.
    in_view = (enu[..., UP] >= np.sin(np.radians(mask_deg))) & (enu[..., UP] > 0)
    if visible is not None:
        in_view &= _visibility(visible, in_view.shape)
    if not in_view.any():
        why = f" ({' '.join(satellites.notes).rstrip('.')})" if satellites.notes else ""
        raise InputError(f"geometry: no satellite is above the mask of {mask_deg:g} deg at any epoch{why}.")

    systems = tuple(name[0] for name in satellites.names)
    seen = {systems[k] for k in np.flatnonzero(in_view.any(axis=0))}
    clocks = tuple(letter for letter in SYSTEM_NAMES if letter in seen)
    at, satellite = np.nonzero(in_view)
    east, north, up = enu[at, satellite].T
    sky = Sky(
        orbit=np.array(satellites.orbits)[satellite],
        elevation_rad=np.arcsin(np.minimum(up, 1.0)),
        azimuth_rad=np.arctan2(east, north) % (2 * np.pi),
        latitude_rad=latitude[at],
        longitude_rad=longitude[at],
        satellite=np.array(satellites.names)[satellite],
    )
    sigma = np.asarray(model.sigma_m(sky), dtype=float)
    if sigma.shape != at.shape:
        raise InputError(
            f"error model {model.name!r}: one sigma per satellite is needed, shape {at.shape}, not {sigma.shape}."
        )
    sigma_m = np.ones(in_view.shape)
    sigma_m[at, satellite] = sigma
    design = np.zeros((*in_view.shape, POSITION_UNKNOWNS + len(clocks)))
    design[..., :POSITION_UNKNOWNS] = -enu
    for column, letter in enumerate(clocks, start=POSITION_UNKNOWNS):
        design[:, [system == letter for system in systems], column] = 1.0
    return Geometry.from_rows(
        design=design,
        sigma_m=sigma_m,
        in_view=in_view,
        names=satellites.names,
        systems=systems,
        clocks=clocks,
        time_gps_s=time_gps_s,
        notes=satellites.notes,
    )


def _positions_m(
    site: str | ArrayLike | None, track_m: ArrayLike | None, epochs: int | None
) -> tuple[NDArray[np.float64], int]:
    """Position at each epoch (epochs, 3) [m] and the number of epochs."""
    if epochs is not None and (isinstance(epochs, bool) or not isinstance(epochs, int | np.integer) or epochs < 1):
        raise InputError(f"epochs: {shown(epochs)} cannot be used; it is a whole number of at least 1.")
    if epochs is not None and epochs > MOST_EPOCHS:
        raise InputError(f"epochs: {epochs} are too many for one series; at most {MOST_EPOCHS} can be used.")
    if track_m is None:
        count = DEFAULT_EPOCHS if epochs is None else int(epochs)
        return np.tile(site_position_m(DEFAULT_SITE if site is None else site), (count, 1)), count
    if site is not None:
        raise InputError("site: a track is given too; the user either stands at a site or moves along a track.")
    track = checked_positions_m(track_m, field="track_m", shape=(None, 3))
    if epochs not in (None, len(track)):
        raise InputError(f"epochs: {epochs} were asked for, but the track has {len(track)}; leave epochs out.")
    return track, len(track)


def _visibility(visible: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    try:
        mask = np.asarray(visible)
    except ValueError:
        raise InputError(f"visible: True or False by epoch and satellite is needed, {shape}.") from None
    if mask.dtype != np.bool_ or mask.shape != shape:
        raise InputError(
            f"visible: True or False by epoch and satellite is needed, {shape}, not {mask.dtype} {mask.shape}."
        )
    return mask
