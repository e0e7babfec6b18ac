"""Experiments of the kind ``guo``: chi-square test against inter-system mean check, after Guo et al. (2022).

A bias on the least detectable satellite of one system at every epoch of a series. Simulated series have one draw of
noise for the paper's table and many more for rates; real ones have the receiver's own errors. False alarms are
measured before anything is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field

from pl_mc.detectors import Detector, as_detectors, detector
from pl_mc.engine.detect import detect
from pl_mc.engine.execution import Execution
from pl_mc.experiments.output import write_table
from pl_mc.faults import ramps
from pl_mc.geometry import Geometry, dops
from pl_mc.input_errors import InputError
from pl_mc.report.figures import save_figure
from pl_mc.statistics.intervals import binomial_p_value
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.noncentral import split_at_threshold
from pl_mc.statistics.reliability import least_detectable, reliability
from pl_mc.statistics.student import chi2_threshold
from pl_mc.studies.guo.figures import (
    detection_figure,
    power_figure,
    residual_figure,
    satellite_power_figure,
    satellites_figure,
    statistic_figure,
)
from pl_mc.studies.guo.series import GuoSeries, day_of_detections, detection_table, draws_table
from pl_mc.studies.guo.text import GuoReport, guo_summary, hypothesis_table, variance_factors
from pl_mc.studies.series.sources import AnySource, ReceiverSource, Series
from pl_mc.studies.spec import Experiment, Strict, satellite_files


class TestChoice(Strict):
    """A test by name; every further field is an option of that test."""

    __test__ = False

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str

    def build(self) -> Detector:
        """The test's record."""
        return detector(self.name, **(self.model_extra or {}))


class PowerCurves(Strict):
    """Detection of every satellite of one epoch against the bias.

    Attributes:
        epoch: number of the epoch, counted from 0.
        start_m, stop_m, step_m: biases [m].
        draws: noise draws for each fault.
        calibration_draws: fault-free draws that find thresholds, and as many that measure false alarms.
    """

    epoch: int = Field(ge=0)
    start_m: float = 0.0
    stop_m: float = 60.0
    step_m: float = Field(default=2.0, gt=0)
    draws: int = Field(ge=1)
    calibration_draws: int = Field(ge=1)


class GuoExperiment(Experiment):
    """Detection by each test, of biases on the least detectable satellite of each epoch.

    Attributes:
        source: a site or a receiver's files.
        without: satellites left out, by name (a site can switch them off itself).
        system: RINEX letter of the system whose least detectable satellite is biased.
        biases_m: the biases; the fault-free case is always there [m].
        p_fa: nominal false-alarm probability of all tests.
        tests: the tests with their readings.
        draws: noise draws at each epoch beyond the one of the paper's table.
        calibration_draws: fault-free draws at each epoch that find thresholds, and as many that measure false
            alarms.
        curves: the epoch of the power curves.
        remarks: sentences about the choices of the file, for the notes.
    """

    kind: Literal["guo"] = "guo"
    source: AnySource
    without: tuple[str, ...] = ()
    system: str = "C"
    biases_m: Annotated[tuple[float, ...], Field(min_length=1)] = (10.0, 20.0, 30.0)
    p_fa: float = Field(default=0.01, gt=0, lt=1)
    tests: Annotated[tuple[TestChoice, ...], Field(min_length=1)] = (
        TestChoice(name="chi2"),
        TestChoice(name="mean_check"),
    )
    draws: int = Field(default=256, ge=1)
    calibration_draws: int = Field(default=1999, ge=1)
    curves: PowerCurves
    remarks: tuple[str, ...] = ()

    def test_records(self) -> tuple[Detector, ...]:
        """The tests, made records."""
        return as_detectors([choice.build() for choice in self.tests])

    def input_files(self) -> Mapping[str, Path]:
        """The receiver's files, or the almanac or SP3 file of a simulated source that has one."""
        if isinstance(self.source, ReceiverSource):
            return self.source.files()
        return satellite_files(self.source, "source")


