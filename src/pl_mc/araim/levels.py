"""ARAIM protection levels of one geometry or of a batch (multiple-hypothesis solution separation).

Source: ARAIM Algorithm Description Document v3.0, Working Group C, 2017, detection only; and v4.2, with priors over an
exposure, consolidation and exclusion by prediction, as the code of its authors has it (MAAST for ARAIM).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.araim.batch import Batch, as_batch
from pl_mc.araim.budget import LPV_200, LPV_200_V42, V3, V42, Budget, as_budget, require_standard
from pl_mc.araim.exclusion import EXCLUSIONS, candidates, positions_after
from pl_mc.araim.exposure_modes import LISTED, ORDERS, exposure_modes
from pl_mc.araim.modes import CONTAINED, UNMONITORED, FaultModes, fault_modes
from pl_mc.araim.record import AraimLevels, PositionLevels
from pl_mc.araim.tiles import ADJUSTED, ESTIMATORS, LEAST_SQUARES, Positions, Solved, solve, stacked
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, UP
from pl_mc.input_errors import InputError, require_choice, shown

# Geometries whose positions after an exclusion are solved together, so that memory stays bounded.
_TOGETHER = 2048


@ordinary_arithmetic
def protection_levels(
    design: ArrayLike,
    c_int: ArrayLike | None = None,
    c_acc: ArrayLike | None = None,
    systems: Sequence[str] | Sequence[Sequence[str]] = (),
    b_nom: ArrayLike | None = None,
    p_sat: ArrayLike | None = None,
    p_const: Mapping[str, float] | None = None,
    budget: Budget | str | None = None,
    unmonitored: str | None = None,
    *,
    in_view: ArrayLike | None = None,
    ism: Any = None,
    names: Sequence[str] | Sequence[Sequence[str]] | None = None,
    noise_m2: ArrayLike | None = None,
    standard: str = V3,
    exclusion: str | None = None,
    estimator: str = LEAST_SQUARES,
    order: str | None = None,
    modes: FaultModes | Sequence[FaultModes] | None = None,
) -> AraimLevels:
    """Protection levels, thresholds and fault modes of one geometry (n, t) or of a batch (g, n, t).

    Computed in double precision on all cores, whatever the configuration of JAX. In v3.0 a satellite that is the
    only one of its clock moves no position: neither its fault nor, if it is alone, that of its constellation counts.

    Args:
        design: (n, t) or (g, n, t), minus line of sight east, north, up, then clock columns [m/m].
        c_int: variances of the pseudorange errors under the integrity model, which also weight the solution [m^2]:
            (n,), (g, n), or diagonal matrices (n, n) for one geometry, (g, n, n) for a batch.
        c_acc: the same under the accuracy model [m^2].
        systems: n RINEX letters, or a list of g lists of n.
        b_nom: largest nominal bias [m], one number, (n,) or (g, n).
        p_sat: prior probability of a fault of each satellite, one number, (n,) or (g, n).
        p_const: prior probability of a fault of each constellation, by letter.
        budget: the operation's risks, or the name of a budget that pl_mc has; `pl_mc.araim.LPV_200`, or for v4.2
            `pl_mc.araim.LPV_200_V42`, unless given.
        unmonitored: v3 alone, what counts as not monitored. ``plain``: every combination of faults without a test of
            its own. ``contained``, unless given: of these only the combinations whose satellites no monitored mode
            holds together; the others add to the prior of the mode that holds them.
        in_view: which rows count, (n,) or (g, n); all unless given. Other rows may hold anything.
        ism: an integrity support message (`pl_mc.araim.Ism`, a table of its fields or the path of a CSV file), which
            says b_nom, p_sat and p_const, as far as it has them, and with sigma_URA and sigma_URE c_acc: c_int less
            sigma_URA^2, plus sigma_URE^2. What it says is not given beside it. For v4.2 with an exposure it says
            rates and durations of faults.
        names: names of the satellites, (n,) or (g, n), which an ISM may tell apart and tables show.
        noise_m2: with an ism, instead of c_int, the variances of all other errors (receiver, troposphere), in its
            shapes [m^2].
        standard: ``v3`` or ``v4.2``, which has priors at an instant and over an exposure.
        exclusion: v4.2 alone, which exclusions the levels are to hold after as well: ``satellites``, each of them, or
            ``constellations``, of these too; none unless given.
        estimator: v4.2 alone, ``least_squares``, or ``adjusted``: accuracy is spent, up to the budget's limits of
            sigma, to stand nearer to the weakest subset; it is not always better.
        order: v4.2 alone, in which order modes join that no prior demands, see `pl_mc.araim.exposure_modes`:
            ``listed``, as the rows stand, as in the authors' code, unless given; or ``probable``.
        modes: fault modes to use, one list or one for each geometry; found by the standard unless given.

    Raises:
        InputError: an argument that is missing, said twice or without effect, shapes that do not fit, numbers that
            are not finite, variances that are not positive, probabilities outside [0, 1), a letter without a
            probability, an ISM that lacks a satellite, or faults so probable that too many combinations would have to
            be monitored.
    """
    budget = (LPV_200_V42 if standard == V42 else LPV_200) if budget is None else as_budget(budget)
    require_standard(standard, budget)
    _require_effect(standard, budget, unmonitored, exclusion, estimator, order, modes)
    whole = as_batch(design, c_int, c_acc, systems, b_nom, p_sat, p_const, budget, in_view, ism, names, noise_m2)
    # Rows out of view decide nothing: without them patterns are few, and their modes are found once for each.
    rows = None if modes is not None else whole.rows_in_view_first()
    batch = whole if rows is None else whole.of_rows(rows)
    if modes is not None:
        found, pattern = _given(batch, modes, standard)
    elif standard == V3:
        found, pattern = _modes_at_an_instant(batch, budget, unmonitored or CONTAINED)
    else:
        found, pattern = _modes_over_exposure(batch, budget, exclusion is not None, order or LISTED)
    g = len(batch.in_view)
    excluded, there = (None, None) if exclusion is None else candidates(batch, exclusion)
    share = None if there is None else 1.0 / there.sum(axis=1)
    levels = solve(batch, Positions(np.arange(g), None, found, pattern, share), budget, estimator)
    worst = _largest_of(levels)
    positions = None
    if excluded is not None and there is not None:
        positions = _after_exclusions(batch, found, pattern, excluded, there, budget, estimator)
        worst = {field: getattr(positions, field).max(axis=1, where=there, initial=0.0) for field in worst}
    spoiled, prior, exposure = stacked(found)
    spoiled, prior, exposure = spoiled[pattern], prior[pattern], exposure[pattern]
    if rows is not None:
        spoiled = _spread_rows(spoiled, rows, whole.in_view.shape[1])
        positions = positions and _spread_positions(positions, rows, whole.in_view.shape[1])
    horizontal = {}
    if levels.horizontal_m is not None:
        horizontal = dict(zip(("hpl_norm_m", "hpl_plane_m", "hpl_plane_coded_m"), levels.horizontal_m, strict=True))
    arrays = {
        **worst, **horizontal, "hpl_east_m": levels.level_m[EAST], "hpl_north_m": levels.level_m[NORTH],
        "p_not_monitored": levels.p_not_monitored, "available": levels.available, "excluded": spoiled,
        "probability": prior, "threshold_m": levels.threshold_m, "satellites": whole.satellites, "exposure": exposure,
    }  # fmt: skip
    if whole.single:
        arrays = {field: values[0] for field, values in arrays.items()}
        positions = positions and PositionLevels(**{field: values[0] for field, values in vars(positions).items()})
    return AraimLevels(**arrays, positions=positions)


def _largest_of(levels: Solved) -> dict[str, Any]:
    """What is reported as the largest over all positions, of each."""
    return {
        "vpl_m": levels.level_m[UP],
        "hpl_m": np.hypot(levels.level_m[EAST], levels.level_m[NORTH]),
        "emt_m": levels.emt_m,
        "sigma_v_acc_m": levels.sigma_v_acc_m,
    }


def _after_exclusions(
    batch: Batch, found: Sequence[FaultModes], pattern: NDArray[np.intp], excluded: NDArray[np.bool_],
    there: NDArray[np.bool_], budget: Budget, estimator: str,
) -> PositionLevels:  # fmt: skip
    """The levels of all positions."""
    every: dict[str, NDArray] = {}
    for first in range(0, len(there), _TOGETHER):
        part = np.arange(first, min(first + _TOGETHER, len(there)))
        positions = positions_after(part, excluded[part], there[part], found, pattern[part])
        levels = solve(batch, positions, budget, estimator, whole=False)
        for field, values in _largest_of(levels).items():
            every.setdefault(field, np.full(there.shape, np.inf))[part[0] : part[-1] + 1][there[part]] = values
    return PositionLevels(excluded, there, **every)


def _spread_rows(packed: NDArray[np.bool_], rows: NDArray[np.intp], n: int) -> NDArray[np.bool_]:
    """(g, k, n), what is said of some rows (g, w) of each geometry (g, k, w); nothing of the others."""
    found = np.zeros((*packed.shape[:2], n), dtype=bool)
    np.put_along_axis(found, np.broadcast_to(rows[:, None], packed.shape), packed, axis=2)
    return found


def _spread_positions(packed: PositionLevels, rows: NDArray[np.intp], n: int) -> PositionLevels:
    """The levels of all positions with a place for every row: all in view, without each row, each constellation."""
    g, width = rows.shape
    more = packed.there.shape[1] - 1 - width
    last = np.broadcast_to(1 + n + np.arange(more), (g, more))
    place = np.concatenate([np.zeros((g, 1), dtype=np.intp), 1 + rows, last], axis=1)

    def spread(values: NDArray[Any], nothing: Any) -> NDArray[Any]:
        found = np.full((g, 1 + n + more, *values.shape[2:]), nothing)
        found[np.arange(g)[:, None], place] = values
        return found

    levels = {name: values for name, values in vars(packed).items() if name not in ("excluded", "there")}
    return PositionLevels(
        spread(_spread_rows(packed.excluded, rows, n), False), spread(packed.there, False),
        **{name: spread(values, np.inf) for name, values in levels.items()},
    )  # fmt: skip


def _require_effect(
    standard: str, budget: Budget, unmonitored: str | None, exclusion: str | None, estimator: str, order: str | None,
    modes: Any,
) -> None:  # fmt: skip
    """Raise `InputError` for options that cannot be used, or that this standard would ignore."""
    for field, value, choices in (
        ("unmonitored", unmonitored, UNMONITORED), ("exclusion", exclusion, EXCLUSIONS),
        ("estimator", estimator, ESTIMATORS), ("order", order, ORDERS),
    ):  # fmt: skip
        if value is not None:
            require_choice(value, choices, field=field)
    if standard == V42:
        if unmonitored is not None:
            raise InputError("unmonitored: it belongs to standard 'v3'; 'v4.2' has the consolidation of its budget.")
        if estimator == ADJUSTED and budget.sigma_acc_vertical_m is None and budget.sigma_acc_horizontal_m is None:
            raise InputError(
                "budget: the adjusted estimator needs a limit, sigma_acc_vertical_m or sigma_acc_horizontal_m "
                "(nearest: pl_mc.araim.LPV_200_V42)."
            )
    else:
        for field, given in (
            ("exclusion", exclusion is not None), ("estimator", estimator == ADJUSTED), ("order", order is not None),
        ):  # fmt: skip
            if given:
                raise InputError(f"{field}: it has no effect in standard 'v3' (nearest: standard='v4.2').")
    if modes is not None and (order is not None or unmonitored is not None):
        raise InputError(f"{'order' if order else 'unmonitored'}: it has no effect where the modes are given.")


def _given(batch: Batch, modes: Any, standard: str) -> tuple[list[FaultModes], NDArray[np.intp]]:
    """Fault modes of the caller's own, checked, and which of them belong to each geometry (g,)."""
    g, n = batch.in_view.shape
    found = [modes] if isinstance(modes, FaultModes) else modes
    if not isinstance(found, Sequence) or not all(isinstance(one, FaultModes) for one in found):
        raise InputError(f"modes: pl_mc.araim.FaultModes, or a list of {g}, are needed, not {shown(modes)}.")
    if len(found) not in (1, g):
        raise InputError(f"modes: one list, or {g} as there are geometries, are needed, not {len(found)}.")
    for one in found:
        m = len(one.probability)
        if np.shape(one.excluded) != (m, n) or np.shape(one.over_exposure) != (m,):
            raise InputError(f"modes: the shapes (modes, {n}) and (modes,) are needed, not {np.shape(one.excluded)}.")
    if standard == V42:
        found = [dataclasses.replace(one, exposure=one.over_exposure) for one in found]
    elif any(one.exposure is not None for one in found):
        raise InputError("modes: priors over an exposure have no effect in standard 'v3' (nearest: standard='v4.2').")
    return list(found), np.arange(g) if len(found) == g else np.zeros(g, dtype=np.intp)


