"""Kinds of experiments: the record that checks a file, and the function that runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pl_mc.experiments import guo_run, map_run, observe_run, readings_run, satellite_ramp_run, series_run, sweep_run
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
    "guo": Kind(guo_run.GuoExperiment, guo_run.run),
    "map": Kind(map_run.MapExperiment, map_run.run),
    "readings": Kind(readings_run.ReadingsExperiment, readings_run.run),
    "satellite-ramps": Kind(satellite_ramp_run.SatelliteRampExperiment, satellite_ramp_run.run),
    "sweep": Kind(sweep_run.SweepExperiment, sweep_run.run),
    "observe": Kind(observe_run.ObserveExperiment, observe_run.run),
    "series": Kind(series_run.SeriesExperiment, series_run.run),
}
