"""Stored files of runs that go on, damaged: parts and records of a sweep, of an experiment, of a finished run.

Outcomes:

- ``told``: bit for bit the result of the run that nothing happened to, and a note names the file.
- ``same``: that result without a note, since the damaged record still says what it said.
- ``refused``: an `InputError`, one sentence a line, that names the file or its folder.
- ``other``: another result, or files that do not belong there. A finding, with a note or without.
- ``untold``: the result, but a part was damaged, or a record said something else, and no note names it. A finding.
- ``exception``, ``sentence``, ``hang``, ``crash``: findings, as of `outcomes`.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from numpy.random import Generator

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

from mutations import MUTATIONS
from outcomes import Case, Outcome, attempted, generator_of, serve

from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment, run_shard
from pl_mc.studies.spec import Experiment
from reference import small_sweep as small
from reference.damage import CHANGED, FORGED_ROWS, FORGED_WORDS, changed, forged

ORDER = ("told", "same", "refused")
FINDINGS = ("other", "untold", "exception", "sentence", "hang", "crash")

# What receivers write means nothing in these files.
_OF_RECEIVERS = ("event inserted", "message of another meaning")
# The same again under other names.
_TWICE = ("truncated", "empty")

# An experiment that makes six parts.
EXPERIMENT = Path(__file__).parents[2] / ".ci" / "small.toml"


@dataclass(frozen=True)
class Target:
    """A sound file, and what may stand in its place: another file of its folder, the same file of another run."""

    content: bytes
    neighbour: bytes
    stranger: bytes


Damage = Callable[[Target, Generator], bytes]


def _of_hands(mutation: Callable[[bytes, Generator], bytes]) -> Damage:
    return lambda target, rng: mutation(target.content, rng)


def _of_disks(kind: str) -> Damage:
    return lambda target, rng: changed(
        kind, target.content, rng.random(), neighbour=target.neighbour, stranger=target.stranger
    )


def _one_of(options: Mapping[str, Any], rng: Generator) -> Any:
    return options[list(options)[int(rng.integers(len(options)))]]


def _more_events(rows: Any, rng: Generator) -> Any:
    """Counts that contradict nothing: a checksum alone knows them."""
    return rows.assign(unconverged=(rows.unconverged + rng.integers(1, 5, len(rows))).clip(upper=rows.draws))


def _value_exchanged(target: Target, rng: Generator) -> bytes:
    """A record in its form with one value of another."""
    content = json.loads(target.content)
    places = list(_leaves(content))
    holder, key = places[int(rng.integers(len(places)))]
    values: tuple[Any, ...] = (None, True, -1, 0, 10**30, 0.5, "", "ls", "x" * 3000, [], {}, [1, None], {"a": {"b": 1}})
    holder[key] = values[int(rng.integers(len(values)))]
    return (json.dumps(content, indent=2) + "\n").encode()


def _leaves(content: Any) -> Any:
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in list(pairs):
        yield content, key
        if isinstance(value, dict | list):
            yield from _leaves(value)


BOTH: Mapping[str, Damage] = {
    **{name: _of_hands(mutation) for name, mutation in MUTATIONS.items() if name not in _OF_RECEIVERS},
    **{name: _of_disks(name) for name in CHANGED if name not in _TWICE},
}
OF_PARTS: Mapping[str, Damage] = {
    "other counts, checksum of before": lambda target, rng: forged(
        target.content, partial(_more_events, rng=rng), checksum=False
    ),
    "other rows, checksum that is right": lambda target, rng: forged(target.content, _one_of(FORGED_ROWS, rng)),
    "other words, checksum that is right": lambda target, rng: forged(target.content, words=_one_of(FORGED_WORDS, rng)),
}
OF_RECORDS: Mapping[str, Damage] = {"value exchanged": _value_exchanged}


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _link_to_itself(path: Path) -> None:
    path.unlink()
    path.symlink_to(path)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


# What stands in the place of a file and is none.
PLACES: Mapping[str, Callable[[Path], None]] = {
    "a folder in its place": _folder,
    "a link to itself in its place": _link_to_itself,
    "a pipe in its place": _pipe,
}


@dataclass(frozen=True)
class Found:
    """What a run gave that went on.

    Attributes:
        result: its tables, answers and files by name, to the bit.
        notes: what it says beside.
    """

    result: Mapping[str, bytes]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """What is there when a run goes on.

    Attributes:
        tree: a folder with what was stored.
        stranger: the same of a run with another seed.
        resumed: goes on with a copy of the tree.
    """

    tree: Path
    stranger: Path
    resumed: Callable[[Path], Found]


@dataclass(frozen=True)
class Subject:
    """A kind of stored file.

    Attributes:
        scene: name of the scene.
        pattern: of the files in its tree, one of which is damaged.
        beside: of the files, one of which may stand in its place.
        own: ways to damage it beside those for all files.
        share: of the cases of a study. Runs that go on to a page take long.
    """

    scene: str
    pattern: str
    beside: str
    own: Mapping[str, Damage]
    share: float

    @property
    def damages(self) -> tuple[str, ...]:
        """The ways in which it is damaged."""
        return (*BOTH, *self.own, *PLACES)

    @property
    def is_part(self) -> bool:
        """Whether it is a part, every byte of which counts."""
        return self.own is OF_PARTS


PART, FOLDER, RUN = "part-*.parquet", "one.unfinished", "one"
SUBJECTS: Mapping[str, Subject] = {
    "part of a sweep": Subject("sweep", f"sweep/{PART}", f"sweep/{PART}", OF_PARTS, 0.56),
    "record of a sweep": Subject("sweep", "sweep/_sweep.json", f"sweep/{PART}", OF_RECORDS, 0.14),
    "part of an unfinished run": Subject("unfinished", f"{FOLDER}/*/{PART}", f"{FOLDER}/*/{PART}", OF_PARTS, 0.06),
    "record of an unfinished run": Subject(
        "unfinished", f"{FOLDER}/experiment.json", f"{FOLDER}/*/*.json", OF_RECORDS, 0.06
    ),
    "record of its sweep": Subject("unfinished", f"{FOLDER}/*/_sweep.json", f"{FOLDER}/*.json", OF_RECORDS, 0.04),
    "manifest of a finished run": Subject("finished", f"{RUN}/manifest.json", f"{RUN}/report.json", OF_RECORDS, 0.05),
    "report of a finished run": Subject("finished", f"{RUN}/report.json", f"{RUN}/manifest.json", OF_RECORDS, 0.05),
    "tables and summary of a finished run": Subject("finished", f"{RUN}/*[vd]", f"{RUN}/*.csv", {}, 0.04),
}


def planned(count: int, seed: int) -> list[Case]:
    """Damaged files of every kind, each in every way in turn."""
    first, wanted = seed * 1_000_000, []
    counts = {name: round(subject.share * count) for name, subject in SUBJECTS.items()}
    counts[next(iter(SUBJECTS))] += count - sum(counts.values())
    for name, number in counts.items():
        ways = SUBJECTS[name].damages
        wanted += [Case(name, ways[k % len(ways)], first + k // len(ways)) for k in range(number)]
    return wanted


@cache
def scene(name: str, place: Path) -> Scene:
    """A sweep with all of its parts, an unfinished run with all of its parts, or a finished run; made at a place."""
    make, resumed = {"sweep": (_sweep, _swept), "unfinished": (_unfinished, _run), "finished": (_finished, _read)}[name]
    for whose, more in (("sound", 0), ("stranger", 1)):
        make(place / name / whose, more)
    return Scene(place / name / "sound", place / name / "stranger", resumed)


def _sweep(tree: Path, more: int) -> None:
    with small.cut(2):
        small.run(folder=tree / "sweep", seed=small.SEED + more)


def _swept(tree: Path) -> Found:
    with small.cut(2):
        table = small.run(folder=tree / "sweep", resume=True, workers=1)
    # Numbers are written so that they are read back to the bit.
    counted = {"table": table.to_csv(index=False).encode()}
    return Found(counted | small.contents(tree / "sweep"), tuple(table.attrs["notes"]))


def _experiment(more: int = 0) -> Experiment:
    content = tomllib.loads(EXPERIMENT.read_text(encoding="utf-8"))
    return build_experiment(content | {"draws": 1500, "seed": content["seed"] + more}, source=EXPERIMENT.name)


def _unfinished(tree: Path, more: int) -> None:
    with small.cut(1, 1):
        run_shard(RUN, _experiment(more), tree / RUN, Execution(shard=(1, 1), workers=1))


def _finished(tree: Path, more: int) -> None:
    with small.cut(1, 1):
        run_experiment(RUN, _experiment(more), tree / RUN, execution=Execution(workers=1))


def _run(tree: Path) -> Found:
    with small.cut(1, 1):
        found = run_experiment(RUN, _experiment(), tree / RUN, execution=Execution(resume=True, workers=1))
    tables = {path.name: path.read_bytes() for path in sorted((tree / RUN).glob("*.csv"))}
    said = {"left": sorted(path.name for path in tree.iterdir()), "answer": found.answer}
    return Found(tables | {name: repr(value).encode() for name, value in said.items()}, found.notes)


def _read(tree: Path) -> Found:
    """Nothing is counted: what it hands back, the notes included, is what was read."""
    found = _run(tree)
    return Found({**found.result, "notes": repr(found.notes).encode()}, found.notes)


@cache
def sound(name: str, folder: Path) -> Found:
    """What a scene gives where nothing is damaged."""
    made = scene(name, folder)
    return made.resumed(_copied(made, folder))


def prepare(folder: Path) -> None:
    """All that is compared with; not part of any case."""
    for subject in SUBJECTS.values():
        sound(subject.scene, folder)


def _copied(made: Scene, folder: Path) -> Path:
    """A copy of a scene, always at the same place, so that texts that name it are the same."""
    tree = folder / "case"
    shutil.rmtree(tree, ignore_errors=True)
    shutil.copytree(made.tree, tree)
    return tree


def _picked(tree: Path, pattern: str, rng: Generator) -> Path:
    found = sorted(path for path in tree.glob(pattern) if path.is_file())
    return found[int(rng.integers(len(found)))]


def damage(case: Case, made: Scene, tree: Path) -> Path:
    """Damage a file of a copy of the scene; the file."""
    subject, rng = SUBJECTS[case.subject], generator_of(case)
    path = _picked(tree, subject.pattern, rng)
    if case.mutation in PLACES:
        PLACES[case.mutation](path)
        return path
    beside = path
    while beside.read_bytes() == path.read_bytes():
        beside = _picked(tree, subject.beside, rng)
    content, neighbour = path.read_bytes(), beside.read_bytes()
    stranger = (made.stranger / path.relative_to(tree)).read_bytes()
    # Some tables do not depend on the seed.
    target = Target(content, neighbour, stranger if stranger != content else neighbour)
    way = {**BOTH, **subject.own}[case.mutation]
    # A digit may become what it was.
    while content == target.content:
        content = way(target, rng)
    path.write_bytes(content)
    return path


def judge(case: Case, folder: Path) -> Outcome:
    """Damage the file of a case, go on, and say what came of it."""
    subject = SUBJECTS[case.subject]
    made, expected = scene(subject.scene, folder), sound(subject.scene, folder)
    tree = _copied(made, folder)
    path = damage(case, made, tree)
    says = _said_by(path)
    begin = time.perf_counter()
    found, outcome, detail = attempted(lambda: made.resumed(tree))
    if outcome == "refused" and str(tree) not in detail:
        outcome = "sentence"
    if not outcome:
        named = any(str(path) in note for note in found.notes)
        # A record that says what it said may stay as it is.
        kept = () if named or subject.is_part else (path.name,)
        detail = _difference(found.result, expected.result, kept)
        if detail:
            outcome = "other"
        elif named:
            outcome = "told"
        else:
            says_the_same = says == _said_by(made.tree / path.relative_to(tree))
            outcome = "same" if says_the_same and not subject.is_part else "untold"
    return Outcome(**asdict(case), outcome=outcome, detail=detail[-3000:], seconds=time.perf_counter() - begin)


def _said_by(path: Path) -> Any:
    """What a record says of the run, in whatever form it is written."""
    try:
        content = json.loads(path.read_bytes()) if path.is_file() else None
    except (ValueError, OSError, RecursionError):
        return None
    read = ("experiment", "environment") if path.name == "_sweep.json" else ("experiment",)
    return {name: content.get(name) for name in read} if isinstance(content, dict) else None


def _difference(found: Mapping[str, bytes], sound: Mapping[str, bytes], kept: Sequence[str]) -> str:
    """The first difference in words; empty where there is none."""
    for name in sorted({*found, *sound} - {*kept}):
        one, other = found.get(name), sound.get(name)
        if one != other:
            return f"{name}: {one and one[:1000]!r}, not {other and other[:1000]!r}"
    return ""


if __name__ == "__main__":
    serve(judge, prepare)
