"""The signals that are read from receiver files, one row each; nothing else names a code, a carrier or a group delay.

A row for a signal of a system in `SYSTEMS` works as it stands, alone and in every combination that removes the
ionosphere. Alone, the first row of a system is read unless another one is asked for; of two carriers the first pair
that a file has all of, those first whose group delays its messages send in full.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from pl_mc.constants import BDT_BEHIND_GPS_S, FREQUENCY_B1I_HZ, FREQUENCY_L1_HZ, MOST_SATELLITES

# Navigation messages, as they are called here.
LNAV, CNAV, CNAV2, INAV, FNAV, D1_D2, B_CNAV1, B_CNAV2, FDMA = (
    "LNAV", "CNAV", "CNAV-2", "I/NAV", "F/NAV", "D1/D2", "B-CNAV1", "B-CNAV2", "FDMA",
)  # fmt: skip

# Group delays of the messages, by their names in the interface documents, and in the library of receiver files. What
# the library has no name for it does not read.
GROUP_DELAYS: Mapping[str, str] = {
    "TGD": "gps_tgd_s", "TGD1": "beidou_tgd1_s", "TGD2": "beidou_tgd2_s", "BGD E1,E5a": "galileo_bgd_e5a_e1_s",
    "BGD E1,E5b": "galileo_bgd_e5b_e1_s", "ISC L1C/A": "cnav_isc_l1ca_s", "ISC L2C": "cnav_isc_l2c_s",
    "ISC L5Q5": "cnav_isc_l5q5_s", "ISC L1CP": "cnav_isc_l1cp_s",
}  # fmt: skip

# Messages of BeiDou of which the library has the lines alone, by their names in RINEX 4: what is added to the clock and
# the orbit of D1, with the places (line and number) of the delays, of the health, and of the integrity flags after it
# (RINEX 4.00, CNV1 and CNV2). Health has two bits, and flags come above them: of B-CNAV2 three of B2a and then, as in
# B-CNAV1, three of B1C, which are DIF (the error exceeds what was predicted), SIF (the signal is not normal) and AIF
# (SISMAI is not valid, of which no document says what it would mean; so AIF forbids nothing).
ADDED_TO_D1: Mapping[str, str] = {"CNV1": B_CNAV1, "CNV2": B_CNAV2}
ADDED_DELAYS: Mapping[str, tuple[int, int]] = {"TGD B1Cp": (7, 2), "TGD B2ap": (7, 3)}
ADDED_HEALTH, ADDED_FLAGS, FLAGS_ABOVE = (8, 1), (8, 2), 2
_B_HEALTH, _B1C_FLAGS, _B2A_FLAGS = 0b11, 0b110 << FLAGS_ABOVE, 0b110_000 << FLAGS_ABOVE

# Those without which a record is damaged; of CNAV some are not sent.
OWN_GROUP_DELAYS: Mapping[str, tuple[str, ...]] = {
    LNAV: ("TGD",), D1_D2: ("TGD1", "TGD2"), INAV: ("BGD E1,E5a", "BGD E1,E5b"), FNAV: ("BGD E1,E5a",),
    CNAV: (), CNAV2: (),
}  # fmt: skip

_L2_HZ, _L5_HZ = 1_227.60e6, 1_176.45e6
_E5B_HZ, _B3I_HZ = 1_207.14e6, 1_268.52e6
_ANY_BIT = -1

# Carriers whose delays by the ionosphere differ by less are one band: L1 and B1I by 2 percent.
_ONE_BAND = 0.05


def in_one_band(ionosphere_factor: float) -> bool:
    """Whether carriers are so close that their delays by the ionosphere, with that ratio, are nearly the same."""
    return abs(ionosphere_factor - 1.0) < _ONE_BAND


def _gamma(carrier_hz: float) -> float:
    """Group delay on a carrier over that on L1 where the satellite's is given as one of the ionosphere."""
    return (FREQUENCY_L1_HZ / carrier_hz) ** 2


