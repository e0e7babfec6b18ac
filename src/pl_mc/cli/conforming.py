"""``pl-mc conform``: reference numbers put before this program or another one."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from pl_mc.cli.printing import Json, Quiet, print_json
from pl_mc.input_errors import InputError
from pl_mc.runtime.kept_programs import keep_programs


def conform(
    *, subject: str = "pl_mc", vectors: Path | None = None, out: Path | None = None, json: Json = False,
    quiet: Quiet = False,
) -> int:  # fmt: skip
    """Compare levels with reference numbers that others computed or published. Exit code 1 where any fails.

    Example: `pl-mc conform --subject "python my_tool.py"`

    Parameters
    ----------
    subject
        `pl_mc`, or a command that answers the task in a folder, its last argument; see the how-to on conformance.
    vectors
        A folder of reference numbers in files of the shipped names, any of them, instead of the shipped ones.
    out
        A CSV file for the table.
    json
        Print the table as JSON.
    quiet
        Print the last line alone.
    """
    keep_programs()
    from pl_mc.conformance import conform as conformed
    from pl_mc.conformance import summary
    from pl_mc.report.files import write_table

    if out is not None and (out.suffix != ".csv" or not out.parent.is_dir()):
        raise InputError(f"--out: {out}: the name of a CSV file in a folder that is there is needed.")
    table = conformed(subject, vectors)
    if out is not None:
        write_table(table, out.parent, out.stem)
    passed = len(table) > 0 and bool(table["passed"].all()) and not table.attrs["notes"]
    if json:
        content = {name: table.attrs[name] for name in ("cases", "notes")}
        # JSON has no infinity, which is how far nothing is from a number.
        sets = table.astype({"deviation": object}).replace({"deviation": {math.inf: None}})
        print_json({"sets": sets.to_dict("records"), "passed": passed} | content)
        return 0 if passed else 1
    for note in table.attrs["notes"]:
        print(f"pl-mc: {note}", file=sys.stderr)
    if not quiet:
        for row in table.itertuples():
            verdict = "passed" if row.passed else "FAILED"
            worst = f"{row.worst} off by {row.deviation:.2g} of {row.tolerance:.2g}"
            print(f"{verdict}  {row.set:44s} {row.cases:5d} cases  {row.remark or worst}")
    print(summary(table))
    return 0 if passed else 1
