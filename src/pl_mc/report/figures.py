"""Figures: one look for all, legible in grey, saved as PNG and SVG with no clock or random name in the file."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.alert import EITHER, VERTICAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from PIL.Image import Image

_LOOK: Any = {
    "svg.hashsalt": "pl_mc",
    "svg.fonttype": "none",
    # Titles and names are texts of users and data; a dollar in them is a dollar.
    "text.parse_math": False,
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.5,
}


@dataclass(frozen=True)
class SeriesStyle:
    """How one method is drawn: a colour, and a line and marker that tell it apart in grey."""

    colour: str
    line: str
    marker: str

    @property
    def look(self) -> dict[str, Any]:
        """The options of a line in this style."""
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker}


# Okabe and Ito's colours, ordered so that neighbours differ in lightness too.
_STYLES = (
    SeriesStyle("#0072B2", "-", "o"),
    SeriesStyle("#D55E00", "--", "s"),
    SeriesStyle("#009E73", "-.", "^"),
    SeriesStyle("#CC79A7", ":", "D"),
    SeriesStyle("#56B4E9", "-", "v"),
    SeriesStyle("#E69F00", "--", "P"),
)

# Lines at values to compare with, thinner than any limit.
DOTTED: Any = {"color": "0.15", "linewidth": 1.0, "linestyle": ":", "zorder": 1.5}

# The line at a limit.
DASHED: Any = {"color": "0.15", "linewidth": 1.2, "linestyle": (0, (6, 2)), "zorder": 1.5}

_LABELS = {"ls": "least squares (VPL)", "igg3": "IGG-III (VPL_R)"}


_Arguments = ParamSpec("_Arguments")


def in_common_look(make: Callable[_Arguments, Figure]) -> Callable[_Arguments, Figure]:
    """Decorator of a function that draws a figure: titles, legends and grids in the common look.

    Where it cannot be drawn, whatever the reason, an `Undrawn` one stands for it: numbers that were counted for hours
    are worth more than their picture.
    """

    @functools.wraps(make)
    def wrapped(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> Figure:
        import matplotlib as mpl

        from pl_mc.report.artists import Undrawn

        with mpl.rc_context(_LOOK):
            try:
                return make(*args, **kwargs)
            except Exception as error:
                return Undrawn(_why(error))

    return wrapped


def series_style(index: int, further: Sequence[SeriesStyle] = ()) -> SeriesStyle:
    """The style of the method in that place of a list; ``further`` styles come behind the six common ones."""
    styles = (*_STYLES, *further)
    return styles[index % len(styles)]


def method_label(name: str, axis: str = VERTICAL) -> str:
    """A method's name in a legend, with that of its level on an axis; without it where both levels decide."""
    label = _LABELS.get(name, name)
    return label.split(" (")[0] if axis == EITHER else label if axis == VERTICAL else label.replace("(VPL", "(HPL")


def short_label(name: str) -> str:
    """A method's name in a legend, without that of its level."""
    return method_label(name, EITHER)


def new_figure(
    rows: int, columns: int, *, width_in: float, height_in: float, title: str | None = None, **options: Any
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row; call it inside a function that is `in_common_look`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    if title is not None:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure, list(axes.flat)


def bar_lengths(value: ArrayLike, low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """Lengths of interval bars below and above a value, as ``errorbar`` takes them; none below zero by rounding."""
    middle, lowest, highest = (np.asarray(part, dtype=np.float64) for part in (value, low, high))
    return np.maximum(np.vstack([middle - lowest, highest - middle]), 0.0)


def note(axes: Axes, text: str, at: tuple[Any, Any], *, shift: tuple[float, float], **options: Any) -> None:
    """A small text beside a point, shifted by so many dots of print; options are those of ``annotate``."""
    axes.annotate(text, at, xytext=shift, textcoords="offset points", **{"fontsize": 8, **options})


def legend_key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that no drawn line has."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **look)


def legend_below(
    figure: Figure, panels: Iterable[Axes], *, columns: int, side: Literal["left", "center"] = "left"
) -> None:
    """One legend below all panels, each name once."""
    handles = {
        label: handle for panel in panels for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    place: Any = f"outside lower {side}"
    figure.legend(list(handles.values()), list(handles), loc=place, ncols=columns)


def limit_line(axes: Axes, value: float, label: str, *, width: float = 1.2, **options: Any) -> None:
    """A horizontal line at a limit, named where it is drawn; options are those of the name."""
    axes.axhline(value, **DASHED | {"linewidth": width})
    look: Any = {"shift": (0, 2), "ha": "right", "va": "bottom", "fontsize": 8.5, "color": "0.15"}
    note(axes, label, (0.995, value), xycoords=("axes fraction", "data"), **look | options)


def shade(axes: Axes, windows: Sequence[tuple[float, float]], label: str | None = None) -> None:
    """Shade windows of the horizontal axis, such as those with a fault."""
    for k, (start, stop) in enumerate(windows):
        axes.axvspan(start, stop, color="0.85", linewidth=0, zorder=0.5, label=label if k == 0 else None)


def save_figure(figure: Figure, folder: Path, name: str) -> str:
    """``name.svg``, and ``name.png`` in 256 colours: a third of the bytes, and the eye sees no difference.

    Returns:
        Why the figure could not be drawn and nothing was written; empty where it was.
    """
    from pl_mc.report.artists import Undrawn

    if isinstance(figure, Undrawn):
        return figure.reason
    try:
        _save(figure, folder, name)
    except OSError:
        raise
    except Exception as error:
        for ending in ("svg", "png"):
            (folder / f"{name}.{ending}").unlink(missing_ok=True)
        return _why(error)
    return ""


def _why(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200].rstrip('.')}"


def _save(figure: Figure, folder: Path, name: str) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.ticker import LogFormatter
    from PIL.Image import fromarray

    from pl_mc.report.artists import Powers

    with mpl.rc_context(_LOOK):
        for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
            if isinstance(axis.get_major_formatter(), LogFormatter):
                axis.set_major_formatter(Powers())
            if isinstance(axis.get_minor_formatter(), LogFormatter):
                axis.set_minor_formatter(Powers(labelOnlyBase=False))
        # Laid out and drawn once for both; what saves a figure lays it out and draws it twice for each.
        figure.set_dpi(150)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        image = fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        figure.set_layout_engine("none")
        # Colours are counted and bytes are packed outside Python, while it writes the other file.
        with ThreadPoolExecutor(1) as beside:
            packed = beside.submit(_save_png, image, folder / f"{name}.png")
            FigureCanvasSVG(figure).print_svg(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
        packed.result()


def _save_png(image: Image, place: Path) -> None:
    from PIL.Image import Dither

    few = image.quantize(256, dither=Dither.NONE)
    few.save(place, optimize=True, dpi=(150, 150))
