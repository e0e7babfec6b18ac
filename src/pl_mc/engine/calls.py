"""Calls of a compiled function over epochs and blocks of noise: how they are cut, and the one loop that makes them.

Every call has the same shape, so that its function compiles once. The cut never changes a result: noise is found by
epoch and block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from pl_mc.kernels.noise import LANES
from pl_mc.runtime.precision import precision_scope
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import in_order


@dataclass(frozen=True)
class Chunk:
    """One call: epochs ``first_epoch`` to ``stop_epoch`` of a cut, blocks of noise from ``first_block`` on."""

    first_epoch: int
    stop_epoch: int
    first_block: int

    @property
    def size(self) -> int:
        """Number of epochs."""
        return self.stop_epoch - self.first_epoch


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Epochs and blocks of noise, cut into calls of one shape.

    Attributes:
        epoch_count: epochs.
        draws: noise draws at each.
        epochs_per_call, blocks_per_call: the shape of every call.
        noise_from: number of the first block of noise; chunks count blocks from there.
    """

    epoch_count: int
    draws: int
    epochs_per_call: int
    blocks_per_call: int
    noise_from: int = 0

    @property
    def blocks(self) -> int:
        """Blocks of noise in all."""
        return math.ceil(self.draws / LANES)

    @property
    def block_groups(self) -> int:
        """Calls that the noise of an epoch takes."""
        return math.ceil(self.blocks / self.blocks_per_call)

    @property
    def chunk_count(self) -> int:
        """Number of calls."""
        return math.ceil(self.epoch_count / self.epochs_per_call) * self.block_groups

    def chunk(self, number: int) -> Chunk:
        """The call of that number: all blocks of some epochs come before the next epochs."""
        epoch_group, block_group = divmod(number, self.block_groups)
        first_epoch = epoch_group * self.epochs_per_call
        stop_epoch = min(first_epoch + self.epochs_per_call, self.epoch_count)
        return Chunk(first_epoch, stop_epoch, block_group * self.blocks_per_call)

    def places(self, chunk: Chunk) -> NDArray[np.int64]:
        """(epochs_per_call,), the epochs of a call; where it is not full, the last one again and again."""
        places = np.arange(chunk.first_epoch, chunk.first_epoch + self.epochs_per_call)
        return np.minimum(places, chunk.stop_epoch - 1)

    def draws_of(self, chunk: Chunk) -> int:
        """Draws that a call counts for each of its faults."""
        return min(self.draws - chunk.first_block * LANES, self.blocks_per_call * LANES)

    def noise_of(self, chunk: Chunk) -> tuple[np.int32, np.int32, np.int32]:
        """First block of a call, the block up to which draws count whole, and how many draws of that one count.

        Draws beyond the call are other calls', also where several devices round its blocks up.
        """
        whole, rest = divmod(chunk.first_block * LANES + self.draws_of(chunk), LANES)
        return np.int32(self.noise_from + chunk.first_block), np.int32(self.noise_from + whole), np.int32(rest)


def run_calls(
    cut: Cut,
    function: Callable[..., Any],
    *,
    precision: str,
    threads: int = 1,
    chunks: Iterable[Chunk] | None = None,
    compiled: bool = False,
    what: str = "",
    show: bool | None = False,
) -> Iterator[tuple[Chunk, Any]]:
    """Make the calls of a cut in order, in a few threads, and give each with its result as NumPy arrays.

    Args:
        cut: the work.
        function: makes a call, given its chunk and the three numbers of `Cut.noise_of`. It runs, and its arrays are
            made, in the scope of the precision.
        precision: ``float64`` or ``float32``.
        threads, compiled: as for `pl_mc.runtime.threads.in_order`.
        chunks: the calls; all of them unless given.
        what, show: of a progress bar for all calls.
    """

    def run(chunk: Chunk) -> Any:
        with precision_scope(precision):
            return jax.tree.map(np.asarray, function(chunk, *cut.noise_of(chunk)))

    every = map(cut.chunk, range(cut.chunk_count)) if chunks is None else chunks
    results = in_order(run, every, threads, compiled=compiled)
    return with_progress(results, total=cut.chunk_count, what=what, show=show)
