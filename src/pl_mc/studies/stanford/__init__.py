"""Error against protection level over many scenarios: the Stanford diagram."""

from pl_mc.studies.stanford.run import StanfordExperiment, answer, checks, run, work
from pl_mc.studies.study import Study

STUDY = Study(
    model=StanfordExperiment, run=run, answer=answer, work=work, checks=checks,
    question=lambda experiment: (
        "How do {0} error and {0} protection level lie to each other and to the alert limit?"
    ).format(*experiment.judged_axes()),
)  # fmt: skip
