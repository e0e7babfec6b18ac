"""What commands print: text for people, JSON for programs, or one line. Results go to standard output alone."""

from __future__ import annotations

import json
from typing import Annotated, Any

from cyclopts import Parameter

from pl_mc.experiments.result import RunResult

Json = Annotated[bool, Parameter(negative="")]
Quiet = Annotated[bool, Parameter(negative="", alias="-q")]
Flag = Annotated[bool, Parameter(negative="")]


def print_json(content: Any) -> None:
    """One JSON document."""
    print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False, default=str))


def print_result(result: RunResult, *, as_json: bool, quiet: bool) -> None:
    """A finished run: the summary and the folder; as JSON; or the folder alone."""
    if as_json:
        print_json(result_content(result))
    elif quiet:
        print(result.folder)
    else:
        print(result.summary)
        page = f", report: {result.folder / result.page}" if result.page else ""
        print(f"Results: {result.folder}{page}")


def result_content(result: RunResult) -> dict[str, Any]:
    """A finished run for programs: its folder, the files in it, the answer and the notes."""
    files = sorted(path.name for path in result.folder.iterdir() if path.is_file())
    return {
        "folder": str(result.folder),
        "report": result.page,
        "tables": [name for name in files if name.endswith((".csv", ".parquet"))],
        "figures": [name for name in files if name.endswith((".png", ".svg"))],
        "answer": list(result.answer),
        "notes": list(result.notes),
    }
