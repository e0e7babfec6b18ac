"""A progress bar on standard error, advanced by the host once per call (adapter of rich)."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


@contextlib.contextmanager
def progress_bar(*, total: int, what: str, show: bool | None) -> Iterator[Callable[[], None]]:
    """A function that advances the bar by one; ``show`` None shows it where standard error is a terminal."""
    if not (sys.stderr.isatty() if show is None else show):
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """Steps a second, once two are done."""

        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.3g}/s" if task.speed else "-/s")

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)


def with_progress(items: Iterable[Item], *, total: int, what: str, show: bool | None) -> Iterator[Item]:
    """Pass items through, and advance a bar by one for each."""
    with progress_bar(total=total, what=what, show=show) as advance:
        for item in items:
            yield item
            advance()
