"""One bias as a record and as text: of which satellites, how large, from when to when.

A fault is one bias or several, separated by commas: ``G01:+30m``, ``G01+G13:+30m``, ``G:+20m`` (all satellites of GPS
in view), ``G15:+0.1m/s:100-`` (a ramp from epoch 100 on), ``G02:uniform(5,100)m:100-199`` (drawn, in a window).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import Geometry, as_words
from pl_mc.input_errors import (
    InputError,
    hold_whole,
    nearest,
    plain_number,
    require_choice,
    require_list,
    require_number,
    require_truth,
    shown,
)

NO_FAULT = "none"
FIXED, UNIFORM, NORMAL = "fixed", "uniform", "normal"

# A larger bias is a slip of the unit, and cannot be computed with.
MOST_BIAS_M = 1e9
# To the nanometre, so that 0.1 + 0.2 reads as it was meant; a ramp reaches a day.
_DIGITS, _RATE_DIGITS = 9, 14

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?"
_SIZE = re.compile(
    rf"(?P<sign>\+-|[+-])?(?:(?P<law>[a-z]+)\( ?(?P<numbers>{_NUMBER}(?: ?, ?{_NUMBER})*) ?\)"
    rf"|(?P<value>(?![+-]){_NUMBER}))"
    r"(?: ?(?P<unit>m/s|m))?(?: (?P<together>common|independent))?"
)
_NAME = re.compile(r"[^\s,:+()]+")
_WINDOW = re.compile(r"([0-9]{1,15})-([0-9]{0,15})")
# Commas between biases, not those between the numbers of a distribution.
_BETWEEN = re.compile(r",(?![^()]*\))")
_FORM = (
    "the form is G02:+30m, several satellites G01+G13:+30m or G01:+30m,C08:-20m, all of a system G:+20m, drawn "
    "G02:uniform(5,100)m, in time G15:+0.1m/s, in a window G02:+30m:100-199"
)


@dataclass(frozen=True, kw_only=True)
class Bias:
    """One bias. Text made of it (``str``) and read again is the same record.

    Attributes:
        of: satellites by name, or systems by letter for all of their satellites in view.
        law: ``fixed``, or the distribution of its size: ``uniform`` or ``normal``.
        numbers: of ``fixed`` the size, of ``uniform`` the ends, of ``normal`` mean and standard deviation [m], or [m/s]
            of a ramp. Kept to 1e-9 m and 1e-14 m/s.
        either_sign: whether either sign of the size is equally likely, drawn with it.
        independent: whether every satellite draws a size of its own, of a fixed size the sign; else one drawn size is
            that of all.
        per_second: whether it grows with time, from zero at its first epoch on.
        first_epoch, last_epoch: epoch numbers of its window, both included; None for the first or last of a series.
    """

    of: tuple[str, ...]
    law: str = FIXED
    numbers: tuple[float, ...]
    either_sign: bool = False
    independent: bool = False
    per_second: bool = False
    first_epoch: int | None = None
    last_epoch: int | None = None

    def __post_init__(self) -> None:
        of, numbers = as_words("of", self.of), require_list(self.numbers, field="numbers", of="numbers")
        if not of or not all(map(_NAME.fullmatch, of)):
            raise InputError(f"of: satellites by name, or systems by letter, are needed, not {shown(self.of)}.")
        for field in ("either_sign", "independent", "per_second"):
            require_truth(getattr(self, field), field=field)
        # A window that has an end has a beginning.
        if self.first_epoch is not None or self.last_epoch is not None:
            hold_whole(self, "first_epoch", low=0)
        if self.last_epoch is not None:
            hold_whole(self, "last_epoch", low=0)
        self._hold(of, numbers)

    def _hold(self, of: tuple[str, ...], numbers: Sequence[float]) -> None:
        """Check the size, and keep it in the one form that its text has."""
        named = "+".join(of)
        if len(numbers) != (1 if require_choice(self.law, (FIXED, UNIFORM, NORMAL), field="law") == FIXED else 2):
            raise InputError(f"numbers: fixed takes one number, a distribution two, not {shown(self.numbers)}.")
        digits = _RATE_DIGITS if self.per_second else _DIGITS
        numbers = tuple(round(require_number(x, field=f"bias of {named}"), digits) + 0.0 for x in numbers)
        if max(map(abs, numbers)) > MOST_BIAS_M:
            raise InputError(
                f"bias of {named}: a bias is a finite number of metres, up to {MOST_BIAS_M:g}, not "
                f"{plain_number(max(numbers, key=abs))}."
            )
        if self.law == FIXED and (self.either_sign or self.independent):
            # Which sign it is written with says nothing where either is drawn, which independent ones do anyway.
            numbers = (abs(numbers[0]),)
            object.__setattr__(self, "either_sign", not self.independent)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "of", of)
        if self.law == FIXED and numbers == (0.0,):
            raise InputError(f"bias of {named}: a bias of size zero is no fault; without one it is {NO_FAULT}.")
        if self.law == UNIFORM and not numbers[0] < numbers[1]:
            raise InputError(f"bias of {named}: uniform takes two sizes in order, such as uniform(5,100), not {self}.")
        if self.law == NORMAL and not numbers[1] > 0:
            raise InputError(
                f"bias of {named}: normal takes a mean and a positive standard deviation, such as normal(0,10), not "
                f"{self}."
            )
        if self.independent and len(of) == 1 and len(of[0]) > 1:
            raise InputError(f"bias of {named}: one satellite has none to be independent of; leave independent out.")
        if self.last_epoch is not None and self.first_epoch is not None and self.last_epoch < self.first_epoch:
            raise InputError(
                f"bias of {named}: the window {self._window} ends before it begins; did you mean "
                f"{self.last_epoch}-{self.first_epoch}?"
            )

    def __str__(self) -> str:
        name = "+".join(self.of)
        plain = self.law == FIXED and not self.either_sign
        numbers = ",".join(plain_number(value, sign=plain) for value in self.numbers)
        size = numbers if self.law == FIXED else f"{self.law}({numbers})"
        window = "" if self.first_epoch is None else f":{self._window}"
        unit = "m/s" if self.per_second else "m"
        return f"{name}:{'+-' * self.either_sign}{size}{unit}{' independent' * self.independent}{window}"

    @property
    def _window(self) -> str:
        return f"{self.first_epoch}-{'' if self.last_epoch is None else self.last_epoch}"

    @property
    def drawn(self) -> bool:
        """Whether something of it is drawn anew for every draw of the noise."""
        return self.law != FIXED or self.either_sign or self.independent

    def during(self, epoch: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether epoch numbers lie in its window."""
        after = True if self.first_epoch is None else epoch >= self.first_epoch
        return np.broadcast_to(after & (True if self.last_epoch is None else epoch <= self.last_epoch), np.shape(epoch))

    def overlaps(self, other: Bias) -> bool:
        """Whether their windows have an epoch in common."""
        ends = [(x.first_epoch or 0, np.inf if x.last_epoch is None else x.last_epoch) for x in (self, other)]
        return max(first for first, _ in ends) <= min(last for _, last in ends)

    def members(self, g: Geometry) -> NDArray[np.bool_]:
        """(m,), which satellites of ``g.names`` it is of."""
        each = zip(g.names, g.systems, strict=True)
        return np.array([name in self.of or (letter in self.of and letter not in g.names) for name, letter in each])

    def rows(self, series: Geometry, places: NDArray[np.int64] | slice = slice(None)) -> NDArray[np.bool_]:
        """(p, n), the rows that it biases at these epochs of a series."""
        seen = self.members(series)[series.satellite[places]] & series.in_view[places]
        return seen & self.during(series.epoch[places])[:, None]


