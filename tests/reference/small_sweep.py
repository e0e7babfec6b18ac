"""One small sweep, for the tests of how sweeps are cut, stored, resumed and spread; a call takes milliseconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.engine import EVENTS, Execution, plan, run_sweep
from pl_mc.engine.calls import Chunk
from pl_mc.engine.task import SweepTask
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Igg3, as_methods
from reference.problems import random_series

COUNTS = [event.count for event in EVENTS]
METHODS = ("ls", Igg3(iterations=1))
DRAWS = 5 * LANES + 7
SEED = 51

# Four faults and six blocks at four epochs: 24 calls of one block at one epoch each.
PER_CALL = 4 * LANES


def small_series() -> pl_mc.Geometry:
    in_view = np.ones((4, 8), dtype=bool)
    in_view[1, 2] = in_view[2, :4] = in_view[3, 5] = False
    return random_series(np.random.default_rng(50), in_view, "GGGGGCCC", noise=4.0)


SERIES = small_series()
FAULTS = (
    pl_mc.no_fault(SERIES)
    + pl_mc.biases(SERIES, {"G01": 40.0})
    + pl_mc.biases(SERIES, {"G03": 40.0, "C06": -50.0})
    + pl_mc.biases(SERIES, {"C07": 70.0})
)


def drawn_faults() -> pl_mc.Faults:
    """Faults of drawn sizes for the same series."""
    return pl_mc.biases(SERIES, "C07:uniform(20,90)m") + pl_mc.biases(SERIES, "C:+-30m independent:1-3")


def run(*, faults: pl_mc.Faults = FAULTS, **options) -> pd.DataFrame:
    """The small sweep."""
    return pl_mc.sweep(SERIES, faults, **({"draws": DRAWS, "seed": SEED, "methods": METHODS} | options))


def run_stored(folder: Path, **options) -> pd.DataFrame:
    """The small sweep from what is stored alone."""
    return run_sweep(
        SERIES, FAULTS, draws=DRAWS, seed=SEED, methods=METHODS, alert=pl_mc.LPV_200, precision="float64",
        execution=Execution(folder=folder, stored_only=True), **options,
    )  # fmt: skip


def task(**options) -> SweepTask:
    """The small sweep as a record."""
    given = {"draws": DRAWS, "seed": SEED, "methods": as_methods(METHODS), "alert": pl_mc.LPV_200}
    return SweepTask(SERIES, FAULTS, **(given | {"precision": "float64"} | options))


@contextmanager
def cut(per_part: int, per_call: int = PER_CALL) -> Iterator[None]:
    """Sweeps in this scope are cut into small calls and parts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "SCENARIOS_PER_CALL", per_call)
        patch.setattr(plan, "CALLS_PER_PART", per_part)
        yield


@contextmanager
def counted_calls() -> Iterator[list[Chunk]]:
    """A list of the calls that are computed in this scope."""
    calls: list[Chunk] = []
    count = SweepTask.count

    def noted(self: SweepTask, chunk: Chunk, *noise: np.int32, devices: int = 1):
        calls.append(chunk)
        return count(self, chunk, *noise, devices=devices)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SweepTask, "count", noted)
        yield calls


def contents(folder: Path) -> dict[str, bytes]:
    """The bytes of every file in a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def assert_same(found: pd.DataFrame, expected: pd.DataFrame) -> None:
    """Bit for bit the same tables; notes aside."""
    found, expected = found.copy(), expected.copy()
    found.attrs = expected.attrs = {}
    pd.testing.assert_frame_equal(found, expected, check_exact=True)
