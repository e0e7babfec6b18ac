"""The one exception that bad input raises, and the sentence parts that it is made of.

Every check of what a user gave ends here: one sentence that names the file, line or field, the rule, and the
nearest valid value. The command line prints the sentence and exits with code 2; no traceback reaches a user.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Something that the user gave cannot be used; the message is one sentence made for that user."""


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
    if word not in choices:
        raise InputError(f"{field}: {word!r} is unknown ({nearest(str(word), choices)}).")
    return word
