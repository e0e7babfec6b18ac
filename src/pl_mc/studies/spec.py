"""Parts that experiment files have in common: geometry, faults, noise, methods, and what they are made into."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from pl_mc.alert import AXES, EITHER, VERTICAL, AlertLimits, Judged, as_alert, as_axes, as_limits, is_operation
from pl_mc.constants import MOST_SATELLITES
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.error_models import ErrorModel, error_model
from pl_mc.geometry import Geometry, redundancy_numbers, simulate
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.methods import Method, as_methods, method
from pl_mc.noise_models import NoiseModel, noise_model
from pl_mc.receiver.truth import is_file
from pl_mc.studies.figure_fields import FigureFields
from pl_mc.studies.strict import Strict


class SimulatedGeometry(Strict):
    """The nominal constellations over a site.

    Fields are those of `pl_mc.simulate`; ``epoch`` picks one epoch of the series, counted from 0.
    """

    site: str = "CUT0"
    start: str = "2017-11-21T00:00:00"
    epochs: int = Field(default=2880, ge=1)
    interval_s: float = Field(default=30.0, gt=0)
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    constellations: tuple[str, ...] = ("GPS", "BDS-2")
    without: tuple[str, ...] = ()
    almanac: Path | None = Field(
        default=None, description="YUMA or SEM file whose healthy satellites take the place of the nominal GPS"
    )
    sp3: Path | None = Field(default=None, description="SP3 file whose satellites take the place of all nominal ones")
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)
    epoch: int | None = Field(default=None, ge=0)

    def build(self) -> Geometry:
        """The series, or the one epoch asked for."""
        series = simulate(
            site=self.site, start=self.start, epochs=self.epochs, interval_s=self.interval_s,
            mask_deg=self.mask_deg, constellations=self.constellations, without=self.without,
            almanac=self.almanac, sp3=self.sp3, error_model=self.model(),
        )  # fmt: skip
        return series if self.epoch is None else series[self.epoch]

    def one_epoch(self) -> Geometry:
        """The one epoch asked for; an `InputError` where this is a series."""
        built = self.build()
        if built.is_series:
            raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
        return built

    def model(self) -> ErrorModel:
        """The error model."""
        return error_model(self.error_model, **self.error_options)


class ReceiverFiles(Strict):
    """A receiver's RINEX files and where it truly was; fields of `pl_mc.receiver.read_receiver_series`.

    ``observations`` and ``navigation`` are one file or several; ``truth`` is ``X,Y,Z`` Earth-fixed [m] or the name of a
    track; ``systems`` are those of GPS, BeiDou and Galileo that the files have unless given; ``signals`` are names such
    as ``L5``, or with the ionosphere ``dual`` pairs such as ``E1+E5b``.
    """

    observations: Path | tuple[Path, ...]
    navigation: Path | tuple[Path, ...]
    truth: str
    systems: tuple[str, ...] | None = None
    signals: tuple[str, ...] | None = None
    ionosphere: Literal["broadcast", "none", "dual"] = "broadcast"
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    snr_dbhz: float | None = Field(default=None, ge=0, le=100)
    ionex: tuple[Path, ...] = ()
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)

    @field_validator("systems")
    @classmethod
    def _letter_by_letter(cls, systems: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for one in systems or ():
            if len(one) > 1 and set(one) <= {*SYSTEM_NAMES, ",", " "}:
                letters = [letter for letter in one if letter in SYSTEM_NAMES]
                right = f"{','.join(letters)} on the command line, {letters} in a file"
                raise PydanticCustomError("systems", f"no system is called {one}; the form is {right}")
        return systems

    def model(self) -> ErrorModel:
        """The error model."""
        return error_model(self.error_model, **self.error_options)

    def receiver_files(self) -> dict[str, Path]:
        """The files by field; of several of a field each one but the first has its number."""
        files = numbered("observations", self.observations) | numbered("navigation", self.navigation)
        files |= numbered("ionex", self.ionex)
        return files | ({"truth": Path(self.truth)} if self.has_track() else {})

    def has_track(self) -> bool:
        """Whether the truth is a file."""
        return is_file(self.truth)


def numbered(field: str, paths: Path | tuple[Path, ...]) -> dict[str, Path]:
    """Files of a field by its name, with a number from the second on."""
    several = paths if isinstance(paths, tuple) else (paths,)
    return {field if k == 1 else f"{field} {k}": path for k, path in enumerate(several, start=1)}


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise PydanticCustomError("twice", "each is named once, and {name} is there twice", {"name": twice[0]})
    return names


# Names of which each counts once.
Distinct = Annotated[tuple[str, ...], AfterValidator(_each_once)]


class NamedChoice(Strict):
    """Something by name; every further field is an option of it."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, given: Any) -> Any:
        return {"name": given} if isinstance(given, str) else given

    @property
    def options(self) -> dict[str, Any]:
        """The further fields."""
        return self.model_extra or {}


