"""Chi-square test against inter-system mean check, after Guo et al. (2022)."""

from pl_mc.studies.guo.pictures import pictures
from pl_mc.studies.guo.run import GuoExperiment, answer, run, work
from pl_mc.studies.study import Study

STUDY = Study(
    model=GuoExperiment, run=run, answer=answer, pictures=pictures, work=work,
    question="How often does each test detect a bias on the least detectable satellite, at its nominal threshold "
    "and at equal false-alarm rates?",
)  # fmt: skip
