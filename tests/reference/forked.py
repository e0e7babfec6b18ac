"""Processes that have everything imported when they begin: forks of one that computes nothing itself.

Python and its libraries take some two seconds to start, which is most of what a small command does. Where a test is
not about starting, its processes are forked from one that has done so: it starts no backend of JAX, so that a fork
computes with threads of its own, as a process that was started does. Streams, signals and exit codes are real.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import io
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

# What commands and sweeps import, all of it.
IMPORTED = ("jax", "pandas", "scipy.stats", "matplotlib.pyplot", "pl_mc.cli.main", "pl_mc.experiments.running")

# JAX reads its variables when it is imported: those that tests change are read anew.
OF_JAX = {
    "JAX_COMPILATION_CACHE_DIR": str, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": float, "JAX_PLATFORMS": str,
}  # fmt: skip

# Between two looks whether a fork has ended [s].
_LOOK_S = 0.005


class Forked:
    """A process that runs a program, with what tests need of `subprocess.Popen`; its output goes to two pipes.

    Args:
        program: the text of a program, as for ``python -c``.
        arguments: of it.
        cwd, env: its folder and its variables; those of this process unless given.
        stdout, stderr: files in place of the pipes.
        whole_end: whether Python ends in good order; it takes a third of a second to forget all that was imported.
    """

    def __init__(
        self, program: str, arguments: Sequence[str] = (), *, cwd: Path | None = None,
        env: Mapping[str, str] | None = None, stdout: Any = None, stderr: Any = None, whole_end: bool = False,
    ) -> None:  # fmt: skip
        self.returncode: int | None = None
        self._read: dict[str, int] = {}
        ends = []
        for name, file in (("stdout", stdout), ("stderr", stderr)):
            if file is None:
                self._read[name], end = os.pipe()
                ends.append(end)
            else:
                ends.append(os.dup(file if isinstance(file, int) else file.fileno()))
        self._said, says = os.pipe()
        task = {
            "program": program, "arguments": list(arguments), "whole_end": whole_end, "cwd": str(cwd or Path.cwd()),
            "env": dict(os.environ if env is None else env),
        }  # fmt: skip
        socket.send_fds(_server(), [json.dumps(task).encode()], [*ends, says])
        for end in (*ends, says):
            os.close(end)
        self.pid = int(self._line())

    def _line(self) -> bytes:
        found = b""
        while not found.endswith(b"\n"):
            if not (more := os.read(self._said, 1)):
                raise RuntimeError("the process that is forked from has ended")
            found += more
        return found

    def poll(self) -> int | None:
        """The exit code, negative for a signal; None while it runs."""
        if self.returncode is None and _readable(self._said, 0.0):
            self.returncode = int(self._line())
            os.close(self._said)
        return self.returncode

    def wait(self, timeout: float = 240.0) -> int:
        """The exit code, when it has ended."""
        if self.returncode is None and not _readable(self._said, timeout):
            raise subprocess.TimeoutExpired("a forked process", timeout)
        code = self.poll()
        assert code is not None
        return code

    def communicate(self, timeout: float = 240.0) -> tuple[str, str]:
        """What it writes to its pipes until it ends; empty for one that has none."""
        end = time.monotonic() + timeout
        found = dict.fromkeys(("stdout", "stderr"), b"")
        with selectors.DefaultSelector() as waiting:
            for name, number in self._read.items():
                waiting.register(number, selectors.EVENT_READ, name)
            while waiting.get_map():
                ready = waiting.select(max(0.0, end - time.monotonic()))
                if not ready:
                    raise subprocess.TimeoutExpired("a forked process", timeout)
                for key, _ in ready:
                    more = os.read(key.fd, 2**16)
                    found[key.data] += more
                    if not more:
                        waiting.unregister(key.fd)
                        os.close(key.fd)
        self._read = {}
        self.wait(max(0.0, end - time.monotonic()))
        return found["stdout"].decode(), found["stderr"].decode()

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def _readable(number: int, seconds: float) -> bool:
    with selectors.DefaultSelector() as waiting:
        waiting.register(number, selectors.EVENT_READ)
        return bool(waiting.select(seconds))


@functools.cache
def _server() -> socket.socket:
    """The line to the process that forks, which this process has one of."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    # Of a session of its own: who stops the tests stops it by hanging up.
    process = subprocess.Popen(
        [sys.executable, __file__, str(theirs.fileno())], pass_fds=[theirs.fileno()], start_new_session=True,
        env={name: value for name, value in os.environ.items() if name not in OF_JAX}, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    theirs.close()

    def hang_up() -> None:
        ours.close()
        process.wait()

    atexit.register(hang_up)
    return ours


# ---- The process that forks ----


def _serve(line: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Fork for every task that comes; in a fork, its task and its files."""
    running: dict[int, int] = {}
    with selectors.DefaultSelector() as waiting:
        waiting.register(line, selectors.EVENT_READ)
        while True:
            ready = waiting.select(_LOOK_S if running else None)
            for pid in list(running):
                found, status = os.waitpid(pid, os.WNOHANG)
                if found:
                    says = running.pop(pid)
                    # Nobody may be there to hear it.
                    with contextlib.suppress(BrokenPipeError):
                        os.write(says, b"%d\n" % os.waitstatus_to_exitcode(status))
                    os.close(says)
            if not ready:
                continue
            message, files, *_ = socket.recv_fds(line, 2**20, 3)
            if not message:
                os._exit(0)
            *streams, says = files
            with warnings.catch_warnings():
                # Of the thread that frees the memory of a library, and of nobody's work.
                warnings.simplefilter("ignore", DeprecationWarning)
                pid = os.fork()
            if not pid:
                for number in (*running.values(), says):
                    os.close(number)
                line.close()
                return json.loads(message), streams
            running[pid] = says
            os.write(says, b"%d\n" % pid)
            for number in streams:
                os.close(number)


def _stream(number: int, *, unbuffered: bool) -> Any:
    """A standard stream as Python makes it."""
    raw = io.FileIO(number, "wb", closefd=False)
    errors = "strict" if number == 1 else "backslashreplace"
    return io.TextIOWrapper(
        raw if unbuffered else io.BufferedWriter(raw), encoding="utf-8", errors=errors, line_buffering=number == 2,
        write_through=unbuffered,
    )  # fmt: skip


def _become(task: dict[str, Any], files: Sequence[int]) -> dict[str, Any]:
    """Take on the folder, the variables and the streams of a task; the names of its program."""
    for number, file in enumerate(files, start=1):
        os.dup2(file, number)
        os.close(file)
    os.chdir(task["cwd"])
    os.environ.clear()
    os.environ.update(task["env"])
    unbuffered = bool(os.environ.get("PYTHONUNBUFFERED"))
    sys.stdout, sys.stderr = (_stream(number, unbuffered=unbuffered) for number in (1, 2))
    sys.__stdout__, sys.__stderr__ = sys.stdout, sys.stderr
    sys.argv = ["-c", *task["arguments"]]
    sys.path[0] = ""
    config = sys.modules["jax"].config
    for variable, kind in OF_JAX.items():
        if variable in os.environ:
            config.update(variable.lower(), kind(os.environ[variable]))
    main = sys.modules["__main__"] = ModuleType("__main__")
    return vars(main)


def _run(task: dict[str, Any], files: Sequence[int]) -> None:
    names = _become(task, files)
    program = compile(task["program"], "<string>", "exec")
    if task["whole_end"]:
        exec(program, names)
        return
    code: Any = 0
    try:
        exec(program, names)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)


def _main() -> None:
    for name in IMPORTED:
        importlib.import_module(name)
    list(importlib.import_module("pl_mc.studies.registry").KINDS.values())
    gc.collect()
    gc.freeze()
    _run(*_serve(socket.socket(fileno=int(sys.argv[1]))))


if __name__ == "__main__":
    _main()
