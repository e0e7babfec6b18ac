"""Figures at a width of one's own: panels that find room, sizes of print, legends below, greys."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from pl_mc.report.artists import Sheet
from pl_mc.report.look import Look, look_now

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.text import Text

# How much smaller than on a screen a panel of curves is at the least, how high its axes are, and what stands above and
# below them [in].
_LEAST, _LOWEST_IN, _AROUND_IN = 0.5, 1.1, 0.6
# Times a figure is made higher until its panels are high enough.
_TRIES = 4
# Sizes of text [points], of lines and of markers.
_SMALLEST_PT, _LARGEST_PT = 7.0, 8.0
_LINE, _THINNEST_PT, _MARKER = 0.75, 0.5, 0.8
# What a key takes beside its text, as a multiple of the size of letters.
_OF_A_KEY = 4.5
# The lightest colour of a map in greys: what was not seen is lighter still.
_LIGHTEST = 0.82


def laid_out(
    figure: Sheet, rows: int, columns: int, *, look: Look, lines_in: float, labels_in: float, panel_mm: float,
    sharex: Any = False, sharey: Any = False, subplot_kw: Any = None, gridspec_kw: Any = None,
) -> list[Axes]:  # fmt: skip
    """Axes row by row; columns that find no room stand below the others, all rows of them together."""
    width_in = look.width_in
    assert width_in is not None
    natural_width, natural_height = figure.get_size_inches()
    across = look.columns_that_fit(columns, labels_in, panel_mm)
    blocks = -(-columns // across)
    scale = float(np.clip(width_in / across / (natural_width / columns), _LEAST, look.text))
    figure.rows = rows * blocks
    # No higher than wide, which is what a screen leaves of a panel above its legend.
    curves_in = min(scale * (natural_height / rows - _AROUND_IN), width_in / across)
    figure.least_in = look.text * lines_in or max(curves_in, _LOWEST_IN)
    figure.set_size_inches(width_in, figure.rows * (figure.least_in + _AROUND_IN))
    given = dict(gridspec_kw or {})
    heights = np.array(given.get("height_ratios", np.ones(rows)), dtype=float) / np.mean(
        given.get("height_ratios", 1.0)
    )
    widths = given.get("width_ratios") if blocks == 1 else None
    grid = figure.add_gridspec(figure.rows, across, height_ratios=list(heights) * blocks, width_ratios=widths)
    made: dict[tuple[int, int], Axes] = {}
    for row in range(rows):
        for column in range(columns):
            block, place = divmod(column, across)
            shared: dict[str, Any] = {
                "sharex": _first(made, sharex, along="row", row=row, column=column),
                "sharey": _first(made, sharey, along="col", row=row, column=column),
            }
            panel = figure.add_subplot(grid[block * rows + row, place], **shared, **(subplot_kw or {}))
            if sharex in (True, "all", "col") and row < rows - 1:
                panel.tick_params(labelbottom=False)
            if sharey in (True, "all", "row"):
                if place:
                    panel.tick_params(labelleft=False)
                elif block:
                    figure.named_like.append((panel, made[row, 0]))
            made[row, column] = panel
            figure.panels.append((panel, float(heights[row])))
    return list(made.values())


def _first(made: dict[tuple[int, int], Axes], shared: Any, *, along: str, row: int, column: int) -> Axes | None:
    """The panel whose axis another one has."""
    places = {True: (0, 0), "all": (0, 0), "row": (row, 0), "col": (0, column)}
    return made.get(places[shared]) if shared in places and shared is not False else None


def finish(figure: Sheet) -> None:
    """What a complete figure still needs at its width."""
    look = look_now()
    for panel, other in figure.named_like:
        if not panel.get_ylabel() and panel.get_visible():
            panel.set_ylabel(other.get_ylabel())
    if look.is_print:
        _sizes(figure)
    if figure.keys:
        _legend(figure)
    _high_enough(figure)
    _wrapped(figure)
    _high_enough(figure)
    if look.style == "grey":
        _in_greys(figure)


def _sizes(figure: Sheet) -> None:
    """Text of 7 to 8 points, thin lines, small markers."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    # Keys of a legend may be drawn nowhere else.
    for artist in dict.fromkeys([*figure.findobj(), *figure.keys.values()]):
        if isinstance(artist, Text):
            artist.set_fontsize(
                float(np.clip(look_now().text * float(artist.get_fontsize()), _SMALLEST_PT, _LARGEST_PT))
            )
        elif isinstance(artist, Line2D):
            if artist.get_linewidth():
                artist.set_linewidth(max(_LINE * float(artist.get_linewidth()), _THINNEST_PT))
            artist.set_markersize(_MARKER * float(artist.get_markersize()))
        elif isinstance(artist, LineCollection):
            artist.set_linewidth(list(np.maximum(_LINE * np.ravel(artist.get_linewidth()), _THINNEST_PT)))


