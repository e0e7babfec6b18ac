"""A results folder held against its manifest: every flipped byte is found, and another run gives the same."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.output import content_hash
from pl_mc.experiments.reading import remake_page
from pl_mc.experiments.running import run_experiment
from pl_mc.experiments.verifying import verify
from pl_mc.input_errors import InputError
from reference.small_run import SMALL, ended

# Figures are compared.
pytestmark = pytest.mark.drawn


def test_a_run_is_as_it_was_written_and_comes_out_the_same_again(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = verify(finished, redo=True)
    assert found.passed
    assert set(found.intact) == {path.name for path in finished.iterdir()} - {"manifest.json"}
    assert set(found.same) == set(found.intact) - {"report.html"}
    assert ended("verify", str(finished)) == 0
    files = f"{len(found.intact)} of {len(found.intact)} files"
    assert capsys.readouterr().out == f"{finished}: {files} are as the run wrote them.\n"


def test_one_flipped_byte_in_any_file_is_found(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in sorted(copied.iterdir()):
        whole = path.read_bytes()
        for place in (0, len(whole) // 2, len(whole) - 1):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            # What is no JSON any more is no manifest at all.
            code = ended("verify", str(copied))
            said = capsys.readouterr()
            assert (code == 1 and f"{path.name}: it is not what the run wrote.\n" in said.out) or (
                code == 2 and str(path) in said.err and path.name == "manifest.json"
            ), (path.name, place, said)
        path.write_bytes(whole)
    assert verify(copied).passed


def test_what_is_missing_and_what_is_foreign(copied: Path) -> None:
    (copied / "rates.svg").unlink()
    found = verify(copied)
    assert (found.passed, found.missing) == (False, ("rates.svg",))
    assert verify(copied, partial=True).passed
    (copied / "mine.txt").write_text("mine")
    assert verify(copied, partial=True).foreign == ("mine.txt",)
    (copied / "mine.txt").unlink()
    # A file elsewhere is not what the run wrote here.
    shutil.copy(copied / "rates.csv", copied.parent / "elsewhere.csv")
    (copied / "rates.csv").unlink()
    (copied / "rates.csv").symlink_to(copied.parent / "elsewhere.csv")
    assert verify(copied).changed == ("rates.csv",)


def test_another_run_says_which_numbers_are_different(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = (copied / "rates.csv").read_text().splitlines()
    column = rows[0].split(",").index("alarms")
    cells = rows[2].split(",")
    cells[column] = str(int(cells[column]) - 3)
    (copied / "rates.csv").write_text("\n".join([*rows[:2], ",".join(cells), *rows[3:]]) + "\n")
    assert ended("verify", str(copied), "--redo", "--json") == 1
    said = json.loads(capsys.readouterr().out)
    assert said["changed"] == ["rates.csv"]
    (told,) = said["redone"]
    assert told == f"rates.csv: alarms comes out different (by up to {3 / (int(cells[column]) + 3):.1g} of its value)."
    assert said["notes"] == ["Versions and processor are those of the run: nothing explains a difference."]


def test_a_page_that_is_made_again_is_the_page_of_the_run(copied: Path) -> None:
    (copied / "rates.png").unlink()
    remake_page(copied)
    assert verify(copied, partial=True).passed


def test_the_files_that_a_run_read(tmp_path: Path) -> None:
    ism = tmp_path / "ism.csv"
    ism.write_text("satellite,b_nom_m,p_sat,p_const\nG,0.75,1e-5,1e-4\nC,0.75,1e-5,1e-4\n")
    content = SMALL | {"methods": [{"name": "araim", "ism": str(ism)}]}
    run_experiment("small", build_experiment(content, source="small"), tmp_path / "out")
    assert verify(tmp_path / "out").passed
    ism.write_text(ism.read_text().replace("0.75", "0.5"))
    (said,) = verify(tmp_path / "out").inputs
    assert said.startswith("methods")
    assert said.endswith(" now.")
    ism.unlink()
    found = verify(tmp_path / "out")
    assert found.passed
    (said,) = found.notes
    assert str(ism) in said


def test_what_cannot_be_verified(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = json.loads((copied / "manifest.json").read_text())
    del manifest["files"]
    (copied / "manifest.json").write_text(json.dumps(manifest))
    assert ended("verify", str(copied)) == 2
    assert capsys.readouterr().err.startswith(f"pl-mc: {copied / 'manifest.json'}: it names no hashes of files")
    assert ended("verify", str(copied), "--progress") == 2
    assert "it does nothing without --redo" in capsys.readouterr().err
    for folder in (copied / "nothing", Path("x" * 300)):
        assert ended("verify", str(folder)) == 2
        assert capsys.readouterr().err.count("\n") == 1


def resealed(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """The manifest changed, with a hash of what it says now."""
    manifest = json.loads((folder / "manifest.json").read_text())
    change(manifest)
    del manifest["sha256"]
    (folder / "manifest.json").write_text(json.dumps(manifest | {"sha256": content_hash(manifest)}))


@pytest.mark.parametrize("name", ["../outside.txt", "/etc/hostname", "", ".", "..", "a\nb", "\ud800x", "y" * 300])
def test_a_manifest_names_files_of_its_folder_alone(copied: Path, name: str) -> None:
    (copied.parent / "outside.txt").write_text("outside")
    resealed(copied, lambda manifest: manifest["files"].update({name: "0" * 64}))
    with pytest.raises(InputError, match=r"manifest\.json: files: .* is no name of a file in the folder"):
        verify(copied)


def test_damage_is_listed_whole_and_nothing_is_run_of_a_changed_manifest(copied: Path) -> None:
    (copied / "levels.csv").write_bytes(b"\xff\x00")
    (copied / "report.json").write_text("{")
    (copied / "summary.md").write_bytes(b"\xff")
    found = verify(copied, redo=True)
    assert set(found.changed) == {"levels.csv", "report.json", "summary.md"}
    assert "levels.csv: it is no table, which another run writes." in (found.redone or ())
    (copied / "manifest.json").write_text(
        (copied / "manifest.json").read_text().replace("A small ramp", "A large ramp")
    )
    found = verify(copied, redo=True)
    assert found.redone is None
    assert found.notes == ("manifest.json: since it is not what the run wrote, nothing was run again.",)
