"""Fault modes: which combinations of faults have to be monitored, and how probable each is.

An event is the fault of one satellite or of one constellation; a fault mode is the set of satellites that a
combination of events spoils. The list depends on which satellites are in view and on nothing else of the geometry,
so it is made on the host, once for each pattern of a batch.

ADD v3.0, section on the faults to be monitored. Combinations are taken by the number of their events and then by
decreasing probability, those of one probability together (so that the order of the satellites is of no matter): all
that are more probable than P_THRES, then others until what is left is no more than P_THRES.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.araim.budget import Budget
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.geometry.record import as_mask
from pl_mc.input_errors import (
    InputError,
    require_choice,
    require_list,
    require_number,
    require_numbers,
    require_true,
    shown,
)

PLAIN, CONTAINED = "plain", "contained"
UNMONITORED = (PLAIN, CONTAINED)

# Smaller priors than this are none; their combinations would be below the smallest double.
LEAST_PRIOR = 1e-100

# The longest list of combinations of one size: three events of forty.
LARGEST_LIST = 10_000

# Probabilities that differ by less than this share of themselves count as one.
_TIE = 1e-9


@dataclass(frozen=True)
class FaultModes:
    """The monitored fault modes of one pattern of satellites in view.

    The probabilities of the modes, of no fault and of what is not monitored sum to one.

    Attributes:
        excluded: (modes, n), which satellites each mode spoils.
        probability: (modes,), prior of each; for ``contained`` with its share of the combinations that it holds.
        p_no_fault: prior of no fault at all.
        p_not_monitored: prior of everything else.
        exposure: (modes,), prior of each over the exposure, where it is another one (v4.2); the sum of one then holds
            with these, and of no fault over the exposure.
    """

    excluded: NDArray[np.bool_]
    probability: NDArray[np.float64]
    p_no_fault: float
    p_not_monitored: float
    exposure: NDArray[np.float64] | None = None

    @property
    def over_exposure(self) -> NDArray[np.float64]:
        """(modes,), the prior of each over the exposure."""
        return self.probability if self.exposure is None else self.exposure


def lone_satellites(clocks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,), satellites that are the only one of a clock column, of (n, clocks).

    Such a satellite decides its clock and nothing else, so its faults move no position, whatever else is left out.
    """
    return np.asarray((clocks & (clocks.sum(axis=0) == 1)).any(axis=1))


@ordinary_arithmetic
def fault_modes(
    systems: Sequence[str],
    clocks: NDArray[np.bool_],
    p_sat: NDArray[np.float64],
    p_const: dict[str, float],
    budget: Budget,
    unmonitored: str,
) -> FaultModes:
    """The fault modes of one pattern.

    Args:
        systems: n letters; an empty one for rows that are out of view.
        clocks: (n, clocks), which clock each satellite in view observes.
        p_sat: (n,), prior of each satellite's fault.
        p_const: prior of a fault of each constellation.
        budget: for its P_THRES.
        unmonitored: ``plain``, every combination for itself; ``contained``, a combination whose satellites all
            belong to a monitored mode is protected by it and adds to its prior, shared where there are several.
    """
    require_choice(unmonitored, UNMONITORED, field="unmonitored")
    if not isinstance(budget, Budget):
        raise InputError(f"budget: a budget such as pl_mc.araim.LPV_200 is needed, not {shown(budget)}.")
    systems = require_list(systems, field="systems", of="letters")
    given, clocks = require_numbers(p_sat, field="p_sat"), as_mask(clocks)
    if not all(isinstance(one, str) for one in systems) or given.shape != (len(systems),):
        raise InputError(f"systems, p_sat: a letter and a number for each row are needed, not {shown(systems)}.")
    if clocks.ndim != 2 or len(clocks) != len(systems):
        raise InputError(f"clocks: the shape ({len(systems)}, clocks) is needed, not {clocks.shape}.")
    if not isinstance(p_const, Mapping) or not {*systems} - {""} <= {*p_const}:
        raise InputError(f"p_const: a prior of each letter of systems is needed, not {shown(p_const)}.")
    priors = {letter: require_number(p_const[letter], field="p_const") for letter in {*systems} - {""}}
    p = np.array([*given, *priors.values()])
    rule = f"a prior probability lies between 0 and 1, 1 excluded, and is 0 or at least {LEAST_PRIOR:g}"
    require_true((p == 0) | ((p >= LEAST_PRIOR) & (p < 1)), field="p_sat, p_const", rule=rule, of=p)
    single, odds, p_no_fault = _events(systems, clocks, given, priors)
    in_view = np.array([letter != "" for letter in systems], dtype=bool)
    limit = budget.p_threshold
    sets, prior, order_of = single[:0], odds[:0], np.zeros(0, dtype=np.intp)
    # Combinations that have a test of their own; those that a mode with a test holds.
    chosen, held = np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    # Prior of what ought to be monitored and leaves too few satellites.
    lost = 0.0

    def left() -> float:
        return float(1.0 - p_no_fault - prior[chosen | held].sum())

    for order in range(1, len(single) + 1):
        # Pairs are always listed, since some of them are held by a single fault.
        if order > 2 and (left() <= limit or lost > limit):
            break
        for size in (1, 2) if order == 1 else (order,) if order > 2 else ():
            more, more_prior = _combinations(single, p_no_fault * odds, odds, size, limit)
            sets, prior = np.concatenate([sets, more]), np.concatenate([prior, more_prior])
            order_of = np.concatenate([order_of, np.full(len(more), size)])
            chosen = np.concatenate([chosen, np.zeros(len(more), dtype=bool)])
            new = _holders(more, sets[: len(chosen)][chosen]).any(axis=1) if unmonitored == CONTAINED else False
            held = np.concatenate([held, np.zeros(len(more), dtype=bool) | new])
        for group in _groups(prior, order_of == order):
            most = float(prior[group[0]])
            if most <= limit and (lost > limit or left() <= limit):
                break
            solvable = solvable_modes(sets[group], in_view, clocks)
            lost += float(prior[group][~solvable].sum())
            wanted = group[solvable & ~(held[group] & (most <= limit))]
            chosen[wanted] = True
            if unmonitored == CONTAINED:
                held |= _holders(sets, sets[wanted]).any(axis=1)
    probability = prior[chosen]
    if unmonitored == CONTAINED:
        shared = ~chosen & held
        holders = _holders(sets[shared], sets[chosen])
        probability = probability + (prior[shared] / holders.sum(axis=1)) @ holders
    return FaultModes(sets[chosen], probability, p_no_fault, max(left(), 0.0))


