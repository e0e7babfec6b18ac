"""Counting a service volume: its parts, stored or computed, joined in order."""

from __future__ import annotations

from collections import deque

from pl_mc.engine.execution import Execution, run_task
from pl_mc.input_errors import InputError
from pl_mc.runtime.threads import cores
from pl_mc.service.counting import ServiceCounts
from pl_mc.service.task import ServiceTask


def count_service(task: ServiceTask, execution: Execution) -> tuple[ServiceCounts, tuple[str, ...]]:
    """The counts of all sites (of one share: of its sites, zero elsewhere), and a sentence for each bad part file.

    The result is bit for bit the same however often it was stopped and resumed.

    Raises:
        InputError: parts of another service volume, a folder that cannot be written, missing parts where none may
            be, or a way to run that service volumes do not have.
    """
    _require_possible(execution)
    task.require_satellites()
    task.require_noise(task.geometries(next(task.batches_of(0))))
    threads = execution.workers or cores()
    total, notes = task.nothing(len(task.grid)), []
    rest, early = deque(execution.share_of(task.part_count)), {}
    for found in run_task(
        task, execution, lambda numbers, after: task.count_parts(numbers, threads=threads, after_call=after)
    ):
        if isinstance(found, str):
            notes.append(found)
            continue
        early[found.number] = found.counts
        # In the order of the parts, so that sums round alike.
        while rest and rest[0] in early:
            total.join(task.sites_of(rest[0]), early.pop(rest.popleft()))
    return total, tuple(notes)


def _require_possible(execution: Execution) -> None:
    if execution.scheduler is not None or execution.devices is not None:
        field = "scheduler" if execution.scheduler is not None else "devices"
        raise InputError(
            f"{field}: a service volume runs in threads of one process; share it among jobs by a shard instead."
        )
