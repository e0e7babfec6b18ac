"""Thousands of damaged files and strange arguments, what became of each, and a table and a figure of it.

``python tests/fuzzing/study.py --count 15000 --out results/fuzz``; one process reads all of them, on one core.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parent))

from api_calls import calls
from matplotlib.figure import Figure
from mutations import MUTATIONS
from outcomes import FINDINGS, STRANGE_ARGUMENTS, Case, cases, outcomes
from subjects import subjects

from pl_mc.experiments.output import result_folder
from pl_mc.report.figures import in_common_look, new_figure, save_figure
from pl_mc.report.files import write_table
from pl_mc.statistics.intervals import clopper_pearson

SIGN = "fuzz.csv"

# Kinds of outcome, in the order of the table, with what they are called in the figure.
ORDER = ("refused", "same", "told", "well formed", "accepted")
COLOURS = {
    "refused": ("0.80", "refused in a sentence"),
    "same": ("#56B4E9", "same numbers as the sound file"),
    "told": ("#009E73", "other numbers, told in a note"),
    "well formed": ("#E69F00", "other numbers in a well-formed file"),
    "accepted": ("#0072B2", "accepted, nothing to compare"),
    "findings": ("#D55E00", "finding"),
}

# Of each kind, the seconds of the slowest case and the memory of the largest.
MOST = ("slowest_s", "largest_gb")

# Of all cases, the share that are calls instead of files.
CALLS = 1 / 3


def main() -> None:
    """Run the study and write ``fuzz.csv``, ``examples.csv``, ``findings.csv`` if any, a figure and a summary."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=15_000)
    parser.add_argument("--seed", type=int, default=1, help="other seeds damage otherwise; the tests have 0")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    begin = time.perf_counter()
    wanted = planned(options.count, options.seed)
    found = pd.DataFrame([asdict(one) for one in outcomes(wanted)])
    seconds = time.perf_counter() - begin
    # Of the processes that read the cases, those that ended included; kilobytes where this runs.
    largest_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    with result_folder(options.out, sign=SIGN) as folder:
        table = counted(found)
        write_table(table, folder, SIGN.removesuffix(".csv"))
        write_table(examples(found), folder, "examples")
        bad = found[found.outcome.isin(FINDINGS)]
        if len(bad):
            write_table(bad.drop(columns="seconds"), folder, "findings")
        save_figure(figure(table), folder, "fuzz")
        text = summary(table, seconds, found.seconds.max(), largest_gb, options.seed)
        (folder / "summary.md").write_text(text, encoding="utf-8")
    print(text)
    print(json.dumps(bad.drop(columns="seconds").to_dict("records"), indent=1)[:20_000])


