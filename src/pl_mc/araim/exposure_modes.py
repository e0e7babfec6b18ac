"""Fault modes of ARAIM v4.2: priors at an instant and over an exposure, and constellations that stand for the rest.

A fault of rate R that lasts MFD on average is there at an instant with R MFD, and at some time of an exposure T with
R (MFD + T). The first enters the risk of a level, the second what may stay without a test. As in `pl_mc.araim.modes`
the list hangs on which satellites are in view and is made on the host, once for each pattern of a batch.

Source: the rules as the code of the algorithm's authors has them, `determine_subsets_v5` of MAAST for ARAIM.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.araim.budget import Budget
from pl_mc.araim.modes import LARGEST_LIST, FaultModes, solvable_modes
from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError

# Whatever the budget, a mode more probable than this over the exposure has a test.
ALWAYS_MONITORED = 1e-7

# As many satellites as a solution needs at least, whatever its unknowns.
FEWEST = 4

LISTED, PROBABLE = "listed", "probable"
ORDERS = (LISTED, PROBABLE)

# Priors that differ by less than this share of themselves count as one.
_TIE = 1e-9


@dataclass(frozen=True)
class Combinations:
    """Combinations of events.

    Attributes:
        spoiled: (m, n), the satellites that each spoils.
        instant, exposure: (m,), its prior at an instant and over the exposure.
    """

    spoiled: NDArray[np.bool_]
    instant: FloatArray
    exposure: FloatArray

    def at(self, places: Any) -> Combinations:
        """Some of them."""
        return Combinations(self.spoiled[places], self.instant[places], self.exposure[places])


def exposure_modes(
    systems: Sequence[str], clocks: NDArray[np.bool_], p_sat: tuple[FloatArray, FloatArray],
    p_const: tuple[dict[str, float], dict[str, float]], budget: Budget, *, excludes: bool, order: str = LISTED,
) -> FaultModes:  # fmt: skip
    """The fault modes of one pattern of satellites.

    Args:
        systems: n letters; an empty one for rows that are out of view.
        clocks: (n, clocks), which clock each satellite in view observes.
        p_sat, p_const: priors at an instant and over the exposure, of each satellite (n,) and by letter.
        budget: for P_THRES, consolidation and P_exc.
        excludes: whether levels hold after an exclusion too: a mode that together with an exclusion leaves no
            satellite at all then has no test, unless its prior demands one.
        order: in which order modes join whose prior does not demand a test, after the number of satellites that
            they spoil. ``listed``: as the rows stand, which is what the authors' code does. ``probable``: by
            decreasing prior, equal ones together, so that the order of rows does not matter.
    """
    letters = np.array(systems)
    every = _consolidated(_combinations(letters, p_sat, p_const, budget.p_threshold), letters, budget.consolidation)
    every = every.at(np.argsort(every.spoiled.sum(axis=1), kind="stable"))
    listed, p_not_monitored = _monitored(every, budget, _options(every, budget, excludes), order)
    merged = _merged(listed)
    merged = merged.at(merged.spoiled.any(axis=1))
    seen = letters != ""
    solvable = solvable_modes(merged.spoiled, seen, clocks) & ((seen & ~merged.spoiled).sum(axis=1) >= FEWEST)
    p_not_monitored += float(merged.exposure[~solvable].sum())
    kept = merged.at(solvable)
    return FaultModes(kept.spoiled, kept.instant, float(every.instant[0]), p_not_monitored, kept.exposure)


def without_rows(modes: FaultModes, rows: NDArray[np.bool_]) -> FaultModes:
    """The modes of all in view where the satellites of some rows (n,) have been excluded.

    They leave every mode. Modes that then spoil the same are one, with the sum of their priors, and one that spoils
    nothing more is part of no fault. What is not monitored stays as it is.
    """
    merged = _merged(Combinations(modes.excluded & ~rows, modes.probability, modes.over_exposure))
    merged = merged.at(merged.spoiled.any(axis=1))
    return FaultModes(merged.spoiled, merged.instant, modes.p_no_fault, modes.p_not_monitored, merged.exposure)


def _combinations(
    letters: NDArray[np.str_], p_sat: tuple[FloatArray, FloatArray], p_const: tuple[dict[str, float], ...],
    p_threshold: float,
) -> Combinations:  # fmt: skip
    """All combinations of as many events as P_THRES may ask for, two at least; no fault at all is the first."""
    seen = letters != ""
    present = list(dict.fromkeys(letters[seen].tolist()))
    groups = letters[None] == np.array(present, dtype=np.str_)[:, None]
    single = np.concatenate([np.eye(len(letters), dtype=bool)[seen], groups])
    instant, exposure = (
        np.concatenate([sat[seen], [const[one] for one in present]]) for sat, const in zip(p_sat, p_const, strict=True)
    )
    able = exposure > 0
    single, instant, exposure = single[able], instant[able], exposure[able]
    most = max(2, _most_events(exposure, p_threshold))
    if math.comb(len(single), most) > LARGEST_LIST:
        raise InputError(
            f"p_sat: with {len(single)} faults this probable over the exposure, combinations of {most} would have to "
            f"be listed to come down to P_THRES = {p_threshold:g}; smaller probabilities are needed."
        )
    parts: list[tuple[NDArray, FloatArray, FloatArray]] = []
    for size in range(min(most, len(single)) + 1):
        shape = (math.comb(len(single), size), size)
        picked = np.array(list(itertools.combinations(range(len(single)), size)), dtype=np.intp).reshape(shape)
        parts.append(
            (
                single[picked].any(axis=1),
                *(np.prod(1.0 - p) * (p / (1.0 - p))[picked].prod(axis=1) for p in (instant, exposure)),
            )
        )
    return Combinations(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _most_events(p: FloatArray, p_threshold: float) -> int:
    """The smallest number of events such that more than that are no more probable than P_THRES."""
    none, odds = float(np.prod(1.0 - p)), p / (1.0 - p)
    pairs = (odds.sum() ** 2 - (odds**2).sum()) / 2.0
    at_most = np.cumsum([none, none * odds.sum(), none * pairs])
    for events, share in enumerate(at_most):
        if 1.0 - share <= p_threshold:
            return events
    events = len(at_most)
    while p.sum() ** (events + 1) / math.factorial(events + 1) > p_threshold and events < len(p):
        events += 1
    return events


def _consolidated(every: Combinations, letters: NDArray[np.str_], share: float) -> Combinations:
    """Combinations inside one constellation, less probable than a share of its own fault, are added to that fault."""
    instant, exposure = every.instant.copy(), every.exposure.copy()
    stays = np.ones(len(instant), dtype=bool)
    for letter in dict.fromkeys(letters[letters != ""].tolist()):
        own = letters == letter
        inside = every.spoiled.any(axis=1) & ~every.spoiled[:, ~own].any(axis=1)
        whole = np.flatnonzero(inside & every.spoiled[:, own].all(axis=1) & stays)
        if not len(whole):
            continue
        # The first is the constellation alone, unless it is a single satellite, which comes before.
        j = int(whole[np.argmax(every.instant[whole])])
        leaves = inside & stays & (every.instant < share * every.instant[j])
        leaves[j] = False
        instant[j] += every.instant[leaves].sum()
        exposure[j] += every.exposure[leaves].sum()
        stays &= ~leaves
    return Combinations(every.spoiled[stays], instant[stays], exposure[stays])


def _options(every: Combinations, budget: Budget, excludes: bool) -> NDArray[np.bool_]:
    """(options, n), the satellites that each exclusion leaves out; the first leaves out none."""
    nothing = np.zeros((1, every.spoiled.shape[1]), dtype=bool)
    if not excludes:
        return nothing
    return np.concatenate([nothing, every.spoiled[every.spoiled.any(axis=1) & (every.instant > budget.p_exclusion)]])


def _monitored(
    every: Combinations, budget: Budget, options: NDArray[np.bool_], order: str
) -> tuple[Combinations, float]:
    """Those that have a test, no fault among them, and the prior of the others over the exposure."""
    fault = every.spoiled.any(axis=1)
    chosen = ~fault | (every.exposure > ALWAYS_MONITORED)
    left = 1.0 - float(every.exposure[chosen].sum())
    in_view = every.spoiled.any(axis=0)
    for group in _joining(every, np.flatnonzero(~chosen), order):
        if left <= budget.p_threshold:
            break
        kept = in_view & ~(every.spoiled[group][:, None] | options)
        wanted = group[np.all(np.any(kept, axis=2), axis=1)]
        chosen[wanted] = True
        left -= float(every.exposure[wanted].sum())
    return every.at(np.flatnonzero(chosen)), left


def _joining(every: Combinations, places: NDArray[np.intp], order: str) -> Iterator[NDArray[np.intp]]:
    """Which modes join together, one group after the other."""
    if order == LISTED:
        yield from places[:, None]
        return
    number, prior = every.spoiled[places].sum(axis=1), every.exposure[places]
    sequence = np.lexsort((-prior, number))
    places, number, prior = places[sequence], number[sequence], prior[sequence]
    new = (np.diff(number) > 0) | (prior[1:] < prior[:-1] * (1.0 - _TIE))
    yield from np.split(places, np.flatnonzero(new) + 1)


def _merged(given: Combinations) -> Combinations:
    """One combination for each set of satellites, with the sum of the priors, in the order of the first of each."""
    packed = np.packbits(given.spoiled, axis=1)
    words = np.ascontiguousarray(packed).view(np.dtype((np.void, packed.shape[1])))[:, 0]
    _, first, place = np.unique(words, return_index=True, return_inverse=True)
    instant, exposure = (
        np.bincount(place.reshape(-1), p, len(first)).astype(float) for p in (given.instant, given.exposure)
    )
    listed = np.argsort(first)
    return Combinations(given.spoiled[first[listed]], instant[listed], exposure[listed])
