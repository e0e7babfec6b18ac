"""Epochs and events of an observation file as the lines that they are, and those of them that can be read.

The library reads a whole file or nothing. So a file that it refuses, or of which it skips something, is halved until
the epochs are found that hold the damage; of these, what can be read satellite by satellite is kept, and the rest is
named with its line. A sound file is read at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pl_mc.input_errors import InputError
from pl_mc.receiver.rinex_text import RinexText, label_of
from pl_mc.runtime import sidereon_adapter as library

# Header lines that decide what is read; what is wrong with others is nobody's business. The columns and the scale of
# the values are needed, the others are dropped where they cannot be read.
COLUMNS = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV", "SYS / SCALE FACTOR")
_OTHERS = ("TIME OF FIRST OBS", "APPROX POSITION XYZ")

_TIME_2 = r" [ \d]\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d[ \d]{3}\.\d{7}"
_COUNT_2 = r"(?:\d{3}| \d\d|  \d)"
_EPOCH_2 = re.compile(rf"{_TIME_2}  [0-6](?:{_COUNT_2}|   )", re.ASCII)
_EVENT_2 = re.compile(rf" {{28}}[2-6]{_COUNT_2}\s*", re.ASCII)
_FLAG_2, _FLAG_3 = 28, 31
_FLAGS = ("0", "1", "2", "3", "4", "5", "6")

_WIDTH, _GAP = 14, 2
_VALUES_ON_A_LINE_2, _NAMES_ON_A_LINE_2, _FIRST_NAME_2 = 5, 12, 32


class Satellite(NamedTuple):
    """What a block says of one satellite: its name, the number of the line, and the lines of its values."""

    name: str
    number: int
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Block:
    """An epoch or an event of an observation file.

    Attributes:
        number: of its first line in the file.
        first: its first line.
        flag: 0 and 1 are observations, 2 to 5 events, 6 cycle slips.
        satellites: of observations and of cycle slips.
        records: the lines that belong to an event.
        damage: what is wrong with the number of its lines; empty where nothing is.
    """

    number: int
    first: str
    flag: int
    satellites: tuple[Satellite, ...]
    records: tuple[str, ...]
    damage: str = ""

    @property
    def count(self) -> int:
        """How many satellites or lines it has."""
        return len(self.records) if 2 <= self.flag <= 5 else len(self.satellites)

    @property
    def when(self) -> str:
        """Its time, for messages: as a date where it has the form of one, or as it is written."""
        words = self.first[: _FLAG_3 if self.first.startswith(">") else _FLAG_2].lstrip(">").split()
        if len(words) != 6 or not all(word.replace(".", "").isdecimal() for word in words):
            return " ".join(words) or "no time"
        year, month, day, hour, minute, second = words
        century = "" if len(year) > 2 else "19" if int(year) >= 80 else "20"
        whole, _, part = second.partition(".")
        part = f".{part.rstrip('0')}" if part.strip("0") else ""
        return f"{century}{year:0>2}-{month:0>2}-{day:0>2} {hour:0>2}:{minute:0>2}:{whole:0>2}{part}"

    def field(self, satellite: Satellite, place: int) -> str:
        """The columns of a value of one of its satellites, by its place among those of the system."""
        if self.first.startswith(">"):
            begin = 3 + (_WIDTH + _GAP) * place
            return satellite.lines[0][begin : begin + _WIDTH]
        row, column = divmod(place, _VALUES_ON_A_LINE_2)
        begin = (_WIDTH + _GAP) * column
        return satellite.lines[row][begin : begin + _WIDTH] if row < len(satellite.lines) else ""

    def is_overfull(self, satellite: Satellite, count: int) -> bool:
        """Whether the last line of RINEX 2 holds more than its part of so many values: lines have changed places."""
        rest = count - _VALUES_ON_A_LINE_2 * (len(satellite.lines) - 1)
        return not self.first.startswith(">") and bool(satellite.lines[-1][(_WIDTH + _GAP) * rest :].strip())

    def text(self) -> list[str]:
        """Its lines, with the number of satellites or records that it has."""
        below = [*self.records, *(line for one in self.satellites for line in one.lines)]
        if self.first.startswith(">"):
            return [f"{self.first[: _FLAG_3 + 1]}{self.count:3d}{self.first[_FLAG_3 + 4 :]}", *below]
        names = "".join(one.name for one in self.satellites)
        lines = [names[k : k + 36] for k in range(0, len(names), 36)] or [""]
        head = f"{self.first[: _FLAG_2 + 1]}{self.count:3d}"
        return [f"{head if k == 0 else ' ' * _FIRST_NAME_2}{line}" for k, line in enumerate(lines)] + below


def readable(file: RinexText, wanted: dict[str, tuple[str, ...]]) -> tuple[Any, tuple[Block, ...], tuple[str, ...]]:
    """What the library reads of a file, the block of each of its epochs, and what was left out, in words.

    Args:
        file: an observation file.
        wanted: of each system letter, the codes of which one will be read; damage in columns of other codes is
            harmless.

    Raises:
        InputError: a header that cannot be read, or nothing after it that can.
    """
    left_out = file.without_label()
    header = _header(file, wanted, left_out)
    body, file_end = _whole_lines(file, left_out)
    made = _blocks_2(file, body, left_out) if file.generation == 2 else _blocks_3(file, body, left_out)
    blocks = tuple(made)
    read = None if any(block.damage for block in blocks) else _read(header, blocks)
    if read is None:
        blocks = tuple(_sound(header, blocks, [], wanted, left_out))
        read = _read(header, blocks)
    if file_end:
        left_out.append(file_end)
    if read is None or not any(block.flag < 2 for block in blocks):
        what = f" (left out: {left_out[0]})" if left_out else ""
        raise InputError(f"{file.path}: the file has a header and no epochs that can be read{what}.")
    return read, blocks, tuple(left_out)


def _header(file: RinexText, wanted: Collection[str], left_out: list[str]) -> list[str]:
    """The header lines that count, as far as they can be read; what a system that is not read observes does not."""
    columns = file.labelled(COLUMNS) if file.generation == 2 else _columns_3(file, wanted)
    lines = [file.header[0], *columns]
    said = _refusal([*lines, file.header[-1]])
    if said or not columns:
        label = COLUMNS[1] if file.generation == 2 else COLUMNS[0]
        said = said if columns else f"it lists no {label}"
        raise InputError(f"{file.path}: its header does not say which columns the values have ({said}).")
    for line in file.labelled(_OTHERS):
        if _refusal([*lines, line, file.header[-1]]):
            left_out.append(f"the header's {label_of(line)}")
        else:
            lines.append(line)
    return [*lines, file.header[-1]]


def _columns_3(file: RinexText, wanted: Collection[str]) -> list[str]:
    """Columns and scales of the systems that are read, as they stand, and one column of every other of the file."""
    kept, others, letter = [], {}, " "
    for line in file.labelled(COLUMNS):
        letter = line[0] if line[0] != " " else letter
        if letter in wanted:
            kept.append(line)
        elif letter in library.SYSTEMS and label_of(line) == COLUMNS[0]:
            others[letter] = f"{f'{letter}    1 C1C':60}{COLUMNS[0]}"
    return [*kept, *others.values()]


def _refusal(lines: Iterable[str]) -> str:
    try:
        library.observations("\n".join((*lines, "")))
    except library.Unreadable as error:
        return str(error) or "no reason given"
    return ""


def _whole_lines(file: RinexText, left_out: list[str]) -> tuple[Sequence[str], str]:
    """The lines of the body but for a last one that is cut within a value, and what is to be said of it.

    Values have 14 columns and 2 of flags each; in RINEX 3 and 4 the three of a name stand before them. Where the last
    difference of a compact file is cut, its value looks whole.
    """
    body = file.body
    length = len(body[-1]) if body else 0
    if file.ends_with_newline or not length:
        return body, ""
    after = 0 if file.generation == 2 else 3
    values = None if file.compact else re.fullmatch(r"[ \d.-]*", body[-1][after:], re.ASCII)
    if values and length >= after and (length - after) % (_WIDTH + _GAP) in (0, _WIDTH, _WIDTH + 1):
        return body, ""
    return body[:-1], f"line {file.number(len(body) - 1)} (the file is cut short in it)"


def _blocks_3(file: RinexText, body: Sequence[str], left_out: list[str]) -> Iterator[Block]:
    kept = [(file.number(k), line) for k, line in enumerate(body) if line and not line.isspace()]
    starts = [k for k, (_, line) in enumerate(kept) if line.startswith(">")]
    _stray(kept[: starts[0] if starts else len(kept)], left_out)
    for start, stop in zip(starts, [*starts, len(kept)][1:], strict=True):
        number, first = kept[start]
        flag, count = first[_FLAG_3 : _FLAG_3 + 1], first[_FLAG_3 + 1 : _FLAG_3 + 4].strip() or "0"
        if not (flag in _FLAGS and count.isdecimal()):
            left_out.append(f"the epoch of line {number} and the {stop - start - 1} lines below (no flag and count)")
            continue
        own = kept[start + 1 : min(start + 1 + int(count), stop)]
        _stray(kept[start + 1 + len(own) : stop], left_out)
        missing = int(count) - len(own)
        damage = f"{missing} of its {count} lines are missing" if missing else ""
        if 2 <= int(flag) != 6:
            yield Block(number, first, int(flag), (), tuple(line for _, line in own), damage)
        else:
            satellites = tuple(Satellite(line[:3], at, (line,)) for at, line in own)
            yield Block(number, first, int(flag), satellites, (), damage)


def _blocks_2(file: RinexText, body: Sequence[str], left_out: list[str]) -> Iterator[Block]:
    count_of_types = _type_count(file.header) or 1
    at = 0
    while at < len(body):
        if not body[at].strip():
            at += 1
            continue
        start, first, number = at, body[at], file.number(at)
        if not (_EPOCH_2.match(first) or _EVENT_2.fullmatch(first)):
            at = next((k for k in range(at, len(body)) if _begins_2(body[k])), len(body))
            _stray([(file.number(k), body[k]) for k in range(start, at) if body[k].strip()], left_out)
            continue
        flag, count = int(first[_FLAG_2]), int(first[_FLAG_2 + 1 : _FLAG_2 + 4].strip() or 0)
        if 2 <= flag <= 5:
            records = tuple(body[at + 1 : at + 1 + count])
            at += 1 + count
            count_of_types = _type_count(records) or count_of_types
            damage = "" if len(records) == count else f"{count - len(records)} of its {count} lines are missing"
            yield Block(number, first, flag, (), records, damage)
            continue
        heads, rows = max(1, math.ceil(count / _NAMES_ON_A_LINE_2)), math.ceil(count_of_types / _VALUES_ON_A_LINE_2)
        end = at + heads + count * rows
        # The next epoch begins where this one ends, but for blank lines; a line more or less moves values to others.
        begins = next((k for k in range(at + 1, len(body)) if _begins_2(body[k])), len(body))
        over = next((k for k in range(end, begins) if body[k].strip()), None)
        at = begins
        if begins < end or over is not None:
            left_out.append(
                f"the epoch of line {number} ({Block(number, first, flag, (), ()).when}; it has "
                f"{'fewer' if begins < end else 'more'} lines than its {count} satellites need)"
            )
            continue
        names = "".join(line[_FIRST_NAME_2:].ljust(3 * _NAMES_ON_A_LINE_2)[:36] for line in body[start : start + heads])
        yield Block(
            number,
            first,
            flag,
            tuple(
                Satellite(
                    names[3 * k : 3 * k + 3],
                    file.number(start + heads + k * rows),
                    tuple(body[start + heads + k * rows : start + heads + (k + 1) * rows]),
                )
                for k in range(count)
            ),
            (),
        )


def _begins_2(line: str) -> bool:
    return bool(_EPOCH_2.match(line) or _EVENT_2.fullmatch(line))


def _type_count(lines: Iterable[str]) -> int | None:
    """The number of observation types that a header or an event of RINEX 2 gives."""
    for line in lines:
        if label_of(line) == COLUMNS[1] and line[:6].strip().isdecimal():
            return int(line[:6])
    return None


def _stray(lines: Sequence[tuple[int, str]], left_out: list[str]) -> None:
    if lines:
        first, last = lines[0][0], lines[-1][0]
        where = f"line {first}" if first == last else f"lines {first} to {last}"
        left_out.append(f"{where} (of no epoch)")


def _sound(
    header: list[str],
    blocks: tuple[Block, ...],
    before: list[Block],
    wanted: dict[str, tuple[str, ...]],
    left_out: list[str],
) -> Iterator[Block]:
    """The blocks of which everything is read; ``before``: events whose header lines hold for them."""
    if not blocks:
        return
    if not any(block.damage for block in blocks) and _read(header, (*before, *blocks)) is not None:
        yield from blocks
    elif len(blocks) == 1:
        yield from _salvaged(header, blocks[0], before, wanted, left_out)
    else:
        half = len(blocks) // 2
        first = tuple(_sound(header, blocks[:half], before, wanted, left_out))
        yield from first
        events = [block for block in first if any(label_of(line) in COLUMNS for line in block.records)]
        yield from _sound(header, blocks[half:], [*before, *events], wanted, left_out)


def _read(header: list[str], blocks: Collection[Block]) -> Any | None:
    """What the library reads of blocks; None where it refuses them or skips anything in them."""
    text = "\n".join([*header, *(line for block in blocks for line in block.text()), ""])
    try:
        read = library.observations(text)
    except library.Unreadable:
        return None
    epochs = read.epochs
    whole = len(epochs) == len(blocks) and all(
        epoch.flag == block.flag
        and epoch.declared_record_count == block.count
        and (block.flag > 1 or (epoch.satellite_count == block.count and epoch.epoch is not None))
        for epoch, block in zip(epochs, blocks, strict=True)
    )
    return read if whole and not read.skipped_records else None


def _salvaged(
    header: list[str], block: Block, before: list[Block], wanted: dict[str, tuple[str, ...]], left_out: list[str]
) -> Iterator[Block]:
    """What of one block can be read; what cannot is told."""
    empty = Block(block.number, block.first, block.flag, (), ())
    read = _read(header, [*before, empty]) if not block.records else None
    if read is None or block.flag > 1:
        kind = "epoch" if block.flag < 2 else f"event (flag {block.flag})"
        why = f"; {block.damage}" if block.damage else ""
        left_out.append(f"the {kind} of line {block.number} ({block.when}{why})")
        return
    if block.damage:
        left_out.append(f"part of the epoch of line {block.number} ({block.when}; {block.damage})")
    in_force = read.header_at(len(before))
    kept: list[Satellite] = []
    for one in block.satellites:
        # A line whose damage is in columns that are not read is as good as sound, unless it has nothing else.
        forms = (one, *_blanked(one, in_force, wanted))
        sound = next((form for form in forms if _read(header, [*before, _with(empty, form)])), None)
        if sound is None:
            left_out.append(f"line {one.number} ({one.name}, {block.when})")
        else:
            kept.append(sound)
    names = [one.name for one in kept]
    for name in sorted({name for name in names if names.count(name) > 1}):
        same = {one.lines for one in kept if one.name == name}
        left_out.append(
            f"{name} of the epoch of line {block.number} ({block.when}; it is there {names.count(name)} times, "
            f"{'alike' if len(same) == 1 else 'with other values'})"
        )
        first = names.index(name)
        kept = [one for k, one in enumerate(kept) if one.name != name or (k == first and len(same) == 1)]
        names = [one.name for one in kept]
    found = Block(block.number, block.first, block.flag, tuple(kept), ())
    if _read(header, [*before, found]) is not None:
        yield found
    else:
        left_out.append(f"the epoch of line {block.number} ({block.when})")


def _with(block: Block, satellite: Satellite) -> Block:
    return Block(block.number, block.first, block.flag, (satellite,), ())


def _blanked(satellite: Satellite, header: Any, wanted: dict[str, tuple[str, ...]]) -> tuple[Satellite, ...]:
    """A satellite with the values that are read alone; none where it has none of them."""
    letter = satellite.name[:1].strip() or "G"
    listed = library.codes(header, letter) if letter in wanted else []
    columns = [k for k, code in enumerate(listed) if code in wanted.get(letter, ())]
    folded = len(satellite.lines) > 1 or not satellite.lines[0].startswith(satellite.name)
    begin, on_a_line = (0, _VALUES_ON_A_LINE_2) if folded else (3, max(1, len(listed)))
    lines = []
    for row, line in enumerate(satellite.lines):
        text = [" "] * max(len(line), begin)
        text[:begin] = line[:begin]
        for k in columns:
            if k // on_a_line == row:
                at = begin + (_WIDTH + _GAP) * (k % on_a_line)
                text[at : at + _WIDTH] = line[at : at + _WIDTH]
        lines.append("".join(text).rstrip())
    has_values = any(line[begin:].strip() for line in lines)
    return (Satellite(satellite.name, satellite.number, tuple(lines)),) if has_values else ()
