"""Where a series of epochs and its errors without faults come from: a site, a flight, or a receiver's files."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from pl_mc.error_models import error_model
from pl_mc.geometry import Geometry, simulate
from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.flight import Flight, banked_visibility, fly, survey_plan
from pl_mc.geometry.frames import geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.kernels.noise import LANES, epoch_key, unit_noise
from pl_mc.receiver import read_receiver_series, read_truth
from pl_mc.runtime.precision import dtype_of, precision_scope
from pl_mc.studies.registry import PACKAGED_FOLDERS
from pl_mc.studies.spec import ReceiverFiles, SimulatedGeometry, numbered, satellite_files
from pl_mc.studies.strict import Strict

# Names the folder in which the files of receivers are looked for.
DATA_VARIABLE = "PL_MC_DATA"

_FORMS = {"site": "Site", "flight": "Flight", "receiver": "Receiver"}


@dataclass(frozen=True)
class Series:
    """A series of e epochs and n rows with its errors as they are without injected faults.

    Attributes:
        geometry: the series.
        errors_m: (k, e, n), pseudorange errors: k draws of noise, or the one set that a receiver had [m].
        tables: further tables by file name, such as a track.
        notes: sentences about what was left out or chosen.
    """

    geometry: Geometry
    errors_m: NDArray[np.float64]
    tables: Mapping[str, pd.DataFrame]
    notes: tuple[str, ...]


class SiteSource(SimulatedGeometry):
    """The nominal constellations over a site, with noise drawn from the error model."""

    kind: Literal["site"] = "site"
    epoch: None = None

    def files(self) -> dict[str, Path]:
        """The almanac or SP3 file, where there is one."""
        return satellite_files(self, "source")

    def series(self, *, draws: int, seed: int, precision: str) -> Series:
        """The series with ``draws`` draws of noise."""
        g = self.build()
        return Series(g, drawn_errors_m(g, draws=draws, seed=seed, precision=precision), {}, g.notes)

    def describe(self) -> str:
        """The source in words."""
        taken = f"nominal {' + '.join(self.constellations)}"
        if self.almanac is not None:
            taken += f" (GPS from the almanac {self.almanac.name})"
        if self.sp3 is not None:
            taken = f"the {' + '.join(self.constellations)} of the precise orbits {self.sp3.name}"
        return (
            f"simulated {self.site} from {self.start} (GPS time), {self.epochs} epochs every {self.interval_s:g} s "
            f"under {taken}, mask {self.mask_deg:g} deg; one draw of "
            f"noise from the error model {self.error_model}"
        )


class FlightSource(Strict):
    """The nominal constellations over the flight of `pl_mc.geometry.flight.survey_plan`, with drawn noise.

    Attributes:
        banked_mask: whether satellites below the mask of the banked aircraft are hidden too.
    """

    kind: Literal["flight"] = "flight"
    start: str
    epochs: int = Field(ge=2)
    interval_s: float = Field(default=1.0, gt=0)
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    banked_mask: bool = True
    constellations: tuple[str, ...] = ("GPS", "BDS-2")
    without: tuple[str, ...] = ()
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)

    def files(self) -> dict[str, Path]:
        """No file is read."""
        return {}

    def series(self, *, draws: int, seed: int, precision: str) -> Series:
        """The series with ``draws`` draws of noise, and the flight as a table."""
        flight = fly(survey_plan(), epochs=self.epochs, interval_s=self.interval_s)
        visible = None
        if self.banked_mask:
            slots = constellation_slots(self.constellations, self.without)
            time_gps_s = gps_seconds(self.start) + flight.time_s
            visible = banked_visibility(flight, slots, time_gps_s, mask_deg=self.mask_deg)
        same = self.model_dump(include={"start", "interval_s", "mask_deg", "constellations", "without"})
        model = error_model(self.error_model, **self.error_options)
        g = simulate(track_m=flight.track_m, visible=visible, error_model=model, **same)
        errors_m = drawn_errors_m(g, draws=draws, seed=seed, precision=precision)
        note = (
            "The flight is made up (Zhengzhou plain, survey legs at 28 m/s, turns at 20-25 deg of bank): the paper "
            "says nothing of place, aircraft or track."
        )
        return Series(g, errors_m, {"flight": flight_table(flight)}, (note,))

    def describe(self) -> str:
        """The source in words."""
        hidden = " and from the banked plane of the aircraft" if self.banked_mask else ""
        return (
            f"made-up survey flight from {self.start} (GPS time), {self.epochs} epochs every {self.interval_s:g} s "
            f"under nominal {' + '.join(self.constellations)}, mask {self.mask_deg:g} deg from the horizon"
            f"{hidden}; one draw of noise from the error model {self.error_model}"
        )


class ReceiverSource(ReceiverFiles):
    """Files of a real receiver with its true position, read by `pl_mc.receiver.read_receiver_series`.

    Names without a folder are looked for in the folder that the environment variable ``PL_MC_DATA`` names, or in
    the current one where it names none.
    """

    kind: Literal["receiver"] = "receiver"

    def files(self) -> dict[str, Path]:
        """The files by field, found; an `InputError` names the one that is not there and the variable."""
        return {field: _found(field, path) for field, path in self.receiver_files().items()}

    def series(self, *, draws: int, seed: int, precision: str) -> Series:
        """The series with the errors that the receiver had; the noise is its own, so draws and seed do nothing."""
        files = self.files()
        read = read_receiver_series(
            [path for field, path in files.items() if field.startswith("observations")],
            [path for field, path in files.items() if field.startswith("navigation")],
            read_truth(str(files["truth"]) if self.has_track() else self.truth),
            systems=self.systems,
            signals=self.signals,
            mask_deg=self.mask_deg,
            error_model=self.model(),
            ionosphere=self.ionosphere,
            snr_dbhz=self.snr_dbhz,
            ionex=[path for field, path in files.items() if field.startswith("ionex")] or None,
        )
        return Series(read.geometry, read.errors_m[None], {}, read.notes)

    def describe(self) -> str:
        """The source in words."""
        truth = "its track" if self.has_track() else "its known position"
        named = " and ".join(path.name for path in numbered("observations", self.observations).values())
        systems = "those it has" if self.systems is None else " + ".join(self.systems)
        systems += "" if self.signals is None else f", signals {', '.join(self.signals)}"
        systems += "" if self.ionosphere == "broadcast" else f", ionosphere {self.ionosphere}"
        return (
            f"receiver file {named} against {truth}, systems {systems}, mask "
            f"{self.mask_deg:g} deg; the receiver's own errors; sigma from the error model {self.error_model}"
        )


def _form_of_source(given: Any) -> str | None:
    kind = given.get("kind") if isinstance(given, Mapping) else getattr(given, "kind", None)
    return _FORMS.get(kind) if isinstance(kind, str) else None


AnySource = Annotated[
    Annotated[SiteSource, Tag("Site")]
    | Annotated[FlightSource, Tag("Flight")]
    | Annotated[ReceiverSource, Tag("Receiver")],
    Discriminator(
        _form_of_source, custom_error_type="source_kind", custom_error_message=f"its kind is one of {', '.join(_FORMS)}"
    ),
]


def expected_epochs(source: AnySource) -> int:
    """The number of epochs; of a receiver's files, which are not read to tell, that of a day of 30 s."""
    return 2880 if isinstance(source, ReceiverSource) else source.epochs


