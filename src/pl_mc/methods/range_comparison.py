"""Range comparison: the ranges of the redundant satellites, predicted from a solution without them."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import require_choice
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import Projections, covariance_of, largest_slopes, parity_basis, projections
from pl_mc.kernels.linear_model import COORDINATES, product, redundancy_floor
from pl_mc.methods.base import Named, Outcome
from pl_mc.methods.raim_levels import P_FA, P_MD, at_dof, decided, require_risks

MINIMAL, OTHERS = "minimal", "others"


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides.

    Attributes:
        comparisons: (n, n), row j times the residuals is prediction j minus its measurement, over its own standard
            deviation; zero rows where there is none.
        threshold: (), of the absolute value of each.
        levels: protection levels.
    """

    comparisons: Array
    threshold: Array
    levels: ProtectionLevels


@dataclass(frozen=True)
class RangeComparison(Named):
    """Range comparison (after Lee 1986): a range that differs too much from its prediction rejects.

    ``minimal``: t satellites determine the unknowns and predict the ranges of the n - t others, d = z_s - A_s
    A_b^-1 z_b, with covariance I + A_s (A_b'A_b)^-1 A_s' (in units of sigma). The geometry decides which ones serve
    as the base: the others are picked one by one as those that the rest misses least (`parity_basis`). ``others``:
    every satellite is predicted from all others, which is d_i = e_i / r_i with variance 1 / r_i. Each |d_j| over
    its standard deviation is compared with Q^-1(p_fa / (2 m)), m the number of comparisons, so that a false alarm
    has at most the probability p_fa (exactly that for m = 1, Bonferroni's inequality beyond).

    Levels: a fault of whitened size b moves comparison j by C_ji b; b_i is the size at which its largest one is
    found with probability 1 - p_md, (threshold + Q^-1(p_md)) / max_j |C_ji|, and PL = max |G_q,i| b_i. A fault with
    a larger mean error is missed with less than p_md; the noise of the position is neglected.

    Lee's paper ("Analysis of range and position comparison methods as a means to provide GPS integrity in the user
    receiver", ION Annual Meeting 1986) was not at hand. The idea, to compare ranges with those that a solution from
    other satellites predicts, is from works that cite it; the choice of the base, the standardisation, the shares
    of the false alarms and the levels are this file's own reading.

    An alarm means that some comparison rejects, or levels beyond VAL. Where a satellite moves the position and no
    comparison sees it there is no solution.

    Attributes:
        p_fa: largest false-alarm probability of all comparisons of a sample together.
        p_md: missed-detection probability behind the levels.
        base: ``minimal`` or ``others``.
    """

    key = "range_comparison"

    p_fa: float = P_FA
    p_md: float = P_MD
    base: str = MINIMAL

    def __post_init__(self) -> None:
        require_risks("range_comparison", p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.base, (MINIMAL, OTHERS), field="range_comparison: base")

    levels_from_geometry = True

    def prepare(self, model: LinearModel) -> Prepared:
        parts = projections(model)
        comparisons = _minimal(model, parts) if self.base == MINIMAL else parts.rows[:-COORDINATES]
        square = jnp.sum(comparisons * comparisons, axis=1)
        sound = square >= redundancy_floor(square.dtype)
        scale = jnp.where(sound, jax.lax.rsqrt(jnp.where(sound, square, 1.0)), 0.0)
        comparisons = comparisons * scale[:, None]
        number = jnp.sum(sound, dtype=square.dtype)
        threshold = at_dof(_quantiles(model.design.shape[0], self.p_fa), number)
        gain = parts.rows[-COORDINATES:]
        seen = jnp.max(comparisons * comparisons, axis=0)
        horizontal, vertical = largest_slopes(gain, seen, covariance_of(gain))
        # A p_md above one half needs less than the threshold, but never less than nothing.
        size = jnp.maximum(threshold - float(special.ndtri(self.p_md)), 0.0)
        return Prepared(comparisons, threshold, ProtectionLevels(hpl_m=horizontal * size, vpl_m=vertical * size))

    def statistic(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Array:
        return _largest(prepared, start) / prepared.threshold

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        rejects = _largest(prepared, start) > prepared.threshold
        return decided(model.available, start.state[:COORDINATES], prepared.levels, rejects)


def _largest(prepared: Prepared, start: LeastSquaresSolution) -> Array:
    """(...), the largest comparison."""
    return jnp.max(jnp.abs(product(prepared.comparisons, start.residuals)), axis=0)


def _minimal(model: LinearModel, parts: Projections) -> Array:
    """(n, n), row k: the comparison of redundant satellite k with its prediction from the base, in whitened ranges.

    With R_ss = L L' for the redundant satellites s, d = R_ss^-1 R_s z = L^-T Q z, Q the parity basis with pivots s.
    """
    basis, pivots = parity_basis(model, parts)
    lower = product(pivots, basis.T)
    n = lower.shape[0]
    numbers = jnp.arange(n, dtype=jnp.int32)

    def add_row(k: Array, inverse: Array) -> Array:
        here = numbers == k
        unit = here.astype(lower.dtype)
        row = product(unit, lower)
        pivot = product(row, unit)
        known = product(row, inverse)
        found = jnp.where(pivot > 0, (unit - known) / jnp.where(pivot > 0, pivot, 1.0), 0.0)
        return jnp.where(here[:, None], found[None], inverse)

    inverse = jax.lax.fori_loop(0, n, add_row, jnp.zeros_like(lower))
    return product(inverse.T, basis)


def _quantiles(most: int, p_fa: float) -> FloatArray:
    """(most + 1,), Q^-1(p_fa / (2 m)) by the number m of comparisons; that of one for none."""
    return np.asarray(-special.ndtri(p_fa / (2.0 * np.maximum(np.arange(most + 1), 1))))
