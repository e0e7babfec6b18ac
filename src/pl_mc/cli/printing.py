"""What commands share: parameters of one meaning, and what they print.

Text for people, JSON for programs, or one line; results go to standard output alone.
"""

from __future__ import annotations

import json as json_text
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from pl_mc.alert import AXES
from pl_mc.experiments.source_files import experiment_files
from pl_mc.input_errors import InputError, shown

if TYPE_CHECKING:
    from pl_mc.experiments.running import RunResult

_LONGEST_NUMBER = 40

Json = Annotated[bool, Parameter(negative="")]
Quiet = Annotated[bool, Parameter(negative="", alias="-q")]
Flag = Annotated[bool, Parameter(negative="")]
Several = Parameter(negative="")
Texts = Annotated[tuple[str, ...], Several]
Progress = Annotated[bool | None, Parameter(help="Show a progress bar; unless given, only on a terminal.")]

# Names of methods and error models, which are registered in packages that take seconds to load.
METHOD_NAMES = (
    "ls", "igg3", "igg3_gated", "araim", "separated", "ibpl", "slope", "max_dop", "parity", "w_test", "leave_one_out",
    "range_comparison", "nioraim", "sbas", "huber", "tukey", "hampel", "danish", "l1", "mm",
)  # fmt: skip
ERROR_MODEL_NAMES = ("residual", "none", "uire", "constant", "dual_frequency", "by_elevation")

if TYPE_CHECKING:
    Shipped = str
    MethodWord = str
    AxisWord = str
    PrecisionWord = str
    ErrorModelWord = str
    IonosphereWord = str
    StyleWord = str
else:
    # Words for which shells offer these; what else may stand there is checked where it is used.
    Shipped = Literal[tuple(experiment_files()) or ("ramp",)] | str
    MethodWord, ErrorModelWord = Literal[METHOD_NAMES] | str, Literal[ERROR_MODEL_NAMES] | str
    AxisWord, PrecisionWord = Literal[AXES] | str, Literal["float64", "float32"] | str
    IonosphereWord = Literal["broadcast", "none", "dual"] | str
    StyleWord = Literal["screen", "paper", "grey"] | str

Which = Annotated[
    Shipped,
    Parameter(
        help="A name that `pl-mc list` shows, the path of a TOML file, or the `manifest.json` of an earlier run.",
        show_choices=False,
    ),
]
Named = Annotated[Shipped, Parameter(show_choices=False)]
Axes = Annotated[tuple[AxisWord, ...], Parameter(negative="", show_choices=False)]
Methods = Annotated[tuple[MethodWord, ...], Parameter(negative="", show_choices=False)]
Precisions = Annotated[tuple[PrecisionWord, ...], Parameter(negative="", show_choices=False)]


def _whole(kind: object, tokens: Any) -> int:
    """A whole number as Python writes it, 10000 or 1e4."""
    text = tokens[0].value
    try:
        if text.isascii() and len(text) <= _LONGEST_NUMBER and "_" not in text:
            number = int(text) if text.lstrip("+-").isdigit() else float(text)
            if number == int(number):
                return int(number)
    except (ValueError, OverflowError):
        pass
    raise InputError(f"{shown(text)} is no whole number.")


def _whole_number(about: str) -> Any:
    return Parameter(help=about, converter=_whole)


Draws = Annotated[int | None, _whole_number("Noise draws for each fault and epoch, instead of the experiment's.")]
Seed = Annotated[int | None, _whole_number("Seed of the noise, instead of the experiment's.")]
Limit = Annotated[float | None, Parameter(allow_leading_hyphen=True)]
Count = Annotated[int | None, Parameter(converter=_whole)]


@Parameter(name="*")
@dataclass(frozen=True)
class Output:
    """How a command that makes results shows its progress and what it prints at the end.

    Attributes:
        progress, json, quiet: the options of those names.
    """

    progress: Progress = None
    json: Annotated[
        bool, Parameter(negative="", help="Print folder, files, answer and notes as JSON instead of the summary.")
    ] = False
    quiet: Annotated[bool, Parameter(negative="", alias="-q", help="Print the results folder alone.")] = False

    @property
    def bar(self) -> bool | None:
        """Whether there is a bar; none for a quiet command unless it is asked for."""
        return False if self.progress is None and self.quiet else self.progress

    def show(self, result: RunResult, bundle: Path | None = None) -> None:
        """A finished run: the summary, the folder and a bundle where there is one; as JSON; or the folder alone."""
        if self.json:
            print_json(result_content(result, bundle=bundle))
        elif self.quiet:
            print(result.folder)
        else:
            print(result.summary)
            page = f", report: {result.folder / result.page}" if result.page else ""
            print(f"Results: {result.folder}{page}")
            if bundle is not None:
                print(f"Bundle: {bundle}")


@Parameter(name="*")
@dataclass(frozen=True)
class Figures:
    """How figures are drawn, instead of the experiment's way.

    Attributes:
        format, style, width: the options of those names.
    """

    format: Annotated[
        tuple[str, ...], Parameter(negative="", help="Files of each figure: png, svg, pdf, or several, `png,svg,pdf`.")
    ] = ()
    style: Annotated[
        StyleWord | None,
        Parameter(help="screen; paper (in colours) or grey, for print: 7 to 8 points, no heading.", show_choices=False),
    ] = None
    width: Annotated[
        str | None, Parameter(help="Width of every figure, 60 to 420 mm: `88mm`, `8.8cm` or `3.5in`; 180 mm in print.")
    ] = None

    @property
    def fields(self) -> dict[str, Any]:
        """The fields that are given."""
        given = {"format": ",".join(self.format) or None, "style": self.style, "width": self.width}
        return {name: value for name, value in given.items() if value is not None}


def overrides(
    draws: int | None,
    seed: int | None,
    val_m: float | None = None,
    hal_m: float | None = None,
    axes: tuple[str, ...] = (),
) -> dict[str, Any]:
    """The fields of an experiment that a command replaces."""
    limits = {"vertical_m": val_m, "horizontal_m": hal_m}
    alert = {field: limit for field, limit in limits.items() if limit is not None}
    fields = {"draws": draws, "seed": seed, "alert": alert or None, "axes": axes or None}
    return {field: value for field, value in fields.items() if value is not None}


def print_json(content: Any) -> None:
    """One JSON document."""
    print(json_text.dumps(content, indent=2, ensure_ascii=False, allow_nan=False, default=str))


def result_content(result: RunResult, *, bundle: Path | None = None) -> dict[str, Any]:
    """A finished run for programs: its folder, the files in it, the answer and the notes, and a bundle of it."""
    files = sorted(path.name for path in result.folder.iterdir() if path.is_file())
    return {
        "folder": str(result.folder),
        "report": result.page,
        "tables": [name for name in files if name.endswith((".csv", ".parquet"))],
        "figures": [name for name in files if name.endswith((".png", ".svg", ".pdf"))],
        "answer": list(result.answer),
        "notes": list(result.notes),
    } | ({} if bundle is None else {"bundle": str(bundle)})
