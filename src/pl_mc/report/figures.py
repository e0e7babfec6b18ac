"""Figures: one look for all, legible in grey, saved as PNG, SVG and PDF with no clock or random name in the file."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.alert import EITHER, VERTICAL
from pl_mc.input_errors import InputError
from pl_mc.report.look import PANEL_MM, RAISED, look_now

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from PIL.Image import Image

# Lines at values to compare with, thinner than any limit.
DOTTED: Any = {"color": "0.15", "linewidth": 1.0, "linestyle": ":", "zorder": 1.5}

# The line at a limit.
DASHED: Any = {"color": "0.15", "linewidth": 1.2, "linestyle": (0, (6, 2)), "zorder": 1.5}

_LABELS = {"ls": "least squares (VPL)", "igg3": "IGG-III (VPL_R)"}

# Dots an inch of pictures: for a screen, and in print.
_DPI, _PRINT_DPI = 150, 300

# From a panel to what stands below the name of its axis [in].
_BELOW_IN = 0.5

_Arguments = ParamSpec("_Arguments")


def in_common_look(make: Callable[_Arguments, Figure]) -> Callable[_Arguments, Figure]:
    """Decorator of a function that draws a figure: in the look that is asked for, see `pl_mc.report.look.drawn_in`.

    Where it cannot be drawn, whatever the reason, an `Undrawn` one stands for it: numbers that were counted for hours
    are worth more than their picture.
    """

    @functools.wraps(make)
    def wrapped(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> Figure:
        import matplotlib as mpl

        from pl_mc.report.artists import Sheet, Undrawn, label_powers
        from pl_mc.report.print_layout import finish

        with mpl.rc_context(look_now().settings):
            try:
                figure = make(*args, **kwargs)
                label_powers(figure)
                if isinstance(figure, Sheet) and look_now().width_in is not None:
                    finish(figure)
                return figure
            except Exception as error:
                return Undrawn(_why(error))

    return wrapped


def method_label(name: str, axis: str = VERTICAL) -> str:
    """A method's name in a legend, with that of its level on an axis; without it where both levels decide."""
    label = _LABELS.get(name, name)
    return label.split(" (")[0] if axis == EITHER else label if axis == VERTICAL else label.replace("(VPL", "(HPL")


def short_label(name: str) -> str:
    """A method's name in a legend, without that of its level."""
    return method_label(name, EITHER)


def new_figure(
    rows: int, columns: int, *, width_in: float, height_in: float, title: str | None = None, lines_in: float = 0.0,
    labels_in: float = 0.0, panel_mm: float = PANEL_MM, **options: Any,
) -> tuple[Figure, list[Axes]]:  # fmt: skip
    """A figure and its axes, row by row; call it inside a function that is `in_common_look`.

    At a width that is asked for columns that find no room go below the others, and heights follow.

    Args:
        rows, columns: of panels.
        width_in, height_in: on a screen [in].
        title: heading on a screen.
        lines_in: height of the lines of text that a panel stands beside, which is kept; none of a panel of curves [in].
        labels_in: width of their names, for which room is left beside the panels [in].
        panel_mm: how narrow a panel may get, with its own labels [mm].
        options: those of ``subplots``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from pl_mc.report.artists import Sheet
    from pl_mc.report.print_layout import laid_out

    look = look_now()
    figure = Sheet(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    if look.width_in is None:
        axes = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    else:
        axes = laid_out(
            figure, rows, columns, look=look, lines_in=lines_in, labels_in=labels_in, panel_mm=panel_mm, **options
        )
    if title is not None and not look.is_print:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, wrap=look.width_in is not None)
    return figure, axes


def columns_that_fit(columns: int, labels_in: float = 0.0, panel_mm: float = PANEL_MM) -> int:
    """How many panels, of at most so many, stand side by side in the look that is asked for, as in `new_figure`."""
    return look_now().columns_that_fit(columns, labels_in, panel_mm)


def power_text(value: float) -> str:
    """A small number as axes have it: 10⁻⁷, 2 × 10⁻⁷."""
    factor, _, exponent = f"{value:.2e}".partition("e")
    power = "10" + str(int(exponent)).translate(RAISED)
    return power if float(factor) == 1.0 else f"{float(factor):g} × {power}"


def widest_in(labels: Iterable[str], size: float = 9.5) -> float:
    """About how wide the longest line of some labels is in letters of a size in points [in]."""
    return max((len(line) for label in labels for line in label.splitlines()), default=0) * 0.58 * size / 72.0


def bar_lengths(value: ArrayLike, low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """Lengths of interval bars below and above a value, as ``errorbar`` takes them; none below zero by rounding."""
    middle, lowest, highest = (np.asarray(part, dtype=np.float64) for part in (value, low, high))
    return np.maximum(np.vstack([middle - lowest, highest - middle]), 0.0)


def note(axes: Axes, text: str, at: tuple[Any, Any], *, shift: tuple[float, float], **options: Any) -> None:
    """A small text beside a point, shifted by so many dots of print; options are those of ``annotate``."""
    made = axes.annotate(text, at, xytext=shift, textcoords="offset points", **{"fontsize": 8, **options})
    # Panels are narrow in print: what is beside a point takes nothing of them.
    made.set_in_layout(look_now().width_in is None)


def legend_key(label: str, **look: Any) -> Line2D:
    """An entry of a legend that no drawn line has."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **look)


