"""Errors off their centre: delays by multipath, which have one sign, and biases without a fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import ndtr

from pl_mc.geometry.record import UP, Geometry
from pl_mc.input_errors import InputError, require_choice, require_number, require_numbers, require_positive, shown
from pl_mc.kernels import LinearModel
from pl_mc.kernels.linear_model import per_lane
from pl_mc.noise_models.base import OneNumber, make_floats
from pl_mc.noise_models.quantile_map import log_normal_upper

EXPONENTIAL, UNIFORM = "exponential", "uniform"
METRES, SIGMAS = "m", "sigma"
SIGNS = ("up", "down", "random", "given")

# Up to two sigma the root is found to rounding, up to three to 1e-5 of a sigma of the noise; beyond that the way to
# it is longer than this, and a bias is no longer one that anybody would call nominal.
_STEPS = 7
_LARGEST_RANDOM = 3.0
# Half of the peak of the standard normal density.
_HALF_PEAK = 0.5 / math.sqrt(2.0 * math.pi)


@dataclass(frozen=True)
class Multipath(OneNumber):
    """Gaussian noise, and with some probability a delay, independent between satellites and of the noise.

    Attributes:
        chance: probability of a delay, above 0 and at most 1; of a satellite at the horizon, where ``decay_deg`` is
            given.
        size: mean of an exponential delay, largest one of a uniform delay, which begins at 0.
        unit: of ``size``: ``m``, or ``sigma`` for that of each satellite.
        law: ``exponential`` or ``uniform``.
        decay_deg: elevation over which the probability falls to 1/e, chance exp(-elevation / decay) [deg]; the same
            for all satellites unless given.

    Example:
        >>> import pl_mc
        >>> pl_mc.multipath(chance=0.05, size=3.0).name
        'multipath(chance=0.05,size=3,unit=m,law=exponential)'
    """

    base_name = "multipath"

    chance: float = 0.01
    size: float = 5.0
    unit: str = METRES
    law: str = EXPONENTIAL
    decay_deg: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < require_number(self.chance, field="multipath: chance") <= 1.0:
            raise InputError(f"multipath: chance: a number above 0 and at most 1 is needed, not {self.chance!r}.")
        require_positive(self.size, field="multipath: size")
        require_choice(self.unit, (METRES, SIGMAS), field="multipath: unit")
        require_choice(self.law, (EXPONENTIAL, UNIFORM), field="multipath: law")
        make_floats(self, "chance", "size")
        if self.decay_deg is not None:
            require_positive(self.decay_deg, field="multipath: decay_deg")
            make_floats(self, "decay_deg")

    @property
    def inputs_per_row(self) -> int:
        return 2

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        noise, occurs = units
        inverse_sigma = model.weight_root
        log_chance = jnp.full_like(inverse_sigma, math.log(self.chance))
        if self.decay_deg is not None:
            sine = -model.design[:, UP] / jnp.where(inverse_sigma > 0, inverse_sigma, 1.0)
            elevation = jnp.arcsin(jnp.clip(sine, -1.0, 1.0))
            log_chance = log_chance - elevation / math.radians(self.decay_deg)
        # A delay where the second number is as far out as has the probability, on either side, from zero upward:
        # the further out, the longer. One number says both whether and how much, without a jump.
        log_two_sided = math.log(2.0) + log_normal_upper(jnp.abs(occurs))
        log_share = jnp.minimum(log_two_sided - per_lane(log_chance, occurs), 0.0)
        delay = -log_share if self.law == EXPONENTIAL else -jnp.expm1(log_share)
        scale = self.size * inverse_sigma if self.unit == METRES else jnp.full_like(inverse_sigma, self.size)
        return noise + delay * per_lane(scale, occurs)


@dataclass(frozen=True)
class NominalBias(OneNumber):
    """Gaussian noise about a bias that each satellite has without being faulty.

    Integrity concepts bound such biases, which come from antennas, signal deformation and models, by b_nom and let
    them add up as badly as they can (Blanch et al. 2015, IEEE Transactions on Aerospace and Electronic Systems
    51:713-732).

    Attributes:
        bias_m: its size, the same for all satellites; or one for each satellite of a single epoch, in order [m].
        sign: ``up``, on every satellite the sign with which least squares moves up (all together the worst that
            biases of these sizes can do to its vertical error); ``down``, all the other way; ``random``, each
            satellite's own in every draw (at most three sigma); ``given``, as ``bias_m`` has it, the same in every
            draw. The first three take sizes that are not negative.

    Example:
        >>> import pl_mc
        >>> pl_mc.nominal_bias(0.75).name
        'nominal_bias(bias_m=0.75,sign=up)'
    """

    base_name = "nominal_bias"

    bias_m: float | tuple[float, ...] = 0.5
    sign: str = "up"

    def __post_init__(self) -> None:
        require_choice(self.sign, SIGNS, field="nominal_bias: sign")
        if isinstance(self.bias_m, list | np.ndarray):
            sizes = require_numbers(self.bias_m, field="nominal_bias: bias_m")
            object.__setattr__(self, "bias_m", tuple(np.ravel(sizes).tolist()))
        sizes = self.bias_m if isinstance(self.bias_m, tuple) else (self.bias_m,)
        for size in sizes:
            if require_number(size, field="nominal_bias: bias_m") < 0 and self.sign != "given":
                raise InputError(
                    f"nominal_bias: bias_m: a size of at least 0 is needed, not {shown(size)}; with sign 'given' "
                    "either sign will do."
                )
        if not sizes:
            raise InputError("nominal_bias: bias_m: one number, or one for each satellite, is needed.")
        if isinstance(self.bias_m, tuple):
            object.__setattr__(self, "bias_m", tuple(float(size) for size in sizes))
        else:
            make_floats(self, "bias_m")

    @property
    def shifts_only(self) -> bool:
        return self.sign != "random"

    def require_geometry(self, g: Geometry) -> None:
        if isinstance(self.bias_m, tuple) and (g.is_series or len(self.bias_m) != len(g.names)):
            has = "a series of epochs" if g.is_series else f"{len(g.names)} satellites"
            raise InputError(
                f"nominal_bias: bias_m: one number, or one for each satellite of a single epoch, is needed; there "
                f"are {len(self.bias_m)} numbers, and the geometry has {has}."
            )
        ratio = float(np.max(np.where(g.in_view, np.asarray(self.bias_m) / g.sigma_m, 0.0)))
        if self.sign == "random" and ratio > _LARGEST_RANDOM:
            raise InputError(
                f"nominal_bias: bias_m: with sign 'random' at most {_LARGEST_RANDOM:g} sigma of every satellite is "
                f"needed, not {ratio:.3g}."
            )

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        size = jnp.asarray(self.bias_m, model.weight_root.dtype) * model.weight_root
        if self.sign == "random":
            return _either_sign(units[0], per_lane(size, units[0]))
        if self.sign != "given":
            upward = jnp.where(model.gain[UP] < 0, -1.0, 1.0).astype(size.dtype)
            size = size * upward if self.sign == "up" else -size * upward
        return units[0] + per_lane(size, units[0])


def _either_sign(unit: Array, size: Array) -> Array:
    """Quantile of N(size, 1) or N(-size, 1), either with probability 1/2, at the probability of ``unit``.

    A sign drawn apart would be a jump, and every pattern of signs an island for samplers of rare events; this rises
    with the one number smoothly. The root lies between ``unit`` and ``unit + size`` on the positive side, and is
    found by Newton's steps on the logarithm of the tail, which is close to straight; where a step leaves what is
    left of the interval, by halving it.
    """
    z = jnp.abs(unit)
    wanted = log_normal_upper(z)
    low, high = z, z + size
    x = jnp.minimum(z * jnp.sqrt(1.0 + size * size), high)
    for _ in range(_STEPS):
        tail = 0.5 * (ndtr(size - x) + ndtr(-size - x))
        sound = tail > 0
        safe = jnp.where(sound, tail, 1.0)
        # Far out the tail vanishes, and x is too large.
        excess = jnp.where(sound, jnp.log(safe), -jnp.inf) - wanted
        low, high = jnp.where(excess > 0, x, low), jnp.where(excess > 0, high, x)
        density = (jnp.exp(-0.5 * (x - size) ** 2) + jnp.exp(-0.5 * (x + size) ** 2)) * _HALF_PEAK
        steep = sound & (density > 0)
        further = x + jnp.where(steep, excess * safe / jnp.where(steep, density, 1.0), jnp.inf)
        inside = (further >= low) & (further <= high)
        x = jnp.where(inside, further, 0.5 * (low + high))
    return jnp.where(unit < 0, -x, x)
