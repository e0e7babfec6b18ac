"""One robust estimate in many variants, under the same faults and noise."""

from pl_mc.studies.study import Study
from pl_mc.studies.variants.record import VariantsExperiment
from pl_mc.studies.variants.run import pictures, run, sweeps
from pl_mc.studies.variants.text import answer

STUDY = Study(
    model=VariantsExperiment,
    question="Which choice within IGG-III decides how often it alarms, misleads, misses or throws out good satellites?",
    run=run,
    answer=answer,
    pictures=pictures,
    sweeps=sweeps,
)
