"""Ways to damage a file: what disks, transfers, editors and hands do; functions of the bytes and a generator."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from numpy.random import Generator

_NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eEdD][-+]?\d+)?")
_STRANGE = (
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e400", b"1e-320", b"-1", b"0", b"", b"1,5", b"0x10", b"1_000",
    b"99999999999999999999", b"-99999999999999999999", b"--5", b"1e", b".", b"\xd9\xa3", b"true", b"1e9", b"-0.0",
)  # fmt: skip


def flip(content: bytes, rng: Generator) -> bytes:
    """One to four bytes become others."""
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        changed[int(rng.integers(len(changed)))] = int(rng.integers(256))
    return bytes(changed)


def digit(content: bytes, rng: Generator) -> bytes:
    """One to three digits become other digits: the one damage that leaves a file well formed."""
    changed = bytearray(content)
    places = [k for k, byte in enumerate(content) if 48 <= byte <= 57]
    for _ in range(int(rng.integers(1, 4)) if places else 0):
        changed[places[int(rng.integers(len(places)))]] = 48 + int(rng.integers(10))
    return bytes(changed)


def delete(content: bytes, rng: Generator) -> bytes:
    """One to forty bytes are gone."""
    at = int(rng.integers(len(content)))
    return content[:at] + content[at + int(rng.integers(1, 41)) :]


def insert(content: bytes, rng: Generator) -> bytes:
    """One to twenty bytes that were not there."""
    at = int(rng.integers(len(content) + 1))
    return content[:at] + rng.integers(0, 256, int(rng.integers(1, 21)), dtype="u1").tobytes() + content[at:]


def shift(content: bytes, rng: Generator) -> bytes:
    """A blank more or less in a line."""
    at = int(rng.integers(len(content)))
    blank = content.find(b" ", at)
    if rng.random() < 0.5 or blank < 0:
        return content[:at] + b" " + content[at:]
    return content[:blank] + content[blank + 1 :]


def double_line(content: bytes, rng: Generator) -> bytes:
    """A line twice."""
    return _with_lines(content, rng, lambda lines, k: [*lines[: k + 1], *lines[k:]])


def drop_line(content: bytes, rng: Generator) -> bytes:
    """A line less."""
    return _with_lines(content, rng, lambda lines, k: [*lines[:k], *lines[k + 1 :]])


def swap_lines(content: bytes, rng: Generator) -> bytes:
    """Two lines have changed places."""
    lines = content.split(b"\n")
    j, k = (int(one) for one in rng.integers(0, len(lines), 2))
    lines[j], lines[k] = lines[k], lines[j]
    return b"\n".join(lines)


def truncate(content: bytes, rng: Generator) -> bytes:
    """The file ends early."""
    return content[: int(rng.integers(len(content)))]


def strange_number(content: bytes, rng: Generator) -> bytes:
    """A number becomes a huge, negative, missing or impossible one; in half of the cases of the same width."""
    found = list(_NUMBER.finditer(content))
    if not found:
        return content
    one = found[int(rng.integers(len(found)))]
    new = _STRANGE[int(rng.integers(len(_STRANGE)))]
    if rng.random() < 0.5:
        width = one.end() - one.start()
        new = new[:width].rjust(width)
    return content[: one.start()] + new + content[one.end() :]


def swap_fields(content: bytes, rng: Generator) -> bytes:
    """Two numbers have changed places."""
    found = list(_NUMBER.finditer(content))
    if len(found) < 2:
        return content
    j, k = sorted(int(one) for one in rng.choice(len(found), 2, replace=False))
    first, second = found[j], found[k]
    before, between, after = (content[: first.start()], content[first.end() : second.start()], content[second.end() :])
    return before + second[0] + between + first[0] + after


def encode(content: bytes, rng: Generator) -> bytes:
    """Another encoding, other line ends, tabs for blanks."""
    text = content.decode("latin-1")
    forms: tuple[Callable[[], bytes], ...] = (
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-8-sig"),
        lambda: text.replace("\n", "\r\n").encode("latin-1"),
        lambda: text.replace("\n", "\r").encode("latin-1"),
        lambda: text.replace("    ", "\t").encode("latin-1"),
        lambda: text.replace(" ", "\u00a0").encode("utf-8"),
        lambda: text.replace("-", "\u2212").encode("utf-8"),
        lambda: text.upper().encode("latin-1", "replace"),
        lambda: text.replace("\n", "\0\n", 1).encode("latin-1"),
    )
    return forms[int(rng.integers(len(forms)))]()


def empty(content: bytes, rng: Generator) -> bytes:
    """Nothing, or next to nothing."""
    forms = (b"", b" ", b"\n", b"\n" * 1000, b"\0" * 100, content[:1], content.split(b"\n")[0])
    return forms[int(rng.integers(len(forms)))]


def mark(content: bytes, rng: Generator) -> bytes:
    """What editors and transfers leave: a byte-order mark, blank lines before, within and after."""
    forms = (
        lambda: b"\xef\xbb\xbf" + content,
        lambda: b"\n" * int(rng.integers(1, 4)) + content,
        lambda: content + b"\n  \n" * int(rng.integers(1, 4)),
        lambda: _with_lines(content, rng, lambda lines, k: [*lines[:k], b"", *lines[k:]]),
        lambda: content + b"\0" * int(rng.integers(1, 200)),
    )
    return forms[int(rng.integers(len(forms)))]()


def repeat_part(content: bytes, rng: Generator) -> bytes:
    """Some lines once more, as where files are put together: an epoch, a record, a header."""
    count = int(rng.integers(2, 60))
    return _with_lines(content, rng, lambda lines, k: [*lines[: k + count], *lines[k:]])


def event(content: bytes, rng: Generator) -> bytes:
    """An event of a receiver: the antenna moves, another site, header lines that repeat or change what was said."""
    lines = content.split(b"\n")
    old = b"2.1" in content[:9]
    starts = [k for k, line in enumerate(lines) if line.startswith((b">", b"&", b" 20 "))] or [len(lines) // 2]
    said = (
        (b"OTHER".ljust(60) + b"MARKER NAME",),
        (b"  3582913.8991   532590.1966  5232750.2961".ljust(60) + b"APPROX POSITION XYZ",),
        tuple(line for line in lines[:20] if b"TYPES" in line),
        (b"     1    L9".ljust(60) + b"# / TYPES OF OBSERV",),
        (b"        1.5000        0.0000        0.0000".ljust(60) + b"ANTENNA: DELTA H/E/N",),
        (),
    )[int(rng.integers(6))]
    flag, count = int(rng.integers(2, 6)), len(said) + (0 if rng.random() < 0.8 else int(rng.integers(-1, 3)))
    head = (b" " * 28 if old else b">" + b" " * 30) + b"%d%3d" % (flag, max(count, 0))
    at = starts[int(rng.integers(len(starts)))]
    return b"\n".join([*lines[:at], head, *said, *lines[at:]])


def other_word(content: bytes, rng: Generator) -> bytes:
    """A number of a message becomes one that forbids the use, or is of another week."""
    found = list(re.finditer(rb"[ -]\d\.\d{12}[eEdD][-+]\d\d", content))
    if not found:
        return mark(content, rng)
    one = found[int(rng.integers(len(found)))]
    value = (8192.0, 6144.0, 32767.0, -1.0, -2.0, 1.0, 63.0, 2111.0, 755.0, 604800.0, 388814.0)[int(rng.integers(11))]
    new = f"{value:19.12e}".replace("e", chr(one[0][-4])).encode()
    return content[: one.start()] + new + content[one.end() :]


MUTATIONS: Mapping[str, Callable[[bytes, Generator], bytes]] = {
    "bytes flipped": flip,
    "digits exchanged": digit,
    "bytes deleted": delete,
    "bytes inserted": insert,
    "columns shifted": shift,
    "line doubled": double_line,
    "line dropped": drop_line,
    "lines swapped": swap_lines,
    "cut short": truncate,
    "strange number": strange_number,
    "numbers swapped": swap_fields,
    "other encoding": encode,
    "emptied": empty,
    "marks and blanks": mark,
    "part repeated": repeat_part,
    "event inserted": event,
    "message of another meaning": other_word,
}


def same_columns(one: bytes, other: bytes) -> bool:
    """Whether two files of fixed columns differ in digits alone."""
    return re.sub(rb"\d", b"0", one) == re.sub(rb"\d", b"0", other)


def same_values(one: bytes, other: bytes) -> bool:
    """Whether two RINEX files of observations differ in digits, missing values and fewer last epochs alone.

    What stands in columns that are not read, beside the pseudorange, is nobody's business.
    """
    damaged, whole = one.rstrip().split(b"\n"), other.rstrip().split(b"\n")
    used = slice(32, 46) if b"2.11" in other[:9] else slice(0, 17)
    for k, line in enumerate(whole[: len(damaged)]):
        if re.fullmatch(rb"(?:[A-Z]\d\d)?[ \d.]+", line) and b"." in line and not line.startswith(b" 20  6"):
            damaged[k], whole[k] = damaged[k][used], line[used]
    masked, sound = _values_masked(damaged), _values_masked(whole)
    ends_an_epoch = len(masked) == len(sound) or re.match(rb">| 00 | {28}\d", ([*sound, b">"])[len(masked)])
    return masked == sound[: len(masked)] and bool(ends_an_epoch)


def same_numbers(one: bytes, other: bytes) -> bool:
    """Whether two RINEX files of ephemerides differ in digits and signs alone; all lines of a record look alike."""
    masked = (re.sub(rb"[ +-]\d?(?=\.\d)", b" 0", content) for content in (one, other))
    return same_columns(*(re.sub(rb"[eEdD][+-]", b"E+", content) for content in masked))


def same_words(one: bytes, other: bytes) -> bool:
    """Whether two files of free columns differ in the values of numbers and in blanks alone."""
    return _words(one) == _words(other)


def fewer_lines(one: bytes, other: bytes) -> bool:
    """Whether the lines of a file are lines of the other, but for the values of numbers; a table has no length.

    What a comment says is nobody's business, a line of the table that ran into it included.
    """
    lines = {line for line in _words(one).split(b"\n") if not line.startswith(b"#")}
    return lines <= set(_words(other).split(b"\n"))


def _values_masked(lines: list[bytes]) -> list[bytes]:
    masked, inside = [], False
    for line in lines:
        inside = inside or b"END OF HEADER" in line
        name = 3 if re.match(rb"[A-Z]\d\d", line) else 0
        fields = [line[k : k + 14] for k in range(name, len(line), 16)]
        if inside and all(re.fullmatch(rb" *| *-?\d*\.\d{3}", field) for field in fields):
            masked.append(re.sub(rb"\d", b"0", line[:name]))
        else:
            masked.append(re.sub(rb"\d", b"0", line))
    return masked


def _words(content: bytes) -> bytes:
    return re.sub(rb"[ \t\r]*([ \t\r,])[ \t\r]*", rb"\1", _NUMBER.sub(b"0", content)).strip()


def _with_lines(content: bytes, rng: Generator, change: Callable[[list[bytes], int], list[bytes]]) -> bytes:
    lines = content.split(b"\n")
    return b"\n".join(change(lines, int(rng.integers(len(lines)))))
