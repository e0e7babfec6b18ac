"""Faults in windows of a series, solved by a plain and a robust method, after Zhao et al. (2021)."""

from pl_mc.studies.series.run import SeriesExperiment, run, work
from pl_mc.studies.series.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=SeriesExperiment,
    question="With faults in windows of a series, what do the plain and the robust method make of errors, "
    "protection levels and alarms?",
    run=run,
    answer=answer,
    work=work,
)
