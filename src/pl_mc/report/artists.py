"""Our own among the artists of matplotlib, which is loaded with this file: where something is drawn, not before."""

from __future__ import annotations

import re
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation

# Labels of logarithmic axes as matplotlib makes them: a factor, if any, and an exponent.
_POWER = re.compile(r"^\$\\mathdefault\{(?:(\S+)\\times ?)?10\^\{([-0-9]+)\}\}\$$")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Sheet(Figure):
    """A figure that is completed at a width of its own, see `pl_mc.report.print_layout.finish`.

    Attributes:
        keys: what stands in the legend below all panels, by name.
        named_like: panels that begin another line, each with the one whose name of the vertical axis is theirs too.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.keys: dict[str, Any] = {}
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
            return (f"{found[1]} × " if found[1] else "") + "10" + found[2].translate(_RAISED)

        return _POWER.sub(plain, super().__call__(x, pos))
