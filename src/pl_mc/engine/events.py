"""Events: what is counted in a scenario, from a method's outcome and the vertical alert limit.

``misleading`` is the literature's misleading information (MI), ``missed`` its hazardously misleading one (HMI).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from pl_mc.geometry.record import UP
from pl_mc.methods.base import Outcome

# A larger last step of a position component, and the iteration has not settled [m].
SETTLED_M = 0.01


@dataclass(frozen=True)
class Event:
    """An event's name, the column of its count, and what it means."""

    name: str
    count: str
    meaning: str


EVENTS = (
    Event("alarm", "alarms", "VPL > VAL, or the method's own test rejects, or unavailable"),
    Event("hazard", "hazards", "|vertical error| > VAL"),
    Event("missed", "missed", "hazard and no alarm"),
    Event("exceeded", "exceeded", "|vertical error| > VPL, alarm or not"),
    Event("misleading", "misleading", "exceeded and no alarm"),
    Event("false_alarm", "false_alarms", "available, alarm, and no hazard"),
    Event("unavailable", "unavailable", "no determined solution; counts as an alarm and as nothing else"),
    Event("unconverged", "unconverged", "available, and the last iteration moved the position by more than 1 cm"),
    Event("tied", "tied", "available, and satellites that no residual tells apart share a weight below one"),
)


def alarms(outcome: Outcome, vertical_m: Array | float) -> Array:
    """(...), whether each scenario alarms."""
    return ~outcome.available | outcome.rejects | (outcome.vpl_m > vertical_m)


def unconverged(outcome: Outcome) -> Array:
    """(...), whether the last iteration still moved the position by more than `SETTLED_M`."""
    return outcome.available & (False if outcome.change_m is None else outcome.change_m > SETTLED_M)


def tied(outcome: Outcome) -> Array:
    """(...), whether satellites that no residual tells apart share a weight below one."""
    return outcome.available & (False if outcome.tied is None else outcome.tied)


def events(outcome: Outcome, vertical_m: Array | float) -> Array:
    """(events, ...), which of `EVENTS` each scenario is."""
    error = jnp.abs(outcome.error_m[UP])
    alarm = alarms(outcome, vertical_m)
    hazard = outcome.available & (error > vertical_m)
    exceeded = outcome.available & (error > outcome.vpl_m)
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
