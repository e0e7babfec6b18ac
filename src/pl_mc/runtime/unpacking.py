"""From a file on disk to the bytes that its author wrote: gzip and Hatanaka compression undone, within limits.

Nothing here can stall or fill the memory: only regular files are read, what is unpacked has a largest size, and
the Hatanaka decompressor, a native program, runs behind a child process with a time limit.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import re
import signal
import stat
import subprocess
import sys
import zlib
from pathlib import Path

from pl_mc.input_errors import InputError
from pl_mc.runtime import hatanaka_worker

# A day of one receiver at 10 Hz is a few hundred megabytes; what unpacks to more is no such file.
LARGEST_BYTES = 2_000_000_000

_OTHER_COMPRESSION = {b"\x1f\x9d": ".Z", b"PK": ".zip", b"BZh": ".bz2", b"\xfd7zXZ": ".xz"}

# What compact records hold: differences, flags and changed satellites; no point and no letter else.
_DIFFERENCES = re.compile(rb"[0-9A-Z &-]*")
_FIRST_DIFFERENCE = re.compile(rb"(\d&)?-?\d+( |$)")
_CLOCK = re.compile(rb"(\d&)?-?\d+")
_PRINTABLE = re.compile(rb"[ -~]*")

# Time that decompression may take: some seconds for the start, and many times the usual speed for the rest.
_START_LIMIT_S, _LIMIT_S_PER_MEGABYTE = 15.0, 2.0


def read_unzipped(path: Path) -> bytes:
    """The content of a regular file, plain or gzipped.

    Raises:
        InputError: it is missing, no regular file, unreadable, too long, or a damaged gzip file.
    """
    try:
        status = path.stat()
        regular, size = stat.S_ISREG(status.st_mode), status.st_size
        content = path.read_bytes() if regular and size <= LARGEST_BYTES else b""
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}).") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: this cannot be the name of a file.") from None
    if not regular:
        raise InputError(f"{path}: it cannot be read (it is no regular file).")
    if size > LARGEST_BYTES:
        raise InputError(f"{path}: it is longer than {LARGEST_BYTES / 1e9:g} GB, which no file of its kind is.")
    if not content.startswith(b"\x1f\x8b"):
        return content
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(content)) as file:
            content = file.read(LARGEST_BYTES + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise InputError(f"{path}: the gzip file is cut short or damaged.") from None
    if len(content) > LARGEST_BYTES:
        raise InputError(f"{path}: it unpacks to more than {LARGEST_BYTES / 1e9:g} GB, which no file of its kind does.")
    return content


def read_unpacked(path: Path) -> bytes:
    """The content of a RINEX file: plain, gzipped, Hatanaka-compressed or both.

    Raises:
        InputError: as `read_unzipped`; an empty file, another compression, or damaged Hatanaka compression.
    """
    content = read_unzipped(path)
    for magic, suffix in _OTHER_COMPRESSION.items():
        if content.startswith(magic):
            raise InputError(f"{path}: {suffix} files are not read; RINEX comes plain, as .gz, .crx or .crx.gz.")
    if not content.strip():
        raise InputError(f"{path}: the file is empty.")
    if b"CRINEX VERS" in content[:80]:
        content = _without_hatanaka(path, content)
    return content


def _without_hatanaka(path: Path, content: bytes) -> bytes:
    _require_compact(path, content)
    limit_s = _START_LIMIT_S + _LIMIT_S_PER_MEGABYTE * len(content) / 1e6
    # A session of its own, so that the program that the child starts ends with it.
    child = subprocess.Popen(
        [sys.executable, "-P", hatanaka_worker.__file__, str(LARGEST_BYTES)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        text, said = child.communicate(content, timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{path}: undoing its Hatanaka compression was given up after {limit_s:.0f} s; is it damaged?"
        ) from None
    finally:
        if child.poll() is None:
            _end(child)
    if child.returncode == 0:
        _require_clock_lines(path, content, text)
        return text
    reason = " ".join(said.decode("utf-8", "replace").split())
    if child.returncode != hatanaka_worker.EXIT_REFUSED:
        reason = f"the decompressor broke down, exit code {child.returncode}"
    raise InputError(f"{path}: its Hatanaka compression cannot be undone ({reason or 'no reason given'}).")


def _require_compact(path: Path, content: bytes) -> None:
    """Raise `InputError` unless the records of a compact file are made of its few characters.

    The decompressor takes any character for a digit, and gives a number that means nothing.
    """
    lines = content.split(b"\n")
    begin = next((k for k, line in enumerate(lines) if line[60:].strip() == b"END OF HEADER"), len(lines))
    for number, line in enumerate(lines[begin + 1 :], start=begin + 2):
        # Epochs written in full, and header lines that an event brings, look like RINEX.
        whole = line.startswith((b"&", b">")) or (len(line) > 60 and line[60:61].isalpha())
        form = _PRINTABLE if whole else _DIFFERENCES
        line = line.removesuffix(b"\r")
        broken = not whole and re.match(rb"[\d-]", line) and not _FIRST_DIFFERENCE.match(line)
        if broken or not form.fullmatch(line):
            raise InputError(f"{path}, line {number}: this is no line of Hatanaka compression; the file is damaged.")


def _require_clock_lines(path: Path, content: bytes, text: bytes) -> None:
    """Raise `InputError` where a compact RINEX 3 file has other than a clock offset in the line that belongs to it.

    Below the line of an epoch stand its clock offset, or nothing, and its satellites. The decompressor takes the
    differences of a satellite for those of the clock where two such lines have changed places. Files are looked
    through up to the first event.
    """
    lines = content.replace(b"\r\n", b"\n").split(b"\n")
    at = next((k for k, line in enumerate(lines) if line[60:].strip() == b"END OF HEADER"), len(lines)) + 1
    running = False
    for line in text.split(b"\n"):
        if not line.startswith(b">"):
            continue
        if line[31:32] > b"1" or not line[32:35].strip().isdigit() or at + 1 >= len(lines):
            return
        clock = lines[at + 1].strip()
        if clock and not (_CLOCK.fullmatch(clock) and (running or b"&" in clock)):
            raise InputError(f"{path}, line {at + 2}: this is no clock offset of a Hatanaka file; it is damaged.")
        running = bool(clock)
        at += 2 + int(line[32:35])


def _end(child: subprocess.Popen[bytes]) -> None:
    """Kill a child and what it started, and wait for it."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    else:
        child.kill()
    child.communicate()
