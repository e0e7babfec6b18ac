"""The choice of fault modes inside a compiled function: one prior for all satellites, one for all constellations.

The rule is that of `pl_mc.araim.modes`, with combinations of at most two events: what would need three stays not
monitored. Which combinations there can be is known when the function is compiled; which of them a geometry needs
is a mask. The letters of the systems are not known here: satellites that share a clock column are a constellation.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.araim.modes import CONTAINED
from pl_mc.kernels import LinearModel
from pl_mc.kernels.linear_model import COORDINATES, product

# Priors of groups of combinations that differ by less than this share of themselves count as one.
_TIE = 1e-9

# What bounds on priors may lose by rounding and by priors of no fault that are not quite one.
_MARGIN = 1.01


@dataclass(frozen=True)
class Priors:
    """Priors and what is done with them; frozen, so that it can be a static argument.

    Attributes:
        p_sat, p_const: prior of a fault of each satellite (positive) and of each constellation (or zero).
        p_threshold: P_THRES, what may stay without a test.
        unmonitored: ``plain`` or ``contained``.
    """

    p_sat: float
    p_const: float
    p_threshold: float
    unmonitored: str

    @property
    def odds(self) -> dict[str, float]:
        """Odds of the two kinds of events."""
        both = {"sat": self.p_sat, "const": self.p_const}
        return {kind: p / (1.0 - p) for kind, p in both.items() if p > 0}

    def prior_of_none(self, satellites: Array | float, constellations: Array | float) -> Array:
        """Prior of no fault among so many."""
        return jnp.exp(satellites * math.log1p(-self.p_sat) + constellations * math.log1p(-self.p_const))

    def kinds(self, order: int) -> list[tuple[str, ...]]:
        """Kinds of combinations of that many events, in the order in which the modes of a geometry stand."""
        single: list[tuple[str, ...]] = [(kind,) for kind in self.odds]
        return single if order == 1 else [a + b for k, a in enumerate(single) for b in single[k:]]

    def stages(self, order: int) -> list[list[tuple[str, ...]]]:
        """Those kinds by decreasing prior, kinds of one prior together."""
        size = {kind: math.prod(self.odds[event] for event in kind) for kind in self.kinds(order)}
        stages: list[list[tuple[str, ...]]] = []
        for kind in sorted(size, key=lambda kind: -size[kind]):
            if stages and size[kind] > size[stages[-1][0]] * (1.0 - _TIE):
                stages[-1].append(kind)
            else:
                stages.append([kind])
        return stages

    def pairs_possible(self, satellites: int, clocks: int) -> bool:
        """Whether a pair can come to be monitored with at most so many satellites and clocks.

        A bound over all ways in which they may be spread: pairs inside a constellation are fewest where all have
        the same number.
        """
        odds, limit = self.odds, self.p_threshold
        if max(odds.values()) ** 2 > limit:
            return True
        # More probable single faults are monitored, or so much is lost that no pair helps; others may be lost.
        bound = float(more_faults(2, satellites, clocks, self.p_sat, self.p_const)[-1, -1])
        bound += sum(count * p for count, p in ((satellites, self.p_sat), (clocks, self.p_const)) if p <= limit)
        if self.unmonitored == CONTAINED and self.p_const > limit:
            each = satellites / clocks
            inside = clocks * max(each * (each - 1.0) / 2.0, 0.0) * odds["sat"] ** 2
            inside += satellites * odds["sat"] * odds["const"]
            bound -= inside * float(np.exp(satellites * np.log1p(-self.p_sat) + clocks * np.log1p(-self.p_const)))
        return bound * _MARGIN > limit


@functools.cache
def more_faults(least: int, satellites: int, clocks: int, p_sat: float, p_const: float) -> NDArray[np.float64]:
    """(satellites + 1, clocks + 1), prior of ``least`` faults or more, by numbers of what can fail."""
    table = np.zeros((satellites + 1, clocks + 1))
    for n in range(satellites + 1):
        for c in range(clocks + 1):
            # By numbers of faults; sums of positive terms, so that small priors keep their digits.
            faults = np.array([1.0])
            for p in [p_sat] * n + [p_const] * c:
                faults = np.convolve(faults, [1.0 - p, p])
            table[n, c] = faults[least:].sum()
    return table


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CompiledModes:
    """Fault modes of one geometry; each has its place whether it is needed or not, single faults first.

    Attributes:
        excluded: (modes, n), satellites that each spoils.
        probability: (modes,), prior of each monitored one with its share of what it holds; zero for those that are
            not monitored.
        p_not_monitored: (), prior of what is in none.
    """

    excluded: Array
    probability: Array
    p_not_monitored: Array


def compiled_modes(model: LinearModel, priors: Priors) -> CompiledModes:
    """The fault modes of a geometry; pairs have places where the shape of the geometry admits a need for them."""
    n, clocks = model.design.shape[0], model.design.shape[1] - COORDINATES
    dtype = model.design.dtype
    seen = model.in_view > 0
    member = (model.design[:, COORDINATES:] != 0) & seen[:, None]
    # The only satellite of a clock decides that clock and nothing else.
    lone = jnp.any(member & (jnp.sum(member, axis=0, keepdims=True) == 1), axis=1)
    counts = seen & ~lone
    groups = member.T & counts[None]
    events = {"sat": jnp.eye(n, dtype=bool) & counts[:, None], "const": groups}
    satellites = jnp.sum(counts, dtype=jnp.int32)
    constellations = jnp.sum(jnp.any(groups, axis=1), dtype=jnp.int32)
    none = priors.prior_of_none(satellites.astype(dtype), constellations.astype(dtype))

    kinds = priors.kinds(1) + priors.kinds(2)
    sets, weights = zip(*(_combinations(events, priors.odds, kind, none) for kind in kinds), strict=True)
    excluded, prior = jnp.concatenate(sets), jnp.concatenate(weights)
    kind_of = np.concatenate([np.full(len(part), k) for k, part in enumerate(sets)])
    orders = (1, 2) if priors.pairs_possible(n, clocks) else (1,)
    candidates = int((kind_of < sum(len(priors.kinds(order)) for order in orders)).sum())
    # A combination is held by a mode if none of its satellites is outside of the mode.
    outside = product(excluded.astype(dtype), (~excluded[:candidates]).T.astype(dtype))
    holds = (outside == 0) & (prior > 0)[:, None]
    left_over = jnp.asarray(more_faults(3, n, clocks, priors.p_sat, priors.p_const), dtype)[satellites, constellations]
    solvable = _solvable(excluded[:candidates], seen, member)
    limit = priors.p_threshold
    contained = priors.unmonitored == CONTAINED

    def covered(chosen: Array) -> tuple[Array, Array]:
        """Which combinations are chosen, and which are not but held by those that are."""
        own = jnp.concatenate([chosen, jnp.zeros(len(prior) - candidates, bool)])
        held = jnp.any(holds & chosen[None], axis=1) & ~own
        return own, held if contained else jnp.zeros_like(held)

    def left(chosen: Array) -> Array:
        own, held = covered(chosen)
        return left_over + jnp.sum(jnp.where(own | held, 0.0, prior))

    chosen = jnp.zeros(candidates, bool)
    lost = jnp.zeros((), dtype)
    for order in orders:
        for stage in priors.stages(order):
            among = np.isin(kind_of[:candidates], [kinds.index(kind) for kind in stage])
            there = jnp.asarray(among) & (prior[:candidates] > 0)
            most = none * math.prod(priors.odds[event] for event in stage[0])
            wanted = there & ((most > limit) | ((lost <= limit) & (left(chosen) > limit)))
            lost = lost + jnp.sum(jnp.where(wanted & ~solvable, prior[:candidates], 0.0))
            wanted = wanted & solvable & ~(covered(chosen)[1][:candidates] & (most <= limit))
            chosen = chosen | wanted

    _, held = covered(chosen)
    holders = (holds & chosen[None] & held[:, None]).astype(dtype)
    shares = prior / jnp.maximum(jnp.sum(holders, axis=1), 1.0)
    probability = jnp.where(chosen, prior[:candidates] + product(shares, holders), 0.0)
    return CompiledModes(excluded[:candidates], probability, left(chosen))


def _combinations(
    events: dict[str, Array], odds: dict[str, float], kind: tuple[str, ...], none: Array
) -> tuple[Array, Array]:
    """Satellites and priors of all combinations of a kind; prior zero where an event does not exist."""
    if len(kind) == 1:
        sets, exist = events[kind[0]], jnp.any(events[kind[0]], axis=1)
    else:
        first, second = (events[event] for event in kind)
        pick = np.triu_indices(len(first), 1) if kind[0] == kind[1] else np.indices((len(first), len(second)))
        one, other = (first[pick[0].ravel()], second[pick[1].ravel()])
        sets, exist = one | other, jnp.any(one, axis=1) & jnp.any(other, axis=1)
    prior = none * math.prod(odds[event] for event in kind)
    return sets & exist[:, None], jnp.where(exist, prior, jnp.zeros_like(prior))


def _solvable(excluded: Array, seen: Array, member: Array) -> Array:
    """(modes,), whether at least as many satellites as unknowns are left."""
    kept = seen[None] & ~excluded
    clocks = product(kept.astype(jnp.float32), member.astype(jnp.float32)) > 0
    return jnp.sum(kept, axis=1) >= COORDINATES + jnp.sum(clocks, axis=1)
