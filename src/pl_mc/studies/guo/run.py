"""Experiments of the kind ``guo``: chi-square test against inter-system mean check, after Guo et al. (2022).

A bias on the least detectable satellite of one system at every epoch of a series. Simulated series have one draw of
noise for the paper's table and many more for rates; real ones have the receiver's own errors. False alarms are
measured before anything is compared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from pl_mc.detectors import Detector, as_detectors, detector
from pl_mc.engine import Execution
from pl_mc.faults import ramps
from pl_mc.geometry import Geometry, dops
from pl_mc.input_errors import InputError
from pl_mc.report.document import Chart, Quantity
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.reliability import least_detectable, reliability
from pl_mc.studies.guo import figures
from pl_mc.studies.guo.paper import hypothesis_table, variance_factors
from pl_mc.studies.guo.series import Day, GuoSeries, day_of_detections, power_table
from pl_mc.studies.guo.text import summary
from pl_mc.studies.sources import AnySource, ReceiverSource, Series, expected_epochs
from pl_mc.studies.spec import Experiment, Strict
from pl_mc.studies.study import Work

# Statistics a second, from the seconds of manifests of shipped experiments, on two cores.
_STATISTICS_PER_S = 1.7e6
# About as many satellites are in view, each of which gets the biases of the curves.
_IN_VIEW = 25


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
        return self.source.files()


def run(experiment: GuoExperiment, execution: Execution) -> Findings:
    """Detection over the series and at one epoch, the paper's table beside it, figures 1-5 with more."""
    tests = experiment.test_records()
    loaded = experiment.source.series(draws=1, seed=experiment.seed, precision=experiment.precision)
    g, errors_m = without_satellites(loaded, experiment.without)
    row = least_detectable(g, system=experiment.system)
    kept = np.flatnonzero(row >= 0)
    if not kept.size:
        raise InputError(f"system: {experiment.system!r} has no satellite that the others check, at any epoch.")
    left_out = f"{row.size - kept.size} of {row.size} epochs are left out: no satellite of {experiment.system}"
    skipped = [f"{left_out} is checked by others."] if kept.size < row.size else []
    series = GuoSeries(
        geometry=_epochs(g, kept),
        errors_m=errors_m[kept],
        faulted_row=row[kept],
        biases_m=(0.0, *experiment.biases_m),
        real=isinstance(experiment.source, ReceiverSource),
    )
    options: dict[str, Any] = {
        "p_fa": experiment.p_fa,
        "seed": experiment.seed,
        "precision": experiment.precision,
        "progress": execution.progress,
    }
    draws = {"draws": experiment.draws, "calibration_draws": experiment.calibration_draws}
    day = day_of_detections(series, tests, **draws, **options)
    hypotheses = hypothesis_table(day.drawn)
    curves = experiment.curves
    place = np.flatnonzero(g.epoch == curves.epoch)
    if not place.size:
        raise InputError(f"curves.epoch: {curves.epoch} is not among the epochs {g.epoch[0]} to {g.epoch[-1]}.")
    epoch = g[int(place[0])]
    sizes = {"start_m": curves.start_m, "stop_m": curves.stop_m, "step_m": curves.step_m}
    draws = {"draws": curves.draws, "calibration_draws": curves.calibration_draws}
    power = power_table(epoch, ramps(epoch, satellites=epoch.names, **sizes), tests, **draws, **options)
    reliable = reliability(epoch)
    return Findings(
        summary=summary(experiment, series, day.detection, hypotheses),
        tables=(
            Table("detection", day.detection, _chart("at the epochs of the series")),
            Table("detection_draws", day.drawn, _chart("in many draws of noise at each epoch")),
            Table("epochs", day.epochs, stored="parquet"),
            Table("hypotheses", hypotheses),
            Table("power", power, _chart("satellite by satellite at one epoch", "satellite")),
            Table("reliability", reliable),
            Table("variance_factor", variance_factors(series.geometry, series.faulted_row, experiment.p_fa)),
        ),
        pictures=_pictures(experiment, series, day, power, reliable),
        notes=(*loaded.notes, *skipped, *day.notes, *experiment.remarks),
    )


def work(experiment: GuoExperiment) -> Work:
    """What a run costs: statistics of all tests over the series and at the epoch of the curves."""
    curves = experiment.curves
    at_an_epoch = experiment.draws * (len(experiment.biases_m) + 1) + 2 * experiment.calibration_draws
    sizes = 1 + round((curves.stop_m - curves.start_m) / curves.step_m)
    of_curves = _IN_VIEW * sizes * curves.draws + 2 * curves.calibration_draws
    statistics = expected_epochs(experiment.source) * at_an_epoch + of_curves
    return Work(None, statistics * len(experiment.tests) / _STATISTICS_PER_S)


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


def _epochs(g: Geometry, kept: NDArray[np.int64]) -> Geometry:
    """The epochs of these places, which need not follow each other."""
    by_epoch = ("design", "sigma_m", "in_view", "satellite", "epoch", "time_gps_s")
    return dataclasses.replace(g, **{name: getattr(g, name)[kept] for name in by_epoch})


def _chart(what: str, *menus: str) -> Chart:
    rate = Quantity("detection", "detection_rate", "low", "high", "detections")
    return Chart(f"Detection against the bias, {what}", ("test", "reading"), (rate,), ("level", *menus))


def _pictures(
    experiment: GuoExperiment, series: GuoSeries, day: Day, power: pd.DataFrame, reliable: pd.DataFrame
) -> tuple[Picture, ...]:
    """The paper's figures 1-5 and those of detection rates."""
    g, title = series.geometry, experiment.title
    basis = ls_quantities(g).basis
    scaled = np.where(g.in_view, series.errors_m / g.sigma_m, 0.0)
    fitted = np.einsum("enk,ek->en", basis, np.einsum("enk,en->ek", basis, scaled))
    residuals_m = (fitted - scaled) * g.sigma_m
    letters = np.array(g.systems)[g.satellite]
    rows = {letter: g.in_view & (letters == letter) for letter in ("G", "C")}
    by_system = {letter: (residuals_m[own], g.sigma_m[own]) for letter, own in rows.items()}
    counts = {letter: own.sum(axis=1) for letter, own in rows.items()}
    drawn = {
        "detection": (
            figures.detection_figure(day.detection, title=title),
            "Detection rates by test and bias, with 95 % intervals.",
        ),
        "fig1_residuals": (
            figures.residual_figure(by_system, title=title),
            "Pseudorange errors, how often which, by system.",
        ),
        "fig2_satellites": (
            figures.satellites_figure(g.epoch, counts, dops(g).pdop, title=title),
            "Satellites in view over the epochs.",
        ),
    }
    for name, test, sizes in (
        ("fig3_t", "mean_check", (0.0,)),
        ("fig4_t", "mean_check", experiment.biases_m),
        ("fig5_f", "chi2", experiment.biases_m),
    ):
        of_test = day.epochs[day.epochs.test == test]
        if len(of_test):
            first = of_test[of_test.reading == of_test.reading.iloc[0]]
            figure = figures.statistic_figure(first, biases_m=sizes, title=title)
            drawn[name] = figure, "A test's statistic and its threshold over the epochs."
    figure = figures.power_figure(power, reliable, title=title)
    drawn["power"] = figure, "Detection rate of each test against the bias."
    figure = figures.satellite_power_figure(power, reliable, title=title)
    drawn["power_satellites"] = figure, "Detection rate by satellite and bias."
    return tuple(Picture(name, *figure_and_caption) for name, figure_and_caption in drawn.items())
