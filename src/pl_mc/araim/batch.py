"""What `protection_levels` was given, checked and brought to arrays over a batch of geometries."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.araim.budget import RATES_NEEDED, Budget
from pl_mc.araim.modes import LEAST_PRIOR
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import POSITION_UNKNOWNS, SYSTEM_NAMES, as_mask
from pl_mc.input_errors import InputError, nearest, require_number, require_numbers, shown
from pl_mc.ism import Ism, as_ism

# What lies beyond these is a slip of the unit, and cannot be computed with.
_LEAST_M2, _MOST_M2, _MOST_M = 1e-18, 1e18, 1e9


@dataclass(frozen=True)
class Batch:
    """Geometries with finite numbers everywhere; rows out of view are zero, their variances are 1.

    Attributes:
        design: (g, n, t) [m/m]; in_view: (g, n).
        c_int, c_acc: (g, n), variances [m^2].
        b_nom: (g, n), largest nominal biases [m].
        p_sat: (g, n), priors; zero out of view.
        systems: (g, n), letters; empty out of view. names: (g, n), of the satellites; empty where not known.
        p_const: prior by letter.
        r_sat_per_h: (g, n), rates of faults [1/h], and r_const_per_h by letter; zero where nothing says them.
        b_acc: (g, n), largest nominal biases for continuity [m]; zero where nothing says them.
        single: whether the caller gave one geometry without an axis of geometries.
    """

    design: FloatArray
    in_view: NDArray[np.bool_]
    c_int: FloatArray
    c_acc: FloatArray
    b_nom: FloatArray
    p_sat: FloatArray
    systems: NDArray[np.str_]
    names: NDArray[np.str_]
    p_const: dict[str, float]
    r_sat_per_h: FloatArray
    r_const_per_h: dict[str, float]
    b_acc: FloatArray
    single: bool

    @property
    def satellites(self) -> NDArray[np.str_]:
        """(g, n), what each row is called: its name, or its letter and place."""
        place = np.char.add(self.systems, [f"#{k + 1}" for k in range(self.systems.shape[1])])
        return np.where(self.names == "", np.where(self.in_view, place, ""), self.names)

    def rows_in_view_first(self) -> NDArray[np.intp] | None:
        """(g, w), the rows in view of each geometry, in their order, and others up to the most of any; None for all."""
        width = max(1, int(self.in_view.sum(axis=1).max()))
        if width == self.in_view.shape[1]:
            return None
        return np.argsort(~self.in_view, axis=1, kind="stable")[:, :width]

    def of_rows(self, rows: NDArray[np.intp]) -> Batch:
        """With these rows (g, w) of each geometry alone."""
        picked: dict[str, Any] = {
            name: np.take_along_axis(value, rows if value.ndim == 2 else rows[..., None], axis=1)
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray)
        }
        return replace(self, **picked)


def as_batch(
    design: ArrayLike, c_int: ArrayLike | None, c_acc: ArrayLike | None,
    systems: Sequence[str] | Sequence[Sequence[str]], b_nom: ArrayLike | None, p_sat: ArrayLike | None,
    p_const: Mapping[str, float] | None, budget: Budget, in_view: ArrayLike | None, ism: Any = None,
    names: Sequence[str] | Sequence[Sequence[str]] | None = None, noise_m2: ArrayLike | None = None,
) -> Batch:  # fmt: skip
    """The batch; an `InputError` says what does not fit."""
    rows = require_numbers(design, field="design")
    single = rows.ndim == 2
    rows = rows[None] if single else rows
    if rows.ndim != 3 or rows.shape[2] <= POSITION_UNKNOWNS or 0 in rows.shape:
        raise InputError(
            "design: the shape (n, t) or (g, n, t) with three position columns and at least one clock is needed, "
            f"not {np.shape(design)}."
        )
    g, n, _ = rows.shape
    seen = np.ones((g, n), bool) if in_view is None else _spread("in_view", as_mask(in_view), g, n)
    if not (np.abs(rows[seen]) <= _MOST_M).all():
        raise InputError(f"design: the rows of satellites in view are finite numbers, up to {_MOST_M:g}.")
    letters = _letters(systems, seen)

    def by_satellite(field: str, value: Any) -> FloatArray:
        return _spread(field, _diagonal(field, require_numbers(value, field=field), single, n), g, n)

    by_name: dict[str, Any] = {"c_int": c_int, "c_acc": c_acc, "b_nom": b_nom, "p_sat": p_sat, "p_const": p_const}
    known = _names(names, letters, seen)
    said = None if ism is None else _Said(as_ism(ism), known, letters, seen)
    if said is None and noise_m2 is not None:
        raise InputError("noise_m2: it belongs to an ism, and there is none.")
    if said is not None:
        by_name |= _of_ism(said, by_name, noise_m2, by_satellite)
    for field, value in by_name.items():
        if value is None:
            raise InputError(f"{field}: it is needed where no ism {'with noise_m2 ' * field.startswith('c_')}says it.")
    variances = dict[str, FloatArray]()
    for field in ("c_int", "c_acc"):
        given = by_satellite(field, by_name[field])
        if not ((given >= _LEAST_M2) & (given <= _MOST_M2))[seen].all():
            raise InputError(
                f"{field}: a variance is finite and positive, {_LEAST_M2:g} to {_MOST_M2:g} m^2, for every satellite "
                "in view."
            )
        variances[field] = np.where(seen, given, 1.0)
    bias = _spread("b_nom", require_numbers(by_name["b_nom"], field="b_nom"), g, n)
    if not ((bias >= 0) & (bias <= _MOST_M))[seen].all():
        raise InputError(f"b_nom: a nominal bias is the largest size of an error, not negative, up to {_MOST_M:g} m.")
    p = _spread("p_sat", require_numbers(by_name["p_sat"], field="p_sat"), g, n)
    if not ((p == 0) | ((p >= LEAST_PRIOR) & (p < 1)))[seen].all():
        raise InputError(
            f"p_sat: a prior probability lies between 0 and 1, 1 excluded, and is 0 or at least {LEAST_PRIOR:g}."
        )
    rows, bias, p = np.where(seen[..., None], rows, 0.0), np.where(seen, bias, 0.0), np.where(seen, p, 0.0)
    p_letter = _constellations(by_name["p_const"], letters)
    return Batch(
        rows, seen, variances["c_int"], variances["c_acc"], bias, p, letters, known, p_letter,
        *_over_time(said, letters, budget), single,
    )  # fmt: skip


@dataclass(frozen=True)
class _Said:
    """An ISM, and the satellites (g, n) that it is asked about: names, letters, and which are in view."""

    ism: Ism
    names: NDArray[np.str_]
    letters: NDArray[np.str_]
    seen: NDArray[np.bool_]

    def of(self, field: str) -> FloatArray:
        """(g, n), a field; zero out of view."""
        # Once for each satellite, however many geometries it is in.
        word = np.char.add(self.letters[self.seen], self.names[self.seen])
        known, place = np.unique(word, return_inverse=True)
        found = np.zeros(self.seen.shape)
        single = [name for name in self.ism.single_satellites(field) if name[0] in known]
        if single:
            raise InputError(
                f"names: the ISM tells {single[0]} from others in {field}; names of satellites are needed."
            )
        known_letters, known_names = [one[0] for one in known], [one[1:] for one in known]
        found[self.seen] = self.ism.values(field, known_names, known_letters)[place.reshape(-1)]
        return found


def _of_ism(
    said: _Said, given: Mapping[str, Any], noise_m2: Any, by_satellite: Callable[[str, Any], FloatArray]
) -> dict[str, Any]:
    """Arguments that an ISM says; what is said twice is refused."""
    ism, found = said.ism, dict[str, Any]()
    said_by = {"b_nom": "b_nom_m", "p_sat": "p_sat", "p_const": "p_const", "c_acc": "sigma_ure_m"}
    for argument, field in said_by.items():
        if given[argument] is not None and ism.has(field):
            raise InputError(f"{argument}: the ISM has {field}, which says it; one of the two is needed, not both.")
    if noise_m2 is not None and given["c_int"] is not None:
        raise InputError("noise_m2: c_int is given too, which holds it; one of the two is needed, not both.")
    for argument, field in list(said_by.items())[:2]:
        if ism.has(field):
            found[argument] = said.of(field)
    if ism.has("p_const"):
        letters = sorted(set(said.letters[said.seen].tolist()))
        found["p_const"] = dict(zip(letters, ism.values("p_const", letters, letters).tolist(), strict=True))
    argument, value = ("c_int", given["c_int"]) if noise_m2 is None else ("noise_m2", noise_m2)
    if value is None or (noise_m2 is None and not ism.has("sigma_ure_m")):
        return found
    ura_m2 = said.of("sigma_ura_m") ** 2
    least = ura_m2 if argument == "c_int" else np.zeros_like(ura_m2)
    variance = by_satellite(argument, value)
    for k in np.argwhere(said.seen & ~(variance >= least))[:1].tolist():
        name = said.names[tuple(k)] or said.letters[tuple(k)]
        rule = (
            "it holds the square of sigma_ura_m, as with an error model of the same ism"
            if argument == "c_int"
            else "a variance is not negative"
        )
        raise InputError(
            f"{argument}: {variance[tuple(k)]:g} m^2 for {name} cannot be used; {rule} (nearest: {least[tuple(k)]:g})."
        )
    found["c_int"] = variance - least + ura_m2
    return found | ({"c_acc": variance - least + said.of("sigma_ure_m") ** 2} if ism.has("sigma_ure_m") else {})


def _over_time(
    said: _Said | None, letters: NDArray[np.str_], budget: Budget
) -> tuple[FloatArray, dict[str, float], FloatArray]:
    """Rates of faults of satellites (g, n) and by letter, and b_acc (g, n)."""
    present = sorted({*letters.ravel().tolist()} - {""})
    rates, by_letter, b_acc = np.zeros(letters.shape), dict.fromkeys(present, 0.0), np.zeros(letters.shape)
    if budget.exposure_h > 0:
        if said is None:
            raise InputError(RATES_NEEDED)
        rates = said.of("r_sat_per_h")
        by_letter = dict(zip(present, said.ism.values("r_const_per_h", present, present).tolist(), strict=True))
    if said is not None and said.ism.has("b_acc_m"):
        b_acc = said.of("b_acc_m")
    return rates, by_letter, b_acc


def _names(given: Any, letters: NDArray[np.str_], seen: NDArray[np.bool_]) -> NDArray[np.str_]:
    """(g, n), names of satellites; empty where they are not known."""
    if given is None:
        return np.zeros(letters.shape, dtype=np.str_)
    try:
        names = np.array(given)
    except (TypeError, ValueError):
        names = np.array(None)
    if names.dtype.kind != "U" or names.shape not in (letters.shape, letters.shape[1:]):
        raise InputError(f"names: a name for each of the {letters.shape[1]} rows is needed, not {shown(given)}.")
    return np.where(seen, np.broadcast_to(names, letters.shape), "")


def _spread(field: str, value: NDArray[Any], g: int, n: int) -> NDArray[Any]:
    """(g, n), from one number, one for each satellite, or one for each satellite of each geometry."""
    if value.shape not in ((), (n,), (g, n)):
        raise InputError(f"{field}: its shape is (), ({n},) or ({g}, {n}), as the design says, not {value.shape}.")
    return np.broadcast_to(value, (g, n))


def _diagonal(field: str, value: FloatArray, single: bool, n: int) -> FloatArray:
    """Variances, also out of covariance matrices (n, n) of one geometry or (g, n, n) of several."""
    if value.shape[-2:] != (n, n) or value.ndim != (2 if single else 3):
        return value
    diagonal = np.diagonal(value, axis1=-2, axis2=-1)
    if (value != diagonal[..., None] * np.eye(n)).any():
        raise InputError(f"{field}: the errors of the satellites are independent, so off the diagonal all is zero.")
    return diagonal


def _letters(systems: Any, seen: NDArray[np.bool_]) -> NDArray[np.str_]:
    g, n = seen.shape
    try:
        given = np.array(list(systems) if isinstance(systems, str) else systems, dtype=np.str_)
    except (TypeError, ValueError) as error:
        raise InputError(f"systems: it cannot be read as RINEX letters ({error}).") from None
    if given.ndim == 1 and given.shape == (g,) and g != n:
        # A sequence of words, "GGGEEE" for each geometry.
        words = given.tolist()
        given = np.array([list(word) for word in words]) if {len(word) for word in words} == {n} else given
    if given.shape not in ((n,), (g, n)):
        raise InputError(f"systems: one RINEX letter for each of the {n} rows is needed, not shape {given.shape}.")
    letters = np.where(seen, np.broadcast_to(given, (g, n)), "")
    for letter in np.unique(letters[seen]).tolist():
        if letter not in SYSTEM_NAMES:
            raise InputError(f"systems: {letter!r} is unknown ({nearest(letter, SYSTEM_NAMES)}).")
    return letters


def _constellations(p_const: Any, letters: NDArray[np.str_]) -> dict[str, float]:
    if not isinstance(p_const, Mapping):
        raise InputError(
            f"p_const: a mapping from letter to probability is needed, such as {{'G': 1e-8}}, not {shown(p_const)}."
        )
    found = {}
    for letter in sorted(set(letters.ravel().tolist()) - {""}):
        if letter not in p_const:
            raise InputError(f"p_const: there is no probability of {letter!r} ({nearest(letter, map(str, p_const))}).")
        found[letter] = require_number(p_const[letter], field=f"p_const[{letter!r}]")
        if not 0.0 <= found[letter] < 1.0:
            raise InputError(
                f"p_const[{letter!r}]: a prior probability lies between 0 and 1, 1 excluded, not {found[letter]!r}."
            )
    return found
