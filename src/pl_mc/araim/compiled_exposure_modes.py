"""The fault modes of ARAIM v4.2 inside a compiled function, and those that an exclusion leaves.

The rule is that of `pl_mc.araim.exposure_modes`, ``listed``, with combinations of at most two events: three or more are
never monitored. Each combination has its place whether it is needed or not.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.araim.budget import Budget
from pl_mc.araim.compiled_modes import CompiledModes, Priors, members, solvable_modes, three_or_more
from pl_mc.araim.exposure_modes import ALWAYS_MONITORED, FEWEST
from pl_mc.kernels import LinearModel
from pl_mc.kernels.linear_model import product


def compiled_exposure_modes(model: LinearModel, priors: Priors, budget: Budget, *, excludes: bool) -> CompiledModes:
    """The fault modes of a geometry, each once, with priors at an instant and over the budget's exposure."""
    n, dtype = model.design.shape[0], model.design.dtype
    seen = model.in_view > 0
    events = priors.events(model, lone=True)
    over = priors.events(model, lone=True, exposure_h=budget.exposure_h)
    single = jnp.concatenate([jnp.eye(n, dtype=bool) & seen[:, None], events.groups])
    one, other = np.triu_indices(single.shape[0], 1)
    spoiled = jnp.concatenate([single, single[one] | single[other]])

    def priors_of(p: Array) -> Array:
        none, odds = jnp.exp(jnp.sum(jnp.log1p(-p))), p / (1.0 - p)
        return none * jnp.concatenate([odds, odds[one] * odds[other]])

    p_exposure = jnp.concatenate([over.satellites, over.constellations])
    instant = priors_of(jnp.concatenate([events.satellites, events.constellations]))
    exposure = priors_of(p_exposure)
    # A constellation's own fault stands for what is inside of it and far less probable.
    alone = n + np.arange(events.groups.shape[0])
    outside = product(spoiled.astype(dtype), (~events.groups).T.astype(dtype)).T
    inside = (outside == 0) & jnp.any(spoiled, axis=1)[None] & (exposure > 0)[None]
    leaves = inside & (instant[None] < budget.consolidation * instant[alone][:, None])
    leaves = leaves & (np.arange(spoiled.shape[0])[None] != alone[:, None])
    moved = leaves.astype(dtype)
    instant = instant.at[alone].add(product(moved, instant[:, None])[:, 0])
    exposure = exposure.at[alone].add(product(moved, exposure[:, None])[:, 0])
    stays = (exposure > 0) & ~jnp.any(leaves, axis=0)
    chosen = _monitored(spoiled, instant, exposure, stays, three_or_more(p_exposure), seen, budget, excludes)
    left = three_or_more(p_exposure) + jnp.sum(jnp.where(stays & ~chosen, exposure, 0.0))
    merged = merge(CompiledModes(spoiled, jnp.where(chosen, instant, 0.0), left, jnp.where(chosen, exposure, 0.0)))
    enough = jnp.sum(seen[None] & ~spoiled, axis=1) >= FEWEST
    lost = ~(enough & solvable_modes(spoiled, seen, members(model)))
    over_exposure = jnp.zeros_like(exposure) if merged.exposure is None else merged.exposure
    return CompiledModes(
        spoiled,
        jnp.where(lost, 0.0, merged.probability),
        left + jnp.sum(jnp.where(lost, over_exposure, 0.0)),
        jnp.where(lost, 0.0, over_exposure),
    )


def _monitored(
    spoiled: Array, instant: Array, exposure: Array, stays: Array, left_over: Array, seen: Array, budget: Budget,
    excludes: bool,
) -> Array:  # fmt: skip
    """(modes,), which combinations have a test."""
    dtype, count = exposure.dtype, jnp.sum(spoiled, axis=1, dtype=jnp.int32)
    always = stays & (exposure > ALWAYS_MONITORED)
    # A mode that leaves no satellite at all, by itself or after an exclusion, is passed over.
    rows = spoiled.astype(dtype)
    both = count[:, None].astype(dtype) + count[None].astype(dtype) - product(rows, rows.T)
    in_view = jnp.sum(seen, dtype=jnp.int32)
    passed_over = count >= in_view
    if excludes:
        options = stays & (instant > budget.p_exclusion)
        passed_over = passed_over | jnp.any((both >= in_view.astype(dtype)) & options[None], axis=1)
    joins = stays & ~always & ~passed_over
    # By the number of satellites, and then as they stand.
    order = jnp.argsort(count, stable=True)
    each = jnp.where(joins, exposure, 0.0)[order]
    before = left_over + jnp.sum(jnp.where(stays & ~always, exposure, 0.0)) - (jnp.cumsum(each) - each)
    taken = joins[order] & (before > budget.p_threshold)
    return always | jnp.zeros_like(always).at[order].set(taken)


def without(modes: CompiledModes, rows: Array) -> CompiledModes:
    """The modes where the satellites of some rows (n,) have been excluded: they leave every mode."""
    spoiled = modes.excluded & ~rows
    none = ~jnp.any(spoiled, axis=1)
    exposure = None if modes.exposure is None else jnp.where(none, 0.0, modes.exposure)
    return merge(
        replace(modes, excluded=spoiled, probability=jnp.where(none, 0.0, modes.probability), exposure=exposure)
    )


def merge(modes: CompiledModes) -> CompiledModes:
    """Modes that spoil the same are one, the first of them, with the sum of the priors; the others have none."""
    rows = modes.excluded.astype(modes.probability.dtype)
    count, overlap = jnp.sum(rows, axis=1), product(rows, rows.T)
    live = modes.probability > 0
    same = (overlap == count[:, None]) & (overlap == count[None]) & live[None] & live[:, None]
    first = live & (jnp.argmax(same, axis=1) == np.arange(rows.shape[0]))
    shares = same.astype(rows.dtype)

    def summed(prior: Array) -> Array:
        return jnp.where(first, product(shares, prior[:, None])[:, 0], 0.0)

    exposure = None if modes.exposure is None else summed(modes.exposure)
    return replace(modes, probability=summed(modes.probability), exposure=exposure)
