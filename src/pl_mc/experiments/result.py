"""What a finished run hands back: a summary for the screen and for ``summary.md``, and where the files are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    Attributes:
        folder: the results.
        summary: one screen of text in Markdown.
        notes: sentences about what was left out or chosen.
        answer: the answer in three sentences; none for a share of a run.
        page: name of the page in the folder; empty for a share.
    """

    folder: Path
    summary: str
    notes: tuple[str, ...]
    answer: tuple[str, ...] = ()
    page: str = ""