def _patterns(batch: Batch, *more: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
    """Which clock each row observes (g, n, clocks); a geometry of each pattern, and the pattern of each (g,)."""
    clocks = batch.design[:, :, POSITION_UNKNOWNS:] != 0
    codes = np.unique(batch.systems, return_inverse=True)[1].reshape(batch.systems.shape)
    parts = [codes.astype(np.int8), clocks.reshape(len(clocks), -1).astype(np.int8)]
    for values in more:
        if (values[batch.in_view] != values.max()).any():
            parts.append(np.ascontiguousarray(values).view(np.int8))
    keys = np.ascontiguousarray(np.concatenate(parts, axis=1))
    words = keys.view(np.dtype((np.void, keys.shape[1])))[:, 0]
    _, first, pattern = np.unique(words, return_index=True, return_inverse=True)
    return clocks, first, pattern.reshape(-1)


def _modes_at_an_instant(batch: Batch, budget: Budget, unmonitored: str) -> tuple[list[FaultModes], NDArray[np.intp]]:
    """The fault modes of v3.0 of each distinct pattern of satellites, and the pattern of each geometry (g,)."""
    clocks, first, pattern = _patterns(batch, batch.p_sat)
    found = [
        fault_modes(batch.systems[k].tolist(), clocks[k], batch.p_sat[k], batch.p_const, budget, unmonitored)
        for k in first
    ]
    return found, pattern


def _modes_over_exposure(
    batch: Batch, budget: Budget, excludes: bool, order: str
) -> tuple[list[FaultModes], NDArray[np.intp]]:
    """The same of v4.2."""
    clocks, first, pattern = _patterns(batch, batch.p_sat, batch.r_sat_per_h)
    p_sat = batch.p_sat + batch.r_sat_per_h * budget.exposure_h
    p_const = {letter: p + batch.r_const_per_h[letter] * budget.exposure_h for letter, p in batch.p_const.items()}
    for field, p in (("p_sat", p_sat.max()), *((f"p_const[{letter!r}]", p) for letter, p in p_const.items())):
        if p >= 1.0:
            raise InputError(
                f"{field}: over an exposure of {budget.exposure_h:g} h its prior is {p:.3g}; below 1 is needed."
            )
    found = [
        exposure_modes(
            batch.systems[k].tolist(), clocks[k], (batch.p_sat[k], p_sat[k]), (batch.p_const, p_const), budget,
            excludes=excludes, order=order,
        )
        for k in first
    ]  # fmt: skip
    return found, pattern
