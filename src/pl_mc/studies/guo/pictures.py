"""The figures of an experiment after Guo et al. (2022), from its tables and, for its first two, from its series."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pl_mc.geometry import dops
from pl_mc.report.findings import Picture
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.guo import figures
from pl_mc.studies.guo.run import GuoExperiment, series_of
from pl_mc.studies.sources import SiteSource

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Mapping[str, pd.DataFrame]

_SYSTEMS = ("G", "C")


def pictures(stored: Tables, experiment: GuoExperiment) -> tuple[Picture, ...]:
    """The paper's figures 1-5 and those of detection rates."""
    title = experiment.title
    statistics = []
    source, time = experiment.source, "epoch"
    if isinstance(source, SiteSource):
        time = f"epoch, one every {source.interval_s:g} s from {source.start}"
    # Many rows, which a folder may be without.
    epochs = stored["epochs"] if "epochs" in stored else pd.DataFrame({"test": []})
    for name, test, sizes in (
        ("fig3_t", "mean_check", (0.0,)),
        ("fig4_t", "mean_check", experiment.biases_m),
        ("fig5_f", "chi2", experiment.biases_m),
    ):
        of_test = epochs[epochs.test == test]
        if len(of_test):
            first = of_test[of_test.reading == of_test.reading.iloc[0]]
            draw = partial(figures.statistic_figure, first, biases_m=sizes, time=time, title=title)
            statistics.append(Picture(name, "A test's statistic and its threshold over the epochs.", draw))
    return (
        Picture(
            "detection", "Detection rates by test and bias, with 95 % intervals.",
            lambda: figures.detection_figure(stored["detection"], title=title),
        ),
        Picture("fig1_residuals", "Pseudorange errors, how often which, by system.", lambda: _residuals(experiment)),
        Picture("fig2_satellites", "Satellites in view over the epochs.", lambda: _satellites(experiment)),
        *statistics,
        Picture(
            "power", "Detection rate of each test against the bias.",
            lambda: figures.power_figure(stored["power"], stored["reliability"], title=title),
        ),
        Picture(
            "power_satellites", "Detection rate by satellite and bias.",
            lambda: figures.satellite_power_figure(stored["power"], stored["reliability"], title=title),
        ),
    )  # fmt: skip


def _residuals(experiment: GuoExperiment) -> Figure:
    _, series, _ = series_of(experiment)
    g = series.geometry
    basis = ls_quantities(g).basis
    scaled = np.where(g.in_view, series.errors_m / g.sigma_m, 0.0)
    fitted = np.einsum("enk,ek->en", basis, np.einsum("enk,en->ek", basis, scaled))
    residuals_m = (fitted - scaled) * g.sigma_m
    letters = np.array(g.systems)[g.satellite]
    rows = {letter: g.in_view & (letters == letter) for letter in _SYSTEMS}
    by_system = {letter: (residuals_m[own], g.sigma_m[own]) for letter, own in rows.items()}
    return figures.residual_figure(by_system, title=experiment.title)


def _satellites(experiment: GuoExperiment) -> Figure:
    _, series, _ = series_of(experiment)
    g = series.geometry
    letters = np.array(g.systems)[g.satellite]
    counts = {letter: (g.in_view & (letters == letter)).sum(axis=1) for letter in _SYSTEMS}
    return figures.satellites_figure(g.epoch, counts, dops(g).pdop, title=experiment.title)