class MethodChoice(NamedChoice):
    """A method by name; every further field is an option of that method."""

    def build(self) -> Method:
        """The method's record."""
        return method(self.name, **self.options)


class GivenLimits(Strict):
    """Alert limits of one's own, see `pl_mc.AlertLimits`."""

    name: str = "own limits"
    vertical_m: float | None = None
    horizontal_m: float | None = None

    def build(self) -> AlertLimits:
        """The record."""
        return AlertLimits(self.name, self.vertical_m, self.horizontal_m)


class Experiment(Strict):
    """What every experiment file says, whatever its kind."""

    # Whether a kind computes in double precision, whatever the file says; sentences that hold for all its numbers.
    double_alone: ClassVar[bool] = False
    conditions: ClassVar[tuple[str, ...]] = ()

    title: str
    methods: tuple[MethodChoice, ...] = (MethodChoice(name="ls"), MethodChoice(name="igg3"))
    alert: str | GivenLimits = "LPV-200"
    seed: int = Field(default=20171121, ge=0, le=LARGEST_SEED)
    precision: Literal["float64", "float32"] = "float64"
    # No matter of numbers: what is stored of an experiment and compared is without it.
    figures: FigureFields = Field(default=FigureFields(), exclude=True)

    @field_validator("precision")
    @classmethod
    def _has_an_effect(cls, precision: str) -> str:
        if cls.double_alone and precision != "float64":
            raise PydanticCustomError("precision", "this kind computes in double precision alone (float64)")
        return precision

    def method_records(self) -> tuple[Method, ...]:
        """The methods, made records."""
        return as_methods([choice.build() for choice in self.methods])

    @field_validator("alert", mode="before")
    @classmethod
    def _by_name_or_in_a_table(cls, given: Any) -> Any:
        if isinstance(given, str | GivenLimits):
            return given
        if not isinstance(given, Mapping):
            raise PydanticCustomError("alert", "an operation's name, or a table such as {vertical_m = 25}, is needed")
        return GivenLimits.model_validate(given)

    def alert_limits(self) -> AlertLimits:
        """The alert limits, of which the vertical one decides; an `InputError` where there is none."""
        return as_alert(self.given_limits())

    def judged_axes(self) -> tuple[str, ...]:
        """The axes by whose limits the experiment judges; none for kinds that judge by no limit."""
        return (VERTICAL,)

    def asked_axes(self) -> tuple[str, ...] | None:
        """The axes that the file names, unless it names none."""
        return None

    def judged(self) -> tuple[Judged, ...]:
        """The axes with their limits."""
        return tuple(Judged(self.alert_limits(), axis) for axis in self.judged_axes())

    def given_limits(self) -> str | AlertLimits:
        """The limits as they are written, by name or as a record."""
        return self.alert if isinstance(self.alert, str) else self.alert.build()

    def input_files(self) -> Mapping[str, Path]:
        """Files that the experiment reads, by field; their hashes go into the manifest."""
        return satellite_files(getattr(self, "geometry", None), "geometry")


class ByAxes(Experiment):
    """What a file says of a kind that judges by any axis.

    Attributes:
        axes: which of the limits decide: vertical, horizontal or either of them, one or several of these; the vertical
            one unless given, the horizontal one where there is no other.
    """

    # How many axes a kind judges by at a time, and whether either limit may decide.
    most_axes: ClassVar[int] = len(AXES)
    takes_either: ClassVar[bool] = True

    axes: tuple[str, ...] | None = None

    @field_validator("axes", mode="before")
    @classmethod
    def _of_the_limits(cls, given: Any, info: ValidationInfo) -> Any:
        named, alert = (given,) if isinstance(given, str) else given, info.data.get("alert")
        # Limits that are wrong themselves say so.
        own = isinstance(alert, GivenLimits)
        if named is not None and alert is not None and (own or is_operation(alert)):
            try:
                axes = as_axes(named, as_limits(alert.build() if own else alert))
            except InputError as error:
                raise PydanticCustomError("axes", "{rule}", {"rule": str(error).removeprefix("axes: ")}) from None
            if len(axes) > cls.most_axes:
                raise PydanticCustomError("axes", "this kind of experiment judges by one axis at a time")
            if EITHER in axes and not cls.takes_either:
                raise PydanticCustomError(
                    "axes", "this kind of experiment has one error and one level; choose vertical or horizontal"
                )
        return named

    def alert_limits(self) -> AlertLimits:
        """The alert limits; one of the two is enough."""
        return as_limits(self.given_limits())

    def judged_axes(self) -> tuple[str, ...]:
        """The axes asked for, else the vertical one where it has a limit."""
        return as_axes(self.axes, self.alert_limits())

    def asked_axes(self) -> tuple[str, ...] | None:
        """The field."""
        return self.axes


