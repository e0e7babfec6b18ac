"""Occasional multipath: Gaussian noise, and now and then a delay, which has one sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from pl_mc.geometry.record import UP
from pl_mc.input_errors import InputError, require_choice, require_number, require_positive
from pl_mc.kernels import LinearModel
from pl_mc.kernels.linear_model import per_lane
from pl_mc.noise_models.base import OneNumber, make_floats
from pl_mc.noise_models.quantile_map import log_normal_upper

EXPONENTIAL, UNIFORM = "exponential", "uniform"
METRES, SIGMAS = "m", "sigma"


@dataclass(frozen=True)
class Multipath(OneNumber):
    """A delay that a satellite has with some probability, independent between satellites and of the noise.

    Attributes:
        chance: probability of a delay, above 0 and at most 1; of a satellite at the horizon, where ``decay_deg`` is
            given.
        size: mean of an exponential delay, largest one of a uniform delay, which begins at 0.
        unit: of ``size``: ``m``, or ``sigma`` for that of each satellite.
        law: ``exponential`` or ``uniform``.
        decay_deg: elevation over which the probability falls to 1/e, chance exp(-elevation / decay) [deg]; the same
            for all satellites unless given.
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
