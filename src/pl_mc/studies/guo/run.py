"""Experiments of the kind ``guo``: chi-square test against inter-system mean check, after Guo et al. (2022).

A bias on the least detectable satellite of one system at every epoch of a series. Simulated series have one draw of
noise for the paper's table and many more for rates; real ones have the receiver's own errors. False alarms are
measured before anything is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.detectors import Detector, as_detectors, detector
from pl_mc.engine import Execution
from pl_mc.engine.detect_runs import LEVELS, NOMINAL
from pl_mc.faults import ramps
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.document import Chart, Quantity, Summary, TextTable
from pl_mc.report.findings import Findings, Table
from pl_mc.report.text import percent, rate_text, row_rate
from pl_mc.statistics.reliability import least_detectable, reliability
from pl_mc.studies.guo.paper import LETTERS, closest, hypothesis_table, paper_rate, variance_factors
from pl_mc.studies.guo.series import GuoSeries, day_of_detections, power_table
from pl_mc.studies.sources import AnySource, ReceiverSource, Series, expected_epochs
from pl_mc.studies.spec import Experiment, NamedChoice, epochs_at
from pl_mc.studies.strict import Strict
from pl_mc.studies.study import Work

# Statistics a second, from the seconds of manifests of shipped experiments, on two cores.
_STATISTICS_PER_S = 1.7e6
# About as many satellites are in view, each of which gets the biases of the curves.
_IN_VIEW = 25
# Largest difference of rates at which a reading and a line of the paper are called close.
_CLOSE = 0.10


class TestChoice(NamedChoice):
    """A test by name; every further field is an option of that test."""

    __test__ = False

    def build(self) -> Detector:
        """The test's record."""
        return detector(self.name, **self.options)


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
    tests: Annotated[tuple[TestChoice, ...], Field(min_length=1)] = tuple(
        TestChoice(name=name) for name in ("chi2", "mean_check")
    )
    draws: int = Field(default=256, ge=1)
    calibration_draws: int = Field(default=1999, ge=1)
    curves: PowerCurves
    remarks: tuple[str, ...] = ()

    def judged_axes(self) -> tuple[str, ...]:
        """None: tests alone decide."""
        return ()

    def test_records(self) -> tuple[Detector, ...]:
        """The tests, made records."""
        return as_detectors([choice.build() for choice in self.tests])

    def input_files(self) -> Mapping[str, Path]:
        """The receiver's files, or the almanac or SP3 file of a simulated source that has one."""
        return self.source.files()


def run(experiment: GuoExperiment, execution: Execution) -> Findings:
    """Detection over the series and at one epoch, the paper's table beside it, figures 1-5 with more."""
    tests = experiment.test_records()
    g, series, notes = series_of(experiment)
    options: dict[str, Any] = {name: getattr(experiment, name) for name in ("p_fa", "seed", "precision")}
    options["progress"] = execution.progress
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
        notes=(*notes, *day.notes, *experiment.remarks),
    )


def series_of(experiment: GuoExperiment) -> tuple[Geometry, GuoSeries, tuple[str, ...]]:
    """The series, that of its epochs at which a satellite is biased, and sentences about what was left out."""
    loaded = experiment.source.series(draws=1, seed=experiment.seed, precision=experiment.precision)
    g, errors_m = without_satellites(loaded, experiment.without)
    row = least_detectable(g, system=experiment.system)
    kept = np.flatnonzero(row >= 0)
    if not kept.size:
        raise InputError(f"system: {experiment.system!r} has no satellite that the others check, at any epoch.")
    left_out = f"{row.size - kept.size} of {row.size} epochs are left out: no satellite of {experiment.system}"
    skipped = [f"{left_out} is checked by others."] if kept.size < row.size else []
    series = GuoSeries(
        epochs_at(g, kept), errors_m[kept], row[kept], (0.0, *experiment.biases_m),
        real=isinstance(experiment.source, ReceiverSource),
    )  # fmt: skip
    return g, series, (*loaded.notes, *skipped)


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
    place, at = np.nonzero(g.in_view)
    satellite = g.satellite[place, at]

    def by_satellite(values: np.ndarray, missing: float) -> np.ndarray:
        spread = np.full((len(g), len(g.names), *values.shape[2:]), missing, dtype=values.dtype)
        spread[place, satellite] = values[place, at]
        return spread

    kept = Geometry.from_rows(
        design=by_satellite(g.design, 0.0), sigma_m=by_satellite(g.sigma_m, 1.0),
        in_view=by_satellite(g.in_view, False) & ~out, names=g.names, systems=g.systems, clocks=g.clocks,
        epoch=g.epoch, time_gps_s=g.time_gps_s,
    )  # fmt: skip
    order = np.array([g.names.index(name) for name in kept.names])
    values = by_satellite(errors, 0.0)
    return kept, np.where(kept.in_view, values[np.arange(len(g))[:, None], order[kept.satellite]], 0.0)


