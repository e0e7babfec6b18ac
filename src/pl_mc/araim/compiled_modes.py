"""The choice of fault modes inside a compiled function.

The rule is that of `pl_mc.araim.modes`, with combinations of at most two events: what would need three stays not
monitored. Which combinations there can be is known when the function is compiled; which of them a geometry needs
is a mask. Priors are one for all satellites and one for all constellations, and satellites that share a clock column
are a constellation; or they are those of an ISM, which the code of each row finds, and its letters are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.araim.modes import CONTAINED
from pl_mc.input_errors import InputError
from pl_mc.ism import CODES, Ism
from pl_mc.ism.codes import EACH, LETTERS
from pl_mc.kernels import LinearModel
from pl_mc.kernels.linear_model import COORDINATES, product

# Priors of groups of combinations that differ by less than this share of themselves count as one; in single precision
# as little as rounding leaves.
_TIE = 1e-9

# What bounds on priors may lose by rounding and by priors of no fault that are not quite one.
_MARGIN = 1.01


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Events:
    """What can fail in one geometry, and with which prior; zero where there is nothing.

    Attributes:
        satellites: (n,), prior of a fault of each row that can move the position.
        groups: (c, n), which of these rows belong to each constellation.
        constellations: (c,), prior of a fault of each.
    """

    satellites: Array
    groups: Array
    constellations: Array


@dataclass(frozen=True)
class Priors:
    """Priors and what is done with them; frozen, so that it can be a static argument.

    Attributes:
        p_sat, p_const: prior of a fault of each satellite and of each constellation, where the ISM has none.
        p_threshold: P_THRES, what may stay without a test.
        unmonitored: ``plain`` or ``contained``.
        ism: what says more of them.
    """

    p_sat: float
    p_const: float
    p_threshold: float
    unmonitored: str
    ism: Ism | None = None

    def events(self, model: LinearModel, *, lone: bool = False, exposure_h: float = 0.0) -> Events:
        """What can fail among the rows of a model, within an exposure; those alone in their clock too if ``lone``."""
        seen = model.in_view > 0
        member = members(model)
        # The only satellite of a clock decides that clock and nothing else.
        alone = jnp.any(member & (jnp.sum(member, axis=0, keepdims=True) == 1), axis=1)
        counts = seen if lone else seen & ~alone
        dtype = model.design.dtype
        if self.ism is None:
            satellites, groups = jnp.asarray(self.p_sat, dtype), member.T & counts[None]
            constellations = jnp.full(groups.shape[0], self.p_const, dtype)
        else:
            codes = codes_of_rows(model)
            satellites = jnp.asarray(self.within("p_sat", exposure_h), dtype)[codes]
            groups = (codes // EACH == jnp.arange(len(LETTERS), dtype=codes.dtype)[:, None]) & counts[None]
            constellations = jnp.asarray(self.within("p_const", exposure_h)[::EACH], dtype)
        there = jnp.any(groups, axis=1)
        return Events(jnp.where(counts, satellites, 0.0), groups, jnp.where(there, constellations, 0.0))

    def of(self, field: str) -> np.ndarray:
        """(CODES,), a prior by the codes of satellites."""
        own = getattr(self, field)
        return self.ism.table(field) if self.ism is not None and self.ism.has(field) else np.full(CODES, own)

    def within(self, field: str, exposure_h: float) -> np.ndarray:
        """The same, of a fault that is there at some time of an exposure."""
        if exposure_h == 0.0 or self.ism is None:
            return self.of(field)
        rate = {"p_sat": "r_sat_per_h", "p_const": "r_const_per_h"}[field]
        return self.of(field) + exposure_h * self.ism.table(rate)

    def constellations(self, clocks: int) -> int:
        """Number of constellations that have a place."""
        return clocks if self.ism is None else len(LETTERS)

    def pairs_possible(self, satellites: int, clocks: int) -> bool:
        """Whether a pair can come to be monitored with at most so many satellites and clocks.

        A bound over all ways in which they may be spread: pairs inside a constellation are fewest where all have
        the same number.
        """
        limit, p_const = self.p_threshold, self.of("p_const")[::EACH].tolist()
        p_sat = np.unique(self.of("p_sat")).tolist()
        p_const = p_const[:clocks] if self.ism is None else p_const
        every = [p_sat[-1]] * satellites + p_const
        if max(_odds(p) for p in every) ** 2 > limit:
            return True
        # More probable single faults are monitored, or so much is lost that no pair helps; others may be lost.
        few = [p for p in p_sat if p <= limit]
        bound = faults_at_least(2, every) + satellites * max(few, default=0.0) + sum(p for p in p_const if p <= limit)
        if self.ism is None and self.unmonitored == CONTAINED and self.p_const > limit:
            each, odds = satellites / clocks, _odds(self.p_sat)
            inside = clocks * max(each * (each - 1.0) / 2.0, 0.0) * odds**2 + satellites * odds * _odds(self.p_const)
            bound -= inside * math.exp(sum(math.log1p(-p) for p in every))
        return bound * _MARGIN > limit


def codes_of_rows(model: LinearModel) -> Array:
    """(n,), the code of each row's satellite; an `InputError` for a model that names none."""
    if model.satellite is None:
        raise InputError("araim: ism: this model names no satellites; linear_model takes their codes as satellite.")
    return model.satellite


def faults_at_least(least: int, priors: list[float]) -> float:
    """Prior of so many faults or more of independent events."""
    # By numbers of faults; sums of positive terms, so that small priors keep their digits.
    faults = np.array([1.0])
    for p in priors:
        faults = np.convolve(faults, [1.0 - p, p])
    return float(faults[least:].sum())