class ByOneAxis(ByAxes):
    """What a file says of a kind that judges by one axis at a time."""

    most_axes: ClassVar[int] = 1

    @property
    def decides(self) -> Judged:
        """The axis with its limits."""
        (judged,) = self.judged()
        return judged

    def with_axis(self, table: pd.DataFrame, behind: str = "method") -> pd.DataFrame:
        """The table with a column ``axis`` behind one of its columns, unless the vertical limit decides unasked."""
        if "axis" in table or (self.decides.axis == VERTICAL and self.axes is None):
            return table
        table.insert(table.columns.get_loc(behind) + 1, "axis", self.decides.axis)
        return table


class ByOneLevel(ByOneAxis):
    """What a file says of a kind that judges one error by one level, the vertical ones or the horizontal ones."""

    takes_either: ClassVar[bool] = False

    @property
    def level_axis(self) -> Literal["vertical", "horizontal"]:
        """The axis."""
        return "vertical" if self.decides.axis == VERTICAL else "horizontal"


def kind_of(experiment: Experiment) -> str:
    """The kind of an experiment, which every record but the common one has as a field."""
    return str(experiment.kind)  # type: ignore[attr-defined]


def satellite_files(part: object, field: str) -> dict[str, Path]:
    """The almanac or the SP3 file of a simulated part of an experiment, by field; nothing where it has none."""
    paths = {f"{field}.{name}": getattr(part, name, None) for name in ("almanac", "sp3")}
    return {name: path for name, path in paths.items() if path is not None}


class NoiseChoice(NamedChoice):
    """A noise model by name; every further field is an option of that model."""

    def build(self) -> NoiseModel:
        """The model's record."""
        return noise_model(self.name, **self.options)


def scaled_noise(g: Geometry, factor: float) -> Geometry:
    """The geometry with every sigma multiplied."""
    return g if factor == 1.0 else dataclasses.replace(g, sigma_m=g.sigma_m * factor)


def epochs_at(g: Geometry, places: NDArray[np.int64]) -> Geometry:
    """The epochs of these places in a series, which need not follow each other."""
    by_epoch = ("design", "sigma_m", "in_view", "satellite", "epoch", "time_gps_s")
    return dataclasses.replace(g, **{name: getattr(g, name)[places] for name in by_epoch})


def require_existing(name: str, g: Geometry) -> None:
    """Raise `InputError` for the name of a satellite that no constellation has: a slip, and not one out of view."""
    found = re.fullmatch(r"([A-Z])(\d\d)", name)
    if found is None or not 1 <= int(found[2]) <= MOST_SATELLITES.get(found[1], 0):
        known = [f"{letter}{k:02d}" for letter in sorted(set(g.systems)) for k in range(1, MOST_SATELLITES[letter] + 1)]
        raise InputError(f"satellite: {shown(name)} is no satellite that exists ({nearest(name, known)}).")


def median_redundancy_satellite(g: Geometry, *, system: str) -> str:
    """The satellite of a system whose redundancy number is the median one (the lower of the two middle ones)."""
    if g.is_series:
        raise InputError("faults.otherwise: a median redundancy number needs one epoch; give geometry.epoch.")
    redundancy = redundancy_numbers(g)
    rows = [k for k, letter in enumerate(g.systems) if letter == system]
    if not rows:
        raise InputError(f"faults.satellite: no satellite of system {system!r} ({nearest(system, set(g.systems))}).")
    ordered = sorted(rows, key=lambda k: (redundancy[k], g.names[k]))
    return g.names[ordered[(len(ordered) - 1) // 2]]
