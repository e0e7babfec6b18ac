"""Compiled programs that the command line keeps in the user's cache folder, so that the next process finds them.

JAX has such a cache, which is used here, but for how it stores: JAX writes files in place, and takes what it finds for
whole. Here a file is whole or not at all, and begins with a checksum of the rest: one that another process is writing,
or that a disk has spoiled, is no file, and is compiled and written anew.

The programs are machine code for the processor that they were compiled on, of which JAX's own keys say nothing
certain: each sort of processor has a folder of its own.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import sys
import warnings
from pathlib import Path
from typing import Any

from pl_mc.runtime.threads import cores
from pl_mc.runtime.whole_files import write_whole

# Names another folder; `off` keeps nothing.
VARIABLE, OFF = "PL_MC_CACHE", "off"
# A folder of the user's own choice, which JAX fills and reads in its own way.
_OF_JAX = "JAX_COMPILATION_CACHE_DIR"

# What takes less time to compile is compiled anew [s].
_LEAST_S = 0.02
# Beyond so many bytes the programs that were not used for the longest time go, until half of it is left.
MOST_BYTES = 500_000_000

_CHECKSUM = hashlib.sha256
_CHECKSUM_BYTES = _CHECKSUM().digest_size


class KeptPrograms:
    """The cache of JAX, in files that are whole or not there (its interface is `get` and `put`).

    Args:
        folder: where they are.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder

    def get(self, key: str) -> bytes | None:
        """The program of a key; None where there is no such file, or a spoilt one."""
        place = self._path / key
        with contextlib.suppress(OSError):
            content = place.read_bytes()
            checksum, program = content[:_CHECKSUM_BYTES], content[_CHECKSUM_BYTES:]
            if checksum == _CHECKSUM(program).digest():
                os.utime(place)
                return program
        return None

    def put(self, key: str, program: bytes) -> None:
        """Keep a program, where there is room for it."""
        with contextlib.suppress(OSError):
            write_whole(self._path / key, _CHECKSUM(program).digest() + program)


def keep_programs() -> None:
    """From now on JAX looks for programs among the kept ones, and keeps what it compiles.

    For commands alone, which own their process. Where the folder cannot be used, or this version of JAX stores
    programs in another way, everything is compiled as if there were none; nothing is said of it.
    """
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache")
    if os.environ.get(_OF_JAX) or os.environ.get(VARIABLE) == OFF:
        return
    import jax

    store: Any = sys.modules.get("jax._src.compilation_cache")
    if not hasattr(store, "get_file_cache") or getattr(jax.config, "jax_compilation_cache_dir", None):
        return
    try:
        folder = cache_folder() / _processor()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
            # Another user's machine code is not run.
            return
        _make_room(folder.parent)
    except (OSError, RuntimeError):
        return
    store.get_file_cache = lambda path: (KeptPrograms(Path(path)), path)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _LEAST_S)


def cache_folder() -> Path:
    """The folder of kept programs: that of the variable, else one in the user's cache folder.

    Raises:
        RuntimeError: nobody knows the user's home.
    """
    if named := os.environ.get(VARIABLE):
        return Path(named).expanduser()
    if sys.platform == "win32":
        above = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        above = Path.home() / "Library" / "Caches"
    else:
        given = os.environ.get("XDG_CACHE_HOME", "")
        # By its specification a relative one is to be ignored.
        above = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    return above / "pl_mc" / "programs"


def _processor() -> str:
    """A name for processors that run each other's programs, and for which the compiler makes the same ones."""
    about = [platform.system(), platform.machine(), platform.processor(), str(cores())]
    with contextlib.suppress(OSError):
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").partition("\n\n")[0]
        # All but what changes while it runs, or from one core to the next.
        kinds = ("vendor", "cpu family", "model", "stepping", "flags", "features", "cpu part", "cpu variant", "isa")
        about += [line for line in first.lower().splitlines() if line.startswith(kinds)]
    return _CHECKSUM("\n".join(about).encode()).hexdigest()[:16]


def _make_room(folder: Path) -> None:
    """Delete the programs that were not used for the longest time, of all processors, where there are too many."""
    files = []
    for file in folder.glob("*/*"):
        # Another process may delete the same ones.
        with contextlib.suppress(OSError):
            about = file.stat()
            files.append((about.st_mtime, about.st_size, file))
    total = sum(size for _, size, _ in files)
    if total <= MOST_BYTES:
        return
    for _, size, file in sorted(files):
        if total <= MOST_BYTES // 2:
            break
        with contextlib.suppress(OSError):
            file.unlink()
        total -= size
