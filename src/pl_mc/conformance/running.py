"""Reference numbers put before a subject, one task after the other, and how far its answers are from them."""

from __future__ import annotations

import json
import shlex
import subprocess
import tempfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import pandas as pd

from pl_mc.conformance.araim_files import documents, maast_v3, maast_v42, orbits
from pl_mc.conformance.closed_forms import closed_forms
from pl_mc.conformance.other_files import five_satellites, rtklib, sbas
from pl_mc.conformance.row_set import Folder, RowSet, deviations
from pl_mc.conformance.subject import answer
from pl_mc.input_errors import InputError, require_path, system_reason

OWN = "pl_mc"
# A command that cannot answer a kind of task says so by this exit code.
DECLINED = 77
# The longest that a command may take over one task [s].
_LONGEST_S = 600.0


def conform(subject: str = OWN, vectors: str | Path | None = None) -> pd.DataFrame:
    """How far a subject's answers are from reference numbers.

    Args:
        subject: ``pl_mc``, or a command that is called with a folder as its last argument. In it stand ``task.json``
            and the tables that belong to it, and the command writes ``answers.csv`` there; by exit code 77 it says
            that it does not do such a task. docs/how-to/conformance.md has the columns.
        vectors: a folder with files of the names that pl_mc ships, any of them; the shipped ones, and those by
            closed form, unless given.

    Returns:
        One row per set of numbers: ``set``, ``file``, ``source``, ``cases`` (rows of the file), ``numbers``, ``worst``
        (the column of the worst), its ``deviation`` and ``tolerance``, ``passed``, and ``remark``, why there is no
        answer. Its ``attrs`` have ``cases``, rows checked by file, and ``notes``.

    Raises:
        InputError: a folder that is none, files that are no such tables, a command that cannot be started.
    """
    with resources.as_file(resources.files("pl_mc.conformance") / "vectors") as shipped:
        place = shipped if vectors is None else require_path(vectors, field="vectors")
        if not place.is_dir():
            raise InputError(f"vectors: {place}: there is no such folder.")
        folder = Folder(place)
        rows, checked = [], dict[str, set[int]]()
        for row_set in _row_sets(folder, own=vectors is None):
            found, remark = _answers(row_set, subject)
            off = deviations(row_set, found)
            if off.empty:
                continue
            worst = off.loc[off["ratio"].idxmax()]
            checked.setdefault(row_set.file, set()).update(off["row"].tolist())
            rows.append(
                {
                    "set": row_set.name, "file": row_set.file, "source": row_set.source,
                    "cases": int(off["row"].nunique()), "numbers": len(off), "worst": worst["column"],
                    "deviation": worst["deviation"], "tolerance": worst["tolerance"],
                    "passed": bool((off["ratio"] <= 1.0).all()), "remark": remark,
                }
            )  # fmt: skip
    columns = ["set", "file", "source", "cases", "numbers", "worst", "deviation", "tolerance", "passed", "remark"]
    table = pd.DataFrame(rows, columns=columns)
    for file, number in folder.rows.items():
        if left := number - len(checked.get(file, ())):
            folder.lacks.append(f"{file}: {left} of {number} rows are not checked; what they belong to is not known.")
    table.attrs["cases"] = {file: len(places) for file, places in checked.items()}
    table.attrs["notes"] = tuple(folder.lacks)
    return table


def summary(table: pd.DataFrame) -> str:
    """The last line: whether all passed, and rows checked by file."""
    failed = int((~table["passed"].astype(bool)).sum())
    by_file = ", ".join(f"{file} {number}" for file, number in table.attrs["cases"].items())
    if table.empty:
        return "Nothing was checked: there is no reference number."
    verdict = f"All {len(table)} sets passed" if not failed else f"{failed} of {len(table)} sets failed"
    return f"{verdict}; cases by file: {by_file}."


def _row_sets(folder: Folder, *, own: bool) -> Iterator[RowSet]:
    for kind in (documents, maast_v3, orbits, maast_v42, five_satellites, sbas, rtklib):
        yield from kind(folder)
    if own:
        yield from closed_forms(folder)


def _answers(row_set: RowSet, subject: str) -> tuple[pd.DataFrame, str]:
    """What a subject answers, and a remark where it does not."""
    if subject == OWN:
        return answer(row_set.task, row_set.tables), ""
    nothing = pd.DataFrame({key: [] for key in row_set.keys})
    with tempfile.TemporaryDirectory(prefix="pl-mc-conform-") as made:
        place = Path(made)
        (place / "task.json").write_text(json.dumps(row_set.task, indent=2), encoding="utf-8")
        for name, table in row_set.tables.items():
            table.to_csv(place / f"{name}.csv", index=False)
        try:
            done = subprocess.run([*shlex.split(subject), str(place)], timeout=_LONGEST_S, check=False)
        except (OSError, ValueError) as error:
            reason = system_reason(error) if isinstance(error, OSError) else str(error)
            raise InputError(f"subject: {subject}: the command cannot be started ({reason}).") from None
        except subprocess.TimeoutExpired:
            return nothing, f"no answer within {_LONGEST_S:g} s"
        if done.returncode == DECLINED:
            return nothing, "declined"
        if done.returncode:
            return nothing, f"exit code {done.returncode}"
        path = place / "answers.csv"
        try:
            found = pd.read_csv(path)
        except (OSError, ValueError) as error:
            return nothing, f"answers.csv cannot be read ({str(error).splitlines()[0]})"
    missing = [key for key in row_set.keys if key not in found]
    return (nothing, f"answers.csv lacks the column {missing[0]}") if missing else (found, "")
