"""What every error model is: a name, a description, and a standard deviation for satellites in the sky.

A model sees satellites only through `Sky`: class of orbit, direction, and where the user is. Nothing else about
satellites or receivers reaches it, so that a model serves nominal constellations and receiver files alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import LEAST_SIGMA_M, MOST_SIGMA_M
from pl_mc.input_errors import InputError, is_real, nearest, shown

ORBIT_CLASSES = ("GPS", "BDS-MEO", "BDS-IGSO", "BDS-GEO", "GAL", "GLO")

# An elevation computed as an arc sine may come out a rounding error above the zenith.
_ZENITH_TOLERANCE_RAD = 1e-9


@dataclass(frozen=True)
class Sky:
    """Satellites as an error model sees them; the fields are arrays that broadcast against each other.

    Attributes:
        orbit: class of orbit of each satellite, one of `ORBIT_CLASSES`.
        elevation_rad: elevation above the horizon, over 0 and at most pi/2 [rad].
        azimuth_rad: azimuth, clockwise from north [rad].
        latitude_rad, longitude_rad: geodetic position of the user [rad].
        satellite: name of each satellite ("G07"); None where names are not known.
    """

    orbit: ArrayLike
    elevation_rad: ArrayLike
    azimuth_rad: ArrayLike
    latitude_rad: ArrayLike
    longitude_rad: ArrayLike
    satellite: ArrayLike | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape that the fields broadcast to.

        Raises:
            InputError: the fields do not broadcast against each other.
        """
        given = {name: getattr(self, name) for name in self.__dataclass_fields__}
        shapes = {name: np.shape(np.asarray(value)) for name, value in given.items() if value is not None}
        try:
            return np.broadcast_shapes(*shapes.values())
        except ValueError:
            listed = ", ".join(f"{name} {s}" for name, s in shapes.items())
            raise InputError(f"sky: the shapes of its fields do not fit each other ({listed}).") from None

    def checked(self) -> Sky:
        """The same sky with every field broadcast to one shape, after a check of each value.

        Raises:
            InputError: an unknown class of orbit, an angle that is not a finite number, an elevation outside
                (0, pi/2], or a latitude outside [-pi/2, pi/2].
        """
        shape = self.shape
        orbit = np.broadcast_to(np.asarray(self.orbit, dtype=np.str_), shape)
        unknown = orbit[~np.isin(orbit, ORBIT_CLASSES)]
        if unknown.size:
            word = str(unknown.flat[0])
            raise InputError(f"orbit: {shown(word)} is not a class of orbit ({nearest(word, ORBIT_CLASSES)}).")
        angles = {
            name: np.broadcast_to(_angle(name, getattr(self, name)), shape)
            for name in ("elevation_rad", "azimuth_rad", "latitude_rad", "longitude_rad")
        }
        elevation = angles["elevation_rad"]
        bad = elevation[~((elevation > 0) & (elevation <= np.pi / 2 + _ZENITH_TOLERANCE_RAD))]
        if bad.size:
            raise InputError(
                f"elevation_rad: {bad.flat[0]:g} rad; an error model needs satellites above the horizon, "
                "with elevations over 0 and at most pi/2 rad."
            )
        bad = angles["latitude_rad"][np.abs(angles["latitude_rad"]) > np.pi / 2 + _ZENITH_TOLERANCE_RAD]
        if bad.size:
            raise InputError(f"latitude_rad: {bad.flat[0]:g} rad; a latitude is between -pi/2 and pi/2 rad.")
        names = None if self.satellite is None else np.broadcast_to(np.asarray(self.satellite, dtype=np.str_), shape)
        return Sky(orbit=orbit, **angles, satellite=names)


@runtime_checkable
class ErrorModel(Protocol):
    """Anything with these three members serves as an error model."""

    @property
    def name(self) -> str:
        """Name of the model, as printed in reports."""
        ...

    def sigma_m(self, sky: Sky) -> NDArray[np.float64]:
        """Standard deviation of the pseudorange error of each satellite, in the shape of ``sky`` [m]."""
        ...

    def describe(self) -> dict[str, Any]:
        """Name and options as plain numbers and strings, fit for a table of settings or a JSON file."""
        ...


