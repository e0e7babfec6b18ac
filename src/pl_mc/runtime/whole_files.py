"""Files that are there whole or not at all, and the one who may write into a folder."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from pl_mc.input_errors import InputError

try:
    import fcntl
except ImportError:  # Where there is no such lock, nobody is kept out.
    fcntl = None  # type: ignore[assignment]


def write_whole(place: Path, content: bytes | str) -> None:
    """Write a file that is there whole or not at all, also if the process or the machine stops meanwhile.

    A file that holds the content already is left as it is; text is written as UTF-8.
    """
    content = content.encode() if isinstance(content, str) else content
    with contextlib.suppress(OSError):
        if place.stat().st_size == len(content) and place.read_bytes() == content:
            return
    # Process numbers alone are no name: containers that share a folder have the same.
    working = place.with_name(f".{place.name}.{os.getpid()}-{secrets.token_hex(4)}")
    try:
        with working.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(working, place)
    finally:
        working.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """The right to write a folder, alone or together with others that ask for a shared one.

    It is held by a lock of the operating system on a file beside the folder, so that it ends with the process, in
    whatever way that ends.

    Raises:
        InputError: somebody else has it.
        OSError: the place cannot be written to.
    """
    if fcntl is None:
        yield
        return
    place = folder.with_name(f".{folder.name}.lock")
    while True:
        handle = os.open(place, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            who = os.read(handle, 20).decode("ascii", "replace").strip()
            os.close(handle)
            process = f" (process {who})" if who.isdecimal() else ""
            raise InputError(
                f"{folder}: another run is writing there{process}; wait for its end, or name another folder (--out)."
            ) from None
        except OSError:  # A file system without locks.
            pass
        # Whoever held it before may have removed the file meanwhile.
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), place.stat()):
                break
        os.close(handle)
    try:
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        # The last one that shares it removes the file.
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            place.unlink()
        os.close(handle)
