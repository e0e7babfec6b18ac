"""A protection level for any estimate, from its separation from the solutions that a fault cannot have touched.

The solution x_(-k) without the satellites of fault mode k is, under that mode, a clean weighted least-squares solution
whatever the fault is. So with x the truth and x_R any estimate of it, and in each of east, north and up,

    |x_R - x| <= |x_R - x_(-k)| + |x_(-k) - x|,   and   P(|x_(-k) - x| > K_k sigma_(-k) + b_k | k) <= 2 Q(K_k),

Q the tail of the normal distribution, b_k what nominal biases do to x_(-k) at most. A level that holds
|x_R - x_(-k)| + K_k sigma_(-k) + b_k of every monitored mode k, the fault-free one (nothing left out) among them, is
therefore exceeded with at most sum_k P_k 2 Q(K_k): how x_R was made, and what it made of the fault, does not count.
That is solution separation (Brenner 1996, Integrated GPS/inertial fault detection availability, NAVIGATION 43) with
the separation itself in the place of the threshold that it has to pass. K_k must not depend on the errors. Those with
K_k sigma_(-k) + b_k = T for every k make the largest of these sums least, and then

    PL = T + max_k |x_R - x_(-k)|,   sum_k P_k 2 Q((T - b_k) / sigma_(-k)) = P_HMI,q (1 - p_lost / P_HMI).

A fault on satellite j moves all solutions but those without j, and so the largest separation. But then residuals of
these solutions show it. A mode is left out of the maximum where they refute it: where the square sum of the residuals
of its own subset is beyond its quantile of probability 1 - p. Under mode k that sum is a chi-square variable, whatever
x_R is, so that leaving modes out costs at most sum_k P_k p_k, which belongs to p_lost as the prior of what is not
monitored does. Where nominal biases b shift the residuals, the root of the quantile is raised by |b / sigma|, by which
the length of a vector grows at the most. Where all modes are refuted there is an alarm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.araim.compiled_modes import compiled_modes
from pl_mc.araim.risk_equations import protection_level
from pl_mc.input_errors import InputError, require_choice, require_number
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import COORDINATES, product
from pl_mc.kernels.small_matrix import cholesky, lower_triangle, pivot_floor, solve
from pl_mc.methods.base import Estimator, Outcome
from pl_mc.methods.danish import Danish
from pl_mc.methods.hampel import Hampel
from pl_mc.methods.huber import Huber
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.l1 import L1
from pl_mc.methods.ls import Ls
from pl_mc.methods.mm import MM
from pl_mc.methods.monitoring import Monitoring
from pl_mc.methods.raim_levels import at_dof, thresholds
from pl_mc.methods.tukey import Tukey

ESTIMATES: dict[str, type[Estimator]] = {
    cls.key: cls for cls in (Ls, Igg3, Huber, Tukey, Hampel, Danish, L1, MM)
}  # fmt: skip
MIDRANGE = "midrange"

# The fault-free case is about so much more probable than a fault of one satellite, and refuted so much more seldom.
_FAULT_FREE_SHARE = 1e-4


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides. Modes stand in blocks, the fault-free one first in the first.

    Attributes:
        gain: (blocks, 3 modes, n), x_(-k) less the least-squares solution, per whitened residual [m].
        residuals: (blocks, modes n, n), whitened residuals of each subset, of those of all satellites.
        root: (blocks, modes), length of these residuals beyond which a mode is refuted; infinite where it never is.
        monitored: (blocks, modes).
        level_m: (3,), T of east, north and up [m].
        available: (), whether there are levels.
    """

    gain: Array
    residuals: Array
    root: Array
    monitored: Array
    level_m: Array
    available: Array


