"""Faults of one geometry: which satellites are biased, by how much, and at which epochs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.faults.bias import MOST_BIAS_M, NO_FAULT, Bias
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, nearest, plain_number, require_numbers, require_true, shown


@dataclass(frozen=True)
class Faults:
    """Biases on the satellites of one geometry, fault by fault.

    Most faults are one bias on each satellite at all epochs, a row of ``bias_m``. Those that are not (in a window, a
    ramp, of a system in a series, drawn) have their biases in ``shaped`` too.

    Attributes:
        bias_m: (f, m), bias that is added to each satellite's pseudorange [m], over ``names``; NaN where it depends on
            time or is drawn.
        names: the m satellites, as in `Geometry.names`; for a single epoch these are its n rows.
        labels: f labels, ``G02:+30m,C11:-20m``; ``none`` where nothing is biased.
        shaped: by the number of such a fault its biases, each with the GPS time of its first epoch [s].

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> faults = pl_mc.no_fault(g) + pl_mc.biases(g, "G08:+20m")
        >>> faults.labels, faults.bias_m.shape
        (('none', 'G08:+20m'), (2, 8))
    """

    bias_m: NDArray[np.float64]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    shaped: Mapping[int, tuple[tuple[Bias, float], ...]] = field(default_factory=dict)

    @classmethod
    def from_array(cls, g: Geometry, bias_m: ArrayLike) -> Faults:
        """Faults from rows of biases (f, m) [m] over ``g.names``."""
        require_geometry(g)
        bias = np.atleast_2d(require_numbers(bias_m, field="bias_m"))
        if bias.ndim != 2 or bias.shape[1] != len(g.names):
            raise InputError(f"bias_m: rows of {len(g.names)} biases are needed, not shape {bias.shape}.")
        if bias.shape[0] == 0:
            raise InputError("faults: at least one fault is needed; use no_fault(g) for the fault-free case.")
        rule = f"a bias is a finite number of metres, up to {MOST_BIAS_M:g}"
        require_true(np.abs(bias) <= MOST_BIAS_M, field="bias_m", rule=rule, of=bias)
        labels = tuple(fault_label(dict(zip(g.names, row, strict=True))) for row in bias)
        return cls(bias_m=bias, names=g.names, labels=labels)

    def __len__(self) -> int:
        return len(self.labels)

    def __add__(self, other: Faults) -> Faults:
        """The faults of both, in order."""
        return Faults.joined([self, other])

    @classmethod
    def joined(cls, lists: Sequence[Faults]) -> Faults:
        """The faults of several lists, one at least, in order."""
        if any(one.names != lists[0].names for one in lists):
            raise InputError("faults: only faults of the same geometry can be joined.")
        places = itertools.accumulate(map(len, lists), initial=0)
        shaped = {
            begin + k: biases for begin, one in zip(places, lists, strict=False) for k, biases in one.shaped.items()
        }
        labels = tuple(label for one in lists for label in one.labels)
        return cls(np.concatenate([one.bias_m for one in lists]), lists[0].names, labels, shaped)

    def only(self, *chosen: int) -> Faults:
        """Some of them alone."""
        shaped = {place: self.shaped[k] for place, k in enumerate(chosen) if k in self.shaped}
        return Faults(self.bias_m[list(chosen)], self.names, tuple(self.labels[k] for k in chosen), shaped)

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """(f,), whether a bias of the fault is drawn anew for every draw of the noise."""
        drawn = np.zeros(len(self), dtype=bool)
        drawn[[k for k, biases in self.shaped.items() if any(bias.drawn for bias, _ in biases)]] = True
        return drawn

    @property
    def scalar_bias_m(self) -> NDArray[np.float64]:
        """(f,), the bias where one satellite has one, 0 where none is faulted, NaN elsewhere [m]."""
        count = (self.bias_m != 0).sum(axis=1)
        return np.where(count > 1, np.nan, self.bias_m.sum(axis=1))

    def applies(self, g: Geometry) -> NDArray[np.bool_]:
        """(epochs, f), whether each fault is one of each epoch of ``g``.

        All of its satellites are in view; of biases in windows those of the epoch count, one at least, and of a system
        the satellites that are there, one at least.
        """
        due, hidden = self._state(g)
        return due & ~hidden

    def unseen(self, g: Geometry) -> NDArray[np.bool_]:
        """(epochs, f), whether each fault would be one of an epoch, were its satellites in view."""
        due, hidden = self._state(g)
        return due & hidden

    def _state(self, g: Geometry) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(epochs, f) twice: whether a bias of the fault has its time, whether a satellite of those is out of view."""
        self.require_geometry(g)
        series = g.as_series()
        seen = seen_satellites(series, series.in_view)
        hidden = (((self.bias_m != 0).astype(np.int64) @ (~seen).T.astype(np.int64)) > 0).T
        due = np.ones(hidden.shape, dtype=bool)
        for k, biases in self.shaped.items():
            due[:, k] = hidden[:, k] = False
            for bias, _ in biases:
                during = bias.during(series.epoch)
                named = [name in bias.of for name in g.names]
                # Of a system those in view, one at least; of satellites by name each.
                there = seen[:, bias.members(g)].any(axis=1) & seen[:, named].all(axis=1)
                due[:, k] |= during
                hidden[:, k] |= during & ~there
        return due, hidden

    def require_geometry(self, g: Geometry) -> None:
        """Raise `InputError` unless these faults were made for the satellites of ``g``."""
        if self.names != require_geometry(g).names:
            raise InputError("faults: they were made for other satellites than those of this geometry.")

    def require_sizes(self, what: str) -> Faults:
        """These faults, unless one of them is drawn, which ``what`` cannot take: an `InputError`."""
        for k in np.flatnonzero(self.drawn)[:1]:
            raise InputError(
                f"faults: {self.labels[k]} is drawn anew for every draw of the noise, which {what} cannot take; give "
                "it a size, or use pl_mc.sweep."
            )
        return self


def seen_satellites(series: Geometry, rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(epochs, m), which satellites have a row that is marked in ``rows`` (epochs, n)."""
    seen = np.zeros((len(series), len(series.names)), dtype=bool)
    epochs, at = np.nonzero(rows)
    seen[epochs, series.satellite[epochs, at]] = True
    return seen


def fault_label(bias_by_name: Mapping[str, float]) -> str:
    """``G02:+30m,C11:-20m``; ``none`` where every bias is zero."""
    # To the nanometre, so that 0.1 + 0.2 reads as it was meant.
    parts = [f"{name}:{plain_number(round(float(bias), 9), sign=True)}m" for name, bias in bias_by_name.items() if bias]
    return ",".join(parts) or NO_FAULT


def require_satellite(g: Geometry, name: str) -> int:
    """Index of ``name`` in ``g.names``; an `InputError` with the nearest names if it is not there."""
    if not isinstance(name, str) or name not in g.names:
        raise InputError(f"satellite: {shown(name)} is not in view ({nearest(str(name), g.names)}).")
    return g.names.index(name)


def require_faults(faults: object) -> Faults:
    """``faults`` if they are `Faults`; else an `InputError`."""
    if not isinstance(faults, Faults):
        kind = faults.__name__ if isinstance(faults, type) else type(faults).__name__
        raise InputError(f"faults: use ramp, biases or no_fault to make faults; {kind} is none of them.")
    return faults
