"""Our own among the artists of matplotlib, which is loaded with this file: where something is drawn, not before."""

from __future__ import annotations

import re
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogFormatterSciNotation

from pl_mc.report.look import RAISED

# Labels of logarithmic axes as matplotlib makes them: a factor, if any, and an exponent.
_POWER = re.compile(r"^\$\\mathdefault\{(?:(\S+)\\times ?)?10\^\{([-0-9]+)\}\}\$$")


class Sheet(Figure):
    """A figure that is completed at a width of its own, see `pl_mc.report.print_layout.finish`.

    Attributes:
        keys: what stands in the legend below all panels, by name.
        rows, least_in: of panels below each other, and how high each has to be at least [in].
        panels: the panels, each with its height as a share of the mean one.
        named_like: panels that begin another line, each with the one whose name of the vertical axis is theirs too.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.keys: dict[str, Any] = {}
        self.rows, self.least_in = 1, 0.0
        self.panels: list[tuple[Axes, float]] = []
        self.named_like: list[tuple[Axes, Axes]] = []


class Undrawn(Figure):
    """What stands for a figure that could not be drawn, which costs that figure alone.

    Args:
        reason: why, within a sentence.
    """

    def __init__(self, reason: str) -> None:
        super().__init__()
        self.reason = reason


class Powers(LogFormatterSciNotation):
    """Powers of ten in raised digits: nothing on a figure is parsed as mathematics, the names of users least of all."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        def plain(found: re.Match[str]) -> str:
            return (f"{found[1]} × " if found[1] else "") + "10" + found[2].translate(RAISED)

        return _POWER.sub(plain, super().__call__(x, pos))


def label_powers(figure: Figure) -> None:
    """Give logarithmic axes labels such as 10⁻³."""
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), LogFormatter):
            axis.set_major_formatter(Powers())
        if isinstance(axis.get_minor_formatter(), LogFormatter):
            axis.set_minor_formatter(Powers(labelOnlyBase=False))
