"""The same work in batched NumPy: what an array programmer writes with matrix products and `numpy.linalg.solve`.

Scenarios lie along the first axis, as `numpy.linalg` wants them. The sums over satellites are matrix products, the
noise of a batch serves every bias, and batches are small enough for the caches, so that this is no straw man. The
formulas are those of Zhao et al. 2021, eqs 4-7 and 14-19, in the default reading of `pl_mc.methods.Igg3`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.benchmark.problem import ROBUST
from pl_mc.constants import K_VERTICAL
from pl_mc.geometry.record import UP, Geometry
from pl_mc.kernels.events import EVENTS, SETTLED_M
from pl_mc.kernels.linear_model import REDUNDANCY_FLOOR
from pl_mc.kernels.small_matrix import PIVOT_FLOOR
from pl_mc.methods import Igg3

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Draws per batch: its residuals, 24 satellites in double precision, fill about 200 kB.
BATCH = 1024


@dataclass(frozen=True)
class NumpyOutcome:
    """What a method says in each scenario.

    Attributes:
        vertical_error_m: (s,), up error of the position [m].
        vpl_m: (s,), vertical protection level [m].
        available: (s,), whether the solution is determined; where not, the numbers mean nothing.
        unconverged: (s,), whether the last iteration moved the position by more than a centimetre.
    """

    vertical_error_m: Numbers
    vpl_m: Numbers
    available: Flags
    unconverged: Flags


class NumpyModel:
    """One geometry, all satellites in view, prepared for batches of whitened observations (s, n)."""

    def __init__(self, g: Geometry) -> None:
        self.weight_root = 1.0 / g.sigma_m
        self.design = g.design * self.weight_root[:, None]
        n, t = self.design.shape
        self.products = (self.design[:, :, None] * self.design[:, None, :]).reshape(n, t * t)
        self.normal = self.products.sum(axis=0).reshape(t, t)
        self.cofactor = np.linalg.inv(self.normal)
        self.gain = self.cofactor @ self.design.T
        self.leverage = np.einsum("nt,tn->n", self.design, self.gain)
        self.redundancy = 1.0 - self.leverage
        self.pivot_floor = PIVOT_FLOOR * np.diag(np.linalg.cholesky(self.normal)) ** 2
        self.dof = self.design.shape[0] - self.design.shape[1]

    def least_squares(self, whitened: Numbers) -> NumpyOutcome:
        """Eqs 4, 15 and 16."""
        state = whitened @ self.gain.T
        residuals = whitened - state @ self.design.T
        unit_error = np.sqrt(np.einsum("sn,sn->s", residuals, residuals) / self.dof)
        vpl_m = K_VERTICAL * np.sqrt(self.cofactor[UP, UP]) * unit_error
        sure = np.ones(len(whitened), dtype=bool)
        return NumpyOutcome(state[:, UP], vpl_m, available=sure, unconverged=~sure)

    def igg3(self, whitened: Numbers, options: Igg3) -> NumpyOutcome:
        """Eqs 6, 7, 17 and 19, with the cofactor, scale and redundancy that are the defaults of ``options``."""
        t = self.design.shape[1]
        checked = self.redundancy >= REDUNDANCY_FLOOR
        per_residual = np.where(checked, 1.0 / np.sqrt(np.where(checked, self.redundancy, 1.0)), 0.0)
        state = whitened @ self.gain.T
        residuals = whitened - state @ self.design.T
        square_sum = np.einsum("sn,sn->s", residuals, residuals)
        available = np.ones(len(whitened), dtype=bool)
        for _ in range(options.options.solutions):
            scale = np.maximum(1.0, np.sqrt(square_sum / self.dof))
            size = np.maximum(np.abs(residuals) * per_residual / scale[:, None], options.k0)
            fall = np.maximum(options.k1 - size, 0.0) / (options.k1 - options.k0)
            weights = options.k0 / size * fall * fall
            normal = (weights @ self.products).reshape(-1, t, t)
            self._mark_undetermined(weights, normal, available)
            before, state = state, np.linalg.solve(normal, ((weights * whitened) @ self.design)[:, :, None])[:, :, 0]
            residuals = whitened - state @ self.design.T
            square_sum = np.einsum("sn,sn->s", weights * residuals, residuals)
        unit = np.broadcast_to(np.eye(t)[UP][:, None], (len(whitened), t, 1))
        cofactor = np.linalg.solve(normal, unit)[:, UP, 0]
        vpl_m = options.k_vertical * np.sqrt(square_sum / self.dof * cofactor)
        unconverged = available & (np.abs(state - before)[:, : UP + 1].max(axis=1) > SETTLED_M)
        return NumpyOutcome(state[:, UP], vpl_m, available, unconverged)

    def _mark_undetermined(self, weights: Numbers, normal: Numbers, available: Flags) -> None:
        """Where a solution is not determined, clear ``available`` and put a regular matrix into ``normal``.

        Two sums clear most scenarios: weights that add up to t + 1 belong to so many satellites at least, and since
        b b' <= h N0 for a row b of leverage h, N >= (1 - sum (1 - w) h) N0, and so are its pivots.
        """
        t = normal.shape[-1]
        weighted_leverage = weights @ self.leverage
        doubtful = (weighted_leverage < t - 1 + 1e-3) | (weights.sum(axis=1) < t + 1)
        place = np.flatnonzero(doubtful | ~available)
        if not place.size:
            return
        sound = (np.count_nonzero(weights[place], axis=1) > t) & self._regular(normal[place])
        available[place] &= sound
        # A singular matrix would stop the whole batch; its scenario is lost anyhow.
        normal[place[~available[place]]] = self.normal

    def _regular(self, normal: Numbers) -> Flags:
        """(s,), whether every Cholesky pivot reaches its floor."""
        t = normal.shape[-1]
        regular = np.ones(len(normal), dtype=bool)
        lower: dict[tuple[int, int], Numbers] = {}
        for j in range(t):
            pivot = normal[:, j, j] - sum(lower[j, k] ** 2 for k in range(j))
            sound = pivot >= self.pivot_floor[j]
            regular &= sound
            root = np.sqrt(np.where(sound, pivot, 1.0))
            for i in range(j + 1, t):
                lower[i, j] = (normal[:, i, j] - sum(lower[i, k] * lower[j, k] for k in range(j))) / root
        return regular


def both_methods(g: Geometry, errors_m: Numbers, *, batch: int = BATCH) -> dict[str, NumpyOutcome]:
    """Outcomes of ``ls`` and ``igg3`` for given pseudorange errors (s, n) [m]."""
    model, options = NumpyModel(g), ROBUST
    found: dict[str, list[NumpyOutcome]] = {"ls": [], options.name: []}
    for first in range(0, len(errors_m), batch):
        whitened = errors_m[first : first + batch] * model.weight_root
        found["ls"].append(model.least_squares(whitened))
        found[options.name].append(model.igg3(whitened, options))
    fields = ("vertical_error_m", "vpl_m", "available", "unconverged")
    return {
        name: NumpyOutcome(*(np.concatenate([getattr(part, field) for part in parts]) for field in fields))
        for name, parts in found.items()
    }


def events_of(outcome: NumpyOutcome, vertical_m: float) -> Flags:
    """(events, s), which of `EVENTS` each scenario is."""
    error = np.abs(outcome.vertical_error_m)
    available = outcome.available
    alarm = ~available | (outcome.vpl_m > vertical_m)
    hazard = available & (error > vertical_m)
    exceeded = available & (error > outcome.vpl_m)
    quiet = ~alarm
    return np.stack(
        [
            alarm, hazard, hazard & quiet, exceeded, exceeded & quiet, available & alarm & ~hazard, ~available,
            outcome.unconverged, np.zeros_like(available),
        ]
    )  # fmt: skip


def count_events(
    g: Geometry, bias_m: Numbers, noise: Numbers, vertical_m: float, *, batch: int = BATCH
) -> NDArray[np.int64]:
    """(f, methods, events), how often each event happens, by ``ls`` and by ``igg3``, ``batch`` draws at a time.

    ``g``: one epoch, all satellites in view; ``bias_m``: (f, n) [m]; ``noise``: (draws, n), in units of each
    satellite's sigma, the same for every bias; ``vertical_m``: vertical alert limit [m].
    """
    model, options = NumpyModel(g), ROBUST
    total = np.zeros((len(bias_m), 2, len(EVENTS)), dtype=np.int64)
    for first in range(0, len(noise), batch):
        some = noise[first : first + batch]
        for k, bias in enumerate(bias_m * model.weight_root):
            whitened = some + bias
            for place, outcome in enumerate((model.least_squares(whitened), model.igg3(whitened, options))):
                total[k, place] += events_of(outcome, vertical_m).sum(axis=1)
    return total


def sweep_numpy(g: Geometry, bias_m: Numbers, *, draws: int, seed: int, vertical_m: float) -> NDArray[np.int64]:
    """`count_events` of fresh noise, drawn batch by batch."""
    generator = np.random.default_rng(seed)
    sizes = [(min(BATCH, draws - first), g.design.shape[0]) for first in range(0, draws, BATCH)]
    return np.sum([count_events(g, bias_m, generator.standard_normal(size), vertical_m) for size in sizes], axis=0)
