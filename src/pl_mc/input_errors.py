"""The one exception that bad input raises, and the sentence parts that it is made of.

Every check of what a user gave ends here: one sentence that names the file, line or field, the rule, and the
nearest valid value. The command line prints the sentence and exits with code 2; no traceback reaches a user.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import numbers
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Record = TypeVar("Record")


class InputError(ValueError):
    """Something that the user gave cannot be used; the message is one sentence made for that user.

    Whatever a sentence quotes, it stays on its line and within a screen: a line that ends in no full stop goes on in
    the next, and the middle of a long one is left out.

    Example:
        >>> import pl_mc
        >>> try:
        ...     pl_mc.simulate(site="CUT1", epochs=1)
        ... except pl_mc.InputError as said:
        ...     print(str(said).split(" (")[0])
        site: 'CUT1' is unknown
    """

    def __init__(self, message: str) -> None:
        lines = re.sub(r"(?<![.?])\s*\n\s*", " ", message).split("\n")
        half = _LONGEST_LINE // 2
        super().__init__("\n".join(x if len(x) <= 2 * half else f"{x[:half]} ... {x[-half:]}" for x in lines))


# A longer line of a message is cut.
_LONGEST_LINE = 1200
# What is quoted of a value is at most so long.
_LONGEST_SHOWN = 60
# What file systems take, in bytes: of a name (with room for endings that are added), and of a path.
_LONGEST_NAME, _LONGEST_PATH = 230, 4000


def shown(value: object) -> str:
    """A value within a sentence: on one line, and not all of a long one."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def nearest(word: str, valid: Iterable[str], *, limit: int = 3) -> str:
    """The end of a sentence about an unknown word: the nearest valid ones, or all where there are few.

    Case is ignored in the comparison, so that ``g02`` finds ``G02``.
    """
    choices = [str(item) for item in valid]
    if not choices:
        return "there is none to choose from"
    by_folded = {choice.casefold(): choice for choice in choices}
    close = difflib.get_close_matches(word.casefold(), list(by_folded), n=limit, cutoff=0.5)
    if close:
        return "nearest: " + ", ".join(by_folded[item] for item in close)
    shown = ", ".join(choices[:12]) + (", ..." if len(choices) > 12 else "")
    return "valid: " + shown


def require_choice(word: str, valid: Iterable[str], *, field: str) -> str:
    """``word`` if it is one of ``valid``; else an `InputError` that names ``field`` and the nearest choices."""
    choices = list(valid)
    if not isinstance(word, str) or word not in choices:
        raise InputError(f"{field}: {shown(word)} is unknown ({nearest(str(word), choices)}).")
    return word


def known_options(called: str) -> Callable[[type[Record]], type[Record]]:
    """What makes a dataclass refuse an option that it has not by an `InputError`; ``called`` is what that names."""

    def of(cls: type[Record]) -> type[Record]:
        made: Callable[..., None] = cls.__init__
        fields = [field.name for field in dataclasses.fields(cls) if field.init]  # type: ignore[arg-type]

        @functools.wraps(made)
        def checked(self: Record, *values: Any, **options: Any) -> None:
            for option in options:
                if option not in fields:
                    raise InputError(f"{called}: the option {shown(option)} is unknown ({nearest(option, fields)}).")
            made(self, *values, **options)

        cls.__init__ = checked  # type: ignore[assignment]
        return cls

    return of


def require_whole(value: int, *, field: str, low: int, high: int | None = None) -> int:
    """``value`` as an int if it is a whole number in the range; else an `InputError` that names ``field``."""
    # 1e4 is a whole number wherever it stands; strings are none.
    whole = is_real(value) and (isinstance(value, numbers.Integral) or (abs(value) < 2**53 and value == int(value)))
    if not whole or value < low or (high is not None and value > high):
        bounds = f"of at least {low}" if high is None else f"from {low} to {high}"
        raise InputError(f"{field}: a whole number {bounds} is needed, not {shown(value)}.")
    return int(value)


def hold_whole(record: object, name: str, *, low: int, high: int | None = None, field: str = "") -> None:
    """Make a field of a frozen record an int where it is a whole number in the range, however it was written (1e4)."""
    value = require_whole(getattr(record, name), field=field or name, low=low, high=high)
    object.__setattr__(record, name, value)


