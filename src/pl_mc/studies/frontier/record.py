"""The record of an experiment of the kind ``frontier``."""

from __future__ import annotations

import zlib
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from pl_mc.error_models import error_model
from pl_mc.geometry import Geometry, simulate
from pl_mc.geometry.gps_time import gps_dates, gps_seconds
from pl_mc.integrity_risk.given_residuals import RiskBudget
from pl_mc.integrity_risk.given_residuals.budget import as_budget
from pl_mc.integrity_risk.given_residuals.truth import Alike, Neighbours, OfNoise, Scaled, Truth
from pl_mc.studies.spec import ByOneLevel, NoiseChoice
from pl_mc.studies.strict import Strict, once

WORLD = "world"

_Positive = Annotated[float, Field(gt=0)]


class Sky(Strict):
    """Geometries of one place over a time, or of random users of the Earth.

    Attributes:
        name: what tables call it.
        site: a place as `pl_mc.simulate` takes it, whose epochs are spread evenly over ``duration_s``; or ``world``,
            random places, each as probable as its area, at random times of that duration.
        count: number of geometries.
        stressed: how many of them are looked at under wrong assumptions too.
        methods: names of the methods that are looked at, as tables have them; all unless given.
        start, duration_s: GPS time from which epochs are taken, and over how long [s].
        mask_deg: elevation mask [deg].
        constellations: nominal constellations, as of `pl_mc.simulate`.
        error_model, error_options: the error model, and its options.
    """

    name: str
    site: str = WORLD
    count: int = Field(ge=1, le=100_000)
    stressed: int = Field(default=0, ge=0)
    methods: tuple[str, ...] = ()
    start: str = "2017-11-21T00:00:00"
    duration_s: float = Field(default=86_400.0, gt=0)
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    constellations: tuple[str, ...] = ("GPS", "GAL")
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _within_count(self) -> Sky:
        if self.stressed > self.count:
            raise PydanticCustomError(
                "stressed", "stressed is at most count, {count}, not {stressed}",
                {"count": self.count, "stressed": self.stressed},
            )  # fmt: skip
        return self

    def geometries(self, seed: int) -> list[Geometry]:
        """The geometries with redundancy, one epoch each; fewer than ``count`` where some have none."""
        common: dict[str, Any] = {
            "mask_deg": self.mask_deg, "constellations": self.constellations,
            "error_model": error_model(self.error_model, **self.error_options),
        }  # fmt: skip
        if self.site != WORLD:
            step_s = self.duration_s / self.count
            series = simulate(site=self.site, start=self.start, epochs=self.count, interval_s=step_s, **common)
            found = [series[k] for k in range(len(series))]
        else:
            rng = np.random.default_rng((seed, zlib.crc32(self.name.encode())))
            start_s = gps_seconds(self.start, field=f"skies: {self.name}: start")
            found = []
            for latitude, longitude, when in rng.uniform(size=(self.count, 3)):
                place = (float(np.degrees(np.arcsin(2.0 * latitude - 1.0))), 360.0 * float(longitude) - 180.0, 0.0)
                time = gps_dates([start_s + np.floor(self.duration_s * when)])[0].isoformat()
                found.append(simulate(site=place, start=time, epochs=1, **common)[0])
        return [g for g in found if int(g.satellite_count) > int(g.unknown_count)]


