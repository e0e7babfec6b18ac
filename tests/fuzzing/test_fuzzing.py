"""Damaged files and strange arguments: a result or a sentence, nothing else; and the judge sees what it should."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import api_calls
import numpy as np
import outcomes as judging
import pytest
import subjects as kinds
from api_calls import ELSEWHERE, HEAVY, KERNELS, STRANGE, Call, calls, documented
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mutations import MUTATIONS
from outcomes import FINDINGS, STRANGE_ARGUMENTS, Case, Outcome, cases, judge, outcomes

from pl_mc.input_errors import InputError


def light_calls() -> list[str]:
    return [name for name in calls() if name.rpartition(".")[2] not in HEAVY]


def test_every_function_of_the_reference_is_called() -> None:
    left = {path for path in documented("function") if not path.startswith(KERNELS)} - {*ELSEWHERE, *calls()}
    assert not left
    assert {name.rpartition(".")[2] for name in calls()} >= {*HEAVY}


@pytest.mark.parametrize("name", light_calls())
def test_sound_arguments_are_taken(name: str) -> None:
    calls()[name].function(**calls()[name].arguments)


@pytest.fixture(scope="module")
def found() -> list[Outcome]:
    """Three hundred damaged files, every kind with every damage, and three hundred calls."""
    names = list(kinds.subjects())
    functions = light_calls()
    strange = [Case(functions[k % len(functions)], STRANGE_ARGUMENTS, k) for k in range(300)]
    return list(outcomes(cases(names, MUTATIONS, 300) + strange))


def test_every_damage_gives_a_result_or_a_sentence(found: list[Outcome]) -> None:
    assert len(found) == 600
    bad = [one for one in found if one.outcome in FINDINGS]
    assert not bad, bad[0]


def test_every_damage_is_answered_soon(found: list[Outcome]) -> None:
    assert max(one.seconds for one in found) < 10


def test_the_outcomes_are_not_all_of_one_sort(found: list[Outcome]) -> None:
    """A reader that refused everything, or a judge that saw nothing, would pass the tests above."""
    count = Counter(one.outcome for one in found)
    assert count["refused"] > 150
    assert count["same"] > 15
    assert count["told"] >= 1
    assert count["well formed"] >= 1
    assert count["accepted"] > 5


def test_sound_files_are_read(tmp_path: Path) -> None:
    for subject in kinds.subjects().values():
        path = tmp_path / f"sound{subject.suffix}"
        path.write_bytes(subject.content)
        read = subject.read(path)
        # What a solution file holds is told of every one.
        assert [
            note for note in read.notes if not re.match(r": 8 positions .*of (RTKLIB's form|GGA sentences)\.$", note)
        ] == []
        assert bool(read.numbers) == (subject.tolerance is not None)
    for call in calls().values():
        call.function(**call.arguments)


@pytest.mark.parametrize("outcome", ["silent", "exception", "sentence", "refused", "same", "told", "well formed"])
def test_the_judge_tells_outcomes_apart(outcome: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(path: Path) -> kinds.Read:
        if path.read_bytes() == b"sound":
            return kinds.Read({"a": 1.0})
        if outcome == "exception":
            raise ZeroDivisionError
        if outcome in ("sentence", "refused"):
            raise InputError(f"{path}: it is damaged{'.' if outcome == 'refused' else ''}")
        return kinds.Read({"a": 1.0 if outcome == "same" else 2.0}, ("odd",) if outcome == "told" else ())

    subject = kinds.Subject(outcome, b"sound", read, "", 0.5, lambda one, other: outcome == "well formed")
    monkeypatch.setattr(kinds, "subjects", lambda: {outcome: subject})
    assert judge(Case(outcome, "bytes deleted", 1), tmp_path).outcome == outcome


@pytest.mark.parametrize(
    ("program", "outcome"), [("import time; time.sleep(100)", "hang"), ("import os; os.kill(os.getpid(), 9)", "crash")]
)
def test_hangs_and_crashes_end_a_process_and_not_the_study(program: str, outcome: str, tmp_path: Path) -> None:
    path = tmp_path / "program.py"
    path.write_text(f"import sys\nprint('ready', flush=True)\nsys.stdin.readline()\n{program}\n", encoding="ascii")
    both = list(outcomes([Case("a", "b", 1), Case("a", "b", 2)], limit_s=2.0, program=path))
    assert [one.outcome for one in both] == [outcome, outcome]


def test_calls_leave_nothing_where_the_study_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some strange values are names of folders; sweeps had been stored in them."""
    call = Call(lambda folder: Path(folder, "left").write_text("x", encoding="ascii"), {"folder": "../.."})
    monkeypatch.setattr(api_calls, "calls", lambda: {"mine": call})
    monkeypatch.setattr(api_calls, "with_strange", lambda call, rng: call.arguments)
    place = tmp_path / "a" / "b"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    assert judge(Case("mine", STRANGE_ARGUMENTS, 1), tmp_path).outcome == "accepted"
    assert sorted(tmp_path.rglob("*")) == [place.parent, place]


def test_cases_are_the_same_every_time() -> None:
    names = list(kinds.subjects())
    for case in cases(names, MUTATIONS, 50):
        assert judging.damaged(case) == judging.damaged(case)
    assert len({(one.subject, one.mutation) for one in cases(names, MUTATIONS, 13 * len(names))}) == 13 * len(names)


ARGUMENTS = st.one_of(
    st.sampled_from(STRANGE),
    st.none(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.binary(max_size=20),
    st.lists(st.one_of(st.floats(), st.integers(-3, 3), st.text(max_size=4), st.none()), max_size=4),
    st.dictionaries(st.text(max_size=4), st.floats(), max_size=3),
    arrays(np.float64, st.tuples(st.integers(0, 4), st.integers(0, 4))),
)


@settings(max_examples=200, derandomize=True)
@given(data=st.data())
def test_strange_arguments_give_a_result_or_a_sentence(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(light_calls()))
    arguments: dict[str, Any] = dict(calls()[name].arguments)
    for field in data.draw(st.sets(st.sampled_from(sorted(arguments)), min_size=1, max_size=2)):
        arguments[field] = data.draw(ARGUMENTS)
    said = "."
    try:
        calls()[name].function(**arguments)
    except InputError as error:
        said = str(error)
    assert judging.is_sentence(said)
