"""Which message a signal belongs to, what its health, accuracy and group delays do, and what pairs of carriers are."""

from __future__ import annotations

import gzip
import re
from collections.abc import Sequence
from pathlib import Path

import hatanaka
import numpy as np
import pytest

from pl_mc.error_models import Sky, error_model
from pl_mc.error_models.base import sigma_of_signal_m
from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverData, read_receiver_series, read_rinex, read_truth
from pl_mc.receiver.navigation_records import read_navigation
from pl_mc.receiver.signals import LNAV, Observable, observables_of, signals_of

KMS = "KMS300DNK_R_20221591000_01H_30S_MO.crx", "KMS300DNK_R_20221591000_01H_MN.rnx.gz"
KMS_TRUTH = "3516213.4380,781859.8595,5246037.9660"
C = 299_792_458.0
F1, F2, F5 = 1575.42e6, 1227.60e6, 1176.45e6
TGD, ISC = 5e-9, {"L1C/A": 1e-9, "L2C": 2e-9, "L5I5": 3e-9, "L5Q5": 4e-9}


@pytest.fixture(scope="module")
def texts(data_folder: Path) -> tuple[str, str]:
    """Some epochs of RINEX 4 and their navigation file."""
    observations = hatanaka.crx2rnx((data_folder / KMS[0]).read_bytes()).decode()
    return observations, gzip.decompress((data_folder / KMS[1]).read_bytes()).decode()


def write(folder: Path, texts: Sequence[str]) -> tuple[Path, Path]:
    paths = folder / "made.obs", folder / "made.nav"
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    return paths


def set_field(text: str, name: str, message: str, row: int, column: int, value: float) -> str:
    """A navigation file of RINEX 4 with another number in all records of a satellite and a message."""
    lines = text.split("\n")
    found = [k for k, line in enumerate(lines) if line.split() == [">", "EPH", name, message]]
    assert found
    for k in found:
        at = 4 + 19 * column
        line = lines[k + 1 + row]
        lines[k + 1 + row] = f"{line[:at]}{value:19.12e}{line[at + 19 :]}"
    return "\n".join(lines)


def with_cnav(text: str) -> str:
    """A navigation file with a record of CNAV after each of LNAV of GPS: the same orbit and clock, its own delays."""

    def made(found: re.Match[str]) -> str:
        head, body = found[1], found[2].split("\n")
        rows = [[line[4 + 19 * k : 23 + 19 * k] for k in range(4)] for line in body[1:8]]

        def number(value: float) -> str:
            return f"{value:19.12e}"

        rows[0][0] = number(0.0)
        rows[4] = [rows[4][0], number(0.0), number(0.0), number(0.0)]
        rows[5] = [number(0.0), number(0.0), number(TGD), number(0.0)]
        rows[6] = [number(value) for value in ISC.values()]
        rows.append([found[2].split("\n")[7][4:23], number(2213.0), " " * 19, " " * 19])
        lines = [body[0], *("    " + "".join(row) for row in rows)]
        return found[0] + f"> EPH {head} CNAV\n" + "\n".join(lines) + "\n"

    return re.sub(r"> EPH (G\d\d) LNAV *\n((?:[^>].*\n){8})", made, text)


def with_b_cnav(
    text: str, *, delays: tuple[float, float] = (4e-9, -3e-9), health: tuple[int, int] = (0, 0),
    flags: tuple[int | None, int | None] = (0, 0),
) -> str:  # fmt: skip
    """A navigation file with records of B-CNAV1 and B-CNAV2 after each of D1."""

    def made(found: re.Match[str]) -> str:
        blank, out = " " * 19, found[0]
        for message, ill, flag in zip(("CNV1", "CNV2"), health, flags, strict=True):
            flag_field = blank if flag is None else f"{float(flag):19.12e}"
            rows = found[2].split("\n")[:6]
            rows.append("    " + f"{0.0:19.12e}" * 4)
            rows.append(f"    {1e-9:19.12e}{blank}{delays[0]:19.12e}{delays[1]:19.12e}")
            rows.append(f"    {0.0:19.12e}{float(ill):19.12e}{flag_field}{1.0:19.12e}")
            rows.append(f"    {0.0:19.12e}{blank}{blank}{1.0:19.12e}")
            out += f"> EPH {found[1]} {message}\n" + "\n".join(rows) + "\n"
        return out

    return re.sub(r"> EPH (C\d\d) D1 *\n((?:[^>].*\n){8})", made, text)


