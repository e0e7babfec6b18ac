"""What can be proven about a protection level at one geometry: risks, the worst faults, budgets, multipliers."""

from pl_mc.studies.risk.record import RiskExperiment, checks, work
from pl_mc.studies.risk.run import pictures, run
from pl_mc.studies.risk.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=RiskExperiment,
    question="How probable is misleading information or a missed detection, which fault is the worst, and which "
    "multiplier would keep the target?",
    run=run,
    answer=answer,
    pictures=pictures,
    work=work,
    checks=checks,
)
