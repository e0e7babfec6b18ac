"""Geometry: who is in view, how they are seen, and how well each is measured.

One record serves a single epoch (arrays of shape ``(n, t)`` and ``(n,)``) and a series of epochs (a leading axis,
padded with a mask to the largest satellite count), so that a day with changing satellites is one array.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.constants import EAST as EAST
from pl_mc.constants import LEAST_SIGMA_M, MOST_SIGMA_M
from pl_mc.constants import NORTH as NORTH
from pl_mc.constants import UP as UP
from pl_mc.input_errors import InputError, nearest, require_numbers, shown

if TYPE_CHECKING:
    import pandas as pd

SYSTEM_NAMES = {"G": "GPS", "C": "BeiDou", "E": "Galileo", "R": "GLONASS", "J": "QZSS"}

POSITION_UNKNOWNS = 3

# Rows that were printed with two decimals are still taken.
_LENGTH_TOLERANCE = 0.01
# Clocks in seconds have the speed of light in their column.
_MOST_PER_CLOCK = 1e9


def _static() -> Any:
    return field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True, repr=False)
class Geometry:
    """Design rows, standard deviations and names of the satellites in view, for one epoch or a series of epochs.

    Rows beyond an epoch's satellites are padding: ``in_view`` is False, the design row is zero, sigma is 1.
    ``...`` stands for nothing (a single epoch) or for one leading axis of epochs.

    Attributes:
        design: (..., n, t), partial derivatives of each pseudorange: minus line of sight in east, north, up,
            then one clock column per system of ``clocks`` [m/m].
        sigma_m: (..., n), standard deviation of each pseudorange error [m].
        in_view: (..., n), True where the row is a satellite.
        satellite: (..., n), index into ``names`` of the satellite of each row.
        epoch: (...), epoch number, counted from 0 within the series that the geometry was made from.
        time_gps_s: (...), time since 1980-01-06 in GPS time [s]; NaN where the geometry has no date.
        names: satellites that appear in any epoch ("G02"); for a single epoch exactly its rows, in order.
        systems: RINEX letter of each satellite of ``names``.
        clocks: RINEX letters of each clock column; several letters ("GC") where systems share a clock.
        notes: sentences about what the file behind the geometry lacks.

    Example:
        >>> import pl_mc
        >>> pl_mc.simulate(site="CUT0", epochs=1)[0]
        Geometry(epoch 0, 16 satellites: GPS, BeiDou)
    """

    design: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    in_view: NDArray[np.bool_]
    satellite: NDArray[np.int32]
    epoch: NDArray[np.int64]
    time_gps_s: NDArray[np.float64]
    names: tuple[str, ...] = _static()
    systems: tuple[str, ...] = _static()
    clocks: tuple[str, ...] = _static()
    notes: tuple[str, ...] = field(default=(), compare=False, metadata={"static": True})

    @classmethod
    @ordinary_arithmetic
    def from_arrays(
        cls, design: ArrayLike, sigma_m: ArrayLike, systems: Sequence[str], names: Sequence[str]
    ) -> Geometry:
        """One epoch from plain arrays.

        Args:
            design: (n, t), ENU columns (minus line of sight) followed by clock columns [m/m].
            sigma_m: (n,), standard deviations [m].
            systems: n RINEX letters (G, C, E, R).
            names: n distinct satellite names.

        Raises:
            InputError: shapes that do not fit, rows that are no unit vectors (within 1 %), a sigma that is no
                length, a column of zeros, fewer satellites than unknowns, or columns that depend on each other.
        """
        design = require_numbers(design, field="design")
        sigma = require_numbers(sigma_m, field="sigma_m")
        if design.ndim != 2:
            raise InputError(f"design: two axes (satellites, unknowns) are needed, not shape {design.shape}.")
        n, t = design.shape
        names, systems = as_words("names", names), as_words("systems", systems)
        for label, got in (("sigma_m", sigma.shape), ("systems", (len(systems),)), ("names", (len(names),))):
            if got != (n,):
                raise InputError(f"{label}: one entry per design row is needed, ({n},), not {got}.")
        _check_satellites(names, systems)
        if t <= POSITION_UNKNOWNS:
            raise InputError(f"design: three position columns and at least one clock are needed, not {t} columns.")
        _require_rows(design, sigma, np.array(names))
        zero = np.flatnonzero(~design.any(axis=0))
        if zero.size:
            raise InputError(f"design: column {zero[0]} is all zeros, so its unknown cannot be estimated.")
        if n < t:
            raise InputError(f"design: {n} satellites cannot determine {t} unknowns; at least {t} are needed.")
        rank = np.linalg.matrix_rank(design / sigma[:, None])
        if rank < t:
            raise InputError(f"design: its {t} columns depend on each other (rank {rank}); no position follows.")
        return cls(
            design=design, sigma_m=sigma, in_view=np.ones(n, dtype=bool), satellite=np.arange(n, dtype=np.int32),
            epoch=np.asarray(0), time_gps_s=np.asarray(np.nan), names=names, systems=systems,
            clocks=_clock_letters(design, systems),
        )  # fmt: skip

    @classmethod
    @ordinary_arithmetic
    def from_rows(
        cls,
        *,
        design: NDArray[np.float64],
        sigma_m: NDArray[np.float64],
        in_view: NDArray[np.bool_],
        names: Sequence[str],
        systems: Sequence[str],
        clocks: Sequence[str],
        epoch: ArrayLike | None = None,
        time_gps_s: ArrayLike | None = None,
        notes: Sequence[str] = (),
    ) -> Geometry:
        """A series of epochs from one row per known satellite, packed to the largest number in view at once.

        Args:
            design: (epochs, m, t), a row for each of the m satellites of ``names``, whether in view or not.
            sigma_m: (epochs, m), standard deviations [m].
            in_view: (epochs, m), which rows count.
            names, systems: the m satellites and their RINEX letters.
            clocks: RINEX letters of each clock column.
            epoch: (epochs,), epoch numbers; 0, 1, 2, ... unless given.
            time_gps_s: (epochs,), GPS time [s].
            notes: sentences about what the file behind the geometry lacks.

        Satellites never in view are left out. Epochs may have fewer satellites than unknowns: a sweep counts them
        as unavailable.
        """
        design, sigma_m = require_numbers(design, field="design"), require_numbers(sigma_m, field="sigma_m")
        in_view = as_mask(in_view)
        names, systems, clocks = (
            as_words(label, words) for label, words in (("names", names), ("systems", systems), ("clocks", clocks))
        )
        m, t = len(names), POSITION_UNKNOWNS + len(clocks)
        if design.ndim != 3 or design.shape[1:] != (m, t):
            raise InputError(
                f"design: {m} names and {len(clocks)} clocks need the shape (epochs, {m}, {t}), not {design.shape}."
            )
        epochs = design.shape[0]
        for label, got in (("sigma_m", sigma_m.shape), ("in_view", in_view.shape)):
            if got != (epochs, m):
                raise InputError(f"{label}: its shape is (epochs, satellites), {(epochs, m)}, not {got}.")
        if len(systems) != m:
            raise InputError(f"systems: one letter per name is needed, {m}, not {len(systems)}.")
        _check_satellites(names, systems)
        numbers = np.arange(epochs) if epoch is None else _as_epoch_numbers(epoch, epochs)
        times = np.full(epochs, np.nan) if time_gps_s is None else require_numbers(time_gps_s, field="time_gps_s")
        if times.shape != (epochs,):
            raise InputError(f"time_gps_s: one time per epoch is needed, ({epochs},), not {times.shape}.")
        if not in_view.any():
            raise InputError("geometry: no satellite is in view at any epoch.")
        _require_rows(design[in_view], sigma_m[in_view], np.array(names)[in_view.nonzero()[1]])
        seen = np.flatnonzero(in_view.any(axis=0)).tolist()
        design, sigma_m, in_view = design[:, seen], sigma_m[:, seen], in_view[:, seen]
        width = int(in_view.sum(axis=1).max())
        # A stable sort puts the satellites in view first and keeps their order.
        order = np.argsort(~in_view, axis=1, kind="stable")[:, :width]
        mask = np.take_along_axis(in_view, order, axis=1)
        rows = np.take_along_axis(design, order[:, :, None], axis=1)
        return cls(
            design=np.where(mask[:, :, None], rows, 0.0),
            sigma_m=np.where(mask, np.take_along_axis(sigma_m, order, axis=1), 1.0),
            in_view=mask,
            satellite=np.where(mask, order, 0).astype(np.int32),
            epoch=numbers,
            time_gps_s=times,
            names=tuple(names[i] for i in seen),
            systems=tuple(systems[i] for i in seen),
            clocks=clocks,
            notes=tuple(notes),
        )

    @property
    def is_series(self) -> bool:
        """Whether there is a leading axis of epochs."""
        return self.design.ndim == 3

    @property
    def satellite_count(self) -> NDArray[np.int64]:
        """(...), number of satellites in view."""
        return np.asarray(self.in_view).sum(axis=-1)

    @property
    def unknown_count(self) -> NDArray[np.int64]:
        """(...), number of unknowns, three coordinates and the clocks that some satellite in view observes."""
        clocks = np.asarray(self.design)[..., POSITION_UNKNOWNS:]
        return POSITION_UNKNOWNS + clocks.any(axis=-2).sum(axis=-1)

    @property
    def elevation_rad(self) -> NDArray[np.float64]:
        """(..., n), elevation angles [rad], from the up component of the line of sight."""
        return np.arcsin(np.clip(-np.asarray(self.design)[..., UP], -1.0, 1.0))

    @property
    def azimuth_rad(self) -> NDArray[np.float64]:
        """(..., n), azimuths, clockwise from north [rad]."""
        rows = np.asarray(self.design)
        return np.arctan2(-rows[..., EAST], -rows[..., NORTH]) % (2 * np.pi)

    def __iter__(self) -> Iterator[Geometry]:
        """The epochs, one by one."""
        return (self[k] for k in range(len(self)))

    def __len__(self) -> int:
        """Number of epochs."""
        return self.design.shape[0] if self.is_series else 1

    def __getitem__(self, index: int | slice) -> Geometry:
        """One epoch (an integer: no padding, names are its rows) or a shorter series (a slice)."""
        if not self.is_series:
            raise InputError("geometry: a single epoch has no further epochs to choose from.")
        if isinstance(index, slice):
            if len(range(*index.indices(len(self)))) == 0:
                raise InputError(f"geometry: the slice {index.start}:{index.stop} holds no epoch of {len(self)}.")
            return replace(self, **{name: getattr(self, name)[index] for name in _ARRAYS})
        if not isinstance(index, int | np.integer) or isinstance(index, bool):
            raise InputError(f"geometry: an epoch is chosen by a whole number or a slice, not {shown(index)}.")
        if not -len(self) <= index < len(self):
            raise InputError(f"geometry: epoch index {index} is outside 0 to {len(self) - 1}.")
        rows = np.flatnonzero(self.in_view[index])
        kept = self.satellite[index][rows]
        design = self.design[index][rows]
        columns = design.any(axis=0)
        columns[:POSITION_UNKNOWNS] = True
        return Geometry(
            design=design[:, columns],
            sigma_m=self.sigma_m[index][rows],
            in_view=np.ones(rows.size, dtype=bool),
            satellite=np.arange(rows.size, dtype=np.int32),
            epoch=np.asarray(self.epoch[index]),
            time_gps_s=np.asarray(self.time_gps_s[index]),
            names=tuple(self.names[i] for i in kept),
            systems=tuple(self.systems[i] for i in kept),
            clocks=tuple(c for c, used in zip(self.clocks, columns[POSITION_UNKNOWNS:], strict=True) if used),
            notes=self.notes,
        )

    def sel(self, satellite: str | Sequence[str]) -> Geometry:
        """The same epochs with some satellites alone, in the order of the geometry.

        Args:
            satellite: a name or several.

        Raises:
            InputError: a name that is nowhere in view, or none.
        """
        wanted = (satellite,) if isinstance(satellite, str) else as_words("satellite", satellite)
        for name in wanted:
            if name not in self.names:
                raise InputError(f"satellite: {shown(name)} is not in view ({nearest(name, self.names)}).")
        chosen = np.array([name in wanted for name in self.names])
        series, m = self.as_series(), len(self.names)
        place, row = np.nonzero(series.in_view & chosen[series.satellite])
        of = series.satellite[place, row]
        design = np.zeros((len(series), m, series.design.shape[2]))
        sigma_m, in_view = np.ones((len(series), m)), np.zeros((len(series), m), bool)
        design[place, of], sigma_m[place, of] = series.design[place, row], series.sigma_m[place, row]
        in_view[place, of] = True
        left = Geometry.from_rows(
            design=design, sigma_m=sigma_m, in_view=in_view, names=self.names, systems=self.systems,
            clocks=self.clocks, epoch=series.epoch, time_gps_s=series.time_gps_s, notes=self.notes,
        )  # fmt: skip
        return left if self.is_series else left[0]

    def to_frame(self) -> pd.DataFrame:
        """A table with a row for each satellite in view at each epoch.

        Returns:
            ``epoch, time_gps_s, satellite, system, elevation_deg, azimuth_deg, sigma_m``.
        """
        import pandas as pd

        series = self.as_series()
        place, row = np.nonzero(series.in_view)
        of = series.satellite[place, row]
        degrees = {"elevation_deg": series.elevation_rad, "azimuth_deg": series.azimuth_rad}
        return pd.DataFrame({
            "epoch": series.epoch[place],
            "time_gps_s": series.time_gps_s[place],
            "satellite": np.array(self.names, dtype=object)[of],
            "system": np.array(self.systems, dtype=object)[of],
            **{name: np.degrees(angle[place, row]) for name, angle in degrees.items()},
            "sigma_m": series.sigma_m[place, row],
        })  # fmt: skip

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset`` over ``epoch`` and ``satellite``; NaN where a satellite is not in view.

        Raises:
            InputError: xarray is not installed.
        """
        if importlib.util.find_spec("xarray") is None:
            raise InputError("to_xarray: it needs the package xarray, which is not installed; to_frame needs none.")
        table = self.to_frame()
        cube = table[["epoch", "satellite", "elevation_deg", "azimuth_deg", "sigma_m"]]
        whole = cube.set_index(["epoch", "satellite"]).to_xarray()
        whole = whole.reindex(epoch=self.as_series().epoch, satellite=list(self.names))
        return whole.assign_coords(
            time_gps_s=("epoch", self.as_series().time_gps_s), system=("satellite", list(self.systems))
        )

    def __repr__(self) -> str:
        """``Geometry(2880 epochs, 12-20 satellites at once, 22 in all: GPS, BeiDou)``."""
        count, systems = self.as_series().satellite_count, dict.fromkeys(self.systems)
        known = ", ".join(SYSTEM_NAMES.get(letter, letter) for letter in systems)
        if not self.is_series:
            return f"Geometry(epoch {int(self.epoch)}, {int(count[0])} satellites: {known})"
        at_once = f"{count.min()}" if count.min() == count.max() else f"{count.min()}-{count.max()}"
        return f"Geometry({len(self)} epochs, {at_once} satellites at once, {len(self.names)} in all: {known})"

    def as_series(self) -> Geometry:
        """The same geometry with an axis of epochs, of length one for a single epoch."""
        if self.is_series:
            return self
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name))[None] for name in _ARRAYS}
        return replace(self, **arrays)


