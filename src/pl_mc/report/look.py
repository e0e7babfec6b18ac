"""In which look figures are drawn: on a screen, or for print at a width of one's own, in colours or in greys.

The look is that of the moment in which a figure is drawn (`drawn_in`): what draws need not hand it on.
"""

from __future__ import annotations

import contextlib
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any, Literal

from pl_mc.input_errors import InputError

STYLES = ("screen", "paper", "grey")
# Forms of files; what a page shows of a figure is one of the first two.
ENDINGS = ("png", "svg", "pdf")
USUAL_ENDINGS = ("png", "svg")

MM = 25.4
_UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": MM}
_NARROWEST_MM, _WIDEST_MM = 60.0, 420.0
# What prints without a width have: two columns of most journals.
_USUAL_WIDTH_MM = 180.0
# Panels beside each other are no narrower.
PANEL_MM = 40.0

# Digits of an exponent.
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

# Greys of methods, each beside a line and a marker of its own.
_GREYS = ("0.0", "0.5", "0.25", "0.62")

_COMMON: Any = {
    "svg.hashsalt": "pl_mc",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
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
# Sizes of text are those of a screen, and become smaller with all others when a figure is finished.
_PRINT: Any = {
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "grid.linewidth": 0.4,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.labelpad": 2.5,
    "axes.titlepad": 4.0,
}


@dataclass(frozen=True)
class Look:
    """How figures are drawn and stored.

    Attributes:
        style: ``screen``; ``paper``, in colours, or ``grey``, told apart by lines, markers and hatches: 7 to 9 points,
            thin lines, no heading, which belongs into a caption.
        width_mm: the width of every figure [mm]; that of each figure on a screen, and two columns in print, if none.
        endings: of the files that are written, of `ENDINGS`.
    """

    style: Literal["screen", "paper", "grey"] = "screen"
    width_mm: float | None = None
    endings: tuple[str, ...] = USUAL_ENDINGS

    @property
    def is_print(self) -> bool:
        """Whether it is a style for print."""
        return self.style != "screen"

    @property
    def width_in(self) -> float | None:
        """The width that a figure has to have [in], unless it has its own."""
        width_mm = _USUAL_WIDTH_MM if self.is_print and self.width_mm is None else self.width_mm
        return None if width_mm is None else width_mm / MM

    @property
    def settings(self) -> Any:
        """Settings of matplotlib."""
        return _COMMON | _PRINT if self.is_print else _COMMON

    @property
    def text(self) -> float:
        """Size of text, as a share of that on a screen."""
        return 0.82 if self.is_print else 1.0

    def columns_that_fit(self, columns: int, labels_in: float = 0.0, panel_mm: float = PANEL_MM) -> int:
        """How many panels, of at most so many, the width holds side by side, see `pl_mc.report.figures.new_figure`."""
        if self.width_in is None:
            return columns
        room_mm = (self.width_in - self.text * labels_in) * MM
        return max(1, min(columns, int(room_mm / panel_mm + 1e-9)))


# As figures have always been.
USUAL = Look()

_NOW: ContextVar[Look] = ContextVar("look", default=USUAL)


def look_now() -> Look:
    """The look of what is being drawn."""
    return _NOW.get()


@contextlib.contextmanager
def drawn_in(look: Look) -> Iterator[None]:
    """What is drawn meanwhile is drawn in this look."""
    before = _NOW.set(look)
    try:
        yield
    finally:
        _NOW.reset(before)


def width_mm(text: str) -> float:
    """A width such as ``88mm``, ``8.8cm`` or ``3.5in`` [mm].

    Raises:
        InputError: it is none, or a figure of it could not be read or printed.
    """
    found = re.fullmatch(r"\s*(\d{1,6}(?:\.\d{1,6})?)\s*(mm|cm|in)\s*", text, re.ASCII)
    needed = f"width: a length of {_NARROWEST_MM:g}mm to {_WIDEST_MM:g}mm with its unit is needed"
    if found is None:
        raise InputError(f"{needed}, such as 88mm.")
    length_mm = float(found[1]) * _UNITS_MM[found[2]]
    nearest_mm = min(max(length_mm, _NARROWEST_MM), _WIDEST_MM)
    if nearest_mm != length_mm:
        raise InputError(f"{needed} (nearest: {nearest_mm:g}mm).")
    return length_mm


def endings_of(given: Sequence[str]) -> tuple[str, ...]:
    """Forms of files by name, each once, in the order of `ENDINGS`; an `InputError` where one is none."""
    words = [word.strip().lower() for text in given for word in text.split(",")]
    if not words or not set(words) <= set(ENDINGS):
        raise InputError(f"format: the forms of a figure are {', '.join(ENDINGS)}, one or several.")
    if len(set(words)) < len(words):
        raise InputError(f"format: {next(word for word in words if words.count(word) > 1)} stands there twice.")
    return tuple(ending for ending in ENDINGS if ending in words)


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


# Okabe and Ito's colours first, ordered so that neighbours differ in lightness too.
_SERIES = (
    SeriesStyle("#0072B2", "-", "o"),
    SeriesStyle("#D55E00", "--", "s"),
    SeriesStyle("#009E73", "-.", "^"),
    SeriesStyle("#CC79A7", ":", "D"),
    SeriesStyle("#56B4E9", "-", "v"),
    SeriesStyle("#E69F00", "--", "P"),
    SeriesStyle("#000000", "-", "x"),
    SeriesStyle("#882255", "--", "*"),
    SeriesStyle("#44AA99", "-.", "<"),
    SeriesStyle("#AA4499", ":", ">"),
    SeriesStyle("#888888", "-", "h"),
    SeriesStyle("#117733", "--", "X"),
    SeriesStyle("#332288", "-.", "p"),
    SeriesStyle("#661100", ":", "d"),
    SeriesStyle("#999933", "--", "H"),
    SeriesStyle("#0000AA", "-.", "8"),
)

# Families of methods whose look is theirs in every figure; others take what is left.
_FAMILIES = (
    "ls", "igg3", "araim", "separated", "huber", "slope", "parity", "w_test", "leave_one_out", "max_dop", "ibpl",
    "sequential_parity", "kalman", "filter_bank", "sbas", "igg3_gated",
)  # fmt: skip


def series_style(index: int) -> SeriesStyle:
    """The style of what has that place in a list, such as a system; for methods there is `styles_of`."""
    return _in_this_look(index % len(_SERIES))


def styles_of(methods: Iterable[str]) -> dict[str, SeriesStyle]:
    """The style of each method of a figure: of families the same in every figure, no two alike in one.

    Args:
        methods: names with or without options, ``igg3(k1=4.0)``; of two of a family that without options has its look,
            else the first.
    """
    names = list(dict.fromkeys(methods))
    place: dict[str, int] = {}
    for name in sorted(names, key=lambda name: name not in _FAMILIES):
        family = re.split(r"[^a-z0-9_]", name, maxsplit=1)[0]
        if family in _FAMILIES and _FAMILIES.index(family) not in place.values():
            place[name] = _FAMILIES.index(family)
    # The looks of least squares and IGG-III are the last that others get.
    places = itertools.chain(range(2, len(_FAMILIES)), (0, 1), itertools.count(len(_FAMILIES)))
    left = (k for k in places if k not in place.values())
    for name in names:
        if name not in place:
            place[name] = next(left)
    return {name: _in_this_look(place[name]) for name in names}


def _in_this_look(place: int) -> SeriesStyle:
    """The style of a place; beyond the last the colours come again with the lines and markers of others."""
    turn, index = divmod(place, len(_SERIES))
    other = _SERIES[(index + 5 * turn) % len(_SERIES)]
    style = replace(_SERIES[index], line=other.line, marker=other.marker)
    return replace(style, colour=_GREYS[place % len(_GREYS)]) if look_now().style == "grey" else style
