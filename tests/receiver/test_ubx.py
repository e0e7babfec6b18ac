"""Logs of u-blox receivers, written byte by byte from the layout of the messages in the interface description."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from pl_mc.geometry.frames import from_geodetic, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.receiver import Fixes, read_claims, read_truth

WEEK, TOW_MS = 2111, 345_630_000
FIRST_GPS_S = gps_seconds("2020-06-25T00:00:30")
LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_MM = 55.4936789, -8.4568271, 59_428


def message(group: int, kind: int, payload: bytes) -> bytes:
    covered = struct.pack("<BBH", group, kind, len(payload)) + payload
    a = b = 0
    for byte in covered:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + covered + bytes([a, b])


def pvt(
    ms: int, *, fix: int = 3, ok: int = 1, valid: int = 7, date: tuple[int, ...] = (2020, 6, 25, 0, 0, 12),
    accuracy_mm: tuple[int, int] = (1500, 2500), invalid: int = 0, length: int = 92, latitude: float = LATITUDE_DEG,
) -> bytes:  # fmt: skip
    """NAV-PVT, of 92 bytes, or 84 in the earliest protocol."""
    payload = struct.pack("<IHBBBBBBIiBBBB", ms, *date, valid, 25, -300_000, fix, ok, 0xE0, 14)
    payload += struct.pack("<iiiiII", round(LONGITUDE_DEG * 1e7), round(latitude * 1e7), HEIGHT_MM, 0, *accuracy_mm)
    payload += struct.pack("<iiiiiIIHHIihH", 1, 2, 3, 4, 5, 6, 7, 150, invalid, 0, 0, 0, 0)
    assert len(payload) == 92
    return message(0x01, 0x07, payload[:length])


def posllh(ms: int, *, accuracy_mm: tuple[int, int] = (1700, 2700)) -> bytes:
    place = round(LONGITUDE_DEG * 1e7), round(LATITUDE_DEG * 1e7), HEIGHT_MM, 18_827
    return message(0x01, 0x02, struct.pack("<IiiiiII", ms, *place, *accuracy_mm))


def hpposllh(ms: int, *, invalid: int = 0) -> bytes:
    """1e-7 degrees and millimetres, with a hundredth and a tenth of these; accuracies in a tenth of a millimetre."""
    place = round(LONGITUDE_DEG * 1e7), round(LATITUDE_DEG * 1e7), HEIGHT_MM, 18_827
    payload = struct.pack("<BHBIiiiibbbbII", 0, 0, invalid, ms, *place, -25, 31, 4, 0, 161, 263)
    return message(0x01, 0x14, payload)


def levels(ms: int, mm: tuple[int, int, int], *, frame: int = 3, valid: int = 1, risk=(5, 0)) -> bytes:
    head = struct.pack("<BBbBBBBB4xI", 1, *risk, valid, frame, 0, 0, 0, ms)
    return message(0x01, 0x62, head + struct.pack("<IIIIIIHHI4x", *mm, 0, 0, 0, 4500, 0, 0))


def timegps(ms: int, *, valid: int = 7, week: int = WEEK) -> bytes:
    return message(0x01, 0x20, struct.pack("<IihbBI", ms, 0, week, 18, valid, 20))


def read(folder: Path, *parts: bytes, name: str = "log.ubx") -> Fixes:
    pytest.importorskip("pyubx2")
    path = folder / name
    path.write_bytes(b"".join(parts))
    return read_claims(path)


def test_a_log_gives_positions_accuracies_and_levels(tmp_path: Path) -> None:
    fixes = read(
        tmp_path, pvt(TOW_MS), levels(TOW_MS, (4000, 3000, 7000)), b"$GNTXT,01,01*2B\r\n",
        levels(TOW_MS + 250, (3000, 4000, 8000), frame=1), pvt(TOW_MS + 250), pvt(TOW_MS + 500),
        levels(TOW_MS + 500, (1, 2, 3), valid=0), levels(TOW_MS + 750, (6000, 8000, 9000), frame=2),
        pvt(TOW_MS + 750, accuracy_mm=(0xFFFFFFFF, 2500)), message(0x02, 0x15, bytes(40)),
    )  # fmt: skip
    # Times are those of the week in GPS time, not of the date in UTC with its nanoseconds.
    np.testing.assert_array_equal(fixes.time_gps_s, FIRST_GPS_S + np.array([0.0, 0.25, 0.5, 0.75]))
    expected = from_geodetic(np.radians(LATITUDE_DEG), np.radians(LONGITUDE_DEG), np.array(59.428))
    np.testing.assert_allclose(fixes.position_m, np.broadcast_to(expected, (4, 3)), atol=1e-3)
    assert fixes.covariance_m2 is not None
    np.testing.assert_allclose(np.diag(fixes.covariance_m2[0]), [1.5**2 / 2, 1.5**2 / 2, 2.5**2])
    assert np.isnan(fixes.covariance_m2[3]).all()
    # An ellipse reaches as far as its longer axis, two axes as far as both together.
    np.testing.assert_array_equal(fixes.level_m["hpl"], [4.0, 5.0, np.nan, 10.0])
    np.testing.assert_array_equal(fixes.level_m["vpl"], [7.0, 8.0, np.nan, 9.0])
    assert fixes.satellites.tolist() == [14] * 4
    assert fixes.of_sigma.startswith("vacc_m as the standard deviation up")
    assert fixes.notes == (
        "log.ubx: 4 positions of NAV-PVT, 3 protection levels of NAV-PL, which are to be misleading in 5 % of epochs "
        "at most, on each axis.",
        "log.ubx: 1 UBX messages of NAV-PL without a valid level were left out.",
    )


@pytest.mark.parametrize(("risk", "said"), [((5, 0), "5 %"), ((1, -3), "0.001 %"), ((25, -6), "2.5e-05 %")])
def test_the_risk_of_a_level_is_a_coefficient_and_a_power_of_ten(risk, said: str, tmp_path: Path) -> None:
    fixes = read(tmp_path, pvt(TOW_MS), levels(TOW_MS, (1, 1, 1), risk=risk))
    assert f"misleading in {said} of epochs" in fixes.notes[0]


def test_positions_of_other_messages_stand_in_where_there_is_no_pvt(tmp_path: Path) -> None:
    fixes = read(
        tmp_path, posllh(TOW_MS), hpposllh(TOW_MS), timegps(TOW_MS), posllh(TOW_MS + 1000), hpposllh(TOW_MS + 1000),
        pvt(TOW_MS + 1000), posllh(TOW_MS + 2000), posllh(TOW_MS + 3000), pvt(TOW_MS + 3000, fix=0, ok=0),
        posllh(TOW_MS + 4000, accuracy_mm=(0xFFFFFFFF, 0xFFFFFFFF)), hpposllh(TOW_MS + 5000, invalid=1),
    )  # fmt: skip
    np.testing.assert_array_equal(fixes.time_gps_s, FIRST_GPS_S + np.array([0.0, 1.0, 2.0]))
    angles = [LATITUDE_DEG + 31e-9, LONGITUDE_DEG - 25e-9]
    fine = from_geodetic(*np.radians(angles), np.array(59.4284))
    # The first is that of high precision, with accuracies of 16.1 and 26.3 mm.
    np.testing.assert_allclose(fixes.position_m[0], fine, atol=1e-5)
    sigma_m = np.sqrt(np.diagonal(fixes.covariance_m2, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma_m[:, 2], [0.0263, 2.5, 2.7])
    np.testing.assert_allclose(sigma_m[:, 0] * np.sqrt(2.0), [0.0161, 1.5, 1.7])
    assert fixes.satellites is None
    said = " ".join(fixes.notes)
    for words in (
        "1 positions of NAV-HPPOSLLH, 1 positions of NAV-PVT, 1 positions of NAV-POSLLH",
        "1 UBX messages of NAV-PVT without a fix", "1 UBX messages of NAV-POSLLH without an accuracy",
        "1 UBX messages of NAV-HPPOSLLH that are not valid",
    ):  # fmt: skip
        assert words in said, words


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (pvt(TOW_MS, fix=2), "without a fix in three dimensions"), (pvt(TOW_MS, ok=0), "without a fix in three dim"),
        (pvt(TOW_MS, invalid=1), "without a fix in three dimensions"), (pvt(TOW_MS, fix=5), "without a fix in three"),
        (pvt(TOW_MS, latitude=95.0), "away from the Earth's surface"),
    ],
)  # fmt: skip
def test_positions_that_are_none_are_left_out(part: bytes, words: str, tmp_path: Path) -> None:
    fixes = read(tmp_path, part, pvt(TOW_MS + 1000))
    assert fixes.time_gps_s.tolist() == [FIRST_GPS_S + 1.0]
    assert words in fixes.notes[1]
    with pytest.raises(InputError, match="no UBX message gives a position with a fix") as caught:
        read(tmp_path, part)
    assert words in str(caught.value)


def test_damaged_bytes_cost_their_message_alone(tmp_path: Path) -> None:
    bad = bytearray(pvt(TOW_MS + 1000))
    bad[40] ^= 0x10
    # A length that reaches beyond the messages that follow.
    long = bytearray(pvt(TOW_MS + 2000))
    long[5] = 0x01
    fixes = read(
        tmp_path, b"\x00\xb5", pvt(TOW_MS), bytes(bad), pvt(TOW_MS + 1500), bytes(long), pvt(TOW_MS + 2500),
        levels(TOW_MS + 2500, (1000, 1000, 2000)), b"noise\xff", pvt(TOW_MS + 3000), pvt(TOW_MS + 3500)[:-3],
    )  # fmt: skip
    np.testing.assert_array_equal(fixes.time_gps_s - FIRST_GPS_S, [0.0, 1.5, 2.5, 3.0])
    np.testing.assert_array_equal(fixes.level_m["vpl"], [np.nan, np.nan, 2.0, np.nan])
    assert "log.ubx: 3 UBX messages that are damaged or cut short were left out." in fixes.notes


def test_every_damaged_byte_is_found_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    clean = [pvt(TOW_MS + 1000 * k) for k in range(40)]
    whole = bytearray(b"".join(clean))
    hit = rng.choice(40, size=12, replace=False)
    for k in hit:
        whole[k * len(clean[0]) + int(rng.integers(2, len(clean[0])))] ^= int(rng.integers(1, 256))
    fixes = read(tmp_path, bytes(whole))
    kept = set((fixes.time_gps_s - FIRST_GPS_S).astype(int).tolist())
    assert kept == set(range(40)) - set(hit.tolist())


def test_the_week_is_that_of_the_nearest_date_across_its_end(tmp_path: Path) -> None:
    last, date = 604_800_000 - 1000, (2020, 6, 27, 23, 59, 41)
    fixes = read(tmp_path, pvt(last, date=date), posllh(0), posllh(1000))
    np.testing.assert_array_equal(fixes.time_gps_s, (WEEK + 1) * 604_800.0 + np.array([-1.0, 0.0, 1.0]))
    fixes = read(tmp_path, posllh(200_000_000), pvt(TOW_MS, valid=0), timegps(TOW_MS + 1000))
    assert fixes.time_gps_s.tolist() == [WEEK * 604_800.0 + 200_000.0, WEEK * 604_800.0 + TOW_MS / 1e3]
    with pytest.raises(InputError, match=r"log\.ubx: its times have no week; NAV-TIMEGPS with a valid week or NAV-PVT"):
        read(tmp_path, pvt(TOW_MS, valid=4), timegps(TOW_MS, valid=5))


def test_the_shorter_form_of_early_receivers(tmp_path: Path) -> None:
    assert read(tmp_path, pvt(TOW_MS, length=84)).time_gps_s.tolist() == [FIRST_GPS_S]


def test_a_log_is_a_track_and_may_be_packed(tmp_path: Path) -> None:
    import gzip

    pytest.importorskip("pyubx2")
    path = tmp_path / "track.ubx.gz"
    path.write_bytes(gzip.compress(b"".join(pvt(TOW_MS + 1000 * k) for k in range(3))))
    track = read_truth(str(path))
    latitude, longitude, height_m = geodetic(track.at([FIRST_GPS_S + 0.5])[0][0])
    assert np.degrees([latitude, longitude]) == pytest.approx([LATITUDE_DEG, LONGITUDE_DEG], abs=1e-9)
    assert height_m == pytest.approx(59.428, abs=1e-6)
    assert track.notes == ("track.ubx.gz: 3 positions of NAV-PVT.",)


def sentences() -> bytes:
    path = Path(__file__).parent / "files" / "esbjerg.nmea"
    return path.read_bytes()


def test_sentences_are_read_where_messages_have_no_position_and_among_noise(tmp_path: Path) -> None:
    pytest.importorskip("pyubx2")
    clean = read_truth(str(Path(__file__).parent / "files" / "esbjerg.nmea"))
    for between in (message(0x02, 0x15, bytes(range(256))), b"\xfe\x81\xff\n"):
        path = tmp_path / "mixed.ubx"
        path.write_bytes(between * 30 + sentences().replace(b"$GPRMC", between + b"$GPRMC"))
        np.testing.assert_array_equal(read_truth(str(path)).position_m, clean.position_m)
    with pytest.raises(InputError, match=r"log\.ubx: none of its UBX messages has a position; those of NAV-PVT"):
        read(tmp_path, levels(TOW_MS, (1, 1, 1)))
    with pytest.raises(InputError, match=r"log\.ubx: it is not a text file; a \.pos of RTKLIB, an NMEA or UBX log"):
        read(tmp_path, b"\xff\xfe\x00")


def test_without_the_library_a_sentence_names_what_brings_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyubx2", None)
    path = tmp_path / "log.ubx"
    path.write_bytes(pvt(TOW_MS))
    with pytest.raises(InputError, match=r"log\.ubx: its UBX messages need .* pip install 'pl_mc\[ubx\]' brings it"):
        read_claims(path)