_ARRAYS = ("design", "sigma_m", "in_view", "satellite", "epoch", "time_gps_s")


def require_geometry(g: Geometry) -> Geometry:
    """``g`` if it is a `Geometry`; else an `InputError`."""
    if not isinstance(g, Geometry):
        kind = g.__name__ if isinstance(g, type) else type(g).__name__
        raise InputError(f"geometry: a pl_mc Geometry is needed, not {kind}.")
    return g


def as_mask(in_view: ArrayLike) -> NDArray[np.bool_]:
    """Which rows count (...), from truth values or numbers."""
    if isinstance(in_view, np.ndarray) and in_view.dtype == bool:
        return in_view
    try:
        given = np.asarray(in_view)
    except ValueError:
        given = np.asarray(None)
    return given if given.dtype == bool else require_numbers(in_view, field="in_view") != 0


def as_words(field_name: str, value: Sequence[str]) -> tuple[str, ...]:
    """Names or letters, one by one; a word of letters is a sequence of them."""
    try:
        words: tuple[object, ...] = tuple(value)
    except TypeError:
        words = (value,)
    if not all(isinstance(word, str) for word in words):
        raise InputError(f"{field_name}: a sequence of names is needed, not {shown(value)}.")
    return tuple(map(str, words))


def _as_epoch_numbers(value: ArrayLike, epochs: int) -> NDArray[np.int64]:
    numbers = require_numbers(value, field="epoch")
    whole = np.isfinite(numbers) & (numbers >= 0) & (numbers == np.floor(numbers)) & (numbers < 2**53)
    # Noise is found by epoch number: two epochs of one number would share theirs.
    if numbers.shape != (epochs,) or not whole.all() or np.unique(numbers).size != epochs:
        raise InputError(f"epoch: {epochs} different whole numbers, none negative, are needed.")
    return numbers.astype(np.int64)


