"""Positions that an exclusion may leave: all in view, and without each satellite or constellation (ADD v4.2).

What is predicted is the worst of them: with it continuity is kept through any single fault or outage. Each takes an
equal part of the integrity risk, the modes are those of all in view, and priors over the exposure that no mode covers
stay as they are (`usr_vhpl_araim` of MAAST for ARAIM).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pl_mc.araim.batch import Batch
from pl_mc.araim.exposure_modes import without_rows
from pl_mc.araim.modes import FaultModes
from pl_mc.araim.tiles import Positions

SATELLITES, CONSTELLATIONS = "satellites", "constellations"
EXCLUSIONS = (SATELLITES, CONSTELLATIONS)

# Constellations less probable than this to fail are no candidates.
LEAST_CONSTELLATION = 1e-7


def candidates(batch: Batch, exclusion: str) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The rows that each position leaves out (g, positions, n), and whether it is there (g, positions).

    The first leaves out none, then each row stands for itself, then each constellation.
    """
    g, n = batch.in_view.shape
    alike = np.concatenate([np.zeros((1, n), dtype=bool), np.eye(n, dtype=bool)])
    rows = [np.broadcast_to(alike, (g, n + 1, n))]
    if exclusion == CONSTELLATIONS:
        able = [letter for letter, p in sorted(batch.p_const.items()) if p > LEAST_CONSTELLATION]
        rows += [(batch.systems == letter)[:, None] for letter in able]
    excluded = np.concatenate(rows, axis=1) & batch.in_view[:, None]
    number = excluded.sum(axis=2)
    there = (number > 0) & (number < batch.in_view.sum(axis=1, keepdims=True))
    there[:, 0] = True
    return excluded, there


def positions_after(
    geometries: NDArray[np.intp], excluded: NDArray[np.bool_], there: NDArray[np.bool_],
    found: Sequence[FaultModes], pattern: NDArray[np.intp],
) -> Positions:  # fmt: skip
    """The positions of some geometries, in the order of their places in ``there``.

    Args:
        geometries: (k,), places in the batch; excluded: (k, positions, n); there: (k, positions).
        found: modes of all in view; pattern: (k,), which of them belong to each.
    """
    _, first, place = np.unique(pattern, return_index=True, return_inverse=True)
    lists, start = list[FaultModes](), np.zeros(len(first), dtype=np.intp)
    for k, at in enumerate(first.tolist()):
        start[k] = len(lists)
        lists += [without_rows(found[pattern[at]], rows) for rows in excluded[at, there[at]]]
    geometry, position = np.nonzero(there)
    rank = np.cumsum(there, axis=1) - 1
    return Positions(
        geometry=geometries[geometry],
        excluded=excluded[geometry, position],
        modes=lists,
        place=start[place.reshape(-1)[geometry]] + rank[geometry, position],
        share=1.0 / there.sum(axis=1)[geometry],
    )
