"""What became of a damaged file, and the process in which many of them are read one after another.

Outcomes:

- ``refused``: an `InputError`, one sentence a line.
- ``same``: numbers as of the sound file.
- ``told``: other numbers, and the notes say something that they do not say of the sound file.
- ``well formed``: other numbers and no new note, but the damaged file is as well formed as the sound one: other
  digits in the same columns, another number where columns are free, a table with fewer lines.
- ``accepted``: nothing to compare with.
- ``silent``: other numbers, no new note, and a damage that shows in the form of the file. A finding.
- ``exception``, ``sentence``, ``hang``, ``crash``: another exception, a refusal that is no sentence, no end within
  the limit, an end of the process. Findings.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

FINDINGS = ("silent", "exception", "sentence", "hang", "crash")
LIMIT_S = 60.0

# The mutation of a case that is a call with strange arguments instead of a file.
STRANGE_ARGUMENTS = "strange arguments"


@dataclass(frozen=True)
class Case:
    """One damaged file: its kind, the mutation and the number that seeds it."""

    subject: str
    mutation: str
    number: int


@dataclass(frozen=True)
class Outcome:
    """What became of it, with the sentence, the trace or the difference, the seconds that it took and the memory.

    ``peak_gb`` is what the process that judged it held at most meanwhile; NaN where it was judged here, or where the
    process ended.
    """

    subject: str
    mutation: str
    number: int
    outcome: str
    detail: str
    seconds: float
    peak_gb: float = math.nan


def cases(names: Sequence[str], mutations: Iterable[str], count: int) -> list[Case]:
    """``count`` cases, kinds and mutations in turn."""
    pairs = [(name, mutation) for mutation in mutations for name in names]
    return [Case(*pairs[k % len(pairs)], number=k // len(pairs)) for k in range(count)]


def damaged(case: Case) -> bytes:
    """The file of a case."""
    from mutations import MUTATIONS
    from subjects import subjects

    return MUTATIONS[case.mutation](subjects()[case.subject].content, generator_of(case))


def generator_of(case: Case) -> np.random.Generator:
    """The generator of a case, the same wherever it is judged."""
    return np.random.default_rng([case.number, zlib.crc32(case.subject.encode()), zlib.crc32(case.mutation.encode())])


def judge(case: Case, folder: Path) -> Outcome:
    """Read the file of a case, or make its call, and say what became of it."""
    return _judged_call(case) if case.mutation == STRANGE_ARGUMENTS else _judged_file(case, folder)


def _judged_call(case: Case) -> Outcome:
    from api_calls import calls, with_strange

    call = calls()[case.subject]
    arguments = with_strange(call, np.random.default_rng([case.number, zlib.crc32(case.subject.encode())]))
    begin = time.perf_counter()
    # Some of the strange values are names of folders; what is written there is gone with the case.
    with tempfile.TemporaryDirectory() as place:
        inside = Path(place, "a", "b")
        inside.mkdir(parents=True)
        with contextlib.chdir(inside):
            _, outcome, detail = attempted(lambda: call.function(**arguments))
    if outcome == "exception":
        changed = {key: repr(value)[:200] for key, value in arguments.items() if value is not call.arguments[key]}
        detail = f"{changed}\n{detail}"
    return Outcome(
        **asdict(case), outcome=outcome or "accepted", detail=detail[-3000:], seconds=time.perf_counter() - begin
    )


def attempted(action: Callable[[], Any]) -> tuple[Any, str, str]:
    """What it gives, and no outcome; or nothing, how it ended (a refusal, another exception), and what was said."""
    from pl_mc.input_errors import InputError

    try:
        return action(), "", ""
    except InputError as error:
        return None, "refused" if is_sentence(str(error)) else "sentence", str(error)
    except Exception:
        return None, "exception", traceback.format_exc()


def is_sentence(said: str) -> bool:
    """Whether a refusal is one sentence a line, without a trace."""
    return all(line.endswith((".", "?")) for line in said.split("\n")) and "Traceback" not in said


def _judged_file(case: Case, folder: Path) -> Outcome:
    from subjects import subjects

    subject = subjects()[case.subject]
    content = damaged(case)
    path = folder / f"damaged{subject.suffix}"
    path.write_bytes(content)
    begin = time.perf_counter()
    read, outcome, detail = attempted(lambda: subject.read(path))
    if outcome == "refused" and path.name not in detail and subject.tolerance is not None:
        # A refusal names the file; checks of experiments name their fields.
        outcome = "sentence"
    if not outcome:
        sound = _sound(case.subject)
        detail = _difference(read.numbers, sound.numbers, subject.tolerance or 0.0)
        if subject.tolerance is None:
            outcome = "accepted"
        elif not detail:
            outcome = "same"
        elif set(read.notes) - set(sound.notes):
            outcome = "told"
        else:
            outcome = "well formed" if subject.alike(content, subject.content) else "silent"
    return Outcome(**asdict(case), outcome=outcome, detail=detail[:3000], seconds=time.perf_counter() - begin)


_SOUND: dict[str, object] = {}


def _sound(name: str):  # type: ignore[no-untyped-def]
    from subjects import subjects

    if name not in _SOUND:
        subject = subjects()[name]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"sound{subject.suffix}")
            path.write_bytes(subject.content)
            _SOUND[name] = subject.read(path)
    return _SOUND[name]


def _difference(found: dict[str, float], sound: dict[str, float], tolerance: float) -> str:
    """The first difference in words; empty where there is none."""
    for key in sorted(set(found) | set(sound)):
        if key not in found:
            return f"{key} is missing ({len(set(sound) - set(found))} in all)"
        if key not in sound:
            return f"{key} is new"
        if not math.isfinite(found[key]) or abs(found[key] - sound[key]) > tolerance:
            return f"{key} is {found[key]:.6g}, not {sound[key]:.6g}"
    return ""


def outcomes(wanted: Iterable[Case], limit_s: float = LIMIT_S, program: str | Path = __file__) -> Iterator[Outcome]:
    """The outcomes of cases, read in a process of its own that is started anew where one hangs or ends it."""
    process: subprocess.Popen[bytes] | None = None
    try:
        for case in wanted:
            if process is None:
                process = _start(program)
            begin = time.perf_counter()
            answer = _answer(process, case, limit_s)
            if answer is None:
                outcome = "hang" if process.poll() is None else "crash"
                _end(process)
                process = None
                yield Outcome(**asdict(case), outcome=outcome, detail="", seconds=time.perf_counter() - begin)
            else:
                yield Outcome(**answer)
    finally:
        if process is not None:
            _end(process)


def _start(program: str | Path) -> subprocess.Popen[bytes]:
    process = subprocess.Popen([sys.executable, str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
    # The start is not part of any case.
    assert _line(process, 120.0) == b"ready\n"
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        pipe.close()
    process.wait()


def _answer(process: subprocess.Popen[bytes], case: Case, limit_s: float) -> dict | None:
    assert process.stdin is not None
    try:
        process.stdin.write(json.dumps(asdict(case)).encode() + b"\n")
    except BrokenPipeError:
        process.wait()
        return None
    line = _line(process, limit_s)
    return json.loads(line) if line and line.endswith(b"\n") else None


def _line(process: subprocess.Popen[bytes], limit_s: float) -> bytes | None:
    """A line of the process, what came of it when it ended, or None when time is up."""
    assert process.stdout is not None
    end, line = time.monotonic() + limit_s, b""
    while not line.endswith(b"\n"):
        ready, _, _ = select.select([process.stdout], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            return None
        part = os.read(process.stdout.fileno(), 65536)
        if not part:
            process.wait()
            return line
        line += part
    return line


def serve(
    judged: Callable[[Case, Path], Outcome] = judge, prepare: Callable[[Path], object] = lambda folder: None
) -> None:
    """Judge the cases that come as lines, in a folder that is prepared before the first."""
    import jax

    import pl_mc  # noqa: F401

    jax.config.update("jax_enable_x64", True)
    # Whoever turns warnings into errors gets a traceback of them.
    warnings.simplefilter("error")
    sys.path.insert(0, str(Path(__file__).parent))
    # What a library prints must not be taken for an answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        print("ready", file=answers, flush=True)
        for line in sys.stdin:
            # The high-water mark of this process begins anew (Linux, `man proc_pid_clear_refs`).
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
            outcome = judged(Case(**json.loads(line)), Path(folder))
            print(json.dumps(asdict(outcome) | {"peak_gb": _peak_gb()}), file=answers, flush=True)


def _peak_gb() -> float:
    """The largest memory of this process since its mark began anew, or of a process that it started."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert found is not None
    return max(int(found[1]), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) / 1e6


if __name__ == "__main__":
    serve()
