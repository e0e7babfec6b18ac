"""Checks of what a sweep is asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.alert import AlertLimits, as_alert, as_limits
from pl_mc.faults import Faults, require_faults
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, require_numbers
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Method
from pl_mc.methods.capabilities import declared
from pl_mc.statistics.least_squares import ls_quantities

LARGEST_SEED = 2**32 - 1

# Blocks of noise are numbered by 32-bit integers, also those beyond the last draw that fill up the last call.
LARGEST_DRAWS = LANES * 2**30


def require_geometry_and_alert(g: Geometry, alert: str | AlertLimits, *, any_axis: bool = False) -> AlertLimits:
    """The alert limits; an `InputError` unless these are of the right kinds and a single epoch can be solved.

    ``any_axis``: limits without a vertical one will do.
    """
    require_geometry(g)
    limits = as_limits(alert) if any_axis else as_alert(alert)
    if not g.is_series and g.satellite_count < g.unknown_count:
        raise InputError(
            f"geometry: {g.satellite_count} satellites cannot determine {g.unknown_count} unknowns; at least "
            f"{g.unknown_count} are needed (in a series of epochs such an epoch counts as unavailable)."
        )
    return limits


def require_single(g: Geometry, what: str) -> None:
    """Raise `InputError` for a series of epochs."""
    if g.is_series:
        raise InputError(f"geometry: {what} is made for one epoch; choose one of the {len(g)}, such as g[0].")


def require_inputs(
    g: Geometry, faults: Faults, alert: str | AlertLimits, *, any_axis: bool = False, drawn: bool = False
) -> AlertLimits:
    """The alert limits; an `InputError` unless all are of the right kinds and belong together.

    ``drawn``: faults whose sizes are drawn will do.
    """
    limits = require_geometry_and_alert(g, alert, any_axis=any_axis)
    require_faults(faults).require_geometry(g)
    if not drawn:
        faults.require_sizes("this function")
    return limits


def require_errors(g: Geometry, errors_m: ArrayLike) -> NDArray[np.float64]:
    """(epochs, n), pseudorange errors in the rows of ``g`` as a series, zero on padding [m].

    Raises:
        InputError: numbers of another shape than ``g.sigma_m``, or not finite for a satellite in view.
    """
    errors = require_numbers(errors_m, field="errors_m")
    if errors.shape != g.sigma_m.shape:
        raise InputError(f"errors_m: the shape {g.sigma_m.shape} is needed, not {errors.shape}.")
    if not np.isfinite(errors[g.in_view]).all():
        raise InputError("errors_m: the error of every satellite in view is a finite number of metres.")
    return np.atleast_2d(np.where(g.in_view, errors, 0.0))


def solved_epochs(g: Geometry, method: Method) -> NDArray[np.bool_]:
    """(e,), epochs at which a method can have a solution; without redundancy those alone whose levels need none."""
    found = ls_quantities(g)
    prior = declared(method, "levels_without_redundancy")
    return np.atleast_1d(np.isfinite(found.vdop_m) if prior else found.available)


def notes_on_redundancy(g: Geometry, methods: Sequence[Method]) -> tuple[str, ...]:
    """Epochs at which levels stand although nothing can be tested, of methods whose levels need no redundancy."""
    names = [method.name for method in methods if declared(method, "levels_without_redundancy")]
    bare = int((g.satellite_count == g.unknown_count).sum())
    if not (names and bare):
        return ()
    of_epochs = f"{bare} of {len(g)} epochs have" if g.is_series else "The epoch has"
    return (f"{of_epochs} as many satellites as unknowns: levels of {', '.join(names)} stand there, without any test.",)


def require_bounded(g: Geometry, method: Method) -> None:
    """Raise `InputError` where no fault is the worst: a method has levels, and no residual shows any fault."""
    if notes_on_redundancy(g, (method,)):
        raise InputError(
            "geometry: where there are as many satellites as unknowns a fault of any size goes unseen, and "
            f"{method.name} has levels there, so that none is the worst (nearest: an epoch with a satellite more)."
        )


def notes_on_faults(g: Geometry, faults: Faults) -> tuple[str, ...]:
    """What the geometry's file lacks, and satellites of faults that are out of view at epochs, which give no row."""
    unseen = faults.unseen(g)
    notes: dict[str, str] = {}
    for k in np.flatnonzero(unseen.any(axis=0)):
        biased = ", ".join(np.array(faults.names)[faults.bias_m[k] != 0])
        epochs = (unseen | faults.applies(g))[:, k].sum() if k in faults.shaped else len(unseen)
        who = faults.labels[k] if k in faults.shaped else biased
        notes[who] = f"{who}: out of view at {unseen[:, k].sum()} of {epochs} epochs, which give no row."
    return g.notes + tuple(notes.values())
