"""Faults made from tables, texts and ramps."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.faults.bias import Bias, fault_text, parse_fault
from pl_mc.faults.record import Faults, fault_label, require_satellite, seen_satellites
from pl_mc.geometry.record import SYSTEM_NAMES, Geometry, require_geometry
from pl_mc.input_errors import InputError, nearest, require_number, shown

# A ramp of more steps is a slip of the hand.
_MOST_STEPS = 1_000_000
# Words in front of a bias that make a fault of every satellite, or of every pair.
_EVERY = re.compile(r"\s*(each|pairs)\b\s*([^:]*?)\s*:(.*)")


def no_fault(g: Geometry) -> Faults:
    """The fault-free case.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> pl_mc.no_fault(g).labels
        ('none',)
    """
    return Faults.from_array(g, np.zeros((1, len(require_geometry(g).names))))


@ordinary_arithmetic
def biases(g: Geometry, bias_m: Mapping[str, float | tuple[Any, ...]] | str | Sequence[Bias]) -> Faults:
    """One fault on one or several satellites.

    Text is the label of a fault. Biases on satellites are separated by commas, each a name, a colon and a size:

    - ``G02:+30m,C11:-20m``; satellites of one bias may be named together, ``G01+G13:+30m``; a letter stands for all
      satellites of a system in view, ``G:+20m``;
    - ``G15:+0.1m/s`` grows with time, from zero at the first epoch;
    - ``G02:+30m:100-199`` counts in a window of epochs, both ends included, ``100-`` from there to the end; a ramp
      begins at its window's first epoch;
    - ``G02:uniform(5,100)m``, ``G02:normal(0,10)m`` and, of either sign, ``G02:+-30m`` and ``G02:+-uniform(5,100)m``
      are drawn anew for every draw of the noise; satellites of one bias share its size, with ``G:+20m independent``
      each draws its own, of a fixed size the sign.

    ``each:+30m`` is the fault of every satellite, one after another, ``each G:+30m`` of those of a system, and
    ``pairs:+30m`` that of every pair that is in view together at some epoch; whatever bias follows.

    Args:
        g: the geometry.
        bias_m: bias of each faulted satellite [m], ``{"G02": 30.0, "C11": -20.0}``, or its distribution as in a risk
            budget, ``{"G02": ("uniform", 5, 100)}``; text; or records of its biases, such as those of
            `pl_mc.faults.parse_fault`. ``none`` and an empty table are the fault-free case.

    Raises:
        InputError: text of another form, a satellite that is not in view or named twice, a size that is no number, a
            window outside the series, a ramp without a series of epochs.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> pl_mc.biases(g, "G08:+20m,G01:-10m").labels
        ('G08:+20m,G01:-10m',)
    """
    require_geometry(g)
    if isinstance(bias_m, str):
        return Faults.joined([_fault(g, parse_fault(text)) for text in _every(g, bias_m)])
    if isinstance(bias_m, list | tuple) and all(isinstance(one, Bias) for one in bias_m):
        return _fault(g, bias_m)
    if not isinstance(bias_m, Mapping):
        raise InputError(
            f"biases: a table by satellite such as {{'G02': 30.0}}, or text such as G02:+30m, is needed, not "
            f"{shown(bias_m)}."
        )
    by_name = dict[str, float]()
    for named, value in bias_m.items():
        names = _named_together(named)
        _require_named(g, names)
        if isinstance(value, list | tuple):
            continue
        for name in names:
            if name in by_name:
                raise InputError(f"biases: {name} is named twice.")
            by_name[name] = require_number(value, field=f"bias of {named}")
    parts = biases_of_table(bias_m)
    if any(part.drawn for part in parts) or not set(by_name) <= set(g.names):
        return _fault(g, parts)
    row = np.zeros(len(g.names))
    for name, size_m in by_name.items():
        row[g.names.index(name)] = size_m
    # The label keeps the order in which the user named the satellites.
    return replace(Faults.from_array(g, row), labels=(fault_label(by_name),))


def require_text(text: str) -> str:
    """``text`` if `biases` can read it, whatever the geometry; else an `InputError`."""
    found = _EVERY.fullmatch(text)
    if found is None:
        parse_fault(text)
    else:
        _one_bias(text, found, found[2] or "G+C")
    return text


def _one_bias(text: str, every: re.Match[str], of: str) -> Bias:
    """The bias after a word of `_EVERY`, on all that the word is about."""
    parts = parse_fault(f"{of}:{every[3]}")
    if len(parts) != 1:
        raise InputError(f"biases: {shown(text)} is no fault; one bias follows {every[1]}, such as {every[1]}:+30m.")
    return parts[0]


def biases_of_table(bias_m: Mapping[str, float | Sequence[Any]]) -> list[Bias]:
    """The biases of a table of sizes [m], or of distributions, by satellite; none of size zero."""
    parts: list[Bias] = []
    for named, value in bias_m.items():
        names = _named_together(named)
        if isinstance(value, list | tuple):
            parts.append(Bias(of=names, law=value[0] if value else "", numbers=tuple(value[1:])))
        elif round(size_m := require_number(value, field=f"bias of {named}"), 9):  # type: ignore[arg-type]
            parts += [Bias(of=(name,), numbers=(size_m,)) for name in names]
    return parts


def _named_together(named: Any) -> tuple[Any, ...]:
    return tuple(named.split("+")) if isinstance(named, str) else (named,)


def _every(g: Geometry, text: str) -> list[str]:
    """The faults that a text stands for: itself, or that of each satellite or pair."""
    found = _EVERY.fullmatch(text)
    if found is None:
        return [text]
    bias = _one_bias(text, found, found[2] or "+".join(dict.fromkeys(g.systems)))
    _require_named(g, bias.of)
    seen = seen_satellites(g.as_series(), bias.rows(g.as_series()))
    groups: list[tuple[int, ...]] = [(k,) for k in range(len(g.names)) if seen[:, k].any()]
    if found[1] == "pairs":
        pairs_of = itertools.combinations(range(len(g.names)), 2)
        groups = [pair for pair in pairs_of if seen[:, pair].all(axis=1).any()]
    if not groups:
        raise InputError(f"biases: {shown(text)}: no such satellites are in view at any epoch of it.")
    return [f"{'+'.join(g.names[k] for k in group)}:{found[3]}" for group in groups]


def _fault(g: Geometry, parts: Sequence[Bias]) -> Faults:
    """One fault of a geometry, checked to be possible in it."""
    row, shaped, placed = np.zeros(len(g.names)), False, list[tuple[Bias, float]]()
    taken: dict[str, list[Bias]] = {}
    for part in parts:
        _require_named(g, part.of)
        for name in [*part.of, *(name for name in np.array(g.names)[part.members(g)] if name not in part.of)]:
            if any(part.overlaps(other) for other in taken.setdefault(name, [])):
                raise InputError(f"biases: {name} is named twice.")
            taken[name].append(part)
        first_s = _first_time_s(g, part)
        of_system = not set(part.of) <= set(g.names)
        # Together or one by one is the same for a size that is not drawn, and is written one by one.
        alone = [part] if part.drawn or of_system else [replace(part, of=(name,)) for name in part.of]
        placed += [(one, first_s) for one in alone]
        row[part.members(g)] = np.nan if part.drawn or part.per_second else part.numbers[0]
        shaped |= part.drawn or (g.is_series and (of_system or part.per_second or part.first_epoch is not None))
    label = fault_text([one for one, _ in placed])
    return Faults(row[None], g.names, (label,), {0: tuple(placed)} if shaped else {})


def _require_named(g: Geometry, names: Sequence[str]) -> None:
    """Raise `InputError` unless each is a satellite or the letter of a system in view."""
    for name in names:
        if isinstance(name, str) and name in SYSTEM_NAMES and name not in (*g.systems, *g.names):
            which = f"none of {SYSTEM_NAMES[name]} is there ({nearest(name, dict.fromkeys(g.systems))})"
            raise InputError(f"satellite: {shown(name)} is not in view: {which}.")
        if name not in g.systems:
            require_satellite(g, name)


def _first_time_s(g: Geometry, part: Bias) -> float:
    """GPS time at which a bias begins [s], NaN where that says nothing; an `InputError` where it is not possible."""
    epochs = np.atleast_1d(g.epoch)
    first, last = int(epochs[0]), int(epochs[-1])
    begin = first if part.first_epoch is None else part.first_epoch
    during = part.during(epochs)
    outside = not first <= begin <= last or (part.last_epoch or begin) > last
    if (g.is_series and outside) or not during.any():
        run = f"epochs run from {first} to {last}" if g.is_series else f"the one epoch is {first}"
        raise InputError(f"fault {part}: {run}.")
    if not g.is_series:
        if part.per_second:
            raise InputError(f"fault {part}: a ramp in time needs a series of epochs, such as g in place of g[0].")
        return np.nan
    if not part.rows(g).any():
        present = np.unique(g.satellite[during][g.in_view[during]])
        raise InputError(
            f"fault {part}: {'+'.join(part.of)} is out of view at all epochs of the window (in view: "
            f"{', '.join(g.names[k] for k in present)})."
        )
    times_s = g.time_gps_s[during]
    if part.per_second and not np.ptp(times_s) > 0:
        why = "the geometry has no times" if np.isnan(times_s).any() else "its window is a single epoch"
        raise InputError(f"fault {part}: a ramp in time needs epochs at several times, and {why}.")
    return float(times_s[0])


@ordinary_arithmetic
def pairs(g: Geometry, first_m: float, second_m: float | None = None) -> Faults:
    """The same two biases on every pair of satellites.

    Args:
        g: the geometry.
        first_m: bias of the first satellite of each pair, in the order of ``g.names`` [m].
        second_m: bias of the second one; that of the first unless given [m].

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> len(pl_mc.pairs(g, 30.0)), pl_mc.pairs(g, 30.0, -10.0).labels[0]
        (28, 'G01:+30m,G03:-10m')
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

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> pl_mc.ramp(g, satellite="G08", start_m=5, stop_m=15, step_m=5).labels
        ('G08:+5m', 'G08:+10m', 'G08:+15m')
    """
    return ramps(g, satellites=[satellite], start_m=start_m, stop_m=stop_m, step_m=step_m)


@ordinary_arithmetic
def ramps(g: Geometry, *, satellites: Sequence[str], start_m: float, stop_m: float, step_m: float) -> Faults:
    """The same ramp on each of several satellites, one at a time, satellite by satellite.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> pl_mc.ramps(g, satellites=("G08", "G01"), start_m=5, stop_m=10, step_m=5).labels
        ('G08:+5m', 'G08:+10m', 'G01:+5m', 'G01:+10m')
    """
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
