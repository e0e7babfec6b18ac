"""Injection: faults made biases, row by row and epoch by epoch, and added to the errors of a real receiver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.deprecated import MOVED, moved_names, warn
from pl_mc.faults import Bias, Faults, parse_fault, require_faults
from pl_mc.faults import biases as one_fault
from pl_mc.faults.bias import FIXED, NORMAL, UNIFORM
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, require_numbers


@dataclass(frozen=True)
class DrawnRows:
    """What is drawn of biases, row by row; the arrays have one shape (..., n).

    A bias is ``start_m + spread_m z`` with a standard normal number z, or ``start_m + spread_m Phi(z)`` where it is
    ``uniform``; with the sign of another one where it is of ``either`` sign. Rows without a drawn bias have zeros.

    Attributes:
        start_m, spread_m: [m].
        uniform, either: as above.
        of: the row whose numbers a row takes; its own, or the first row of those that share a size.
    """

    start_m: FloatArray
    spread_m: FloatArray
    uniform: NDArray[np.bool_]
    either: NDArray[np.bool_]
    of: NDArray[np.int32]

    def at(self, places: NDArray[np.int64]) -> DrawnRows:
        """Those of some places along the first axis."""
        return DrawnRows(*(part[places] for part in vars(self).values()))


def row_biases(
    series: Geometry, faults: Faults, places: NDArray[np.int64], index: NDArray[np.int64]
) -> tuple[FloatArray, DrawnRows | None]:
    """Biases of faults in the rows of the epochs of a series.

    Args:
        series: the geometry.
        faults: made for it.
        places: (...), epochs by their place in the series.
        index: (...), faults by their number.

    Returns:
        (..., n), biases that are not drawn [m], zero on padding; and those that are, or None where none is.
    """
    satellite, seen = series.satellite[places], series.in_view[places]
    bias_m = faults.bias_m[index[..., None], satellite]
    drawn = None
    if faults.shaped:
        places, index = np.broadcast_arrays(places, index)
        own = np.broadcast_to(np.arange(seen.shape[-1], dtype=np.int32), bias_m.shape)
        if faults.drawn.any():
            metres, flags = np.zeros((2, *bias_m.shape)), np.zeros((2, *bias_m.shape), dtype=bool)
            drawn = DrawnRows(metres[0], metres[1], flags[0], flags[1], own.copy())
    for k, biases in faults.shaped.items():
        at = np.nonzero(index == k)
        fixed_m = np.zeros((len(at[0]), seen.shape[-1]))
        for bias, first_s in biases:
            rows = bias.rows(series, places[at])
            scale = (series.time_gps_s[places[at]] - first_s)[:, None] if bias.per_second else 1.0
            if not bias.drawn:
                fixed_m += np.where(rows, scale * bias.numbers[0], 0.0)
            elif drawn is not None:
                _add(drawn, bias, at, rows, scale)
        bias_m[at] = fixed_m
    return np.where(seen, bias_m, 0.0), drawn


def at_epoch(g: Geometry, faults: Faults, place: int) -> FloatArray:
    """(f, m), the biases of each satellite at an epoch of a series, by its place [m]; zero where it is out of view."""
    series, by_satellite_m = g.as_series(), np.zeros(faults.bias_m.shape)
    bias_m, _ = row_biases(series, faults.require_sizes("this function"), np.array(place), np.arange(len(faults)))
    seen = series.in_view[place]
    by_satellite_m[:, series.satellite[place, seen]] = bias_m[:, seen]
    return by_satellite_m


def _add(drawn: DrawnRows, bias: Bias, at: Any, rows: NDArray[np.bool_], scale: Any) -> None:
    """A drawn bias into the arrays, at some places (p,) and the rows there (p, n)."""
    start, spread = {
        FIXED: (bias.numbers[0], 0.0),
        UNIFORM: (bias.numbers[0], bias.numbers[-1] - bias.numbers[0]),
        NORMAL: (bias.numbers[0], bias.numbers[-1]),
    }[bias.law]
    values = (
        (drawn.start_m, scale * start), (drawn.spread_m, scale * spread), (drawn.uniform, bias.law == UNIFORM),
        (drawn.either, bias.either_sign or bias.law == FIXED),
        (drawn.of, drawn.of[at] if bias.independent else np.argmax(rows, axis=1)[:, None]),
    )  # fmt: skip
    for array, value in values:
        array[at] = np.where(rows, value, array[at])


def drawn_m(rows: Any, numbers: Any, normal_cdf: Callable[[Any], Any]) -> Any:
    """(n, ...), the drawn biases of the rows (n) of an epoch [m], from two standard normal numbers (2, n, ...) of each.

    NumPy and JAX arrays alike; the fields of ``rows`` have the axes of the numbers, of length one beyond the first.
    """
    size, sign = numbers
    chance = size + rows.uniform * (normal_cdf(size) - size)
    return (rows.start_m + rows.spread_m * chance) * (1.0 - 2.0 * rows.either * (sign < 0))


@ordinary_arithmetic
def inject(
    g: Geometry,
    errors_m: NDArray[np.float64],
    faults: Faults | Sequence[Bias],
    numbers: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_], tuple[str, ...]]:
    """Add faults to the errors of a series, all of them together.

    Args:
        g: a series of epochs.
        errors_m: (epochs, n), pseudorange errors in the rows of ``g`` [m].
        faults: the faults, such as those of ``pl_mc.biases(g, "G02:+30m:545-645")``; where a satellite has several at
            an epoch they add up.
        numbers: (epochs, 2, n), standard normal numbers that drawn sizes are made from.

    Returns:
        The errors (epochs, n) [m]; whether each epoch is faulted (epochs,); and a sentence for each fault whose
        satellites are out of view in part of its window. Those that are in view are biased then.

    Raises:
        InputError: errors of another shape, faults of another geometry, drawn ones without numbers.
    """
    errors = require_numbers(errors_m, field="errors_m")
    if errors.shape != require_geometry(g).sigma_m.shape or not g.is_series:
        raise InputError(f"errors_m: a series and errors of its shape are needed, not {errors.shape}.")
    if isinstance(faults, list | tuple) and all(isinstance(one, Bias) for one in faults):
        warn("inject of a list", MOVED["pl_mc.injection.parse_injection"])
        faults = one_fault(g, faults)
    faults = require_faults(faults)
    faults.require_geometry(g)
    if numbers is None:
        faults.require_sizes("this")
    faulted = np.zeros(len(g), dtype=bool)
    places, notes = np.arange(len(g)), []
    for k, hidden in enumerate(faults.unseen(g).T):
        bias_m, drawn = row_biases(g, faults, places, np.full(len(g), k))
        if drawn is not None and numbers is not None:
            taken = np.take_along_axis(numbers, drawn.of[:, None], axis=2)
            bias_m = bias_m + drawn_m(drawn, np.moveaxis(taken, 1, 0), special.ndtr)
        errors += bias_m
        faulted |= _biased(g, faults, k)
        if hidden.any():
            due = (hidden | faults.applies(g)[:, k]).sum()
            parts = [bias.of for bias, _ in faults.shaped.get(k, ())]
            of = parts[0] if len(parts) == 1 else tuple(np.array(g.names)[faults.bias_m[k] != 0])
            names = "+".join(of) if len(of) == 1 or len(parts) == 1 else "a satellite of it"
            notes.append(f"Fault {faults.labels[k]}: {names} is out of view at {hidden.sum()} of {due} epochs.")
    return errors, faulted, tuple(notes)


def _biased(g: Geometry, faults: Faults, k: int) -> NDArray[np.bool_]:
    """(epochs,), whether a fault biases a satellite in view, a ramp at its first epoch included."""
    if k in faults.shaped:
        return np.any([bias.rows(g).any(axis=1) for bias, _ in faults.shaped[k]], axis=0)
    return ((faults.bias_m[k][g.satellite] != 0) & g.in_view).any(axis=1)


def _injection(satellite: str, bias_m: float, first_epoch: int | None = None, last_epoch: int | None = None) -> Bias:
    """What `Injection` was."""
    return Bias(of=(satellite,), numbers=(bias_m,), first_epoch=first_epoch, last_epoch=last_epoch)


def _parse_injection(text: str) -> Bias:
    """The one bias of a text, as `parse_injection` gave it."""
    (one,) = parse_fault(text)
    return one


__getattr__ = moved_names(__name__)