def run(experiment: GuoExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``detection.csv``, tables of draws, hypotheses, reliability and power, and figures 1-5 with more.

    Returns:
        The summary in Markdown, and notes.
    """
    tests = experiment.test_records()
    loaded = experiment.source.series(draws=1, seed=experiment.seed, precision=experiment.precision)
    real = isinstance(experiment.source, ReceiverSource)
    g, errors_m = without_satellites(loaded, experiment.without)
    row = least_detectable(g, system=experiment.system)
    if (row < 0).all():
        raise InputError(f"system: {experiment.system!r} has no satellite that the others check, at any epoch.")
    notes = [*loaded.notes, *_skipped(experiment, row)]
    kept = np.flatnonzero(row >= 0)
    series = GuoSeries(
        geometry=g if kept.size == len(g) else _epochs(g, kept),
        errors_m=errors_m[kept],
        faulted_row=row[kept],
        biases_m=(0.0, *experiment.biases_m),
        real=real,
    )
    day = day_of_detections(
        series, tests, p_fa=experiment.p_fa, seed=experiment.seed, draws=experiment.draws,
        calibration_draws=experiment.calibration_draws, precision=experiment.precision, progress=execution.progress,
    )  # fmt: skip
    detection, draws = detection_table(series, day), draws_table(series, day)
    hypotheses = hypothesis_table(draws)
    factors = variance_factors(series.geometry, series.faulted_row, experiment.p_fa)

    epoch = _one_epoch(g, experiment.curves.epoch)
    choice = experiment.curves
    faults = ramps(
        epoch, satellites=epoch.names, start_m=choice.start_m, stop_m=choice.stop_m, step_m=choice.step_m
    )
    power = detect(
        epoch, faults, tests=tests, draws=choice.draws, seed=experiment.seed, p_fa=experiment.p_fa,
        calibration_draws=choice.calibration_draws, precision=experiment.precision, progress=execution.progress,
    )  # fmt: skip
    # Zero metres on one satellite is zero metres on any: the fault-free draws, once for each satellite.
    sizes = int(len(faults) / len(epoch.names))
    satellite = dict(zip(faults.labels, np.repeat(epoch.names, sizes), strict=True))
    power.insert(2, "satellite", np.where(power.bias_m == 0, "", power.fault.map(satellite)))
    power = power.drop_duplicates(["test", "reading", "level", "fault"]).reset_index(drop=True)
    power = power.join(exact_rates(epoch, power, experiment.p_fa))
    reliable = reliability(epoch)

    for name, table in (
        ("detection", detection), ("detection_draws", draws), ("hypotheses", hypotheses),
        ("variance_factor", factors), ("power", power), ("reliability", reliable),
    ):  # fmt: skip
        write_table(table, folder, name)
    day.epochs.to_parquet(folder / "epochs.parquet", index=False, compression="zstd")
    report = GuoReport(
        title=experiment.title,
        source=experiment.source.describe(),
        geometry=series.geometry,
        real=real,
        p_fa=experiment.p_fa,
        seed=experiment.seed,
        draws=experiment.draws,
        calibration_draws=experiment.calibration_draws,
        detection=detection,
        drawn=draws,
        hypotheses=hypotheses,
        factors=factors,
        power=power,
        reliable=reliable,
        power_epoch=int(epoch.epoch),
    )
    _save_figures(experiment, series, day.epochs, report, folder)
    return guo_summary(report), (*notes, *day.notes, *experiment.remarks)


def exact_rates(g: Geometry, power: pd.DataFrame, p_fa: float) -> pd.DataFrame:
    """``exact_rate`` of the chi-square test at its nominal threshold; ``exact_p_value`` of the count beside it."""
    quantities = ls_quantities(g)
    mine = power[(power.test == "chi2") & (power.reading == "apriori") & (power.level == "nominal")]
    row = [g.names.index(name) if name else 0 for name in mine.satellite]
    spread = mine.bias_m.to_numpy() ** 2 * quantities.redundancy[row] / g.sigma_m[row] ** 2
    dof = float(quantities.dof)
    _, above = split_at_threshold(chi2_threshold(dof, p_fa), dof, spread)
    columns = {"exact_rate": above, "exact_p_value": binomial_p_value(mine.detections, mine.draws, above)}
    return pd.DataFrame(columns, index=mine.index)


def without_satellites(series: Series, names: tuple[str, ...]) -> tuple[Geometry, np.ndarray]:
    """The series and its first errors (e, n) [m] without satellites of these names."""
    g, errors = series.geometry, series.errors_m[0]
    out = np.isin(np.array(g.names), names)
    if not out.any():
        return g, errors
    epochs, known = len(g), len(g.names)
    design = np.zeros((epochs, known, g.design.shape[2]))
    sigma, values = np.ones((epochs, known)), np.zeros((epochs, known))
    seen = np.zeros((epochs, known), dtype=bool)
    place, at = np.nonzero(g.in_view)
    satellite = g.satellite[place, at]
    design[place, satellite], sigma[place, satellite] = g.design[place, at], g.sigma_m[place, at]
    values[place, satellite], seen[place, satellite] = errors[place, at], True
    seen[:, out] = False
    kept = Geometry.from_rows(
        design=design, sigma_m=sigma, in_view=seen, names=g.names, systems=g.systems, clocks=g.clocks,
        epoch=g.epoch, time_gps_s=g.time_gps_s,
    )  # fmt: skip
    order = np.array([g.names.index(name) for name in kept.names])
    return kept, np.where(kept.in_view, values[np.arange(epochs)[:, None], order[kept.satellite]], 0.0)


def _epochs(g: Geometry, kept: np.ndarray) -> Geometry:
    """The epochs of these places, which need not follow each other."""
    return Geometry(
        design=g.design[kept], sigma_m=g.sigma_m[kept], in_view=g.in_view[kept], satellite=g.satellite[kept],
        epoch=g.epoch[kept], time_gps_s=g.time_gps_s[kept], names=g.names, systems=g.systems, clocks=g.clocks,
    )  # fmt: skip


def _one_epoch(g: Geometry, number: int) -> Geometry:
    place = np.flatnonzero(g.epoch == number)
    if place.size == 0:
        raise InputError(f"curves.epoch: {number} is not among the epochs {g.epoch[0]} to {g.epoch[-1]}.")
    return g[int(place[0])]


def _skipped(experiment: GuoExperiment, row: np.ndarray) -> list[str]:
    count = int((row < 0).sum())
    if not count:
        return []
    return [f"{count} of {row.size} epochs are left out: no satellite of {experiment.system} is checked by others."]


def _save_figures(
    experiment: GuoExperiment, series: GuoSeries, epochs: pd.DataFrame, report: GuoReport, folder: Path
) -> None:
    g, title = series.geometry, experiment.title
    quantities = ls_quantities(g)
    scaled = np.where(g.in_view, series.errors_m / g.sigma_m, 0.0)
    fitted = np.einsum("enk,ek->en", quantities.basis, np.einsum("enk,en->ek", quantities.basis, scaled))
    residuals_m = (fitted - scaled) * g.sigma_m
    letters = np.array(g.systems)[g.satellite]
    by_system = {letter: residuals_m[g.in_view & (letters == letter)] for letter in ("G", "C")}
    sigma_m = {letter: g.sigma_m[g.in_view & (letters == letter)] for letter in ("G", "C")}
    save_figure(residual_figure(by_system, sigma_m, title=title), folder, "fig1_residuals")
    counts = {letter: (g.in_view & (letters == letter)).sum(axis=1) for letter in ("G", "C")}
    save_figure(satellites_figure(g.epoch, counts, dops(g).pdop, title=title), folder, "fig2_satellites")
    for number, test, sizes in (
        (3, "mean_check", (0.0,)),
        (4, "mean_check", experiment.biases_m),
        (5, "chi2", experiment.biases_m),
    ):
        for first in epochs[epochs.test == test].reading.unique()[:1]:
            figure = statistic_figure(epochs, test=test, reading=str(first), biases_m=sizes, title=title)
            save_figure(figure, folder, f"fig{number}_{'t' if test == 'mean_check' else 'f'}")
    save_figure(detection_figure(report.detection, title=title), folder, "detection")
    save_figure(power_figure(report.power, report.reliable, title=title), folder, "power")
    save_figure(satellite_power_figure(report.power, report.reliable, title=title), folder, "power_satellites")
