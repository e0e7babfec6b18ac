"""How large a bias is: the distributions from which a risk budget takes the sizes of faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special, stats

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError, require_choice

# Sizes of one satellite are integrated over their distribution function: panels with Gauss-Legendre nodes in each.
# Rare sizes may be the dangerous ones, and a quantile changes ever faster towards 0 and 1: decades at either end.
_NODES = 8
_ENDS = np.concatenate([[0.0], np.logspace(-12, -2, 21)])
_EDGES = np.concatenate([_ENDS, np.linspace(0.01, 0.99, 41)[1:-1], 1.0 - _ENDS[::-1]])
# For a method whose probabilities are estimates every size costs a run of the estimator.
_FEW_EDGES = np.array([0.0, 0.5, 1.0])


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
            values = np.atleast_1d(np.asarray(bias, dtype=float))
            chance = np.ones(values.shape) if weights is None else np.asarray(weights, dtype=float)
        except (TypeError, ValueError):
            raise InputError(
                "bias: 'worst', a distribution such as ('uniform', 5, 100) or an array of sizes in metres is "
                f"needed, not {bias!r}."
            ) from None
        if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
            raise InputError("bias: an array of sizes is one row of finite numbers of metres.")
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
            raise InputError(f"bias: {bias!r} is unknown (valid: worst, ('uniform', 5, 100), sizes in metres).")
        return None
    name, *parameters = bias
    known = [item for item in dir(stats) if isinstance(getattr(stats, item), stats.rv_continuous)]
    require_choice(name, known, field="bias")
    if name == "uniform":
        if len(parameters) != 2 or not parameters[0] < parameters[1]:
            raise InputError(
                f"bias: 'uniform' takes two sizes in order, such as ('uniform', 5, 100), not {bias!r}."
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
