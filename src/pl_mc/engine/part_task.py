"""What is counted in parts, a sweep or a service volume, as the store of parts and the running of them see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import pyarrow as pa


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
