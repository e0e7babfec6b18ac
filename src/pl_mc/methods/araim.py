"""ARAIM: least squares, tested by solution separation against every fault mode (ADD v3.0, detection only).

What the modes and the levels are is explained in `pl_mc.araim`; here they come out of the model of one geometry,
inside the compiled sweep. Satellites that share a clock column are a constellation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.araim.compiled_modes import compiled_modes
from pl_mc.araim.levels import protection_levels
from pl_mc.araim.risk_equations import Priors, figures, solve_levels
from pl_mc.araim.solving import Subsets, Whole, fit_subsets
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import EAST, NORTH, UP
from pl_mc.input_errors import require_positive
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import COORDINATES, per_lane, product
from pl_mc.methods.base import Outcome
from pl_mc.methods.monitoring import Monitoring

# Arguments of the method's levels that a field of an ISM stands for.
_ARGUMENTS = {"c_acc": "sigma_ure_m", "b_nom": "b_nom_m", "p_sat": "p_sat", "p_const": "p_const"}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides. Tests stand in blocks, three (east, north, up) for each of a block's fault modes.

    Attributes:
        gain: (blocks, tests, n), separation per whitened residual [m].
        limit_m: (blocks, tests), largest separation that passes [m]; infinite where a mode is not monitored.
        used: (blocks,), whether any mode of a block is monitored.
        hpl_m, vpl_m: (), protection levels [m].
        available: (), whether there are any.
    """

    gain: Array
    limit_m: Array
    used: Array
    hpl_m: Array
    vpl_m: Array
    available: Array


