"""The sweeps of an experiment, named apart from what is made of them, so that other processes can count them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pl_mc.engine import Execution, run_sweep
from pl_mc.engine.checkpoint_store import read_rows
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.methods import Method
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.studies.spec import Experiment


@dataclass(frozen=True)
class PlannedSweep:
    """One sweep of an experiment.

    Attributes:
        name: its name within the experiment.
        g: geometry.
        faults: faults.
        draws: noise draws for each fault at each epoch.
        noise: the noise.
        methods: instead of the experiment's, unless none.
    """

    name: str
    g: Geometry
    faults: Faults
    draws: int
    noise: NoiseModel = GAUSSIAN
    methods: tuple[Method, ...] = ()

    def methods_of(self, experiment: Experiment) -> tuple[Method, ...]:
        """The methods of this sweep."""
        return self.methods or experiment.method_records()

    def run(self, experiment: Experiment, execution: Execution) -> pd.DataFrame:
        """The table, see `pl_mc.sweep`; parts are stored in a folder of the sweep's own."""
        return run_sweep(
            self.g, self.faults, draws=self.draws, seed=experiment.seed, methods=self.methods_of(experiment),
            alert=experiment.alert_limits(), axes=experiment.asked_axes(), precision=experiment.precision,
            noise=self.noise, execution=execution.inside(self.name),
        )  # fmt: skip

    def stored(self, execution: Execution) -> Path:
        """The folder with the rows of every epoch, of a sweep that has run; `pandas.read_parquet` reads it."""
        assert execution.folder is not None
        return execution.folder / self.name

    def rows(self, execution: Execution) -> Iterator[pd.DataFrame]:
        """These rows, part by part."""
        return read_rows(self.stored(execution))
