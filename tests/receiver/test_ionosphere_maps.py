"""Maps of the ionosphere whose delays are known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ionex_files import ionex

from pl_mc.cli.main import main
from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverSeries, read_receiver_series, read_truth

FILES = Path(__file__).parent / "files"
PAIR = FILES / "mixed_3.obs", FILES / "mixed_3.nav"
TEXT = "4075580.8863,931853.5784,4801567.9707"
L1_HZ = 1575.42e6


def read(**options: object) -> ReceiverSeries:
    return read_receiver_series(*PAIR, read_truth(TEXT), systems=("G",), **options)


DAY = ("2020 6 24 12 0 0", "2020 6 25 0 0 0", "2020 6 25 12 0 0")


def test_a_layer_of_one_content_delays_as_its_formula_says(tmp_path: Path) -> None:
    # 20 TECU at midnight, the time of the two epochs, 18 s before which UTC is.
    path = ionex(tmp_path, lambda k: (10.0, 20.0, 50.0)[k], DAY)
    none, maps = read(ionosphere="none"), read(ionex=path)
    np.testing.assert_array_equal(none.geometry.design, maps.geometry.design)
    for epoch in range(2):
        elevation = np.arcsin(-none.geometry.design[epoch, :, 2])
        zenith = np.arcsin(6371.0 / (6371.0 + 450.0) * np.cos(elevation))
        expected_m = 40.3e16 * 20.0 / L1_HZ**2 / np.cos(zenith)
        taken_m = none.errors_m[epoch] - maps.errors_m[epoch]
        # The clock of each is the median, so that differences between satellites tell; 12 h have 10 TECU, 18 s 1e-3 m.
        np.testing.assert_allclose(np.diff(taken_m), np.diff(expected_m), atol=3e-3)
    assert np.ptp(expected_m) > 2.0


def test_files_of_several_days_are_taken_together_and_what_none_covers_is_refused(tmp_path: Path) -> None:
    before = ionex(tmp_path, lambda k: 20.0, ("2020 6 23 0 0 0", "2020 6 24 0 0 0"), "before.20i")
    there = ionex(tmp_path, lambda k: 20.0, DAY)
    np.testing.assert_array_equal(read(ionex=[before, there]).errors_m, read(ionex=there).errors_m)
    with pytest.raises(InputError, match=r"before\.20i: the maps do not cover the observations"):
        read(ionex=before)
    with pytest.raises(InputError, match="not of dual"):
        read(ionex=there, ionosphere="dual")
    with pytest.raises(InputError, match=r"mixed_3\.nav: it cannot be read as maps"):
        read(ionex=PAIR[1])
    with pytest.raises(InputError, match="there is no such file"):
        read(ionex=tmp_path / "no.20i")


def test_the_command_takes_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = ionex(tmp_path, lambda k: 20.0, DAY)
    options = ["--truth", TEXT, "--systems", "G", "--method", "ls", "--out", str(tmp_path / "out")]
    options += ["--ionex", str(path)]
    main(["observe", *map(str, PAIR), *options])
    assert "ionosphere by maps" in " ".join(capsys.readouterr().out.split())
