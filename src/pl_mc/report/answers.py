"""What each kind of experiment asks, and its answer in three sentences with numbers.

A new kind gets a function beside its other texts and a line in both tables here; until it has, its page asks what
its title says and quotes its summary.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from pl_mc.report.run_folder import RunFolder
from pl_mc.report.series_answers import observe_answer, readings_answer, series_answer
from pl_mc.report.sweep_answers import (
    compare_answer,
    map_answer,
    noise_answer,
    satellite_ramps_answer,
    stanford_answer,
    sweep_answer,
    variants_answer,
)
from pl_mc.studies.guo.answer import guo_answer
from pl_mc.studies.risk.answer import risk_answer
from pl_mc.studies.service.text import service_answer
from pl_mc.studies.time_ramps.text import time_ramps_answer
from pl_mc.studies.tuning.text import tuning_answer

ANSWERS: dict[str, Callable[[RunFolder], tuple[str, ...]]] = {
    "compare": compare_answer,
    "guo": guo_answer,
    "map": map_answer,
    "noise": noise_answer,
    "observe": observe_answer,
    "readings": readings_answer,
    "risk": risk_answer,
    "satellite-ramps": satellite_ramps_answer,
    "series": series_answer,
    "service": service_answer,
    "stanford": stanford_answer,
    "sweep": sweep_answer,
    "time-ramps": time_ramps_answer,
    "tuning": tuning_answer,
    "variants": variants_answer,
}

QUESTIONS: dict[str, str] = {
    "compare": "How often does each method alarm, mislead or miss under one ramp, and which test detects best at "
    "one false-alarm rate?",
    "guo": "How often does each test detect a bias on the least detectable satellite, at its nominal threshold "
    "and at equal false-alarm rates?",
    "map": "With a bias on every satellite in turn at every epoch, how often does each method alarm, mislead or "
    "miss?",
    "noise": "How much more often does each method alarm, mislead or miss where errors are not Gaussian, though "
    "receivers believe that they are?",
    "observe": "How large are the receiver's position errors, do the protection levels hold them, and when is "
    "there an alarm?",
    "readings": "What the paper leaves open can be read in several ways: which reading comes near its table?",
    "risk": "How probable is misleading information or a missed detection, which fault is the worst, and which "
    "multiplier would keep the target?",
    "satellite-ramps": "With a bias on one satellite after the other, how often does each method alarm, mislead "
    "or miss?",
    "series": "With faults in windows of a series, what do the plain and the robust method make of errors, "
    "protection levels and alarms?",
    "service": "Where on Earth, and for how much of the day, does each method serve an operation?",
    "stanford": "How do vertical error and vertical protection level lie to each other and to the alert limit?",
    "sweep": "How often does each method alarm, mislead or miss, fault by fault?",
    "time-ramps": "How long does an error that grows on one satellite stay unseen, by tests of single epochs and "
    "by sequential ones?",
    "tuning": "Can the limits of IGG-III be chosen so that its level costs less at the same risk?",
    "variants": "Which choice within IGG-III decides how often it alarms, misleads, misses or throws out good "
    "satellites?",
}

_SENTENCE = re.compile(r"(?<=[.!?])\s+(?=[A-Z0-9|])")


def question_of(run: RunFolder) -> str:
    """What the run asked, in a sentence."""
    return QUESTIONS.get(run.kind, f"{run.title.rstrip('.')}.")


def answer_of(run: RunFolder) -> tuple[str, ...]:
    """Three sentences with numbers."""
    answer = ANSWERS.get(run.kind)
    return answer(run) if answer is not None else quoted(run.summary)


def quoted(summary: str) -> tuple[str, ...]:
    """Up to three sentences with numbers out of a summary, its last paragraphs first; findings come last."""
    parts = [part for part in summary.split("\n\nNotes:")[0].split("\n\n") if not part.startswith(("#", "|"))]
    found = [
        sentence.strip(" -*").replace("`", "")
        for part in reversed(parts)
        for sentence in _SENTENCE.split(" ".join(part.split()))
        if re.search(r"\d", sentence)
    ]
    return tuple(found[:3]) or ("The summary below says what was found.",)
