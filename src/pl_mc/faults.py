"""Faults: which satellites are biased, by how much.

A `Faults` record is a list of bias vectors over the satellites of a geometry, each with a label such as
``G02:+30m,C11:-20m``. In a series of epochs a fault counts in those epochs alone in which all of its satellites
are in view.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, nearest, plain_number, require_number, require_numbers, require_true, shown

NO_FAULT = "none"

# A larger bias is a slip of the unit, and cannot be computed with.
MOST_BIAS_M = 1e9

# One part of a label: satellites and their bias.
_ONE_BIAS = re.compile(r"([^:,\s]+):([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?) ?m?")

# A ramp of more steps is a slip of the hand.
_MOST_STEPS = 1_000_000


@dataclass(frozen=True)
class Faults:
    """Bias vectors over the satellites of one geometry.

    Attributes:
        bias_m: (f, m), bias that is added to each satellite's pseudorange [m], over ``names``.
        names: the m satellites, as in `Geometry.names`; for a single epoch these are its n rows.
        labels: f labels, ``G02:+30m,C11:-20m``; ``none`` where nothing is biased.
    """

    bias_m: NDArray[np.float64]
    names: tuple[str, ...]
    labels: tuple[str, ...]

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
        if self.names != other.names:
            raise InputError("faults: only faults of the same geometry can be joined.")
        return Faults(np.concatenate([self.bias_m, other.bias_m]), self.names, self.labels + other.labels)

    def only(self, k: int) -> Faults:
        """One of them alone."""
        return Faults(self.bias_m[[k]], self.names, (self.labels[k],))

    @property
    def scalar_bias_m(self) -> NDArray[np.float64]:
        """(f,), the bias where one satellite is faulted, 0 where none is, NaN where several are [m]."""
        count = (self.bias_m != 0).sum(axis=1)
        return np.where(count > 1, np.nan, self.bias_m.sum(axis=1))

    def applies(self, g: Geometry) -> NDArray[np.bool_]:
        """(epochs, f), whether all satellites of each fault are in view at each epoch of ``g``."""
        self.require_geometry(g)
        series = g.as_series()
        seen = np.zeros((len(series), len(g.names)), dtype=bool)
        epochs, rows = np.nonzero(series.in_view)
        seen[epochs, series.satellite[epochs, rows]] = True
        missing = (self.bias_m != 0).astype(np.int64) @ (~seen).T.astype(np.int64)
        return (missing == 0).T

    def require_geometry(self, g: Geometry) -> None:
        """Raise `InputError` unless these faults were made for the satellites of ``g``."""
        if self.names != require_geometry(g).names:
            raise InputError("faults: they were made for other satellites than those of this geometry.")


def fault_label(bias_by_name: Mapping[str, float]) -> str:
    """``G02:+30m,C11:-20m``; ``none`` where every bias is zero."""
    # To the nanometre, so that 0.1 + 0.2 reads as it was meant.
    parts = [f"{name}:{plain_number(round(float(bias), 9), sign=True)}m" for name, bias in bias_by_name.items() if bias]
    return ",".join(parts) or NO_FAULT


def no_fault(g: Geometry) -> Faults:
    """The fault-free case."""
    return Faults.from_array(g, np.zeros((1, len(require_geometry(g).names))))


@ordinary_arithmetic
def biases(g: Geometry, bias_m: Mapping[str, float] | str) -> Faults:
    """One fault on one or several satellites.

    Args:
        g: the geometry.
        bias_m: bias of each faulted satellite [m], ``{"G02": 30.0, "C11": -20.0}``, or the same as text, which is its
            label: ``"G02:+30m,C11:-20m"``. Satellites of one bias may be named together, ``G01+G13``, and all of a
            system at one epoch by its letter, ``G``. ``none`` and an empty table are the fault-free case.

    Raises:
        InputError: text of another form, a satellite that is not in view or named twice, a bias that is no number.
    """
    require_geometry(g)
    if not isinstance(bias_m, str | Mapping):
        raise InputError(
            f"biases: a table by satellite such as {{'G02': 30.0}}, or text such as G02:+30m, is needed, not "
            f"{shown(bias_m)}."
        )
    by_name: dict[str, float] = {}
    for named, value in _read_fault(bias_m) if isinstance(bias_m, str) else bias_m.items():
        for name in _satellites_of(g, named):
            if name in by_name:
                raise InputError(f"biases: {name} is named twice.")
            by_name[name] = require_number(value, field=f"bias of {named}")
    row = np.zeros(len(g.names))
    for name, value in by_name.items():
        row[require_satellite(g, name)] = value
    faults = Faults.from_array(g, row[None])
    # The label keeps the order in which the user named the satellites.
    return Faults(faults.bias_m, faults.names, (fault_label(by_name),))


def _read_fault(text: str) -> list[tuple[str, float]]:
    """The biases of a label, in order."""
    found: list[tuple[str, float]] = []
    for part in [] if text.strip() == NO_FAULT else text.split(","):
        one = _ONE_BIAS.fullmatch(part.strip())
        if one is None:
            raise InputError(
                f"biases: {shown(part)} is no fault; the form is G02:+30m, several satellites G01+G13:+30m or "
                "G01:+30m,C08:-20m, all of a system G:+20m."
            )
        found.append((one[1], float(one[2])))
    return found


def _satellites_of(g: Geometry, named: str) -> list[str]:
    """The satellites that a name, several joined by a plus sign, or the letter of a system stand for."""
    names: list[str] = []
    for name in named.split("+") if isinstance(named, str) else [named]:
        if name in g.systems and name not in g.names:
            if g.is_series:
                raise InputError(
                    f"biases: all satellites of {name} at once are a fault of one epoch, such as g[0]: a fault counts "
                    "where all of its satellites are in view."
                )
            names += [one for one, system in zip(g.names, g.systems, strict=True) if system == name]
        else:
            names.append(name)
    return names


@ordinary_arithmetic
def pairs(g: Geometry, first_m: float, second_m: float | None = None) -> Faults:
    """The same two biases on every pair of satellites.

    Args:
        g: the geometry.
        first_m: bias of the first satellite of each pair, in the order of ``g.names`` [m].
        second_m: bias of the second one; that of the first unless given [m].
    """
    n = len(require_geometry(g).names)
    if n < 2:
        raise InputError(f"pairs: two satellites at least are needed, not {n}.")
    one, other = np.triu_indices(n, 1)
    rows = np.zeros((one.size, n))
    rows[np.arange(one.size), one] = require_number(first_m, field="first_m")
    rows[np.arange(one.size), other] = require_number(first_m if second_m is None else second_m, field="second_m")
    return Faults.from_array(g, rows)


def ramp(g: Geometry, *, satellite: str, start_m: float, stop_m: float, step_m: float) -> Faults:
    """A bias on one satellite in equal steps, both ends included where the steps meet them.

    Args:
        g: the geometry.
        satellite: name of the faulted satellite.
        start_m, stop_m, step_m: first bias, last bias and step [m].
    """
    return ramps(g, satellites=[satellite], start_m=start_m, stop_m=stop_m, step_m=step_m)


@ordinary_arithmetic
def ramps(g: Geometry, *, satellites: Sequence[str], start_m: float, stop_m: float, step_m: float) -> Faults:
    """The same ramp on each of several satellites, one at a time, satellite by satellite."""
    if isinstance(satellites, str) or not isinstance(satellites, Sequence):
        raise InputError(f"satellites: a sequence of names is needed, not {shown(satellites)}.")
    require_geometry(g)
    for name in satellites:
        # Each counts once; the same fault twice would count twice.
        if list(satellites).count(name) > 1:
            raise InputError(f"satellites: {shown(name)} is named twice.")
    sizes = ramp_sizes_m(start_m, stop_m, step_m)
    rows = np.zeros((len(satellites), sizes.size, len(g.names)))
    for k, satellite in enumerate(satellites):
        rows[k, :, require_satellite(g, satellite)] = sizes
    return Faults.from_array(g, rows.reshape(-1, len(g.names)))


def ramp_sizes_m(start_m: float, stop_m: float, step_m: float) -> NDArray[np.float64]:
    """start, start + step, ... up to stop [m]; a step of a rounding error past stop still counts."""
    start_m, stop_m, step_m = (
        require_number(value, field=f"ramp: {field}")
        for field, value in (("start_m", start_m), ("stop_m", stop_m), ("step_m", step_m))
    )
    if step_m == 0 or (stop_m - start_m) / step_m < 0:
        raise InputError(
            f"ramp: from {start_m:g} m to {stop_m:g} m in steps of {step_m:g} m: the step has to lead from the "
            "start to the stop."
        )
    if (stop_m - start_m) / step_m > _MOST_STEPS:
        raise InputError(f"ramp: it has more than {_MOST_STEPS} steps; a longer step or a shorter ramp is needed.")
    steps = int(np.floor((stop_m - start_m) / step_m + 1e-9))
    # To the nanometre: what 0.1 + 2 x 0.1 adds beyond is no part of a ramp.
    return np.round(start_m + step_m * np.arange(steps + 1, dtype=np.float64), 9)


def require_satellite(g: Geometry, name: str) -> int:
    """Index of ``name`` in ``g.names``; an `InputError` with the nearest names if it is not there."""
    if not isinstance(name, str) or name not in g.names:
        raise InputError(f"satellite: {shown(name)} is not in view ({nearest(str(name), g.names)}).")
    return g.names.index(name)


def require_faults(faults: Faults) -> Faults:
    """``faults`` if they are `Faults`; else an `InputError`."""
    if not isinstance(faults, Faults):
        kind = faults.__name__ if isinstance(faults, type) else type(faults).__name__
        raise InputError(f"faults: use ramp, biases or no_fault to make faults; {kind} is none of them.")
    return faults
