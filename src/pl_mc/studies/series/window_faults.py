"""Faults in windows of epochs: which satellites, and how large at each epoch, drawn from the experiment's seed."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Annotated, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from pl_mc.engine.drawn_biases import numbers_of_draw
from pl_mc.geometry import Geometry
from pl_mc.injection import inject
from pl_mc.input_errors import InputError
from pl_mc.kernels.noise import epoch_key
from pl_mc.runtime.precision import precision_scope
from pl_mc.studies.fault_fields import ListedFaults, fields_of
from pl_mc.studies.strict import Strict

# Faults draw from the stream of an epoch number that no series reaches, so that they share nothing with the noise.
FAULT_STREAM = 2**32 - 1

Epoch = Annotated[int, Field(ge=0)]


@dataclass(frozen=True)
class DrawnFaults:
    """The faults of one draw over a series of e epochs and n rows.

    Attributes:
        bias_m: (e, n), bias in the rows of the geometry [m].
        faulted: (e,), whether an epoch lies in a window.
        listed: one row per faulted epoch and satellite: ``epoch, satellite, bias_m``.
        chosen: the satellites of each window.
        windows: first and last epoch of each.
        notes: sentences about satellites that are out of view in part of their window.
    """

    bias_m: NDArray[np.float64]
    faulted: NDArray[np.bool_]
    listed: pd.DataFrame
    chosen: tuple[tuple[str, ...], ...]
    windows: tuple[tuple[int, int], ...]
    notes: tuple[str, ...] = ()


class WindowFaults(Strict):
    """Random biases on random satellites in windows of epochs.

    The satellites of a window are chosen anew for each window, all choices alike, from those in view throughout it.

    Attributes:
        windows: first and last epoch of each window, both included, counted from 0.
        satellites: how many are faulted at once.
        lowest_m, highest_m: range of the sizes, which are uniform in it [m].
        size: whether a satellite's bias is drawn anew at every epoch or once for the window.
        sign: whether biases are positive, or positive and negative alike (drawn with each size).
    """

    windows: Annotated[tuple[tuple[Epoch, Epoch], ...], Field(min_length=1)]
    satellites: int = Field(default=2, ge=1)
    lowest_m: float = Field(default=5.0, ge=0)
    highest_m: float = Field(default=100.0, gt=0)
    size: Literal["every_epoch", "one_per_window"] = "every_epoch"
    sign: Literal["positive", "random"] = "positive"

    @field_validator("windows")
    @classmethod
    def _in_order(cls, windows: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
        ends = [epoch for window in windows for epoch in window]
        if any(last < first for first, last in windows) or any(
            later[0] <= earlier[1] for earlier, later in itertools.pairwise(windows)
        ):
            raise ValueError(f"windows go from a first to a last epoch, in order and apart from each other; got {ends}")
        return windows

    @field_validator("highest_m")
    @classmethod
    def _above_lowest(cls, highest_m: float, info: ValidationInfo) -> float:
        if highest_m < info.data.get("lowest_m", highest_m):
            raise ValueError(f"it is at least lowest_m, {info.data['lowest_m']:g} m")
        return highest_m

    def draw(self, g: Geometry, *, seed: int, redraw: int = 0) -> DrawnFaults:
        """The faults of one draw.

        Args:
            g: a series of epochs.
            seed: the experiment's seed.
            redraw: number of the draw; each gives other satellites and sizes.

        Raises:
            InputError: a window outside the series, or with too few satellites in view throughout it.
        """
        bias_m = np.zeros(g.sigma_m.shape)
        faulted = np.zeros(len(g), dtype=bool)
        parts, chosen = [], []
        for number, (first, last) in enumerate(self.windows):
            places = np.flatnonzero((g.epoch >= first) & (g.epoch <= last))
            if first < g.epoch[0] or last > g.epoch[-1] or places.size == 0:
                raise InputError(f"faults.windows: {first}-{last} is outside the series, {g.epoch[0]}-{g.epoch[-1]}.")
            candidates = in_view_throughout(g, places)
            if candidates.size < self.satellites:
                raise InputError(
                    f"faults.satellites: {self.satellites} are needed, but {candidates.size} are in view "
                    f"throughout epochs {first}-{last}; shorten the window or lower the number."
                )
            order, part, sign = _uniforms(seed, redraw, number, len(g.names), places.size)
            if self.size == "one_per_window":
                part, sign = (np.broadcast_to(drawn[0], drawn.shape) for drawn in (part, sign))
            picked = np.sort(candidates[np.argsort(order[candidates], kind="stable")[: self.satellites]])
            for satellite in picked:
                size_m = self.lowest_m + (self.highest_m - self.lowest_m) * part[:, satellite]
                if self.sign == "random":
                    size_m = np.where(sign[:, satellite] < 0.5, -size_m, size_m)
                row = np.argmax((g.satellite[places] == satellite) & g.in_view[places], axis=1)
                bias_m[places, row] = size_m
                columns = {"epoch": g.epoch[places], "satellite": g.names[satellite], "bias_m": size_m}
                parts.append(pd.DataFrame(columns))
            faulted[places] = True
            chosen.append(tuple(g.names[k] for k in picked))
        listed = pd.concat(parts).sort_values("epoch", kind="stable").reset_index(drop=True)
        return DrawnFaults(bias_m=bias_m, faulted=faulted, listed=listed, chosen=tuple(chosen), windows=self.windows)

    def describe(self) -> str:
        """The choices in words."""
        windows = " and ".join(f"{first}-{last}" for first, last in self.windows)
        sizes = "drawn anew at every epoch" if self.size == "every_epoch" else "one a window"
        sign = "positive" if self.sign == "positive" else "of random sign"
        return (
            f"{self.satellites} random satellites (of those in view throughout the window) in epochs {windows}, "
            f"sizes uniform from {self.lowest_m:g} to {self.highest_m:g} m, {sizes}, {sign}"
        )


class GivenFaults(ListedFaults):
    """Faults as texts or tables, all of them added to the one series; what is drawn of them anew at each epoch."""

    def draw(self, g: Geometry, *, seed: int, redraw: int = 0) -> DrawnFaults:
        """The faults with the sizes of one draw; the other arguments are those of `WindowFaults.draw`."""
        faults, _ = self.build(g)
        numbers = numbers_of_draw(g, seed=seed, draw=redraw) if faults.drawn.any() else None
        bias_m, faulted, notes = inject(g, np.zeros(g.sigma_m.shape), faults, numbers)
        if not faulted.any():
            raise InputError("faults.biases: a series needs an epoch with a fault, such as G02:+30m:100-199.")
        place, row = np.nonzero(bias_m)
        names = np.array(g.names)[g.satellite[place, row]]
        listed = pd.DataFrame({"epoch": g.epoch[place], "satellite": names, "bias_m": bias_m[place, row]})
        windows = faulted_windows(pd.DataFrame({"epoch": g.epoch, "faulted": faulted}))
        chosen = (tuple(pd.unique(listed.satellite[listed.epoch.between(*window)])) for window in windows)
        return DrawnFaults(bias_m, faulted, listed, chosen=tuple(chosen), windows=windows, notes=notes)


AnyWindowFaults = Annotated[
    Annotated[WindowFaults, Tag("Windows")] | Annotated[GivenFaults, Tag("Listed")],
    Discriminator(lambda given: "Listed" if "biases" in fields_of(given) else "Windows"),
]


def faulted_windows(epochs: pd.DataFrame) -> tuple[tuple[int, int], ...]:
    """First and last epoch of each run of faulted ones; one row per epoch: ``epoch, faulted``."""
    faulted, number = epochs.faulted.to_numpy(bool), epochs.epoch.to_numpy()
    ends = np.flatnonzero(np.diff(np.concatenate([[False], faulted, [False]]).astype(int))).reshape(-1, 2)
    return tuple((int(number[first]), int(number[stop - 1])) for first, stop in ends)


def in_view_throughout(g: Geometry, places: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices into ``g.names`` of the satellites in view at all of some epochs, given by their places."""
    seen = np.zeros((places.size, len(g.names)), dtype=bool)
    at, row = np.nonzero(g.in_view[places])
    seen[at, g.satellite[places][at, row]] = True
    return np.flatnonzero(seen.all(axis=0))


def _uniforms(
    seed: int, redraw: int, window: int, satellites: int, epochs: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Uniform numbers of one window: an order of all satellites (m,), sizes (epochs, m), signs (epochs, m)."""
    shapes = ((satellites,), (epochs, satellites), (epochs, satellites))
    with precision_scope("float64"):
        stream = epoch_key(jnp.uint32(seed), jnp.uint32(FAULT_STREAM))
        key = jax.random.fold_in(jax.random.fold_in(stream, np.uint32(redraw)), np.uint32(window))
        keys = [jax.random.fold_in(key, np.uint32(purpose)) for purpose in range(3)]
        order, sizes, signs = (
            np.asarray(jax.random.uniform(part, shape, np.float64)) for part, shape in zip(keys, shapes, strict=True)
        )
    return order, sizes, signs
