"""Faults in windows of a series, solved by a plain and a robust method, after Zhao et al. (2021)."""

from pl_mc.studies.series.run import SeriesExperiment, answer, pictures, run, work
from pl_mc.studies.study import Study

STUDY = Study(
    model=SeriesExperiment, run=run, answer=answer, pictures=pictures, work=work,
    with_faults=lambda content, texts: {"faults": {"biases": texts}},
    question="With faults in windows of a series, what do the plain and the robust method make of errors, "
    "protection levels and alarms?",
)  # fmt: skip
