"""Errors that a receiver really had: draws from its whitened errors, pass by pass.

A pass is a satellite's way up or down. A draw takes for each satellite of a geometry a pass of the data by chance, and
of that pass the error at the satellite's own elevation; epochs that are drawn together take the same pass, so that
errors go on in time as they did, depend on elevation as they did, and are distributed as they were. (A bootstrap of
blocks, Künsch 1989, Annals of Statistics 17:1217-1241, whose blocks are passes.) Satellites are independent of each
other.
"""

from __future__ import annotations

import functools
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array
from jax.scipy.special import ndtr

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import UP
from pl_mc.input_errors import InputError, hold_whole, shown
from pl_mc.kernels import LinearModel
from pl_mc.noise_models.base import OneNumber
from pl_mc.runtime.small_files import read_bytes, shown_reason

COLUMNS = ("satellite", "time_gps_s", "elevation_deg", "whitened")

# Cells of elevation: a satellite in a medium orbit crosses one in half a minute.
_CELL_DEG = 0.1
_CELLS = 901
# A pass ends where its satellite is away for so many steps; one that hardly climbs is cut into pieces, since of the
# samples in a cell a pass has one.
_STEPS_AWAY = 10
_SAMPLES_A_CELL = 40
_FEWEST_SAMPLES = 100
_MOST_BYTES = 200_000_000


@dataclass(frozen=True)
class Empirical(OneNumber):
    """Errors of a file, whitened: over the sigma that was believed there, and times the one that is believed here.

    Nothing is ever drawn beyond what the file has, so that rare events are none of its business: `pl_mc.risk` refuses
    it.

    Attributes:
        file: a table (``.csv`` or ``.parquet``) with ``satellite, time_gps_s, elevation_deg, whitened``, as
            `pl_mc.receiver.ReceiverSeries.residuals` makes it.
        epochs_together: epochs one after the other that share their passes; 1 draws every epoch apart.
        digest: of the content of the file, found when the record is made.

    Example:
        >>> import pl_mc
        >>> try:
        ...     pl_mc.empirical("residuals.csv")
        ... except pl_mc.InputError as said:
        ...     print(said)
        empirical: file: residuals.csv: there is no such file.
    """

    base_name = "empirical"
    has_tail = False

    file: str = ""
    epochs_together: int = 60
    digest: str = field(init=False, default="")

    def __post_init__(self) -> None:
        if not isinstance(self.file, str | Path) or not str(self.file):
            raise InputError(f"empirical: file: the name of a table is needed, not {shown(self.file)}.")
        object.__setattr__(self, "file", str(self.file))
        hold_whole(self, "epochs_together", low=1, high=10**6, field="empirical: epochs_together")
        try:
            content = read_bytes(Path(self.file), most_bytes=_MOST_BYTES)
        except FileNotFoundError:
            raise InputError(f"empirical: file: {self.file}: there is no such file.") from None
        object.__setattr__(self, "digest", hashlib.sha256(content).hexdigest()[:12])
        passes_of(self)

    @property
    def inputs_per_row(self) -> int:
        return 2

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        passes = passes_of(self)
        inverse_sigma = model.weight_root
        sine = -model.design[:, UP] / jnp.where(inverse_sigma > 0, inverse_sigma, 1.0)
        elevation_deg = jnp.degrees(jnp.arcsin(jnp.clip(sine, -1.0, 1.0)))
        cell = jnp.clip(jnp.round(elevation_deg / _CELL_DEG).astype(jnp.int32), 0, _CELLS - 1)[:, None]
        whole = jnp.asarray(passes.errors, units[0].dtype)
        # The pass that was drawn, where it comes to this elevation; else one of those that do.
        drawn = _choice(units[0], jnp.full_like(cell, whole.shape[1]))
        there = jnp.asarray(passes.count)[cell]
        other = jnp.asarray(passes.order)[cell, _choice(units[1], there)]
        taken = jnp.where(jnp.asarray(passes.reaches)[cell, drawn], drawn, other)
        return whole[cell, taken]


def _choice(unit: Array, count: Array) -> Array:
    """One of ``count`` by the probability of a standard normal number; all are as likely."""
    return jnp.clip((ndtr(unit) * count).astype(jnp.int32), 0, count - 1)


