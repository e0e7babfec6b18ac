"""Parts that experiment files have in common: geometry, methods, alert limits, and what they are made into."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from pl_mc.alert import BY_NAME, AlertLimits
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.error_models import ErrorModel, error_model
from pl_mc.geometry import Geometry, simulate
from pl_mc.input_errors import require_choice
from pl_mc.methods import Method, as_methods, method


class Strict(BaseModel):
    """A record of an experiment file; unknown fields are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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
    sp3: Path | None = Field(
        default=None, description="SP3-c or SP3-d file whose satellites take the place of all nominal ones"
    )
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)
    epoch: int | None = Field(default=None, ge=0)

    def build(self) -> Geometry:
        """The series, or the one epoch asked for."""
        series = simulate(
            site=self.site,
            start=self.start,
            epochs=self.epochs,
            interval_s=self.interval_s,
            mask_deg=self.mask_deg,
            constellations=self.constellations,
            without=self.without,
            almanac=self.almanac,
            sp3=self.sp3,
            error_model=self.model(),
        )
        return series if self.epoch is None else series[self.epoch]

    def model(self) -> ErrorModel:
        """The error model."""
        return error_model(self.error_model, **self.error_options)


class ReceiverFiles(Strict):
    """A receiver's RINEX files and where it truly was; fields of `pl_mc.receiver.read_receiver_series`.

    ``truth`` is ``X,Y,Z`` Earth-fixed [m] or the name of a track.
    """

    observations: Path
    navigation: Path
    truth: str
    systems: tuple[str, ...] = ("G", "C")
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)

    def model(self) -> ErrorModel:
        """The error model."""
        return error_model(self.error_model, **self.error_options)


class MethodChoice(Strict):
    """A method by name; every further field is an option of that method."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str

    def build(self) -> Method:
        """The method's record."""
        return method(self.name, **(self.model_extra or {}))


class Experiment(Strict):
    """What every experiment file says, whatever its kind."""

    title: str
    methods: tuple[MethodChoice, ...] = (MethodChoice(name="ls"), MethodChoice(name="igg3"))
    alert: str = "LPV-200"
    seed: int = Field(default=20171121, ge=0, le=LARGEST_SEED)
    precision: Literal["float64", "float32"] = "float64"

    def method_records(self) -> tuple[Method, ...]:
        """The methods, made records."""
        return as_methods([choice.build() for choice in self.methods])

    def alert_limits(self) -> AlertLimits:
        """The alert limits by name."""
        return BY_NAME[require_choice(self.alert, BY_NAME, field="alert")]

    def input_files(self) -> Mapping[str, Path]:
        """Files that the experiment reads, by field; their hashes go into the manifest."""
        return satellite_files(getattr(self, "geometry", None), "geometry")


def satellite_files(part: object, field: str) -> dict[str, Path]:
    """The almanac or the SP3 file of a simulated part of an experiment, by field; nothing where it has none."""
    paths = {f"{field}.{name}": getattr(part, name, None) for name in ("almanac", "sp3")}
    return {name: path for name, path in paths.items() if path is not None}
