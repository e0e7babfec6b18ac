"""Output that nobody takes: a reader that has had enough, as in ``pl-mc list | head -3``, is nobody's error."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TextIO

from pl_mc.input_errors import system_reason

# What a shell reports of a program that a closed pipe ended.
EXIT_CODE = 128 + 13


@contextlib.contextmanager
def quiet_end() -> Iterator[None]:
    """A scope of all that writes to the standard streams: where nobody reads one any more, the process ends at once.

    It ends with the code 141, as programs do that the signal of a closed pipe ends, and says nothing; where a file
    takes no more output, as on a full disk, with a sentence and the code 2. Another pipe that breaks, such as one to a
    worker, is an error as everywhere.
    """
    before = sys.stdout, sys.stderr
    watched = [None if stream is None else _Watched(stream) for stream in before]
    sys.stdout, sys.stderr = watched
    try:
        with _quiet(watched):
            yield
    finally:
        sys.stdout, sys.stderr = before


class _Watched:
    """A stream that knows whether it has refused something: one that holds nothing back has nothing left to flush."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self.refused = stream, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._tried(self._stream.write, text)

    def flush(self) -> None:
        self._tried(self._stream.flush)

    def _tried(self, act: Callable[..., Any], *given: str) -> Any:
        try:
            return act(*given)
        except OSError:
            self.refused = True
            raise


@contextlib.contextmanager
def _quiet(streams: Sequence[_Watched | None]) -> Iterator[None]:
    try:
        try:
            yield
        finally:
            if streams[0] is not None:
                streams[0].flush()
    except SystemExit as end:
        # Pages of help are printed by a library that has met the pipe itself.
        raise SystemExit(EXIT_CODE if isinstance(end.__context__, BrokenPipeError) else end.code) from None
    except OSError as error:
        closed = [stream for stream in streams if stream is not None and (stream.refused or _refuses(stream))]
        if not closed:
            raise
        for stream in closed:
            # What is left in it is flushed once more at the end of Python, which would complain.
            with open(os.devnull, "w") as nowhere:
                os.dup2(nowhere.fileno(), stream.fileno())
        if isinstance(error, BrokenPipeError):
            sys.exit(EXIT_CODE)
        with contextlib.suppress(OSError):
            print(f"pl-mc: the output cannot be written ({system_reason(error)}).", file=sys.stderr)
        sys.exit(2)


def _refuses(stream: _Watched) -> bool:
    """Whether a stream takes nothing more: a pipe that nobody reads, a file on a full disk."""
    try:
        stream.flush()
        number = stream.fileno()
    except OSError:
        return True
    except ValueError:
        return False
    if not hasattr(select, "poll"):
        return False
    # One that holds nothing back has nothing to flush.
    waiting = select.poll()
    waiting.register(number, 0)
    return any(event & select.POLLERR for _, event in waiting.poll(0))
