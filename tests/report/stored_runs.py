"""Results folders as runs leave them, made without running anything, so that pages can be tested quickly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import LPV_200
from pl_mc.engine.events import EVENTS
from pl_mc.engine.table import with_rates
from pl_mc.experiments.loading import build_experiment
from pl_mc.report.figures import save_figure
from pl_mc.studies.sweep.figures import rates_by_fault_figure

SIZES_M = (10.0, 25.0, 40.0, 55.0)
DRAWS = 400

CONTENT: dict[str, Any] = {
    "kind": "sweep",
    "title": "A ramp <b>for</b> tests & more",
    "draws": DRAWS,
    "seed": 5,
    "geometry": {"epochs": 4, "epoch": 2},
    "faults": {"satellite": "G07", "start_m": 10.0, "stop_m": 55.0, "step_m": 15.0},
}


def counts(alarms: dict[str, tuple[int, ...]], methods: tuple[str, ...] = ("ls", "igg3")) -> pd.DataFrame:
    """A table of counts: alarms as given by method, every other event never."""
    rows = [
        {"epoch": 2, "method": method, "fault": f"G07:+{size:g}m", "bias_m": size, "draws": DRAWS}
        | {event.count: (alarms[method][k] if event.name == "alarm" else 0) for event in EVENTS}
        for method in methods
        for k, size in enumerate(SIZES_M)
    ]
    return with_rates(pd.DataFrame(rows))


def store_run(
    folder: Path, rates: pd.DataFrame, *, name: str = "small", with_figure: bool = True, **changes: Any
) -> Path:
    """A results folder with that table of rates; ``changes`` are fields of its experiment."""
    folder.mkdir(parents=True)
    record = build_experiment(CONTENT | changes, source="test")
    rates.to_csv(folder / "rates.csv", index=False)
    if with_figure:
        save_figure(rates_by_fault_figure(rates, alert=LPV_200, title=str(record.title)), folder, "rates")
    (folder / "summary.md").write_text(
        "# A ramp\n\nGeometry: epoch 2, 16 satellites.\n\n| fault | alarm |\n|---|---|\n| G07 | 12 % |\n\nThat "
        "is 3 of 9, with w_test(alpha=0.00085966165196832,exclusions=0,final=local,p_fa=0.001,p_md=0.0001).\n"
    )
    manifest = {
        "name": name,
        "experiment": record.model_dump(mode="json"),
        "inputs": {},
        "noise": {"generator": "threefry2x32"},
        "notes": ["Faulted satellite: G07."],
        "versions": {"python": "3", "pl_mc": "0.1.0"},
        "machine": {"system": "Linux"},
        "seconds": 1.5,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def store_epochs(folder: Path, alarms: np.ndarray, *, draws: int, method: str = "igg3") -> None:
    """Counts of every epoch of one method and fault: ``alarms`` of each epoch."""
    rows = pd.DataFrame({"epoch": np.arange(len(alarms)), "method": method, "fault": "G07:+10m", "draws": draws})
    for event in EVENTS:
        rows[event.count] = alarms if event.name == "alarm" else 0
    (folder / "epochs").mkdir()
    rows.to_parquet(folder / "epochs" / "part-00000.parquet", index=False)
