"""Experiments of the kind ``map``: a ramp on every satellite at every epoch, as maps over time."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import Field

from pl_mc.engine import sweep
from pl_mc.engine.table import sum_over_faults
from pl_mc.experiments.common import Experiment, SimulatedGeometry, Strict
from pl_mc.experiments.output import write_table
from pl_mc.faults import ramps
from pl_mc.geometry import Geometry
from pl_mc.report.figures import method_label, save_figure
from pl_mc.report.map_figures import map_figure
from pl_mc.report.text import event_text, markdown_table

MAPPED = ("alarm", "missed", "misleading")


class RampSizes(Strict):
    """Biases of the ramp [m]."""

    start_m: float
    stop_m: float
    step_m: float


class MapExperiment(Experiment):
    """Every satellite of a series, one at a time, through the same ramp."""

    kind: Literal["map"] = "map"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry
    faults: RampSizes


def run(experiment: MapExperiment, folder: Path, *, progress: bool | None) -> tuple[str, tuple[str, ...]]:
    """Write ``by_epoch_satellite.parquet``, ``by_satellite.csv``, ``by_bias.csv`` and maps of three events.

    Returns:
        The summary in Markdown, and notes.
    """
    g = experiment.geometry.build().as_series()
    sizes = experiment.faults
    faults = ramps(g, satellites=g.names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)
    alert = experiment.alert_limits()
    rates = sweep(
        g, faults, draws=experiment.draws, seed=experiment.seed, methods=experiment.method_records(), alert=alert,
        precision=experiment.precision, progress=progress,
    )  # fmt: skip
    rates.insert(1, "satellite", rates.fault.str.split(":").str[0])
    by_place = sum_over_faults(rates, ["epoch", "satellite", "method"])
    by_satellite = sum_over_faults(rates, ["satellite", "method"])
    by_bias = sum_over_faults(rates, ["bias_m", "method"])
    by_place.to_parquet(folder / "by_epoch_satellite.parquet", index=False, compression="zstd")
    write_table(by_satellite, folder, "by_satellite")
    write_table(by_bias, folder, "by_bias")
    for event in MAPPED:
        figure = map_figure(by_place, event=event, alert=alert, title=experiment.title)
        save_figure(figure, folder, f"map_{event}")
    # A satellite that is out of view at some epochs is no news on a map that shows it.
    return _summary(experiment, g, by_bias, by_satellite), ()


def _summary(experiment: MapExperiment, g: Geometry, by_bias: pd.DataFrame, by_satellite: pd.DataFrame) -> str:
    alert = experiment.alert_limits()
    methods = list(dict.fromkeys(by_bias.method))
    scenarios = int(by_bias[by_bias.method == methods[0]].draws.sum())
    tables = []
    for key, table in (("bias_m", by_bias), ("satellite", by_satellite)):
        rows = []
        for value, group in table.sort_values(key, kind="stable").groupby(key, sort=False):
            cells = [f"{value:g}" if key == "bias_m" else str(value)]
            for row in group.itertuples():
                cells += [event_text(row, event) for event in MAPPED]
            rows.append(cells)
        header = ["bias [m]" if key == "bias_m" else key]
        header += [f"{event}, {m}" for m in methods for event in MAPPED]
        tables += [markdown_table(header, rows), ""]
    lines = [
        f"# {experiment.title}",
        "",
        f"{len(g)} epochs, every satellite in view in turn, {experiment.draws:,} draws each: {scenarios:,} "
        f"scenarios a method, seed {experiment.seed}. {alert.name}, VAL {alert.vertical_m:g} m. Rates over all "
        "epochs with 95 % bounds that count each noise draw once, since all faults of an epoch share its noise.",
        "",
        *tables,
        "; ".join(f"{m}: {method_label(m)}" for m in methods if method_label(m) != m) + ".",
    ]
    return "\n".join(lines) + "\n"
