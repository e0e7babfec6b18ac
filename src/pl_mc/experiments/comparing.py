"""A comparison of two runs written into a folder: ``compare.html`` and ``compare.csv``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.output import result_folder
from pl_mc.input_errors import InputError
from pl_mc.report.compare_page import comparison_page
from pl_mc.report.comparison import Comparison, compare_runs
from pl_mc.report.files import write_table
from pl_mc.report.run_folder import MANIFEST, RunFolder, read_run_folder

PAGE = "compare.html"


@dataclass(frozen=True)
class Compared:
    """A comparison that is written.

    Attributes:
        folder: where it is.
        comparison: what it says.
    """

    folder: Path
    comparison: Comparison

    def content(self) -> dict[str, Any]:
        """The comparison for programs."""
        found = self.comparison
        rates = found.rates.astype(object).where(found.rates.notna(), None)
        return {
            "folder": str(self.folder),
            "report": PAGE,
            "names": list(found.names),
            "same_noise": found.same_noise,
            "verdict": found.verdict,
            "fields": found.fields.to_dict("records"),
            "rates": rates.to_dict("records"),
            "notes": list(found.notes),
        }


def write_comparison(first: Path, second: Path, out: Path | None = None) -> Compared:
    """Compare two runs and write the page and the table.

    Args:
        first, second: their results folders; differences are second minus first.
        out: the folder; ``runs/compare-FIRST-SECOND`` unless given. An earlier comparison there is replaced.

    Raises:
        InputError: folders without a finished run, runs of different kinds, or a place that cannot be written to.
    """
    runs = _completed(read_run_folder(first)), _completed(read_run_folder(second))
    found = compare_runs(*runs)
    names = [run.folder.absolute().name for run in runs]
    folder = Path("runs") / f"compare-{names[0]}-{names[1]}" if out is None else Path(out)
    with result_folder(folder, sign=PAGE) as working:
        write_table(found.rates, working, "compare")
        (working / PAGE).write_text(comparison_page(*runs, found), encoding="utf-8")
    return Compared(folder, found)


def _completed(run: RunFolder) -> RunFolder:
    """The run with the defaults of fields that its version did not have yet."""
    try:
        record = build_experiment(run.experiment, source=MANIFEST)
    except InputError:
        return run
    return replace(run, experiment=record.model_dump(mode="json"))
