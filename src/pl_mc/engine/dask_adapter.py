"""Parts of a sweep on the workers of a Dask cluster (adapter of dask.distributed, the extra ``pl_mc[dask]``).

Only counts come back, and this process stores them: workers need no file system in common. A worker that dies costs
the parts that it was at; Dask gives them to another.
"""

from __future__ import annotations

import contextlib
import itertools
import pickle
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from pl_mc.engine.compiling import require_devices
from pl_mc.engine.part_task import environment
from pl_mc.engine.task import Engine, PartCounts, SweepTask
from pl_mc.input_errors import InputError, shown
from pl_mc.runtime.threads import cores

# How often a part is given out again, after the workers that had it died.
RETRIES = 3

# Parts in flight for each worker: one at work, one waiting, so that a worker never waits for this process.
AHEAD = 2

# How long to wait for a scheduler that does not answer.
PATIENCE = "10s"

# How long a scheduler may be without workers, which it may start anew, and how often that is looked at.
LONELY_S, LOOK_S = 15.0, 1.0

# How long to wait for a part that is finished, which is a table of counts, before workers are looked for.
FETCH_S = 5.0


def dask_engine(scheduler: str, *, workers: int | None, devices: int | None) -> Engine:
    """An engine on the scheduler at an address (``tcp://host:port``), or on ``local`` or ``local:N`` processes.

    Args:
        scheduler: where.
        workers: threads that each part uses; unless given, all cores of a remote worker, and one for a local one.
        devices: devices of its machine that each part uses.

    Raises:
        InputError: Dask is not installed, no scheduler answers, it has no workers, or one differs from here.
    """

    def engine(task: SweepTask, numbers: Sequence[int], after_call: Callable[[], None]) -> Generator[PartCounts]:
        with _client(scheduler, threads=workers) as client:
            from distributed import as_completed
            from distributed.protocol.pickle import dumps

            here = environment()
            _require_equal_workers(client, here)
            # The plan, once made, goes along. A result, unlike data that are scattered, is made again when all
            # workers that hold it died.
            assert task.plan.part_count
            # Methods that a script defined are packed with their code.
            shared = client.submit(pickle.loads, dumps(task), pure=False, retries=RETRIES)
            threads = workers if workers is not None else (1 if scheduler.startswith("local") else None)

            def submit(number: int) -> Any:
                work = (_count_part, shared, number, threads, devices, here)
                return client.submit(*work, pure=False, retries=RETRIES)

            waiting = iter(numbers)
            window = AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
            finished = as_completed([submit(number) for number in itertools.islice(waiting, window)])
            watch = _Watch(client)
            for future in watch.each(finished):
                part = _result(future, watch)
                for number in itertools.islice(waiting, 1):
                    finished.add(submit(number))
                for _ in task.plan.chunks(part.number):
                    after_call()
                yield part

    return engine


def _count_part(
    task: SweepTask, number: int, threads: int | None, devices: int | None, there: Mapping[str, Any]
) -> PartCounts:
    """One part, on a worker; ``there`` is the environment of the process that asks."""
    # Workers may come at any time, after those that were there had been looked at.
    _require_equal("the worker that was given a part", environment(), there)
    parts = task.count_parts([number], threads=threads or cores(), devices=require_devices(devices))
    return next(iter(parts))


