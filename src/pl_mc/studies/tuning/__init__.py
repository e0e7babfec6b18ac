"""Limits of IGG-III that cost least at a given risk, beside the default and least squares."""

from pl_mc.studies.study import Study
from pl_mc.studies.tuning.record import TuningExperiment, checks
from pl_mc.studies.tuning.run import pictures, run, work
from pl_mc.studies.tuning.text import answer

STUDY = Study(
    model=TuningExperiment,
    question="Can the limits of IGG-III be chosen so that its level costs less at the same risk?",
    run=run,
    answer=answer,
    pictures=pictures,
    work=work,
    checks=checks,
    with_faults=lambda content, texts: {"faults": texts},
)
