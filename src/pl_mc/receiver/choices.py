"""What is asked for of receiver files, in the rows of `pl_mc.receiver.signals`: systems, signals, pairs of them."""

from __future__ import annotations

from collections.abc import Sequence

from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.receiver.signals import SYSTEMS, Observable, Signal, in_one_band, observables_of, signals_of


def checked_systems(systems: Sequence[str]) -> tuple[str, ...]:
    """Systems as they were asked for.

    Raises:
        InputError: none, one that is not read, or one twice.
    """
    if not isinstance(systems, Sequence):
        raise InputError(f"systems: a sequence of RINEX letters is needed, not {shown(systems)}.")
    letters = tuple(systems)
    for letter in letters:
        if letter not in SYSTEMS:
            hint = ""
            if isinstance(letter, str) and len(letter) > 1 and set(letter) <= {*SYSTEMS, " ", ";"}:
                hint = f"; they are separated by commas: {','.join(one for one in letter if one in SYSTEMS)}"
            raise InputError(f"systems: {shown(letter)} is not read from receiver files; {_known_systems()} are{hint}.")
    if not letters or len(set(letters)) != len(letters):
        raise InputError(
            f"systems: some of {_known_systems()} are needed, each once, not {', '.join(letters) or 'none'}."
        )
    return letters


def _known_systems() -> str:
    *first, last = (f"{letter} ({SYSTEM_NAMES[letter]})" for letter in SYSTEMS)
    return f"{', '.join(first)} and {last}"


def checked_signals(
    signals: Sequence[str] | None, systems: Sequence[str], *, dual: bool
) -> dict[str, tuple[Observable, ...]]:
    """What can be read of each system, in the order of preference: what was asked for, or what is usual.

    Raises:
        InputError: a signal that none of the systems has, two of one system, one where two are combined.
    """
    if signals is not None and (isinstance(signals, str) or not isinstance(signals, Sequence)):
        raise InputError(f"signals: a sequence of names is needed, such as ['L1', 'E5a'], not {shown(signals)}.")
    made: dict[str, tuple[Observable, ...]] = {}
    for text in signals or ():
        words = [word.strip() for word in text.split("+")] if isinstance(text, str) else []
        if len(words) != 1 + dual:
            form = "two are combined, such as E1+E5b" if dual else "one of each system is read, such as E1, or"
            way = "" if dual else " two with the ionosphere dual"
            raise InputError(f"signals: {form}{way}, not {shown(text)}.")
        of_systems = {letter: _named_signals(letter, words) for letter in systems}
        found = {letter: one for letter, one in of_systems.items() if one is not None}
        if not found:
            named = [" + ".join(SYSTEM_NAMES[letter] for letter in systems)] if len(systems) < len(SYSTEMS) else []
            known = dict.fromkeys(signal.short for letter in systems for signal in signals_of(letter))
            word = next((one for one in words if one not in known), words[0])
            if len(words) == 2 and all(one in known for one in words):
                raise InputError(
                    f"signals: {shown(text)} cannot be combined; two signals of one system are needed, with carriers "
                    "as far apart as those of L1 and L2."
                )
            raise InputError(
                f"signals: {shown(text)} is not read of {' '.join(named) or 'any system'} ({nearest(word, known)})."
            )
        for letter, observable in found.items():
            if letter in made:
                both = f"{made[letter][0].name} and {observable.name}"
                raise InputError(f"signals: one of each system is read, and {both} are both of {SYSTEM_NAMES[letter]}.")
            made[letter] = (observable,)
    return {letter: made.get(letter) or observables_of(letter, dual=dual) for letter in systems}


def _named_signals(system: str, words: Sequence[str]) -> Observable | None:
    """Signals of a system by their names, in any case of letters; None where it has not got all of them."""
    rows: dict[str, Signal] = {}
    for names in ([s.short for s in signals_of(system)], [s.name.split()[0] for s in signals_of(system)]):
        for name, signal in zip(names, signals_of(system), strict=True):
            rows.setdefault(name.casefold(), signal)
    found = [rows[word.casefold()] for word in words if word.casefold() in rows]
    same = len(found) == 2 and in_one_band(found[0].ionosphere_factor(found[1].carrier_hz))
    return None if same or len(found) < len(words) else Observable(tuple(found))


def delays_needed(every: Sequence[Observable]) -> str:
    """The group delays that are needed, message by message, in words."""
    said = []
    for one in every:
        for first in one.signals[0].group_delays:
            names = [name for signal in one.signals for name in signal.group_delays.get(first, ())]
            if first in one.messages:
                said.append(f"{' and '.join(dict.fromkeys(names)) or 'its clock'} of {first}")
    return ", or ".join(dict.fromkeys(said)) or "there is no message with both"