def _holders(sets: NDArray[np.bool_], modes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(sets, modes), whether all satellites of a set belong to a mode."""
    held = np.zeros((len(sets), len(modes)), dtype=bool)
    for k, mode in enumerate(modes):
        held[:, k] = ~sets[:, ~mode].any(axis=1)
    return held


def _combinations(
    single: NDArray[np.bool_], one: NDArray[np.float64], odds: NDArray[np.float64], size: int, limit: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Satellites and priors of all combinations of ``size`` events; ``one`` is the prior of each event alone."""
    if math.comb(len(single), size) > LARGEST_LIST:
        raise InputError(
            f"p_sat: with {len(single)} faults this probable, combinations of {size} would have to be monitored to "
            f"come down to P_THRES = {limit:g}; smaller probabilities are needed."
        )
    picked = np.array(list(itertools.combinations(range(len(single)), size)), dtype=np.intp).reshape(-1, size)
    return np.asarray(single[picked].any(axis=1)), one[picked[:, 0]] * odds[picked[:, 1:]].prod(axis=1)


def _groups(prior: NDArray[np.float64], among: NDArray[np.bool_]) -> Iterator[NDArray[np.intp]]:
    """Places of equal priors, by decreasing prior."""
    places = np.flatnonzero(among)
    places = places[np.argsort(-prior[places], kind="stable")]
    while len(places):
        stop = int((prior[places] > prior[places[0]] * (1.0 - _TIE)).sum())
        yield places[:stop]
        places = places[stop:]


def _events(
    systems: Sequence[str], clocks: NDArray[np.bool_], p_sat: NDArray[np.float64], p_const: dict[str, float]
) -> tuple[NDArray[np.bool_], NDArray[np.float64], float]:
    """Single faults that can move the position: satellites (events, n), odds (events,), and prior of none."""
    letters = np.array(systems)
    counts = (letters != "") & ~lone_satellites(clocks)
    sets = [np.eye(len(letters), dtype=bool)[counts]]
    probability = [p_sat[counts]]
    for letter in sorted(set(letters[counts].tolist())):
        sets.append((counts & (letters == letter))[None])
        probability.append(np.array([p_const[letter]]))
    p = np.concatenate(probability)
    single, p = np.concatenate(sets)[p > 0], p[p > 0]
    return single, p / (1.0 - p), float(np.prod(1.0 - p))


def solvable_modes(
    excluded: NDArray[np.bool_], in_view: NDArray[np.bool_], clocks: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(modes,), whether at least as many satellites as unknowns are left."""
    kept = in_view & ~excluded
    unknowns = 3 + sum((kept & column).any(axis=1).astype(np.intp) for column in clocks.T)
    return np.asarray(kept.sum(axis=1) >= unknowns)
