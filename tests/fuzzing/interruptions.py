"""Sweeps that are killed, and stored files that are damaged, before a run goes on; what became of each, in tables.

``python tests/fuzzing/interruptions.py --kills 200 --damaged 2000 --seed 1 --out FOLDER``; one process at a time.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

import interrupted
from interrupted import FINDINGS, ORDER
from outcomes import outcomes
from study import counted, share, total_lines

from pl_mc.engine.checkpoint_store import BadPart
from pl_mc.experiments.output import result_folder
from pl_mc.report.files import write_table
from reference import killed_sweep
from reference import small_sweep as small
from reference.killed_sweep import PARTS, ended_after, whole_parts

SIGN = "interruptions.csv"

# Seconds that a file takes longer, between its temporary file and its place, in this and that chain.
_SLOW_S = (0.0, 0.01, 0.04)
# Kills in a row, at most, before a sweep may end.
_LONGEST = 8
# Of the kills, the share that come at any time, the start included; the others come when a part more is there.
_ANY_TIME = 0.25


@dataclass(frozen=True)
class Kill:
    """One kill that hit a running sweep, and what it left.

    Attributes:
        chain: number of the chain; a chain is one sweep that is killed and goes on until it ends.
        slow_s: seconds that a file took longer.
        before, after: finished parts when the process began, and when it was dead.
        temporary: files left between their writing and their place.
        half: those of them that are shorter than the file that they were to be.
        lost: parts that were there and are not.
        unlike: parts under their name that are not those of the uninterrupted sweep.
        seconds: from the start of the process to its end.
    """

    chain: int
    slow_s: float
    before: int
    after: int
    temporary: int
    half: int
    lost: int
    unlike: int
    seconds: float


@dataclass(frozen=True)
class Chain:
    """What a sweep was that went on after its kills.

    Attributes:
        chain: its number.
        kills: how often it was killed.
        other_tables, other_files: 1 where its table, or a file of its folder, is not that of the uninterrupted
            sweep.
        leftovers: files that the uninterrupted sweep does not leave.
        seconds: that it took to go on.
    """

    chain: int
    kills: int
    other_tables: int
    other_files: int
    leftovers: int
    seconds: float


def main() -> None:
    """Run the study and write its tables and ``interruptions.md``."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--damaged", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=1, help="other seeds kill and damage otherwise; the tests have 0")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    begin = time.perf_counter()
    with result_folder(options.out, sign=SIGN) as folder:
        kills, chains = killed(options.kills, options.seed)
        # Of the processes that were killed and of this one, in which their sweeps go on; kilobytes where this runs.
        who = (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)
        largest_gb = max(resource.getrusage(one).ru_maxrss for one in who) / 1e6
        found = damaged(options.damaged, options.seed)
        seconds = time.perf_counter() - begin
        table = counted(found, ORDER, FINDINGS)
        write_table(table, folder, SIGN.removesuffix(".csv"))
        write_table(kills, folder, "kills")
        write_table(chains, folder, "chains")
        bad = found[found.outcome.isin(FINDINGS)]
        if len(bad):
            write_table(bad.drop(columns="seconds"), folder, "findings")
        text = summary(table, kills, chains, seconds, largest_gb, options.seed)
        (folder / "interruptions.md").write_text(text, encoding="utf-8")
    print(text)
    print(bad.drop(columns="seconds").to_string(max_colwidth=2000) if len(bad) else "no findings")


def damaged(count: int, seed: int) -> pd.DataFrame:
    """What became of damaged files, a row each."""
    found = outcomes(interrupted.planned(count, seed), program=interrupted.__file__)
    return pd.DataFrame([asdict(one) for one in found])


