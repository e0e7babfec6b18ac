"""Alert limits: the error that an operation tolerates without an alert, and the axes by which it is judged."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pl_mc.input_errors import InputError, known_options, require_choice, require_list, require_positive, shown

# Limits beyond these are slips of the unit, and cannot be computed with.
_LEAST_M, _MOST_M = 1e-6, 1e9

# In the place of a limit that is missing: one that no level reaches.
_NONE_M = 1e300

VERTICAL, HORIZONTAL, EITHER = "vertical", "horizontal", "either"
AXES = (VERTICAL, HORIZONTAL, EITHER)


@dataclass(frozen=True)
class _Called:
    """What texts and figures call the error of an axis, its size, its level and limit, and what its level promises."""

    error: str
    size: str
    level: str
    limit: str
    multiplier: str
    promise: float

    @property
    def promised(self) -> str:
        """``1e-7``."""
        return f"{self.promise:.0e}".replace("e-0", "e-")


_CALLED = {
    VERTICAL: _Called("vertical error", "|vertical error|", "VPL", "VAL", "K_V = 5.33", 1e-7),
    HORIZONTAL: _Called("horizontal error", "horizontal error", "HPL", "HAL", "K_H = 6.18", 5e-9),
}


@known_options("alert")
@dataclass(frozen=True)
class AlertLimits:
    """Alert limits of one operation, one of the two at least.

    Attributes:
        name: the operation.
        vertical_m: vertical alert limit, VAL [m]; None for an operation without one.
        horizontal_m: horizontal alert limit, HAL [m]; None for an operation without one.

    Example:
        >>> import pl_mc
        >>> pl_mc.AlertLimits("mine", vertical_m=20.0)
        AlertLimits(name='mine', vertical_m=20.0, horizontal_m=None)
    """

    name: str
    vertical_m: float | None = None
    horizontal_m: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"alert.name: a word is needed, not {shown(self.name)}.")
        for field in ("vertical_m", "horizontal_m"):
            value = getattr(self, field)
            if value is None:
                continue
            rule = f"an alert limit is positive and finite, {_LEAST_M:g} to {_MOST_M:g} m"
            try:
                limit_m = require_positive(value, field=field)
            except InputError:
                raise InputError(f"alert.{field}: {rule}, not {shown(value)}.") from None
            if not _LEAST_M <= limit_m <= _MOST_M:
                raise InputError(f"alert.{field}: {rule}, not {limit_m:g}.")
            # Numbers of any type are doubles from here on; a record is frozen.
            object.__setattr__(self, field, limit_m)
        if self.vertical_m is None and self.horizontal_m is None:
            raise InputError(f"alert: {self.name} has no limit; vertical_m, horizontal_m or both are needed.")

    @property
    def has_vertical(self) -> bool:
        """Whether the operation has a vertical limit."""
        return self.vertical_m is not None

    @property
    def val_m(self) -> float:
        """The vertical limit, or a number that no level reaches [m]."""
        return _NONE_M if self.vertical_m is None else self.vertical_m

    @property
    def hal_m(self) -> float:
        """The horizontal limit, or a number that no level reaches [m]."""
        return _NONE_M if self.horizontal_m is None else self.horizontal_m

    @property
    def limit_m(self) -> dict[str, float]:
        """The limit of each of the two axes that has one [m]."""
        both = {VERTICAL: self.vertical_m, HORIZONTAL: self.horizontal_m}
        return {axis: limit for axis, limit in both.items() if limit is not None}

    @property
    def words(self) -> str:
        """``VAL 35 m, HAL 40 m``, of the limits that there are."""
        return ", ".join(f"{_CALLED[axis].limit} {limit:g} m" for axis, limit in self.limit_m.items())


@dataclass(frozen=True)
class Judged:
    """An axis and the limits that decide on it, in the words of texts and figures.

    Attributes:
        alert: limits, among them those of the axis.
        axis: one of `AXES`.
    """

    alert: AlertLimits
    axis: str = VERTICAL

    @property
    def called(self) -> tuple[_Called, ...]:
        """The words of each of its errors, the vertical one first."""
        return tuple(_CALLED[one] for one in judged_by(self.axis))

    @property
    def levels(self) -> tuple[tuple[str, str, float], ...]:
        """Columns of its levels begin with ``vpl``, of the name ``VPL``; and the limit of each [m]."""
        limits = (self.alert.limit_m[one] for one in judged_by(self.axis))
        return tuple((one.level.lower(), one.level, limit) for one, limit in zip(self.called, limits, strict=True))

    def limits(self, form: Callable[[float], str] = "{:g}".format) -> str:
        """``VAL 35 m``."""
        return ", ".join(
            f"{one.limit} {form(limit)} m" for one, (_, _, limit) in zip(self.called, self.levels, strict=True)
        )

    @property
    def alarm(self) -> str:
        """``VPL > VAL``."""
        return " or ".join(f"{one.level} > {one.limit}" for one in self.called)

    @property
    def beyond_limit(self) -> str:
        """``|vertical error| > VAL``."""
        return " or ".join(f"{one.size} > {one.limit}" for one in self.called)

    @property
    def beyond_level(self) -> str:
        """``|vertical error| > VPL``."""
        return " or ".join(f"{one.size} > {one.level}" for one in self.called)

    def probability(self, event: str) -> str:
        """``P(|vertical error| > VPL, no alarm)``."""
        if event == "alarm":
            return "P(alarm)"
        if self.axis == EITHER:
            return f"P(an error > its {'limit' if event == 'missed' else 'level'}, no alarm)"
        return f"P({self.beyond_limit if event == 'missed' else self.beyond_level}, no alarm)"

    def means(self, event: str) -> str:
        """How an answer begins its sentence about alarms, misleading information or missed detections."""
        if event == "alarm":
            return "Alarms" if self.axis == VERTICAL else f"Alarms ({self.alarm})"
        if event == "misleading":
            errors = " or ".join(one.error for one in self.called)
            its = "the" if len(self.called) == 1 else "its"
            return f"Misleading information ({errors} beyond {its} protection level, no alarm)"
        limits = [limit for _, _, limit in self.levels]
        errors = " or ".join(
            f"{one.error} beyond the alert limit of {limit:g} m" for one, limit in zip(self.called, limits, strict=True)
        )
        return f"Missed detections ({errors}, no alarm)"


# ICAO Annex 10, vol. I, table 3.7.2.4-1; read in Li et al. 2020, Satellite Navigation 1:12, table 1. Of the
# vertical limits of category I, 10 to 15 m (newer editions: up to 35 m), this is the smallest.
APV_I = AlertLimits("APV-I", vertical_m=50.0, horizontal_m=40.0)
LPV_200 = AlertLimits("LPV-200", vertical_m=35.0, horizontal_m=40.0)
APV_II = AlertLimits("APV-II", vertical_m=20.0, horizontal_m=40.0)
CAT_I = AlertLimits("CAT-I", vertical_m=10.0, horizontal_m=40.0)

# The same table; operations of precision approach down to the runway, and those without vertical guidance.
CAT_II = AlertLimits("CAT-II", vertical_m=5.3, horizontal_m=17.3)
CAT_IIIB = AlertLimits("CAT-IIIB", vertical_m=5.2, horizontal_m=15.5)
NPA = AlertLimits("NPA", horizontal_m=556.0)
TERMINAL = AlertLimits("terminal", horizontal_m=1_850.0)
EN_ROUTE = AlertLimits("en-route", horizontal_m=3_700.0)
OCEANIC = AlertLimits("oceanic", horizontal_m=7_400.0)

# Required navigation performance: the limit is the number of nautical miles.
RNP_01 = AlertLimits("RNP 0.1", horizontal_m=185.0)
RNP_03 = AlertLimits("RNP 0.3", horizontal_m=556.0)

# Operations with a vertical limit, and all of them.
BY_NAME = {limits.name: limits for limits in (APV_I, LPV_200, APV_II, CAT_I, CAT_II, CAT_IIIB)}
OPERATIONS = BY_NAME | {limits.name: limits for limits in (NPA, TERMINAL, EN_ROUTE, OCEANIC, RNP_01, RNP_03)}
# Other names of that table, where one line is of two operations.
_ALSO = {
    "cat-ii/iiia": CAT_II, "cat-iiia": CAT_II, "lpv": APV_I, "npa/rnp-0.3": NPA, "continental": EN_ROUTE,
}  # fmt: skip
_BY_LETTERS = {name.lower().replace(" ", "-"): name for name in OPERATIONS} | {
    letters: limits.name for letters, limits in _ALSO.items()
}


def operation_named(name: str, field: str = "alert") -> str:
    """The name of an operation as `OPERATIONS` has it, of one in another case, or with a blank for a hyphen."""
    return _BY_LETTERS.get(_letters(name)) or require_choice(name, OPERATIONS, field=field)


def is_operation(name: object) -> bool:
    """Whether an operation is called so."""
    return isinstance(name, str) and _letters(name) in _BY_LETTERS


def _letters(name: str) -> str:
    return re.sub(r"[\s-]+", "-", re.sub(r"\s*/\s*", "/", name.strip())).lower()


def as_limits(alert: str | AlertLimits) -> AlertLimits:
    """Alert limits by name (``LPV-200``, ``RNP 0.3``, ``CAT I``) or as a record; an `InputError` for anything else."""
    if isinstance(alert, str):
        return OPERATIONS[operation_named(alert)]
    if not isinstance(alert, AlertLimits):
        kind = alert.__name__ if isinstance(alert, type) else type(alert).__name__
        raise InputError(f"alert: alert limits such as pl_mc.LPV_200 are needed, not {kind}.")
    return alert


def as_alert(alert: str | AlertLimits) -> AlertLimits:
    """Alert limits of which the vertical one decides, by name (``LPV-200``) or as a record.

    Raises:
        InputError: another name or type; no vertical limit; a horizontal limit that no operation here has, where it
            decides nothing: it was chosen, and would be ignored.
    """
    limits = as_limits(alert)
    if not limits.has_vertical:
        raise InputError(f"alert: {limits.name} has no vertical limit, which decides here (of {', '.join(BY_NAME)}).")
    known = sorted({one.horizontal_m for one in OPERATIONS.values() if one.horizontal_m is not None})
    if limits.horizontal_m is not None and limits.horizontal_m not in known:
        raise InputError(
            f"alert.horizontal_m: {limits.horizontal_m:g} m would decide nothing here, where the vertical one decides "
            f"alone; leave it out, or take that of an operation ({', '.join(f'{one:g}' for one in known)})."
        )
    return limits


def as_axes(axes: str | Sequence[str] | None, alert: AlertLimits) -> tuple[str, ...]:
    """The axes by which limits are judged: those asked for, else the vertical where it has a limit.

    Raises:
        InputError: none, an unknown one, one twice, or one whose limit is missing.
    """
    if axes is None or isinstance(axes, str):
        return (as_axis(axes, alert, field="axes"),)
    given = require_list(axes, field="axes", of="axes")
    if not given:
        raise InputError(f"axes: at least one is needed (of {', '.join(AXES)}).")
    found = tuple(as_axis(axis, alert, field="axes") for axis in given)
    if len(set(found)) < len(found):
        raise InputError("axes: each axis is judged once.")
    return found


def as_axis(axis: str | None, alert: AlertLimits, *, field: str = "axis") -> str:
    """One axis: that asked for, else the vertical where it has a limit; an `InputError` that names ``field``."""
    if axis is None:
        return VERTICAL if alert.has_vertical else HORIZONTAL
    require_choice(axis, AXES, field=field)
    for needed in judged_by(axis):
        if needed not in alert.limit_m:
            raise InputError(
                f"{field}: {axis} needs a {needed} limit, and {alert.name} has {alert.words} alone; give one, or "
                f"take the axis {next(iter(alert.limit_m))}."
            )
    return axis


def judged_by(axis: str) -> tuple[str, ...]:
    """The limits, vertical and horizontal, by which an axis judges."""
    return (VERTICAL, HORIZONTAL) if axis == EITHER else (axis,)


def unjudged_note(alert: AlertLimits, axes: Sequence[str] = (VERTICAL,)) -> str:
    """A sentence for tables and summaries: which limit decides nothing beside another; empty where none does."""
    by = {limit for axis in axes for limit in judged_by(axis)}
    left = [axis for axis in alert.limit_m if axis not in by]
    if not left or not by:
        return ""
    (axis,), (judged,) = left, by
    return (
        f"The {axis} alert limit of {alert.name}, {alert.limit_m[axis]:g} m, is not judged: "
        f"the {judged} one, {alert.limit_m[judged]:g} m, decides alone."
    )
