"""Experiments of the kind ``variants``: one robust estimate in many variants, under the same faults and noise.

The strongest and the weakest geometry of a series, a ramp on one satellite or on two, and for every variant the
rates of alarm, missed detection, misleading information and unavailability, with least squares beside them; and
what the weights did, since the rates alone do not tell swamping from collapse.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.engine.swamping import watch_weights
from pl_mc.engine.table import COUNT_COLUMNS, with_rates
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, no_fault, ramp_sizes_m
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3, Method, as_methods, method
from pl_mc.report.figures import save_figure
from pl_mc.statistics import ls_quantities
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, MethodChoice, SimulatedGeometry, Strict
from pl_mc.studies.sweep.map import RampSizes
from pl_mc.studies.variants.figures import variants_figure
from pl_mc.studies.variants.text import variants_summary, worst_table

STRONGEST, WEAKEST = "strongest", "weakest"
NONE, MEDIAN, INFLUENCE, DOUBLE = "none", "median redundancy", "largest influence", "double"
DEFAULT = "default"


class Variant(Strict):
    """One variant.

    Attributes:
        group: variants of one group stand together in a figure.
        label: its name in tables and figures.
        method: ``igg3``, or another method of the same kind, such as ``igg3_gated``.
        options: what differs from that method's defaults.
    """

    group: str
    label: str
    method: str = "igg3"
    options: dict[str, Any] = Field(default_factory=dict)

    def build(self) -> Igg3:
        """The method's record."""
        made = method(self.method, **self.options)
        if not isinstance(made, Igg3):
            raise InputError(f"variants: {self.label}: method: {self.method!r} is no variant of igg3.")
        return made


