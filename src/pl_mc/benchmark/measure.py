"""Timing side by side: every computation runs once in each round, so that a busy machine hits all alike."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from pl_mc.engine.compiling import instruction_set, sweep_options
from pl_mc.runtime.threads import cores, processor_name

# The share of the asked time below which another repetition would tell nothing.
_SHORTEST_S = 1e-9

_PACKAGES = ("pl_mc", "jax", "jaxlib", "numpy", "scipy", "statsmodels")


@dataclass(frozen=True)
class Computation:
    """Something that can be timed.

    Attributes:
        what: the computation.
        precision: ``float64`` or ``float32``.
        threads: threads that compute, as far as the computation decides it.
        devices: devices of JAX; 0 where JAX has no part in it.
    """

    what: str
    precision: str
    threads: int
    devices: int


@dataclass(frozen=True)
class Rate(Computation):
    """How fast one computation ran.

    Attributes:
        scenarios: scenarios of one repetition.
        seconds: time of each repetition [s].
        first_call_s: time of the first call of all, which compiles [s]; None where nothing is compiled then.
    """

    scenarios: int
    seconds: tuple[float, ...]
    first_call_s: float | None = None

    @property
    def rates(self) -> list[float]:
        """Million scenarios per second of each repetition."""
        return [self.scenarios / max(seconds, _SHORTEST_S) / 1e6 for seconds in self.seconds]

    @property
    def median_rate(self) -> float:
        """Million scenarios per second."""
        return statistics.median(self.rates)

    @property
    def best_rate(self) -> float:
        """Million scenarios per second."""
        return max(self.rates)


@dataclass(frozen=True)
class Ratio:
    """How many times as fast one computation is as another: median, least and largest of the rounds."""

    what: str
    to: str
    precision: str
    median: float
    low: float
    high: float

    @classmethod
    def of(cls, one: Rate, other: Rate) -> Ratio:
        """Round by round, as both were measured."""
        found = [a / b for a, b in zip(one.rates, other.rates, strict=True)]
        return cls(one.what, other.what, one.precision, statistics.median(found), min(found), max(found))


@dataclass(frozen=True)
class Contestant(Computation):
    """One computation to be timed.

    Attributes:
        unit: scenarios of the smallest repetition; others are multiples of it.
        run: does that many scenarios and gives the time that counts [s].
        compiles: whether its first call is worth a line.
        share: how much of the time of a repetition it gets.
        most: units of the largest repetition; None for no limit.
    """

    unit: int
    run: Callable[[int], float]
    compiles: bool = False
    share: float = 1.0
    most: int | None = None


def timed(call: Callable[[], object]) -> float:
    """Wall time of a call [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def measure(
    contestants: Sequence[Contestant],
    *,
    seconds: float,
    rounds: int,
    rounds_with_progress: Callable[[Iterable[int]], Iterable[int]] = lambda numbers: numbers,
) -> list[Rate]:
    """Time each computation for about ``seconds`` in all, in ``rounds`` repetitions that alternate.

    One call compiles, a second one finds the size of a repetition; neither counts.
    """
    first = [contestant.run(contestant.unit) for contestant in contestants]
    sizes = []
    for contestant in contestants:
        # One unit keeps one thread busy; several threads do several in the same time.
        each = contestant.run(contestant.unit) / contestant.threads
        units = max(1, int(contestant.share * seconds / rounds / max(each, _SHORTEST_S)))
        # As many for each thread: of an odd number of units one of two threads would wait for the last.
        if units > contestant.threads:
            units -= units % contestant.threads
        sizes.append(contestant.unit * (units if contestant.most is None else min(units, contestant.most)))
    times: list[list[float]] = [[] for _ in contestants]
    for _ in rounds_with_progress(range(rounds)):
        for contestant, size, found in zip(contestants, sizes, times, strict=True):
            found.append(contestant.run(size))
    return [
        Rate(c.what, c.precision, c.threads, c.devices, size, tuple(found), start if c.compiles else None)
        for c, size, found, start in zip(contestants, sizes, times, first, strict=True)
    ]


def describe_machine() -> dict[str, Any]:
    """What a measurement was made on, in words that name no person, path or host."""
    return {
        "processor": processor_name(), "cores": cores(), "memory_gb": _memory_gb(),
        "instruction_set": instruction_set(), "system": platform.system(), "backend": jax.default_backend(),
        "device": jax.local_devices()[0].device_kind, "devices": jax.local_device_count(),
        "compiler_options": sweep_options(), "versions": {"python": platform.python_version()} | versions(),
        "blas": _blas(), "load_average": load_average(),
    }  # fmt: skip


def load_average() -> list[float] | None:
    """Processes that wanted a core, averaged over 1, 5 and 15 minutes; None where the system does not tell."""
    return [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else None


def versions() -> dict[str, str]:
    """Versions of the packages that compute; those that are not installed are left out."""
    found = {}
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[package] = importlib.metadata.version(package)
    return found


def _memory_gb() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _blas() -> str:
    """The linear algebra library under NumPy."""
    config: Any = np.show_config(mode="dicts")
    blas = (config or {}).get("Build Dependencies", {}).get("blas", {})
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
