"""Integrity support messages in experiment files: as a CSV file and as a table, checked, hashed, and run again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas as pd
import pytest

import pl_mc
from pl_mc.araim import Ism
from pl_mc.cli.main import main
from pl_mc.engine import Execution
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.methods.araim import Araim
from pl_mc.studies.file_fields import named_files

ISM = """satellite,sigma_ura_m,sigma_ure_m,b_nom_m,p_sat,p_const
G,1.0,0.66,0.75,1e-5,1e-8
E,1.0,0.66,0.75,1e-5,1e-4
E01,2.5,1.5,1.0,3e-5,
"""
EXPERIMENT = """kind = "sweep"
title = "an ISM"
draws = 256
seed = 5
alert = {vertical_m = 12}

[geometry]
site = "CUT0"
start = "2017-11-15T00:00:00"
epochs = 1
epoch = 0
mask_deg = 5
constellations = "ADD-24+24"
error_model = "dual_frequency"
error_options = {ism = "ism.csv"}

[[faults.biases]]
G18 = 15.0

[[methods]]
name = "araim"
ism = "ism.csv"

[[methods]]
name = "araim"
ism = {name = "table", b_nom_m = 0.5, p_const = {G = 1e-8, E = 1e-4}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("ism.csv").write_text(ISM)
    Path("one.toml").write_text(EXPERIMENT)
    return tmp_path


@pytest.mark.usefixtures("without_figures")
def test_a_file_and_a_table(folder: Path) -> None:
    """The rates of `pl_mc.sweep` with the same ISM; the manifest has the file's hash and redoes the run."""
    assert main(("run", "one.toml", "-q")) is None
    main(("run", "runs/one/manifest.json", "-q", "--out", "again"))
    model = pl_mc.error_model("dual_frequency", ism="ism.csv")
    g = pl_mc.simulate(
        site="CUT0", start="2017-11-15", epochs=1, mask_deg=5.0, constellations="ADD-24+24", error_model=model
    )[0]
    table = Ism(name="table", b_nom_m=0.5, p_const={"G": 1e-8, "E": 1e-4})
    expected = pl_mc.sweep(
        g, pl_mc.biases(g, {"G18": 15.0}), draws=256, seed=5, methods=(Araim(ism="ism.csv"), Araim(ism=table)),
        alert=pl_mc.AlertLimits("own", vertical_m=12.0),
    )  # fmt: skip
    for run in ("runs/one", "again"):
        found = pd.read_csv(Path(run, "rates.csv"))
        assert found.method.tolist() == ["araim(ism=ism.csv)", "araim(ism=table)"]
        assert found.alarms.tolist() == expected.alarms.tolist()
    assert 0 < expected.alarms.iloc[0] <= 256
    inputs = json.loads(Path("runs/one/manifest.json").read_text())["inputs"]
    assert set(inputs) == {"geometry.error_options.ism", "methods.0.ism"}
    assert len({file["sha256"] for file in inputs.values()}) == 1


def test_files_are_found_wherever_they_stand() -> None:
    content = {"methods": [{"name": "araim", "ism": "a.csv"}, {"ism": {"p_sat": 1e-5}}], "budgets": [{"ism": "b.csv"}]}
    assert named_files(content) == {"methods.0.ism": Path("a.csv"), "budgets.0.ism": Path("b.csv")}


@pytest.mark.parametrize(
    ("file", "text", "line", "words"),
    [
        (ISM + "G99,1,1,1,1e-5,\n", EXPERIMENT, 20, "ism.csv: line 5: satellite: 'G99' is neither"),
        (ISM.replace("E,1.0", "E,-1.0"), EXPERIMENT, 14, "ism.csv: line 3: sigma_ura_m: -1.0 cannot be used"),
        (ISM.replace("E,", "R,").replace("E01,", "R01,"), EXPERIMENT, 7, "no value for E.. or for its constellation E"),
        (ISM, EXPERIMENT.replace('ism = "ism.csv"\n', 'ism = "other.csv"\n'), 20, "other.csv: there is no such file"),
        (ISM, EXPERIMENT.replace("b_nom_m = 0.5", "b_nom = 0.5"), 24, "the field 'b_nom' is unknown .nearest: b_nom_m"),
        (ISM, EXPERIMENT.replace("b_nom_m = 0.5", "b_nom_m = -0.5"), 24, "b_nom_m: -0.5 cannot be used; .*nearest: 0"),
        (
            ISM,
            EXPERIMENT.replace('error_options = {ism = "ism.csv"}\n', ""),
            19,
            "sigma_ura_m: .* is more than its sigma in the geometry",
        ),
    ],
)
def test_what_check_says(folder: Path, file: str, text: str, line: int, words: str) -> None:
    """Each problem with its field and line, and the same as one sentence where it is run."""
    Path("ism.csv").write_text(file)
    Path("one.toml").write_text(text)
    found = check_experiment("one.toml")
    assert re.search(words, found.text()), found.text()
    assert line in {problem.line for problem in found.problems}
    assert len({(problem.line, problem.reason) for problem in found.problems}) == len(found.problems) <= 2
    with pytest.raises(pl_mc.InputError, match=words):
        run_experiment("one", load_experiment("one.toml")[1], Path("out"), execution=Execution(progress=False))
    assert not Path("out").exists()
