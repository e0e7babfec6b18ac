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


def test_the_command_tells_observations_from_navigation(files: dict[str, Path], tmp_path: Path) -> None:
    order = [str(files[name]) for name in ("first", "nav", "second")]
    main(["observe", *order, "--truth", TRUTH_TEXT, "--method", "ls", "-q", "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert len(table) == 20
    main(["run", str(tmp_path / "out" / "manifest.json"), "-q", "--out", str(tmp_path / "again")])
    pd.testing.assert_frame_equal(table, pd.read_parquet(tmp_path / "again" / "epochs.parquet"))
    with pytest.raises(SystemExit):
        main(["observe", *order[::2], "--truth", TRUTH_TEXT, "-q", "--out", str(tmp_path / "no")])
