"""Experiments of the kind ``map``: a ramp on every satellite at every epoch, as maps over time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.engine.table import COUNT_COLUMNS, sum_over_faults, with_rates
from pl_mc.experiments.output import write_table
from pl_mc.faults import ramps
from pl_mc.geometry import Geometry
from pl_mc.report.figures import method_label, save_figure
from pl_mc.report.text import event_text, markdown_table
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, SimulatedGeometry, Strict
from pl_mc.studies.sweep.map_figures import map_figure

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


def sweeps(experiment: MapExperiment) -> tuple[PlannedSweep, ...]:
    """The sweep of the experiment."""
    g = experiment.geometry.build().as_series()
    sizes = experiment.faults
    faults = ramps(g, satellites=g.names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)
    return (PlannedSweep("sweep", g, faults, experiment.draws),)


def run(experiment: MapExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``by_epoch_satellite.parquet``, ``by_satellite.csv``, ``by_bias.csv`` and maps of three events.

    The counts of every epoch and fault are in ``epochs/*.parquet``.

    Returns:
        The summary in Markdown, and notes.
    """
    (planned,) = sweeps(experiment)
    alert = experiment.alert_limits()
    rates = planned.run(experiment, execution)
    planned.keep_rows(execution, folder)
    by_place = rates_by_place(planned.rows(execution))
    rates["satellite"] = rates.fault.str.split(":").str[0]
    by_satellite = sum_over_faults(rates, ["satellite", "method"], independent=_draws_by(by_place, ["satellite"]))
    by_bias = sum_over_faults(rates, ["bias_m", "method"], independent=_draws_by(by_place, []))
    by_place.to_parquet(folder / "by_epoch_satellite.parquet", index=False, compression="zstd")
    write_table(by_satellite, folder, "by_satellite")
    write_table(by_bias, folder, "by_bias")
    for event in MAPPED:
        figure = map_figure(by_place, event=event, alert=alert, title=experiment.title)
        save_figure(figure, folder, f"map_{event}")
    # A satellite that is out of view at some epochs is no news on a map that shows it.
    return _summary(experiment, planned.g, by_bias, by_satellite), ()


def rates_by_place(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """One row per epoch, satellite and method, summed over biases, from the rows of a sweep part by part."""
    keys = ["epoch", "satellite", "method"]
    sums = []
    for rows in parts:
        rows = rows.assign(satellite=rows.fault.astype(str).str.split(":").str[0], method=rows.method.astype(str))
        # Rows of one epoch and part have the same draws; all biases of a satellite saw the same noise.
        first = rows.groupby(keys, sort=False)["draws"].first().rename("independent_draws")
        sums.append(rows.groupby(keys, sort=False)[COUNT_COLUMNS].sum().join(first))
    total = pd.concat(sums).groupby(level=keys, sort=False).sum()
    return with_rates(total[["draws", "independent_draws", *COUNT_COLUMNS[1:]]].reset_index())


def _draws_by(by_place: pd.DataFrame, keys: list[str]) -> pd.Series:
    """Independent draws by ``keys`` and method: those of every epoch, each counted once."""
    once = by_place.drop_duplicates([*keys, "method", "epoch"])
    return once.groupby([*keys, "method"], sort=False)["independent_draws"].sum()


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