@dataclass(frozen=True)
class Separated(Monitoring):
    """A robust estimate whose level is proven: its separation from the solutions that a fault cannot have touched.

    Priors, nominal biases, budget and ISM are options of `pl_mc.methods.Monitoring`. An alarm means that the level is
    beyond the limit, or that the residuals refute every monitored mode.

    Attributes:
        estimate: whose error the level bounds: the name or record of ``ls`` or of a reweighted estimate; or
            ``midrange``, the middle of the solutions that are not refuted, in each coordinate: of all estimates it is
            the one with the smallest largest separation.
        p_refuted: probability with which a fault mode may be refuted though it is true, 1e-4 times that for the
            fault-free one; zero, and none is ever refuted.
    """

    key = "separated"

    estimate: Any = "igg3"
    p_refuted: float = 1e-5

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= require_number(self.p_refuted, field="separated: p_refuted") < 0.1:
            raise InputError(f"separated: p_refuted: from 0 to below 0.1, not {self.p_refuted!r}.")
        if isinstance(self.estimate, str) and self.estimate != MIDRANGE:
            name = require_choice(self.estimate, (*ESTIMATES, MIDRANGE), field="separated: estimate")
            object.__setattr__(self, "estimate", ESTIMATES[name]())
        elif not isinstance(self.estimate, str | Estimator):
            raise InputError(
                f"separated: estimate: one of {', '.join((*ESTIMATES, MIDRANGE))} is needed, or a record of one, "
                f"not {self.estimate!r}."
            )

    def prepare(self, model: LinearModel) -> Prepared:
        priors = self._priors
        modes = compiled_modes(model, priors)
        n, dtype = model.design.shape[0], model.design.dtype
        # All single faults are one block, the fault-free case before them.
        width = 1 + n + priors.constellations(model.design.shape[1] - COORDINATES)
        excluded = jnp.concatenate([jnp.zeros((1, n), bool), modes.excluded])
        probability = jnp.concatenate([jnp.ones(1, dtype), modes.probability])
        blocks = -(-probability.shape[0] // width)
        surplus = blocks * width - probability.shape[0]
        excluded = jnp.pad(excluded, ((0, surplus), (0, 0))).reshape(blocks, width, n)
        gain, residuals, dof, regular = jax.lax.map(lambda block: _subsets(model, block), excluded)
        probability = jnp.pad(probability, (0, surplus)).reshape(blocks, width)
        monitored = regular & (probability > 0)
        bias = (self._nominal_m(model) * model.weight_root)[:, None, None]
        # Per whitened observation, (blocks, 3, n, modes).
        sigma_m = jnp.sqrt(jnp.sum(gain * gain, axis=2))
        bias_m = jnp.sum(jnp.abs(gain) * bias[:, 0], axis=2)
        refutable = jnp.full(probability.shape, self.p_refuted, dtype).at[0, 0].multiply(_FAULT_FREE_SHARE)
        refutable = jnp.where(dof >= 1, refutable, 0.0)
        lost = modes.p_not_monitored + jnp.sum(jnp.where(monitored, refutable, 1.0) * probability)
        share = 1.0 - lost / self.budget.p_hmi
        available = model.determined & monitored[0, 0] & (share > 0)
        horizontal, vertical = self.budget.p_hmi_horizontal / 2.0, self.budget.p_hmi_vertical
        live = monitored & available

        def flat(values: Array, other: float) -> Array:
            """(3, modes, 1), and a number where nothing is monitored."""
            return jnp.where(live[:, None], values, other).transpose(1, 0, 2).reshape(COORDINATES, -1, 1)

        level = protection_level(
            flat(sigma_m, 1.0),
            flat(bias_m, 0.0),
            # Both tails of each.
            jnp.where(live, 2.0 * probability, 0.0).reshape(-1, 1),
            jnp.asarray([horizontal, horizontal, vertical], dtype)[:, None] * jnp.where(available, share, 1.0),
        )[:, 0]
        return Prepared(
            gain=(gain - model.gain[None, :COORDINATES, :, None]).transpose(0, 1, 3, 2).reshape(blocks, -1, n),
            residuals=residuals,
            root=self._roots(model, excluded, dof, bias[:, 0, 0]),
            monitored=monitored,
            level_m=level,
            available=available,
        )

    def _nominal_m(self, model: LinearModel) -> Array:
        """(n,) or (), largest nominal bias [m]."""
        if self.ism is not None and self.ism.has("b_nom_m"):
            return self._said("b_nom_m", model)
        return jnp.full_like(model.weight_root, self.b_nom_m)

    def _roots(self, model: LinearModel, excluded: Array, dof: Array, bias: Array) -> Array:
        """(blocks, modes), `Prepared.root`; ``bias`` (n,) are nominal biases over sigma."""
        if self.p_refuted == 0:
            return jnp.full(dof.shape, jnp.inf, model.design.dtype)
        n = model.design.shape[0]
        dof = dof.astype(model.design.dtype)
        fault, none = (at_dof(thresholds(n, p), dof) for p in (self.p_refuted, _FAULT_FREE_SHARE * self.p_refuted))
        square = fault.at[0, 0].set(none[0, 0])
        length = jnp.sqrt(jnp.sum(jnp.where(excluded, 0.0, bias * bias), axis=2))
        return jnp.sqrt(square) + length

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        n, lanes = start.residuals.shape[0], start.square_sum.shape
        width = prepared.root.shape[1]

        def add_block(ends: tuple[Array, Array], block: tuple[Array, ...]) -> tuple[tuple[Array, Array], None]:
            gain, residuals, root, monitored = block
            shift = product(gain, start.residuals).reshape(COORDINATES, width, *lanes)
            own = product(residuals, start.residuals).reshape(width, n, *lanes)
            square = jnp.sum(own * own, axis=1)
            shape = (width,) + (1,) * len(lanes)
            stands = monitored.reshape(shape) & (square <= jnp.square(root).reshape(shape))
            low = jnp.min(jnp.where(stands[None], shift, jnp.inf), axis=1)
            high = jnp.max(jnp.where(stands[None], shift, -jnp.inf), axis=1)
            return (jnp.minimum(ends[0], low), jnp.maximum(ends[1], high)), None

        nothing = jnp.full((COORDINATES, *lanes), jnp.inf, start.state.dtype)
        blocks = (prepared.gain, prepared.residuals, prepared.root, prepared.monitored)
        (low, high), _ = jax.lax.scan(add_block, (nothing, -nothing), blocks)
        refuted = low[0] > high[0]
        low, high = (jnp.where(refuted, 0.0, end) for end in (low, high))
        least_squares = start.state[:COORDINATES]
        if isinstance(self.estimate, str):
            available = jnp.broadcast_to(prepared.available & model.determined, lanes)
            from_ls, change_m, tied = 0.5 * (low + high), None, None
        else:
            estimate = self.estimate._estimate(model, start)
            available = estimate.available & prepared.available
            from_ls = jnp.where(available, estimate.state[:COORDINATES] - least_squares, 0.0)
            change_m, tied = estimate.change_m, estimate.tied
        separation = jnp.maximum(from_ls - low, high - from_ls)
        level = prepared.level_m.reshape((COORDINATES,) + (1,) * len(lanes)) + separation
        return Outcome(
            error_m=jnp.where(available, least_squares + from_ls, jnp.inf),
            hpl_m=jnp.where(available, jnp.hypot(level[0], level[1]), jnp.inf),
            vpl_m=jnp.where(available, level[2], jnp.inf),
            available=available,
            rejects=available & refuted,
            change_m=change_m,
            tied=tied,
        )


def _subsets(model: LinearModel, excluded: Array) -> tuple[Array, Array, Array, Array]:
    """Solutions without the satellites of some modes (m, n).

    Returns:
        Gain (3, n, m) [m per whitened observation], residuals of kept satellites of those of all of them (m n, n),
        degrees of freedom (m,), and (m,) whether the satellites that are left determine a position; where not, all is
        finite and meaningless.
    """
    n, t = model.design.shape
    kept = (model.in_view > 0)[None] & ~excluded
    mask = kept.astype(model.design.dtype)
    clocks = product(mask, (model.design[:, COORDINATES:] != 0).astype(mask.dtype)) > 0
    idle = jnp.concatenate([jnp.zeros((COORDINATES, mask.shape[0]), bool), ~clocks.T]).astype(mask.dtype)
    diagonal = [k for k, (row, column) in enumerate(lower_triangle(t)) if row == column]
    packed = product(model.products[:-1], mask.T).at[jnp.asarray(diagonal)].add(idle)
    factor = cholesky(packed, pivot_floor(packed[jnp.asarray(diagonal)]))
    # (t, n, m): a row of the design for each satellite that is kept.
    gain = jnp.stack(solve(factor, list(model.design_rows[:, :, None] * mask.T[None])))
    fitted = jnp.einsum("kt,tnm->mkn", model.design, gain, precision=jax.lax.Precision.HIGHEST)
    residuals = mask[:, :, None] * (jnp.eye(n, dtype=mask.dtype)[None] - fitted)
    unknowns = COORDINATES + jnp.sum(clocks, axis=1, dtype=jnp.int32)
    dof = jnp.sum(kept, axis=1, dtype=jnp.int32) - unknowns
    return gain[:COORDINATES], residuals.reshape(-1, n), dof, factor.regular & (dof >= 0)
