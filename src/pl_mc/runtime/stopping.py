"""Ctrl-C, SIGTERM and SIGHUP as one: a `KeyboardInterrupt` in the main thread that nothing can swallow.

Python raises it wherever the main thread happens to be. In a callback of the garbage collector, of which JAX has one
that runs often while a function is traced, it is printed, ignored and gone, and the program goes on to its end.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

# The first is there everywhere.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")

# After which time an interrupt that was ignored is raised anew [s].
_AGAIN_S = 0.05


class Stops:
    """What has been asked for so far.

    Attributes:
        number: the first signal that came; 0 while none has.
    """

    number: int = 0

    @property
    def name(self) -> str:
        """The signal by name."""
        return signal.Signals(self.number or signal.SIGINT).name

    @property
    def exit_code(self) -> int:
        """What a process ends with that a signal ended: 130 after Ctrl-C."""
        return 128 + (self.number or signal.SIGINT)


@contextlib.contextmanager
def stoppable() -> Iterator[Stops]:
    """In this scope each of the three signals, the first time, interrupts the main thread; the others do nothing.

    A signal that the process was started to ignore (``nohup``) stays ignored; outside the main thread nothing is done.
    """
    stops, main = Stops(), threading.main_thread()
    if threading.current_thread() is not main:
        yield stops
        return
    number, hooked, hook = 0, False, sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:
        if not stops.number:
            stops.number = number
            if hooked:
                later()
            else:
                raise KeyboardInterrupt

    def later() -> None:
        threading.Timer(_AGAIN_S, again).start()

    def again() -> None:
        # As if the signal came once more.
        stops.number = 0
        if hasattr(signal, "pthread_kill"):
            # To the thread itself: one that waits for a lock would not wake up for the others'.
            signal.pthread_kill(main.ident or 0, number)
        else:
            signal.raise_signal(number)

    def ignored(said: Any) -> None:
        nonlocal number, hooked
        if not (stops.number and issubclass(said.exc_type, KeyboardInterrupt)):
            hook(said)
            return
        number = stops.number
        # What is raised in here is lost; on a busy machine a thread may take longer to start than the time it waits.
        hooked = True
        try:
            later()
        finally:
            hooked = False

    signals = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {one: signal.getsignal(one) for one in signals}
    try:
        sys.unraisablehook = ignored
        for one, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(one, stop)
        yield stops
    finally:
        for one, handler in before.items():
            signal.signal(one, handler if handler is not None else signal.SIG_DFL)
        sys.unraisablehook = hook
