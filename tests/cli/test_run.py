"""The command line as a user meets it: what a run leaves behind, and what bad input gets."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pl_mc.cli.main import main
from pl_mc.engine import checkpoint_store, plan, task
from pl_mc.engine.calls import Chunk
from pl_mc.experiments import running
from pl_mc.report.findings import Findings
from pl_mc.studies import sweep
from reference.damage import FORGED_ROWS, forged

SMALL = """
kind = "sweep"
title = "A small ramp"
draws = 300
seed = 5
[geometry]
epochs = 4
epoch = 2
[faults]
satellite = "G02"
otherwise = "median_redundancy"
start_m = 10
stop_m = 40
step_m = 15
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder with a small experiment file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The sentence on standard error of a command that must end with exit code 2 and nothing on standard output."""
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pl-mc: ")
    assert "Traceback" not in err
    return err


def test_a_run_leaves_tables_figures_summary_and_manifest(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["run", "small.toml"])
    results = folder / "runs" / "small"
    files = {path.name for path in results.iterdir()}
    assert files == {
        "assumptions.md", "exact.csv", "levels.csv", "manifest.json", "rates.csv", "rates.png", "rates.svg",
        "report.html", "report.json", "summary.md",
    }  # fmt: skip
    rates = pd.read_csv(results / "rates.csv")
    assert list(rates.method.unique()) == ["ls", "igg3"]
    assert list(rates.bias_m.unique()) == [10.0, 25.0, 40.0]
    assert (rates.draws == 300).all()
    out = capsys.readouterr().out
    assert "A small ramp" in out
    # The folder is the last thing that is said.
    assert out.splitlines()[-1] == "Results: runs/small, report: runs/small/report.html"
    page = (results / "report.html").read_text()
    assert "<h1>A small ramp</h1>" in page
    assert "noise draws for each fault at each epoch" in page
    assert "pl-mc run runs/small/manifest.json" in page
    # Nothing but the results remains beside them.
    assert [path.name for path in (folder / "runs").iterdir()] == ["small"]


@pytest.mark.drawn
def test_the_manifest_redoes_the_run_to_the_byte(folder: Path) -> None:
    main(["run", "small.toml", "--out", "first", "--draws", "150", "--seed", "9"])
    manifest = json.loads((folder / "first" / "manifest.json").read_text())
    assert manifest["experiment"]["draws"] == 150
    assert manifest["experiment"]["seed"] == 9
    assert {"pl_mc", "jax", "jaxlib", "numpy"} <= set(manifest["versions"])
    main(["run", "first/manifest.json", "--out", "second"])
    for name in ("rates.csv", "exact.csv", "levels.csv", "rates.svg", "summary.md", "report.json"):
        assert (folder / "first" / name).read_bytes() == (folder / "second" / name).read_bytes(), name


def test_an_earlier_result_is_replaced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["run", "small.toml", "--out", "here", "--draws", "10", "--quiet"])
    assert capsys.readouterr().out == "here\n"
    main(["run", "small.toml", "--out", "here", "--draws", "20", "--json"])
    content = json.loads(capsys.readouterr().out)
    assert (content["folder"], content["report"], len(content["answer"])) == ("here", "report.html", 3)
    assert content["tables"] == ["exact.csv", "levels.csv", "rates.csv"]
    assert content["notes"][0].startswith("Faulted satellite: ")
    assert (pd.read_csv(folder / "here" / "rates.csv").draws == 20).all()
    assert not [path for path in folder.iterdir() if path.name.startswith(".here")]


def test_the_packaged_experiments_are_listed_and_sound(capsys: pytest.CaptureFixture[str]) -> None:
    main(["list", "--quiet"])
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split()[0] == "ramp" for line in lines)
    # Listing builds every record, so each file is valid.
    shipped = Path(__file__).parents[2] / "experiments"
    assert len(lines) == len(list(shipped.glob("*.toml")))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("draws = 300", "drows = 300"), ("drows", "nearest: draws", "draws: field required")),
        (("draws = 300", "draws = 0"), ("draws", "greater than or equal to 1")),
        (("epochs = 4", "epoch_s = 4"), ("geometry.epoch_s", "nearest: epoch")),
        (("epoch = 2", "mask_deg = 95"), ("geometry.mask_deg", "95")),
        (("epoch = 2", "epoch = 7"), ("epoch index 7", "0 to 3")),
        (("epoch = 2", 'constellations = ["GPSS"]'), ("GPSS", "nearest: GPS")),
        (("epoch = 2", 'error_model = "residuals"'), ("residuals", "nearest: residual")),
        (("epoch = 2", 'site = "CUTO"'), ("CUTO", "CUT0")),
        (('otherwise = "median_redundancy"', ""), ("G02", "nearest: ")),
        (("step_m = 15", "step_m = -15"), ("ramp", "step")),
        (("seed = 5", 'alert = "LPV200"'), ("LPV200", "nearest: LPV-200")),
        (("seed = 5", 'methods = [{name = "ig3"}]'), ("ig3", "nearest: igg3")),
        (("seed = 5", 'methods = [{name = "igg3", k_1 = 4}]'), ("k_1", "nearest: k1")),
        (("seed = 5", 'methods = [{name = "igg3", k1 = 1.0}]'), ("k0 < k1",)),
        (('kind = "sweep"', 'kind = "sweap"'), ("sweap", "nearest: sweep")),
        (('title = "A small ramp"', "title = "), ("not TOML", "line 3")),
    ],
)  # fmt: skip
def test_a_wrong_experiment_is_refused_in_words(
    folder: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: tuple[str, ...]
) -> None:
    assert change[0] in SMALL
    (folder / "small.toml").write_text(SMALL.replace(*change))
    sentence = refused(capsys, "run", "small.toml")
    for word in words:
        assert word in sentence
    assert not (folder / "runs" / "small").exists()


def test_an_unknown_experiment_names_the_nearest(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nearest: ramp" in refused(capsys, "run", "rampe")
    assert "no such file" in refused(capsys, "run", "missing.toml")
    assert "no manifest" in _refused_json(folder, capsys)


def _refused_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    (folder / "other.json").write_text("[1, 2]")
    return refused(capsys, "run", "other.json")


def test_an_unknown_option_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--draws" in refused(capsys, "run", "small.toml", "--drows", "3")
    assert "abc" in refused(capsys, "run", "small.toml", "--draws", "abc")
    assert "run" in refused(capsys, "rum")


def test_a_place_that_cannot_hold_results_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "file").write_text("text")
    assert "a file of that name" in refused(capsys, "run", "small.toml", "--out", "file")
    assert "cannot be written" in refused(capsys, "run", "small.toml", "--out", "file/inside")
    (folder / "mine").mkdir()
    (folder / "mine" / "thesis.tex").write_text("text")
    assert "something other" in refused(capsys, "run", "small.toml", "--out", "mine")
    assert (folder / "mine" / "thesis.tex").read_text() == "text"


@pytest.mark.parametrize("where", ["computing", "writing"])
def test_an_interrupted_run_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    def half_way(experiment: object, execution: object) -> Findings:
        if where == "computing":
            raise KeyboardInterrupt
        return Findings((), ())

    def half_of_a_file(findings: Findings, working: Path, **_: object) -> None:
        (working / "rates.csv").write_text("half")
        raise KeyboardInterrupt

    study = replace(sweep.STUDY, run=half_way, answer=lambda tables, experiment: ())
    monkeypatch.setattr(sweep, "STUDY", study)
    monkeypatch.setattr(running, "write_findings", half_of_a_file)
    with pytest.raises(SystemExit) as stop:
        main(["run", "small.toml"])
    assert stop.value.code == 130
    assert "nothing was written" in capsys.readouterr().err
    assert list((folder / "runs").iterdir()) == []


def test_a_stopped_run_goes_on_where_it_was(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C after the second of the parts; what the resumed run counts is what was missing."""
    # One block of noise for a call: 3,000 draws of 3 faults are 12 calls.
    monkeypatch.setattr(plan, "SCENARIOS_PER_CALL", 1)
    monkeypatch.setattr(plan, "CALLS_PER_PART", 3)
    main(["run", "small.toml", "--draws", "3000", "--out", "whole"])
    counted: list[int] = []
    count = task.SweepTask.count

    def stop_after_two_parts(self: task.SweepTask, chunk: Chunk, *noise: np.int32, devices: int = 1) -> object:
        if len(counted) == 8:
            raise KeyboardInterrupt
        counted.append(chunk.first_block)
        return count(self, chunk, *noise, devices=devices)

    monkeypatch.setattr(task.SweepTask, "count", stop_after_two_parts)
    with pytest.raises(SystemExit) as stop:
        main(["run", "small.toml", "--draws", "3000", "--out", "again", "--workers", "1"])
    assert stop.value.code == 130
    assert "2 finished parts are kept in again.unfinished, --resume goes on" in capsys.readouterr().err
    assert not (folder / "again").exists()

    assert "--resume goes on with it, --fresh starts anew" in refused(
        capsys, "run", "small.toml", "--draws", "3000", "--out", "again"
    )
    assert "draws: 3000 before, 300 now" in refused(capsys, "run", "small.toml", "--out", "again", "--resume")
    counted.clear()
    counted.append(-1)
    main(["run", "small.toml", "--draws", "3000", "--out", "again", "--resume", "--workers", "1"])
    assert counted == [-1, *range(6, 12)]
    assert not (folder / "again.unfinished").exists()
    for table in ("rates.csv", "levels.csv", "exact.csv"):
        assert (folder / "again" / table).read_text() == (folder / "whole" / table).read_text()


