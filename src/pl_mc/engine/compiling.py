"""The compiled heart of a sweep, for the backend at hand, on one device or on several of one machine."""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh, PartitionSpec

from pl_mc.engine.core import EpochBatch, count_epochs
from pl_mc.input_errors import InputError, require_whole
from pl_mc.kernels.noise import LANES
from pl_mc.runtime.forks import require_own_threads
from pl_mc.runtime.precision import precision_scope

# Bytes of one row of the scenarios that a processor takes at a time: 256 in double precision, 512 in single. Larger
# tiles leave its caches, smaller ones drown in the cost of calls (measured; half or double lose 5 to 30 %).
_PROCESSOR_TILE = 2048

# Bytes of one row of what a loop takes of them at a time: 64 lanes in double precision, 128 in single, for which all
# that a solution needs lies in the first cache.
_PROCESSOR_LOOP = 512

# Without it the compiler hands products of matrices to a library, which no function of machine code can hold.
_OWN_PRODUCTS: dict[str, int | str] = {
    "xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_CONVOLUTION"
}

# Name of the mesh axis over which blocks of noise are spread.
_BLOCKS = "blocks"


@functools.cache
def instruction_set() -> str:
    """The widest vector instructions of this processor, as far as they can be told; last bits depend on them."""
    try:
        flags = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    except OSError:
        return platform.machine()
    known = [name for name in ("avx512f", "avx2", "avx", "asimd") if name in flags]
    return f"{platform.machine()} {known[0]}" if known else platform.machine()


@functools.cache
def compiler_options() -> dict[str, int | str]:
    """Options for the compiler, for the kernels of this project alone; none where it does not know them.

    On a processor (JAX 0.10, AMD EPYC): with AVX-512, vectors of 512 bits instead of 256 gave 5 to 15 %. Calls run
    in as many threads as there are cores, so that splitting single operations over threads, which the compiler does
    where it finds them heavy, costs their waiting for each other and gains nothing: 10 to 20 %.
    """
    require_own_threads()
    if jax.default_backend() != "cpu":
        return {}
    wanted: dict[str, int | str] = {"xla_disable_hlo_passes": "cpu-parallel-task-assigner"}
    if "avx512" in instruction_set():
        wanted["xla_cpu_prefer_vector_width"] = 512
    return {option: value for option, value in wanted.items() if _known(option, value)}


@functools.cache
def sweep_options() -> dict[str, int | str]:
    """`compiler_options` of sweeps, whose methods are functions of machine code each (`pl_mc.kernels.one_call`)."""
    known = jax.default_backend() == "cpu" and all(_known(option, value) for option, value in _OWN_PRODUCTS.items())
    return compiler_options() | (_OWN_PRODUCTS if known else {})


def _known(option: str, value: int | str) -> bool:
    try:
        # Without the settings of a user, such as one that compiles nothing.
        with precision_scope("float32"):
            jax.jit(lambda x: x, compiler_options={option: value})(np.float32(0)).block_until_ready()
    except Exception:  # Another version of the compiler may not know the option; it names no type for that.
        return False
    return True


def require_devices(devices: int | None) -> int:
    """The number of devices to use, one unless given; an `InputError` where there are not so many."""
    count = 1 if devices is None else require_whole(devices, field="devices", low=1)
    here = jax.local_device_count()
    if count > here:
        raise InputError(
            f"devices: {count} were asked for, but JAX finds {here} ({jax.default_backend()}); for more devices on "
            "a processor set jax_num_cpu_devices before JAX is first used."
        )
    return count


@functools.cache
def compiled_count(devices: int) -> Callable[..., Array]:
    """`count_epochs` as one compiled function, with static ``axes``, ``blocks`` and ``noise_model``."""
    options = sweep_options()
    on_processor = jax.default_backend() == "cpu"

    def one_device(batch: EpochBatch, *numbers: Any, blocks: int, **static: Any) -> Array:
        size = batch.design.dtype.itemsize
        together = _PROCESSOR_TILE // (LANES * size) if on_processor else blocks
        loop_lanes = _PROCESSOR_LOOP // size if options.keys() >= _OWN_PRODUCTS.keys() else None
        return count_epochs(batch, *numbers, blocks=blocks, together=together, loop_lanes=loop_lanes, **static)

    def several_devices(batch: EpochBatch, *numbers: Any, blocks: int, **static: Any) -> Array:
        each = -(-blocks // devices)

        def share(batch: EpochBatch, seed: Array, first: Array, *rest: Any) -> Array:
            own = first + jax.lax.axis_index(_BLOCKS).astype(jnp.int32) * each
            return jax.lax.psum(one_device(batch, seed, own, *rest, blocks=each, **static), _BLOCKS)

        mesh = Mesh(np.array(jax.local_devices()[:devices]), (_BLOCKS,))
        everywhere = PartitionSpec()
        spread = jax.shard_map(share, mesh=mesh, in_specs=everywhere, out_specs=everywhere, check_vma=False)
        return spread(batch, *numbers)

    function = one_device if devices == 1 else several_devices
    return jax.jit(function, static_argnames=("axes", "blocks", "noise_model"), compiler_options=options)
