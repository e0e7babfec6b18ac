"""How commands speak: JSON, quiet, help with examples and exit codes, no colours where nobody sees them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from stored_runs import counts, store_run

from pl_mc.cli.main import app, main
from pl_mc.cli.printing import ERROR_MODEL_NAMES, METHOD_NAMES
from pl_mc.error_models.registry import ERROR_MODELS
from pl_mc.methods.registry import METHODS


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs that differ in their seed."""
    folder = tmp_path_factory.mktemp("two")
    for seed in (1, 2):
        store_run(folder / str(seed), counts({"ls": (0, 9, 400, 400), "igg3": (0, 0, 0, 0)}), seed=seed)
    return folder


def test_report_and_compare_speak_json(two_runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["report", str(two_runs / "1"), "--json"])
    content = json.loads(capsys.readouterr().out)
    assert content["folder"] == str(two_runs / "1")
    assert content["report"] == "report.html"
    assert content["tables"] == ["rates.csv"]
    assert content["figures"] == ["rates.png", "rates.svg"]
    assert len(content["answer"]) == 3
    assert content["notes"] == ["Faulted satellite: G07.", "Every iteration had settled to 1 cm."]
    assert (two_runs / "1" / "report.html").is_file()
    main(["report", str(two_runs / "1"), "-q"])
    assert capsys.readouterr().out == f"{two_runs / '1' / 'report.html'}\n"

    main(["compare", str(two_runs / "1"), str(two_runs / "2"), "--out", str(two_runs / "compared"), "--json"])
    content = json.loads(capsys.readouterr().out)
    assert content["fields"] == [{"field": "seed", "first": "1", "second": "2"}]
    assert content["names"] == ["1", "2"]
    assert not content["same_noise"]
    # 2 methods x 4 biases x 9 events.
    assert len(content["rates"]) == 72
    main(["compare", str(two_runs / "1"), str(two_runs / "2"), "--out", str(two_runs / "compared")])
    out = capsys.readouterr().out
    assert out.startswith("# 2 against 1\n")
    assert out.splitlines()[-1] == f"Comparison: {two_runs / 'compared'}"


def test_the_list_is_names_titles_or_json(capsys: pytest.CaptureFixture[str]) -> None:
    main(["list", "--json"])
    listed = json.loads(capsys.readouterr().out)
    main(["list", "--quiet"])
    assert capsys.readouterr().out.split() == [one["name"] for one in listed]
    assert {"name", "kind", "title", "needs"} == set(listed[0])
    needs = {one["name"]: one["needs"] for one in listed}
    assert needs["ramp"] == {"files": [], "extras": []}
    assert needs["service-volume"] == {"files": [], "extras": ["maps"]}
    # What comes with the package is no need.
    assert needs["observe-day"]["files"] == [
        "ESBC00DNK_R_20201770000_01D_30S_MO.crx.gz", "ESBC00DNK_R_20201770000_01D_MN.rnx.gz",
    ]  # fmt: skip
    main(["list"])
    rows = capsys.readouterr().out.splitlines()
    assert rows[0].split() == ["name", "needs", "title"]
    told = {row.split()[0]: row for row in rows[1 : 1 + len(listed)]}
    assert "  2 files     " in told["guo2022-esbc"]
    assert "  extra maps  " in told["service-volume"]
    assert "  -           5-100 m" in told["ramp"]
    assert "PL_MC_DATA" in rows[-1]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["report", "nothing"], "no such results folder"),
        (["compare", "nothing", "nothing"], "no such results folder"),
        (["check", "rampe"], "nearest: ramp"),
        (["check", "missing.toml"], "no such file"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(command)
    assert stop.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_help_has_examples_exit_codes_and_no_colours(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "Exit codes: 0 done; 1 where a check (verify, conform) finds something; 2 input that cannot be used" in text
    assert "--install-completion" in text
    for name in (
        "run",
        "list",
        "init",
        "check",
        "explain",
        "report",
        "compare",
        "verify",
        "observe",
        "merge",
        "bench",
        "conform",
    ):
        main([name, "--help"])
        shown = capsys.readouterr().out
        assert f"pl-mc {name}" in shown
        assert "Example" in shown
        assert "\x1b" not in shown


def test_completion_knows_commands_and_options() -> None:
    for shell in ("bash", "zsh", "fish"):
        script = app.generate_completion(shell=shell)
        assert "compare" in script
        assert "measure" in script
        # Values of options, and names of experiments, which the oldest library leaves out for fish.
        names = () if shell == "fish" else ("zhao2021-static",)
        for value in (*names, "igg3_gated", "horizontal", "float32", "dual_frequency", "broadcast"):
            assert value in script, (shell, value)


def test_what_shells_offer_is_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(METHOD_NAMES) == set(METHODS)
    # That of one's own figures needs a file.
    assert set(ERROR_MODEL_NAMES) == set(ERROR_MODELS) - {"user"}
    # What else may stand there is told by the house's own sentence, and names of files are no slips.
    for arguments, words in (
        (["run", "rampe"], "nearest: ramp"),
        (["run", "ramp", "--axes", "vertikal"], "nearest: vertical"),
        (["check", "nothing.toml"], "there is no such file"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main(arguments)
        assert words in capsys.readouterr().err
    main(["run", "--help"])
    assert "zhao2021-sweep|" not in capsys.readouterr().out


def test_a_terminal_without_colours_gets_none() -> None:
    command = [sys.executable, "-m", "pl_mc.cli.main", "check", "--help"]
    env = os.environ | {"NO_COLOR": "1", "FORCE_COLOR": "", "TERM": "xterm-256color"}
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=True, timeout=120)
    assert "\x1b[3" not in done.stdout
    assert done.stderr == ""
