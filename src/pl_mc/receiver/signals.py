"""The signals that are read from receiver files, one row each; nothing else names a code or a carrier.

Of a system the first row counts. A row for a signal of GPS or BeiDou that they send today works as it stands; a
system that is not in `SYSTEMS` also needs a row there, and the rules of `pl_mc.receiver.navigation_records`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pl_mc.constants import BDT_BEHIND_GPS_S, FREQUENCY_B1I_HZ, FREQUENCY_L1_HZ
from pl_mc.geometry.record import MOST_SATELLITES


@dataclass(frozen=True)
class Signal:
    """One signal of one system.

    Attributes:
        system: RINEX letter.
        name: of the signal, as its interface document says it.
        codes: its pseudorange codes in RINEX 3 and 4, the first of which a file has a value is taken. Those after
            the first are other tracking modes of the same carrier, or other names.
        codes_2: the same in RINEX 2, which is read of GPS alone.
        carrier_hz: carrier frequency [Hz].
        group_delays: how much of the two broadcast group delays, TGD and none of GPS, TGD1 and TGD2 of BeiDou, its
            user takes from the broadcast clock.
        codes_302: further codes in RINEX 3.02 alone, which elsewhere are of another signal.
    """

    system: str
    name: str
    codes: tuple[str, ...]
    codes_2: tuple[str, ...]
    carrier_hz: float
    group_delays: tuple[float, float]
    codes_302: tuple[str, ...] = ()

    def ionosphere_factor(self, model_hz: float = FREQUENCY_L1_HZ) -> float:
        """Ionospheric delay over that on another carrier; of a code it is inverse to the carrier's square.

        IS-GPS-200, 20.3.3.3.3.3.
        """
        return (model_hz / self.carrier_hz) ** 2


@dataclass(frozen=True)
class System:
    """What is known of a system's satellites and messages.

    Attributes:
        highest_number: of its satellites.
        messages: navigation messages that are read, by their names in the library of receiver files.
        ephemeris_window_s: how far an epoch may lie from an ephemeris' reference time toe [s].
        time_step_s: the last bit of toe and of toc, which are one time in one message [s].
        largest_accuracy_m: a larger accuracy (URA) is none that was predicted [m].
        behind_gps_s: how far its time is behind that of GPS [s].
        first_gps_week: week of GPS in which its weeks begin to count.
    """

    highest_number: int
    messages: tuple[str, ...]
    ephemeris_window_s: float
    time_step_s: float
    largest_accuracy_m: float
    behind_gps_s: float
    first_gps_week: int


# Group delays: the broadcast clock less TGD is that of a user of L1 C/A or P alone (IS-GPS-200, 20.3.3.3.3.2); less
# TGD1 that of B1I, less TGD2 that of B2I, and as it stands that of B3I (BDS-SIS-ICD-2.1, 5.2.4.10). B1I is one of two
# components on its carrier: I, Q or X (both). RINEX 3.02 and some writers since name its codes after band 1, where
# 3.03 and later have B1C. L1C (X, S, L) has a delay of its own against L1 C/A, which LNAV does not send.
SIGNALS: tuple[Signal, ...] = (
    Signal("G", "L1 C/A", ("C1C", "C1P", "C1W", "C1Y", "C1X", "C1S", "C1L"), ("C1", "P1"), FREQUENCY_L1_HZ, (1.0, 0.0)),
    Signal("C", "B1I", ("C2I", "C1I", "C2X", "C2Q"), (), FREQUENCY_B1I_HZ, (1.0, 0.0), ("C1X", "C1Q")),
)

# Windows: GPS half the fit interval of four hours (IS-GPS-200, 20.3.4.4); BeiDou sends hourly messages
# (BDS-SIS-ICD-2.1, 5.2.4.2), of which receivers miss some. Steps: IS-GPS-200, tables 20-I and 20-III;
# BDS-SIS-ICD-2.1, 5.2.4.9. Accuracy: index 14 of GPS ends at 6144 m (IS-GPS-200, 20.3.3.3.1.3), that of BeiDou is
# 4096 m (BDS-SIS-ICD-2.1, 5.2.4.5); index 15 promises nothing.
SYSTEMS: Mapping[str, System] = {
    "G": System(MOST_SATELLITES["G"], ("gps_lnav",), 7200.0, 16.0, 6144.0, 0.0, 0),
    "C": System(MOST_SATELLITES["C"], ("beidou_d1", "beidou_d2"), 7200.0, 8.0, 4096.0, BDT_BEHIND_GPS_S, 1356),
}


def signal_of(system: str) -> Signal:
    """The signal that is read of a system.

    Raises:
        KeyError: a system of which none is.
    """
    for signal in SIGNALS:
        if signal.system == system:
            return signal
    raise KeyError(system)
