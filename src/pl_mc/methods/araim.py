"""ARAIM: least squares, tested by solution separation against every fault mode (ADD v3.0 or v4.2).

What the modes and the levels are is explained in `pl_mc.araim`; here they come out of the model of one geometry,
inside the compiled sweep. Satellites that share a clock column are a constellation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.araim.budget import RATES, RATES_NEEDED, V3, V42, require_standard
from pl_mc.araim.compiled_exposure_modes import compiled_exposure_modes
from pl_mc.araim.compiled_exposure_modes import without as without_rows
from pl_mc.araim.compiled_modes import CompiledModes, compiled_modes
from pl_mc.araim.exclusion import SATELLITES
from pl_mc.araim.levels import protection_levels
from pl_mc.araim.modes import CONTAINED
from pl_mc.araim.risk_equations import Priors, figures, solve_levels
from pl_mc.araim.solving import Subsets, Whole, fit_subsets
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import EAST, NORTH, UP
from pl_mc.input_errors import InputError, require_choice, require_positive
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import COORDINATES, per_lane, product
from pl_mc.methods.base import Outcome
from pl_mc.methods.monitoring import Monitoring
from pl_mc.methods.raim_levels import at_dof, require_risks, thresholds

NONE = "none"

# Arguments of the method's levels that a field of an ISM stands for.
_ARGUMENTS = {"c_acc": "sigma_ure_m", "b_nom": "b_nom_m", "p_sat": "p_sat", "p_const": "p_const"}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Position:
    """The tests and levels of one position. Tests stand in blocks, three (east, north, up) for each of a block's modes.

    Attributes:
        gain: (blocks, tests, n), separation per whitened residual [m].
        limit_m: (blocks, tests), largest separation that passes [m]; infinite where a mode is not monitored.
        used: (blocks,), whether any mode of a block is monitored.
        step: (3, n), what a whitened residual adds to the position of all in view [m].
        hpl_m, vpl_m: (), protection levels [m].
        available: (), whether there are any.
    """

    gain: Array
    limit_m: Array
    used: Array
    step: Array
    hpl_m: Array
    vpl_m: Array
    available: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides: the position of all in view, and with exclusion those without each row.

    Attributes:
        whole: of all in view.
        without: each leaf has an axis of rows (n,) in front; None without exclusion.
        prior: (n,), of the fault of each satellite, zero where it cannot be excluded.
    """

    whole: Position
    without: Position | None
    prior: Array


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

    With an exclusion a failed test, or a V'PV that is too large, is not yet an alarm. Satellites are left out one at a
    time, in the order of their priors and of how well the others then agree: 2 ln P - V'PV of the rest, the
    likeliest first if any size of a fault is as likely as any other. The first whose rest passes all tests that are
    left, at their own thresholds, and that of its V'PV, is excluded, and position and levels are those of the rest.
    If there is none the scenario alarms. Every position takes an equal part of the integrity risk, so that the
    levels hold for whichever is used: those of `pl_mc.araim.protection_levels` with the same ``exclusion``, position
    by position.

    Attributes:
        accuracy_ratio: sigma of the accuracy model over that of the integrity model. The sweep's noise has the
            latter, so with a smaller ratio false alerts are more frequent than the budget says.
        standard: ``v3``, or ``v4.2`` with priors over an exposure, which an ``ism`` says; its budget is then one
            such as `pl_mc.araim.LPV_200_V42`.
        exclusion: ``none``, or ``satellites``.
        p_fa_chi2: false-alarm probability of V'PV with an exclusion, a check of what no mode explains (1e-8, ADD).
    """

    key = "araim"

    accuracy_ratio: float = 1.0
    standard: str = V3
    exclusion: str = NONE
    p_fa_chi2: float = 1e-8

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self.accuracy_ratio, field="araim: accuracy_ratio")
        require_choice(self.exclusion, (NONE, SATELLITES), field="araim: exclusion")
        require_standard(self.standard, self.budget, of="araim: ")
        require_risks("araim", p_fa_chi2=self.p_fa_chi2)
        if self.exclusion == NONE and self.p_fa_chi2 != type(self).p_fa_chi2:
            raise InputError(
                "araim: p_fa_chi2: it has no effect without an exclusion (nearest: exclusion='satellites')."
            )
        if self.standard == V42:
            if self.unmonitored != CONTAINED:
                raise InputError("araim: unmonitored: it belongs to standard 'v3'; 'v4.2' has consolidation.")
            if self.budget.exposure_h > 0 and not (self.ism is not None and all(map(self.ism.has, RATES))):
                raise InputError(f"araim: {RATES_NEEDED}")

    @property
    def levels_from_geometry(self) -> bool:
        """Whether no residual decides which position, and so which level, is used."""
        return self.exclusion == NONE

    @property
    def names_exclusions(self) -> bool:
        """Whether outcomes say which satellite was left out, so that sweeps count exclusions."""
        return self.exclusion != NONE

    levels_without_redundancy = True

    def batched_levels(
        self, design: FloatArray, sigma_m: FloatArray, in_view: NDArray[np.bool_], systems: NDArray[np.str_],
        names: NDArray[np.str_] | None = None,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """The levels of `pl_mc.araim`, with the sigma of the model as that of the integrity model.

        With an exclusion they are what is predicted: the largest over all positions.
        """
        if self.exclusion != NONE and self.standard == V3:
            raise InputError("araim: exclusion: levels after it are predicted as of v4.2 (nearest: standard='v4.2').")
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
        if self.standard == V3:
            own["unmonitored"] = self.unmonitored
        own |= {"budget": self.budget, "standard": self.standard, "in_view": in_view}
        own["exclusion"] = None if self.exclusion == NONE else self.exclusion
        levels = protection_levels(design, variance, systems=systems.tolist(), **own)
        return levels.hpl_m, levels.vpl_m

    def prepare(self, model: LinearModel) -> Prepared:
        modes = self._modes(model)
        n = model.design.shape[0]
        nobody = jnp.zeros(n, bool)
        if self.exclusion == NONE:
            return Prepared(self._position(model, modes, nobody, None), None, jnp.zeros(n, model.design.dtype))
        # A satellite that nothing checks shows no fault.
        checked = (model.in_view > 0) & (model.inverse_residual_sigma > 0)
        share = 1.0 / (1.0 + jnp.sum(model.in_view))
        prior = jnp.where(checked, self._priors.events(model, lone=True).satellites, 0.0)
        whole = self._position(model, modes, nobody, share)
        without = jax.lax.map(
            lambda rows: self._position(model, without_rows(modes, rows), rows, share), jnp.eye(n, dtype=bool)
        )
        return Prepared(whole, without, prior)

    def _modes(self, model: LinearModel) -> CompiledModes:
        if self.standard == V42:
            return compiled_exposure_modes(model, self._priors, self.budget, excludes=self.exclusion != NONE)
        return compiled_modes(model, self._priors)

    def _position(self, model: LinearModel, modes: CompiledModes, rows: Array, share: Array | None) -> Position:
        """The position without some rows (n,), with the part of the risk that it may take."""
        n, t = model.design.shape
        seen = (model.in_view > 0) & ~rows
        # All single faults are one block. Pairs are many and seldom needed: blocks without any are passed over.
        width = n + self._priors.constellations(t - COORDINATES)
        blocks = -(-modes.probability.shape[0] // width)
        surplus = blocks * width - modes.probability.shape[0]
        excluded = jnp.pad(modes.excluded, ((0, surplus), (0, 0))).reshape(blocks, width, n)
        probability = jnp.pad(modes.probability, (0, surplus)).reshape(blocks, width)
        used = jnp.any(probability > 0, axis=1)
        if blocks == 1:
            whole, subsets = jax.tree.map(lambda leaf: leaf[None], self._fit(model, seen, excluded[0]))
        else:
            whole, subsets = jax.lax.map(
                lambda block: jax.lax.cond(block[0], self._fit, self._nothing, model, seen, block[1]),
                (used.at[0].set(True), excluded),
            )
        # (blocks, 3, m, 1) to (3, blocks m, 1).
        sigma, bias, separation = (
            jnp.moveaxis(leaf, 0, 1).reshape(3, blocks * width, 1)
            for leaf in (subsets.sigma_m, subsets.bias_m, subsets.sigma_separation_m)
        )
        whole = jax.tree.map(lambda leaf: leaf[0], whole)
        exposure = None if modes.exposure is None else jnp.pad(modes.exposure, (0, surplus))[:, None]
        part = None if share is None else share[None]
        levels = solve_levels(
            whole,
            Subsets(subsets.difference, sigma, bias, separation, subsets.regular.reshape(blocks * width, 1)),
            Priors(probability.reshape(blocks * width, 1), modes.p_not_monitored[None], exposure, part),
            figures(self.budget, blocks * width),
        )
        determined = model.determined if share is None else model.determined & whole.regular[0]
        available = determined & levels.available[0]
        level = jnp.where(available, levels.level_m[:, 0], jnp.inf)
        threshold = levels.threshold_m[..., 0].reshape(3, blocks, width)
        return Position(
            # (blocks, 3, n, m) to (blocks, 3, m, n): one row for each test.
            gain=jnp.swapaxes(subsets.difference[..., 0], 2, 3).reshape(blocks, 3 * width, n),
            limit_m=jnp.moveaxis(threshold, 1, 0).reshape(blocks, 3 * width),
            used=used,
            step=jnp.where(available, whole.gain[..., 0] - model.gain[:COORDINATES], 0.0),
            hpl_m=jnp.sqrt(level[EAST] ** 2 + level[NORTH] ** 2),
            vpl_m=level[UP],
            available=available,
        )

    def statistic(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Array:
        """The largest ratio of a separation and its limit."""
        whole = prepared.whole
        limit = whole.limit_m.reshape(-1)
        # Modes that are not monitored have an infinite limit.
        inverse = jnp.where(jnp.isfinite(limit) & (limit > 0), 1.0 / jnp.where(limit > 0, limit, 1.0), 0.0)
        gain = whole.gain.reshape(limit.shape[0], -1) * inverse[:, None]
        ratio = jnp.max(jnp.abs(product(gain, start.residuals)), axis=0)
        return jnp.where(whole.available, ratio, jnp.inf)

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        whole, shape = prepared.whole, start.square_sum.shape
        rejects = _rejected(whole, start.residuals)
        outcome = _outcome(whole, jnp.broadcast_to(whole.available, shape), start.state[:3])
        if prepared.without is None:
            return replace(outcome, rejects=outcome.available & rejects)
        table = thresholds(model.design.shape[0], self.p_fa_chi2)
        found = rejects | (start.square_sum > per_lane(at_dof(table, model.dof), start.square_sum))
        limit = at_dof(table, model.dof - 1)

        def consider(best: tuple[Array, Outcome], row: Any) -> tuple[tuple[Array, Outcome], None]:
            score, chosen = best
            k, position, prior, residual, inverse_sigma = row
            rest = start.square_sum - (residual * inverse_sigma) ** 2
            passes = position.available & (prior > 0) & ~_rejected(position, start.residuals) & (rest <= limit)
            own = jnp.where(passes & found, 2.0 * jnp.log(jnp.where(prior > 0, prior, 1.0)) - rest, -jnp.inf)
            better = own > score
            error = start.state[:3] + product(position.step, start.residuals)
            candidate = replace(_outcome(position, jnp.ones(shape, bool), error), excluded=jnp.full(shape, k))
            return (jnp.where(better, own, score), _where(better, candidate, chosen)), None

        nobody = jnp.full(shape, -1, jnp.int32)
        start_from = (jnp.full(shape, -jnp.inf, start.square_sum.dtype), replace(outcome, excluded=nobody))
        rows = (
            jnp.arange(model.design.shape[0], dtype=jnp.int32), prepared.without, prepared.prior, start.residuals,
            model.inverse_residual_sigma,
        )  # fmt: skip
        (score, outcome), _ = jax.lax.scan(consider, start_from, rows)
        return replace(outcome, rejects=outcome.available & found & jnp.isneginf(score))

    def accuracy(self, model: LinearModel) -> Array:
        """(n,), variance of each satellite's error under the accuracy model over that under the integrity model."""
        root, dtype = model.weight_root, model.design.dtype
        if self.ism is None or not self.ism.has("sigma_ure_m"):
            return jnp.full(root.shape, self.accuracy_ratio**2, dtype)
        change = self._said("sigma_ure_m", model) ** 2 - self._said("sigma_ura_m", model) ** 2
        return jnp.maximum(1.0 + change * root**2, 0.0)

    def _fit(self, model: LinearModel, seen: Array, excluded: Array) -> tuple[Whole, Subsets]:
        """The solution with the satellites in ``seen`` (n,) and those of some modes (modes, n), for one geometry."""
        root, dtype = model.weight_root, model.design.dtype
        bias_m, accuracy = jnp.asarray(self.b_nom_m, dtype), self.accuracy(model)
        if self.ism is not None and self.ism.has("b_nom_m"):
            bias_m = self._said("b_nom_m", model)
        return fit_subsets(
            model.design[..., None], seen[:, None], excluded.T[..., None], (bias_m * root)[:, None], accuracy[:, None]
        )

    def _nothing(self, model: LinearModel, seen: Array, excluded: Array) -> tuple[Whole, Subsets]:
        """Zeros of the shape of `_fit`."""
        shapes = jax.eval_shape(self._fit, model, seen, excluded)
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)


