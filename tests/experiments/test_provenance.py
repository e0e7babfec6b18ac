"""What a manifest says of a run: date, command, code, packages, machine, seeds; no person's folder and no host."""

from __future__ import annotations

import getpass
import json
import os
import re
import shutil
import socket
from importlib.metadata import PathDistribution
from pathlib import Path
from typing import Any

import pytest

from pl_mc.cli.main import main
from pl_mc.experiments import provenance
from pl_mc.experiments.loading import load_experiment
from pl_mc.experiments.output import content_hash
from pl_mc.experiments.verifying import verify
from pl_mc.runtime.typed_command import typed, typed_command

ISM = "satellite,b_nom_m,p_sat,p_const\nG,0.75,1e-5,1e-4\nC,0.75,1e-5,1e-4\n"
MAP = """
kind = "sweep"
view = "map"
title = "A small map"
draws = 64
seed = 5
methods = [{{ name = "araim", ism = "{ism}" }}]
geometry.epochs = 2
faults = {{ start_m = 10, stop_m = 40, step_m = 15 }}
"""
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One experiment run twice by commands, in a home with an ISM."""
    home = tmp_path_factory.mktemp("ann") / "ann.home"
    home.mkdir()
    (home / "ism.csv").write_text(ISM)
    (home / "map.toml").write_text(MAP.format(ism=home / "ism.csv"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(home))
        for place in ("one", "two"):
            main(["run", str(home / "map.toml"), f"--out={home / place}", "--no-progress", "-q"])
    return home


def manifest_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "manifest.json").read_text()))


def test_two_runs_differ_in_time_and_command_alone(twice: Path) -> None:
    first, second = manifest_of(twice / "one"), manifest_of(twice / "two")
    different = {field for field in first if first[field] != second[field]}
    assert different <= {"date", "command", "seconds", "files", "sha256"}
    assert list(first) == list(second)
    files = {name for name in first["files"] if first["files"][name] != second["files"][name]}
    # The page names date, time and folder.
    assert files == {"report.html"}
    assert first["command"] == ["pl-mc", "run", "map.toml", "--out=one", "--no-progress", "-q"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ", first["date"])
    assert first["seeds"] == {"seed": 5}
    assert {"system", "processor", "cores", "instruction set"} <= set(first["machine"])
    assert re.fullmatch(r"[0-9a-f]{64}", first["code"]["sha256"])
    assert first["installed"]["jax"] == {
        "version": first["versions"]["jax"],
        "sha256": first["installed"]["jax"]["sha256"],
    }
    assert {"numpy", "scipy", "jaxlib", "pydantic", "jinja2"} <= set(first["installed"])
    assert not {"pytest", "sphinx", "ruff", "pl-mc"} & set(first["installed"])


def test_a_manifest_tells_no_home_and_no_host(twice: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {name: (twice / "one" / name).read_text() for name in ("manifest.json", "report.html", "summary.md")}
    for name, text in texts.items():
        assert str(twice) not in text, name
        assert socket.gethostname() not in text or len(socket.gethostname()) < 4, name
        assert getpass.getuser() not in text or len(getpass.getuser()) < 5, name
    (choice,) = manifest_of(twice / "one")["experiment"]["methods"]
    assert choice["ism"] == "~/ism.csv"
    monkeypatch.setenv("HOME", str(twice))
    (method,) = load_experiment(str(twice / "one" / "manifest.json"))[1].method_records()
    assert method.name.startswith("araim")
    assert verify(twice / "one").passed


def test_rows_in_folders_are_held_against_the_manifest_too(twice: Path, tmp_path: Path) -> None:
    copied = Path(shutil.copytree(twice / "one", tmp_path / "one"))
    part = copied / "epochs" / "part-000000.parquet"
    assert "epochs/part-000000.parquet" in verify(copied).intact
    whole = part.read_bytes()
    part.write_bytes(whole[:50] + bytes([whole[50] ^ 1]) + whole[51:])
    assert verify(copied).changed == ("epochs/part-000000.parquet",)
    part.write_bytes(whole)
    (copied / "epochs" / "mine.txt").write_text("mine")
    assert verify(copied).foreign == ("epochs/mine.txt",)
    (copied / "epochs" / "mine.txt").unlink()
    # A manifest of a version that hashed no folders.
    manifest = manifest_of(copied)
    manifest["files"] = {name: value for name, value in manifest["files"].items() if "/" not in name}
    del manifest["sha256"]
    (copied / "manifest.json").write_text(json.dumps(manifest | {"sha256": content_hash(manifest)}))
    found = verify(copied)
    assert found.passed
    assert "epochs: the run was of a version that kept no hash of it." in found.notes


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("/home/ann/x/my.toml", "my.toml"),
        ("--out=/home/ann/my dir/y", "--out=y"),
        ("runs/x", "runs/x"),
        ("./my.toml", "./my.toml"),
        ("../up/y", "y"),
        ("a/../../ann/b", "b"),
        ("~/z/a.b", "a.b"),
        ("~ann/z/a.b", "a.b"),
        ("C:\\Users\\ann\\x.toml", "x.toml"),
        ("\\\\server\\share\\x.csv", "x.csv"),
        ("tcp://head:8786", "tcp://"),
        ("--scheduler=tcp://head:8786", "--scheduler=tcp://"),
        ('araim(ism="/home/ann/i.csv", k=2)', 'araim(ism="i.csv", k=2)'),
        ("G15:+0.1m/s:100-", "G15:+0.1m/s:100-"),
        ("3/16", "3/16"),
        ("3582104.9,532590.2,5232755.3", "3582104.9,532590.2,5232755.3"),
    ],
)
def test_a_command_is_told_without_folders_elsewhere(given: str, told: str) -> None:
    with typed(["run", given]):
        assert typed_command() == ["pl-mc", "run", told]
    assert typed_command() is None


def test_the_hash_of_a_package_is_of_its_wheel_and_not_of_its_installer(tmp_path: Path) -> None:
    def installed(place: str, *further: str, size: int = 10) -> str:
        folder = tmp_path / place / "one-1.0.dist-info"
        folder.mkdir(parents=True)
        rows = [f"one/a.py,sha256=abc,{size}", "one/b.py,sha256=def,10", "one-1.0.dist-info/METADATA,sha256=m,9"]
        (folder / "RECORD").write_text("\n".join([*further, *rows, "one-1.0.dist-info/RECORD,,"]) + "\n")
        return provenance._record_hash(PathDistribution(folder))

    plain = installed("plain")
    again = installed(
        "again", "one/__pycache__/a.pyc,,", "../../../bin/one,sha256=here,99",
        "one-1.0.dist-info/direct_url.json,sha256=x,7", "one-1.0.dist-info/INSTALLER,sha256=y,4", size=11,
    )  # fmt: skip
    assert plain == again
    assert installed("more", "one/c.py,sha256=abc,10") != plain
    (tmp_path / "none-1.0.dist-info").mkdir()
    assert provenance._record_hash(PathDistribution(tmp_path / "none-1.0.dist-info")) == ""


def test_the_commit_of_a_checkout_is_read_without_git(tmp_path: Path) -> None:
    assert provenance._commit(tmp_path) is None
    git = tmp_path / ".git"
    (git / "refs/heads").mkdir(parents=True)
    (git / "HEAD").write_text(f"{COMMIT}\n")
    assert provenance._commit(tmp_path) == COMMIT
    (git / "HEAD").write_text("ref: refs/heads/mine\n")
    assert provenance._commit(tmp_path) is None
    (git / "packed-refs").write_text(f"# pack-refs\n{'f' * 40} refs/heads/mine2\n{COMMIT} refs/heads/mine\n")
    assert provenance._commit(tmp_path) == COMMIT
    (git / "refs/heads/mine").write_text(f"{'e' * 40}\n")
    assert provenance._commit(tmp_path) == "e" * 40
    # A further work tree: its HEAD is its own, references are common.
    (git / "worktrees/two").mkdir(parents=True)
    (git / "worktrees/two/HEAD").write_text("ref: refs/heads/mine\n")
    (git / "worktrees/two/commondir").write_text("../..\n")
    (tmp_path / "two").mkdir()
    (tmp_path / "two/.git").write_text(f"gitdir: {git / 'worktrees/two'}\n")
    assert provenance._commit(tmp_path / "two") == "e" * 40
    (git / "HEAD").write_bytes(os.urandom(20))
    assert provenance._commit(tmp_path) is None
