"""One series under several readings of its paper, and how near each comes.

Made of the runs of another kind: `pl_mc.studies.series` is its base.
"""

from pl_mc.studies.readings.run import ReadingsExperiment, answer, run, work
from pl_mc.studies.study import Study

STUDY = Study(
    model=ReadingsExperiment, run=run, answer=answer, work=work,
    question="What the paper leaves open can be read in several ways: which reading comes near its table?",
)  # fmt: skip
