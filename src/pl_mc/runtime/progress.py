"""A progress bar on standard error, advanced by the host once per call (adapter of rich)."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from pl_mc.input_errors import require_truth

Item = TypeVar("Item")


@contextlib.contextmanager
def progress_bar(
    *, total: int, what: str, show: bool | None, each: float = 1.0, unit: str = ""
) -> Iterator[Callable[[], None]]:
    """A function that advances the bar by one.

    Args:
        total: steps in all.
        what: what goes on.
        show: whether to show it; where standard error is a terminal if None.
        each, unit: what a step does, about, for the rate: so many scenarios, say.
    """
    if show is not None:
        require_truth(show, field="progress")
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
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """Steps, or what they do, a second, once two are done."""

        def render(self, task: Task) -> Text:
            return Text(rate_text(None if task.speed is None else each * task.speed, unit))

    class Left(ProgressColumn):
        """The time that is left, once it is known."""

        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            return Text("" if task.time_remaining is None else f"{duration_text(task.time_remaining)} left")

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate(), TimeElapsedColumn(), Left(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)


def duration_text(seconds: float) -> str:
    """A length of time in the unit that people would take: seconds, minutes, hours or days."""
    for size, below, unit, form in ((1, 90, "s", ".0f"), (60, 90, "min", ".2g"), (3600, 48, "h", ".1f")):
        if seconds < below * size:
            return f"{max(1.0 if unit == 's' else 0.0, seconds / size):{form}} {unit}"
    days = seconds / 86_400
    return f"{days:.1f} days" if days < 100 else f"{days:,.0f} days"


def rate_text(rate: float | None, unit: str) -> str:
    """A rate for people, ``2.1M scenarios/s``; a dash while it is not known."""
    ends = f" {unit}/s" if unit else "/s"
    if not rate:
        return f"-{ends}"
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if rate >= size:
            return f"{rate / size:.3g}{letter}{ends}"
    return f"{rate:.3g}{ends}"


def with_progress(items: Iterable[Item], *, total: int, what: str, show: bool | None) -> Iterator[Item]:
    """Pass items through, and advance a bar by one for each."""
    with progress_bar(total=total, what=what, show=show) as advance:
        for item in items:
            yield item
            advance()
