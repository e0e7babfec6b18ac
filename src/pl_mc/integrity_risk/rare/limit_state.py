"""The limit state: how far a scenario is from an event, as one number that is positive exactly where it happens.

Samplers of rare events climb this number. It is computed by the methods themselves, through one compiled function
per shape and method, in calls of a fixed width.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL, AlertLimits, judged_by
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, UP, Geometry
from pl_mc.ism import satellite_codes
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.events import sizes_and_levels, unconverged
from pl_mc.kernels.linear_model import has_one_clock_per_row
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.methods.base import Method, Outcome
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.runtime.precision import precision_scope

RISK_EVENTS = ("missed", "misleading", "exceeded", "alarm")

# Scenarios per tile of a call, which stay in the cache; points that are turned into noise together; and the most of a
# call, which computes as many tiles as it was given points for: enough to hide what a call costs besides.
_TILE = 512
POINTS_TOGETHER = 1024
_POINTS_PER_CALL = 8 * POINTS_TOGETHER

# From outcomes, the alert limits of an axis [m], the event and the axis to a number each.
OfOutcome = Callable[[Outcome, Array, Any, str], Array]

# What the errors of an axis are made of.
_COMPONENTS = {VERTICAL: (UP,), HORIZONTAL: (EAST, NORTH), EITHER: (UP, EAST, NORTH)}

# The limit state [m] where no distance is known: no solution, or a test of the method's own that decides alone.
FAR_M = 1e9


@dataclass(frozen=True)
class Rotation:
    """Orthonormal coordinates of the whitened noise of one epoch, those that matter for an axis first.

    For the vertical the first coordinate is the direction that moves the least-squares vertical error, the second the
    fault's trace in the residuals, the next the rest of the residuals. The others move horizontal position and clocks
    alone; an estimator that follows a shift of its observations does not feel them in its vertical error or its
    levels. For the horizontal the two directions that move the error east and north stand in the place of the first,
    for both together all three.

    Attributes:
        matrix: (n, m), rows of the geometry by coordinates, m satellites in view; zero on padding. Where an error
            comes from k numbers (k n, k m).
        active: number of coordinates that matter: degrees of freedom and the components of the error; all where
            errors are not Gaussian.
    """

    matrix: FloatArray
    active: int


class InCoordinates:
    """What a state at one epoch says of its points: how many coordinates they have."""

    coordinates: Rotation

    @property
    def active(self) -> int:
        """Number of coordinates that matter."""
        return self.coordinates.active

    @property
    def dimension(self) -> int:
        """Number of all coordinates."""
        return self.coordinates.matrix.shape[1]


def rotation(
    design: FloatArray, sigma_m: FloatArray, in_view: NDArray[np.bool_], bias_m: FloatArray, axis: str = VERTICAL
) -> Rotation:
    """The coordinates of an epoch with redundancy: design (n, t) [m/m]; sigma [m], view and fault [m] (n,)."""
    seen = np.flatnonzero(in_view)
    whitened = design[seen] / sigma_m[seen, None]
    used = whitened.any(axis=0) | (np.arange(whitened.shape[1]) < POSITION_UNKNOWNS)
    fitted, triangle = np.linalg.qr(whitened[:, used])
    # The rows of (A'A)^-1 A' lie in the fitted space.
    first = [fitted @ np.linalg.solve(triangle.T, unit) for unit in np.eye(triangle.shape[0])[list(_COMPONENTS[axis])]]
    scaled = bias_m[seen] / sigma_m[seen]
    trace = scaled - fitted @ (fitted.T @ scaled)
    # A fault that the residuals do not show leaves a trace of rounding alone.
    if float(np.linalg.norm(trace)) > 1e-9 * float(np.linalg.norm(scaled)):
        first.append(trace)
    unknowns = triangle.shape[0]
    # The left singular vectors of I - QQ' with singular value one span the residuals.
    residuals = np.linalg.svd(np.eye(seen.size) - fitted @ fitted.T)[0][:, : seen.size - unknowns]
    matrix = np.zeros((design.shape[0], seen.size))
    matrix[seen] = _orthonormal(np.column_stack([*first, residuals, fitted]))
    return Rotation(matrix, active=seen.size - unknowns + len(_COMPONENTS[axis]))


def all_axes(in_view: NDArray[np.bool_], inputs: int) -> Rotation:
    """The ``inputs`` numbers of each satellite in view (n,) as they are; rows by (inputs, n).

    Independent errors that are not Gaussian look the same along the axes of the satellites alone, and an error that
    comes from several numbers has no direction at all. So every coordinate matters.
    """
    matrix = np.asarray(np.kron(np.eye(inputs), np.eye(in_view.size)[:, in_view]), dtype=np.float64)
    return Rotation(matrix, active=matrix.shape[1])


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Gram-Schmidt, twice, over columns of which those that depend on earlier ones are left out."""
    kept: list[FloatArray] = []
    for column in columns.T:
        size = np.linalg.norm(column)
        rest = column / size if size > 0 else column
        for _ in range(2):
            for other in kept:
                rest = rest - (other @ rest) * other
        left = np.linalg.norm(rest)
        if left > 1e-7:
            kept.append(rest / left)
    return np.column_stack(kept)


