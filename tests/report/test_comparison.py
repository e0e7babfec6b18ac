"""Two runs side by side: what differs, with intervals that hold, and honest words where they are not paired."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import special
from stored_runs import DRAWS, counts, store_epochs, store_run

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.output import require_finished_alike
from pl_mc.experiments.reading import write_comparison
from pl_mc.input_errors import InputError
from pl_mc.report.comparison import NEWCOMBE, PAIRED, compare_runs
from pl_mc.report.run_folder import read_run_folder
from pl_mc.statistics.intervals import difference_bounds

FIRST = {"ls": (0, 130, 398, 400), "igg3": (0, 0, 0, 0)}
SECOND = {"ls": (0, 130, 398, 400), "igg3(k1=3)": (0, 20, 0, 0)}


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, Path]:
    """A run, and another with other options of the robust method, on the same noise."""
    options = [{"name": "ls"}, {"name": "igg3", "k1": 3.0}]
    return (
        store_run(tmp_path / "first", counts(FIRST), with_figure=False),
        store_run(
            tmp_path / "second", counts(SECOND, ("ls", "igg3(k1=3)")), with_figure=False, name="other", methods=options
        ),
    )


def test_fields_that_differ_are_named_and_rates_laid_side_by_side(runs: tuple[Path, Path]) -> None:
    found = compare_runs(*map(read_run_folder, runs))
    assert found.names == ("small", "other")
    assert found.fields.to_numpy().tolist() == [["methods.1.k1", "nothing", "3"]]
    # 2 methods x 4 biases x 9 events; the robust method in spite of its other name.
    assert len(found.rates) == 72
    assert any("igg3(k1=3) of the second run stands beside igg3 of the first" in note for note in found.notes)
    (row,) = found.rates[found.rates.differs].to_dict("records")
    assert (row["method"], row["event"], row["bias_m"]) == ("igg3", "alarm", 25.0)
    assert (row["first_count"], row["second_count"]) == (0, 20)
    assert row["difference"] == pytest.approx(20 / DRAWS)
    low, high = difference_bounds(0, DRAWS, 20, DRAWS)
    assert (row["low"], row["high"]) == (pytest.approx(float(low)), pytest.approx(float(high)))
    assert "1 of 72 rates differ" in found.text


def test_the_same_noise_without_epochs_has_no_paired_interval_and_says_so(runs: tuple[Path, Path]) -> None:
    found = compare_runs(*map(read_run_folder, runs))
    assert found.same_noise
    assert set(found.rates.interval) == {NEWCOMBE}
    assert any("a paired interval is not to be had" in note for note in found.notes)


def test_another_seed_is_other_noise(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    other = store_run(tmp_path / "seed", counts(FIRST), with_figure=False, name="seed", seed=6)
    found = compare_runs(read_run_folder(runs[0]), read_run_folder(other))
    assert not found.same_noise
    assert not found.rates.differs.any()
    assert any("not the same draw for draw" in note for note in found.notes)


def test_epochs_of_the_same_noise_are_paired(tmp_path: Path) -> None:
    """Forty epochs that all differ by about the same: the interval is Student's, far inside that of two "
    "proportions."""
    rng = np.random.default_rng(3)
    epochs, draws = 40, 10
    old = rng.integers(0, 9, epochs)
    new = old + rng.integers(0, 2, epochs)
    folders = []
    for name, each in (("one", old), ("two", new)):
        table = counts({"igg3": (int(each.sum()), 0, 0, 0)}, ("igg3",))
        assert table.draws[0] == epochs * draws
        folder = store_run(tmp_path / name, table, with_figure=False, name=name)
        store_epochs(folder, each, draws=draws)
        folders.append(folder)
    found = compare_runs(*map(read_run_folder, folders))
    row = found.rates[(found.rates.event == "alarm") & (found.rates.bias_m == 10.0)].iloc[0]
    difference = (new - old) / draws
    half = special.stdtrit(epochs - 1, 0.975) * difference.std(ddof=1) / np.sqrt(epochs)
    assert row.interval == PAIRED
    assert row.low == pytest.approx(difference.mean() - half)
    assert row.high == pytest.approx(difference.mean() + half)
    wide = difference_bounds(old.sum(), epochs * draws, new.sum(), epochs * draws)
    assert row.high - row.low < 0.5 * float(wide[1] - wide[0])
    # Nothing was ever seen of the other events: no scatter, no paired interval.
    assert (found.rates[found.rates.event == "missed"].interval == NEWCOMBE).all()
    assert any("1 of 36 intervals are those of the paired differences" in note for note in found.notes)


