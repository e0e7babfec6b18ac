"""Experiments of the kind ``variants``: one robust estimate in many variants, under the same faults and noise.

The strongest and the weakest geometry of a series, a ramp on one satellite or on two, and for every variant the
rates of alarm, missed detection, misleading information and unavailability, with least squares beside them; and
what the weights did, since the rates alone do not tell swamping from collapse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pl_mc.alert import VERTICAL
from pl_mc.engine import Execution
from pl_mc.engine.swamping import WATCHED, watch_weights
from pl_mc.engine.table import count_columns, with_rates
from pl_mc.faults import Faults, no_fault, ramp_sizes_m
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3
from pl_mc.report.document import Chart, Quantity
from pl_mc.report.findings import Findings, Picture, Table, event_quantities
from pl_mc.statistics import ls_quantities
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.variants.figures import variants_figure
from pl_mc.studies.variants.record import DEFAULT, VariantsExperiment
from pl_mc.studies.variants.text import DOUBLE, NONE, summary, worst_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STRONGEST, WEAKEST = "strongest", "weakest"
MEDIAN, INFLUENCE = "median redundancy", "largest influence"

_OF_WEIGHTS = tuple(
    Quantity(event.replace("_", " "), f"{event}_rate", f"{event}_low", f"{event}_high", f"{event}_count")
    for event in WATCHED
)


@dataclass(frozen=True)
class FaultClass:
    """Faults of one epoch that differ in size alone.

    Attributes:
        geometry: ``strongest`` or ``weakest``.
        name: ``none``, ``median redundancy``, ``largest influence`` or ``double``.
        epoch: number of the epoch.
        satellites: the faulted ones; each gets the whole bias.
        moved: error of least squares per metre of bias, on the axis that decides [m/m].
        redundancy: redundancy numbers of the satellites.
        faults: the faults, over the satellites of the series.
        sizes_m: their biases [m].
    """

    geometry: str
    name: str
    epoch: int
    satellites: tuple[str, ...]
    moved: float
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
    axis = experiment.decides.axis
    strong, weak = strongest_and_weakest(series, axis)
    # Epochs in order of time, whichever is the stronger one.
    first, last = min(strong, weak), max(strong, weak)
    both = series[first : last + 1 : last - first]
    sizes_m = tuple(map(float, ramp_sizes_m(**experiment.faults.model_dump())))
    classes = (
        *fault_classes(series[strong], both, STRONGEST, sizes_m, axis),
        *fault_classes(series[weak], both, WEAKEST, sizes_m, axis),
    )
    # Faults that both epochs have in common are counted once.
    rows = {label: bias_m for of in classes for label, bias_m in zip(of.faults.labels, of.faults.bias_m, strict=True)}
    every = Faults(np.stack(list(rows.values())), both.names, tuple(rows))
    return PlannedSweep("sweep", both, every, experiment.draws), classes


def strongest_and_weakest(g: Geometry, axis: str = VERTICAL) -> tuple[int, int]:
    """Places in a series of the smallest and the largest VDOP of least squares [m], sqrt(Q_UU), or HDOP."""
    quantities = ls_quantities(g)
    usable = np.flatnonzero(quantities.available)
    if usable.size == 0:
        raise InputError("geometry: no epoch has more satellites than unknowns; at least one is needed.")
    dop_m = (quantities.vdop_m if axis == VERTICAL else quantities.hdop_m)[usable]
    strong, weak = int(usable[dop_m.argmin()]), int(usable[dop_m.argmax()])
    if strong == weak:
        raise InputError("geometry: all epochs are equally strong; a series that changes is needed.")
    return strong, weak


def fault_classes(
    g: Geometry, series: Geometry, name: str, sizes_m: tuple[float, ...], axis: str = VERTICAL
) -> tuple[FaultClass, ...]:
    """The classes of faults of one epoch.

    One satellite: that with the median redundancy number (the lower of two middle ones), and that with the largest
    effect on the vertical, |s_i|, s the vertical row of N^-1 A' P. Two satellites with the same bias: the pair with
    the largest |s_i + s_j|, whose effects therefore agree in sign. Horizontally s has two rows, and |.| is a length.

    Args:
        g: the epoch.
        series: a series with that epoch in it, over whose satellites the faults are made.
        name: what the epoch is called.
        sizes_m: the biases [m].
        axis: whose error counts.
    """
    quantities = ls_quantities(g)
    redundancy = quantities.redundancy
    gains = quantities.gain[None] if axis == VERTICAL else quantities.horizontal_gain
    reach = np.linalg.norm(gains, axis=0)
    order = sorted(range(len(g.names)), key=lambda k: (redundancy[k], g.names[k]))
    pairs = np.linalg.norm(gains[:, :, None] + gains[:, None, :], axis=0)
    pairs[np.tril_indices(len(reach))] = -1.0
    chosen: dict[str, tuple[int, ...]] = {
        NONE: (),
        MEDIAN: (order[(len(order) - 1) // 2],),
        INFLUENCE: (int(reach.argmax()),),
        DOUBLE: tuple(int(k) for k in np.unravel_index(pairs.argmax(), pairs.shape)),
    }
    made = []
    for what, rows in chosen.items():
        names = tuple(g.names[k] for k in rows)
        bias = np.zeros((len(sizes_m), len(series.names)))
        moved = gains[:, list(rows)].sum(axis=1)
        bias[:, [series.names.index(satellite) for satellite in names]] = np.reshape(sizes_m, (-1, 1))
        made.append(
            FaultClass(
                geometry=name,
                name=what,
                epoch=int(g.epoch),
                satellites=names,
                moved=float(moved[0] if axis == VERTICAL else np.linalg.norm(moved)),
                redundancy=tuple(float(redundancy[k]) for k in rows),
                faults=Faults.from_array(series, bias) if names else no_fault(series),
                sizes_m=sizes_m if names else (0.0,),
            )
        )
    return tuple(made)


def run(experiment: VariantsExperiment, execution: Execution) -> Findings:
    """Rates of every variant, the largest of each event on a ramp, what the weights did, and the faults."""
    planned, classes = _planned(experiment)
    legend, faults = experiment.legend(), _faults_in_order(classes)
    planned.run(experiment, execution)
    # A sweep's parts can hold some of the draws of a fault each.
    keys = ["epoch", "fault", "method"]
    counts = pd.concat(planned.rows(execution)).astype({"fault": str, "method": str})
    rates = with_rates(counts.groupby(keys, sort=False)[count_columns(counts)].sum().reset_index())
    cases = legend.merge(faults, how="cross")
    variants = cases.merge(rates, on=keys, how="left", validate="m:1")
    assert variants.draws.notna().all()
    variants, worst = (experiment.with_axis(table) for table in (variants, worst_table(variants)))
    swamping = _weights(experiment, planned, faults, legend)
    described = _describe(classes, experiment.decides.axis)
    return Findings(
        summary=summary(experiment, variants, swamping, described, default=_default_options()),
        tables=(
            Table("variants", variants, chart=_chart("Rates of events against the bias", event_quantities())),
            Table("worst", worst),
            Table("swamping", swamping, chart=_chart("What the weights did against the bias", _OF_WEIGHTS)),
            Table("faults", described),
        ),
        notes=planned.g.notes,
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: VariantsExperiment) -> tuple[Picture, ...]:
    """The variants at each geometry."""

    def draw(geometry: str) -> Figure:
        rates, faults = (table[table.geometry == geometry] for table in (stored["variants"], stored["faults"]))
        title = f"{experiment.title}: {geometry} geometry"
        return variants_figure(rates, faults, judged=experiment.decides, title=title)

    caption = "Every variant at the {} geometry: rates against the bias."
    return tuple(
        Picture(f"variants_{geometry}", caption.format(geometry), partial(draw, geometry))
        for geometry in (WEAKEST, STRONGEST)
    )


def _chart(title: str, quantities: tuple[Quantity, ...]) -> Chart:
    return Chart(title, ("variant",), quantities, menus=("geometry", "fault_class"))


def _weights(
    experiment: VariantsExperiment, planned: PlannedSweep, faults: pd.DataFrame, legend: pd.DataFrame
) -> pd.DataFrame:
    """One row per variant, geometry, class and bias: what happened to the weights."""
    records = {record.name: record for record in experiment.method_records() if isinstance(record, Igg3)}
    robust = legend[legend.method.isin(records) & ((legend.group != "") | (legend.variant == DEFAULT))]
    watched = watch_weights(
        planned.g, planned.faults, [records[name].options for name in robust.method],
        draws=min(experiment.draws, experiment.weight_draws), seed=experiment.seed, precision=experiment.precision,
    )  # fmt: skip
    keyed = robust.reset_index(drop=True).reset_index(names="estimate").merge(faults, how="cross")
    table = keyed.merge(watched, on=["epoch", "fault", "estimate"], how="left", validate="m:1")
    return table.drop(columns="estimate")


def _faults_in_order(classes: tuple[FaultClass, ...]) -> pd.DataFrame:
    """One row per geometry, class and bias."""
    rows = [
        (of.geometry, of.epoch, of.name, label, size_m)
        for of in classes
        for label, size_m in zip(of.faults.labels, of.sizes_m, strict=True)
    ]
    return pd.DataFrame(rows, columns=["geometry", "epoch", "fault_class", "fault", "bias_m"])


def _describe(classes: tuple[FaultClass, ...], axis: str) -> pd.DataFrame:
    """What is faulted, and what least squares makes of a metre of it."""
    faulted = [of for of in classes if of.satellites]
    return pd.DataFrame(
        {
            "geometry": [of.geometry for of in faulted],
            "epoch": [of.epoch for of in faulted],
            "fault_class": [of.name for of in faulted],
            "satellites": [" ".join(of.satellites) for of in faulted],
            f"{axis}_metres_per_metre": [of.moved for of in faulted],
            "redundancy": [" ".join(map("{:.4f}".format, of.redundancy)) for of in faulted],
        }
    )


def _default_options() -> str:
    """``k0 1.5, k1 5, ...``, the options that variants vary."""
    settled = Igg3().options
    meant = {"iterations": settled.solutions, "acceleration": "aitken" if settled.accelerated else "none"}
    varied = {name: value for name, value in (asdict(Igg3()) | meant).items() if not name.startswith("k_")}
    return ", ".join(
        f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name.replace('_', ' ')} {value}"
        for name, value in varied.items()
    )
