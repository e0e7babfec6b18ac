"""The worst pair of satellites for a method without exact probabilities: cheap screening, then estimates.

All pairs, in every direction and size, are too many for an estimate each. The screening looks at the limit state of
a thousand draws, the same for every fault: it counts where the event is common, and where it is not it takes the
limit state for normal, as the first reliability index did (mean over standard deviation). That orders faults, no
more. The best of them are ordered again by a small population of subset simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.rare.limit_state import FAR_M, POINTS_TOGETHER, LimitState, all_axes, rotation
from pl_mc.integrity_risk.rare.subset import climb
from pl_mc.integrity_risk.worst.search import (
    Estimator,
    Search,
    climb_faults,
    fault_columns,
    last_estimates,
    scan_faults,
)
from pl_mc.methods import Method
from pl_mc.statistics.intervals import clopper_pearson

# Sizes of the larger bias that are screened: small ones make misleading information, large ones missed detections.
_SIZES_M = np.array([2.5, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0])
# Sizes along the direction that is worst for least squares, about the size that is.
_FACTORS = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
# Events from which a share of the draws is taken for what it is.
_ENOUGH = 8
_TAIL = 0.99
# Faults of a pair, and pairs for each that is refined, that go on the short list.
_FAULTS_EACH, _PAIRS_EACH, _FEWEST_PAIRS = 2, 4, 8
# Populations of the short list: points, moves, and evaluations at which one gives up.
_POINTS, _MOVES, _MOST = 512, 5, 100_000
# Of a population that did not get there its last level is a bound, and this much less a guess.
_UNREACHED = np.log(0.1)

SCREENED, SHORTLISTED, REFINED = "screened", "shortlisted", "refined"


@dataclass
class Screen:
    """Quick looks at the event of one method at one epoch; it counts what they cost.

    Attributes:
        limit: the limit state, of no fault.
        draws: (N, n), whitened noise that all faults are screened with.
        seed: of the populations, the same for every fault.
        evaluations: limit states computed so far.
    """

    limit: LimitState
    draws: FloatArray
    seed: int
    evaluations: int = 0

    @classmethod
    def of(
        cls, g: Geometry, method: Method, event: str, alert: AlertLimits, rng: np.random.Generator, axis: str = VERTICAL
    ) -> Screen:
        """Of an epoch with redundancy."""
        n = len(g.names)
        axes = all_axes(np.ones(n, dtype=bool), 1)
        limit = LimitState.of(g.as_series(), 0, np.zeros(n), method, event, alert, axes, axis)
        return cls(limit, rng.standard_normal((POINTS_TOGETHER, n)), int(rng.integers(LARGEST_SEED)))

    def counted(self, bias_m: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Of faults (f, n) [m] the logarithm of a guess of the probability (f,), and the events (f,) behind it."""
        guesses, events = np.empty(len(bias_m)), np.empty(len(bias_m), dtype=np.int64)
        for k, bias in enumerate(bias_m):
            values = replace(self.limit, bias_m=bias)(self.draws)
            events[k] = int((values > 0).sum())
            guesses[k] = _log_guess(values, int(events[k]))
        self.evaluations += len(bias_m) * len(self.draws)
        return guesses, events

    def climbed(self, bias_m: FloatArray) -> FloatArray:
        """Of faults (f, n) [m] the logarithm of the probability (f,) from a population of subset simulation."""
        found = np.empty(len(bias_m))
        for k, bias in enumerate(bias_m):
            turned = rotation(self.limit.design, self.limit.sigma_m, self.limit.in_view, bias, self.limit.axis)
            limit = replace(self.limit, bias_m=bias, coordinates=turned)
            rng = np.random.default_rng(self.seed)
            run = climb(limit, rng, size=_POINTS, moves=_MOVES, most_evaluations=_MOST)
            self.evaluations += run.evaluations
            found[k] = run.log_probability + (0.0 if run.reached else _UNREACHED)
        return found

    def estimator(self, g: Geometry) -> Estimator:
        """The populations as an estimator that says nothing of its error; for comparisons alone."""

        def estimate(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
            value = np.exp(self.climbed(faults.bias_m))
            return pd.DataFrame(
                {"probability": value, "standard_error": np.nan, "low": 0.0, "high": 1.0, "warning": ""}
            )

        return estimate


def screened_table(
    g: Geometry, groups: Sequence[tuple[int, ...]], guesses_m: FloatArray, screen: Screen, search: Search
) -> pd.DataFrame:
    """One row per satellite or pair, of an epoch with redundancy; columns are explained at `pl_mc.worst_case`.

    ``guesses_m`` (groups, n) are faults to look around at besides, what is worst for least squares; what is not
    finite is left out [m].
    """
    scans = [_faults(group, guess) for group, guess in zip(groups, guesses_m, strict=True)]
    owner = np.repeat(np.arange(len(groups)), [len(scan) for scan in scans])
    faults = np.concatenate(scans)
    guess, events = screen.counted(faults)
    order = np.lexsort((-guess, owner))
    # Of each group the best faults first.
    first = np.searchsorted(owner[order], np.arange(len(groups)))
    best = order[first]
    bias, rough = faults[best].copy(), guess[best].copy()
    low, high = clopper_pearson(events[best], len(screen.draws))
    spent = {SCREENED: screen.evaluations}

    listed = np.argsort(-rough, kind="stable")[: max(_FEWEST_PAIRS, _PAIRS_EACH * search.refine)]
    tried = np.concatenate([order[first[k] : first[k] + min(_FAULTS_EACH, len(scans[k]))] for k in listed])
    climbed = screen.climbed(faults[tried])
    for k in listed:
        own = np.flatnonzero(owner[tried] == k)
        at = own[climbed[own].argmax()]
        bias[k], rough[k] = faults[tried[at]], climbed[at]
    chosen = listed[np.argsort(-rough[listed], kind="stable")[: search.refine]]
    bias[chosen] = climb_faults(g, bias[chosen], [groups[k] for k in chosen], screen.estimator(g), search.seed)
    spent[SHORTLISTED] = screen.evaluations - spent[SCREENED]
    stage = np.full(len(groups), SCREENED, dtype=object)
    stage[listed], stage[chosen] = SHORTLISTED, REFINED
    table = pd.DataFrame(fault_columns(g, groups, bias))
    table = table.assign(
        probability=np.nan, standard_error=np.nan, low=np.asarray(low, float), high=np.asarray(high, float),
        rough=np.exp(rough), stage=stage, refined=stage == REFINED, warning=np.full(len(groups), "", dtype=object),
    )  # fmt: skip
    spent[REFINED] = last_estimates(g, table, chosen, bias, search, doubts=[""] * len(groups))
    place = np.array([(REFINED, SHORTLISTED, SCREENED).index(one) for one in stage])
    table = table.iloc[np.lexsort((-rough, place))].reset_index(drop=True)
    table.attrs["evaluations"] = spent
    return table


def _faults(group: tuple[int, ...], guess_m: FloatArray) -> FloatArray:
    """(f, n), what is screened of one satellite or a pair [m]."""
    faults = scan_faults(group, guess_m.size, _SIZES_M)
    if np.isfinite(guess_m).all() and guess_m.any():
        faults = np.concatenate([faults, _FACTORS[:, None] * guess_m])
    return faults


def _log_guess(values: FloatArray, events: int) -> float:
    """Logarithm of a guess of P(limit state > 0) from its values: a count, or a normal tail continued."""
    if events >= _ENOUGH:
        return float(np.log(events / values.size))
    known = values[np.abs(values) < FAR_M]
    if known.size < values.size // 100 + 2:
        return -np.inf
    middle, upper = np.quantile(known, [0.5, _TAIL])
    # A middle beyond zero belongs to events of which there would have been enough.
    index = -middle / max(upper - middle, 1e-12) * float(special.ndtri(_TAIL))
    return float(special.log_ndtr(-index) + np.log(known.size / values.size))
