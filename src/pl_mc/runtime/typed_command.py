"""The command that a run was asked for by, as it was typed, without what it tells of a person's machine."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path

PROGRAM = "pl-mc"

_TYPED: ContextVar[tuple[str, ...] | None] = ContextVar("typed", default=None)

# A folder that is named from the root, the home or upwards, up to its last separator.
_ELSEWHERE = re.compile(r"(?:^|(?<=[\s=\"',:(\[]))(?:~[^/\\\s]*|\.\.|[A-Za-z]:)?[/\\](?:[^\"'=,()\[\]]*[/\\])?")
_ADDRESS = re.compile(r"^([a-z][a-z0-9+.-]*)://.*")


@contextlib.contextmanager
def typed(arguments: Sequence[str]) -> Iterator[None]:
    """A scope of all that a command does."""
    token = _TYPED.set(tuple(arguments))
    try:
        yield
    finally:
        _TYPED.reset(token)


def typed_command() -> list[str] | None:
    """The words of the command; of paths that lead out of the working folder the name alone, of addresses nothing.

    None where no command asked, but a program.
    """
    arguments = _TYPED.get()
    return None if arguments is None else [PROGRAM, *map(_told, arguments)]


def _told(argument: str) -> str:
    option, equals, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
    if (address := _ADDRESS.match(value)) is not None:
        return f"{option}{equals}{address[1]}://"
    parts = re.split(r"[/\\]", value)
    return f"{option}{equals}{parts[-1] if '..' in parts else _ELSEWHERE.sub('', value)}"


def without_home(path: str) -> str:
    """A path with ``~`` in the place of the user's home folder."""
    with contextlib.suppress(RuntimeError, ValueError, OSError):
        return f"~/{Path(path).relative_to(Path.home()).as_posix()}"
    return path
