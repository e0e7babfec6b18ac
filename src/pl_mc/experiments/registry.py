"""Kinds of experiments: the record that checks a file, and the function that runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pl_mc.experiments import observe_run, sweep_run
from pl_mc.experiments.common import Experiment


@dataclass(frozen=True)
class Kind:
    """One kind of experiment.

    Attributes:
        model: the record of its file.
        run: ``run(experiment, folder, progress=...)`` writes the results and returns a summary and notes.
    """

    model: type[Experiment]
    run: Callable[..., tuple[str, tuple[str, ...]]]


KINDS: dict[str, Kind] = {
    "sweep": Kind(sweep_run.SweepExperiment, sweep_run.run),
    "observe": Kind(observe_run.ObserveExperiment, observe_run.run),
}
