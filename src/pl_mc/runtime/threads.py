"""Calls of one compiled function, shared among a few threads."""

from __future__ import annotations

import os
import platform
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(
    run: Callable[[Item], Result], items: Iterable[Item], threads: int, *, compiled: bool = False
) -> Iterator[tuple[Item, Result]]:
    """Each item with its result, in order, computed by a few threads that stay little ahead of the reader.

    A reader that stops waits for the calls that run and for none that waits. No item runs in the reader's own thread:
    Ctrl-C must find that one waiting, and not inside a compiler; then nobody waits for what a compiler is at.

    Args:
        run: what to do with an item.
        items: the items.
        threads: number of threads.
        compiled: whether the compiled function behind ``run`` is there; else the first call, which compiles, runs
            alone, so that the others find it.
    """
    rest = iter(items)
    waiting: deque[tuple[Item, Future[Result]]] = deque()
    pool = ThreadPoolExecutor(threads)
    try:
        for item in () if compiled else rest:
            yield item, pool.submit(run, item).result()
            break
        for item in rest:
            waiting.append((item, pool.submit(run, item)))
            if len(waiting) > 2 * threads:
                done, future = waiting.popleft()
                yield done, future.result()
        while waiting:
            done, future = waiting.popleft()
            yield done, future.result()
    except KeyboardInterrupt:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processor_name() -> str:
    """The processor's own name, or its family where that cannot be read."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