def planned(count: int, seed: int) -> list[Case]:
    """Files of every kind with every mutation in turn, then calls of every function in turn."""
    first = seed * 1_000_000
    called = round(CALLS * count)
    names = list(calls())
    strange = [Case(names[k % len(names)], STRANGE_ARGUMENTS, k // len(names)) for k in range(called)]
    planned = cases(list(subjects()), MUTATIONS, count - called) + strange
    return [replace(case, number=first + case.number) for case in planned]


def counted(found: pd.DataFrame, order: Sequence[str] = ORDER, findings: Sequence[str] = FINDINGS) -> pd.DataFrame:
    """Number of cases by kind and mutation, of each outcome, of findings, and what the slowest and largest took."""
    found = found.assign(kind=found.subject.where(found.mutation != STRANGE_ARGUMENTS, "call of " + found.subject))
    table = (
        found.groupby(["kind", "mutation"], sort=False)
        .outcome.value_counts()
        .unstack(fill_value=0)
        .reindex(columns=[*order, *findings], fill_value=0)
    )
    table.insert(0, "cases", table.sum(axis=1))
    table["findings"] = table[list(findings)].sum(axis=1)
    most = found.groupby(["kind", "mutation"], sort=False)[["seconds", "peak_gb"]].max().round(2)
    table[list(MOST)] = most.reindex(table.index)
    table.columns = [str(name).replace(" ", "_") for name in table.columns]
    return table.reset_index()


def examples(found: pd.DataFrame) -> pd.DataFrame:
    """The first sentence of a refusal of every kind with every mutation, without the folder of the file."""
    refused = found[found.outcome == "refused"].drop_duplicates(["subject", "mutation"])
    sentence = refused.detail.str.split("\n").str[0].str.replace(r"(?:/[^/ ]+)+/", "", regex=True).str[:300]
    return refused[["subject", "mutation", "number"]].assign(sentence=sentence)


@in_common_look
def figure(table: pd.DataFrame) -> Figure:
    """Shares of the outcomes, by kind of file and by mutation."""
    made, axes = new_figure(1, 2, width_in=10.5, height_in=5.2)
    files = table[table.mutation != STRANGE_ARGUMENTS]
    one = pd.concat([files, table[table.mutation == STRANGE_ARGUMENTS].assign(kind="calls of functions")])
    for axis, key, rows, title in (
        (axes[0], "kind", one, "By what was damaged"),
        (axes[1], "mutation", files, "By damage (files alone)"),
    ):
        totals = rows.groupby(key, sort=False).sum(numeric_only=True)
        left = pd.Series(0.0, index=totals.index)
        for name, (colour, label) in COLOURS.items():
            share = 100 * totals[name.replace(" ", "_")] / totals.cases
            axis.barh(totals.index, share, left=left, color=colour, label=label, height=0.72)
            left += share
        axis.invert_yaxis()
        axis.set_xlim(0, 100)
        axis.set_xlabel("share of the cases [%]")
        axis.set_title(title)
        axis.grid(axis="y", visible=False)
    made.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return made


def total_lines(table: pd.DataFrame, key: str, columns: Sequence[str]) -> list[str]:
    """Rows of a table in Markdown: the sums of columns for each kind, say, and the most time and memory."""
    totals = table.groupby(key, sort=False)[list(columns)].sum()
    most = table.groupby(key, sort=False)[list(MOST)].max()
    return [
        f"| {name} | " + " | ".join(f"{number:,}" for number in row) + f" | {seconds:.2f} | {gb:.2f} |"
        for name, row, (seconds, gb) in zip(totals.index, totals.to_numpy(), most.to_numpy(), strict=True)
    ]


def share(events: int, number: int, what: str, came: str) -> str:
    """How many of what came to something, and how many do at the most."""
    high = 100 * float(clopper_pearson(events, number)[1])
    return f"{events} of {number:,} {what} {came} (at most {high:.2g} %, 95 %)"


def summary(table: pd.DataFrame, seconds: float, slowest_s: float, largest_gb: float, seed: int) -> str:
    """The study in Markdown."""
    total, findings = int(table.cases.sum()), int(table.findings.sum())
    files = table[table.mutation != STRANGE_ARGUMENTS]
    shown = pd.concat([files, table[table.mutation == STRANGE_ARGUMENTS].assign(kind="calls of functions")])
    calls_made = total - int(files.cases.sum())
    lines = [
        "# Damaged files and strange arguments",
        "",
        f"{total:,} cases: {total - calls_made:,} files of {files.kind.nunique()} kinds, each damaged in one of "
        f"{files.mutation.nunique()} ways, and {calls_made:,} calls of functions with arguments that make no "
        f"sense. {share(findings, total, 'cases', 'led to a finding')}. The slowest took {slowest_s:.1f} s, and "
        f"no process ever held more than {largest_gb:.2f} GB.",
        "",
        "A finding is an exception other than `InputError`, a refusal that is no sentence, a hang (60 s), an end "
        "of the process, or numbers other than those of the sound file (a pseudorange error by over 1 m, an orbit "
        "by over 100 km, a position by over 1 m, one more or less of either) without a note, although the form of "
        "the file shows the damage.",
        "",
        "| what | cases | refused | same | told | well formed | accepted | findings | slowest [s] | largest [GB] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    columns = ("cases", "refused", "same", "told", "well_formed", "accepted", "findings")
    for key, rows in (("kind", shown), ("mutation", files)):
        lines += total_lines(rows, key, columns)
    lines += [
        "",
        "Same: all numbers as of the sound file. Told: other numbers, and a note says what was left out or is odd. "
        "Well formed: other numbers, but as well formed as the sound file (other digits, another number, a value "
        "missing, a shorter table), so that nobody who has not seen the sound one can tell. Accepted: an "
        "experiment or a call says what its author wants; there is nothing to compare with. `fuzz.csv` has every "
        "kind with every damage, `examples.csv` the first refusal of each.",
        "",
        "Earlier rounds had up to eighteen findings; each was mended and became a test. The bound above is of this "
        "round alone; another seed may find one more." + " Those of this round are in `findings.csv`." * (findings > 0),
        "",
        "`interruptions.md` is of runs that were killed and of stored files that were damaged before a run went on.",
        "",
        f"One process on one core, {seconds:.0f} s in all; memory is that of the process that reads thousands of "
        f"cases, one after the other, while it read this one; Python {platform.python_version()}. Again: "
        f"`python tests/fuzzing/study.py --count {total} --seed {seed} --out FOLDER`.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
