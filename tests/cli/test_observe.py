"""`pl-mc observe` on real receiver days, and what it refuses."""

from __future__ import annotations

import copy
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.dates as mdates
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pl_mc.alert import LPV_200, Judged
from pl_mc.cli.main import main
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import build_experiment
from pl_mc.receiver import rinex
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.observe import STUDY
from pl_mc.studies.observe.figures import error_figure

ESBC_TRUTH = "3582104.8991,532590.1966,5232755.2961"


@pytest.fixture(scope="module", autouse=True)
def read_once() -> Iterator[None]:
    """A day of a real receiver is read once with the same options, which takes a second: tests/receiver is about it."""
    read, known = rinex._read_one, {}

    def once(observation_path: Any, *others: Any, **options: Any) -> Any:
        # Files that a test writes are others under the same name.
        if not str(observation_path).startswith(os.environ.get("PL_MC_DATA", "\0")):
            return read(observation_path, *others, **options)
        key = repr((observation_path, others, options))
        if key not in known:
            known[key] = read(observation_path, *others, **options)
        return copy.deepcopy(known[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rinex, "_read_one", once)
        yield


@pytest.fixture
def esbjerg(data_folder: Path) -> tuple[str, str]:
    """Observation and navigation file of the static day."""
    name = "ESBC00DNK_R_20201770000_01D"
    return str(data_folder / f"{name}_30S_GC.rnx.gz"), str(data_folder / f"{name}_GC_nav.rnx.gz")


# 95 % of |E|, |N|, |U| [m] of single-point solutions with the same error model, from the README of the data.
@pytest.mark.parametrize(
    ("systems", "expected_m"), [("G,C", (0.99, 1.36, 1.76)), ("G", (1.46, 2.39, 2.97)), ("C", (0.68, 1.58, 2.34))]
)
@pytest.mark.usefixtures("without_figures")
def test_accuracy_on_the_static_day(
    tmp_path: Path, esbjerg: tuple[str, str], systems: str, expected_m: tuple[float, float, float]
) -> None:
    main(["observe", *esbjerg, "--truth", ESBC_TRUTH, "--systems", systems, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert list(table.columns) == [
        "epoch", "time", "method", "satellites", "east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available",
        "alarm", "unconverged", "tied", "faulted",
    ]  # fmt: skip
    ls = table[table.method == "ls"]
    assert len(ls) == 2880
    for column, expected in zip(("east_m", "north_m", "up_m"), expected_m, strict=True):
        assert ls[column].abs().quantile(0.95) == pytest.approx(expected, rel=0.15)


def test_two_faulted_satellites_alarm_least_squares_and_not_the_robust_level(
    tmp_path: Path, esbjerg: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    # G15 and G17 stand above 30 degrees throughout these epochs.
    faults = [word for name in ("G15", "G17") for word in ("--fault", f"{name}:+30m:400-499")]
    main(["observe", *esbjerg, "--truth", ESBC_TRUTH, *faults, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    faulted = table[table.faulted]
    assert sorted(faulted.epoch.unique()) == list(range(400, 500))
    assert faulted[faulted.method == "ls"].alarm.mean() >= 0.95
    assert faulted[faulted.method == "igg3"].alarm.mean() <= 0.05
    assert "with injected fault" in capsys.readouterr().out
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["experiment"]["faults"] == ["G15:+30m:400-499", "G17:+30m:400-499"]
    assert len(manifest["inputs"]["observations"]["sha256"]) == 64
    stored = read_run_folder(tmp_path / "out")
    assert set(stored.tables) == {"epochs", "course", "stanford"}
    assert stored.document is not None
    assert stored.document.answer == STUDY.answer({"epochs": table}, build_experiment(stored.experiment, source=""))


@pytest.mark.usefixtures("without_figures")
def test_the_car_data_run(tmp_path: Path, data_folder: Path) -> None:
    files = ("CARD00ESP_R_20203341240_20M_01S_GC.rnx.gz", "CARD00ESP_R_20203340900_15H_GC_nav.rnx.gz")
    track = str(data_folder / "CARD_own_ppk.csv.gz")
    main(["observe", *(str(data_folder / f) for f in files), "--truth", track, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    ls = table[table.method == "ls"]
    assert len(ls) == 1201
    # The reference itself is good to a few metres; its README gives 95 % of 6.8, 9.4, 12.1 m with other weights.
    for column, expected in (("east_m", 6.8), ("north_m", 9.4), ("up_m", 12.1)):
        assert ls[column].abs().quantile(0.95) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fault", "G99:+30m:400-499"], "G99"),
        (["--fault", "G15:+30m:400-4990"], "0 to 2879"),
        (["--fault", "G15:+30m:499-400"], "400"),
        (["--fault", "G02:+30m:400-410"], "out of view"),
        (["--systems", "G,E"], "E"),
        (["--systems", "Q"], "Q"),
        (["--systems", "GC"], "the form is G,C on the command line"),
        (["--ionosphere", "klobuchar"], "'broadcast', 'none' or 'dual'"),
        (["--method", "ls2"], "nearest: ls"),
    ],
)
def test_what_observe_refuses(
    tmp_path: Path, esbjerg: tuple[str, str], capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["observe", *esbjerg, "--truth", ESBC_TRUTH, *options, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


RECEIVER_FILES = Path(__file__).parents[1] / "receiver" / "files"
TRUTH, TRUTH_2 = "4075580.8863,931853.5784,4801567.9707", "-3976219.5082,3382372.5671,3652512.9849"


def small(name: str = "mixed_3") -> tuple[str, str]:
    """Two epochs of a permanent station."""
    ends = ("05o", "05n") if name == "gps_2" else ("obs", "nav")
    return str(RECEIVER_FILES / f"{name}.{ends[0]}"), str(RECEIVER_FILES / f"{name}.{ends[1]}")


@pytest.mark.parametrize("form", [["--truth", TRUTH_2], [f"--truth={TRUTH_2}"]])
@pytest.mark.usefixtures("without_figures")
def test_a_truth_may_begin_with_a_minus(form: list[str], tmp_path: Path) -> None:
    main(["observe", *small("gps_2"), *form, "--systems", "G", "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert table.up_m.abs().max() < 0.5


@pytest.mark.parametrize("form", [["--mask-deg", "-1"], ["--mask-deg=-1"]])
def test_a_mask_below_the_horizon_reaches_its_own_rule(
    form: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["observe", *small(), "--truth", TRUTH, *form, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert "mask_deg: input should be greater than or equal to 0, not -1.0" in capsys.readouterr().err


@pytest.mark.usefixtures("without_figures")
def test_several_navigation_files_and_no_ionosphere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    observations, navigation = small()
    text = Path(navigation).read_text()
    bare = tmp_path / "bare.nav"
    bare.write_text("".join(line for line in text.splitlines(keepends=True) if "IONOSPHERIC" not in line))
    ups = []
    for files, options in (([navigation], []), ([str(bare), navigation], []), ([str(bare)], ["--ionosphere", "none"])):
        main(["observe", observations, *files, "--truth", TRUTH, *options, "--out", str(tmp_path / "out")])
        ups.append(pd.read_parquet(tmp_path / "out" / "epochs.parquet").up_m.abs().max())
        manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
        assert ("navigation 2" in manifest["inputs"]) == (len(files) == 2)
    assert ups[0] == ups[1] < 0.4
    assert ups[2] > 3.0
    assert "The ionosphere's delay is left in" in capsys.readouterr().out
    main(["run", str(tmp_path / "out" / "manifest.json"), "--out", str(tmp_path / "again")])
    assert pd.read_parquet(tmp_path / "again" / "epochs.parquet").up_m.abs().max() == ups[2]
    with pytest.raises(SystemExit) as stop:
        main(["observe", observations, str(bare), "--truth", TRUTH, "--out", str(tmp_path / "no")])
    assert stop.value.code == 2
    assert "--ionosphere none" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.usefixtures("without_figures")
def test_systems_signals_carriers_and_methods_with_options(
    tmp_path: Path, data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = "KMS300DNK_R_20221591000_01H_30S_MO.crx", "KMS300DNK_R_20221591000_01H_MN.rnx.gz"
    files = [str(data_folder / name) for name in names]
    options = ["--truth", "3516213.4380,781859.8595,5246037.9660", "--systems", "G,E", "--mask", "15"]
    options += ["--ionosphere", "dual", "--signals", "E1+E5b", "--method", "igg3(k0=2, k1=6)", "--method", "ls"]
    main(["observe", *files, *options, "--out", str(tmp_path / "out")])
    said = " ".join(capsys.readouterr().out.split())
    assert "GPS L1 P(Y) + L2 P(Y), Galileo E1 + E5b, ionosphere dual, mask 15 deg" in said
    record = json.loads((tmp_path / "out" / "manifest.json").read_text())["experiment"]
    assert record["signals"] == ["E1+E5b"]
    assert record["methods"][0]["k0"] == 2
    main(["run", str(tmp_path / "out" / "manifest.json"), "--out", str(tmp_path / "again")])
    one, other = (pd.read_csv(tmp_path / name / "epochs.csv") for name in ("out", "again"))
    pd.testing.assert_frame_equal(one, other)
    # Two carriers are noisier, which their levels say.
    main(["observe", *files, *options[:6], "--out", str(tmp_path / "single")])
    single = pd.read_csv(tmp_path / "single" / "epochs.csv")
    assert one[one.method == "ls"].vpl_m.median() > 1.1 * single[single.method == "ls"].vpl_m.median()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--signals", "L9"], "signals: 'L9' is not read of"),
        (["--signals", "L1+L2"], "two with the ionosphere dual"),
        (["--signals", "L1+L2", "--ionosphere", "dual"], "holds no pseudorange of GPS L1 C/A + L2 P(Y); it has C1C"),
        (["--method", "igg3(k0=2"], "the form igg3(k0=2, k1=6) is needed"),
        (["--method", "igg3(k9=2)"], "k9"),
        (["--method", "igg3(name='ls')"], "no option of that name"),
    ],
)
def test_signals_and_options_that_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["observe", *small(), "--truth", TRUTH, "--systems", "G", *options, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert words in " ".join(said.split())
    assert len(said.strip().splitlines()) == 1


def test_no_solution_is_exit_2_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    observations, navigation = small()
    lines = Path(navigation).read_text().splitlines(keepends=True)
    end = next(k for k, line in enumerate(lines) if "END OF HEADER" in line) + 1
    records = [lines[k : k + 8] for k in range(end, len(lines), 8)]
    two = {record[0][:3]: record for record in reversed(records) if record[0][:3] in ("G07", "G13")}
    (tmp_path / "two.nav").write_text("".join([*lines[:end], *two["G07"], *two["G13"]]))
    with pytest.raises(SystemExit) as stop:
        main(["observe", observations, str(tmp_path / "two.nav"), "--truth", TRUTH, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "no epoch has a solution; at best 2 of the 4 satellites that are needed are in view (epoch 0)" in said
    assert "left out for want of a usable ephemeris" in said
    assert "GPS alone is used" in said
    assert not (tmp_path / "out").exists()


def test_a_truth_elsewhere_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["observe", *small(), "--truth", "4075780.8863,931853.5784,4801767.9707", "--out", str(tmp_path / "out")])
    assert "the pseudoranges fit a position 282 m from the true position that was given" in capsys.readouterr().out


def drawn(count: int, step_s: float, largest_m: float) -> Figure:
    """The figure of epochs with errors of a metre, a gap, two faulted windows and one level that is large."""
    epochs = np.repeat(np.arange(count), 2)
    seconds = epochs * step_s + np.where(epochs >= count // 2, 10 * step_s, 0.0)
    table = pd.DataFrame({
        "epoch": epochs, "time": pd.Timestamp("2020-06-25") + pd.to_timedelta(seconds, unit="s"),
        "method": ["ls", "igg3"] * count, "faulted": np.isin(epochs, (3, 4, 7)), "vpl_m": 5.0,
        **{column: np.sin(epochs) for column in ("east_m", "north_m", "up_m")},
    })  # fmt: skip
    table.loc[2, "vpl_m"] = largest_m
    return error_figure(table, judged=Judged(LPV_200), title="A title of some length about a station")


@pytest.mark.parametrize(
    ("count", "step_s", "largest_m"), [(4, 1.0, 6.0), (10, 30.0, 6.0), (200, 30.0, 90.0), (200, 900.0, 2e4)]
)
def test_the_figure_shows_all_levels_over_time_with_the_legend_apart(
    count: int, step_s: float, largest_m: float
) -> None:
    figure = drawn(count, step_s, largest_m)
    figure.draw_without_rendering()
    axes = figure.axes
    assert "2020-06-25" in axes[3].get_xlabel()
    assert "GPS time" in axes[3].get_xlabel()
    labels = [tick.get_text() for tick in axes[3].get_xticklabels() if tick.get_text()]
    assert labels
    assert all(":" in label or "-" in label for label in labels)
    low, high = axes[3].get_ylim()
    assert low <= 5.0
    assert high > max(largest_m, 35.0)
    assert axes[3].get_yscale() == ("log" if largest_m > 140 else "linear")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    others = [axis.get_tightbbox() for axis in axes] + [figure.texts[0].get_window_extent()]
    assert not any(box.overlaps(other) for other in others)
    assert {text.get_text() for text in legend.get_texts()} == {
        "faulted epochs", "least squares (VPL)", "IGG-III (VPL_R)",
    }  # fmt: skip
    # Two parts of each line, none across the gap.
    for line in axes[0].get_lines():
        assert np.diff(mdates.date2num(line.get_xdata())).max() * 86_400 == pytest.approx(step_s, abs=1e-3)


def test_a_missing_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = str(tmp_path / "no.rnx")
    with pytest.raises(SystemExit) as stop:
        main(["observe", missing, missing, "--truth", ESBC_TRUTH, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert missing in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_check_names_every_missing_file_by_its_field(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    fields = {**STUDY.outline, "observations": "observations.rnx", "navigation": "navigation.rnx"}
    path.write_text("".join(f"{field} = {json.dumps(value)}\n" for field, value in fields.items()))
    problems = check_experiment(str(path)).problems
    assert [(problem.field, problem.line, problem.reason) for problem in problems] == [
        (name, line, f"{name}.rnx: there is no such file.") for line, name in ((3, "observations"), (4, "navigation"))
    ]


@pytest.mark.usefixtures("without_figures")
def test_faults_of_a_receiver_in_time_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ups, texts = [], ("none", "G07:+30m:1-1", "G:+50m", "G07+G13:+-20m", "G07:+1m/s")
    for text in texts:
        main(["observe", *small(), "--truth", TRUTH, "--fault", text, "--method", "ls", "--out", str(tmp_path / "out")])
        table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
        ups.append(table.up_m.to_numpy())
        assert table.faulted.tolist() == [text not in ("none", "G07:+30m:1-1"), text != "none"]
        assert f"Injected: {text}" in capsys.readouterr().out.replace("Injected: G07:+1m/s", "Injected: G07:+1m/s")
    free, window, system, drawn, ramp = ups
    assert window[0] == free[0]
    assert abs(window[1] - free[1]) > 1.0
    # A clock error, and nothing else.
    np.testing.assert_allclose(system, free, atol=1e-6)
    assert (np.abs(drawn - free) > 0.1).all()
    assert ramp[0] == free[0]
    assert abs(ramp[1] - free[1]) > 0.1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G07:+0m", "faults.0: bias of G07: a bias of size zero is no fault"), ("G07", "faults.0: 'G07' is no fault"),
        ("E:+3m", "'E' is not in view"), ("G07:+3m:1-9", "fault G07:+3m:1-9: epochs run from 0 to 1."),
    ],
)  # fmt: skip
def test_what_is_no_fault_of_a_receiver(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["observe", *small(), "--truth", TRUTH, "--fault", text, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "axis", "present", "absent"),
    [
        (("--hal", "10"), "horizontal", ("HAL 10", "H beyond HPL", "Horizontal errors:"), "VAL|VPL_R|U bey|Vertical"),
        (("--val", "15", "--hal", "10", "--axes", "either"), "either",
         ("VAL 15.00 m, HAL 10", "U beyond VPL or H beyond HPL", "Vertical errors:", "Horizontal errors:"), "VPL_R"),
        (("--val", "15", "--hal", "10"), None, ("VAL 15", "U beyond VPL", "HAL|is not judged"), "H beyond"),
    ],
)  # fmt: skip
def test_the_limits_of_an_observation(
    options: tuple[str, ...], axis: str | None, present: tuple[str, ...], absent: str, tmp_path: Path
) -> None:
    main(["observe", *small(), "--truth", TRUTH, *options, "-q", "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    beyond = {"horizontal": table.hpl_m > 10.0, "either": (table.hpl_m > 10.0) | (table.vpl_m > 15.0)}
    if axis is None:
        assert "axis" not in table
        assert (table.alarm == (~table.available | (table.vpl_m > 15.0))).all()
    else:
        assert set(table.axis) == {axis}
        assert (table.alarm == (~table.available | beyond[axis])).all()
    run = read_run_folder(tmp_path / "out")
    assert run.document is not None
    said = run.summary + " ".join(run.document.answer) + " ".join(figure.alt for figure in run.document.figures)
    for words in present:
        assert re.search(words, said), words
    assert not re.search(absent, said)