def parse_fault(text: str) -> tuple[Bias, ...]:
    """The biases of a fault that is written as text, such as its label; none for ``none``.

    Raises:
        InputError: text of another form, a size that is zero or no number, a window that ends before it begins.
    """
    if not isinstance(text, str):
        raise InputError(f"biases: {shown(text)} is no fault; {_FORM}.")
    text = " ".join(text.replace("±", "+-").split())
    return () if text == NO_FAULT else tuple(map(_parsed, _BETWEEN.split(text)))


def fault_text(biases: Sequence[Bias]) -> str:
    """The label of a fault; ``none`` without a bias."""
    for one in require_list(biases, field="biases", of="biases"):
        if not isinstance(one, Bias):
            raise InputError(f"biases: records of the kind Bias are needed, not {shown(one)}.")
    return ",".join(map(str, biases)) or NO_FAULT


def _parsed(text: str) -> Bias:
    named, *rest = (part.strip() for part in text.split(":"))
    of = tuple(name.strip() for name in named.split("+"))
    if not 1 <= len(rest) <= 2 or not all(map(_NAME.fullmatch, of)):
        _refuse(text)
    size, window = _SIZE.fullmatch(rest[0]), _WINDOW.fullmatch(rest[1]) if len(rest) > 1 else None
    if size is None:
        if re.fullmatch(r"[+-]?(nan|inf(inity)?) ?(m|m/s)?", rest[0], re.IGNORECASE):
            raise InputError(f"biases: {shown(text.strip())}: a bias is a finite number of metres, not {rest[0]}.")
        _refuse(text)
    if len(rest) > 1 and window is None:
        raise InputError(
            f"biases: {shown(text.strip())}: {shown(rest[1])} is no window; first-last is needed, such as 100-199, or "
            "100- to the end."
        )
    law = size["law"] or FIXED
    numbers = tuple(float(value) for value in (size["value"] or size["numbers"]).split(","))
    if law not in (FIXED, UNIFORM, NORMAL) or size["law"] == FIXED:
        raise InputError(f"biases: {shown(law)} is no distribution of a size ({nearest(law, (UNIFORM, NORMAL))}).")
    if len(numbers) != (1 if law == FIXED else 2):
        raise InputError(f"biases: {shown(text.strip())}: {law} takes two numbers, such as {law}(5,100).")
    if size["sign"] == "-":
        numbers = {FIXED: (-numbers[0],), UNIFORM: (-numbers[-1], -numbers[0])}.get(law, (-numbers[0], numbers[-1]))
    return Bias(
        of=of, law=law, numbers=numbers, either_sign=size["sign"] == "+-",
        independent=size["together"] == "independent", per_second=size["unit"] == "m/s",
        first_epoch=int(window[1]) if window else None, last_epoch=int(window[2]) if window and window[2] else None,
    )  # fmt: skip


def _refuse(text: str) -> NoReturn:
    raise InputError(f"biases: {shown(text.strip())} is no fault; {_FORM}.")