@dataclass(frozen=True)
class Signal:
    """One signal of one system.

    Attributes:
        system: RINEX letter.
        name: of the signal, as its interface document says it.
        codes: its pseudorange codes in RINEX 3 and 4, the first of which a file has a value is taken. Those after
            the first are other tracking modes of the same carrier, or other names.
        carrier_hz: carrier frequency [Hz].
        group_delays: of each message whose clock its users can use, in the order of preference, the broadcast delays
            that they take from that clock, and how much of each.
        health: of each message that says how the signal is, the bits of its health that forbid the use.
        codes_2: its codes in RINEX 2, which is read of GPS alone.
        codes_302: further codes in RINEX 3.02 alone, which elsewhere are of another signal.
        neglected_m: of messages that do not send all of its delay, how much of it can stay in [m].
    """

    system: str
    name: str
    codes: tuple[str, ...]
    carrier_hz: float
    group_delays: Mapping[str, Mapping[str, float]]
    health: Mapping[str, int]
    codes_2: tuple[str, ...] = ()
    codes_302: tuple[str, ...] = ()
    neglected_m: Mapping[str, float] = field(default_factory=dict)

    @property
    def short(self) -> str:
        """What it is asked for by, such as ``L1``, ``L1P`` or ``E5a``."""
        return self.name.replace(" C/A", "").replace(" P(Y)", "P")

    def ionosphere_factor(self, model_hz: float = FREQUENCY_L1_HZ) -> float:
        """Ionospheric delay over that on another carrier; of a code it is inverse to the carrier's square.

        IS-GPS-200, 20.3.3.3.3.3.
        """
        return (model_hz / self.carrier_hz) ** 2


@dataclass(frozen=True)
class Observable:
    """What is made of a satellite's pseudoranges: one of them, or the combination of two that has no ionosphere.

    Attributes:
        signals: one, or two on different carriers.
    """

    signals: tuple[Signal, ...]

    @property
    def name(self) -> str:
        """Such as ``L1 C/A`` or ``E1 + E5a``."""
        return " + ".join(signal.name for signal in self.signals)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """What each pseudorange is multiplied by; the delays of the ionosphere, inverse to f^2, cancel.

        IS-GPS-200, 20.3.3.3.3.3.
        """
        if len(self.signals) == 1:
            return (1.0,)
        first, second = (signal.carrier_hz**2 for signal in self.signals)
        return first / (first - second), second / (second - first)

    @property
    def noise(self) -> float:
        """Standard deviation over that of one pseudorange, where those of both carriers are independent and alike."""
        return math.hypot(*self.coefficients)

    @property
    def ionosphere(self) -> float:
        """What of the ionosphere on L1 it has; 1 in the whole band about L1, for which error models are made."""
        if len(self.signals) > 1:
            return 0.0
        factor = self.signals[0].ionosphere_factor()
        return 1.0 if in_one_band(factor) else factor

    @property
    def messages(self) -> tuple[str, ...]:
        """Messages whose clock its users can use, by preference; of pairs those first that neglect nothing."""
        first, *others = (signal.group_delays for signal in self.signals)
        common = [message for message in first if all(message in other for other in others)]
        return tuple(sorted(common, key=lambda message: bool(others) and self.neglected_m(message) > 0))

    def group_delays(self, message: str) -> dict[str, float]:
        """How much of each broadcast delay of a message is taken from its clock."""
        total: dict[str, float] = {}
        for signal, coefficient in zip(self.signals, self.coefficients, strict=True):
            for name, part in signal.group_delays[message].items():
                total[name] = total.get(name, 0.0) + coefficient * part
        # The clocks of GPS and Galileo are those of two carriers; of these two the delays cancel.
        return {name: part for name, part in total.items() if abs(part) > 1e-12}

    def neglected_m(self, message: str) -> float:
        """How much of its group delay a message leaves in at most [m]."""
        pairs = zip(self.signals, self.coefficients, strict=True)
        return sum(abs(coefficient) * signal.neglected_m.get(message, 0.0) for signal, coefficient in pairs)

    @property
    def health(self) -> dict[str, int]:
        """The bits of each message's health that forbid the use of one of its signals."""
        bits: dict[str, int] = {}
        for signal in self.signals:
            for message, mask in signal.health.items():
                bits[message] = bits.get(message, 0) | mask
        return bits


