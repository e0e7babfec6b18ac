"""How errors are really distributed, where that is not what a method takes them for.

All these laws are Gaussian once something else is drawn: errors of every satellite with a sigma of its own, which a
Student variable and a contaminated normal one have for each draw (scale mixtures: Andrews & Mallows 1974, J. R.
Statist. Soc. B 36:99-102), delays by multipath, or errors that satellites have in common. What an event is given the
residuals then stays a normal probability, with another mean and covariance. Of whitened errors z with centre c and
covariance R, B an orthonormal basis of the residuals and g the gain of an error component,

    E(g z | B'z) = g c + M B'(z - c),   cov = g R g' - M (g R B)',   M = g R B (B'R B)^-1;

with R = I that is nothing but the covariance of least squares, since g B is zero.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError, require_fraction, require_positive
from pl_mc.integrity_risk.given_residuals.draws import EpochParts, Lanes
from pl_mc.noise_models import GaussianMixture, Multipath, NoiseModel, StudentT
from pl_mc.noise_models.off_centre import EXPONENTIAL, METRES

# Half of the draws have so many satellites, on average, of a law with more of what is rare: every other one of them
# off the core, gamma variables of a twentieth, delays of three times the length.
_FEW, _OFTEN, _SMALL, _LONG = 3.0, 0.5, 0.05, 3.0


@dataclass(frozen=True)
class Given:
    """What is drawn before errors are Gaussian.

    Attributes:
        scale, centre: (draws, n), of the whitened errors; None for one and zero.
        weight: (draws,), likelihood ratio of these draws; None for one.
    """

    scale: FloatArray | None = None
    centre: FloatArray | None = None
    weight: FloatArray | None = None


class Truth(ABC):
    """A law of the whitened errors, Gaussian of some correlation once scales and centres are drawn."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What tables call it."""

    def correlation(self, parts: EpochParts) -> FloatArray:
        """(n, n), of the Gaussian part of the errors."""
        return np.eye(parts.in_view.size)

    def given(self, parts: EpochParts, rng: np.random.Generator, draws: int) -> Given:
        """What is drawn before."""
        return Given()

    def lanes(self, parts: EpochParts, rng: np.random.Generator, strength: FloatArray) -> tuple[Lanes, FloatArray]:
        """Draws of errors, and (draws,) the square sum of the residuals of each, whose Gaussian part is made white.

        ``strength`` (draws, 1) multiplies the Gaussian part of each draw.
        """
        draws, n = len(strength), parts.in_view.size
        unit = rng.standard_normal((draws, n)) * strength
        correlation = self.correlation(parts) * np.outer(parts.in_view, parts.in_view)
        given = self.given(parts, rng, draws)
        # A common part alone leaves a root of zero.
        values, vectors = np.linalg.eigh(correlation)
        own = unit @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        covariance = correlation[None]
        if given.scale is not None:
            own, covariance = given.scale * own, given.scale[:, :, None] * correlation * given.scale[:, None, :]
        basis = _of_residuals(parts)
        residual = own @ basis
        within = basis.T @ covariance @ basis
        across = parts.gain_m @ covariance @ basis
        map_m = np.swapaxes(np.linalg.solve(within, np.swapaxes(across, 1, 2)), 1, 2)
        left_m2 = parts.gain_m @ covariance @ parts.gain_m.T - map_m @ np.swapaxes(across, 1, 2)
        shift_m = (map_m @ residual[:, :, None])[:, :, 0]
        square = (residual[:, None] @ np.linalg.solve(within, residual[:, :, None]))[:, 0, 0]
        noise = own
        if given.centre is not None:
            noise, shift_m = own + given.centre, shift_m + given.centre @ parts.gain_m.T
        return Lanes(noise, shift_m, left_m2, given.weight), square


def _of_residuals(parts: EpochParts) -> FloatArray:
    """(n, dof), an orthonormal basis of the whitened residuals."""
    seen = np.flatnonzero(parts.in_view)
    basis = np.zeros((parts.in_view.size, parts.dof))
    basis[seen] = np.linalg.qr(parts.basis[seen], mode="complete")[0][:, seen.size - parts.dof :]
    return basis


@dataclass(frozen=True)
class Scaled(Truth):
    """Independent Gaussian errors, all of the model's sigma times a factor."""

    factor: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self.factor, field="truth: factor")

    @property
    def name(self) -> str:
        return f"sigma times {self.factor:g}"

    def lanes(self, parts: EpochParts, rng: np.random.Generator, strength: FloatArray) -> tuple[Lanes, FloatArray]:
        unit = rng.standard_normal((len(strength), parts.in_view.size)) * strength * parts.in_view
        return Lanes(self.factor * unit, None, self.factor**2 * parts.covariance_m2), parts.residual_square(unit)


