"""Faults of a risk budget: what has failed, with what prior probability, and how large its biases are.

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
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.faults import MOST_BIAS_M
from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.input_errors import InputError, require_choice, require_numbers, shown
from pl_mc.ism import Ism

# Priors of a satellite and of a constellation, unless somebody says others (ADD v3.0, appendix D).
P_SAT, P_CONST = 1e-5, 1e-4

INDEPENDENT, COMMON = "independent", "common"
FAULT_FREE, SATELLITE, PAIR, CONSTELLATION = "fault_free", "satellite", "pair", "constellation"
MIXED, CONSTELLATIONS = "constellation_and_satellite", "constellations"

# Sizes of one satellite are integrated over their distribution function: panels with Gauss-Legendre nodes in each.
# Rare sizes may be the dangerous ones, and a quantile changes ever faster towards 0 and 1: decades at either end.
_NODES = 8
_ENDS = np.concatenate([[0.0], np.logspace(-12, -2, 21)])
_EDGES = np.concatenate([_ENDS, np.linspace(0.01, 0.99, 41)[1:-1], 1.0 - _ENDS[::-1]])
# For a method whose probabilities are estimates every size costs a run of the estimator.
_FEW_EDGES = np.array([0.0, 0.5, 1.0])


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

    Priors are those of the n satellites of one epoch, and by RINEX letter those of the systems in view.
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
    g: Geometry, p_sat: float | Mapping[str, float], p_const: float | Mapping[str, float], ism: Ism | None = None
) -> tuple[list[float], dict[str, float]]:
    """Of every satellite, and of every constellation in view; what an ISM says of them comes before the rest."""

    def checked(value: Any, field: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 <= value < 1.0:
            raise InputError(f"{field}: a prior probability lies between 0 and 1 (1 excluded), not {shown(value)}.")
        return float(value)

    def chosen(given: Mapping[str, float], keys: Sequence[str], field: str) -> float:
        for key in keys:
            if key in given:
                return checked(given[key], f"{field} of {key}")
        raise InputError(f"{field}: {keys[0]} is missing; a probability for each is needed, by name or by system.")

    letters = list(dict.fromkeys(g.systems))
    if ism is not None:
        for field, given, usual in (("p_sat", p_sat, P_SAT), ("p_const", p_const, P_CONST)):
            if ism.has(field) and given != usual:
                raise InputError(f"{field}: the ism has it too; leave one of the two out.")
        if not ism.has("p_const"):
            ism.with_field("p_sat")
        if ism.has("p_sat"):
            p_sat = dict(zip(g.names, ism.values("p_sat", g.names, g.systems).tolist(), strict=True))
        if ism.has("p_const"):
            p_const = dict(zip(letters, ism.values("p_const", letters, letters).tolist(), strict=True))
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


@dataclass(frozen=True)
class Sizes:
    """The distribution of the size of a bias.

    Attributes:
        values_m: (k,), sizes for which one satellite is computed [m], with ``weights`` (k,) that sum to 1.
        few_m, few_weights: the same with few sizes, where each is costly.
        quantile: the size at a probability (...), for draws [m].
        random_sign: whether either sign is equally likely.
    """

    values_m: FloatArray
    weights: FloatArray
    few_m: FloatArray
    few_weights: FloatArray
    quantile: Any
    random_sign: bool

    @classmethod
    def of(cls, bias: Any, weights: ArrayLike | None, signs: str) -> Sizes:
        """From what `risk_budget` is given."""
        require_choice(signs, ("random", "positive"), field="signs")
        random_sign = signs == "random"
        frozen = _distribution(bias)
        if frozen is not None:
            if weights is not None:
                raise InputError("weights: they belong to an array of sizes, not to a distribution.")
            (share, weight), (few, few_weight) = (_unit_rule(edges) for edges in (_EDGES, _FEW_EDGES))
            found = cls(frozen.ppf(share), weight, frozen.ppf(few), few_weight, frozen.ppf, random_sign)
            if not np.isfinite(found.values_m).all():
                raise InputError("bias: the distribution gives sizes that are not finite.")
            return found
        try:
            values = np.atleast_1d(require_numbers(bias, field="bias"))
        except InputError:
            raise InputError(
                "bias: 'worst', a distribution such as ('uniform', 5, 100) or an array of sizes in metres is "
                f"needed, not {shown(bias)}."
            ) from None
        chance = np.ones(values.shape) if weights is None else require_numbers(weights, field="weights")
        if values.ndim != 1 or values.size == 0 or not (np.abs(values) <= MOST_BIAS_M).all():
            raise InputError(f"bias: an array of sizes is one row of finite numbers of metres, up to {MOST_BIAS_M:g}.")
        if chance.shape != values.shape or not (np.isfinite(chance).all() and (chance >= 0).all() and chance.any()):
            raise InputError(f"weights: {values.size} numbers are needed, none negative and not all zero.")
        chance = chance / chance.sum()
        steps = np.cumsum(chance)

        def quantile(share: FloatArray) -> FloatArray:
            return values[np.minimum(np.searchsorted(steps, share), values.size - 1)]

        return cls(values, chance, values, chance, quantile, random_sign)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
        """Sizes with their signs [m]."""
        size = self.quantile(rng.uniform(size=shape))
        return size * rng.choice([-1.0, 1.0], size=shape) if self.random_sign else size


def _distribution(bias: Any) -> Any:
    """The frozen distribution that is meant, or None for an array."""
    if hasattr(bias, "ppf"):
        return bias
    if not (isinstance(bias, tuple) and bias and isinstance(bias[0], str)):
        if isinstance(bias, str):
            raise InputError(f"bias: {shown(bias)} is unknown (valid: worst, ('uniform', 5, 100), sizes in metres).")
        return None
    from scipy import stats

    name, *parameters = bias
    known = [item for item in dir(stats) if isinstance(getattr(stats, item), stats.rv_continuous)]
    require_choice(name, known, field="bias")
    if name == "uniform":
        if len(parameters) != 2 or not parameters[0] < parameters[1]:
            raise InputError(
                f"bias: 'uniform' takes two sizes in order, such as ('uniform', 5, 100), not {shown(bias)}."
            )
        return stats.uniform(parameters[0], parameters[1] - parameters[0])
    try:
        frozen = getattr(stats, name)(*parameters)
        middle = frozen.ppf(0.5)
    except (TypeError, ValueError) as error:
        raise InputError(f"bias: {name} cannot be made from {tuple(parameters)} ({error}).") from None
    if not np.isfinite(middle):
        raise InputError(f"bias: {tuple(parameters)} are no parameters of {name}.")
    return frozen


def _unit_rule(edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and weights of a composite Gauss-Legendre rule on [0, 1]."""
    points, weights = special.roots_legendre(_NODES)
    width = np.diff(edges)[:, None]
    return (edges[:-1, None] + width * (points + 1.0) / 2.0).reshape(-1), (width * weights / 2.0).reshape(-1)