class VariantsExperiment(Experiment):
    """Variants of IGG-III, with its defaults in front and ``methods`` beside.

    Attributes:
        draws: of noise, for each fault.
        weight_draws: the first of them, whose weights are looked at.
        geometry: a series, of which the epochs with the smallest and the largest VDOP (in metres) are taken.
        faults: sizes of the ramps.
    """

    kind: Literal["variants"] = "variants"
    methods: tuple[MethodChoice, ...] = (MethodChoice(name="ls"),)
    draws: int = Field(ge=1)
    weight_draws: int = Field(default=2000, ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry()
    faults: RampSizes
    variants: Annotated[tuple[Variant, ...], Field(min_length=1)]

    def method_records(self) -> tuple[Method, ...]:
        """Those beside, the default, and the variants."""
        return as_methods([*super().method_records(), Igg3(), *(variant.build() for variant in self.variants)])

    def legend(self) -> pd.DataFrame:
        """``group, variant, method`` of each method, in order; ``group`` is empty for those beside the variants."""
        rows = [("", choice.build().name, choice.build().name) for choice in self.methods]
        rows += [("", DEFAULT, Igg3().name)]
        rows += [(variant.group, variant.label, variant.build().name) for variant in self.variants]
        return pd.DataFrame(rows, columns=["group", "variant", "method"])


@dataclass(frozen=True)
class FaultClass:
    """Faults of one epoch that differ in size alone.

    Attributes:
        geometry: ``strongest`` or ``weakest``.
        name: ``none``, ``median redundancy``, ``largest influence`` or ``double``.
        epoch: number of the epoch.
        satellites: the faulted ones; each gets the whole bias.
        vertical: vertical error of least squares per metre of bias [m/m].
        redundancy: redundancy numbers of the satellites.
        faults: the faults, over the satellites of the series.
        sizes_m: their biases [m].
    """

    geometry: str
    name: str
    epoch: int
    satellites: tuple[str, ...]
    vertical: float
    redundancy: tuple[float, ...]
    faults: Faults
    sizes_m: tuple[float, ...]


def sweeps(experiment: VariantsExperiment) -> tuple[PlannedSweep, ...]:
    """The one sweep of the experiment."""
    return (_planned(experiment)[0],)


def _planned(experiment: VariantsExperiment) -> tuple[PlannedSweep, tuple[FaultClass, ...]]:
    """Both epochs as a series: every variant is compiled once for the two of them."""
    series = experiment.geometry.build()
    if not series.is_series or len(series) < 2:
        raise InputError("geometry.epochs: a series of at least two epochs is needed, without geometry.epoch.")
    strong, weak = strongest_and_weakest(series)
    # Epochs in order of time, whichever is the stronger one.
    first, last = min(strong, weak), max(strong, weak)
    both = series[first : last + 1 : last - first]
    sizes = ramp_sizes_m(experiment.faults.start_m, experiment.faults.stop_m, experiment.faults.step_m)
    classes = [
        one
        for name, k in ((STRONGEST, strong), (WEAKEST, weak))
        for one in fault_classes(series[k], both, name, tuple(float(size) for size in sizes))
    ]
    rows: dict[str, np.ndarray] = {}
    for one in classes:
        rows |= dict(zip(one.faults.labels, one.faults.bias_m, strict=True))
    every = Faults(np.stack(list(rows.values())), both.names, tuple(rows))
    return PlannedSweep("sweep", both, every, experiment.draws), tuple(classes)


def strongest_and_weakest(g: Geometry) -> tuple[int, int]:
    """Places in a series of the smallest and the largest VDOP of least squares [m], sqrt(Q_UU)."""
    quantities = ls_quantities(g)
    usable = np.flatnonzero(quantities.available)
    if usable.size == 0:
        raise InputError("geometry: no epoch has more satellites than unknowns; at least one is needed.")
    vdop = quantities.vdop_m[usable]
    strong, weak = int(usable[vdop.argmin()]), int(usable[vdop.argmax()])
    if strong == weak:
        raise InputError("geometry: all epochs are equally strong; a series that changes is needed.")
    return strong, weak


def fault_classes(g: Geometry, series: Geometry, name: str, sizes_m: tuple[float, ...]) -> tuple[FaultClass, ...]:
    """The classes of faults of one epoch.

    One satellite: that with the median redundancy number (the lower of two middle ones), and that with the largest
    effect on the vertical, |s_i|, s the vertical row of N^-1 A' P. Two satellites with the same bias: the pair with
    the largest |s_i + s_j|, whose effects therefore agree in sign.

    Args:
        g: the epoch.
        series: a series with that epoch in it, over whose satellites the faults are made.
        name: what the epoch is called.
        sizes_m: the biases [m].
    """
    quantities = ls_quantities(g)
    gain, redundancy = quantities.gain, quantities.redundancy
    order = sorted(range(len(g.names)), key=lambda k: (redundancy[k], g.names[k]))
    pairs = np.abs(gain[:, None] + gain[None, :])
    pairs[np.tril_indices(len(gain))] = -1.0
    chosen: dict[str, tuple[int, ...]] = {
        NONE: (),
        MEDIAN: (order[(len(order) - 1) // 2],),
        INFLUENCE: (int(np.abs(gain).argmax()),),
        DOUBLE: tuple(int(k) for k in np.unravel_index(pairs.argmax(), pairs.shape)),
    }
    made = []
    for what, rows in chosen.items():
        names = tuple(g.names[k] for k in rows)
        bias = np.zeros((len(sizes_m), len(series.names)))
        for satellite in names:
            bias[:, series.names.index(satellite)] = sizes_m
        made.append(
            FaultClass(
                geometry=name,
                name=what,
                epoch=int(g.epoch),
                satellites=names,
                vertical=float(sum(gain[k] for k in rows)),
                redundancy=tuple(float(redundancy[k]) for k in rows),
                faults=Faults.from_array(series, bias) if names else no_fault(series),
                sizes_m=sizes_m if names else (0.0,),
            )
        )
    return tuple(made)


def run(experiment: VariantsExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``variants.csv``, ``worst.csv``, ``swamping.csv``, ``faults.csv`` and a figure for each geometry.

    ``worst.csv`` has, for each variant, geometry and class of faults, the largest rate of each event on the ramp.

    Returns:
        The summary in Markdown, and notes.
    """
    planned, classes = _planned(experiment)
    alert, legend = experiment.alert_limits(), experiment.legend()
    planned.run(experiment, execution)
    rates = with_rates(_sum_of_parts(pd.concat(planned.rows(execution))))
    variants = _by_class(rates, classes, legend)
    swamping = _weights(experiment, planned, classes, legend)
    worst = worst_table(variants)
    described = _describe(classes)
    for name, table in (("variants", variants), ("worst", worst), ("swamping", swamping), ("faults", described)):
        write_table(table, folder, name)
    for geometry in (WEAKEST, STRONGEST):
        figure = variants_figure(
            variants[variants.geometry == geometry], described[described.geometry == geometry], alert=alert,
            title=f"{experiment.title}: {geometry} geometry",
        )  # fmt: skip
        save_figure(figure, folder, f"variants_{geometry}")
    summary = variants_summary(
        experiment.title, variants=variants, worst=worst, swamping=swamping, faults=described,
        default=_default_options(), alert=alert, seed=experiment.seed,
    )  # fmt: skip
    return summary, ()


def _sum_of_parts(rows: pd.DataFrame) -> pd.DataFrame:
    """Counts by epoch, fault and method; a sweep's parts can hold some of the draws of a fault each."""
    keys = ["epoch", "fault", "method"]
    rows = rows.astype({"fault": str, "method": str})
    return rows.groupby(keys, sort=False)[COUNT_COLUMNS].sum().reset_index()


def _by_class(rates: pd.DataFrame, classes: tuple[FaultClass, ...], legend: pd.DataFrame) -> pd.DataFrame:
    """One row per variant, geometry, class of faults and bias, in that order."""
    wanted = _faults_in_order(classes)
    table = legend.merge(wanted, how="cross").merge(
        rates, on=["epoch", "fault", "method"], how="left", validate="m:1"
    )
    assert table.draws.notna().all()
    return table


def _weights(
    experiment: VariantsExperiment, planned: PlannedSweep, classes: tuple[FaultClass, ...], legend: pd.DataFrame
) -> pd.DataFrame:
    """One row per variant, geometry, class and bias: what happened to the weights."""
    records = {record.name: record for record in experiment.method_records() if isinstance(record, Igg3)}
    robust = legend[legend.method.isin(records) & ((legend.group != "") | (legend.variant == DEFAULT))]
    options = [records[name].options for name in robust.method]
    found = watch_weights(
        planned.g, planned.faults, options, draws=min(experiment.draws, experiment.weight_draws),
        seed=experiment.seed, precision=experiment.precision,
    )  # fmt: skip
    keyed = (
        robust.reset_index(drop=True).reset_index(names="estimate").merge(_faults_in_order(classes), how="cross")
    )
    table = keyed.merge(found, on=["epoch", "fault", "estimate"], how="left", validate="m:1")
    return table.drop(columns="estimate")


def _faults_in_order(classes: tuple[FaultClass, ...]) -> pd.DataFrame:
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "geometry": one.geometry,
                    "epoch": one.epoch,
                    "fault_class": one.name,
                    "fault": one.faults.labels,
                    "bias_m": one.sizes_m,
                }
            )
            for one in classes
        ],
        ignore_index=True,
    )


def _describe(classes: tuple[FaultClass, ...]) -> pd.DataFrame:
    """What is faulted, and what least squares makes of a metre of it."""
    return pd.DataFrame(
        [
            {
                "geometry": one.geometry,
                "epoch": one.epoch,
                "fault_class": one.name,
                "satellites": " ".join(one.satellites),
                "vertical_metres_per_metre": one.vertical,
                "redundancy": " ".join(f"{value:.4f}" for value in one.redundancy),
            }
            for one in classes
            if one.satellites
        ]
    )


def _default_options() -> str:
    """``k0 1.5, k1 5, ...``, the options that variants vary."""
    varied = {name: value for name, value in asdict(Igg3()).items() if not name.startswith("k_")}
    return ", ".join(
        f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in varied.items()
    )
