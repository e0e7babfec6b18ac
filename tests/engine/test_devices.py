"""Several devices, and several blocks at a time, give the counts of one."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import jax
import numpy as np
import pytest

from pl_mc.alert import LPV_200
from pl_mc.engine.core import count_epochs
from pl_mc.input_errors import InputError
from pl_mc.kernels.events import limits_of
from pl_mc.kernels.noise import LANES
from pl_mc.methods import as_methods
from pl_mc.runtime.precision import dtype_of
from reference import small_sweep as small
from reference.forked import Forked
from reference.small_sweep import cut

# Bits, across threads, parts and processes: as users compile.
pytestmark = pytest.mark.optimised

TESTS = Path(__file__).parents[1]

PROGRAM = """
import sys, tempfile, warnings
from pathlib import Path
warnings.simplefilter("error")
sys.path.insert(0, {tests!r})
import jax
from pl_mc.kernels.noise import LANES
from pl_mc.input_errors import InputError
from reference import small_sweep as small

assert jax.local_device_count() == 2
ls = {{"methods": ("ls",)}}
# Three blocks a call, which two devices do not share evenly.
with small.cut(2, 12 * LANES):
    assert small.task().plan.blocks_per_call == 3
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        alone = small.run(folder=first, workers=1, **ls)
        for workers in (1, 3):
            small.assert_same(small.run(devices=2, workers=workers, **ls), alone)
        # A sweep goes on with another number of devices, and its files are the same to the byte.
        small.run(folder=second, shard=(1, 2), devices=2, **ls)
        small.assert_same(small.run(folder=second, resume=True, **ls), alone)
        assert small.contents(Path(first)) == small.contents(Path(second))
# All six in one call.
with small.cut(2, 2**20):
    assert small.task().plan.blocks_per_call == 6
    small.assert_same(small.run(devices=2, **ls), alone)
# What is drawn of faults is drawn alike.
drawn = small.drawn_faults()
small.assert_same(small.run(faults=drawn, devices=2, **ls), small.run(faults=drawn, **ls))
try:
    small.run(devices=3)
except InputError as error:
    print(error)
print(*alone["alarms"])
"""


@pytest.mark.quick
def test_two_devices_count_as_one():
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=2"
    environment = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = Forked(PROGRAM.format(tests=str(TESTS)), env=environment)
    out, err = done.communicate()
    assert done.returncode == 0, err
    refused, alarms = out.splitlines()
    assert refused.startswith("devices: 3 were asked for, but JAX finds 2 (cpu); for more devices on a processor set")
    # One device among two counts as the only one.
    with cut(2):
        expected = small.run(methods=("ls",), workers=1)["alarms"].tolist()
    assert [int(count) for count in alarms.split()] == expected


def test_more_devices_than_there_are():
    with pytest.raises(InputError, match=rf"devices: 4096 were asked for, but JAX finds {jax.local_device_count()} "):
        small.run(devices=4096)
    with pytest.raises(InputError, match=r"devices: a whole number of at least 1 is needed, not 0\."):
        small.run(devices=0)


def test_a_refused_device_leaves_no_folder(tmp_path):
    with pytest.raises(InputError, match="devices"):
        small.run(devices=4096, folder=tmp_path / "sweep")
    assert not (tmp_path / "sweep").exists()


def test_blocks_together_count_as_one_after_the_other():
    """Also where groups are filled up with blocks that belong to the next call, or do not exist."""
    with cut(2, 2**20):
        task = small.task()
        (chunk,) = task.plan.chunks(0)
        batch = task.plan.batch(chunk, dtype_of("float64"))

    @partial(jax.jit, static_argnames=("blocks", "together"))
    def count(first_block, stop, *, blocks: int, together: int) -> jax.Array:
        return count_epochs(
            batch, np.uint32(small.SEED), first_block, stop // LANES, stop % LANES,
            limits_of(LPV_200, np.float64), as_methods(("ls",)), axes=("vertical",), blocks=blocks,
            together=together,
        )  # fmt: skip

    seen = []
    for first_block in np.arange(3, dtype=np.int32):
        stop = np.int32((first_block + 3) * LANES + 7)
        alone = np.asarray(count(first_block, stop, blocks=4, together=1))
        # Two groups of three for four blocks; one of nine for four that count.
        for blocks, together in ((4, 3), (9, 9)):
            np.testing.assert_array_equal(count(first_block, stop, blocks=blocks, together=together), alone)
        seen.append(alone)
    assert seen[0].any()
    assert (seen[0] != seen[1]).any()
