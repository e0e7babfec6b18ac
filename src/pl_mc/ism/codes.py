"""Satellites as small whole numbers, the same in every geometry, so that a compiled function can look them up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import MOST_SATELLITES
from pl_mc.input_errors import InputError, require_choice, require_list, shown

LETTERS = "".join(MOST_SATELLITES)
# Codes of one constellation; the first of them is for satellites whose name is none that exists.
EACH = 64
CODES = EACH * len(LETTERS)


def number_of(name: str) -> int:
    """The number in the name of a satellite that can exist, ``G07``; 0 for any other name."""
    digits = name[1:]
    numbered = len(digits) == 2 and digits.isascii() and digits.isdigit() and name[0] in MOST_SATELLITES
    return int(digits) if numbered and int(digits) <= MOST_SATELLITES[name[0]] else 0


def codes_of(names: Sequence[str], systems: Sequence[str]) -> NDArray[np.int32]:
    """(m,), `EACH` times the place of each satellite's system in `LETTERS`, and its number if its name has one."""
    words = require_list(names, field="names", of="words")
    # Letters may stand in one word.
    letters = list(systems) if isinstance(systems, str) else require_list(systems, field="systems", of="letters")
    if len(words) != len(letters) or not all(isinstance(name, str) for name in words):
        raise InputError(f"names: a word for each of the {len(letters)} systems is needed, not {shown(names)}.")
    for letter in letters:
        require_choice(letter, LETTERS, field="systems")
    pairs = zip(words, letters, strict=True)
    codes = [EACH * LETTERS.index(s) + (number_of(name) if name[:1] == s else 0) for name, s in pairs]
    return np.array(codes, dtype=np.int32)


def satellite_codes(g: Any, satellite: ArrayLike | None = None) -> NDArray[np.int32]:
    """The codes of the rows of a geometry, or of satellites by their place in its names (...)."""
    places = g.satellite if satellite is None else np.asarray(satellite)
    return codes_of(g.names, g.systems)[places]
