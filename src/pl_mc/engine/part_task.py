"""What is counted in parts, a sweep or a service volume, as those see it that store, run and compare tasks.

A task has an identity: what decides its counts, in a form that can be stored, compared and told.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import jax
import numpy as np
import pyarrow as pa

from pl_mc.engine.compiling import instruction_set, sweep_options
from pl_mc.noise_models import GAUSSIAN


@dataclass(frozen=True)
class Kind:
    """What a task is, in words.

    Attributes:
        name: ``sweep``, say.
        record: file that names the task in a folder of its parts; it begins with an underscore, so that readers of
            a folder of Parquet files leave it out.
        edge: that at whose edge another environment can count a scenario otherwise.
        unit: what a call computes many of, for the progress bar.
    """

    name: str
    record: str
    edge: str
    unit: str


class Part(Protocol):
    """What one part counted."""

    @property
    def number(self) -> int:
        """The part's number, from 0."""


P = TypeVar("P", bound=Part)


class Task(Protocol[P]):
    """Something that is counted in parts."""

    @property
    def kind(self) -> Kind:
        """What it is."""

    @property
    def part_count(self) -> int:
        """Number of parts."""

    def asked(self) -> dict[str, Any]:
        """All that decides the counts, in a form that can be stored as JSON and compared."""

    def work_of(self, numbers: Sequence[int]) -> tuple[int, float]:
        """Calls that these parts take, at least one part, and units (`Kind.unit`) of a call on average."""

    def part_rows(self, part: P) -> pa.Table:
        """A part as it is stored."""

    def part_of(self, number: int, rows: pa.Table) -> P:
        """The part behind its rows; a `KeyError`, `TypeError` or `ValueError` where they are not those of one."""


Identity = Mapping[str, Mapping[str, Any]]

# What was asked for; and where it runs, which can move the last bits of a number.
ASKED, WHERE = "experiment", "environment"

# What a field that is left out means.
_UNSAID = {"noise": repr(GAUSSIAN)}


def identity_of(task: Task[Any]) -> Identity:
    """Two tasks with the same identity give the same counts."""
    return {ASKED: task.asked(), WHERE: environment()}


def environment() -> dict[str, Any]:
    """Versions and machine, as far as they can change a bit of a result."""
    return {
        "pl_mc": importlib.metadata.version("pl_mc"),
        "jax": importlib.metadata.version("jax"),
        "jaxlib": importlib.metadata.version("jaxlib"),
        "backend": jax.default_backend(),
        "device": jax.local_devices()[0].device_kind,
        "instruction set": instruction_set(),
        "compiler options": sweep_options(),
        "compiler flags": _compiler_flags(),
    }


def fingerprint(section: Mapping[str, Any]) -> str:
    """A short name of a section of an identity."""
    return hashlib.sha256(json.dumps(section, sort_keys=True).encode()).hexdigest()


def differences(before: Identity, now: Identity, sections: Sequence[str] = (ASKED, WHERE)) -> list[str]:
    """What changed, as ``draws: 100 before, 200 now``."""
    found = []
    for section in sections:
        old, new = before.get(section, {}), now.get(section, {})
        for field in [*old, *(field for field in new if field not in old)]:
            if old.get(field) != new.get(field):
                told = field in ("geometry", "faults")
                was, is_now = (part.get(field, _UNSAID.get(field)) for part in (old, new))
                found.append(f"{field}" if told else f"{field}: {was} before, {is_now} now")
    return found


def array_fingerprint(*parts: Any) -> str:
    """A short name of arrays, or of what makes them: types, shapes and every bit."""
    total = hashlib.sha256()
    for part in parts:
        array = np.asarray(part)
        total.update(f"{array.dtype.str}{array.shape}".encode())
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def _compiler_flags() -> list[str]:
    """What the caller told the compiler, but for the number of devices, which moves no bit."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    return sorted(flag for flag in flags if not flag.startswith("--xla_force_host_platform_device_count"))
