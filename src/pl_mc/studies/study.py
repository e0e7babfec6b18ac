"""What a kind of experiment is: one record in one folder, with all that the rest of the house asks of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import pandas as pd

from pl_mc.alert import unjudged_note
from pl_mc.engine import Execution
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.findings import Findings, Picture
from pl_mc.studies.spec import Experiment

# A field, and an act that raises an `InputError` where the field cannot be used.
Check = tuple[str, Callable[[], object]]
Checks = Callable[[Any, Geometry | None], Iterator[Check]]


class Parted(Protocol):
    """Something large that is cut into parts, which are stored, resumed and shared; `PlannedSweep` is one.

    ``name`` is that of its folder of parts.
    """

    @property
    def name(self) -> str: ...

    def run(self, experiment: Any, execution: Execution, /) -> pd.DataFrame:
        """The table; its ``attrs`` have ``notes``."""


@dataclass(frozen=True)
class Work:
    """What a run costs.

    Attributes:
        scenarios: cases of fault and noise, times methods; None where there is no such number.
        seconds: on two cores, without start and compilation.
        remark: words about the estimate, to follow a semicolon; empty where there is nothing to say.
    """

    scenarios: int | None
    seconds: float
    remark: str = ""


def no_checks(record: Any, g: Geometry | None) -> Iterator[Check]:
    """The checks of a kind whose record and geometry say all."""
    yield from ()


def no_pictures(tables: Mapping[str, pd.DataFrame], experiment: Any) -> tuple[Picture, ...]:
    """The pictures of a kind without any."""
    return ()


@dataclass(frozen=True)
class Study:
    """A kind of experiment.

    Attributes:
        model: the record of its file; fields say what they mean.
        question: what it asks, in a sentence; a function of the experiment where that depends on it.
        run: ``run(experiment, execution)``, the findings; it writes nothing.
        answer: ``answer(tables, experiment)``, the answer in three sentences with numbers, from the tables that the
            page shows, by name.
        pictures: ``pictures(tables, experiment)``, the figures that are drawn from the stored tables, by name, so that
            they can be drawn again; a figure whose table is not there says so when it is drawn.
        sweeps: ``sweeps(experiment)``, what of it is cut into parts that can be stored, resumed and shared; None
            where nothing is.
        work: ``work(experiment)``, what a run costs. None where its sweeps are all that costs something.
        beside: ``beside(experiment)``, what a run costs beside its sweeps.
        checks: what the kind asks for besides what its record and a geometry can tell; ``checks(record, g)`` with
            no geometry where there is none or an unsound one.
        with_faults: ``with_faults(content, texts)``, what fields of a file become where faults as texts take the place
            of its own; None for a kind that injects none, or a sort of its own.
        outline: fields of a file to begin with, for a kind of which no experiment comes with the package.
    """

    model: type[Experiment]
    question: str | Callable[[Any], str]
    run: Callable[[Any, Execution], Findings]
    answer: Callable[[Mapping[str, pd.DataFrame], Any], tuple[str, ...]]
    pictures: Callable[[Mapping[str, pd.DataFrame], Any], tuple[Picture, ...]] = no_pictures
    sweeps: Callable[[Any], tuple[Parted, ...]] | None = None
    work: Callable[[Any], Work] | None = None
    beside: Callable[[Any], Work] | None = None
    checks: Checks = no_checks
    with_faults: Callable[[Mapping[str, Any], tuple[str, ...]], Mapping[str, Any]] | None = None
    outline: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.sweeps is None and self.work is None:
            raise TypeError(f"{self.model.__name__}: a study without sweeps says what it costs.")

    def found(self, experiment: Any, execution: Execution) -> Findings:
        """What a run finds, with what it does not judge among its notes."""
        findings = self.run(experiment, execution)
        further = tuple(filter(None, [unjudged_note(experiment.alert_limits(), experiment.judged_axes())]))
        return replace(findings, notes=(*findings.notes, *further))

    def asks(self, experiment: Experiment) -> str:
        """What an experiment of this kind asks, in a sentence."""
        return self.question if isinstance(self.question, str) else self.question(experiment)


def refuse(reason: str) -> None:
    """An act of a check that fails whatever it is asked for."""
    raise InputError(reason)