class _Watch:
    """The time for which a scheduler has had no workers, who could do or hand over what is waited for."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.deserted = time.monotonic()

    def look(self) -> None:
        """Raise `InputError` where that is too long."""
        if _workers(self.client):
            self.deserted = time.monotonic()
        elif time.monotonic() - self.deserted > LONELY_S:
            raise InputError(
                f"scheduler: all its workers are gone, for {LONELY_S:g} s; what was finished before is kept and can be "
                "resumed."
            )

    def each(self, finished: Any) -> Iterator[Any]:
        """The futures as they are done."""
        while finished.count():
            if finished.has_ready():
                yield next(finished)
                continue
            self.look()
            with finished.thread_condition:
                finished.thread_condition.wait(timeout=LOOK_S)


def _workers(client: Any) -> int:
    try:
        return len(client.scheduler_info(n_workers=-1)["workers"])
    except Exception:  # A scheduler that does not answer has none; the types differ with what is wrong.
        return 0


def _result(future: Any, watch: _Watch) -> PartCounts:
    try:
        while True:
            try:
                return future.result(timeout=FETCH_S)
            except TimeoutError:
                # Its worker may have died since; then another one counts it again, if there is any.
                watch.look()
    except InputError:
        raise
    except Exception as error:
        if type(error).__name__ not in ("KilledWorker", "FutureCancelledError", "CancelledError"):
            raise
        raise InputError(
            f"scheduler: a part was given out {RETRIES + 1} times or lost with its scheduler, and never came back "
            f"({type(error).__name__}); what was finished before is kept and can be resumed."
        ) from None


@contextlib.contextmanager
def _client(scheduler: str, *, threads: int | None) -> Iterator[Any]:
    local = scheduler == "local" or scheduler.startswith("local:")
    if not local and not _is_address(scheduler):
        raise InputError(f"scheduler: an address such as tcp://host:8786, or local, is needed, not {shown(scheduler)}.")
    count = _local_workers(scheduler, threads or 1) if local else 0
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("scheduler: Dask is not installed; pip install 'pl_mc[dask]' brings it.") from None
    options = {
        # JAX must not be forked; a process that starts from nothing is the only safe one.
        "distributed.worker.multiprocessing-method": "spawn",
        # The geometry of a day with all its faults is sent once; it is no graph that could be smaller.
        "distributed.admin.large-graph-warning-threshold": "1TiB",
    }
    with dask.config.set(options):
        if local:
            with (
                LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    processes=True,
                    # Any free port, for this machine alone; None would mean the usual one, and a warning if taken.
                    dashboard_address="127.0.0.1:0",
                    silence_logs=50,
                ) as cluster,
                Client(cluster) as client,
            ):
                yield client
            return
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except Exception as error:  # Its types differ with what is wrong, and with the version.
            reason = " ".join(str(error).split())[:100] or type(error).__name__
            raise InputError(f"scheduler: no scheduler answers at {scheduler} ({reason}).") from None
        with client:
            yield client


def _is_address(scheduler: str) -> bool:
    try:
        found = urlsplit(scheduler)
        return found.scheme in ("tcp", "tls") and bool(found.hostname) and bool(found.port)
    except ValueError:  # No number of a port.
        return False


def _local_workers(scheduler: str, threads: int) -> int:
    _, colon, given = scheduler.partition(":")
    if not colon:
        return max(1, cores() // threads)
    if not (given.isascii() and given.isdigit() and len(given) < 10) or int(given) < 1:
        raise InputError(f"scheduler: local:N needs a number of processes, such as local:4, not {shown(scheduler)}.")
    return int(given)


def _require_equal_workers(client: Any, here: Mapping[str, Any]) -> None:
    """Raise `InputError` unless there are workers, and each would give the numbers of this process."""
    found = client.run(environment, on_error="return")
    if not found:
        raise InputError("scheduler: it has no workers; start some with dask worker.")
    # One that is lost while it is asked (a connection ends, which is an `OSError` or one of Dask's) counts nothing.
    lost = {name: said for name, said in found.items() if isinstance(said, OSError | TimeoutError | KeyError)}
    if len(lost) == len(found):
        raise InputError(f"scheduler: its workers were lost while they were asked for their versions ({_why(lost)}).")
    for worker, there in found.items():
        if worker in lost:
            continue
        if isinstance(there, Exception):  # Whatever a worker says that cannot run this at all.
            reason = _why({worker: there})
            raise InputError(f"scheduler: its workers need pl_mc {here['pl_mc']} installed ({reason}).")
        _require_equal(f"worker {worker}", there, here)


def _why(errors: Mapping[str, Exception]) -> str:
    error = next(iter(errors.values()))
    return " ".join(str(error).split())[:100].rstrip(".") or type(error).__name__


def _require_equal(worker: str, there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    wrong = [
        f"{field} {there.get(field)} there, {value} here" for field, value in here.items() if there.get(field) != value
    ]
    if wrong:
        raise InputError(f"scheduler: {worker} would count in another environment ({'; '.join(wrong)}).")
