"""Error against protection level over many scenarios: the Stanford diagram."""

from pl_mc.studies.stanford.run import StanfordExperiment, answer, checks, pictures, run, work
from pl_mc.studies.study import Study

STUDY = Study(
    model=StanfordExperiment, run=run, answer=answer, pictures=pictures, work=work, checks=checks,
    with_faults=lambda content, texts: {"faults": {"biases": texts}, "satellites": ()},
    question="How do error and protection level lie to each other and to the alert limit?",
)  # fmt: skip