@dataclass(frozen=True)
class Araim(Monitoring):
    """Advanced RAIM with the model's sigma as that of the integrity model.

    There is no solution where there are no levels: where the satellites left by a fault more probable than the
    integrity risk determine no position. So a single constellation with a ``p_const`` of 1e-4 is unavailable. With as
    many satellites as unknowns no mode can be tested, and there are levels if no fault needs to be.

    Fault modes are single satellites and constellations, and pairs of them wherever P_THRES asks for them; whether
    it can for that many rows and clocks is decided when the sweep is compiled. Combinations of three are never
    monitored: what they leave above P_THRES takes from the integrity risk.

    Priors, nominal biases, budget and ISM are options that all methods have that monitor fault modes:
    `pl_mc.methods.Monitoring`. With the sigma_URE of an ISM the variance of the accuracy model is that of the model,
    less sigma_URA^2, plus sigma_URE^2.

    Attributes:
        accuracy_ratio: sigma of the accuracy model over that of the integrity model. The sweep's noise has the
            latter, so with a smaller ratio false alerts are more frequent than the budget says.
    """

    key = "araim"

    accuracy_ratio: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self.accuracy_ratio, field="araim: accuracy_ratio")

    levels_from_geometry = True
    levels_without_redundancy = True

    def batched_levels(
        self, design: FloatArray, sigma_m: FloatArray, in_view: NDArray[np.bool_], systems: NDArray[np.str_],
        names: NDArray[np.str_] | None = None,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """The levels of `pl_mc.araim`, with the sigma of the model as that of the integrity model."""
        variance = sigma_m**2
        letters = sorted(set(np.unique(systems).tolist()) - {""})
        if not letters:
            nothing = np.full(len(variance), np.inf)
            return nothing, nothing
        own: dict[str, Any] = {
            "c_acc": self.accuracy_ratio**2 * variance, "b_nom": self.b_nom_m, "p_sat": self.p_sat,
            "p_const": dict.fromkeys(letters, self.p_const),
        }  # fmt: skip
        if self.ism is not None:
            own = {name: value for name, value in own.items() if not self.ism.has(_ARGUMENTS[name])}
            own |= {"ism": self.ism, "names": names}
        levels = protection_levels(
            design, variance, systems=systems.tolist(), budget=self.budget, unmonitored=self.unmonitored,
            in_view=in_view, **own,
        )  # fmt: skip
        return levels.hpl_m, levels.vpl_m

    def prepare(self, model: LinearModel) -> Prepared:
        priors = self._priors
        modes = compiled_modes(model, priors)
        n, t = model.design.shape
        # All single faults are one block. Pairs are many and seldom needed: blocks without any are passed over.
        width = n + priors.constellations(t - COORDINATES)
        blocks = -(-modes.probability.shape[0] // width)
        surplus = blocks * width - modes.probability.shape[0]
        excluded = jnp.pad(modes.excluded, ((0, surplus), (0, 0))).reshape(blocks, width, n)
        probability = jnp.pad(modes.probability, (0, surplus)).reshape(blocks, width)
        used = jnp.any(probability > 0, axis=1)
        if blocks == 1:
            whole, subsets = jax.tree.map(lambda leaf: leaf[None], self._fit(model, excluded[0]))
        else:
            whole, subsets = jax.lax.map(
                lambda block: jax.lax.cond(block[0], self._fit, self._nothing, model, block[1]),
                (used.at[0].set(True), excluded),
            )
        # (blocks, 3, m, 1) to (3, blocks m, 1).
        sigma, bias, separation = (
            jnp.moveaxis(leaf, 0, 1).reshape(3, blocks * width, 1)
            for leaf in (subsets.sigma_m, subsets.bias_m, subsets.sigma_separation_m)
        )
        levels = solve_levels(
            jax.tree.map(lambda leaf: leaf[0], whole),
            Subsets(subsets.difference, sigma, bias, separation, subsets.regular.reshape(blocks * width, 1)),
            Priors(probability.reshape(blocks * width, 1), modes.p_not_monitored[None]),
            figures(self.budget, blocks * width),
        )
        available = model.determined & levels.available[0]
        level = jnp.where(available, levels.level_m[:, 0], jnp.inf)
        threshold = levels.threshold_m[..., 0].reshape(3, blocks, width)
        return Prepared(
            # (blocks, 3, n, m) to (blocks, 3, m, n): one row for each test.
            gain=jnp.swapaxes(subsets.difference[..., 0], 2, 3).reshape(blocks, 3 * width, n),
            limit_m=jnp.moveaxis(threshold, 1, 0).reshape(blocks, 3 * width),
            used=used,
            hpl_m=jnp.sqrt(level[EAST] ** 2 + level[NORTH] ** 2),
            vpl_m=level[UP],
            available=available,
        )

    def statistic(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Array:
        """The largest ratio of a separation and its limit."""
        limit = prepared.limit_m.reshape(-1)
        # Modes that are not monitored have an infinite limit.
        inverse = jnp.where(jnp.isfinite(limit) & (limit > 0), 1.0 / jnp.where(limit > 0, limit, 1.0), 0.0)
        gain = prepared.gain.reshape(limit.shape[0], -1) * inverse[:, None]
        ratio = jnp.max(jnp.abs(product(gain, start.residuals)), axis=0)
        return jnp.where(prepared.available, ratio, jnp.inf)

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        shape = start.square_sum.shape

        def exceeds(gain: Array, limit_m: Array) -> Array:
            # Subset and full solution agree on what the model explains, so residuals are all that separates them.
            separation = jnp.abs(product(gain, start.residuals))
            return jnp.any(separation > per_lane(limit_m, separation), axis=0)

        def add_block(rejects: Array, block: tuple[Array, Array, Array]) -> tuple[Array, None]:
            gain, limit_m, used = block
            return rejects | jax.lax.cond(used, exceeds, lambda *_: jnp.zeros(shape, bool), gain, limit_m), None

        rejects = exceeds(prepared.gain[0], prepared.limit_m[0])
        if prepared.gain.shape[0] > 1:
            rest = (prepared.gain[1:], prepared.limit_m[1:], prepared.used[1:])
            rejects, _ = jax.lax.scan(add_block, rejects, rest)
        available = jnp.broadcast_to(prepared.available, shape)
        return Outcome(
            error_m=jnp.where(available, start.state[:3], jnp.inf),
            hpl_m=jnp.broadcast_to(prepared.hpl_m, shape),
            vpl_m=jnp.broadcast_to(prepared.vpl_m, shape),
            available=available,
            rejects=available & rejects,
        )

    def _fit(self, model: LinearModel, excluded: Array) -> tuple[Whole, Subsets]:
        """The solution with all satellites and those of some modes (modes, n), for a single geometry."""
        root, dtype = model.weight_root, model.design.dtype
        bias_m, accuracy = jnp.asarray(self.b_nom_m, dtype), jnp.full(root.shape, self.accuracy_ratio**2, dtype)
        if self.ism is not None and self.ism.has("b_nom_m"):
            bias_m = self._said("b_nom_m", model)
        if self.ism is not None and self.ism.has("sigma_ure_m"):
            change = self._said("sigma_ure_m", model) ** 2 - self._said("sigma_ura_m", model) ** 2
            accuracy = jnp.maximum(1.0 + change * root**2, 0.0)
        return fit_subsets(
            model.design[..., None],
            (model.in_view > 0)[:, None],
            excluded.T[..., None],
            (bias_m * root)[:, None],
            accuracy[:, None],
        )

    def _nothing(self, model: LinearModel, excluded: Array) -> tuple[Whole, Subsets]:
        """Zeros of the shape of `_fit`."""
        shapes = jax.eval_shape(self._fit, model, excluded)
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
