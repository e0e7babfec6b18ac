"""The signals that are read from receiver files, one row each; nothing else names a code or a carrier.

Of a system the first row counts. A row for a signal of GPS or BeiDou that they send today works as it stands; a
system that is not in `SYSTEMS` also needs its ephemerides checked (`pl_mc.receiver.navigation_records`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pl_mc.constants import FREQUENCY_B1I_HZ, FREQUENCY_L1_HZ


@dataclass(frozen=True)
class Signal:
    """One signal of one system.

    Attributes:
        system: RINEX letter.
        name: of the signal, as its interface document says it.
        codes: its pseudorange codes in RINEX 3 and 4, the first that a file has is taken.
        codes_2: the same in RINEX 2, which is read of GPS alone.
        carrier_hz: carrier frequency [Hz].
        group_delays: how much of the two broadcast group delays, TGD and none of GPS, TGD1 and TGD2 of BeiDou, its
            user takes from the broadcast clock.
    """

    system: str
    name: str
    codes: tuple[str, ...]
    codes_2: tuple[str, ...]
    carrier_hz: float
    group_delays: tuple[float, float]

    @property
    def ionosphere_factor(self) -> float:
        """Ionospheric delay over that on GPS L1; of a code it is inverse to the carrier's square.

        IS-GPS-200, 20.3.3.3.3.3.
        """
        return (FREQUENCY_L1_HZ / self.carrier_hz) ** 2


@dataclass(frozen=True)
class System:
    """What is known of a system's satellites and messages.

    Attributes:
        highest_number: of the satellites that the orbit library knows.
        messages: navigation messages that are read, by their names in RINEX 4.
        largest_health: of the health word of its ephemerides.
        ephemeris_window_s: how far an epoch may lie from an ephemeris' reference time toe [s].
    """

    highest_number: int
    messages: tuple[str, ...]
    largest_health: int
    ephemeris_window_s: float


# Group delays: the broadcast clock less TGD is that of a user of L1 C/A or P alone (IS-GPS-200, 20.3.3.3.3.2); less
# TGD1 that of B1I, less TGD2 that of B2I, and as it stands that of B3I (BDS-SIS-ICD-2.1, 5.2.4.10). RINEX 3.02 and
# some writers since name the codes of B1I after band 1. RINEX 2: the C/A code, or P where a file has no other.
SIGNALS: tuple[Signal, ...] = (
    Signal("G", "L1 C/A", ("C1C",), ("C1", "P1"), FREQUENCY_L1_HZ, (1.0, 0.0)),
    Signal("C", "B1I", ("C2I", "C1I"), (), FREQUENCY_B1I_HZ, (1.0, 0.0)),
)

# Windows: GPS half the fit interval of four hours (IS-GPS-200, 20.3.4.4); BeiDou sends hourly messages
# (BDS-SIS-ICD-2.1, 5.2.4.2), of which receivers miss some.
SYSTEMS: Mapping[str, System] = {"G": System(32, ("LNAV",), 63, 7200.0), "C": System(63, ("D1", "D2"), 1, 7200.0)}


def signal_of(system: str) -> Signal:
    """The signal that is read of a system.

    Raises:
        KeyError: a system of which none is.
    """
    for signal in SIGNALS:
        if signal.system == system:
            return signal
    raise KeyError(system)
