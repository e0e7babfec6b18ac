"""The study of kills and of damaged stored files, at a small size; and its judge sees what it should."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path

import interrupted
import interruptions
import pandas as pd
import pytest
from interrupted import FINDINGS, ORDER, SUBJECTS, Found, Scene, judge, planned
from outcomes import Case
from study import counted

from pl_mc.input_errors import InputError


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("interrupted")


def test_every_damage_gives_the_result_or_a_sentence(place: Path) -> None:
    """Ways to damage a part of a sweep and its record in turn; runs that go on to a page are left to the study."""
    names = [name for name, subject in SUBJECTS.items() if subject.scene == "sweep"]
    ways = [(name, way) for k, name in enumerate(names) for way in SUBJECTS[name].damages[k::3]]
    found = [judge(Case(name, way, 1), place) for name, way in ways]
    bad = [one for one in found if one.outcome in FINDINGS]
    assert not bad, bad[0]
    count = Counter(one.outcome for one in found)
    assert count["told"] > 10


def test_one_kill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what the summary says of it."""
    monkeypatch.setattr(interruptions, "_ANY_TIME", 0.0)
    kills, chains = interruptions.killed(1, seed=0)
    assert kills[["lost", "unlike"]].to_numpy().tolist() == [[0, 0]]
    assert kills.after[0] >= 1
    assert chains.drop(columns=["chain", "kills", "seconds"]).to_numpy().tolist() == [[0, 0, 0]]
    case = planned(1, 0)[0]
    table = counted(
        pd.DataFrame([asdict(case) | {"outcome": "told", "seconds": 2.5, "peak_gb": 0.25}]), ORDER, FINDINGS
    )
    said = interruptions.summary(table, kills, chains, 1.0, 0.5, 0)
    assert "1 kills (SIGKILL) hit 1 sweeps of 12 parts" in said
    assert "0 of 1 damages led to a finding" in said
    assert f"lived {kills.seconds[0]:.1f} s" in said
    assert "with 0.50 GB of memory at most; to go on after a damage took 2.5 s at most, with 0.25 GB." in said


def test_studies_damage_every_kind_in_every_way() -> None:
    wanted = planned(2_000, 3)
    assert len(wanted) == len(set(wanted)) == 2_000
    for name, subject in SUBJECTS.items():
        assert {case.mutation for case in wanted if case.subject == name} == set(subject.damages)


@pytest.mark.parametrize(
    ("subject", "outcome"),
    [("part of a sweep", outcome) for outcome in ("told", "refused", *FINDINGS[:4])] + [("record of a sweep", "same")],
)
def test_the_judge_tells_outcomes_apart(
    subject: str, outcome: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a run that does what is to be seen."""
    sound = tmp_path / "sound"
    for tree in (sound, tmp_path / "stranger"):
        (tree / "sweep").mkdir(parents=True)
        (tree / "sweep" / "_sweep.json").write_text('{"experiment": {"a": [1,\n2]}}\n', encoding="utf-8")
        for number in range(2):
            (tree / "sweep" / f"part-{number}.parquet").write_text(f"{tree.name} {number}\n", encoding="utf-8")

    def resumed(tree: Path) -> Found:
        files = [(path, sound / "sweep" / path.name) for path in (tree / "sweep").iterdir()]
        changed = [path for path, whole in files if path.read_bytes() != whole.read_bytes()]
        if not changed:
            return Found({"a": b"1"}, ())
        if outcome == "exception":
            raise ZeroDivisionError
        if outcome in ("sentence", "refused"):
            raise InputError(f"{changed[0] if outcome == 'refused' else 'something'}: it is damaged.")
        result = {"a": b"2" if outcome == "other" else b"1"}
        return Found(result, () if outcome in ("untold", "same") else (f"{changed[0]}: it was counted again.",))

    monkeypatch.setattr(interrupted, "scene", lambda name, folder: Scene(sound, tmp_path / "stranger", resumed))
    monkeypatch.setattr(interrupted, "sound", lambda name, folder: Found({"a": b"1"}, ()))
    way = "columns shifted" if outcome == "same" else "bytes deleted"
    numbers = range(8) if outcome == "same" else (1,)
    assert outcome in {judge(Case(subject, way, number), tmp_path).outcome for number in numbers}