def _require_rows(design: NDArray[np.float64], sigma_m: NDArray[np.float64], names: NDArray[np.str_]) -> None:
    """Raise `InputError` with the first satellite whose row (m, t) or sigma (m,) cannot be one."""
    usual = (sigma_m >= LEAST_SIGMA_M) & (sigma_m <= MOST_SIGMA_M)
    bounds = f"a sigma is finite and positive, {LEAST_SIGMA_M:g} to {MOST_SIGMA_M:g} m"
    finite = np.isfinite(design).all(axis=1)
    length = np.sqrt((np.where(np.abs(design) < 2.0, design, 2.0)[:, :POSITION_UNKNOWNS] ** 2).sum(axis=1))
    clocks = np.abs(design[:, POSITION_UNKNOWNS:]).max(axis=1, initial=0.0)
    for k in np.flatnonzero(~usual):
        raise InputError(f"sigma_m: {names[k]} has {sigma_m[k]:g}; {bounds}.")
    for k in np.flatnonzero(~finite):
        raise InputError(f"design: the row of {names[k]} is not finite.")
    for k in np.flatnonzero(~(np.abs(length - 1.0) <= _LENGTH_TOLERANCE)):
        raise InputError(
            f"design: the row of {names[k]} starts with a vector of length {length[k]:.4g}; east, north and up of a "
            "line of sight are a unit vector, and the clock columns follow it."
        )
    for k in np.flatnonzero(~(clocks <= _MOST_PER_CLOCK)):
        raise InputError(f"design: the row of {names[k]} has {clocks[k]:g} in a clock column; 0 and 1 are usual.")


def _check_satellites(names: tuple[str, ...], systems: tuple[str, ...]) -> None:
    unknown = [s for s in systems if s not in SYSTEM_NAMES]
    if unknown:
        raise InputError(f"systems: {unknown[0]!r} is unknown (valid: {', '.join(SYSTEM_NAMES)}).")
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise InputError(f"names: {sorted(repeated)[0]!r} appears more than once.")


def _clock_letters(design: NDArray[np.float64], systems: tuple[str, ...]) -> tuple[str, ...]:
    """The systems that each clock column serves, read off its nonzero rows."""
    letters = np.array(systems)
    return tuple("".join(dict.fromkeys(letters[column != 0].tolist())) for column in design.T[POSITION_UNKNOWNS:])
