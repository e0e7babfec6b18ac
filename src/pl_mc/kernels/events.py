"""Events: what is counted in a scenario, from a method's outcome and the alert limits.

Each axis judges an error by a level and a limit: the vertical one |up error| by VPL and VAL; the horizontal one, of
length sqrt(east^2 + north^2), by HPL and HAL; ``either`` takes alarm, hazard and exceeded of both together.

``misleading`` is the literature's misleading information (MI), ``missed`` its hazardously misleading one (HMI).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import DTypeLike, NDArray

from pl_mc.alert import HORIZONTAL, VERTICAL, AlertLimits, judged_by
from pl_mc.constants import EAST, NORTH, UP
from pl_mc.input_errors import InputError
from pl_mc.kernels.outcome import Outcome

# A larger last step of a position component, and the iteration has not settled [m].
SETTLED_M = 0.01


@dataclass(frozen=True)
class Event:
    """An event's name, the column of its count, and what it means."""

    name: str
    count: str
    meaning: str


EVENTS = (
    Event("alarm", "alarms", "level > limit, or the method's own test rejects, or unavailable"),
    Event("hazard", "hazards", "error > limit"),
    Event("missed", "missed", "hazard and no alarm"),
    Event("exceeded", "exceeded", "error > level, alarm or not"),
    Event("misleading", "misleading", "exceeded and no alarm"),
    Event("false_alarm", "false_alarms", "available, alarm, and no hazard"),
    Event("unavailable", "unavailable", "no determined solution; counts as an alarm and as nothing else"),
    Event("unconverged", "unconverged", "available, and the last iteration moved the position by more than 1 cm"),
    Event("tied", "tied", "available, and satellites that no residual tells apart share a weight below one"),
)

# Counted where a method says which satellite it excludes; with `unavailable` each draw is one of them.
EXCLUSIONS = (
    Event("right_exclusion", "right_exclusions", "a satellite is excluded that has a fault, alarm or not"),
    Event("wrong_exclusion", "wrong_exclusions", "a satellite is excluded that has no fault, alarm or not"),
    Event("failed_exclusion", "failed_exclusions", "a fault is detected and no exclusion passes: an alarm"),
    Event("no_exclusion", "no_exclusions", "nothing is detected, so that nothing is excluded"),
)


def counted_events(methods: Iterable[object]) -> tuple[Event, ...]:
    """What is counted of some methods: `EVENTS`, and `EXCLUSIONS` if one of them ``names_exclusions``."""
    return EVENTS + (EXCLUSIONS if any(getattr(method, "names_exclusions", False) for method in methods) else ())


def limits_of(alert: AlertLimits, dtype: DTypeLike) -> NDArray[np.floating]:
    """(2,), VAL and HAL; the largest number, which no level reaches, where one is missing."""
    largest = float(np.finfo(dtype).max)
    return np.array([min(alert.val_m, largest), min(alert.hal_m, largest)], dtype)


def _judged(axis: str) -> tuple[int, ...]:
    """Places of the vertical (0) and the horizontal (1) among errors, levels and limits."""
    return tuple((VERTICAL, HORIZONTAL).index(limit) for limit in judged_by(axis))


def levels_of(outcome: Outcome, axis: str, of: str = "one of the methods") -> list[Array]:
    """The protection levels that an axis judges [m], the vertical one first; ``of`` names the method in an error.

    Raises:
        InputError: a method without one of them.
    """
    levels = [(outcome.vpl_m, outcome.hpl_m)[k] for k in _judged(axis)]
    missing = [name for name, level in zip(judged_by(axis), levels, strict=True) if level is None]
    if missing:
        raise InputError(f"axes: {of} has no {missing[0]} level, so that {axis} cannot decide.")
    return levels


def sizes_and_levels(outcome: Outcome, axis: str, of: str = "one of the methods") -> list[tuple[Array, Array]]:
    """The size of each error that an axis judges, and its protection level [m], the vertical one first."""
    east, north, up = (outcome.error_m[k] for k in (EAST, NORTH, UP))
    sizes = (lambda: jnp.abs(up), lambda: jnp.hypot(east, north))
    return [(sizes[k](), level) for k, level in zip(_judged(axis), levels_of(outcome, axis, of), strict=True)]


def alarms(outcome: Outcome, limits_m: Array | NDArray, axis: str = VERTICAL, of: str = "one of the methods") -> Array:
    """(...), whether each scenario alarms; ``limits_m`` (2,) are VAL and HAL."""
    alarm = ~outcome.available | outcome.rejects
    for k, level in zip(_judged(axis), levels_of(outcome, axis, of), strict=True):
        alarm = alarm | (level > limits_m[k])
    return alarm


def unconverged(outcome: Outcome) -> Array:
    """(...), whether the last iteration still moved the position by more than `SETTLED_M`."""
    return outcome.available & (False if outcome.change_m is None else outcome.change_m > SETTLED_M)


def tied(outcome: Outcome) -> Array:
    """(...), whether satellites that no residual tells apart share a weight below one."""
    return outcome.available & (False if outcome.tied is None else outcome.tied)


def events(outcome: Outcome, limits_m: Array, axis: str = VERTICAL, of: str = "one of the methods") -> Array:
    """(events, ...), which of `EVENTS` each scenario is; ``limits_m`` (2,) are VAL and HAL."""
    alarm, judged = alarms(outcome, limits_m, axis, of), sizes_and_levels(outcome, axis, of)
    limits = [limits_m[k] for k in _judged(axis)]
    beyond_limit = [size > limit for (size, _), limit in zip(judged, limits, strict=True)]
    hazard = outcome.available & functools.reduce(jnp.logical_or, beyond_limit)
    exceeded = outcome.available & functools.reduce(jnp.logical_or, [size > level for size, level in judged])
    return jnp.stack(
        [
            alarm,
            hazard,
            hazard & ~alarm,
            exceeded,
            exceeded & ~alarm,
            outcome.available & alarm & ~hazard,
            ~outcome.available,
            unconverged(outcome),
            tied(outcome),
        ]
    )


def exclusions(outcome: Outcome, faulted: Array) -> Array:
    """(exclusions, ...), which of `EXCLUSIONS` each scenario is, none of a method that does not say what it excludes.

    ``faulted``: (n,), the rows that have a fault.
    """
    if outcome.excluded is None:
        return jnp.zeros((len(EXCLUSIONS), *outcome.available.shape), bool)
    out = outcome.available & (outcome.excluded >= 0)
    right = out & faulted[jnp.maximum(outcome.excluded, 0)]
    left = outcome.available & (outcome.excluded < 0)
    return jnp.stack([right, out & ~right, left & outcome.rejects, left & ~outcome.rejects])