def killed(count: int, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """So many kills that hit a running sweep, a row each; and the chains of them, a row each."""
    kills: list[Kill] = []
    chains: list[Chain] = []
    rng = np.random.default_rng([seed, 9])
    with tempfile.TemporaryDirectory() as name, small.cut(2):
        place = Path(name)
        # What each process compiles is compiled once.
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(place / "compiled")
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        table = small.run(folder=place / "sound", methods=killed_sweep.METHODS, workers=2)
        sound = small.contents(place / "sound")
        spans = cache(lambda slow_s: _span_s(place / f"whole-{slow_s}", slow_s))
        while len(kills) < count:
            here = place / f"chain-{len(chains)}"
            slow_s = _SLOW_S[int(rng.integers(len(_SLOW_S)))]
            most = min(int(rng.integers(1, _LONGEST + 1)), count - len(kills))
            hits = list(_hits(here, sound, slow_s, most, spans, rng, len(chains)))
            kills += hits
            if not hits:
                continue
            begin = time.perf_counter()
            found = small.run(folder=here, resume=True, methods=killed_sweep.METHODS, workers=2)
            seconds = time.perf_counter() - begin
            chains.append(_ended(len(chains), len(hits), here, found, table, sound, seconds))
    return pd.DataFrame([asdict(one) for one in kills]), pd.DataFrame([asdict(one) for one in chains])


def _span_s(folder: Path, slow_s: float) -> float:
    """Seconds that a sweep takes in a process of its own, once it has begun."""
    begun: list[float] = []

    def noted() -> bool:
        if not begun and killed_sweep.begun_of(folder).exists():
            begun.append(time.perf_counter())
        return False

    # The first one compiles.
    for _ in range(2):
        begun.clear()
        killed_sweep.begun_of(folder).unlink(missing_ok=True)
        for path in folder.glob("*"):
            path.unlink()
        assert ended_after(killed_sweep.program(folder, slow_s=slow_s), noted, 0.0) == 0
        end = time.perf_counter()
    return end - begun[0]


def _hits(
    here: Path, sound: dict[str, bytes], slow_s: float, most: int, spans: Callable[[float], float],
    rng: np.random.Generator, chain: int,
) -> Iterator[Kill]:  # fmt: skip
    """Kills of one sweep, until it was killed so often or ended by itself."""
    program = killed_sweep.program(here, slow_s=slow_s)
    for _ in range(most):
        before = _parts(here)
        killed_sweep.begun_of(here).unlink(missing_ok=True)
        if rng.random() < _ANY_TIME:
            begun, longest = killed_sweep.begun_of(here).exists, spans(slow_s)
        else:

            def begun(before: set[str] = before) -> bool:
                return _parts(here) > before

            longest = (PARTS - len(before)) * (slow_s + 0.01)
        start = time.perf_counter()
        code = ended_after(program, begun, float(rng.uniform(0, longest)))
        if code == 0:
            return
        assert code == -signal.SIGKILL, code
        after = _parts(here)
        left = {path.name: path.stat().st_size for path in here.glob(".*")}
        try:
            whole_parts(here)
            broken = 0
        except BadPart:
            broken = 1
        unlike = sum((here / name).read_bytes() != sound[name] for name in after)
        yield Kill(
            chain=chain, slow_s=slow_s, before=len(before), after=len(after), temporary=len(left),
            half=sum(size < len(sound[_meant(name)]) for name, size in left.items()), lost=len(before - after),
            unlike=max(unlike, broken), seconds=round(time.perf_counter() - start, 2),
        )  # fmt: skip


def _parts(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("part-*.parquet")}


def _meant(temporary: str) -> str:
    """The file that a temporary one was to be."""
    return temporary.removeprefix(".").rpartition(".")[0]


def _ended(
    chain: int, kills: int, here: Path, found: pd.DataFrame, table: pd.DataFrame, sound: dict[str, bytes],
    seconds: float,
) -> Chain:  # fmt: skip
    """What came of a sweep that went on after its kills, held against the uninterrupted one."""
    files = small.contents(here)
    try:
        small.assert_same(found, table)
        other_tables = 0
    except AssertionError:
        other_tables = 1
    other_files = any(files.get(name) != content for name, content in sound.items())
    left = len(files.keys() - sound.keys())
    return Chain(chain, kills, other_tables, int(other_files), left, round(seconds, 2))


def summary(
    table: pd.DataFrame, kills: pd.DataFrame, chains: pd.DataFrame, seconds: float, largest_gb: float, seed: int
) -> str:
    """The study in Markdown."""
    cases, findings = int(table.cases.sum()), int(table.findings.sum())
    bad = chains.other_tables + chains.other_files + chains.leftovers > 0
    lost = int(kills.lost.sum())
    rows = (
        ("kills that hit a running sweep", len(kills), ""),
        ("kills before the first part of a sweep was there", int((kills.after == 0).sum()), len(kills)),
        ("kills between the writing of a file and its place (a temporary file left)", int((kills.temporary > 0).sum()),
         len(kills)),
        ("of these, kills that left a file half written", int((kills.half > 0).sum()), len(kills)),
        ("finished parts that were lost", lost, int(kills.before.sum())),
        ("parts under their name, other than those of the uninterrupted sweep", int(kills.unlike.sum()),
         int(kills.after.sum())),
        ("sweeps that went on to their end", len(chains), ""),
        ("of these, with another table", int(chains.other_tables.sum()), len(chains)),
        ("of these, with another part or record", int(chains.other_files.sum()), len(chains)),
        ("files left over", int(chains.leftovers.sum()), f"{len(chains)} folders"),
    )  # fmt: skip
    lines = [
        "# Runs that are killed, and stored files that are damaged",
        "",
        f"{len(kills):,} kills (SIGKILL) hit {len(chains):,} sweeps of {PARTS} parts, each of which then went on. "
        f"{share(int(bad.sum()), len(chains), 'sweeps', 'ended otherwise than the uninterrupted one')}; "
        f"{share(int((kills.lost + kills.unlike > 0).sum()), len(kills), 'kills', 'cost or changed a part')}.",
        "",
        f"{cases:,} stored files of {table.kind.nunique()} kinds were damaged, each in one of "
        f"{table.mutation.nunique()} ways, before the run went on. "
        f"{share(findings, cases, 'damages', 'led to a finding')}.",
        "",
        f"The longest process that was killed lived {kills.seconds.max():.1f} s, its start and its compilation "
        f"included; to go on after kills took {chains.seconds.max():.1f} s at most, with {largest_gb:.2f} GB of memory "
        f"at most; to go on after a damage took {table.slowest_s.max():.1f} s at most, with "
        f"{table.largest_gb.max():.2f} GB.",
        "",
        "## Kills",
        "",
        "| what | number | of |",
        "|---|---|---|",
        *(f"| {what} | {number:,} | {of if isinstance(of, str) else f'{of:,}'} |" for what, number, of in rows),
        "",
        f"A sweep was killed up to {_LONGEST} times in a row: a quarter of the kills at any time after it began, the "
        "others once a further part was there. In two of three sweeps each file took 0.01 or 0.04 s longer between "
        "its temporary file and its place. Tables are compared to the bit, files to the byte. A kill ends a process, "
        "not the machine: what the system had not yet put on the disk is not tried here. `kills.csv` and "
        "`chains.csv` have a row each.",
        "",
        "## Damaged files",
        "",
        "| what | cases | told | same | refused | findings | slowest [s] | largest [GB] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for key in ("kind", "mutation"):
        lines += total_lines(table, key, ("cases", *ORDER, "findings"))
    lines += [
        "",
        "Told: the result of the run that nothing happened to, to the bit, and a note names the file. Same: that "
        "result without a note, since the record still says what it said. Refused: one sentence that names the file "
        "or its folder. A finding is anything else: another result, with a note or without, a damaged part that "
        "nobody hears of, another exception, a hang (60 s), an end of the process. The files of a finished run are "
        "read when it is asked to go on; nothing is counted then, so that a changed one is refused. "
        "`interruptions.csv` has every kind with every damage.",
        "",
        "Not among the damages, since nothing can tell it: other counts that contradict nothing, with a checksum made "
        "for them.",
        "",
        "Trial rounds had findings of five kinds: a part that is a pipe, a part that names no environment, a record "
        "that is a pipe or a link to itself, a table that is such a link, and files of a finished run that were handed "
        "back with other digits. Each was mended and became a test.",
        "",
        f"One process at a time, {seconds:.0f} s in all; Python {platform.python_version()}. "
        f"Again: `python tests/fuzzing/interruptions.py --kills {len(kills)} --damaged {cases} --seed {seed} "
        "--out FOLDER`.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
