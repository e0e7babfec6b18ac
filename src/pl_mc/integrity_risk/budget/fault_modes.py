"""Fault modes: which satellites and constellations have failed, with what prior probability.

Faults come from independent sources: every satellite with a prior probability, every constellation with another. A
mode is the set of sources that have failed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.input_errors import InputError, require_choice

INDEPENDENT, COMMON = "independent", "common"
FAULT_FREE, SATELLITE, PAIR, CONSTELLATION = "fault_free", "satellite", "pair", "constellation"
MIXED, CONSTELLATIONS = "constellation_and_satellite", "constellations"


@dataclass(frozen=True)
class Mode:
    """One fault mode.

    Attributes:
        kind: ``fault_free``, ``satellite``, ``pair``, ...
        label: names of what has failed, ``G03`` or ``GPS,E08``.
        prior: probability of this mode and no other.
        directions: (n, k), columns that span its faults [m].
        analysed: whether its faults are looked at; else it counts with its prior.
    """

    kind: str
    label: str
    prior: float
    directions: FloatArray
    analysed: bool = True


def fault_modes(
    g: Geometry,
    satellite_priors: Sequence[float],
    constellation_priors: Mapping[str, float],
    *,
    constellation: str = INDEPENDENT,
) -> list[Mode]:
    """Fault-free, every source alone and every pair of sources, with the probabilities of exactly these.

    Args:
        g: one epoch.
        satellite_priors: n probabilities.
        constellation_priors: by RINEX letter of the systems in view.
        constellation: ``independent`` or ``common``.
    """
    n = len(g.names)
    sources: list[tuple[str, str, float, FloatArray]] = [
        (SATELLITE, name, prior, np.eye(n)[:, [k]])
        for k, (name, prior) in enumerate(zip(g.names, satellite_priors, strict=True))
    ]
    for letter, prior in constellation_priors.items():
        members = np.array(g.systems) == letter
        columns = np.eye(n)[:, members] if constellation == INDEPENDENT else members[:, None].astype(float)
        sources.append((CONSTELLATION, SYSTEM_NAMES[letter], prior, columns))
    none = math.exp(sum(math.log1p(-prior) for _, _, prior, _ in sources))
    modes = [Mode(FAULT_FREE, "", none, np.zeros((n, 0)))]
    for kind, label, prior, columns in sources:
        modes.append(Mode(kind, label, none * _odds(prior), columns))
    kinds = {(SATELLITE, SATELLITE): PAIR, (SATELLITE, CONSTELLATION): MIXED}
    for one, other in combinations(sources, 2):
        kind = kinds.get((one[0], other[0]), CONSTELLATIONS)
        first, second = (other, one) if kind == MIXED else (one, other)
        columns = np.unique(np.hstack([first[3], second[3]]), axis=1)
        prior = none * _odds(one[2]) * _odds(other[2])
        modes.append(Mode(kind, f"{first[1]},{second[1]}", prior, columns))
    order = (FAULT_FREE, SATELLITE, PAIR, CONSTELLATION, MIXED, CONSTELLATIONS)
    return sorted((mode for mode in modes if mode.prior > 0), key=lambda mode: order.index(mode.kind))


def not_monitored(modes: Sequence[Mode], priors: Sequence[float]) -> float:
    """Probability of all modes that are not analysed, those of three and more sources among them.

    Summed over numbers of failed sources, all terms positive: one minus the sum of the analysed modes would lose
    its digits.
    """
    odds = [_odds(prior) for prior in priors]
    none = math.exp(sum(math.log1p(-prior) for prior in priors))
    # Elementary symmetric polynomials: entry k is the sum over all sets of k sources.
    sums = np.zeros(len(odds) + 1)
    sums[0] = 1.0
    for value in odds:
        sums[1:] = sums[1:] + value * sums[:-1]
    return none * float(sums[3:].sum()) + sum(mode.prior for mode in modes if not mode.analysed)


def source_priors(
    g: Geometry, p_sat: float | Mapping[str, float], p_const: float | Mapping[str, float]
) -> tuple[list[float], dict[str, float]]:
    """Of every satellite, and of every constellation in view."""

    def checked(value: Any, field: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 <= value < 1.0:
            raise InputError(f"{field}: a prior probability lies between 0 and 1 (1 excluded), not {value!r}.")
        return float(value)

    def chosen(given: Mapping[str, float], keys: Sequence[str], field: str) -> float:
        for key in keys:
            if key in given:
                return checked(given[key], f"{field} of {key}")
        raise InputError(f"{field}: {keys[0]} is missing; a probability for each is needed, by name or by system.")

    letters = list(dict.fromkeys(g.systems))
    if isinstance(p_sat, Mapping):
        for key in p_sat:
            require_choice(key, [*g.names, *SYSTEM_NAMES], field="p_sat")
        satellites = [chosen(p_sat, pair, "p_sat") for pair in zip(g.names, g.systems, strict=True)]
    else:
        satellites = [checked(p_sat, "p_sat")] * len(g.names)
    if isinstance(p_const, Mapping):
        for key in p_const:
            require_choice(key, SYSTEM_NAMES, field="p_const")
        return satellites, {letter: chosen(p_const, [letter], "p_const") for letter in letters}
    return satellites, dict.fromkeys(letters, checked(p_const, "p_const"))


def _odds(prior: float) -> float:
    return prior / (1.0 - prior)