def clock_m(data: ReceiverData, name: str) -> float:
    return float(data.satellite_clock_m[0, data.names.index(name)])


def used(data: ReceiverData) -> set[str]:
    """Satellites with a state at the first epoch."""
    return {name for k, name in enumerate(data.names) if np.isfinite(data.satellite_clock_m[0, k])}


# Data validity and health of E1-B are bits 0 to 2 of I/NAV, of E5b bits 6 to 8, of E5a bits 3 to 5 of F/NAV.
@pytest.mark.parametrize(
    ("message", "health", "forbidden", "free"),
    [
        ("INAV", 0b000_000_001, ["E1"], ["E5a", "E5b"]),
        ("INAV", 0b000_000_100, ["E1"], ["E5a", "E5b"]),
        ("INAV", 0b001_000_000, ["E5b"], ["E1", "E5a"]),
        ("FNAV", 0b000_010_000, ["E5a"], ["E1", "E5b"]),
        ("FNAV", 0b000_001_000, ["E1+E5a"], ["E1+E5b"]),
        ("INAV", 0b000_000_010, ["E1+E5a", "E1+E5b"], []),
        ("INAV", 0b010_000_000, ["E1+E5b"], ["E1+E5a"]),
    ],
)
def test_health_counts_signal_by_signal(
    message: str, health: int, forbidden: list[str], free: list[str], texts: tuple[str, str], tmp_path: Path
) -> None:
    paths = write(tmp_path, (texts[0], set_field(texts[1], "E07", message, 6, 1, float(health))))
    for signal in (*forbidden, *free):
        kind = "dual" if "+" in signal else "none"
        data = read_rinex(*paths, systems=("E",), signals=(signal,), ionosphere=kind)
        assert ("E07" in used(data)) == (signal in free)
        assert data.unhealthy[0, data.names.index("E07")] == (signal in forbidden)