def _odds(p: float) -> float:
    return p / (1.0 - p)


def members(model: LinearModel) -> Array:
    """(n, clocks), which rows in view observe each clock."""
    return (model.design[:, COORDINATES:] != 0) & (model.in_view > 0)[:, None]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CompiledModes:
    """Fault modes of one geometry; each has its place whether it is needed or not, single faults first.

    Attributes:
        excluded: (modes, n), satellites that each spoils.
        probability: (modes,), prior of each monitored one with its share of what it holds; zero for those that are
            not monitored.
        p_not_monitored: (), prior of what is in none.
        exposure: (modes,), prior of each over the exposure; None in v3.0.
    """

    excluded: Array
    probability: Array
    p_not_monitored: Array
    exposure: Array | None = None


def compiled_modes(model: LinearModel, priors: Priors) -> CompiledModes:
    """The fault modes of a geometry; pairs have places where the shape of the geometry admits a need for them."""
    n, clocks = model.design.shape[0], model.design.shape[1] - COORDINATES
    dtype = model.design.dtype
    events = priors.events(model)
    p = jnp.concatenate([events.satellites, events.constellations])
    single = jnp.concatenate([jnp.eye(n, dtype=bool) & (events.satellites > 0)[:, None], events.groups])
    none, odds = jnp.exp(jnp.sum(jnp.log1p(-p))), p / (1.0 - p)
    one, other = np.triu_indices(len(p), 1)
    excluded = jnp.concatenate([single, single[one] | single[other]])
    prior = jnp.concatenate([none * odds, none * odds[one] * odds[other]])
    orders = 2 if priors.pairs_possible(n, clocks) else 1
    candidates = len(p) if orders == 1 else len(prior)
    # A combination is held by a mode if none of its satellites is outside of the mode.
    outside = product(excluded.astype(dtype), (~excluded[:candidates]).T.astype(dtype))
    holds = (outside == 0) & (prior > 0)[:, None]
    left_over = three_or_more(p)
    solvable = solvable_modes(excluded[:candidates], model.in_view > 0, members(model))
    limit, contained = priors.p_threshold, priors.unmonitored == CONTAINED
    group = _groups(prior[:candidates], np.arange(candidates) >= len(p))

    def covered(chosen: Array) -> tuple[Array, Array]:
        """Which combinations are chosen, and which are not but held by those that are."""
        own = jnp.concatenate([chosen, jnp.zeros(len(prior) - candidates, bool)])
        held = jnp.any(holds & chosen[None], axis=1) & ~own
        return own, held if contained else jnp.zeros_like(held)

    def left(chosen: Array) -> Array:
        own, held = covered(chosen)
        return left_over + jnp.sum(jnp.where(own | held, 0.0, prior))

    def take(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        k, chosen, lost = state
        among = group == k
        most = jnp.max(jnp.where(among, prior[:candidates], 0.0))
        wanted = among & ((most > limit) | ((lost <= limit) & (left(chosen) > limit)))
        lost = lost + jnp.sum(jnp.where(wanted & ~solvable, prior[:candidates], 0.0))
        wanted = wanted & solvable & ~(covered(chosen)[1][:candidates] & (most <= limit))
        return k + 1, chosen | wanted, lost

    start = (jnp.zeros((), jnp.int32), jnp.zeros(candidates, bool), jnp.zeros((), dtype))
    _, chosen, _ = jax.lax.while_loop(lambda state: state[0] <= jnp.max(group), take, start)

    _, held = covered(chosen)
    holders = (holds & chosen[None] & held[:, None]).astype(dtype)
    shares = prior / jnp.maximum(jnp.sum(holders, axis=1), 1.0)
    probability = jnp.where(chosen, prior[:candidates] + product(shares, holders), 0.0)
    return CompiledModes(excluded[:candidates], probability, left(chosen))


def _groups(prior: Array, pair: np.ndarray) -> Array:
    """Number of the group of equal priors, from 0, that each combination is taken with; -1 where there is none.

    Single events come before pairs, more probable ones before others.
    """
    order = jnp.lexsort((-prior, jnp.asarray(pair)))
    sorted_prior, sorted_pair = prior[order], jnp.asarray(pair)[order]
    tie = max(_TIE, 8.0 * float(jnp.finfo(prior.dtype).eps))
    drops = (sorted_prior[1:] < sorted_prior[:-1] * (1.0 - tie)) | (sorted_pair[1:] != sorted_pair[:-1])
    number = jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(drops, dtype=jnp.int32)])
    return jnp.where(prior > 0, jnp.zeros(prior.shape, jnp.int32).at[order].set(number), -1)


def three_or_more(p: Array) -> Array:
    """Prior of three faults or more of independent events (events,); all terms are positive."""

    def add(faults: Array, one: Array) -> tuple[Array, None]:
        moved = faults * one
        return faults.at[:3].multiply(1.0 - one).at[1:].add(moved[:-1]), None

    return jax.lax.scan(add, jnp.asarray([1.0, 0.0, 0.0, 0.0], p.dtype), p)[0][3]


def solvable_modes(excluded: Array, seen: Array, member: Array) -> Array:
    """(modes,), whether at least as many satellites as unknowns are left."""
    kept = seen[None] & ~excluded
    clocks = product(kept.astype(jnp.float32), member.astype(jnp.float32)) > 0
    return jnp.sum(kept, axis=1) >= COORDINATES + jnp.sum(clocks, axis=1)
