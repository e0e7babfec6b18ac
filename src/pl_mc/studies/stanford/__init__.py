"""Vertical error against protection level over many scenarios: the Stanford diagram."""

from pl_mc.studies.stanford.run import StanfordExperiment, checks, run, work
from pl_mc.studies.stanford.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=StanfordExperiment,
    question="How do vertical error and vertical protection level lie to each other and to the alert limit?",
    run=run,
    answer=answer,
    work=work,
    checks=checks,
)
