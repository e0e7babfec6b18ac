"""Sentences about what was left out of a receiver's files, what is odd in them, and what contradicts the truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.receiver.observation_records import Event
from pl_mc.receiver.rinex import ReceiverData, gps_clock
from pl_mc.receiver.truth import Truth

# From a medium orbit overhead to a geostationary one at the horizon, with milliseconds of receiver clock.
PLAUSIBLE_PSEUDORANGE_M = (1.5e7, 5.0e7)

# Errors of this size are no receiver noise: a jump, a fault, or a damaged digit. They are data all the same.
GROSS_ERROR_M = 1e3

# A truth is contradicted where the pseudoranges agree among themselves about a position further from it than this,
# and than so many times what their residuals let one expect of that position.
_FAR_M, _TIMES_EXPECTED = 20.0, 10.0
_SHARE_OF_EPOCHS = 0.9

_NAMED_AT_MOST = 8


def event_notes(events: Sequence[Event], truth: Truth) -> list[str]:
    """Events that move the antenna or change the site, where the truth is one point."""
    if truth.is_track or not events:
        return []
    named = [
        f"line {event.line}{f' ({gps_clock(event.time_gps_s)})' if np.isfinite(event.time_gps_s) else ''}: {event.what}"
        for event in events[:_NAMED_AT_MOST]
    ]
    more = f"; and {len(events) - len(named)} more" if len(events) > len(named) else ""
    return [
        f"The antenna or the site changes within the observation file: {'; '.join(named)}{more}. Errors after that are "
        "still about the one true position that was given; split the file there, or give a track."
    ]


def truth_notes(g: Geometry, errors_m: NDArray[np.float64], truth: Truth) -> list[str]:
    """Whether the pseudoranges fit another position than the truth, at almost all epochs.

    Least squares at each epoch: its distance from the truth against what the root mean square of its residuals lets
    one expect of it, sqrt(tr(Q) v'Pv / (P dof)) with unit weights scaled by sigma.
    """
    weight = np.where(g.in_view, 1.0 / np.where(g.in_view, g.sigma_m, 1.0), 0.0)
    design = g.design * weight[..., None]
    inverse = np.linalg.pinv(np.einsum("eni,enj->eij", design, design))
    solution = np.einsum("eij,enj,en->ei", inverse, design, errors_m * weight)
    residual = errors_m * weight - np.einsum("eni,ei->en", design, solution)
    redundancy = g.in_view.sum(axis=1) - g.unknown_count
    usable = redundancy > 0
    if not usable.any():
        return []
    unit = np.sqrt((residual[usable] ** 2).sum(axis=1) / redundancy[usable])
    expected_m = unit * np.sqrt(np.trace(inverse[usable, :3, :3], axis1=1, axis2=2))
    distance_m = np.linalg.norm(solution[usable, :3], axis=1)
    far = (distance_m > _FAR_M) & (distance_m > _TIMES_EXPECTED * expected_m)
    if far.mean() < _SHARE_OF_EPOCHS:
        return []
    left = g.in_view[usable]
    plain_m = np.sqrt(((residual[usable] / np.where(left, weight[usable], 1.0)) ** 2).sum() / redundancy[usable].sum())
    return [
        f"At {far.sum()} of {usable.size} epochs the pseudoranges fit a position {np.median(distance_m[far]):.0f} m "
        f"from the true position that was given ({truth.source}), with residuals of {plain_m:.1f} m: either the truth "
        "is not the antenna's, or all pseudoranges are faulted alike."
    ]


def epoch_notes(
    data: ReceiverData, known: NDArray[np.bool_], in_view: NDArray[np.bool_], systems: Sequence[str]
) -> list[str]:
    """What epochs lack."""
    notes = []
    total = known.size
    if data.epochs_in_file > total:
        notes.append(
            f"{data.epochs_in_file - total} of {data.epochs_in_file} epochs are skipped: they hold no pseudorange."
        )
    if not known.all():
        notes.append(f"{total - known.sum()} of {total} epochs are skipped: they have no true position.")
    none = int((~in_view.any(axis=1)).sum())
    if none:
        notes.append(f"No satellite is in view at {_epochs(none)}.")
    for letter in systems:
        count = (in_view & (np.array(data.systems) == letter)).sum(axis=1)
        name = SYSTEM_NAMES[letter]
        if (count == 0).any() and (count > 0).any():
            notes.append(f"{name} has no satellite in view at {_epochs((count == 0).sum())}.")
        elif (count == 0).all():
            notes.append(f"{name} has no satellite in view at any epoch.")
        if (count == 1).any():
            notes.append(
                f"{name} has a lone satellite at {_epochs((count == 1).sum())}; there it determines the clock of "
                "its system and nothing else."
            )
    return notes


def satellite_notes(
    data: ReceiverData,
    known: NDArray[np.bool_],
    plausible: NDArray[np.bool_],
    misfit: NDArray[np.bool_],
    error_m: NDArray[np.float64],
) -> list[str]:
    """What became of satellites that were observed."""
    observed = np.isfinite(data.pseudorange_m[known])
    low, high = PLAUSIBLE_PSEUDORANGE_M
    reasons = (
        ("left out as unhealthy", data.unhealthy[known]),
        ("left out, as no accuracy is predicted (URA, SISA)", data.unpredicted[known]),
        ("left out for want of the second of two carriers", data.one_carrier[known]),
        ("left out for want of a usable ephemeris", data.no_ephemeris[known]),
        (f"left out for a pseudorange outside {low:.3g} to {high:.3g} m", observed & ~plausible),
        ("left out below the mask, where the ephemeris puts it but not its pseudorange", misfit),
        (f"kept in spite of an error of more than {GROSS_ERROR_M:g} m", np.abs(error_m) > GROSS_ERROR_M),
    )
    return [f"{_counted(data.names, where.sum(axis=0))}: {what}." for what, where in reasons if where.any()]


def _counted(names: Sequence[str], counts: NDArray[np.int64]) -> str:
    """``G02 (14 epochs), C11 (1 epoch)``, the most frequent first."""
    order = [k for k in np.argsort(-counts, kind="stable") if counts[k]]
    shown = [f"{names[k]} ({_epochs(counts[k])})" for k in order[:_NAMED_AT_MOST]]
    more = len(order) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _epochs(count: int | np.integer) -> str:
    return f"{count} epoch{'' if count == 1 else 's'}"
