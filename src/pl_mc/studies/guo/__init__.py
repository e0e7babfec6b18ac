"""Chi-square test against inter-system mean check, after Guo et al. (2022)."""

from pl_mc.studies.guo.run import GuoExperiment, run, work
from pl_mc.studies.guo.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=GuoExperiment,
    question="How often does each test detect a bias on the least detectable satellite, at its nominal threshold "
    "and at equal false-alarm rates?",
    run=run,
    answer=answer,
    work=work,
)