def _chart(what: str, *menus: str) -> Chart:
    rate = Quantity("detection", "detection_rate", "low", "high", "detections")
    return Chart(f"Detection against the bias, {what}", ("test", "reading"), (rate,), ("level", *menus))


def summary(experiment: GuoExperiment, series: GuoSeries, detection: pd.DataFrame, hypotheses: pd.DataFrame) -> Summary:
    """The blocks of the summary; tables are those of their names."""
    g = series.geometry
    letters = np.array(g.systems)[g.satellite]
    gps, beidou = ((g.in_view & (letters == letter)).sum(axis=1) for letter in ("G", "C"))
    nominal, equal = (_rates(detection[detection.level == level]) for level in LEVELS)
    biases = sorted(bias for bias in detection.bias_m.unique() if bias)
    for test, letter in LETTERS.items():
        printed = [f"{100 * paper_rate(test, bias):.1f} %" for bias in biases]
        nominal.append([f"paper, {letter}", "as printed", "-", *printed])
    header = ["test", "reading", "P_FA measured", *(f"{bias:g} m" for bias in biases)]
    whose = "the receiver's own errors, fault-free" if series.real else "drawn noise without a fault"
    near = "; ".join(
        f"{row.test} ({row.reading}) and {row.line}, largest difference {100 * row.largest:.1f} points"
        for row in closest(hypotheses).itertuples()
        if row.largest < _CLOSE
    )
    return (
        f"{experiment.source.describe()}. {len(g)} epochs, {gps.min()}-{gps.max()} GPS and "
        f"{beidou.min()}-{beidou.max()} BeiDou satellites; the bias on the least detectable BeiDou satellite "
        f"(largest MDB) of each epoch. Nominal P_FA {percent(experiment.p_fa)} %, seed {experiment.seed}. "
        "Rates with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen. P_FA "
        f"is that of {whose}.",
        "At the nominal thresholds, each with the false-alarm rate that it happens to have (not comparable):",
        TextTable.of(header, nominal),
        "At thresholds of equal false-alarm rate (comparable):",
        TextTable.of(header, equal),
        f"Lines of the paper that a reading comes within {100 * _CLOSE:g} points of at every bias: {near or 'none'}.",
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: GuoExperiment) -> tuple[str, ...]:
    """Detection at the smallest bias, of the best and the worst reading; false alarms at nominal thresholds."""
    biased = tables["detection"][lambda table: table.bias_m > 0]
    bias = biased.bias_m.min()
    at = biased[biased.bias_m == bias]
    nominal, equal = at[at.level == NOMINAL], at[at.level != NOMINAL]
    best, worst = equal.loc[equal.detection_rate.idxmax()], equal.loc[equal.detection_rate.idxmin()]
    plain = min((row for _, row in nominal.iterrows()), key=lambda row: row.test != "chi2")
    least, most = nominal.loc[nominal.p_fa_measured.idxmin()], nominal.loc[nominal.p_fa_measured.idxmax()]
    return (
        f"At thresholds of equal false-alarm rate ({percent(experiment.p_fa)} % asked for) {_name(best)} finds a "
        f"bias of {bias:g} m most often, in {_detected(best)} of {int(best.epochs):,} epochs, and {_name(worst)} "
        f"least often, in {_detected(worst)}.",
        f"At its nominal threshold {_name(plain)} finds it in {_detected(plain)} and raises a false alarm in "
        f"{_false_alarms(plain)} of fault-free trials.",
        f"Nominal thresholds are not comparable: the false-alarm rates that they really have go from "
        f"{_false_alarms(least)} for {_name(least)} to {_false_alarms(most)} for {_name(most)}.",
    )


def _rates(level: pd.DataFrame) -> list[list[str]]:
    """False alarms and detections of each reading, bias by bias."""
    return [
        [*key, _false_alarms(group.iloc[0]), *(_detected(row) for _, row in group[group.bias_m != 0].iterrows())]
        for key, group in level.groupby(["test", "reading"], sort=False)
    ]


def _false_alarms(row: pd.Series) -> str:
    count = round(row.p_fa_measured * row.p_fa_trials)
    return rate_text(count, int(row.p_fa_trials), row.p_fa_low, row.p_fa_high)


def _detected(row: pd.Series) -> str:
    return row_rate(row, "detections", "epochs")


def _name(row: pd.Series) -> str:
    return f"{row.test} ({row.reading})"
