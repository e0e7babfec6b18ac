"""Protection levels of many geometries: one compiled call for a batch, and what methods have of their own."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.engine.compiling import compiler_options
from pl_mc.kernels import LeastSquaresSolution, LinearModel, linear_model
from pl_mc.kernels.linear_model import product
from pl_mc.kernels.noise import LANES, epoch_key, unit_inputs
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.methods import Method
from pl_mc.methods.capabilities import declared, levels_from_geometry
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.runtime.precision import dtype_of, on_device, precision_scope
from pl_mc.service.sky import Geometries


def levels_of_batch(
    batch: Geometries, numbers: NDArray[np.int64], methods: Sequence[Method], *, draws: int, seed: int,
    precision: str, noise: NoiseModel = GAUSSIAN,
) -> list[tuple[FloatArray, FloatArray]]:  # fmt: skip
    """HPL and VPL (g, draws) of each method [m], infinite where it has no solution.

    One column, (g, 1), for methods whose levels depend on the geometry alone. Noise is that of a sweep of the same
    seed over epochs of these numbers (g,). A method's own function has a precision of its own.
    """
    noisy = tuple(method for method in methods if not levels_from_geometry(method))
    batched = {m.name: _batched(m, batch) for m in methods if levels_from_geometry(m)}
    quiet = tuple(m for m in methods if m.name in batched and batched[m.name] is None)
    found: dict[str, tuple[FloatArray, FloatArray]] = {}
    if noisy or quiet:
        dtype = dtype_of(precision)
        with precision_scope(precision):
            design, sigma = on_device(batch.design, dtype), on_device(batch.sigma_m, dtype)
            arrays = (design, sigma, on_device(batch.in_view), on_device(numbers, np.uint32), np.uint32(seed))
            levels = _compiled()(*arrays, as_trees(noisy), as_trees(quiet), draws=draws, noise=noise)
            for method, pair in zip((*noisy, *quiet), levels, strict=True):
                found[method.name] = np.asarray(pair[0], dtype=float), np.asarray(pair[1], dtype=float)
    for name, own in batched.items():
        if own is not None:
            horizontal, vertical = own(batch.design, batch.sigma_m, batch.in_view, batch.systems)
            found[name] = horizontal[:, None], vertical[:, None]
    return [found[method.name] for method in methods]


def _batched(method: Method, batch: Geometries) -> Callable[..., tuple[FloatArray, FloatArray]] | None:
    """A method's own function for batches, if it has one; one that tells satellites apart has their names."""
    own = declared(method, "batched_levels")
    names = own is not None and getattr(method, "ism", None) is not None
    return functools.partial(own, names=batch.names) if names else own


@functools.cache
def _compiled() -> Callable[..., list[tuple[Array, Array]]]:
    static = ("draws", "noise")
    return jax.jit(_levels, static_argnames=static, compiler_options=compiler_options())


def _levels(
    design: Array, sigma_m: Array, in_view: Array, numbers: Array, seed: Array, noisy: Trees,
    quiet: Trees, *, draws: int, noise: NoiseModel,
) -> list[tuple[Array, Array]]:  # fmt: skip
    def one(geometry: tuple[Array, Array, Array, Array]) -> list[tuple[Array, Array]]:
        rows, sigma, seen, number = geometry
        # A satellite has one clock.
        model = linear_model(rows, sigma, seen, one_clock_per_row=True)
        pairs = []
        if noisy:
            key = epoch_key(seed, number)
            blocks = []
            for block in range(-(-draws // LANES)):
                number, inputs = jnp.asarray(block, jnp.int32), noise.inputs_per_row
                blocks.append(noise.shape(model, unit_inputs(key, number, inputs, rows.shape[0], rows.dtype)))
            errors = jnp.concatenate(blocks, axis=1)[:, :draws] * model.in_view[:, None]
            pairs += _pairs(of_trees(noisy), model, errors)
        return pairs + (_pairs(of_trees(quiet), model, jnp.zeros_like(sigma)[:, None]) if quiet else [])

    return jax.lax.map(one, (design, sigma_m, in_view, numbers))


def _pairs(methods: tuple[Method, ...], model: LinearModel, noise: Array) -> list[tuple[Array, Array]]:
    state = product(model.gain, noise)
    residuals = noise - product(model.design, state)
    square_sum = jnp.sum(residuals * residuals, axis=0)
    start = LeastSquaresSolution(model.twins.alike(residuals), state, square_sum)
    outcomes = [method.solve(model, method.prepare(model), start) for method in methods]
    return [
        (jnp.where(one.available, one.hpl_m, jnp.inf), jnp.where(one.available, one.vpl_m, jnp.inf)) for one in outcomes
    ]