def require_positive(value: float, *, field: str) -> float:
    """``value`` as a float if it is a positive, finite number; else an `InputError` that names ``field``."""
    number = require_number(value, field=field)
    if number <= 0:
        raise InputError(f"{field}: a positive number is needed, not {shown(value)}.")
    return number


def require_within(value: float, *, field: str, low: float, high: float) -> float:
    """``value`` as a float if it lies from ``low`` to ``high``; else an `InputError` that names ``field``."""
    number = require_number(value, field=field)
    if not low <= number <= high:
        raise InputError(f"{field}: a number from {low:g} to {high:g} is needed, not {shown(value)}.")
    return number


def require_fraction(value: float, *, field: str) -> float:
    """``value`` as a float if it lies between 0 and 1, both excluded; else an `InputError` that names ``field``."""
    if not 0.0 < require_number(value, field=field) < 1.0:
        raise InputError(f"{field}: it lies between 0 and 1, both excluded, not {shown(value)}.")
    return float(value)


def require_number(value: float, *, field: str) -> float:
    """``value`` as a float if it is a finite number; else an `InputError` that names ``field``."""
    try:
        good = is_real(value) and math.isfinite(value)
    except OverflowError:
        # A whole number beyond the largest that a computer counts with.
        good = False
    if not good:
        raise InputError(f"{field}: a finite number is needed, not {shown(value)}.")
    return float(value)


def require_numbers(value: ArrayLike, *, field: str) -> NDArray[np.float64]:
    """``value`` as a new array of doubles, the one way in which numbers come in; they need not be finite.

    Raises:
        InputError: words, dates, truth values, complex numbers, masked values, rows of different lengths.
    """
    try:
        array = np.asarray(value)
        # Whole numbers beyond 64 bits, and tables whose columns have several types, are arrays of objects.
        of_objects = array.dtype == object and all(is_real(one) for one in array.flat)
        if not (of_objects or array.dtype.kind in "iuf") or np.ma.is_masked(value):
            raise TypeError("it holds " + (shown(array.flat[:1].tolist()[0] if array.size else value)))
        with np.errstate(over="ignore"):
            return np.array(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise InputError(f"{field}: it cannot be read as an array of numbers ({reason}).") from None


def require_one_shape(**values: ArrayLike) -> list[NDArray[np.float64]]:
    """Arguments, by name, as arrays of doubles of one shape; an `InputError` where they have none in common."""
    arrays = [require_numbers(value, field=field) for field, value in values.items()]
    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError:
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise InputError(f"{', '.join(values)}: their shapes {shapes} do not go together.") from None


def require_truth(value: bool, *, field: str) -> bool:
    """``value`` as a bool if it is True or False; else an `InputError` that names ``field``."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{field}: True or False is needed, not {shown(value)}.")
    return bool(value)


def require_list(value: Iterable[Any], *, field: str, of: str) -> list[Any]:
    """What ``value`` holds, one by one; an `InputError` that names ``field`` for a word, a table, or no sequence."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        raise InputError(f"{field}: a sequence of {of} is needed, not {shown(value)}.")
    return list(value)


def require_true(valid: ArrayLike, *, field: str, rule: str, of: ArrayLike) -> None:
    """Raise an `InputError` with the first value (...) of ``of`` where ``valid`` (...) is False."""
    bad = np.asarray(of)[~np.asarray(valid)]
    if bad.size:
        raise InputError(f"{field}: {rule}, not {shown(bad.flat[0].item())}.")


def is_real(value: object) -> bool:
    """Whether a value is a number, which a truth value and the text of one are not."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool | np.bool_)


def require_path(value: Path | str, *, field: str) -> Path:
    """``value`` as a path if it can be one; else an `InputError` that names ``field``."""
    text = str(value)
    names = [len(os.fsencode(part)) for part in Path(text).parts] if isinstance(value, str | Path) else []
    if not names or "\0" in text or max(names) > _LONGEST_NAME or sum(names) > _LONGEST_PATH:
        raise InputError(f"{field}: {shown(value)} cannot be a path.")
    return Path(text)


def plain_number(value: float, *, sign: bool = False) -> str:
    """The shortest decimal text that is this number and no other: 30, 0.1, 1234567."""
    return np.format_float_positional(value, trim="-", sign=sign)


def system_reason(error: OSError) -> str:
    """Why the operating system refused, within a sentence."""
    return (error.strerror or str(error)).lower()
