"""Many methods under one ramp, and their tests at one false-alarm rate, at one epoch or over a day."""

from pl_mc.studies.compare.pictures import pictures
from pl_mc.studies.compare.run import CompareExperiment, run, sweeps
from pl_mc.studies.compare.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=CompareExperiment, run=run, answer=answer, pictures=pictures, sweeps=sweeps,
    question="How often does each method alarm, mislead or miss under one ramp, and which test detects best at "
    "one false-alarm rate?",
)  # fmt: skip