def _rejected(position: Position, residuals: Array) -> Array:
    """(...), whether any test of a position rejects, of whitened residuals (n, ...) of all in view."""

    def exceeds(gain: Array, limit_m: Array) -> Array:
        # Subset and full solution agree on what the model explains, so residuals are all that separates them.
        separation = jnp.abs(product(gain, residuals))
        return jnp.any(separation > per_lane(limit_m, separation), axis=0)

    def add_block(rejects: Array, block: tuple[Array, Array, Array]) -> tuple[Array, None]:
        gain, limit_m, used = block
        return rejects | jax.lax.cond(used, exceeds, lambda *_: jnp.zeros_like(rejects), gain, limit_m), None

    rejects = exceeds(position.gain[0], position.limit_m[0])
    if position.gain.shape[0] == 1:
        return rejects
    return jax.lax.scan(add_block, rejects, (position.gain[1:], position.limit_m[1:], position.used[1:]))[0]


def _outcome(position: Position, available: Array, error_m: Array) -> Outcome:
    """What a position says, without the verdict of its tests."""
    return Outcome(
        error_m=jnp.where(available, error_m, jnp.inf),
        hpl_m=jnp.broadcast_to(position.hpl_m, available.shape),
        vpl_m=jnp.broadcast_to(position.vpl_m, available.shape),
        available=available,
        rejects=jnp.zeros_like(available),
    )


def _where(chosen: Array, one: Outcome, other: Outcome) -> Outcome:
    return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), one, other)