@dataclass(frozen=True)
class System:
    """What is known of a system's satellites and messages.

    Attributes:
        highest_number: of its satellites.
        messages: navigation messages that are read, by their names in the library of receiver files.
        ephemeris_window_s: how far an epoch may lie from an ephemeris' reference time toe [s].
        sent_ahead: whether a message is sent before its reference time; if not, the last one before an epoch counts.
        time_step_s: the last bit of toe and of toc, which are one time in one message [s].
        largest_accuracy_m: a larger accuracy (URA, SISA) is none that was predicted [m].
        largest_group_delay_s: what its messages can say [s].
        behind_gps_s: how far its time is behind that of GPS [s].
        first_gps_week: week of GPS in which its weeks begin to count.
    """

    highest_number: int
    messages: Mapping[str, str]
    ephemeris_window_s: float
    sent_ahead: bool
    time_step_s: float
    largest_accuracy_m: float
    largest_group_delay_s: float
    behind_gps_s: float
    first_gps_week: int


# GPS: the clock is that of L1 P(Y) and L2 P(Y) without ionosphere; less TGD it is that of L1 P(Y) alone, less gamma TGD
# that of L2 P(Y), and less TGD plus its ISC that of any other signal (IS-GPS-200, 20.3.3.3.3.2 and 30.3.3.3.1.1;
# IS-GPS-705, 20.3.3.3.1.2; IS-GPS-800, 3.2.4). LNAV has no ISC; its user takes L1 C/A for L1 P(Y). In the
# data that the tests read, satellites differ by up to 0.8 m in L1 C/A against L1 P(Y), and by 0.6 m in L2C against
# L2 P(Y), as in published biases; alone, L1 C/A is what LNAV is for.
# Health: any bit of LNAV (20.3.3.3.1.4); L1, L2, L5 in CNAV (30.3.3.1.1.2); L1C in CNAV-2 (3.5.3.4).
# Galileo: the clock of I/NAV is that of E1 and E5b, of F/NAV that of E1 and E5a, without ionosphere; less BGD that of
# E1, less (f1/f5)^2 BGD that of the other (Galileo OS SIS ICD 2.1, 5.1.5). Health: data validity and signal health of
# E1-B and E5b in I/NAV, of E5a in F/NAV; bits 0 to 2, 6 to 8 and 3 to 5 (RINEX 3.05, table A8).
# BeiDou: the clock is that of B3I; less TGD1 that of B1I, less TGD2 that of B2I (BDS-SIS-ICD-2.1, 5.2.4.10). B1I is one
# of two components on its carrier: I, Q or X (both). RINEX 3.02 and some writers since name its codes after band 1,
# where 3.03 and later have B1C. B1C and B2a have delays of their own, which B-CNAV1 and
# B-CNAV2 send (BDS-SIS-ICD-B1C-1.0, 7.6; -B2a-1.0, 7.6); their clocks are of B3I too, as that of D1, which is used.
# QZSS: as GPS, with L2C for L2 P(Y) (IS-QZSS-PNT-005); its health in LNAV begins with the bits of L1, L1 C/A, L2C, L5.
# GLONASS: carriers of channel 0; those of the others are in the same ratio of 9 to 7, and their ionosphere differs by
# under half a percent. Receivers delay channels differently, by metres, and how far G2 is behind G1
# few messages say: neither is corrected, and satellites lie up to 3 m off in the data that the tests read. A record is
# for a quarter of an hour before and after its time (GLONASS ICD 5.1, 4.4).
# L1C of GPS, B1C, B2a and E1 are read of pilot and data as of the pilot.
SIGNALS: tuple[Signal, ...] = (
    Signal(
        "G", "L1 C/A", ("C1C", "C1P", "C1W", "C1Y", "C1X", "C1S", "C1L"), FREQUENCY_L1_HZ,
        {LNAV: {"TGD": 1.0}, CNAV: {"TGD": 1.0, "ISC L1C/A": -1.0}}, {LNAV: _ANY_BIT, CNAV: 0b100}, ("C1", "P1"),
        neglected_m={LNAV: 0.8},
    ),
    Signal(
        "G", "L1 P(Y)", ("C1W", "C1P", "C1Y"), FREQUENCY_L1_HZ, {LNAV: {"TGD": 1.0}, CNAV: {"TGD": 1.0}},
        {LNAV: _ANY_BIT, CNAV: 0b100}, ("P1",),
    ),
    Signal(
        "G", "L2 P(Y)", ("C2W", "C2P", "C2Y", "C2D"), _L2_HZ,
        {LNAV: {"TGD": _gamma(_L2_HZ)}, CNAV: {"TGD": _gamma(_L2_HZ)}}, {LNAV: _ANY_BIT, CNAV: 0b010}, ("P2",),
    ),
    Signal(
        "G", "L2C", ("C2L", "C2X", "C2S"), _L2_HZ,
        {CNAV: {"TGD": 1.0, "ISC L2C": -1.0}, LNAV: {"TGD": _gamma(_L2_HZ)}}, {LNAV: _ANY_BIT, CNAV: 0b010}, ("C2",),
        neglected_m={LNAV: 0.6},
    ),
    Signal(
        "G", "L5", ("C5Q", "C5X", "C5I"), _L5_HZ,
        {CNAV: {"TGD": 1.0, "ISC L5Q5": -1.0}}, {LNAV: _ANY_BIT, CNAV: 0b001}, ("C5",),
    ),
    Signal(
        "G", "L1C", ("C1L", "C1X", "C1S"), FREQUENCY_L1_HZ,
        {CNAV2: {"TGD": 1.0, "ISC L1CP": -1.0}}, {LNAV: _ANY_BIT, CNAV2: _ANY_BIT},
    ),
    Signal(
        "E", "E1", ("C1C", "C1X", "C1B"), FREQUENCY_L1_HZ,
        {INAV: {"BGD E1,E5b": 1.0}, FNAV: {"BGD E1,E5a": 1.0}}, {INAV: 0b000_000_111},
    ),
    Signal(
        "E", "E5a", ("C5Q", "C5X", "C5I"), _L5_HZ,
        {FNAV: {"BGD E1,E5a": _gamma(_L5_HZ)}}, {FNAV: 0b000_111_000},
    ),
    Signal(
        "E", "E5b", ("C7Q", "C7X", "C7I"), _E5B_HZ,
        {INAV: {"BGD E1,E5b": _gamma(_E5B_HZ)}}, {INAV: 0b111_000_000},
    ),
    Signal(
        "C", "B1I", ("C2I", "C1I", "C2X", "C2Q"), FREQUENCY_B1I_HZ,
        {message: {"TGD1": 1.0} for message in (D1_D2, B_CNAV1, B_CNAV2)}, {D1_D2: _ANY_BIT},
        codes_302=("C1X", "C1Q"),
    ),
    Signal(
        "C", "B3I", ("C6I", "C6X", "C6Q"), _B3I_HZ, {message: {} for message in (D1_D2, B_CNAV1, B_CNAV2)},
        {D1_D2: _ANY_BIT},
    ),
    Signal("C", "B2I", ("C7I", "C7X", "C7Q"), _E5B_HZ, {D1_D2: {"TGD2": 1.0}}, {D1_D2: _ANY_BIT}),
    Signal(
        "C", "B1C", ("C1P", "C1X"), FREQUENCY_L1_HZ, {message: {"TGD B1Cp": 1.0} for message in (B_CNAV1, B_CNAV2)},
        {D1_D2: _ANY_BIT, B_CNAV1: _B_HEALTH | _B1C_FLAGS, B_CNAV2: _B1C_FLAGS},
    ),
    Signal(
        "C", "B2a", ("C5P", "C5X"), _L5_HZ, {message: {"TGD B2ap": 1.0} for message in (B_CNAV2, B_CNAV1)},
        {D1_D2: _ANY_BIT, B_CNAV2: _B_HEALTH | _B2A_FLAGS},
    ),
    Signal("R", "G1", ("C1C", "C1P"), 1_602.0e6, {FDMA: {}}, {FDMA: _ANY_BIT}, neglected_m={FDMA: 3.0}),
    Signal("R", "G2", ("C2C", "C2P"), 1_246.0e6, {FDMA: {}}, {FDMA: _ANY_BIT}, neglected_m={FDMA: 3.0}),
    Signal(
        "J", "L1 C/A", ("C1C", "C1Z", "C1X", "C1L", "C1S"), FREQUENCY_L1_HZ,
        {LNAV: {"TGD": 1.0}, CNAV: {"TGD": 1.0, "ISC L1C/A": -1.0}}, {LNAV: 0b110_000},
    ),
    Signal(
        "J", "L2C", ("C2L", "C2X", "C2S"), _L2_HZ,
        {LNAV: {"TGD": _gamma(_L2_HZ)}, CNAV: {"TGD": 1.0, "ISC L2C": -1.0}}, {LNAV: 0b001_000},
    ),
    Signal("J", "L5", ("C5Q", "C5X", "C5I"), _L5_HZ, {CNAV: {"TGD": 1.0, "ISC L5Q5": -1.0}}, {LNAV: 0b000_100}),
)  # fmt: skip

