"""How probable it is that an error exceeds its level: without a fault, and under the worst fault of each satellite.

Residuals are drawn, the rest is integrated (`pl_mc.integrity_risk.given_residuals.draws`). The worst size of each
satellite's fault is looked for on a grid of noncentralities and then between its neighbours; what is reported comes
from draws that had no part in the choice. A size at the end of the grid stands for an unbounded one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget, Shares
from pl_mc.integrity_risk.given_residuals.draws import Drawn, EpochParts, draw
from pl_mc.integrity_risk.given_residuals.truth import Scaled, Truth
from pl_mc.methods import Method

AS_BELIEVED = Scaled()

# Roots of the noncentrality of V'PV; the last one stands for a fault without bounds.
_ROOTS = np.concatenate([np.geomspace(0.5, 64.0, 29), [1e3, 1e5]])
# Sizes between the neighbours of the best one, and draws of each step by those of the last.
_BETWEEN, _GRID_SHARE, _FINER_SHARE = 9, 16, 4
# The fault-free risk is the smallest: more draws, in part from stronger noise, which estimates answer, and from weaker,
# which makes posterior levels small (shares and strengths).
_FAULT_FREE_TIMES = 4
_STRENGTHS = ((0.25, 1.0), (0.15, 1.25), (0.2, 1.55), (0.1, 0.7), (0.1, 0.45), (0.1, 0.28), (0.1, 0.15))
# A multiplier beyond this is none, nor is one below the least; the search goes in such steps of its logarithm from the
# first, and ends where it moves by less than a share of itself.
LARGEST_K, _LEAST_K, _FIRST_K, _STRIDE, _CLOSE, _ROUNDS = 1e9, 1e-3, 5.5, 0.15, 5e-3, 8
# A multiplier so large, and so much larger than without a fault, is that of the largest size that was tried.
_UNBOUNDED, _UNBOUNDED_TIMES = 1e3, 10.0
# Satellites that move the error by less than this share of its standard deviation do not move it.
_NO_EFFECT = 1e-9
# For the slope at the multiplier.
_STEP = 1.02
DRAWS = 16_384
# Other seeds for each purpose.
_GRID, _FINER, _FREE, _LAST = range(4)


@dataclass(frozen=True)
class WorstFaults:
    """The worst fault of each satellite that is analysed, and what the method makes of residuals under it.

    Attributes:
        bias_m: (rows, n), with the nominal biases of all satellites [m].
        drawn: under each of them, from draws that had no part in the choice.
    """

    bias_m: FloatArray
    drawn: Drawn


@dataclass(frozen=True)
class Contributions:
    """Risk of one epoch at one multiplier of the method's own level.

    Attributes:
        k: the multiplier.
        fault_free, single: prior times P(event), of all satellites together the latter.
        fault_free_error, single_error: standard errors.
        pairs, other: prior of pairs of satellites and of all that is not analysed besides.
        worst: place of the satellite with the largest contribution; -1 without any.
        worst_bias_m: its fault [m]; infinite at the end of the search.
        worst_fault_m: (n,), the same with the nominal biases of all satellites [m].
        nominal_m: (n,), the nominal biases of the fault-free case [m].
        faults: the faults of all satellites.
        worst_probability, worst_error: P(event) under it and its standard error.
        unsettled: largest share of draws whose last iteration still moved by more than 1 cm.
    """

    k: float
    fault_free: float
    single: float
    fault_free_error: float
    single_error: float
    pairs: float
    other: float
    worst: int
    worst_bias_m: float
    worst_fault_m: FloatArray
    nominal_m: FloatArray
    faults: WorstFaults
    worst_probability: float
    worst_error: float
    unsettled: float

    @property
    def analysed(self) -> float:
        return self.fault_free + self.single

    @property
    def error(self) -> float:
        # The same noise serves all satellites: their errors may be of one sign.
        return math.hypot(self.fault_free_error, self.single_error)


class LevelRisk:
    """The risk of one method's level at one epoch with redundancy, as a function of its multiplier.

    Args:
        g: the epoch.
        method: the method, with the multiplier that it has.
        budget: priors and nominal biases.
        axis: ``vertical`` or ``horizontal``.
        draws: of the last estimate of every satellite; the fault-free case has four times as many.
        seed: of the noise, which all methods share; several whole numbers tell geometries apart.
        truth: how errors are really distributed; method and level go by independent ones of the model's sigma.

    Raises:
        InputError: a budget of which nothing is left.
    """

    def __init__(
        self,
        g: Geometry,
        method: Method,
        budget: RiskBudget,
        axis: str,
        *,
        draws: int = DRAWS,
        seed: int | tuple[int, ...] = 0,
        truth: Truth = AS_BELIEVED,
    ) -> None:
        parts = EpochParts.of(g, axis)
        assert parts is not None
        self.truth = truth
        self.parts, self.method, self.draws, self.seed = parts, method, draws, seed
        self.shares: Shares = budget.shared(g)
        self.allowed = budget.allowed(self.shares, axis)
        self.nominal_m = self._nominal(budget.b_nom_m)
        prior = np.zeros(parts.in_view.size)
        prior[: len(g.names)] = self.shares.single
        self.prior = prior
        self.rows = np.flatnonzero(parts.checked & (prior > 0))
        # A fault that no residual shows is never found; the only satellite of a clock moves that clock alone.
        moves = np.abs(parts.gain_m).max(axis=0) > _NO_EFFECT * np.sqrt(np.diag(parts.covariance_m2).max())
        self.unchecked = float(prior[~parts.checked & moves].sum())
        self.free = self._fault_free()
        grid = [self._faults(int(row), _ROOTS) for row in self.rows]
        self.grid_m = np.concatenate(grid) if grid else np.zeros((0, prior.size))
        self.per_row = len(self.grid_m) // max(len(self.rows), 1)
        self.grid = self._drawn(self.grid_m, max(draws // _GRID_SHARE, 256), _GRID)

    def _nominal(self, b_nom_m: float) -> FloatArray:
        """(c, n), nominal biases that move each component of the error most; one row of zeros without."""
        if b_nom_m == 0:
            return np.zeros((1, self.parts.in_view.size))
        return b_nom_m * np.sign(self.parts.gain_m / self.parts.sigma_m)

    def _rng(self, purpose: int) -> np.random.Generator:
        key = self.seed if isinstance(self.seed, tuple) else (self.seed,)
        return np.random.default_rng((*key, purpose))

    def _drawn(self, bias_m: FloatArray, draws: int, purpose: int) -> Drawn:
        lanes, _ = self.truth.lanes(self.parts, self._rng(purpose), np.ones((draws, 1)))
        return draw(self.parts, self.method, bias_m, lanes)

    def event(self, bias_m: FloatArray, draws: int, purpose: int, k: float) -> FloatArray:
        """(faults, draws), P(event | residuals) at k times the level under biases (faults, n) [m]."""
        return self._drawn(bias_m, draws, purpose).beyond(k)

    def _fault_free(self) -> Drawn:
        draws = _FAULT_FREE_TIMES * self.draws
        shares, strengths = np.array(_STRENGTHS).T
        counts = np.diff(np.round(np.concatenate([[0.0], np.cumsum(shares)]) * draws).astype(int))
        lanes, square = self.truth.lanes(self.parts, self._rng(_FREE), np.repeat(strengths, counts)[:, None])
        # Only residuals count, so only their density does.
        half = 0.5 * square[:, None]
        ratio = counts / draws * strengths**-self.parts.dof * np.exp(half * (1.0 - strengths**-2.0))
        self.plain = int(counts[0])
        return draw(self.parts, self.method, self.nominal_m, lanes, 1.0 / ratio.sum(axis=1))

    def _faults(self, row: int, roots: FloatArray) -> FloatArray:
        """(faults, n), biases of one satellite that give these roots of the noncentrality, with nominal ones [m]."""
        size = roots * self.parts.sigma_m[row] / np.sqrt(self.parts.redundancy[row])
        # Without nominal biases either sign does the same.
        signs = (1.0, -1.0) if self.nominal_m.any() else (1.0,)
        found = []
        for nominal in self.nominal_m:
            for sign in signs:
                bias = np.repeat(nominal[None], size.size, axis=0)
                bias[:, row] += sign * size
                found.append(bias)
        return np.concatenate(found)

    def worst_faults(self, k: float) -> WorstFaults:
        """The fault of each satellite that is likeliest to exceed k times the level."""
        bias_m = self._worst_sizes(k) if len(self.rows) else self.grid_m
        return WorstFaults(bias_m, self._drawn(bias_m, self.draws, _LAST))

    def _worst_sizes(self, k: float) -> FloatArray:
        """(rows, n) [m]."""
        height = self.grid.beyond(k).mean(axis=1).reshape(len(self.rows), -1)
        best = height.argmax(axis=1)
        steps = _ROOTS.size
        finer = []
        for j, (row, place) in enumerate(zip(self.rows, best, strict=True)):
            turn, at = divmod(int(place), steps)
            chosen = self.grid_m[j * self.per_row + turn * steps + at]
            ends = float(_ROOTS[max(at - 1, 0)]), float(_ROOTS[min(at + 1, steps - 1)])
            around = self._faults(int(row), np.geomspace(*ends, _BETWEEN))
            finer.append(around.reshape(-1, _BETWEEN, chosen.size)[turn])
        sizes = np.concatenate(finer)
        drawn = self._drawn(sizes, max(self.draws // _FINER_SHARE, 256), _FINER)
        height = drawn.beyond(k).mean(axis=1).reshape(len(self.rows), _BETWEEN)
        return sizes.reshape(len(self.rows), _BETWEEN, -1)[np.arange(len(self.rows)), height.argmax(axis=1)]

    def at(self, k: float, faults: WorstFaults | None = None) -> Contributions:
        """The contributions at a multiplier, under faults that were found for it or for one near it."""
        faults = self.worst_faults(k) if faults is None else faults
        free = self.free.beyond(k)
        means = free.mean(axis=1)
        at = int(means.argmax())
        chance = faults.drawn.beyond(k)
        prior = self.prior[self.rows]
        # The sum of each draw: its scatter is that of the whole.
        sums = prior @ chance
        worst = int((prior * chance.mean(axis=1)).argmax()) if len(prior) else -1
        count = math.sqrt(self.draws)
        row = int(self.rows[worst]) if worst >= 0 else -1
        return Contributions(
            k=k,
            fault_free=self.shares.fault_free * float(means[at]),
            single=float(sums.mean()) + self.unchecked if len(prior) else self.unchecked,
            fault_free_error=self.shares.fault_free * float(free[at].std(ddof=1)) / math.sqrt(free.shape[1]),
            single_error=float(sums.std(ddof=1)) / count if len(prior) else 0.0,
            pairs=self.shares.pairs,
            other=self.shares.other,
            worst=row,
            worst_bias_m=self._told(faults.bias_m[worst], row) if worst >= 0 else math.nan,
            worst_fault_m=faults.bias_m[worst] if worst >= 0 else np.zeros(self.prior.size),
            nominal_m=self.nominal_m[at],
            faults=faults,
            worst_probability=float(chance[worst].mean()) if worst >= 0 else 0.0,
            worst_error=float(chance[worst].std(ddof=1)) / count if worst >= 0 else 0.0,
            unsettled=max(float(one.unsettled.mean()) for one in (self.free, faults.drawn) if one.unsettled.size),
        )

    def _told(self, fault_m: FloatArray, row: int) -> float:
        """The size of a fault on a row; infinite where it is the largest that was tried."""
        size = float(fault_m[row])
        root = abs(size) * math.sqrt(self.parts.redundancy[row]) / self.parts.sigma_m[row]
        return math.copysign(math.inf, size) if root > 0.5 * _ROOTS[-1] else size

    def alarm_rate(self, k: float, limit_m: float) -> float:
        """Share of alarms without a fault at k times the level, by the weights of the draws."""
        return float(self.free.weight @ self.free.alarms(k, limit_m)[0] / self.free.weight.sum())

    def rates_under_faults(
        self, k: float, limit_m: float, sizes_m: FloatArray, draws: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shares of draws at k times the level under each size on each satellite [m], each (sizes, n).

        They are alarms, and exclusions of the faulted satellite and of another one that go on without an alarm.
        """
        n = self.prior.size
        bias = np.repeat(self.nominal_m[:1], len(sizes_m) * n, axis=0).reshape(len(sizes_m), n, n)
        bias[:, np.arange(n), np.arange(n)] += sizes_m[:, None]
        drawn = self._drawn(bias.reshape(-1, n), draws, _LAST)
        alarms, faulted = drawn.alarms(k, limit_m), np.tile(np.arange(n), len(sizes_m))[:, None]
        right, wrong = drawn.excluded == faulted, (drawn.excluded >= 0) & (drawn.excluded != faulted)
        alarm, found, missed = (
            event.mean(axis=1).reshape(len(sizes_m), n) for event in (alarms, right & ~alarms, wrong & ~alarms)
        )
        return alarm, found, missed

    def multiplier(self, z: float) -> tuple[Contributions | None, float, float]:
        """Where the analysed modes take what the budget leaves, with bounds at ``z`` standard errors; None for nowhere.

        The worst sizes are those of a multiplier that is at most half a per cent from it, or ``settled`` is False.
        """
        # Faults only add to it.
        self.settled = False
        k = alone = _root(lambda k: self.shares.fault_free * self.free.beyond(k).mean(axis=1).max(), self.allowed)
        found = None
        for _ in range(_ROUNDS):
            if not math.isfinite(k):
                return None, math.inf, math.inf
            faults = self.worst_faults(max(k, _LEAST_K))

            def analysed(k: float, faults: WorstFaults = faults) -> float:
                return self.at(k, faults).analysed

            before, k = k, _root(analysed, self.allowed)
            if math.isfinite(k):
                found = self.at(max(k, _LEAST_K), faults)
                self.settled = abs(k - before) <= _CLOSE * before
                if self.settled:
                    break
        if found is None or k > max(_UNBOUNDED, _UNBOUNDED_TIMES * alone):
            return None, math.inf, math.inf
        if k <= _LEAST_K:
            return found, 0.0, found.k
        # The risk falls with the multiplier as a power of it over so short a way as to its bounds.
        power = math.log(found.analysed / max(analysed(_STEP * k), 1e-300)) / math.log(_STEP)
        reach = z * found.error / found.analysed
        low = k * (1.0 - min(reach, 0.99)) ** (1.0 / power)
        return found, low, k * (1.0 + reach) ** (1.0 / power)


def _root(risk: Callable[[float], float], allowed: float) -> float:
    """The multiplier at which a risk that falls with it is what is allowed; infinite beyond LARGEST_K."""
    from scipy import optimize

    def excess(log_k: float) -> float:
        return math.log(max(float(risk(math.exp(log_k))), 1e-300) / allowed)

    low = high = math.log(_FIRST_K)
    stride = _STRIDE
    while excess(high) > 0:
        low, high, stride = high, high + stride, 1.5 * stride
        if low > math.log(LARGEST_K):
            return math.inf
    while low == high or excess(low) <= 0:
        low, high = low - _STRIDE, low
        if high < math.log(_LEAST_K):
            return _LEAST_K
    return math.exp(optimize.brentq(excess, low, high, xtol=1e-4))


def z_of(confidence: float) -> float:
    return float(special.ndtri(confidence))
