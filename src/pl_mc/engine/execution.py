"""How and where a task runs, none of which changes a count; and the running."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

from pl_mc.engine.checkpoint_store import BadPart, CheckpointStore
from pl_mc.engine.compiling import require_devices
from pl_mc.engine.part_task import P, Task
from pl_mc.engine.task import Engine, PartCounts, SweepTask
from pl_mc.input_errors import InputError, hold_whole, require_list, require_path, require_truth, require_whole, shown
from pl_mc.runtime.progress import progress_bar
from pl_mc.runtime.threads import cores


@dataclass(frozen=True)
class Execution:
    """How a sweep or a service volume runs.

    Attributes:
        workers: threads that compute; as many as cores unless given, one where there are several devices.
        devices: devices of this machine that share each call.
        scheduler: a Dask scheduler, ``tcp://host:port``, or ``local`` or ``local:N`` for N processes here; None
            computes in this process.
        folder: where finished parts are stored; None keeps nothing.
        resume: go on with the parts that the folder holds.
        shard: (i, n), count the i-th of n shares of the parts alone, i from 1.
        stored_only: count nothing, take all parts from the folder, from whatever machine they come.
        progress: whether to show a progress bar; where standard error is a terminal unless given.
        said: gets a sentence for each stored part that was of no use, whatever becomes of the table.
    """

    workers: int | None = None
    devices: int | None = None
    scheduler: str | None = None
    folder: Path | None = None
    resume: bool = False
    shard: tuple[int, int] | None = None
    stored_only: bool = False
    progress: bool | None = None
    said: list[str] = field(default_factory=list, compare=False)

    @property
    def threads(self) -> int:
        """Threads of what is not cut into parts: ``workers``, as many as cores unless given."""
        return cores() if self.workers is None else self.workers

    def __post_init__(self) -> None:
        for name in ("resume", "stored_only"):
            require_truth(getattr(self, name), field=name)
        if self.progress is not None:
            require_truth(self.progress, field="progress")
        if self.scheduler is not None and not isinstance(self.scheduler, str):
            raise InputError(
                f"scheduler: an address such as tcp://host:8786, or local, is needed, not {shown(self.scheduler)}."
            )
        if self.folder is not None:
            require_path(self.folder, field="folder")
        for name in ("devices", "workers"):
            if getattr(self, name) is not None:
                hold_whole(self, name, low=1)
        if self.shard is not None:
            given = require_list(self.shard, field="shard", of="two numbers, which shard of how many,")
            if len(given) != 2:
                raise InputError(f"shard: two numbers are needed, which shard of how many, not {shown(self.shard)}.")
            index, count = given
            count = require_whole(count, field="shard: the number of shards", low=1)
            index = require_whole(index, field="shard: the shard", low=1, high=count)
            object.__setattr__(self, "shard", (index, count))

    def inside(self, name: str) -> Execution:
        """The same for one of several sweeps of an experiment, with a folder of its own."""
        return self if self.folder is None else replace(self, folder=self.folder / name)

    def share_of(self, part_count: int) -> list[int]:
        """Numbers of the parts, of so many, that are this process's to count, in order."""
        index, count = self.shard or (1, 1)
        return list(range(index - 1, part_count, count))


def run_task(
    task: Task[P], execution: Execution, count: Callable[[Sequence[int], Callable[[], None]], Generator[P]]
) -> Iterator[P | str]:
    """The parts of a task in no certain order, stored where they are to be; and a sentence for each bad part file.

    Args:
        task: what is counted.
        execution: how.
        count: counts parts, in whatever order, and calls its second argument after each call.

    Raises:
        InputError: parts of another task, a folder that cannot be written, missing parts where none may be.
    """
    numbers = execution.share_of(task.part_count)
    store = None
    missing = numbers
    damaged: list[str] = []
    if execution.folder is not None:
        store = CheckpointStore(
            execution.folder, task, numbers=None if execution.shard is None else numbers,
            resume=execution.resume or execution.stored_only, any_machine=execution.stored_only,
        )  # fmt: skip
        there = set(store.stored())
        if not execution.stored_only:
            store.begin()
        missing = [number for number in numbers if number not in there]
        for number in numbers:
            if number not in there:
                continue
            try:
                part = store.read(number)
            except BadPart as bad:
                missing.append(number)
                damaged.append(str(bad))
            else:
                yield part
        said = [
            *([] if execution.stored_only else [f"{bad}; it was counted again." for bad in damaged]),
            *store.notes(),
        ]
        execution.said.extend(said)
        yield from said
    if execution.stored_only and missing:
        told = ", ".join(str(number) for number in sorted(missing)[:8])
        more = f" and {len(missing) - 8} more" if len(missing) > 8 else ""
        what = f"damaged ({damaged[0]})" if len(damaged) == len(missing) else "missing or damaged"
        raise InputError(
            f"{execution.folder}: part {told}{more} of {len(numbers)} (counted from 0) is {what}; run the shards "
            "that count them again."
        )
    if not missing:
        return
    calls, each = task.work_of(missing)
    what, unit = task.kind.name.capitalize(), task.kind.unit
    with (
        progress_bar(total=calls, what=what, show=execution.progress, each=each, unit=unit) as advance,
        # However this ends, threads and processes that count end with it.
        closing(count(sorted(missing), advance)) as parts,
    ):
        for part in parts:
            if store is not None:
                store.write(part)
            yield part


def sweep_engine(execution: Execution) -> Engine:
    """What counts the parts of a sweep; an `InputError` for devices that are not there."""
    if execution.scheduler is not None:
        from pl_mc.engine.dask_adapter import dask_engine

        return dask_engine(execution.scheduler, workers=execution.workers, devices=execution.devices)
    devices = require_devices(execution.devices)
    threads = execution.workers or (cores() if devices == 1 else 1)

    def here(task: SweepTask, numbers: Sequence[int], after_call: Callable[[], None]) -> Generator[PartCounts]:
        return task.count_parts(numbers, threads=threads, devices=devices, after_call=after_call)

    return here
