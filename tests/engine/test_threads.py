"""Work beside other work."""

from __future__ import annotations

import threading

import pytest

from pl_mc.runtime.threads import begun


def test_what_is_begun_runs_beside_and_is_asked_for_once_or_again() -> None:
    """It waits for something that happens after it was begun."""
    later = threading.Event()
    answer = begun(lambda: later.wait(60))
    later.set()
    assert answer() is True
    assert answer() is True


def test_its_error_is_that_of_who_asks() -> None:
    answer = begun(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        answer()
