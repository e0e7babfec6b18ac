"""Results folders as runs leave them, made without running anything, so that pages can be tested quickly."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import pl_mc
from pl_mc.alert import LPV_200, Judged
from pl_mc.engine import checkpoint_store
from pl_mc.engine.table import with_rates
from pl_mc.experiments.loading import build_experiment
from pl_mc.kernels.events import EVENTS
from pl_mc.report.document import Chart, Paragraph, TextTable
from pl_mc.report.files import write_findings
from pl_mc.report.findings import Findings, Picture, Table, event_quantities
from pl_mc.studies.registry import study_of
from pl_mc.studies.spec import kind_of
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

CHART = Chart(title="Rates of events against the bias", curves=("method",), quantities=event_quantities())
CAPTION = "Protection levels and rates of events, fault by fault."
SUMMARY = (
    Paragraph("Geometry: epoch 2, 16 satellites; `0 (< x %)` is a bound."),
    TextTable(("fault", "alarm"), (("G07", "12 %"),)),
    Paragraph(
        "That is 3 of 9, with w_test(alpha=0.00085966165196832,exclusions=0,final=local,p_fa=0.001,p_md=0.0001)."
    ),
)


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
    folder: Path,
    rates: pd.DataFrame,
    *,
    name: str = "small",
    with_figure: bool = True,
    menus: tuple[str, ...] = (),
    **changes: Any,
) -> Path:
    """A results folder with that table of rates; ``changes`` are fields of its experiment.

    Columns of ``menus`` tell rows of the table apart in its chart.
    """
    folder.mkdir(parents=True)
    record = build_experiment(CONTENT | changes, source="test")
    study, title = study_of(record), str(record.title)
    draw = partial(rates_by_fault_figure, rates, judged=Judged(LPV_200), title=title)
    pictures = [Picture("rates", CAPTION, draw)] * with_figure
    findings = Findings(
        summary=SUMMARY,
        tables=(Table("rates", rates, chart=replace(CHART, menus=menus)),),
        pictures=tuple(pictures),
        notes=("Faulted satellite: G07.",),
    )
    document = write_findings(
        findings, folder, title=title, kind=kind_of(record), question=study.asks(record),
        answer=study.answer(findings.data, record), val_m=record.alert_limits().vertical_m,
    )  # fmt: skip
    manifest = {
        "name": name,
        "experiment": record.model_dump(mode="json"),
        "inputs": {},
        "noise": {"generator": "threefry2x32"},
        "notes": list(document.notes),
        "versions": {"python": "3", "pl_mc": pl_mc.__version__},
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
    # As a sweep stores them, with a checksum in the file.
    table = pa.Table.from_pandas(rows, preserve_index=False)
    about = json.dumps({"sha256": checkpoint_store._NO_CHECKSUM})
    sink = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"pl_mc": about}), sink)
    content = checkpoint_store._with_checksum(sink.getvalue().to_pybytes())
    (folder / "epochs" / "part-000000.parquet").write_bytes(content)
