"""Real receiver files, every method at every epoch, with injected faults."""

from pl_mc.studies.observe.record import ObserveExperiment
from pl_mc.studies.observe.run import checks, run, work
from pl_mc.studies.observe.sky_figures import pictures
from pl_mc.studies.observe.text import answer
from pl_mc.studies.study import Study

STUDY = Study(
    model=ObserveExperiment,
    question="How large are the receiver's position errors, do the protection levels hold them, and when is there "
    "an alarm?",
    run=run, answer=answer, pictures=pictures, work=work, checks=checks,
    with_faults=lambda content, texts: {"faults": texts},
    outline={
        "kind": "observe", "title": "Position errors and protection levels",
        "observations": "OBSERVATIONS.rnx.gz", "navigation": "NAVIGATION.rnx.gz", "truth": "X,Y,Z",
    },
)  # fmt: skip
