"""The one file that speaks to the library of u-blox messages (pyubx2, the extra ``pl_mc[ubx]``): bytes in, fields out.

What is a message is decided here, by its two first bytes, its length and its checksum: after damaged bytes the search
goes on two bytes further, so that they cost their own message alone.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from pl_mc.input_errors import InputError

BEGIN = b"\xb5\x62"

# Class, number and length before what a message says, and two bytes of checksum after it.
_HEAD, _TAIL = 6, 2


def messages(content: bytes, wanted: Collection[str], source: str) -> tuple[list[Any], int]:
    """Messages of some kinds in their order, and how many beginnings of one are damaged or cut short.

    Args:
        content: of a log, with whatever else is between the messages.
        wanted: names such as ``NAV-PVT``.
        source: the file, for the sentence of an error.

    Returns:
        Objects with the fields of the interface description as attributes, angles in degrees, and ``identity``, their
        name.

    Raises:
        InputError: the library is not installed.
    """
    try:
        import pyubx2
    except ImportError:
        raise InputError(
            f"{source}: its UBX messages need a library that is not installed; pip install 'pl_mc[ubx]' brings it."
        ) from None
    names = {number: name for number, name in pyubx2.UBX_MSGIDS.items() if name in wanted}
    found: list[Any] = []
    damaged, at = 0, content.find(BEGIN)
    while at >= 0:
        stop = at + _HEAD + int.from_bytes(content[at + 4 : at + _HEAD], "little") + _TAIL
        if stop <= len(content) and _is_sound(content[at + 2 : stop]):
            if content[at + 2 : at + 4] in names:
                try:
                    found.append(pyubx2.UBXReader.parse(content[at:stop]))
                # Its types differ with what is wrong, such as a length that the kind of message does not have.
                except Exception:
                    damaged += 1
            at = content.find(BEGIN, stop)
        else:
            damaged += 1
            at = content.find(BEGIN, at + len(BEGIN))
    return found, damaged


def _is_sound(covered: bytes) -> bool:
    """Whether the last two bytes are the checksum of the others, Fletcher's of eight bits (RFC 1145)."""
    values = np.frombuffer(covered, dtype=np.uint8, count=len(covered) - _TAIL).astype(np.int64)
    sums = values.sum(), (values * np.arange(values.size, 0, -1)).sum()
    return bytes(int(one) & 0xFF for one in sums) == covered[-_TAIL:]