def _legend(figure: Sheet) -> None:
    """One legend below all panels, with as many columns as find room."""
    width = figure.get_figwidth() * figure.dpi
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    size: Any = {"fontsize": _SMALLEST_PT} if look_now().is_print else {}
    for columns in range(min(len(figure.keys), 6), 0, -1):
        made = figure.legend(
            list(figure.keys.values()), list(figure.keys), loc="outside lower left", ncols=columns, handlelength=2.4,
            columnspacing=1.2, borderaxespad=0.1, **size,
        )  # fmt: skip
        if columns == 1:
            # What is wider still goes on in another line.
            for text in made.get_texts():
                _wrap(text, 0.98 * width - _OF_A_KEY * float(text.get_fontsize()) * figure.dpi / 72.0, renderer)
        box = made.get_window_extent(renderer)
        if box.width <= 0.98 * width or columns == 1:
            # Panels and a legend that together are higher than the figure are not laid out at all.
            figure.set_figheight(figure.get_figheight() + box.height / figure.dpi)
            return
        made.remove()


def _high_enough(figure: Sheet) -> None:
    """Lay a figure out, and make it higher until its lowest panel is as high as it has to be."""
    engine = figure.get_layout_engine()
    assert engine is not None
    for _ in range(_TRIES):
        with warnings.catch_warnings():
            # Of panels for which there is no room yet.
            warnings.simplefilter("ignore", UserWarning)
            engine.execute(figure)
        height_in = figure.get_figheight()
        # What a study has removed is no longer there.
        found = [
            height_in * panel.get_position(original=True).height / share
            for panel, share in figure.panels
            if panel in figure.axes
        ]
        lacking = figure.least_in - min(found, default=figure.least_in)
        if lacking < 0.02 * figure.least_in:
            return
        figure.set_figheight(height_in + figure.rows * lacking)


def _wrapped(figure: Sheet) -> None:
    """Titles and names of axes within their panels."""
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    own = [panel for panel, _ in figure.panels]
    for panel in figure.axes:
        box = panel.get_window_extent(renderer)
        # A title may go on above what stands to the right of the panel, not above another panel.
        for title in (panel.title, getattr(panel, "_left_title", None)):
            if title is not None:
                _wrap(title, box.width, renderer)
        # Beside a bar of colours there is room.
        wide, high = (box.width, box.height) if panel in own else (0.8 * side for side in figure.bbox.size)
        _wrap(panel.xaxis.label, 1.05 * wide, renderer)
        _wrap(panel.yaxis.label, 1.05 * high, renderer, upright=True)


def _wrap(text: Text, room: float, renderer: Any, *, upright: bool = False) -> None:
    """A text in lines that find room."""

    def needed() -> float:
        extent = text.get_window_extent(renderer)
        return float(extent.height if upright else extent.width)

    words = text.get_text()
    if not words or needed() <= room:
        return
    longest = max(map(len, words.splitlines()))
    for letters in range(int(longest * room / needed()) + 3, 11, -1):
        lines = [part for line in words.splitlines() for part in textwrap.wrap(line, letters, break_long_words=False)]
        text.set_text("\n".join(lines))
        if needed() <= room:
            return


def _in_greys(figure: Sheet) -> None:
    """Every colour by its lightness; maps of colours from dark to light as they were."""
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    for artist in figure.findobj():
        if isinstance(artist, Collection | AxesImage) and artist.get_array() is not None:
            _with_grey_map(artist)
        elif isinstance(artist, Collection | Patch):
            _to_grey(artist.get_facecolor, artist.set_facecolor)
            _to_grey(artist.get_edgecolor, artist.set_edgecolor)
        elif isinstance(artist, Line2D):
            _to_grey(artist.get_color, artist.set_color)
            _to_grey(artist.get_markerfacecolor, artist.set_markerfacecolor)
            _to_grey(artist.get_markeredgecolor, artist.set_markeredgecolor)
        elif isinstance(artist, Text):
            _to_grey(artist.get_color, artist.set_color)


def _with_grey_map(artist: Any) -> None:
    """Give an artist its map of colours in greys, and its bar of colours the labels that it had."""
    bar = artist.colorbar
    axis = None if bar is None else bar.ax.xaxis if bar.orientation == "horizontal" else bar.ax.yaxis
    labels = None if axis is None else (axis.get_major_formatter(), axis.get_minor_formatter())
    artist.set_cmap(_grey_map(artist.get_cmap()))
    if axis is not None and labels is not None:
        axis.set_major_formatter(labels[0])
        axis.set_minor_formatter(labels[1])


def _to_grey(get: Callable[[], Any], put: Callable[[Any], None]) -> None:
    from matplotlib.colors import to_rgba_array

    given = get()
    if isinstance(given, str) and given in ("none", "auto"):
        return
    colours = to_rgba_array(given)
    if len(colours) and np.ptp(colours[:, :3], axis=1).max() > 0:
        made = np.column_stack([np.repeat(_lightness(colours)[:, None], 3, axis=1), colours[:, 3]])
        put(made if np.ndim(given) > 1 else tuple(made[0]))


def _lightness(colours: Any) -> Any:
    """(k,), what a colour weighs in grey (ITU-R BT.601)."""
    return colours[:, :3] @ np.array([0.299, 0.587, 0.114])


def _grey_map(colours: Colormap) -> Colormap:
    from matplotlib.colors import ListedColormap

    grey = _lightness(colours(np.linspace(0.0, 1.0, colours.N)))
    grey = grey * _LIGHTEST / max(float(grey.max()), 1e-9)
    return ListedColormap(np.repeat(grey[:, None], 3, axis=1))