def test_what_has_no_accuracy_is_left_out(texts: tuple[str, str], tmp_path: Path) -> None:
    """NAPA, index 255, is written as -1; the largest that Galileo sends is 6 m."""
    for value, left_out in ((-1.0, True), (6.0, False), (6.1, True)):
        paths = write(tmp_path, (texts[0], set_field(texts[1], "E07", "INAV", 6, 0, value)))
        data = read_rinex(*paths, systems=("E",), ionosphere="none")
        assert data.unpredicted[0, data.names.index("E07")] == left_out
        assert "E07" in used(read_rinex(*paths, systems=("E",), signals=("E5a",), ionosphere="none"))


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (513.0, "I/NAV"),
        (516.0, "I/NAV"),
        (512.0, "I/NAV"),
        (258.0, "F/NAV"),
        (514.0, "I/NAV"),
        (257.0, "F/NAV"),
        (0.0, "I/NAV"),
    ],
)
def test_the_message_of_galileo_is_that_of_its_clock(
    sources: float, message: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    """Bits 8 and 9 of the data sources say which clock a record has; where they do not, what RINEX 4 announces."""
    inav = re.sub(r"> EPH E\d\d FNAV *\n(?:[^>].*\n){8}", "", texts[1])
    path = write(tmp_path, (texts[0], set_field(inav, "E07", "INAV", 5, 1, sources)))[1]
    navigation = read_navigation([path], ("E",))
    assert {one.message for one in navigation.ephemerides["E07"]} == {message}
    assert navigation.notes == ()
    if not sources:
        records = re.findall(r"> EPH E07 INAV *\n((?:[^>].*\n){8})", set_field(inav, "E07", "INAV", 5, 1, sources))
        head = f"{'3.05':>9}{'':11}{'NAVIGATION DATA':20}{'M':20}RINEX VERSION / TYPE\n{'':60}END OF HEADER\n"
        path.write_text(head + "".join(records))
        older = read_navigation([path], ("E",))
        assert older.ephemerides == {}
        assert "the record of E07 of 2022-06-08" in older.notes[0]
        assert "its data sources name neither I/NAV nor F/NAV" in older.notes[0]


def test_a_signal_without_its_message_is_not_read(texts: tuple[str, str], tmp_path: Path) -> None:
    inav = re.sub(r"> EPH E\d\d FNAV *\n(?:[^>].*\n){8}", "", texts[1])
    paths = write(tmp_path, (texts[0], inav))
    assert used(read_rinex(*paths, systems=("E",), signals=("E1",), ionosphere="none"))
    with pytest.raises(InputError, match=r"it has no group delay of Galileo E5a \(BGD E1,E5a of F/NAV\)"):
        read_rinex(*paths, systems=("E",), signals=("E5a",), ionosphere="none")
    # The pair that is left is taken.
    dual = read_rinex(*paths, systems=("E",), ionosphere="dual")
    assert dual.observables["E"].name == "E1 + E5b"
    default = read_rinex(*write(tmp_path, texts), systems=("E",), ionosphere="dual")
    assert default.observables["E"].name == "E1 + E5a"


@pytest.mark.parametrize(
    ("signal", "delay_s"), [("L5", TGD - ISC["L5Q5"]), ("L2C", TGD - ISC["L2C"]), ("L2", None), ("L1", None)]
)
def test_group_delays_of_cnav(signal: str, delay_s: float | None, texts: tuple[str, str], tmp_path: Path) -> None:
    """IS-GPS-200, 30.3.3.3.1.1; IS-GPS-705, 20.3.3.3.1.2: less TGD, plus the ISC of the signal; LNAV for the others."""
    usual = read_rinex(*write(tmp_path, texts), systems=("G",), signals=("L1",), ionosphere="none")
    paths = write(tmp_path, (texts[0], with_cnav(texts[1])))
    data = read_rinex(*paths, systems=("G",), signals=(signal,), ionosphere="none")
    common = sorted(used(data) & used(usual))
    assert len(common) >= 4
    for name in common:
        record = next(line for line in re.findall(rf"> EPH {name} LNAV *\n(?:.*\n){{6}}(.*)\n", texts[1]))
        tgd_s = float(record[42:61])
        expected_s = {"L1": tgd_s, "L2": (F1 / F2) ** 2 * tgd_s}.get(signal, delay_s)
        assert clock_m(data, name) - clock_m(usual, name) == pytest.approx(C * (tgd_s - expected_s), abs=1e-3)


def test_two_carriers_of_cnav(texts: tuple[str, str], tmp_path: Path) -> None:
    """IS-GPS-705, 20.3.3.3.1.2.2: of L1 C/A and L5 the corrected range has (ISC5 - g ISC1) / (1 - g) - TGD."""
    usual = read_rinex(*write(tmp_path, texts), systems=("G",), signals=("L1",), ionosphere="none")
    paths = write(tmp_path, (texts[0], with_cnav(texts[1])))
    data = read_rinex(*paths, systems=("G",), signals=("L1+L5",), ionosphere="dual")
    ratio = (F1 / F5) ** 2
    left_s = (ISC["L5Q5"] - ratio * ISC["L1C/A"]) / (1 - ratio) - TGD
    for name in used(data):
        record = next(line for line in re.findall(rf"> EPH {name} LNAV *\n(?:.*\n){{6}}(.*)\n", texts[1]))
        assert clock_m(data, name) - clock_m(usual, name) == pytest.approx(
            C * (left_s + float(record[42:61])), abs=2e-3
        )
    without = write(tmp_path, texts)
    with pytest.raises(InputError, match=r"no group delay of GPS L1 C/A \+ L5 .*ISC L5Q5 of CNAV"):
        read_rinex(*without, systems=("G",), signals=("L1+L5",), ionosphere="dual")


def test_one_carrier_alone_is_left_out_and_told(texts: tuple[str, str], tmp_path: Path) -> None:
    header, body = texts[0].split("END OF HEADER", 1)
    # C2W of GPS is its fifth value.
    gone = re.sub(r"^(G05.{64}).{14}", rf"\1{'':14}", body, flags=re.M)
    assert gone != body
    paths = write(tmp_path, (f"{header}END OF HEADER{gone}", texts[1]))
    data = read_rinex(*paths, systems=("G",), ionosphere="dual")
    assert data.one_carrier[:, data.names.index("G05")].all()
    series = read_receiver_series(*paths, read_truth(KMS_TRUTH), systems=("G",), ionosphere="dual")
    assert any(
        re.search(r"G05 \(19 epochs\).*left out for want of the second of two carriers", n) for n in series.notes
    )


def test_what_group_delay_is_missing_is_told(texts: tuple[str, str], tmp_path: Path) -> None:
    paths = write(tmp_path, texts)
    told = {}
    for signals in ("L1P+L2", "L1+L2", "L1P+L2C"):
        told[signals] = read_rinex(*paths, systems=("G",), signals=(signals,), ionosphere="dual").notes
    assert told["L1P+L2"] == ()
    first, second = (F1**2 / (F1**2 - F2**2), F2**2 / (F1**2 - F2**2))
    assert f"up to {0.8 * first:.1f} m a satellite stays in" in told["L1+L2"][0]
    assert f"up to {0.6 * second:.1f} m a satellite stays in" in told["L1P+L2C"][0]
    assert read_rinex(*paths, systems=("G",), ionosphere="dual").observables["G"].name == "L1 P(Y) + L2 P(Y)"
    # With the ISC of CNAV nothing is missing.
    paths = write(tmp_path, (texts[0], with_cnav(texts[1])))
    assert read_rinex(*paths, systems=("G",), signals=("L1+L2C",), ionosphere="dual").notes == ()


@pytest.mark.parametrize(
    ("signals", "ionosphere", "words"),
    [
        (("E1+E5a",), "broadcast", "or two with the ionosphere dual, not 'E1\\+E5a'"),
        (("E1",), "dual", "two are combined, such as E1\\+E5b, not 'E1'"),
        (("L7",), "none", "'L7' is not read of GPS \\+ Galileo \\(nearest: L5"),
        (("L1", "L2"), "none", "L1 C/A and L2 P\\(Y\\) are both of GPS"),
        (("L1+L1C",), "dual", "'L1\\+L1C' cannot be combined"),
        (("L1+E5a",), "dual", "two signals of one system"),
        ("E1", "none", "a sequence of names is needed"),
        ((3,), "none", "not 3"),
    ],
)
def test_signals_that_cannot_be(
    signals: object, ionosphere: str, words: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words) as stop:
        read_rinex(*write(tmp_path, texts), systems=("G", "E"), signals=signals, ionosphere=ionosphere)
    assert "\n" not in str(stop.value)


def test_combinations_have_no_ionosphere_and_their_own_noise() -> None:
    """f1^2 / (f1^2 - f2^2) and its complement: of L1 and L2 2.546 and -1.546, root sum of squares 2.978."""
    for letter in "GCEJ":
        for pair in observables_of(letter, dual=True):
            factors = [signal.ionosphere_factor() for signal in pair.signals]
            assert np.dot(pair.coefficients, factors) == pytest.approx(0.0, abs=1e-12)
            assert sum(pair.coefficients) == pytest.approx(1.0, rel=1e-12)
            assert pair.ionosphere == 0.0
    rows = {signal.short: signal for signal in signals_of("G")}
    pair = Observable((rows["L1P"], rows["L2P"]))
    assert pair.coefficients == pytest.approx((2.5457, -1.5457), abs=1e-4)
    assert pair.noise == pytest.approx(2.978, abs=1e-3)
    assert pair.group_delays(LNAV) == {}


def test_the_pairs_that_are_tried() -> None:
    """P(Y) before C/A; B1I, which all satellites of BeiDou send, before B1C; E5a before E5b; G1 with G2."""
    names = {letter: [pair.name for pair in observables_of(letter, dual=True)] for letter in "GCERJ"}
    assert names["G"][:2] == ["L1 P(Y) + L2 P(Y)", "L1 C/A + L2 P(Y)"]
    assert names["C"][0] == "B1I + B3I"
    assert names["E"] == ["E1 + E5a", "E1 + E5b"]
    assert names["R"] == ["G1 + G2"]
    assert names["J"] == ["L1 C/A + L2C", "L1 C/A + L5"]


def test_sigma_of_other_signals() -> None:
    """sigma0 times the noise, the ionosphere times (f1/f5)^2 or nothing, the troposphere as it is."""
    sky = Sky(orbit="GPS", elevation_rad=np.radians(40.0), azimuth_rad=0.0, latitude_rad=0.9, longitude_rad=0.0)
    parts = {
        "noise": error_model("none"),
        "ionosphere": error_model("user", vertical_ionosphere_m=0.5, zenith_troposphere_m=0.0),
        "all": error_model("residual"),
    }
    noise, with_ionosphere, total = (float(part.sigma_m(sky)) ** 2 for part in parts.values())
    ionosphere, troposphere = with_ionosphere - noise, total - with_ionosphere

    def variance(amplified: float, factor: float) -> float:
        return float(sigma_of_signal_m(parts["all"], sky, noise=np.array(amplified), ionosphere=np.array(factor))) ** 2

    assert variance(1.0, 1.0) == pytest.approx(total, rel=1e-12)
    assert variance(2.978, 0.0) == pytest.approx(2.978**2 * noise + troposphere, rel=1e-12)
    factor = (F1 / F5) ** 2
    assert variance(1.0, factor) == pytest.approx(noise + factor**2 * ionosphere + troposphere, rel=1e-12)
    constant = error_model("constant")
    both = sigma_of_signal_m(constant, sky, noise=np.array(2.978), ionosphere=np.array(0.0))
    assert both == pytest.approx(2.978 * constant.sigma_m(sky), rel=1e-12)


def test_glonass_is_read_where_it_is_asked_for(texts: tuple[str, str], tmp_path: Path) -> None:
    paths = write(tmp_path, texts)
    assert "R" not in read_rinex(*paths).systems
    data = read_rinex(*paths, systems=("R",), ionosphere="none")
    assert {"R04", "R20"} <= used(data)
    assert set(data.orbits) == {"GLO"}
    bound = "FDMA does not send all of its group delays, and none between the receiver's channels is known"
    assert data.notes[0] == f"GLONASS G1: {bound}; up to 3.0 m a satellite stays in."


@pytest.mark.parametrize(
    ("row", "column", "text", "told"),
    [
        (1, 0, " 1.0x0000000000E+04", "is not a number of 19 columns"),
        (1, 0, " 1.000000000000E+01", "no satellite is there"),
        (1, 1, " 9.000000000000E+00", "no satellite is there, is so fast"),
        (2, 3, " 9.900000000000E+01", "there is no channel 99"),
    ],
)
def test_damaged_records_of_glonass(
    row: int, column: int, text: str, told: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    lines = texts[1].split("\n")
    for k in [k for k, line in enumerate(lines) if line.startswith("> EPH R04")]:
        at = 4 + 19 * column
        lines[k + 1 + row] = lines[k + 1 + row][:at] + text + lines[k + 1 + row][at + 19 :]
    data = read_rinex(*write(tmp_path, (texts[0], "\n".join(lines))), systems=("R",), ionosphere="none")
    assert "R04" not in used(data)
    assert data.no_ephemeris[:, data.names.index("R04")].any()
    assert "the record of R04 at line" in data.notes[0]
    assert told in data.notes[0]


def test_an_unhealthy_satellite_of_glonass(texts: tuple[str, str], tmp_path: Path) -> None:
    """Bn is the fourth number of the second line."""
    paths = write(tmp_path, (texts[0], set_field(texts[1], "R04", "FDMA", 1, 3, 1.0)))
    data = read_rinex(*paths, systems=("R",), ionosphere="none")
    assert data.unhealthy[0, data.names.index("R04")]


def test_a_phone_with_l5_and_no_isc(texts: tuple[str, str], tmp_path: Path) -> None:
    """GPS C1C and C5Q alone, with LNAV: Galileo is read of two carriers, and what GPS lacks is said."""
    header, body = texts[0].split("END OF HEADER", 1)
    header = re.sub(r"^G   11.*$", f"{'G    2 C1C C5Q':60}SYS / # / OBS TYPES", header, flags=re.M)
    # C5Q is the sixth value.
    body = re.sub(r"^(G\d\d.{16}).{64}(.{16}).*$", r"\1\2", body, flags=re.M)
    paths = write(tmp_path, (f"{header}END OF HEADER{body}", texts[1]))
    wanting = r"no group delay of GPS L1 C/A \+ L5 \(TGD and ISC L1C/A and ISC L5Q5 of CNAV\)"
    data = read_rinex(*paths, systems=None, ionosphere="dual")
    assert "G" not in data.systems
    assert any(re.search(wanting, note) for note in data.notes)
    with pytest.raises(InputError, match=wanting):
        read_rinex(*paths, systems=("G",), ionosphere="dual")
    with pytest.raises(InputError, match=r"no group delay of GPS L5 \(TGD and ISC L5Q5 of CNAV\)"):
        read_rinex(*paths, systems=("G",), signals=("L5",))
    with pytest.raises(
        InputError, match=r"no group delay of BeiDou B1C \(TGD B1Cp of B-CNAV1, or TGD B1Cp of B-CNAV2\)"
    ):
        read_rinex(*paths, systems=("C",), signals=("B1C",))
    with_isc = write(tmp_path, (f"{header}END OF HEADER{body}", with_cnav(texts[1])))
    assert read_rinex(*with_isc, systems=("G",), ionosphere="dual").observables["G"].name == "L1 C/A + L5"


@pytest.mark.parametrize(("health", "forbidden"), [(0b001, "L5"), (0b010, "L2C"), (0b100, "L1+L5"), (0b011, "L1+L2C")])
def test_health_of_cnav(health: int, forbidden: str, texts: tuple[str, str], tmp_path: Path) -> None:
    """L1, L2 and L5, the first the highest bit (IS-GPS-200, 30.3.3.1.1.2)."""
    text = with_cnav(texts[1])
    names = re.findall(r"> EPH (G\d\d) CNAV", text)
    for name in names:
        text = set_field(text, name, "CNAV", 6, 1, float(health))
    paths = write(tmp_path, (texts[0], text))
    for signal in ("L1", "L2C", "L5", "L1+L2C", "L1+L5"):
        kind = "dual" if "+" in signal else "none"
        data = read_rinex(*paths, systems=("G",), signals=(signal,), ionosphere=kind)
        bits = {"L1": 0b100, "L2C": 0b010, "L5": 0b001}
        ill = any(bits[word] & health for word in signal.split("+"))
        assert ill == (not used(data) & set(names))
        assert ill or signal != forbidden


def test_b1c_and_b2a_have_the_delays_of_b_cnav(texts: tuple[str, str], tmp_path: Path) -> None:
    """The clock is that of B3I; less TGD B1Cp it is that of B1C, less TGD B2ap that of B2a."""
    usual = read_rinex(*write(tmp_path, texts), systems=("C",), signals=("B3I",), ionosphere="none")
    paths = write(tmp_path, (texts[0], with_b_cnav(texts[1])))
    for signal, delay_s in (("B1C", 4e-9), ("B2a", -3e-9)):
        data = read_rinex(*paths, systems=("C",), signals=(signal,), ionosphere="none")
        common = used(data) & used(usual)
        assert len(common) >= 3
        for name in common:
            assert clock_m(data, name) - clock_m(usual, name) == pytest.approx(-C * delay_s, abs=2e-3)
    both = read_rinex(*paths, systems=("C",), signals=("B1C+B2a",), ionosphere="dual")
    ratio = (F1 / F5) ** 2
    for name in used(both) & used(usual):
        left_s = (ratio * 4e-9 + 3e-9) / (ratio - 1)
        assert clock_m(both, name) - clock_m(usual, name) == pytest.approx(-C * left_s, abs=2e-3)
    assert read_rinex(*paths, systems=("C",), ionosphere="none").observables["C"].name == "B1I"


@pytest.mark.parametrize(("health", "forbidden"), [((1, 0), "B1C"), ((0, 1), "B2a")])
def test_health_of_b_cnav(health: tuple[int, int], forbidden: str, texts: tuple[str, str], tmp_path: Path) -> None:
    paths = write(tmp_path, (texts[0], with_b_cnav(texts[1], health=health)))
    for signal in ("B1C", "B2a"):
        data = read_rinex(*paths, systems=("C",), signals=(signal,), ionosphere="none")
        assert bool(used(data)) == (signal != forbidden)
    assert used(read_rinex(*paths, systems=("C",), ionosphere="none"))


# Flags of B-CNAV1 are DIF, SIF and AIF of B1C; of B-CNAV2 those of B2a and then those of B1C.
@pytest.mark.parametrize(
    ("flags", "forbidden"),
    [
        ((0b100, 0), {"B1C"}), ((0b010, 0), {"B1C"}), ((0b001, 0), set()), ((0, 0b100_000), {"B2a"}),
        ((0, 0b010_000), {"B2a"}), ((0, 0b001_001), set()), ((0, 0b000_100), {"B1C"}), ((0, 0b010_010), {"B1C", "B2a"}),
        ((None, None), set()),
    ],
)  # fmt: skip
def test_integrity_flags_of_b_cnav(
    flags: tuple[int | None, int | None], forbidden: set[str], texts: tuple[str, str], tmp_path: Path
) -> None:
    paths = write(tmp_path, (texts[0], with_b_cnav(texts[1], flags=flags)))
    for signal in ("B1C", "B2a"):
        data = read_rinex(*paths, systems=("C",), signals=(signal,), ionosphere="none")
        assert bool(used(data)) == (signal not in forbidden)
        assert data.unhealthy.any() == (signal in forbidden)
    assert used(read_rinex(*paths, systems=("C",), ionosphere="none"))


def test_damaged_delays_of_b_cnav(texts: tuple[str, str], tmp_path: Path) -> None:
    damaged = with_b_cnav(texts[1], delays=(4e-7, 0.0))
    paths = write(tmp_path, (texts[0], damaged))
    with pytest.raises(InputError, match=r"no group delay of BeiDou B1C"):
        read_rinex(*paths, systems=("C",), signals=("B1C",), ionosphere="none")
