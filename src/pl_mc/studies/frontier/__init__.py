"""The frontier: which method alarms least, or has the smallest level, at equal proven risk."""

from pl_mc.studies.frontier.record import FrontierExperiment
from pl_mc.studies.frontier.run import checks, pictures, run, work
from pl_mc.studies.frontier.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=FrontierExperiment, run=run, answer=answer, pictures=pictures, work=work, checks=checks,
    question="Which method has the smallest level and the fewest alarms at equal proven risk?",
)  # fmt: skip
