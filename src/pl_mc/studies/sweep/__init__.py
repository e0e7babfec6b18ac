"""Rates of events under faults: fault by fault, satellite by satellite, or as maps over time."""

from pl_mc.studies.study import Study
from pl_mc.studies.sweep.pictures import pictures
from pl_mc.studies.sweep.record import SweepExperiment
from pl_mc.studies.sweep.text import answer
from pl_mc.studies.sweep.views import run, sweeps

_HOW_OFTEN = "how often does each method alarm, mislead or miss"

QUESTIONS = {
    "faults": f"H{_HOW_OFTEN[1:]}, fault by fault?",
    "satellites": f"With a bias on one satellite after the other, {_HOW_OFTEN}?",
    "map": f"With a bias on every satellite in turn at every epoch, {_HOW_OFTEN}?",
}

STUDY = Study(
    model=SweepExperiment, question=lambda experiment: QUESTIONS[experiment.view], run=run, answer=answer,
    pictures=pictures,
    sweeps=sweeps,
    with_faults=lambda content, texts: {
        "view": "faults", "draws_per_satellite": None, "faults": {"biases": texts}
    },
)  # fmt: skip