def test_rows_of_one_run_alone_are_counted(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    alone = counts(FIRST)
    other = store_run(tmp_path / "fewer", alone[alone.bias_m < 50], with_figure=False, name="fewer")
    found = compare_runs(read_run_folder(runs[0]), read_run_folder(other))
    assert any(note.startswith("rates: 2 rows of the first run") for note in found.notes)
    assert len(found.rates) == 54


def test_a_comparison_is_written_whole_and_replaces_itself_alone(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    made = write_comparison(*runs, tmp_path / "out")
    write_comparison(*runs, tmp_path / "out")
    assert sorted(path.name for path in made.folder.iterdir()) == ["compare.csv", "compare.html"]
    table = pd.read_csv(made.folder / "compare.csv", keep_default_na=False)
    assert len(table) == 72
    assert made.content()["rates"][0]["table"] == "rates"
    with pytest.raises(InputError, match="something other"):
        write_comparison(*runs, runs[0])
    assert (runs[0] / "rates.csv").is_file()


def test_charts_are_those_that_a_document_of_the_two_names(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    def drawn() -> list[list[str]]:
        text = (write_comparison(*runs, tmp_path / "out").folder / "compare.html").read_text()
        data = re.search(r'id="chart-data">(.*?)</script>', text)
        return [chart["curves"] for chart in json.loads(data[1])] if data else []

    both = [["ls (small)", "igg3 (small)", "ls (other)", "igg3(k1=3) (other)"]]
    assert drawn() == both
    # Of a version that stored none, what the other says is drawn; of two of them nothing is.
    (runs[0] / "report.json").unlink()
    assert drawn() == both
    (runs[1] / "report.json").unlink()
    assert drawn() == []


def test_runs_of_a_former_kind_are_runs_of_one_kind(tmp_path: Path) -> None:
    """A map of the version before, and the same as a view of a sweep of today."""
    ramp = {"start_m": 10.0, "stop_m": 55.0, "step_m": 15.0}
    folders = []
    for name, kind in (("before", {"kind": "map"}), ("now", {"kind": "sweep", "view": "map"})):
        folder = store_run(tmp_path / name, counts(FIRST), with_figure=False)
        manifest = json.loads((folder / "manifest.json").read_text())
        fields = {field: value for field, value in manifest["experiment"].items() if field not in ("kind", "view")}
        manifest["experiment"] = fields | kind | {"faults": ramp}
        (folder / "manifest.json").write_text(json.dumps(manifest))
        folders.append(folder)
    made = write_comparison(*folders, tmp_path / "out")
    assert made.comparison.fields.empty
    assert len(made.comparison.rates) == 72


def test_a_run_of_the_first_version_is_one_of_ten_iterations(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    """The same words then and now are two experiments: the fields are named, and no run is taken for the other."""
    before = store_run(tmp_path / "before", counts(FIRST), with_figure=False)
    assert write_comparison(runs[0], before, tmp_path / "same").comparison.fields.empty
    require_finished_alike(before, build_experiment(read_run_folder(before).experiment, source="test"))
    manifest = json.loads((before / "manifest.json").read_text())
    (before / "manifest.json").write_text(json.dumps(manifest | {"versions": {"python": "3", "pl_mc": "0.1.0"}}))
    fields = write_comparison(runs[0], before, tmp_path / "out").comparison.fields
    assert fields.iloc[0].tolist() == ["methods.1.iterations", "nothing", "10"]
    with pytest.raises(InputError, match=r"iterations.*10.* before"):
        require_finished_alike(before, build_experiment(manifest["experiment"], source="test"))


def test_runs_of_two_kinds_are_not_compared(tmp_path: Path, runs: tuple[Path, Path]) -> None:
    text = (runs[1] / "manifest.json").read_text().replace('"sweep"', '"variants"')
    (runs[1] / "manifest.json").write_text(text)
    with pytest.raises(InputError, match="only runs of one kind"):
        write_comparison(*runs, tmp_path / "out")
    assert not (tmp_path / "out").exists()
