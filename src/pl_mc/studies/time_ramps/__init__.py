"""Ramps in time: errors that grow on one satellite, and how long they stay unseen."""

from pl_mc.studies.study import Study
from pl_mc.studies.time_ramps.run import TimeRampsExperiment, answer, checks, pictures, run, with_faults, work

STUDY = Study(
    model=TimeRampsExperiment, run=run, answer=answer, pictures=pictures, work=work, checks=checks,
    with_faults=with_faults,
    question="How long does an error that grows on one satellite stay unseen, by tests of single epochs and by "
    "sequential ones?",
)  # fmt: skip