def test_shares_are_merged(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "SCENARIOS_PER_CALL", 1)
    monkeypatch.setattr(plan, "CALLS_PER_PART", 3)
    main(["run", "small.toml", "--draws", "3000", "--out", "whole"])
    main(["run", "small.toml", "--draws", "3000", "--out", "first", "--shard", "1/3"])
    assert "Shard 1 of 3: 2 parts are finished" in capsys.readouterr().out
    main(["run", "small.toml", "--draws", "3000", "--out", "others", "--shard", "2/3"])
    capsys.readouterr()
    assert "part 2 of 4" in refused(capsys, "merge", "first", "others", "--out", "merged")
    main(["run", "small.toml", "--draws", "3000", "--out", "others", "--shard", "3/3"])
    main(["merge", "first", "others.unfinished", "--out", "merged"])
    assert (folder / "merged" / "rates.csv").read_text() == (folder / "whole" / "rates.csv").read_text()
    capsys.readouterr()
    assert "it holds no parts of a share (a finished run)" in refused(capsys, "merge", "whole", "--out", "merged")
    main(["run", "small.toml", "--draws", "301", "--out", "strange", "--shard", "1/2"])
    capsys.readouterr()
    assert "another experiment" in refused(capsys, "merge", "first", "strange", "--out", "merged")
    # What a link points to is no part of a share.
    secret, part = Path("secret").absolute(), next(Path("first.unfinished").rglob("*.parquet"))
    secret.write_text("not of this run")
    part.with_name("part-000009.parquet").symlink_to(secret)
    assert "it is a link; the parts of a share are" in refused(capsys, "merge", "first", "others", "--out", "linked")
    assert not any(path.read_bytes() == secret.read_bytes() for path in Path().rglob("linked*/**/*.parquet"))


