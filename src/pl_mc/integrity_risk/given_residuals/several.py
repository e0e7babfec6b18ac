"""Faults of several satellites at once, along the direction in which residuals show them least.

Of all biases on a set of satellites that give the residuals one noncentrality, the one that moves the error most is the
first singular vector of the gain, seen through the residuals' own metric (as the slope of classical RAIM is for one
satellite). It is the worst for a test of V'PV; for others it stands for the worst, and what is found is no bound.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.given_residuals.contributions import LevelRisk
from pl_mc.integrity_risk.given_residuals.draws import EpochParts

PAIRS, CONSTELLATIONS = "pairs", "constellations"

# Roots of the noncentrality at which a direction is tried, and draws of each.
_ROOTS, _GRID_DRAWS = np.geomspace(0.5, 64.0, 22), 256
# Directions that residuals show less than this share of, and that move the error by more than this many sigma.
_UNSEEN, _MOVES = 1e-9, 1e-6
_GRID, _LAST = 4, 5


@dataclass(frozen=True)
class Several:
    """What sets of satellites do at a multiplier.

    Attributes:
        probability: (sets,), of the event under the worst size found of each; 1 where no residual shows the set.
        error: (sets,), standard error of it; unseen: (sets,), whether no residual shows it.
    """

    probability: FloatArray
    error: FloatArray
    unseen: NDArray[np.bool_]


def sets_of(g: Geometry, kind: str, rows: int) -> tuple[NDArray[np.bool_], list[tuple[int, ...]]]:
    """(sets, rows), pairs of satellites or constellations of one epoch, and the places of the members of each."""
    members: list[tuple[int, ...]]
    if kind == PAIRS:
        members = [*itertools.combinations(range(len(g.names)), 2)]
    else:
        systems = np.array(list(g.systems))
        members = [tuple(np.flatnonzero(systems == letter).tolist()) for letter in dict.fromkeys(g.systems)]
    found = np.zeros((len(members), rows), dtype=bool)
    for k, places in enumerate(members):
        found[k, list(places)] = True
    return found, members


def least_shown(parts: EpochParts, chosen: NDArray[np.bool_]) -> FloatArray | None:
    """(n,), the bias on a set of satellites (n,) that moves the error most for a noncentrality of one [m].

    None where some bias moves the error and no residual shows it.
    """
    places = np.flatnonzero(chosen)
    basis, gain = parts.basis[places], parts.gain_m[:, places]
    values, vectors = np.linalg.eigh(np.eye(places.size) - basis @ basis.T)
    seen = values > _UNSEEN
    sigma = np.sqrt(np.diag(parts.covariance_m2).max())
    if np.abs(gain @ vectors[:, ~seen]).max(initial=0.0) > _MOVES * sigma:
        return None
    scaled = vectors[:, seen] / np.sqrt(values[seen])
    direction = scaled @ np.linalg.svd(gain @ scaled)[2][0]
    bias = np.zeros(chosen.size)
    bias[places] = direction * parts.sigma_m[places]
    return bias


def several(risk: LevelRisk, k: float, sets: NDArray[np.bool_]) -> Several:
    """The event under each set of satellites (sets, n) at k times the level.

    The size is chosen on a grid, nominal biases and signs among it; what is reported comes from other draws.
    """
    found = [least_shown(risk.parts, chosen) for chosen in sets]
    unseen = np.array([direction is None for direction in found], dtype=bool)
    probability, error = np.ones(len(sets)), np.zeros(len(sets))
    shown = np.array([direction for direction in found if direction is not None])
    if len(shown):
        signs = (1.0, -1.0) if risk.nominal_m.any() else (1.0,)
        scale = np.array([sign * root for sign in signs for root in _ROOTS])
        grid = risk.nominal_m[None, :, None] + (scale[:, None] * shown[:, None])[:, None]
        grid = grid.reshape(len(shown), -1, shown.shape[1])
        height = risk.event(grid.reshape(-1, shown.shape[1]), _GRID_DRAWS, _GRID, k).mean(axis=1)
        best = height.reshape(len(shown), -1).argmax(axis=1)
        chance = risk.event(grid[np.arange(len(shown)), best], risk.draws, _LAST, k)
        probability[~unseen] = chance.mean(axis=1)
        error[~unseen] = chance.std(axis=1, ddof=1) / np.sqrt(risk.draws)
    return Several(probability, error, unseen)