@dataclass(frozen=True)
class EpochState(InCoordinates):
    """One event of one method under one fault at one epoch.

    Attributes:
        design: (n, t) [m/m]; sigma_m: (n,) [m]; in_view: (n,); bias_m: (n,), the fault [m].
        method: the method.
        event: one of `RISK_EVENTS`.
        limits_m: alert limit of the axis [m]; of both, the vertical one first, where either decides.
        coordinates: the coordinates of the points: `rotation` for errors that are Gaussian but for a constant,
            else `all_axes`.
        axis: by which error, level and limit it judges.
        satellite: (n,), codes of the satellites, for methods that tell them apart.
    """

    design: FloatArray
    sigma_m: FloatArray
    in_view: NDArray[np.bool_]
    bias_m: FloatArray
    method: Method
    event: str
    limits_m: float | tuple[float, ...]
    coordinates: Rotation
    axis: str = field(default=VERTICAL, kw_only=True)
    satellite: NDArray[np.int32] | None = field(default=None, kw_only=True)

    @classmethod
    def of(
        cls, series: Geometry, epoch: int, bias_m: FloatArray, method: Method, event: str, alert: AlertLimits,
        coordinates: Rotation | None = None, axis: str = VERTICAL, **options: Any,
    ) -> Self:  # fmt: skip
        """Of an epoch by its place in a series, with the fault by satellite (m,) [m]; `rotation` unless given."""
        seen, design, sigma = series.in_view[epoch], series.design[epoch], series.sigma_m[epoch]
        bias = np.where(seen, bias_m[series.satellite[epoch]], 0.0)
        turned = rotation(design, sigma, seen, bias, axis) if coordinates is None else coordinates
        limits_m = tuple(alert.limit_m[one] for one in judged_by(axis))
        codes = satellite_codes(series, series.satellite[epoch])
        return cls(design, sigma, seen, bias, method, event, limits_m, turned, axis=axis, satellite=codes, **options)

    @functools.cached_property
    def _one_clock_per_row(self) -> bool:
        """What the model is told; samplers ask for limit states again and again."""
        return has_one_clock_per_row(self.design[self.in_view])

    def computed(self, points: FloatArray, of: OfOutcome, event: Any, noise_model: NoiseModel = GAUSSIAN) -> FloatArray:
        """(N,), what a function of outcomes makes of points (N, dimension), call by call; see `OfOutcome`."""
        arrays = (self.design, self.sigma_m, self.in_view, self.satellite, self.bias_m)
        rows, limits_m = self.coordinates.matrix, np.atleast_1d(np.asarray(self.limits_m, np.float64))
        static: dict[str, Any] = {"of": of, "noise_model": noise_model, "axis": self.axis}
        static["one_clock_per_row"] = self._one_clock_per_row
        values, methods = np.empty(len(points)), as_trees((self.method,))
        with precision_scope("float64"):
            for start in range(0, len(points), _POINTS_PER_CALL):
                some = points[start : start + _POINTS_PER_CALL]
                noise = np.zeros((_POINTS_PER_CALL, rows.shape[0]))
                # Small products, which no library shares among threads.
                for first in range(0, len(some), POINTS_TOGETHER):
                    noise[first : first + POINTS_TOGETHER][: len(some) - first] = (
                        some[first : first + POINTS_TOGETHER] @ rows.T
                    )
                tiles = np.int32(-(-len(some) // _TILE))
                found = _values(*arrays, noise, tiles, limits_m, event, methods, **static)
                values[start : start + len(some)] = np.asarray(found)[: len(some)]
        return values


@dataclass(frozen=True)
class LimitState(EpochState):
    """An event whose limit state is positive where it happens.

    Attributes:
        noise: what standard normal numbers are made into.
    """

    noise: NoiseModel = GAUSSIAN

    def __call__(self, points: FloatArray) -> FloatArray:
        """(N,), the limit state [m] of points (N, dimension), standard normal."""
        return self.computed(points, _by_place, np.int32(RISK_EVENTS.index(self.event)), self.noise)

    def unconverged(self, points: FloatArray) -> NDArray[np.bool_]:
        """(N,), whether the last iteration at points (N, dimension) still moved the position by more than 1 cm."""
        return self.computed(points, _by_place, np.int32(len(RISK_EVENTS)), self.noise) > 0


@functools.partial(jax.jit, static_argnames=("of", "noise_model", "axis", "one_clock_per_row"))
def _values(
    design: Array, sigma_m: Array, in_view: Array, satellite: Array | None, bias_m: Array, noise: Array, tiles: Array,
    limits_m: Array, event: Array, methods: Trees, *, of: OfOutcome, noise_model: NoiseModel, axis: str,
    one_clock_per_row: bool,
) -> Array:  # fmt: skip
    """(N,), what ``of`` makes of the outcomes of standard normal numbers (N, k n); zero after so many tiles."""
    (method,) = of_trees(methods)
    model = linear_model(design, sigma_m, in_view, one_clock_per_row=one_clock_per_row, satellite=satellite)
    prepared = method.prepare(model)
    rows = sigma_m.shape[0]

    def one_tile(k: Array, values: Array) -> Array:
        numbers = jax.lax.dynamic_slice_in_dim(noise, k * _TILE, _TILE).T
        units = [numbers[j * rows : (j + 1) * rows] for j in range(noise_model.inputs_per_row)]
        errors = noise_model.shape(model, units) * sigma_m[:, None] + bias_m[:, None]
        found = of(method.solve(model, prepared, start_from(model, errors)), limits_m, event, axis)
        return jax.lax.dynamic_update_slice_in_dim(values, found, k * _TILE, 0)

    return jax.lax.fori_loop(0, tiles, one_tile, jnp.zeros(noise.shape[0], noise.dtype))


def _by_place(outcome: Outcome, limits_m: Array, event: Array, axis: str) -> Array:
    """The limit state of an event by its place in `RISK_EVENTS`; after the last, one where nothing has settled."""
    # All of them cost next to nothing, and one compiled function serves every event.
    states = [limit_state(outcome, limits_m, name, axis) for name in RISK_EVENTS]
    return jnp.stack([*states, unconverged(outcome).astype(outcome.vpl_m.dtype)])[event]


def limit_state(outcome: Outcome, limits_m: Array | float, event: str, axis: str = VERTICAL) -> Array:
    """(...), a number [m] that is positive where the event of `pl_mc.kernels.events` happens, and not elsewhere.

    How far an error is beyond its limit, and its protection level below the alert limit, whichever is less; at most
    `FAR_M` either way. Where either error decides it is the one that is further beyond, and the level that is closest
    to its limit. Without a solution there is an alarm and nothing else; a rejection is an alarm.
    """
    limits = jnp.atleast_1d(limits_m)
    judged = [(*pair, limits[k]) for k, pair in enumerate(sizes_and_levels(outcome, axis))]
    quiet = functools.reduce(jnp.minimum, [limit - level for _, level, limit in judged])
    beyond = functools.reduce(
        jnp.maximum, [error - (limit if event == "missed" else level) for error, level, limit in judged]
    )
    if event == "alarm":
        level, decided, far = -quiet, ~outcome.available | outcome.rejects, FAR_M
    elif event == "exceeded":
        level, decided, far = beyond, ~outcome.available, -FAR_M
    else:
        level, decided, far = jnp.minimum(beyond, quiet), ~outcome.available | outcome.rejects, -FAR_M
    # Where nothing is available the levels are infinite, and their difference is no number.
    return jnp.where(decided, far, jnp.clip(jnp.where(decided, 0.0, level), -FAR_M, FAR_M))
