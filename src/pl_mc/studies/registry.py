"""Kinds of experiments: the record that checks a file, and the function that runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pl_mc.studies.compare import run as compare_run
from pl_mc.studies.guo import run as guo_run
from pl_mc.studies.noise import run as noise_run
from pl_mc.studies.observe import run as observe_run
from pl_mc.studies.readings import run as readings_run
from pl_mc.studies.risk import run as risk_run
from pl_mc.studies.series import run as series_run
from pl_mc.studies.service import run as service_run
from pl_mc.studies.spec import Experiment
from pl_mc.studies.stanford import run as stanford_run
from pl_mc.studies.sweep import map as map_run
from pl_mc.studies.sweep import run as sweep_run
from pl_mc.studies.sweep import satellite_ramps as satellite_ramp_run
from pl_mc.studies.time_ramps import run as time_ramps_run
from pl_mc.studies.tuning import run as tuning_run
from pl_mc.studies.variants import run as variants_run


@dataclass(frozen=True)
class Kind:
    """One kind of experiment.

    Attributes:
        model: the record of its file.
        run: ``run(experiment, folder, execution=...)`` writes the results and returns a summary and notes.
        sweeps: ``sweeps(experiment)``, the sweeps that it runs, of kinds that can be resumed and shared; else None.
            Of a service volume it is what is cut into parts there in the same way.
    """

    model: type[Experiment]
    run: Callable[..., tuple[str, tuple[str, ...]]]
    sweeps: Callable[..., tuple[Any, ...]] | None = None


KINDS: dict[str, Kind] = {
    "compare": Kind(compare_run.CompareExperiment, compare_run.run, compare_run.sweeps),
    "guo": Kind(guo_run.GuoExperiment, guo_run.run),
    "map": Kind(map_run.MapExperiment, map_run.run, map_run.sweeps),
    "noise": Kind(noise_run.NoiseExperiment, noise_run.run, noise_run.sweeps),
    "readings": Kind(readings_run.ReadingsExperiment, readings_run.run),
    "satellite-ramps": Kind(
        satellite_ramp_run.SatelliteRampExperiment, satellite_ramp_run.run, satellite_ramp_run.sweeps
    ),
    "sweep": Kind(sweep_run.SweepExperiment, sweep_run.run, sweep_run.sweeps),
    "observe": Kind(observe_run.ObserveExperiment, observe_run.run),
    "risk": Kind(risk_run.RiskExperiment, risk_run.run),
    "stanford": Kind(stanford_run.StanfordExperiment, stanford_run.run),
    "variants": Kind(variants_run.VariantsExperiment, variants_run.run, variants_run.sweeps),
    "time-ramps": Kind(time_ramps_run.TimeRampsExperiment, time_ramps_run.run),
    "tuning": Kind(tuning_run.TuningExperiment, tuning_run.run),
    "series": Kind(series_run.SeriesExperiment, series_run.run),
    "service": Kind(service_run.ServiceExperiment, service_run.run, service_run.sweeps),
}
