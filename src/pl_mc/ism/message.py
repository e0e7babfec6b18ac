"""The record of an integrity support message.

Source: ARAIM Algorithm Description Document v3.0, Working Group C, 2017, table of ISM parameters; rates and durations
as of v4.2. Fields are optional, since each use needs some of them and says so where one is missing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import MOST_SATELLITES
from pl_mc.input_errors import InputError, known_options, nearest, require_number, shown
from pl_mc.ism.codes import CODES, EACH, LETTERS, number_of

# One value for all, or values by satellite ("G07") or constellation ("G").
Given = float | Mapping[str, float] | None
# The key of one value for all.
EVERY = ""

# Smaller priors than this are none, see `pl_mc.araim.modes`; larger lengths are slips of the unit.
LEAST_PRIOR, MOST_M, MOST_PER_H, MOST_H = 1e-100, 1e9, 1.0, 1e6

# Priors, and the rates and durations whose products they are.
_PRODUCTS = (("p_sat", "r_sat_per_h", "mfd_sat_h"), ("p_const", "r_const_per_h", "mfd_const_h"))


@known_options("ism")
@dataclass(frozen=True)
class Ism:
    """What a constellation provider promises about errors and faults, by satellite or by constellation.

    Every field is one number for all, or a mapping from names of satellites ("G07") and letters of constellations
    ("G"); a satellite has what stands under its name, else what stands under its letter. A satellite whose name is
    one of the user's own has what its constellation has. Fields that are left out are nobody's: what needs them
    says so. They are kept as pairs of name and value; `values` has them satellite by satellite.

    Attributes:
        sigma_ura_m: standard deviation of orbit and clock errors for integrity [m].
        sigma_ure_m: the same for accuracy and continuity [m].
        b_nom_m: largest nominal bias [m].
        p_sat: prior probability of a fault of the satellite.
        p_const: prior probability of a fault of the constellation; its satellites have one.
        b_acc_m: largest nominal bias for continuity, in the thresholds of ARAIM v4.2 [m].
        r_sat_per_h, mfd_sat_h: rate of faults of the satellite and how long one lasts on average [1/h, h]. Of these
            two and p_sat, their product, two may be given.
        r_const_per_h, mfd_const_h: the same of the constellation and p_const.
        name: what it is called in names of methods.

    Raises:
        InputError: a satellite or constellation that does not exist, a length that is negative or not finite, a
            probability outside [0, 1), two for one constellation, or a prior beside its rate and duration.
    """

    sigma_ura_m: Any = None
    sigma_ure_m: Any = None
    b_nom_m: Any = None
    p_sat: Any = None
    p_const: Any = None
    b_acc_m: Any = None
    r_sat_per_h: Any = None
    mfd_sat_h: Any = None
    r_const_per_h: Any = None
    mfd_const_h: Any = None
    name: str = "own"
    source: str = dataclasses.field(default="ism", compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise InputError(f"{self.source}: name: a word is needed, not {shown(self.name)}.")
        for field in FIELDS:
            if (given := getattr(self, field)) is not None:
                object.__setattr__(self, field, _pairs(f"{self.source}: {field}", given, RULES[field]))
        for field in ("p_const", "r_const_per_h", "mfd_const_h"):
            if (pairs := getattr(self, field)) is not None:
                object.__setattr__(self, field, _by_constellation(f"{self.source}: {field}", pairs))
        for prior, *parts in _PRODUCTS:
            if all(getattr(self, field) is not None for field in (prior, *parts)):
                raise InputError(
                    f"{self.source}: {prior}: it is {parts[0]} times {parts[1]}, which are given; two of the three are "
                    "needed."
                )
            for letter, p in self._found(prior).items():
                RULES[prior].checked(f"{self.source}: {prior}: {letter}", p)
        if all(getattr(self, field) is None for field in FIELDS):
            raise InputError(f"{self.source}: it says nothing; at least one of {', '.join(FIELDS)} is needed.")

    def __str__(self) -> str:
        """The name, as it stands in the name of a method."""
        return self.name

    def has(self, field: str) -> bool:
        """Whether it says anything of a field, be it by two others."""
        return bool(self._found(field))

    def with_field(self, *fields: str) -> Ism:
        """The same ISM, after a check that it has these fields."""
        for field in fields:
            self._pairs(field)
        return self

    def values(self, field: str, names: Sequence[str], systems: Sequence[str]) -> NDArray[np.float64]:
        """(m,), a field of each of the m satellites with these names and RINEX letters.

        Raises:
            InputError: the field is left out, or says nothing of one of the satellites.
        """
        given = self._pairs(field)
        found = [_value(given, name, letter) for name, letter in zip(names, systems, strict=True)]
        for name, letter, value in zip(names, systems, found, strict=True):
            if value is None:
                single = "" if field == "p_const" else f"{name} or for its "
                close = nearest(name if single else letter, given)
                raise InputError(
                    f"{self.source}: {field}: there is no value for {single}constellation {letter} ({close})."
                )
        return np.array(found, dtype=np.float64)

    def table(self, field: str) -> NDArray[np.float64]:
        """(CODES,), a field by the codes of `pl_mc.ism.codes`; zero for satellites of which nothing is said."""
        given, table = self._pairs(field), np.zeros(CODES)
        for place, letter in enumerate(LETTERS):
            for number in range(EACH):
                table[EACH * place + number] = _value(given, f"{letter}{number:02d}", letter) or 0.0
        return table

    def as_dict(self) -> dict[str, Any]:
        """What was given, as plain numbers and tables, without the fields that are left out."""
        content: dict[str, Any] = {"name": self.name}
        for field in FIELDS:
            if (pairs := getattr(self, field)) is not None:
                every = pairs[0][0] == EVERY
                content[field] = pairs[0][1] if every else dict(pairs)
        return content

    def single_satellites(self, field: str) -> tuple[str, ...]:
        """The satellites that have a value of their own."""
        return tuple(name for name in self._pairs(field) if len(name) > 1)

    def _pairs(self, field: str) -> dict[str, float]:
        pairs = self._found(field)
        if not pairs:
            there = ", ".join(other for other in FIELDS if self.has(other))
            raise InputError(f"{self.source}: {field}: it is needed here, and the ISM has none (it has {there}).")
        return pairs

    def _found(self, field: str) -> dict[str, float]:
        """The values by name; of a prior also its rate times its duration, of a rate the prior over the duration."""
        if (given := getattr(self, field)) is not None:
            return dict(given)
        for prior, rate, duration in _PRODUCTS:
            sign = {prior: 1, rate: -1}.get(field)
            first, second = getattr(self, rate if field == prior else prior), getattr(self, duration)
            if sign is None or first is None or second is None:
                continue
            first, second = dict(first), dict(second)
            pairs = {key: (_value(first, key, key[:1]), _value(second, key, key[:1])) for key in (*first, *second)}
            return {key: a * b**sign for key, (a, b) in pairs.items() if a is not None and b is not None}
        return {}


@dataclass(frozen=True)
class Rule:
    """What a value may be: from 0, or above it where ``positive``, to below 1, or to ``most``."""

    what: str
    most: float | None = None
    positive: bool = False

    def checked(self, where: str, value: Any) -> float:
        """The value as a float, or an `InputError` with the nearest one."""
        number = require_number(value, field=where)
        most = self.most
        low = number <= 0 if self.positive else number < 0
        if low or (most is None and number >= 1) or (most is not None and number > most):
            close = ("above 0" if self.positive else "0") if low else "below 1" if most is None else f"{most:g}"
            raise InputError(f"{where}: {shown(value)} cannot be used; {self.what} (nearest: {close}).")
        if most is None and 0 < number < LEAST_PRIOR:
            raise InputError(f"{where}: {shown(value)} cannot be used; {self.what} (nearest: 0 or {LEAST_PRIOR:g}).")
        return number


_LENGTH = f"is zero or more, up to {MOST_M:g} m"
_SIGMA = Rule(f"a standard deviation {_LENGTH}", most=MOST_M)
_PRIOR = Rule("a prior probability lies between 0 and 1, 1 excluded")
_RATE, _TIME = f"is zero or more, up to {MOST_PER_H:g} an hour", f"is above zero, up to {MOST_H:g} h"
RULES = {
    "sigma_ura_m": _SIGMA,
    "sigma_ure_m": _SIGMA,
    "b_nom_m": Rule(f"a nominal bias is the largest size of an error and {_LENGTH}", most=MOST_M),
    "p_sat": _PRIOR,
    "p_const": _PRIOR,
    "b_acc_m": Rule(f"a nominal bias is the largest size of an error and {_LENGTH}", most=MOST_M),
    "r_sat_per_h": Rule(f"a rate of faults {_RATE}", most=MOST_PER_H),
    "mfd_sat_h": Rule(f"the mean duration of a fault {_TIME}", most=MOST_H, positive=True),
    "r_const_per_h": Rule(f"a rate of faults {_RATE}", most=MOST_PER_H),
    "mfd_const_h": Rule(f"the mean duration of a fault {_TIME}", most=MOST_H, positive=True),
}
FIELDS = tuple(RULES)


def require_satellite(where: str, name: object) -> str:
    """``name`` if it is a satellite that can exist or the letter of a constellation."""
    if isinstance(name, str) and (name in MOST_SATELLITES or number_of(name)):
        return name
    known = [f"{letter}{k:02d}" for letter, most in MOST_SATELLITES.items() for k in range(1, most + 1)]
    raise InputError(
        f"{where}: {shown(name)} is neither a satellite nor a constellation ({nearest(str(name), [*LETTERS, *known])})."
    )


def _pairs(where: str, given: Any, rule: Rule) -> tuple[tuple[str, float], ...]:
    """What is given for a field, checked, by name; the order in which it is written does not matter."""
    if isinstance(given, Mapping):
        items: Iterable[tuple[Any, Any]] = given.items()
    elif isinstance(given, tuple) and all(isinstance(pair, tuple) and len(pair) == 2 for pair in given):
        # Of a record that is made anew out of another one.
        items = given
    else:
        return ((EVERY, rule.checked(where, given)),)
    pairs = [
        (key, rule.checked(f"{where}: {key}" if key else where, value))
        for key, value in items
        if (key == EVERY and not isinstance(given, Mapping)) or require_satellite(where, key)
    ]
    if not pairs:
        raise InputError(f"{where}: there is no value in it; a number, or one for each constellation, is needed.")
    return tuple(sorted(pairs))


def _value(given: Mapping[str, float], name: str, letter: str) -> float | None:
    # Names of a user's own may look like those of another system.
    own = given.get(name) if name[:1] == letter and number_of(name) else None
    return next((value for value in (own, given.get(letter), given.get(EVERY)) if value is not None), None)


def _by_constellation(where: str, pairs: tuple[tuple[str, float], ...]) -> tuple[tuple[str, float], ...]:
    """The one value of each constellation."""
    found: dict[str, tuple[str, float]] = {}
    for key, value in pairs:
        first, known = found.setdefault(key[:1], (key, value))
        if value != known:
            raise InputError(
                f"{where}: {key} has {value:g} and {first} has {known:g}; a constellation has one probability for all "
                "of its satellites."
            )
    return tuple((letter, value) for letter, (_, value) in found.items())
