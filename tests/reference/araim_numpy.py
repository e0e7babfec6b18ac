"""Solution separation, slowly and literally: one ``numpy.linalg`` fit per fault mode, root finding by SciPy.

ARAIM Algorithm Description Document v3.0, sections on the fault modes, the thresholds and the protection levels.
Nothing is shared with the package but the definition of the fault modes that are monitored.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

P_HMI_VERT, P_HMI_HOR = 9.8e-8, 2e-9
P_FA_VERT, P_FA_HOR = 3.9e-6, 9e-8
P_THRES, P_EMT = 8e-8, 1e-5

# A subset whose scaled normal matrix has a smaller reciprocal condition number has no position.
SINGULAR = 1e-12


@dataclass
class Reference:
    """Results of one geometry: levels and sigma [m], and what the modes that are monitored came to."""

    vpl: float
    hpl: float
    emt: float
    sigma_v_acc: float
    p_not_monitored: float
    modes: list[frozenset[int]]
    probability: list[float]
    thresholds: np.ndarray


def levels(design, c_int, c_acc, systems, b_nom, p_sat, p_const, *, unmonitored) -> Reference:
    """Protection levels of one geometry without padding; the arguments are vectors (n,), ``p_const`` a mapping."""
    sets, p = fault_modes(design, systems, p_sat, p_const, unmonitored=unmonitored)
    gain, sigma = subset(design, c_int, frozenset())
    if gain is None:
        return Reference(np.inf, np.inf, np.inf, np.inf, 1.0, [], [], np.zeros((0, 3)))
    rows = []
    for excluded, probability in zip(sets, p, strict=True):
        other, sigma_k = subset(design, c_int, excluded)
        if other is not None:
            separation = np.sqrt(((other - gain) ** 2 * c_acc).sum(axis=1))
            rows.append((excluded, probability, sigma_k, np.abs(other) @ b_nom, separation))
    p_unmonitored = 1 - no_fault(design, systems, p_sat, p_const) - sum(row[1] for row in rows)
    count = max(len(rows), 1)
    k_fa = special.ndtri([P_FA_HOR / (4 * count), P_FA_HOR / (4 * count), P_FA_VERT / (2 * count)])
    thresholds = np.array([-k_fa * row[4] for row in rows]).reshape(len(rows), 3)
    share = 1 - p_unmonitored / (P_HMI_VERT + P_HMI_HOR)
    bias = np.abs(gain) @ b_nom

    def level(axis, budget):
        if share <= 0:
            return np.inf
        terms = [(2.0, sigma[axis], bias[axis], False)]
        terms += [(r[1], r[2][axis], r[3][axis] + t[axis], True) for r, t in zip(rows, thresholds, strict=True)]

        def excess(x):
            risk = 0.0
            for weight, s, shift, capped in terms:
                u = (x - shift) / s
                risk += weight * (1.0 if capped and u <= 0 else special.ndtr(-u))
            return risk - budget * share

        return optimize.bisect(excess, 0.0, 1e5, xtol=1e-11, rtol=1e-15, maxiter=200)

    return Reference(
        vpl=level(2, P_HMI_VERT),
        hpl=float(np.hypot(level(0, P_HMI_HOR / 2), level(1, P_HMI_HOR / 2))),
        emt=max((t[2] for r, t in zip(rows, thresholds, strict=True) if r[1] >= P_EMT), default=0.0),
        sigma_v_acc=float(np.sqrt((gain[2] ** 2 * c_acc).sum())),
        p_not_monitored=p_unmonitored,
        modes=[row[0] for row in rows],
        probability=[row[1] for row in rows],
        thresholds=thresholds,
    )


def subset(design, c_int, excluded):
    """Gain (3, n) and standard deviations (3,) without some satellites; None where there is no position."""
    kept = [i for i in range(len(c_int)) if i not in excluded]
    columns = [j for j in range(design.shape[1]) if j < 3 or design[kept, j].any()]
    root = np.sqrt(c_int[kept])
    part = design[np.ix_(kept, columns)] / root[:, None]
    if len(kept) < len(columns) or np.linalg.cond(part) > 1 / np.sqrt(SINGULAR):
        return None, None
    solution = np.linalg.pinv(part)
    gain = np.zeros((3, len(c_int)))
    gain[:, kept] = solution[:3] / root
    return gain, np.sqrt((solution[:3] ** 2).sum(axis=1))


def events(design, systems, p_sat, p_const):
    """The single faults that can move the position: sets of satellites and probabilities."""
    n = len(systems)
    lone = {
        i for i in range(n) for j in range(3, design.shape[1]) if design[i, j] and np.count_nonzero(design[:, j]) == 1
    }
    found = [(frozenset([i]), p_sat[i]) for i in range(n) if i not in lone]
    for letter in sorted(set(systems)):
        members = frozenset(i for i in range(n) if systems[i] == letter and i not in lone)
        if members:
            found.append((members, p_const[letter]))
    return found


def no_fault(design, systems, p_sat, p_const):
    return float(np.prod([1 - p for _, p in events(design, systems, p_sat, p_const)]))


def fault_modes(design, systems, p_sat, p_const, *, unmonitored, most=3):
    """Monitored sets of satellites with their probabilities.

    Combinations of events, by number of events and then by decreasing probability, those of one probability
    together: all that are more probable than P_THRES, and others until what is not monitored is not more than that.
    """
    single = [event for event in events(design, systems, p_sat, p_const) if event[1] > 0]
    none = no_fault(design, systems, p_sat, p_const)
    chosen: list[tuple] = []
    # Combinations that are known and not chosen, as (number of events, satellites, prior).
    open_: list[tuple] = []
    lost = 0.0

    def shared():
        """For each combination that is not chosen but held by chosen ones, its prior and who they are."""
        if unmonitored == "plain":
            return []
        return [(p, at) for _, s, p in open_ if (at := [k for k, c in enumerate(chosen) if s <= c[1]])]

    def left():
        return 1 - none - sum(c[2] for c in chosen) - sum(p for p, _ in shared())

    for order in range(1, most + 1):
        if order > 2 and (left() <= P_THRES or lost > P_THRES):
            break
        for size in {1: (1, 2), 2: ()}.get(order, (order,)):
            for picked in itertools.combinations(single, size):
                p = none * np.prod([q / (1 - q) for _, q in picked])
                open_.append((size, frozenset().union(*(s for s, _ in picked)), float(p)))
        rest = sorted((c for c in open_ if c[0] == order), key=lambda c: -c[2])
        while rest:
            top = rest[0][2]
            group = [c for c in rest if c[2] > top * (1 - 1e-9)]
            rest = rest[len(group) :]
            if top <= P_THRES and (lost > P_THRES or left() <= P_THRES):
                break
            lost += sum(c[2] for c in group if not solvable(design, c[1]))
            group = [c for c in group if solvable(design, c[1])]
            if unmonitored == "contained" and top <= P_THRES:
                group = [c for c in group if not any(c[1] <= other[1] for other in chosen)]
            chosen.extend(group)
            open_ = [c for c in open_ if not any(c is other for other in group)]
    probability = [c[2] for c in chosen]
    for p, holders in shared():
        for k in holders:
            probability[k] += p / len(holders)
    return [c[1] for c in chosen], probability


def solvable(design, excluded):
    """Whether as many satellites as unknowns are left."""
    kept = [i for i in range(len(design)) if i not in excluded]
    return len(kept) >= 3 + design[kept, 3:].any(axis=0).sum()