def drawn_errors_m(g: Geometry, *, draws: int, seed: int, precision: str) -> NDArray[np.float64]:
    """(draws, e, n), pseudorange errors drawn from each satellite's sigma [m]; draw k is that of `pl_mc.sample`.

    Raises:
        InputError: more draws than the first block of noise holds.
    """
    if not 1 <= draws <= LANES:
        raise InputError(f"redraws: at most {LANES - 1} are possible, not {draws - 1}.")
    options = {"draws": draws, "rows": g.sigma_m.shape[1], "dtype": dtype_of(precision)}
    with precision_scope(precision):
        unit = np.asarray(_unit_errors(np.uint32(seed), np.asarray(g.epoch, np.uint32), **options))
    return np.moveaxis(unit, -1, 0).astype(np.float64) * np.where(g.in_view, g.sigma_m, 0.0)


@functools.partial(jax.jit, static_argnames=("draws", "rows", "dtype"))
def _unit_errors(seed: Array, epoch: Array, *, draws: int, rows: int, dtype: np.dtype) -> Array:
    def one_epoch(number: Array) -> Array:
        return unit_noise(epoch_key(seed, number), jnp.int32(0), rows, dtype)[:, :draws]

    return jax.lax.map(one_epoch, epoch)


def flight_table(flight: Flight) -> pd.DataFrame:
    """One row per epoch: position, speed, climb, heading and bank."""
    latitude, longitude, height = geodetic(flight.track_m)
    return pd.DataFrame(
        {
            "epoch": np.arange(flight.time_s.size),
            "latitude_deg": np.degrees(latitude).round(8),
            "longitude_deg": np.degrees(longitude).round(8),
            "height_m": height.round(3),
            "speed_m_s": flight.speed_m_s.round(3),
            "climb_m_s": flight.climb_m_s.round(3),
            "heading_deg": (np.degrees(flight.heading_rad) % 360).round(3),
            "bank_deg": np.degrees(flight.bank_rad).round(3),
        }
    )


def where_it_is(path: Path) -> Path:
    """A file of an observation: as it is named, in the folder of receiver files, or among the package's experiments."""
    folder = os.environ.get(DATA_VARIABLE)
    folders = [*([Path(folder)] if folder else []), *PACKAGED_FOLDERS]
    places = [path, *([] if path.is_absolute() else [folder / path for folder in folders])]
    return next((place for place in places if place.is_file()), path)


def _found(field: str, path: Path) -> Path:
    """The file of a field, where it is."""
    folder = os.environ.get(DATA_VARIABLE)
    candidate = path if path.is_absolute() or not folder else Path(folder) / path
    if candidate.is_file():
        return candidate
    if path.is_absolute():
        where = "it is not there"
    elif folder:
        where = f"it is not in {folder}, which the environment variable {DATA_VARIABLE} names"
    else:
        where = (
            f"it is not in the current folder; let the environment variable {DATA_VARIABLE} name the folder of the "
            "receiver files"
        )
    raise InputError(f"source.{field}: {path}: {where}.")