class FrontierExperiment(ByOneLevel):
    """Methods at equal proven risk.

    Attributes:
        skies: sets of geometries.
        budget: fields of `pl_mc.RiskBudget`.
        draws: residuals for each satellite and multiplier; four times as many without a fault.
        sizes_m: biases on single satellites under which alarms are counted [m].
        limits_m: limits of the level whose availability is told, that of the alert aside [m].
        sigma_factors: true sigma over that of the model, as what may be wrong.
        biases_m: nominal biases that the multiplier did not know of [m].
        noises: true laws of the errors, each a noise model that is Gaussian once something else is drawn:
            ``student_t``, ``gaussian_mixture`` or ``multipath``.
        correlations: true correlation of the errors of every two satellites, in units of sigma.
        angles_deg: angle between two satellites over which the true correlation of their errors falls to 1/e.
        iterations: plain iterations after which an estimate stops, settled or not, of methods that have any.
        pair_priors: prior of a fault of each two satellites, along the direction that residuals show least and of the
            worst size of it, whose event is then estimated and not counted as lost.
        independent: independent samples of an approach, by which alarms add up to discontinuity.
        besides: ``pairs`` of satellites, ``constellations``: faults that the budget counts as lost, of which the event
            is estimated all the same, along the direction that residuals show least.
        continuity: probability of an interruption that the operation allows in an exposure, against which that of
            methods with an exposure (``araim`` of v4.2) is estimated; nothing is where it is left out.
    """

    double_alone: ClassVar[bool] = True
    conditions: ClassVar[tuple[str, ...]] = (
        "Multipliers of levels that scale with one (k_vertical, k_horizontal) are found at each geometry and stand in "
        "the tables; what is said below of them is that of other runs.",
        "Constellations have no faults beyond the prior that the budget names, and of two satellites at a time the "
        "prior counts as lost, where no table says otherwise.",
    )

    kind: Literal["frontier"] = "frontier"
    skies: Annotated[tuple[Sky, ...], Field(min_length=1)]
    budget: dict[str, Any] = Field(default_factory=dict)
    draws: int = Field(default=4096, ge=1024)
    sizes_m: Annotated[tuple[_Positive, ...], Field(min_length=1)] = (5.0, 10.0, 20.0, 50.0, 100.0)
    limits_m: tuple[_Positive, ...] = (20.0, 15.0, 10.0)
    sigma_factors: tuple[_Positive, ...] = (1.1, 1.25, 1.5)
    biases_m: tuple[_Positive, ...] = (0.25, 0.75)
    noises: tuple[NoiseChoice, ...] = ()
    correlations: tuple[Annotated[float, Field(gt=0, lt=1)], ...] = ()
    angles_deg: tuple[Annotated[float, Field(gt=0, le=1e6)], ...] = ()
    iterations: tuple[Annotated[int, Field(ge=1, le=1000)], ...] = ()
    pair_priors: tuple[Annotated[float, Field(gt=0, lt=1e-2)], ...] = ()
    independent: int = Field(default=25, ge=1)
    besides: tuple[Literal["pairs", "constellations"], ...] = ()
    continuity: Annotated[float, Field(gt=0, lt=1)] | None = None

    _once = field_validator(
        "sizes_m", "limits_m", "sigma_factors", "biases_m", "correlations", "angles_deg", "iterations", "pair_priors"
    )(once)

    @field_validator("skies")
    @classmethod
    def _names_once(cls, skies: tuple[Sky, ...]) -> tuple[Sky, ...]:
        names = [sky.name for sky in skies]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise PydanticCustomError("twice", "two skies are called {name}", {"name": twice[0]})
        return skies

    @model_validator(mode="after")
    def _some_are_stressed(self) -> FrontierExperiment:
        wrong = ("noises", "correlations", "angles_deg", "iterations", "pair_priors")
        asked = [field for field in wrong if getattr(self, field)]
        if asked and not any(sky.stressed for sky in self.skies):
            raise PydanticCustomError(
                "stressed", "{field} does nothing where no sky has stressed geometries", {"field": asked[0]}
            )
        return self

    @property
    def truths(self) -> tuple[Truth, ...]:
        """What errors may really be like."""
        return (
            *(Scaled(factor) for factor in self.sigma_factors),
            *(OfNoise(choice.build()) for choice in self.noises),
            *(Alike(share) for share in self.correlations),
            *(Neighbours(angle) for angle in self.angles_deg),
        )

    def risk_budget(self) -> RiskBudget:
        """The budget, checked."""
        return as_budget(self.budget)