@dataclass(frozen=True, eq=False)
class Passes:
    """Errors by cell of elevation (c) and pass (p).

    Attributes:
        errors: (c, p), over sigma; 0 where the pass does not come.
        reaches: (c, p), whether it does.
        order: (c, p), the passes that do, then the others.
        count: (c,), how many do; of a cell that none reaches those of the nearest one that some do.
    """

    errors: FloatArray
    reaches: np.ndarray
    order: np.ndarray
    count: np.ndarray


def passes_of(noise: Empirical) -> Passes:
    """The passes of a file, read once for each content."""
    return _passes(noise.file, noise.digest)


@functools.lru_cache(maxsize=8)
def _passes(file: str, digest: str) -> Passes:
    table = _table(file)
    times, step_of = np.unique(table.time_gps_s, return_inverse=True)
    step_s = float(np.median(np.diff(times))) if times.size > 1 else 1.0
    found: list[tuple[Any, Any]] = []
    for _, rows in table.assign(step=step_of).groupby("satellite", sort=True):
        rows = rows.sort_values("time_gps_s")
        away = np.flatnonzero(np.diff(rows.time_gps_s) > _STEPS_AWAY * step_s) + 1
        for part in np.split(np.arange(len(rows)), away):
            elevation, error = rows.elevation_deg.to_numpy()[part], rows.whitened.to_numpy()[part]
            top = int(np.argmax(elevation)) + 1
            for one in (slice(0, top), slice(top, None)):
                found += _pieces(elevation[one], error[one])
    errors, reaches = np.zeros((_CELLS, len(found))), np.zeros((_CELLS, len(found)), bool)
    for k, (elevation, error) in enumerate(found):
        order = np.argsort(elevation, kind="stable")
        elevation, error = elevation[order], error[order]
        first, last = (int(np.clip(round(e / _CELL_DEG), 0, _CELLS - 1)) for e in (elevation[0], elevation[-1]))
        centre = _CELL_DEG * np.arange(first, last + 1)
        nearest = np.abs(elevation[:, None] - centre).argmin(axis=0)
        errors[first : last + 1, k], reaches[first : last + 1, k] = error[nearest], True
    # Below the lowest and above the highest elevation of all passes those nearby stand in.
    some = np.flatnonzero(reaches.any(axis=1))
    source = some[np.abs(some[:, None] - np.arange(_CELLS)).argmin(axis=0)]
    errors, reaches = errors[source], reaches[source]
    order = np.argsort(~reaches, axis=1, kind="stable").astype(np.int32)
    return Passes(errors, reaches, order, reaches.sum(axis=1).astype(np.int32))


def _pieces(elevation: FloatArray, error: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """A pass, or what it is cut into where its satellite hardly moves."""
    if not elevation.size:
        return []
    cells = 1 + int(np.ptp(elevation) / _CELL_DEG)
    count = max(1, -(-elevation.size // (_SAMPLES_A_CELL * cells)))
    return list(zip(np.array_split(elevation, count), np.array_split(error, count), strict=True))


def _table(file: str) -> pd.DataFrame:
    content = io.BytesIO(read_bytes(Path(file), most_bytes=_MOST_BYTES))
    try:
        table = pd.read_parquet(content) if file.lower().endswith(".parquet") else pd.read_csv(content)
    except Exception as error:
        raise InputError(f"empirical: file: {file}: it is no table ({shown_reason(str(error))}).") from None
    absent = [name for name in COLUMNS if name not in table]
    if absent:
        raise InputError(f"empirical: file: {file}: columns {', '.join(COLUMNS)} are needed; {absent[0]} is not there.")
    table = table[list(COLUMNS)]
    for name in COLUMNS[1:]:
        if not pd.api.types.is_numeric_dtype(table[name]) or not np.isfinite(table[name]).all():
            raise InputError(f"empirical: file: {file}: {name}: a finite number is needed in every row.")
    if not table.elevation_deg.between(0.0, 90.0).all():
        raise InputError(f"empirical: file: {file}: elevation_deg: each is between 0 and 90 degrees.")
    if len(table) < _FEWEST_SAMPLES:
        raise InputError(f"empirical: file: {file}: at least {_FEWEST_SAMPLES} errors are needed, not {len(table)}.")
    return table.astype({"satellite": str})
