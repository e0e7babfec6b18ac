"""The same faults under noise models that the receiver does not believe in, and errors correlated in time."""

from pl_mc.studies.noise.run import NoiseExperiment, answer, beside, checks, pictures, run, sweeps
from pl_mc.studies.study import Study

STUDY = Study(
    model=NoiseExperiment, run=run, answer=answer, pictures=pictures, sweeps=sweeps, beside=beside, checks=checks,
    question="How much more often does each method alarm, mislead or miss where errors are not Gaussian, though "
    "receivers believe that they are?",
)  # fmt: skip
