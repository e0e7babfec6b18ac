"""Running a program that speaks to RTKLIB in a process of its own, with a time limit."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence

from pl_mc.input_errors import InputError


def run_rtklib_child(
    program: str,
    arguments: Sequence[str],
    *,
    limit_s: float,
    exit_no_library: int,
    owner: str,
    given_up: Callable[[str], str],
    failed: Callable[[str], str],
) -> None:
    """Run a program and wait for it; a fault in the C code ends the child and not the analysis.

    Args:
        program: path of the program, which imports nothing of this package.
        arguments: its arguments.
        limit_s: time that it may take [s].
        exit_no_library: its exit code where the library cannot be loaded.
        owner: what the sentence about a missing library begins with.
        given_up, failed: the sentences about a child that took longer than a limit, and about one that failed for
            a reason, from these.

    Raises:
        InputError: there is no result.
    """
    # -P keeps this package's folder, with its common module names, off the child's import path.
    command = [sys.executable, "-P", program, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, timeout=limit_s, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(given_up(f"{limit_s:.0f} s")) from None
    message = done.stderr.decode("utf-8", "replace").strip()
    if done.returncode == exit_no_library:
        raise InputError(f"{owner}: the library pyrtklib cannot be loaded here ({message}).")
    if done.returncode != 0:
        last = message.splitlines()[-1] if message else f"exit code {done.returncode}"
        raise InputError(failed(last))