# Systems that are read unless some are asked for; the few satellites of QZSS have a clock of their own and serve a
# region, and those of GLONASS have biases of metres.
USUAL_SYSTEMS = ("G", "C", "E")

# Windows: GPS half the fit interval of four hours (IS-GPS-200, 20.3.4.4), QZSS alike; BeiDou sends hourly messages
# (BDS-SIS-ICD-2.1, 5.2.4.2), of which receivers miss some; those of Galileo are for four hours after their reference
# time (Galileo OS SDD), which is past when they are sent. Steps: IS-GPS-200, tables 20-I and 20-III; BDS-SIS-ICD-2.1,
# 5.2.4.9; Galileo OS SIS ICD 2.1, 5.1. Accuracy: index 14 of GPS ends at 6144 m (IS-GPS-200, 20.3.3.3.1.3), that of
# BeiDou is 4096 m (BDS-SIS-ICD-2.1, 5.2.4.5), index 125 of Galileo 6 m (Galileo OS SIS ICD 2.1, 5.1.12); what comes
# after promises nothing.
# Group delays: eight bits of 2^-31 s in LNAV, 13 of 2^-35 s in CNAV, ten of 2^-32 s of Galileo and
# of 0.1 ns of BeiDou, 12 of 2^-34 s in B-CNAV.
SYSTEMS: Mapping[str, System] = {
    "G": System(
        MOST_SATELLITES["G"], {"gps_lnav": LNAV, "gps_cnav": CNAV, "gps_cnav2": CNAV2}, 7200.0, True, 16.0, 6144.0,
        1.2e-7, 0.0, 0,
    ),
    "C": System(
        MOST_SATELLITES["C"], {"beidou_d1": D1_D2, "beidou_d2": D1_D2}, 7200.0, True, 8.0, 4096.0, 1.2e-7,
        BDT_BEHIND_GPS_S, 1356,
    ),
    "E": System(
        MOST_SATELLITES["E"], {"galileo_inav": INAV, "galileo_fnav": FNAV}, 14400.0, False, 60.0, 6.0, 1.2e-7, 0.0, 0,
    ),
    "R": System(MOST_SATELLITES["R"], {}, 900.0, True, 0.0, 0.0, 0.0, 0.0, 0),
    "J": System(
        MOST_SATELLITES["J"], {"qzss_lnav": LNAV, "qzss_cnav": CNAV, "qzss_cnav2": CNAV2}, 7200.0, True, 16.0, 6144.0,
        1.2e-7, 0.0, 0,
    ),
}  # fmt: skip


def signals_of(system: str) -> tuple[Signal, ...]:
    """The rows of a system."""
    return tuple(signal for signal in SIGNALS if signal.system == system)


def observables_of(system: str, *, dual: bool) -> tuple[Observable, ...]:
    """What is read of a system unless something is asked for, in the order of preference: one signal, or a pair.

    Args:
        system: RINEX letter.
        dual: pairs, of the band of the first row and of another one.
    """
    rows = signals_of(system)
    if not dual:
        return (Observable(rows[:1]),)
    near = [in_one_band(one.ionosphere_factor(rows[0].carrier_hz)) for one in rows]
    # Of one band those first whose group delays are sent in full: P(Y), of which the clock of GPS is, before C/A.
    firsts = [one for one, is_near in zip(rows, near, strict=True) if is_near]
    firsts.sort(key=lambda one: bool(one.neglected_m))
    others = [one for one, is_near in zip(rows, near, strict=True) if not is_near]
    pairs = (Observable((first, other)) for other in others for first in firsts)
    return tuple(pair for pair in pairs if pair.messages)
