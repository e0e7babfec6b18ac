"""Maps of the ionosphere whose delays are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pl_mc.cli.main import main
from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverSeries, read_receiver_series, read_truth

FILES = Path(__file__).parent / "files"
PAIR = FILES / "mixed_3.obs", FILES / "mixed_3.nav"
TEXT = "4075580.8863,931853.5784,4801567.9707"
L1_HZ = 1575.42e6


def ionex(folder: Path, content_tecu: Callable[[int], float], days: tuple[str, ...], name: str = "a.20i") -> Path:
    """Maps of one content everywhere, half a day apart, in a layer at 450 km with the mapping 1 / cos z."""

    def line(body: str, label: str) -> str:
        return f"{body:<60}{label}"

    def date(text: str) -> str:
        return "".join(f"{int(part):6d}" for part in text.split())

    lines = [
        line("     1.0            IONOSPHERE MAPS     GPS", "IONEX VERSION / TYPE"),
        line("made", "PGM / RUN BY / DATE"),
        line(date(days[0]), "EPOCH OF FIRST MAP"), line(date(days[-1]), "EPOCH OF LAST MAP"),
        line(f"{43200:6d}", "INTERVAL"), line(f"{len(days):6d}", "# OF MAPS IN FILE"),
        line("  COSZ", "MAPPING FUNCTION"),
        line(f"{0.0:8.1f}", "ELEVATION CUTOFF"), line("", "OBSERVABLES USED"), line(f"{6371.0:8.1f}", "BASE RADIUS"),
        line(f"{2:6d}", "MAP DIMENSION"), line(f"  {450.0:6.1f}{450.0:6.1f}{0.0:6.1f}", "HGT1 / HGT2 / DHGT"),
        line(f"  {87.5:6.1f}{-87.5:6.1f}{-2.5:6.1f}", "LAT1 / LAT2 / DLAT"),
        line(f"  {-180.0:6.1f}{180.0:6.1f}{5.0:6.1f}", "LON1 / LON2 / DLON"), line(f"{-1:6d}", "EXPONENT"),
        line("", "END OF HEADER"),
    ]  # fmt: skip
    for k, day in enumerate(days):
        lines += [line(f"{k + 1:6d}", "START OF TEC MAP"), line(date(day), "EPOCH OF CURRENT MAP")]
        for latitude in np.arange(87.5, -87.6, -2.5):
            lines.append(
                line(f"  {latitude:6.1f}{-180.0:6.1f}{180.0:6.1f}{5.0:6.1f}{450.0:6.1f}", "LAT/LON1/LON2/DLON/H")
            )
            row = [round(10 * content_tecu(k))] * 73
            lines += ["".join(f"{one:5d}" for one in row[at : at + 16]) for at in range(0, 73, 16)]
        lines.append(line(f"{k + 1:6d}", "END OF TEC MAP"))
    path = folder / name
    path.write_text("\n".join([*lines, line("", "END OF FILE")]) + "\n")
    return path


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
