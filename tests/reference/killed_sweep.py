"""A small sweep in a process of its own, which is killed; and what stands in its folder afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from pl_mc.engine.checkpoint_store import CheckpointStore
from pl_mc.methods import as_methods
from reference import small_sweep as small
from reference.forked import Forked

METHODS = ("ls",)
PARTS = 12

_PROGRAM = """
import os, sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from reference import small_sweep as small
sync = os.fsync

def slow(number):
    sync(number)
    time.sleep({slow_s})

os.fsync = slow
Path({begun!r}).touch()
with small.cut(2):
    table = small.run(folder={folder!r}, resume=True, methods={methods!r}, workers=2)
table.to_pickle({table!r})
"""


def program(folder: Path, *, slow_s: float = 0.04) -> str:
    """The program that goes on with a sweep of `PARTS` parts in a folder.

    A file takes ``slow_s`` longer, between its temporary file and its place: most of the time the sweep is there.
    Beside the folder it leaves `table_of`, and, when the sweep begins, `begun_of`.
    """
    return _PROGRAM.format(
        tests=str(Path(__file__).parents[1]), slow_s=slow_s, begun=str(begun_of(folder)), folder=str(folder),
        methods=METHODS, table=str(table_of(folder)),
    )  # fmt: skip


def table_of(folder: Path) -> Path:
    """Where the table of the sweep in a folder is, when it has ended."""
    return folder.with_name(f"{folder.name}.pickle")


def begun_of(folder: Path) -> Path:
    """What is there when the sweep in a folder has begun."""
    return folder.with_name(f"{folder.name}.begun")


def ended_after(program: str, begun: Callable[[], bool], seconds: float) -> int:
    """The return code of a process that is killed some seconds after a moment; -9 where the kill hit it."""
    process = Forked(program)
    try:
        limit = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < limit:
            if begun():
                time.sleep(seconds)
                break
            time.sleep(0.002)
    finally:
        process.kill()
        process.communicate()
    return process.wait()


def whole_parts(folder: Path) -> set[int]:
    """Numbers of the parts in a folder; a `BadPart` where one is not whole."""
    with small.cut(2):
        store = CheckpointStore(folder, small.task(methods=as_methods(METHODS)), resume=True)
        return {store.read(number).number for number in store.stored()}