# One factor for all satellites, or one for each.
Scale = float | NDArray[np.float64]


@runtime_checkable
class ScaledVariance(Protocol):
    """An error model that knows what of its variance is noise and what ionosphere."""

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """Variance of each error of a checked sky with the two scaled, the noise with orbit and clock [m^2]."""
        ...


class FromVariance:
    """What error models share whose figures add up to a variance, ``variance_m2`` of a checked sky [m^2]."""

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """Variance of each pseudorange error of a checked sky [m^2]."""
        raise NotImplementedError

    def sigma_m(self, sky: Sky) -> NDArray[np.float64]:
        """Standard deviation of each pseudorange error, in the shape of ``sky`` [m].

        Raises:
            InputError: what `Sky.checked` refuses; an elevation of 0 or less among it.
        """
        return np.sqrt(self.variance_m2(sky.checked()))


def sigma_of_signal_m(
    model: ErrorModel, sky: Sky, *, noise: NDArray[np.float64], ionosphere: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standard deviations of a model for other pseudoranges than those of one carrier in the band of L1 [m].

    A model with ``scaled_variance_m2`` scales its terms. Of any other one everything is taken for the larger of the
    two, since it does not say what of its sigma is noise.

    Args:
        model: the model.
        sky: the satellites.
        noise: standard deviation of the noise over that of one carrier, in the shape of ``sky``.
        ionosphere: delay of the ionosphere over that on L1; 0 where two carriers are combined.
    """
    if np.all(noise == 1.0) and np.all(ionosphere == 1.0):
        return model.sigma_m(sky)
    if isinstance(model, ScaledVariance):
        return np.sqrt(model.scaled_variance_m2(sky.checked(), noise, ionosphere))
    return np.maximum(noise, ionosphere) * model.sigma_m(sky)


def by_orbit(record: Any, options: Sequence[str], sky: Sky) -> NDArray[np.float64]:
    """Figures of a record by class of orbit, fields such as ``bds_meo_m``, for each satellite of a checked sky."""
    figure = np.zeros(sky.shape)
    for option in options:
        orbit = option.rpartition("_")[0].replace("_", "-").upper()
        figure = np.where(np.asarray(sky.orbit) == orbit, getattr(record, option), figure)
    return figure


def require_figure(option: str, value: Any, *, allow_zero: bool = False, squared: bool = False) -> float:
    """``value`` as a float if it is usable as a standard deviation in metres, or squared as a variance.

    Raises:
        InputError: not a finite number, or negative, or zero where ``allow_zero`` is False, or such that what it is a
            part of cannot be computed with.
    """
    words, unit, short = ("square metres", "m^2", "m^2") if squared else ("metres", "m", "metres")
    power = 2 if squared else 1
    least, most = 0.0 if allow_zero else LEAST_SIGMA_M**power, MOST_SIGMA_M**power
    rule = f"zero or more, {most:g} at most" if allow_zero else f"over zero, {least:g} to {most:g}"
    if not is_real(value):
        raise InputError(f"{option}: {shown(value)} is not a number of {words}; it is {rule}.")
    # Whole numbers may be beyond any that is computed with.
    number = math.inf if abs(value) > most else float(value)
    if not least <= number <= most:
        raise InputError(f"{option}: {number:g} {unit} cannot be used; it is a finite number of {short}, {rule}.")
    return number


def require_options(model: str, given: Mapping[str, Any], known: tuple[str, ...]) -> None:
    """Raise `InputError`, with the nearest names, for an option that ``model`` does not have."""
    for option in given:
        if option in known:
            continue
        if not known:
            raise InputError(
                f"error model {shown(model)}: it has no options, so {shown(option)} cannot be set; "
                "the model 'user' has them."
            )
        raise InputError(f"error model {shown(model)}: it has no option {shown(option)} ({nearest(option, known)}).")


def _angle(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        angle = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: it cannot be read as an array of angles in radians.") from None
    bad = angle[~np.isfinite(angle)]
    if bad.size:
        raise InputError(f"{name}: {bad.flat[0]} is not an angle; every angle is a finite number of radians.")
    return angle