def test_a_merge_that_was_refused_is_none_when_its_shares_are_mended(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it had gathered, with a checksum that is right, had stood before what was counted again."""
    monkeypatch.setattr(plan, "SCENARIOS_PER_CALL", 1)
    monkeypatch.setattr(plan, "CALLS_PER_PART", 3)
    main(["run", "small.toml", "--draws", "3000", "--out", "whole"])
    main(["run", "small.toml", "--draws", "3000", "--out", "share", "--shard", "1/1"])
    part = sorted(Path("share.unfinished").rglob("*.parquet"))[1]
    sound = part.read_bytes()
    part.write_bytes(forged(sound, FORGED_ROWS["more draws"]))
    capsys.readouterr()
    assert "part 1 of 4 (counted from 0) is damaged" in refused(capsys, "merge", "share", "--out", "merged")
    part.write_bytes(sound)
    # Nor are they gathered among the parts of something else.
    main(["run", "small.toml", "--draws", "301", "--out", "strange", "--shard", "1/2"])
    before = {path: path.read_bytes() for path in Path("strange.unfinished").rglob("*.*")}
    capsys.readouterr()
    assert "--out names another folder" in refused(capsys, "merge", "share", "--out", "strange")
    assert {path: path.read_bytes() for path in Path("strange.unfinished").rglob("*.*")} == before
    main(["merge", "share", "--out", "merged"])
    assert (folder / "merged" / "rates.csv").read_text() == (folder / "whole" / "rates.csv").read_text()


@pytest.mark.parametrize("share", ["0/3", "4/3", "a/3", "3", "1/0", "-1/3"])
def test_a_share_that_is_none(folder: Path, capsys: pytest.CaptureFixture[str], share: str) -> None:
    assert "shard" in refused(capsys, "run", "small.toml", f"--shard={share}")
    assert not (folder / "runs").exists() or list((folder / "runs").iterdir()) == []


def test_the_installed_command_sets_its_exit_code(folder: Path) -> None:
    command = [sys.executable, "-m", "pl_mc.cli.main", "run", "nosuch"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False, timeout=120)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


def test_a_comparison_of_damaged_results(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stored counts of epochs that are not what was written are left out and told; counts that are none are refused."""
    faults = '[faults]\nsatellite = "G01"\nstart_m = 11.0\nstop_m = 12.0\nstep_m = 1.0\n'
    Path("many.toml").write_text(f'kind = "sweep"\ntitle = "A"\ndraws = 30\n[geometry]\nepochs = 3\n{faults}')
    for name in ("one", "other"):
        main(["run", "many.toml", "--out", name, "-q"])
    part = Path("other", "epochs", "part-000000.parquet")
    sound, table = part.read_bytes(), Path("other", "rates.csv")
    assert sound
    for damage in (sound[:-1], b"", sound.replace(b"PAR1", b"PAR2")):
        part.write_bytes(damage)
        capsys.readouterr()
        main(["compare", "one", "other", "--out", "both"])
        assert f"{part}: it is not what was written; the counts of epochs are left out" in capsys.readouterr().out
    part.unlink()
    os.mkfifo(part)
    main(["compare", "one", "other", "--out", "both"])
    assert "it is no regular file; the counts of epochs" in capsys.readouterr().out
    part.unlink()
    monkeypatch.setattr(checkpoint_store, "MOST_BYTES", len(sound) - 1)
    part.write_bytes(sound)
    main(["compare", "one", "other", "--out", "both"])
    assert "it is larger than any part" in capsys.readouterr().out
    content = table.read_text()
    row = content.splitlines()[1]
    fields = row.split(",")
    place = content.splitlines()[0].split(",").index("alarms")
    for number in ("-1", "inf", "0.5", "301"):
        table.write_text(content.replace(row, ",".join([*fields[:place], number, *fields[place + 1 :]])))
        assert f"rates.csv of the second run: row 1: alarms {number}" in refused(capsys, "compare", "one", "other")
    # Numbers in another form are the same numbers.
    place = content.splitlines()[0].split(",").index("bias_m")
    table.write_text(content.replace(row, ",".join([*fields[:place], "11.25", *fields[place + 1 :]])))
    main(["compare", "one", "other", "--out", "both"])
    assert "1 rows of the first run have no counterpart" in capsys.readouterr().out