@dataclass(frozen=True)
class Alike(Truth):
    """Errors of which every two satellites share the same part, in units of sigma: correlation ``share``."""

    share: float = 0.1

    def __post_init__(self) -> None:
        require_fraction(self.share, field="truth: share")

    @property
    def name(self) -> str:
        return f"correlation {self.share:g} of all satellites"

    def correlation(self, parts: EpochParts) -> FloatArray:
        return (1.0 - self.share) * np.eye(parts.in_view.size) + self.share


@dataclass(frozen=True)
class Neighbours(Truth):
    """Errors correlated by exp(-angle / ``angle_deg``) between two satellites: a Gauss-Markov field of the sky."""

    angle_deg: float = 30.0

    def __post_init__(self) -> None:
        require_positive(self.angle_deg, field="truth: angle_deg")

    @property
    def name(self) -> str:
        return f"correlation that falls to 1/e over {self.angle_deg:g} deg of sky"

    def correlation(self, parts: EpochParts) -> FloatArray:
        sight = parts.design[:, :3] / np.maximum(np.linalg.norm(parts.design[:, :3], axis=1), 1e-12)[:, None]
        angle = np.degrees(np.arccos(np.clip(sight @ sight.T, -1.0, 1.0)))
        return np.exp(-angle / self.angle_deg)


@dataclass(frozen=True)
class OfNoise(Truth):
    """Errors of a noise model that is Gaussian once something else is drawn."""

    noise: NoiseModel = StudentT()  # noqa: RUF009 (a frozen record)

    def __post_init__(self) -> None:
        if not isinstance(self.noise, StudentT | GaussianMixture | Multipath):
            raise InputError(
                f"noises: {self.noise.name}: errors that are Gaussian given something else are needed (nearest: "
                "student_t, gaussian_mixture, multipath)."
            )

    @property
    def name(self) -> str:
        return self.noise.name

    def given(self, parts: EpochParts, rng: np.random.Generator, draws: int) -> Given:
        noise, shape = self.noise, (draws, parts.in_view.size)
        share = min(_FEW / parts.in_view.sum(), 0.5)
        rare = (rng.random(shape) < share) & (np.arange(draws) % 2 == 1)[:, None]
        if isinstance(noise, StudentT):
            square = rng.chisquare(noise.nu, shape) * np.where(rare, _SMALL, 1.0)
            ratio = _SMALL ** (-0.5 * noise.nu) * np.exp(0.5 * square * (1.0 - 1.0 / _SMALL))
            scale = noise.unit * (noise.of_sigma or 1.0) * np.sqrt(noise.nu / square)
            return Given(scale, None, _weight(ratio, share, parts))
        if isinstance(noise, GaussianMixture):
            wide = rng.random(shape) < np.where(rare, _OFTEN, noise.chance)
            ratio = np.where(wide, _OFTEN / noise.chance, (1.0 - _OFTEN) / (1.0 - noise.chance))
            scale = noise.core * (noise.of_sigma or 1.0) * np.where(wide, noise.scale, 1.0)
            return Given(scale, None, _weight(ratio, share, parts))
        assert isinstance(noise, Multipath)
        elevation = np.arcsin(np.clip(-parts.design[:, 2], -1.0, 1.0))
        chance = noise.chance * (1.0 if noise.decay_deg is None else np.exp(-elevation / np.radians(noise.decay_deg)))
        chance = np.minimum(np.broadcast_to(chance, parts.in_view.shape), 1.0 - 1e-12)
        delayed = rng.random(shape) < np.where(rare, _OFTEN, chance)
        ratio = np.where(delayed, _OFTEN / chance, (1.0 - _OFTEN) / (1.0 - chance))
        if noise.law == EXPONENTIAL:
            delay = rng.exponential(size=shape) * np.where(rare, _LONG, 1.0)
            ratio = ratio * np.where(delayed, np.exp(delay * (1.0 - 1.0 / _LONG)) / _LONG, 1.0)
        else:
            delay = rng.random(shape)
        size = noise.size / parts.sigma_m if noise.unit == METRES else noise.size
        return Given(None, np.where(delayed, size * delay, 0.0) * parts.in_view, _weight(ratio, share, parts))


def _weight(ratio: FloatArray, share: float, parts: EpochParts) -> FloatArray:
    """(draws,), of draws half of which have a share of satellites of a law with this density ratio (draws, n)."""
    each = np.where(parts.in_view, 1.0 - share + share * ratio, 1.0)
    return 1.0 / (0.5 + 0.5 * np.exp(np.log(each).sum(axis=1)))
