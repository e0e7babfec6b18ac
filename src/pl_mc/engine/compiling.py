"""The compiled heart of a sweep, for the backend at hand, on one device or on several of one machine."""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh, PartitionSpec

from pl_mc.engine.core import EpochBatch, count_events
from pl_mc.input_errors import InputError, require_whole
from pl_mc.methods.base import Method

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
def compiler_options() -> dict[str, int]:
    """Options for the compiler, for the kernels of this project alone.

    With AVX-512, vectors of 512 bits instead of 256 gave 5 to 15 % where it was tried (JAX 0.10, AMD EPYC).
    """
    options = {"xla_cpu_prefer_vector_width": 512}
    if jax.default_backend() != "cpu" or "avx512" not in instruction_set():
        return {}
    try:
        jax.jit(lambda x: x, compiler_options=options)(np.float32(0)).block_until_ready()
    except Exception:  # Another version of the compiler may not know the option; it names no type for that.
        return {}
    return options


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
    """`count_events` as one compiled function, with static ``methods`` and ``blocks``."""
    options = compiler_options()
    on_processor = jax.default_backend() == "cpu"

    def one_device(batch: EpochBatch, *numbers: Array, methods: tuple[Method, ...], blocks: int) -> Array:
        together = 1 if on_processor else blocks
        return count_events(batch, *numbers, methods=methods, blocks=blocks, together=together)

    def several_devices(batch: EpochBatch, *numbers: Array, methods: tuple[Method, ...], blocks: int) -> Array:
        each = -(-blocks // devices)

        def share(batch: EpochBatch, seed: Array, first: Array, *rest: Array) -> Array:
            mine = first + jax.lax.axis_index(_BLOCKS).astype(jnp.int32) * each
            return jax.lax.psum(one_device(batch, seed, mine, *rest, methods=methods, blocks=each), _BLOCKS)

        mesh = Mesh(np.array(jax.local_devices()[:devices]), (_BLOCKS,))
        everywhere = PartitionSpec()
        spread = jax.shard_map(share, mesh=mesh, in_specs=everywhere, out_specs=everywhere, check_vma=False)
        return spread(batch, *numbers)

    function = one_device if devices == 1 else several_devices
    return jax.jit(function, static_argnames=("methods", "blocks"), compiler_options=options)
