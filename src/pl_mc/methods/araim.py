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

from pl_mc.araim.budget import LPV_200, Budget
from pl_mc.araim.compiled_modes import Priors, codes_of_rows, compiled_modes
from pl_mc.araim.levels import protection_levels
from pl_mc.araim.modes import CONTAINED, UNMONITORED
from pl_mc.araim.solving import Subsets, Whole, fit_subsets, solve_levels
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import EAST, NORTH, UP, Geometry
from pl_mc.input_errors import InputError, require_choice, require_number, require_positive
from pl_mc.ism import FIELDS, as_ism
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import COORDINATES, per_lane, product
from pl_mc.methods.base import Named, Outcome

# Options of the method, and arguments of its levels, that a field of an ISM stands for.
_SAID_BY = {"p_sat": "p_sat", "p_const": "p_const", "b_nom_m": "b_nom_m", "accuracy_ratio": "sigma_ure_m"}
_ARGUMENTS = {"c_acc": "sigma_ure_m", "b_nom": "b_nom_m", "p_sat": "p_sat", "p_const": "p_const"}
# A sigma that is the URA and nothing else may have lost a digit.
_ROUNDING = 1e-9


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
class Araim(Named):
    """Advanced RAIM with the model's sigma as that of the integrity model.

    There is no solution where there are no levels: where the satellites left by a fault more probable than the
    integrity risk determine no position. So a single constellation with a ``p_const`` of 1e-4 is unavailable. With as
    many satellites as unknowns no mode can be tested, and there are levels if no fault needs to be.

    Fault modes are single satellites and constellations, and pairs of them wherever P_THRES asks for them; whether
    it can for that many rows and clocks is decided when the sweep is compiled. Combinations of three are never
    monitored: what they leave above P_THRES takes from the integrity risk.

    Attributes:
        p_sat, p_const: prior of a fault of each satellite and of each constellation.
        b_nom_m: largest nominal bias of each satellite, in the levels alone; the sweep draws none [m].
        accuracy_ratio: sigma of the accuracy model over that of the integrity model. The sweep's noise has the
            latter, so with a smaller ratio false alerts are more frequent than the budget says.
        budget: the operation's risks.
        unmonitored: ``contained`` or ``plain``, as for `pl_mc.araim.protection_levels`.
        ism: an integrity support message, `pl_mc.araim.Ism`, a table of its fields or the path of a CSV file, which
            says of each satellite or constellation what the options above say of all, as far as it has it. With its
            sigma_URE the variance of the accuracy model is that of the model, less sigma_URA^2, plus sigma_URE^2: the
            model's sigma has to hold sigma_URA, as that of `pl_mc.error_model` with the same ``ism`` does.
    """

    key = "araim"

    p_sat: float = 1e-5
    p_const: float = 1e-4
    b_nom_m: float = 0.75
    accuracy_ratio: float = 1.0
    budget: Budget = LPV_200
    unmonitored: str = CONTAINED
    ism: Any = None

    def __post_init__(self) -> None:
        require_positive(self.p_sat, field="araim: p_sat")
        for field in ("p_sat", "p_const"):
            if not 0.0 <= require_number(getattr(self, field), field=f"araim: {field}") < 1.0:
                raise InputError(
                    f"araim: {field}: a prior probability lies between 0 and 1, not {getattr(self, field)!r}."
                )
        if require_number(self.b_nom_m, field="araim: b_nom_m") < 0:
            raise InputError(f"araim: b_nom_m: a nominal bias is not negative, as {self.b_nom_m!r} is.")
        require_positive(self.accuracy_ratio, field="araim: accuracy_ratio")
        if not isinstance(self.budget, Budget):
            raise InputError(f"araim: budget: a budget such as pl_mc.araim.LPV_200 is needed, not {self.budget!r}.")
        require_choice(self.unmonitored, UNMONITORED, field="araim: unmonitored")
        if self.ism is not None:
            object.__setattr__(self, "ism", as_ism(self.ism, field="araim: ism"))
            for option, field in _SAID_BY.items():
                if self.ism.has(field) and getattr(self, option) != type(self).__dataclass_fields__[option].default:
                    raise InputError(f"araim: {option}: the ism has {field}, which says it; leave one of the two out.")

    def require_geometry(self, g: Geometry) -> None:
        """Raise `InputError` where the ISM lacks a satellite of a geometry, or a sigma there is below its sigma_URA."""
        if self.ism is None:
            return
        for field in FIELDS:
            if self.ism.has(field):
                self.ism.values(field, g.names, g.systems)
        if self.ism.has("sigma_ure_m"):
            ura_m = self.ism.values("sigma_ura_m", g.names, g.systems)[g.satellite]
            for place in np.argwhere(g.in_view & (g.sigma_m < ura_m * (1.0 - _ROUNDING)))[:1]:
                k = tuple(place)
                raise InputError(
                    f"{self.ism.source}: sigma_ura_m: {ura_m[k]:g} m of {g.names[g.satellite[k]]} is more than its "
                    f"sigma in the geometry, {g.sigma_m[k]:.4g} m, which has to hold it (nearest: an error model with "
                    "the same ism)."
                )

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
        priors = Priors(self.p_sat, self.p_const, self.budget.p_threshold, self.unmonitored, self.ism)
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
            probability.reshape(blocks * width, 1),
            modes.p_not_monitored[None],
            self.budget,
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

    def _said(self, field: str, model: LinearModel) -> Array:
        """(n,), what the ISM says of the satellite of each row."""
        return jnp.asarray(self.ism.table(field), model.design.dtype)[codes_of_rows(model)]

    def _nothing(self, model: LinearModel, excluded: Array) -> tuple[Whole, Subsets]:
        """Zeros of the shape of `_fit`."""
        shapes = jax.eval_shape(self._fit, model, excluded)
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
