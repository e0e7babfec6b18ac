"""A service volume: availability and continuity over a grid of users and a day."""

from pl_mc.studies.service.pictures import pictures
from pl_mc.studies.service.run import ServiceExperiment, checks, run, sweeps, work
from pl_mc.studies.service.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=ServiceExperiment, run=run, answer=answer, pictures=pictures, sweeps=sweeps, work=work, checks=checks,
    question="Where on Earth, and for how much of the day, does each method serve an operation?",
)  # fmt: skip
