"""From a file on disk to the bytes that its author wrote: gzip, bzip2, xz, zip and compress (.Z) undone, within limits.

Nothing here can stall or fill the memory: only regular files are read, and what is unpacked has a largest size.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import stat
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

from pl_mc.input_errors import InputError

# A day of one receiver at 10 Hz is a few hundred megabytes; what unpacks to more is no such file.
LARGEST_BYTES = 2_000_000_000

# A day of one receiver at 1 Hz has four million lines. What takes no room packed, such as empty lines, takes a
# hundred bytes each when they are told apart.
_MOST_LINES = 20_000_000

# A gzipped file within a zip archive; nothing that people send is packed more often.
_LAYERS = 3

# Codes of compress have 9 bits at first, come in groups of eight, and 256 clears the table where the header says so.
_FIRST_BITS, _MOST_BITS, _CODES_IN_A_GROUP, _CLEAR = 9, 16, 8, 256


def read_unzipped(path: Path) -> bytes:
    """The content of a text file, unpacked: plain, ``.gz``, ``.bz2``, ``.xz``, ``.zip`` with one file, or ``.Z``.

    What a file is shows in its first bytes, not in its name.

    Raises:
        InputError: it is missing, no regular file, unreadable, too long, of too many lines, or its packing is damaged.
    """
    content = _content(path)
    for _ in range(_LAYERS):
        packing = next((packing for magic, packing in _PACKINGS.items() if content.startswith(magic)), None)
        if packing is None:
            break
        name, unpacked = packing
        try:
            with unpacked(content) as file:
                content = file.read(LARGEST_BYTES + 1)
        except (EOFError, ValueError, OSError, RuntimeError, zlib.error, lzma.LZMAError, zipfile.BadZipFile) as error:
            reason = f" ({error})" if isinstance(error, _Refused) else ""
            raise InputError(f"{path}: the {name} file is cut short or damaged{reason}.") from None
        if len(content) > LARGEST_BYTES:
            raise InputError(
                f"{path}: it unpacks to more than {LARGEST_BYTES / 1e9:g} GB, which no file of its kind does."
            )
    if content.count(b"\n") + content.count(b"\r") > _MOST_LINES:
        raise InputError(f"{path}: it has more than {_MOST_LINES / 1e6:g} million lines; cut it into several files.")
    return content


class _Refused(ValueError):
    """Why something cannot be unpacked, in words."""


def _content(path: Path) -> bytes:
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
    return content


def _zipped(content: bytes) -> IO[bytes]:
    """The one file of an archive."""
    archive = zipfile.ZipFile(io.BytesIO(content))
    files = [member for member in archive.infolist() if not member.is_dir()]
    if len(files) != 1:
        raise _Refused(f"it holds {len(files)} files, and one is needed; unpack it")
    return archive.open(files[0])


def _compressed(content: bytes) -> IO[bytes]:
    """What the Unix program ``compress`` packed: the adaptive code of Lempel, Ziv and Welch (Welch 1984)."""
    if len(content) < 3:
        raise EOFError
    most_bits, clears = content[2] & 0x1F, bool(content[2] & 0x80)
    if not _FIRST_BITS <= most_bits <= _MOST_BITS:
        raise _Refused(f"its codes have {most_bits} bits, and 9 to 16 are possible")
    start = [bytes([k]) for k in range(256)] + ([b""] if clears else [])
    table, before, bits, parts, size = list(start), b"", _FIRST_BITS, [], 0
    at = 3
    while at < len(content) and size <= LARGEST_BYTES:
        # Codes of one width come in groups, of which the rest means nothing where the width changes.
        group = content[at : at + bits]
        at += bits
        value = int.from_bytes(group, "little")
        for _ in range(min(_CODES_IN_A_GROUP, 8 * len(group) // bits)):
            code, value = value & ((1 << bits) - 1), value >> bits
            if clears and code == _CLEAR:
                table, before, bits = list(start), b"", _FIRST_BITS
                break
            if code > len(table) or (code == len(table) and not before):
                raise _Refused("a code stands for nothing")
            # A code may stand for the entry that it makes itself.
            entry = table[code] if code < len(table) else before + before[:1]
            if before and len(table) < 1 << most_bits:
                table.append(before + entry[:1])
            before = entry
            parts.append(entry)
            size += len(entry)
            if len(table) >= 1 << bits and bits < most_bits:
                bits += 1
                break
    return io.BytesIO(b"".join(parts))


_PACKINGS: Mapping[bytes, tuple[str, Callable[[bytes], Any]]] = {
    b"\x1f\x8b": ("gzip", lambda content: gzip.GzipFile(fileobj=io.BytesIO(content))),
    b"BZh": ("bzip2", lambda content: bz2.BZ2File(io.BytesIO(content))),
    b"\xfd7zXZ\0": ("xz", lambda content: lzma.LZMAFile(io.BytesIO(content))),  # noqa: SIM115
    b"PK\x03\x04": ("zip", _zipped),
    b"\x1f\x9d": (".Z", _compressed),
}
