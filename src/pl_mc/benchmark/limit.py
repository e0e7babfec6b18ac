"""A hand-written kernel to compare with: another program, given the same problem in a file, tells its own rate.

The program is the user's. It is called as ``PROGRAM INPUT OUTPUT THREADS REPEATS`` and prints its best rate in
million scenarios per second. INPUT holds doubles: n, t, S, iterations, k0, k1, K_V, the up column; the design
(n, t), n weights, n standard deviations of residuals, the observations (n, S). OUTPUT holds S protection levels. A
source in C++ is compiled for each precision with ``-DREAL=double`` or ``-DREAL=float``.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pl_mc.benchmark.batched_numpy import Numbers, NumpyModel
from pl_mc.benchmark.problem import ROBUST
from pl_mc.geometry.record import UP, Geometry
from pl_mc.input_errors import InputError

SOURCES = (".cpp", ".cc", ".cxx")
FLAGS = ("-O3", "-march=native", "-ffast-math")
_REAL = {"float64": "double", "float32": "float"}

# The program tells the best of these; that favours it a little.
REPEATS = 3

_LONGEST_S = 300.0


@dataclass(frozen=True)
class Limit:
    """A program that is ready to run.

    Attributes:
        program: the executable; ``folder``: where its input and output lie.
        precision: what it computes in, as its output shows; ``threads``: what it is given.
        vpl_m: (scenarios,), the protection levels that it found [m].
    """

    program: Path
    precision: str
    threads: int
    scenarios: int
    vpl_m: Numbers
    folder: Path

    def seconds(self) -> float:
        """Time for all scenarios, by the program's own clock, the best of a few repetitions [s]."""
        return self.scenarios / 1e6 / _call(self.program, self.folder, self.threads)


@contextlib.contextmanager
def limits(
    path: Path | str, g: Geometry, errors_m: Numbers, *, threads: int, precisions: Sequence[str]
) -> Iterator[list[Limit]]:
    """The program at ``path``, or that source compiled for each precision, on given errors (s, n) [m].

    Raises:
        InputError: no such file, a compiler that is missing or fails, a program that fails or answers otherwise.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"limit: there is no file {path}.")
    with tempfile.TemporaryDirectory(prefix="pl-mc-limit-") as name:
        folder = Path(name)
        programs = [path.absolute()]
        if path.suffix.lower() in SOURCES:
            programs = [_compile(path, folder, precision) for precision in precisions]
        elif not os.access(path, os.X_OK):
            raise InputError(f"limit: {path} is neither a C++ source ({', '.join(SOURCES)}) nor a program.")
        _write_input(folder, g, errors_m)
        yield [_try(program, folder, threads, len(errors_m)) for program in programs]


def _compile(source: Path, folder: Path, precision: str) -> Path:
    compiler = shutil.which("g++")
    if compiler is None:
        raise InputError("limit: a C++ source needs g++, which is not there; give a compiled program.")
    program = folder / f"limit_{precision}"
    command = [compiler, *FLAGS, f"-DREAL={_REAL[precision]}", str(source), "-o", str(program), "-lpthread"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line] or ["no reason given"]
        raise InputError(f"limit: g++ cannot compile {source.name} ({errors[0].split('error: ')[-1]}).")
    return program


def _write_input(folder: Path, g: Geometry, errors_m: Numbers) -> None:
    n, t = g.design.shape
    options = ROBUST
    residual_sigma = g.sigma_m * np.sqrt(NumpyModel(g).redundancy)
    head = [n, t, len(errors_m), options.iterations, options.k0, options.k1, options.k_vertical, UP]
    parts = [np.array(head), g.design.ravel(), g.sigma_m**-2, residual_sigma, errors_m.T.ravel()]
    np.concatenate(parts).astype("<f8").tofile(folder / "input")


def _try(program: Path, folder: Path, threads: int, scenarios: int) -> Limit:
    _call(program, folder, threads)
    try:
        found = np.fromfile(folder / "output", dtype="<f8")
    except OSError:
        found = np.zeros(0)
    if len(found) != scenarios:
        raise InputError(f"limit: {program.name} wrote {len(found)} numbers where {scenarios} are needed.")
    # Numbers of single precision are those that survive a rounding to it.
    single = bool((found == found.astype(np.float32)).all())
    return Limit(program, "float32" if single else "float64", threads, scenarios, found, folder)


def _call(program: Path, folder: Path, threads: int) -> float:
    """The rate that the program prints."""
    command = [str(program), str(folder / "input"), str(folder / "output"), str(threads), str(REPEATS)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        told = "takes too long" if isinstance(error, subprocess.TimeoutExpired) else "cannot be run"
        raise InputError(f"limit: {program.name} {told}.") from None
    try:
        rate = float(done.stdout.split()[-1])
    except (IndexError, ValueError):
        rate = math.nan
    if done.returncode or not rate > 0:
        raise InputError(
            f"limit: {program.name} printed no rate (exit code {done.returncode}); a positive number of million "
            "scenarios per second is needed."
        )
    return rate
