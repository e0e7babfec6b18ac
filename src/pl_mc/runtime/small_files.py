"""Files that people write and that are read whole: experiments, manifests, reports; with bounds on what is read."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pl_mc.input_errors import InputError, shown, system_reason

# Experiments and manifests have a few kilobytes, reports less than one megabyte.
MOST_BYTES = 8_000_000
# Tables within tables; no file of ours has ten.
_DEEPEST = 40


def read_bytes(path: Path, *, most_bytes: int = MOST_BYTES) -> bytes:
    """The content of a regular file.

    Raises:
        FileNotFoundError: there is none.
        InputError: a folder, a pipe or a device; more than ``most_bytes``; a file that the system does not give.
    """
    try:
        # A pipe without a writer would wait for ever.
        place = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        reason = system_reason(error) if isinstance(error, OSError) else "its name cannot be one"
        raise InputError(f"{shown(str(path))}: the file cannot be read ({reason}).") from None
    if not stat.S_ISREG(os.fstat(place).st_mode):
        os.close(place)
        raise InputError(f"{path}: the file cannot be read (it is no regular file).")
    with os.fdopen(place, "rb") as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputError(f"{path}: the file cannot be read (it has more than {most_bytes / 1e6:g} MB).")
    return content


def read_text(path: Path, *, most_bytes: int = MOST_BYTES) -> str:
    """The text of a regular file in UTF-8; errors as of `read_bytes`."""
    try:
        return read_bytes(path, most_bytes=most_bytes).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: the file cannot be read (it is not UTF-8: {error.reason}).") from None


def parsed(text: str, parse: Callable[[str], Any], *, path: Path, what: str) -> Any:
    """What a text says, ``parse(text)``; an `InputError` where it is no ``what``, or beyond its bounds."""
    try:
        content = parse(text)
    except RecursionError:
        raise InputError(f"{path}: it is nested too deeply for any reader.") from None
    except ValueError as error:
        reason = "a number has too many digits" if "integer string conversion" in str(error) else str(error)
        raise InputError(f"{path}: it is not {what}: {shown_reason(reason)}.") from None
    layer = [content]
    for _ in range(_DEEPEST):
        inner = (one.values() if isinstance(one, dict) else one for one in layer if isinstance(one, dict | list))
        layer = [value for values in inner for value in values]
    if layer:
        raise InputError(f"{path}: it is nested too deeply; at most {_DEEPEST} tables or lists are within each other.")
    return content


def parsed_json(text: str, *, path: Path, what: str = "JSON") -> Any:
    """What a text in JSON says; errors as of `parsed`."""
    return parsed(text, json.loads, path=path, what=what)


def shown_reason(reason: str) -> str:
    """What a library says of a file, within a sentence."""
    text = " ".join(reason.split()).rstrip(".")
    return text if len(text) <= 200 else f"{text[:200]}..."