def legend_in(panel: Axes, **options: Any) -> None:
    """The legend of a panel; options are those of ``legend``. In print it stands below all panels."""
    if look_now().width_in is None:
        panel.legend(**options)
    else:
        _below(panel.get_figure(root=True), [panel])


def legend_under(panel: Axes, keys: Sequence[Any], **options: Any) -> None:
    """A legend of a panel's own below the name of its axis, whatever the size of the panel."""
    from matplotlib.transforms import ScaledTranslation

    figure = panel.get_figure(root=True)
    assert figure is not None
    below = panel.transAxes + ScaledTranslation(0.0, -_BELOW_IN, figure.dpi_scale_trans)
    look: Any = {"bbox_to_anchor": (0.0, 0.0), "bbox_transform": below, "borderaxespad": 0.0, "borderpad": 0.0}
    panel.legend(handles=keys, loc="upper left", **look | options)


def legend_below(
    figure: Figure,
    panels: Iterable[Axes] = (),
    *,
    columns: int,
    side: Literal["left", "center"] = "left",
    keys: Sequence[Any] = (),
    **options: Any,
) -> None:
    """One legend below all panels, each name of them once, or of ``keys``; options are those of ``legend``."""
    handles = _handles(panels) | {key.get_label(): key for key in keys}
    if look_now().width_in is None:
        place: Any = f"outside lower {side}"
        figure.legend(list(handles.values()), list(handles), loc=place, ncols=columns, **options)
    else:
        _below(figure, panels, keys)


def _handles(panels: Iterable[Axes]) -> dict[str, Any]:
    return {label: handle for panel in panels for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}


def _below(figure: Any, panels: Iterable[Axes], keys: Sequence[Any] = ()) -> None:
    """Keep what stands below all panels when the figure is complete."""
    found = _handles(panels) | {key.get_label(): key for key in keys}
    figure.keys |= {label: handle for label, handle in found.items() if label not in figure.keys}


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
    """The files of a figure that the look asks for.

    ``name.png`` has 256 colours: a third of the bytes, and the eye sees no difference.

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
        for ending in look_now().endings:
            (folder / f"{name}.{ending}").unlink(missing_ok=True)
        return _why(error)
    return ""


def _why(error: Exception) -> str:
    if isinstance(error, InputError):
        return str(error).rstrip(".")
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200].rstrip('.')}"


def _save(figure: Figure, folder: Path, name: str) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from PIL.Image import fromarray

    look = look_now()
    dpi = _PRINT_DPI if look.is_print else _DPI
    with mpl.rc_context(look.settings):
        # Laid out and drawn once for all; what saves a figure lays it out and draws it twice for each.
        figure.set_dpi(dpi)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        image = fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        figure.set_layout_engine("none")
        # Colours are counted and bytes are packed outside Python, while it writes the other files.
        with ThreadPoolExecutor(1) as beside:
            if "png" in look.endings:
                packed = beside.submit(_save_png, image, folder / f"{name}.png", dpi)
            if "svg" in look.endings:
                FigureCanvasSVG(figure).print_svg(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
            if "pdf" in look.endings:
                FigureCanvasPdf(figure).print_pdf(folder / f"{name}.pdf", metadata={"CreationDate": None})
        if "png" in look.endings:
            packed.result()


def _save_png(image: Image, place: Path, dpi: int) -> None:
    from PIL.Image import Dither

    few = image.quantize(256, dither=Dither.NONE)
    few.save(place, optimize=True, dpi=(dpi, dpi))
