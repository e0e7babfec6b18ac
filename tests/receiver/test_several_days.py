"""Several observation files are one series in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from receiver_files import NOON_GPS_S, TRUTH_TEXT, navigation_text, observation_text, simulate

from pl_mc.cli.main import main
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_receiver_series, read_truth

TRUTH = read_truth(TRUTH_TEXT)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Ten minutes whole, its two halves, and the navigation file."""
    folder = tmp_path_factory.mktemp("days")
    seconds = tuple(30.0 * k for k in range(20))
    made = {"whole": seconds, "first": seconds[:10], "second": seconds[10:]}
    paths = {name: folder / f"{name}.obs" for name in made}
    for name, times in made.items():
        sky = simulate(seconds=times)
        paths[name].write_text(observation_text(sky))
    paths["nav"] = folder / "all.nav"
    paths["nav"].write_text(navigation_text(sky.orbits))
    return paths


def test_two_halves_in_any_order_are_the_whole(files: dict[str, Path]) -> None:
    whole = read_receiver_series(files["whole"], files["nav"], TRUTH)
    for order in (("first", "second"), ("second", "first")):
        both = read_receiver_series([files[name] for name in order], files["nav"], TRUTH)
        np.testing.assert_array_equal(both.geometry.time_gps_s, whole.geometry.time_gps_s)
        assert both.geometry.names == whole.geometry.names
        np.testing.assert_array_equal(both.errors_m, whole.errors_m)
        np.testing.assert_array_equal(both.geometry.design, whole.geometry.design)
        assert both.geometry.epoch.tolist() == list(range(20))
    assert whole.geometry.time_gps_s[0] == NOON_GPS_S


def test_files_of_the_same_time_and_of_other_signals_are_refused(files: dict[str, Path]) -> None:
    with pytest.raises(InputError, match=r"first\.obs: it begins before .*whole\.obs ends"):
        read_receiver_series([files["whole"], files["first"]], files["nav"], TRUTH)
    text = files["second"].read_text()
    bare = files["second"].with_name("gps.obs")
    bare.write_text("".join(line for line in text.splitlines(keepends=True) if not line.startswith("C")))
    with pytest.raises(InputError, match=r"gps\.obs: .*choose systems and signals|no pseudorange of BDS|gps\.obs"):
        read_receiver_series([files["first"], bare], files["nav"], TRUTH)
    found = read_receiver_series([files["first"], bare], files["nav"], TRUTH, systems=("G",))
    assert len(found.geometry) == 20


@pytest.mark.usefixtures("without_figures")
def test_the_command_tells_observations_from_navigation(files: dict[str, Path], tmp_path: Path) -> None:
    order = [str(files[name]) for name in ("first", "nav", "second")]
    main(["observe", *order, "--truth", TRUTH_TEXT, "--method", "ls", "-q", "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert len(table) == 20
    main(["run", str(tmp_path / "out" / "manifest.json"), "-q", "--out", str(tmp_path / "again")])
    pd.testing.assert_frame_equal(table, pd.read_parquet(tmp_path / "again" / "epochs.parquet"))
    with pytest.raises(SystemExit):
        main(["observe", *order[::2], "--truth", TRUTH_TEXT, "-q", "--out", str(tmp_path / "no")])


def with_strengths(folder: Path, strength: dict[str, str]) -> tuple[Path, Path]:
    """The two epochs of a station with S1C of each GPS satellite, 45 dB-Hz unless told."""
    here = Path(__file__).parent / "files"
    lines = []
    for line in (here / "mixed_3.obs").read_text().splitlines():
        if line.startswith("G    2 C1C L1C"):
            lines.append("G    3 C1C L1C S1C".ljust(60) + line[60:])
        elif line.startswith("G") and line[1:3].isdigit():
            lines.append(line.ljust(35) + strength.get(line[:3], "45.000").rjust(14))
        else:
            lines.append(line)
    path = folder / "strong.obs"
    path.write_text("\n".join(lines) + "\n")
    return path, here / "mixed_3.nav"


def test_weak_signals_are_left_out_and_counted(tmp_path: Path) -> None:
    truth = read_truth("4075580.8863,931853.5784,4801567.9707")
    bare = read_receiver_series(*with_strengths(tmp_path, {}), truth, systems=("G",))
    first, second, third = bare.geometry.names[:3]
    paths = with_strengths(tmp_path, {first: "29.900", second: "", third: "30.000"})
    found = read_receiver_series(*paths, truth, systems=("G",), snr_dbhz=30.0)
    # At the limit a signal is strong enough.
    assert set(bare.geometry.names) - set(found.geometry.names) == {first, second}
    assert "2 pseudoranges of less than 30 dB-Hz were left out." in found.notes
    assert "2 pseudoranges of an unknown strength were left out." in found.notes
    assert read_receiver_series(*paths, truth, systems=("G",)).geometry.names == bare.geometry.names
    with pytest.raises(InputError, match=r"strong\.obs: it has no strength S2I of the pseudorange C2I of BeiDou"):
        read_receiver_series(*paths, truth, systems=("G", "C"), snr_dbhz=30.0)
    with pytest.raises(InputError, match="snr_dbhz: a number from 0 to 100"):
        read_receiver_series(*paths, truth, snr_dbhz=-1.0)


@pytest.mark.usefixtures("without_figures")
def test_the_command_and_a_file_of_it_have_a_least_strength(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = map(str, with_strengths(tmp_path, {}))
    options = ["--truth", "4075580.8863,931853.5784,4801567.9707", "--systems", "G", "--snr", "30", "--method", "ls"]
    main(["observe", *paths, *options, "--out", str(tmp_path / "out")])
    assert "at least 30 dB-Hz" in " ".join(capsys.readouterr().out.split())
