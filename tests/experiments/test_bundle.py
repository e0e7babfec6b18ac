"""A bundle to hand over: complete, the same bytes again, free of a person's folders, and one flipped byte is found."""

from __future__ import annotations

import hashlib
import io
import json
import random
import re
import shutil
import tomllib
import zipfile
from pathlib import Path

import pytest

from pl_mc.experiments.bundling import archive_of, verify_bundle, write_bundle
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.experiments.verifying import verify
from pl_mc.input_errors import InputError
from reference.small_run import SMALL, ended

ISM = "satellite,b_nom_m,p_sat,p_const\nG,0.75,1e-5,1e-4\nC,0.75,1e-5,1e-4\n"


# Figures are compared.
pytestmark = pytest.mark.drawn


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that read a file by its whole path."""
    home = tmp_path_factory.mktemp("bundled")
    (home / "mine.csv").write_text(ISM)
    methods = ["ls", {"name": "araim", "ism": str(home / "mine.csv")}]
    run_experiment("small", build_experiment(SMALL | {"methods": methods}, source="small"), home / "small")
    return home / "small"


@pytest.fixture
def bundle(folder: Path, tmp_path: Path) -> Path:
    write_bundle(folder, tmp_path / "small.zip")
    return tmp_path / "small.zip"


def members_of(place: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(place) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_bundle_has_all_of_it_and_is_the_same_again(folder: Path, bundle: Path, tmp_path: Path) -> None:
    held = members_of(bundle)
    inside = {name.removeprefix("results/") for name in held if name.startswith("results/")}
    assert inside == {path.name for path in folder.iterdir()}
    assert {"report.html", "assumptions.md", "manifest.json", "rates.csv", "rates.png", "rates.svg"} <= inside
    assert set(held) - {f"results/{name}" for name in inside} == {
        "README.txt", "SHA256SUMS", "environment.txt", "experiment.toml",
    }  # fmt: skip
    again = shutil.copytree(folder, tmp_path / "elsewhere" / "other")
    write_bundle(again, tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == bundle.read_bytes()
    assert {one.date_time for one in zipfile.ZipFile(bundle).infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert list(held) == sorted(held)
    # What shasum -c reads.
    for line in held["SHA256SUMS"].decode().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256(held[name]).hexdigest() == digest
    # Tables are those of the run, bit by bit.
    for name in inside - {"manifest.json", "report.html"}:
        assert held[f"results/{name}"] == (folder / name).read_bytes(), name


def test_a_bundle_tells_no_folder_and_no_registry(folder: Path, bundle: Path) -> None:
    held = members_of(bundle)
    for name, content in held.items():
        assert str(folder.parent).encode() not in content, name
        assert folder.parent.name.encode() not in content, name
    lock = held["environment.txt"].decode()
    assert "://" not in lock
    packages = [line for line in lock.splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9-]+==\S+  # sha256 [0-9a-f]{64}", line) for line in packages)
    assert any(line.startswith("jaxlib==") for line in packages)
    readme = held["README.txt"].decode()
    assert f"  {hashlib.sha256(ISM.encode()).hexdigest()}  mine.csv\n" in readme
    assert "pl-mc run results/manifest.json --out again" in held["results/report.html"].decode()


def test_the_experiment_of_a_bundle_runs(folder: Path, bundle: Path, tmp_path: Path) -> None:
    experiment = build_experiment(tomllib.loads(members_of(bundle)["experiment.toml"].decode()), source="bundle")
    record = load_experiment(str(folder / "manifest.json"))[1]
    assert experiment.methods[1].options == {"ism": "mine.csv"}
    assert experiment.model_copy(update={"methods": record.methods}) == record


def test_a_bundle_is_verified_packed_and_unpacked(
    folder: Path, bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder.parent)
    found = verify_bundle(bundle, redo=True, progress=False)
    assert found.passed, found.redone
    assert set(found.same) == {path.name for path in folder.iterdir()} - {"manifest.json", "report.html"}
    assert ended("verify", str(bundle)) == 0
    count = len(members_of(bundle))
    assert capsys.readouterr().out == f"{bundle}: {count} of {count} files are as the run wrote them.\n"
    assert ended("verify", str(bundle), "--json") == 0
    assert json.loads(capsys.readouterr().out)["passed"]
    zipfile.ZipFile(bundle).extractall(tmp_path / "unpacked")
    assert verify(tmp_path / "unpacked" / "results").passed
    # A file that the run read is held against what it was.
    (tmp_path / "mine.csv").write_text(ISM.replace("0.75", "0.5"))
    monkeypatch.chdir(tmp_path)
    assert verify_bundle(bundle).inputs


def test_one_flipped_byte_in_any_member_is_found(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = bundle.read_bytes()
    with zipfile.ZipFile(bundle) as archive:
        spans = {
            one.filename: (one.header_offset + 30 + len(one.filename), one.file_size) for one in archive.infolist()
        }
    for name, (begin, size) in spans.items():
        for place in (begin, begin + size // 2, begin + size - 1):
            bundle.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            assert ended("verify", str(bundle)) == 1, (name, place)
            assert f"{name}: it is not what the run wrote.\n" in capsys.readouterr().out
    # Anywhere else, where it may be no archive any more.
    chance = random.Random(5)
    for place in [0, 10, len(whole) - 1, *(chance.randrange(len(whole)) for _ in range(60))]:
        bundle.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert ended("verify", str(bundle)) in (1, 2), place
    for cut in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        bundle.write_bytes(whole[:cut])
        assert ended("verify", str(bundle)) in (1, 2), cut
    bundle.write_bytes(whole + b"\n")
    assert ended("verify", str(bundle)) in (1, 2)


def sealed(members: dict[str, bytes]) -> bytes:
    """An archive whose list of hashes is made anew."""
    others = {name: content for name, content in members.items() if name != "SHA256SUMS"}
    sums = "".join(f"{hashlib.sha256(others[name]).hexdigest()}  {name}\n" for name in sorted(others))
    return archive_of(others | {"SHA256SUMS": sums.encode()})


def test_whoever_writes_the_list_of_hashes_anew_has_the_manifest_against_him(
    bundle: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = members_of(bundle)
    without = {name: content for name, content in held.items() if name != "results/rates.csv"}
    bundle.write_bytes(sealed(without))
    assert verify_bundle(bundle).missing == ("results/rates.csv",)
    assert verify_bundle(bundle, partial=True).passed
    bundle.write_bytes(sealed(held | {"results/foreign.csv": b"a,b\n"}))
    found = verify_bundle(bundle)
    assert found.foreign == ("results/foreign.csv",)
    assert not found.passed
    bundle.write_bytes(sealed(held | {"experiment.toml": held["experiment.toml"].replace(b"= 300", b"= 301")}))
    assert verify_bundle(bundle).changed == ("experiment.toml",)
    # Without the manifest there is nothing that the rest is held against.
    for members in ({name: one for name, one in held.items() if "manifest" not in name}, {"a.txt": b"a"}):
        bundle.write_bytes(sealed(members))
        for partial in (False, True):
            with pytest.raises(InputError, match=r"it is no bundle: results/manifest\.json, against which"):
                verify_bundle(bundle, partial=partial, redo=True)
    bundle.write_bytes(sealed(held | {"results/rates.csv/x": b"x"}))
    with pytest.raises(InputError, match=r"results/rates\.csv is a file and a folder in it"):
        verify_bundle(bundle)
    # What is wrong in it is named as it stands there.
    manifest = json.loads(held["results/manifest.json"]) | {"files": 3}
    bundle.write_bytes(sealed(held | {"results/manifest.json": json.dumps(manifest).encode()}))
    assert ended("verify", str(bundle)) == 2
    assert capsys.readouterr().err.startswith(f"pl-mc: {bundle}: results/manifest.json: ")


def test_what_is_added_taken_away_or_sealed_again(bundle: Path, tmp_path: Path) -> None:
    held = members_of(bundle)
    bundle.write_bytes(archive_of(held | {"results/mine.txt": b"mine"}))
    assert verify_bundle(bundle).foreign == ("results/mine.txt",)
    bundle.write_bytes(archive_of({name: one for name, one in held.items() if name != "results/rates.svg"}))
    assert verify_bundle(bundle).missing == ("results/rates.svg",)
    assert verify_bundle(bundle, partial=True).passed
    for name in ("SHA256SUMS", "results/manifest.json"):
        bundle.write_bytes(archive_of({one: content for one, content in held.items() if one != name}))
        assert name in verify_bundle(bundle).missing
    # What is no list of names and hashes says nothing, and is shown to nobody.
    for sums in (b"\xff", b"one word\n", b"0  \x1b[31mred\n", b"0  ../../out\n", b""):
        bundle.write_bytes(archive_of(held | {"SHA256SUMS": sums}))
        assert verify_bundle(bundle).changed == ("SHA256SUMS",)
    other = held | {"results/rates.csv": held["results/rates.csv"].replace(b"300", b"301")}
    bundle.write_bytes(sealed(other))
    assert verify_bundle(bundle).changed == ("results/rates.csv",)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["../out.txt"], "is no name of a member"),
        (["/etc/out.txt"], "is no name of a member"),
        (["results/../../out.txt"], "is no name of a member"),
        (["results\\..\\out.txt"], "is no name of a member"),
        (["a//b"], "is no name of a member"),
        (["x" * 300], "is no name of a member"),
        (["a\nb"], "is no name of a member"),
        (["twice", "twice"], "is no name of a member"),
    ],
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_names_that_lead_elsewhere_are_refused(tmp_path: Path, names: list[str], words: str) -> None:
    place = tmp_path / "inner" / "hostile.zip"
    place.parent.mkdir()
    with zipfile.ZipFile(place, "w") as archive:
        for name in names:
            archive.writestr(zipfile.ZipInfo(name), b"x")
    with pytest.raises(InputError, match=words):
        verify_bundle(place)
    assert [path.name for path in tmp_path.rglob("*")] == ["inner", "hostile.zip"]


def test_packed_encrypted_and_overlapping_members_are_refused(tmp_path: Path) -> None:
    place = tmp_path / "hostile.zip"
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("results/bomb.csv", b"0" * 50_000_000)
    with pytest.raises(InputError, match="its members are larger than itself"):
        verify_bundle(place)
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("results/a.csv", random.Random(1).randbytes(1000))
    with pytest.raises(InputError, match="is packed or encrypted; unpack it"):
        verify_bundle(place)
    # Ten names for one stretch of bytes.
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("a", b"0" * 1000)
        first = archive.infolist()[0]
        for k in range(10):
            one = zipfile.ZipInfo(f"b{k}")
            one.header_offset, one.file_size, one.compress_size, one.CRC = 0, 1000, 1000, first.CRC
            archive.filelist.append(one)
            archive.NameToInfo[one.filename] = one
    place.write_bytes(out.getvalue())
    with pytest.raises(InputError, match="its members are larger than itself"):
        verify_bundle(place)
    for content in (b"", b"no archive", b"PK\x03\x04", b"PK\x05\x06" + bytes(18)):
        place.write_bytes(content)
        assert ended("verify", str(place)) in (1, 2)


def test_no_bundle_of_a_folder_that_is_not_as_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copied = Path(shutil.copytree(folder, tmp_path / "small"))
    (copied / "rates.csv").write_text((copied / "rates.csv").read_text().replace("300", "301"))
    assert ended("report", str(copied), "--bundle", str(tmp_path / "small.zip")) == 2
    said = capsys.readouterr().err
    assert "no bundle is made of a folder that is not what its run wrote (rates.csv: it is not what" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "small.zip").exists()
    # Nothing is drawn or written where a table is not there; a figure that is not there can be drawn.
    shutil.copy(folder / "rates.csv", copied)
    (copied / "exact.csv").unlink()
    before = {path.name: path.read_bytes() for path in copied.iterdir()}
    assert ended("report", str(copied), "--style", "grey", "--bundle", str(tmp_path / "small.zip")) == 2
    assert {path.name: path.read_bytes() for path in copied.iterdir()} == before
    shutil.copy(folder / "exact.csv", copied)
    (copied / "rates.svg").unlink()
    capsys.readouterr()
    assert ended("report", str(copied), "--bundle", str(tmp_path / "small.zip")) == 2
    assert "--format png,svg draws figures again" in capsys.readouterr().err
    assert ended("report", str(copied), "--format", "png,svg", "--bundle", str(tmp_path / "small.zip")) == 0
    # No bundle lies in another results folder, where it would be foreign.
    assert ended("report", str(copied), "--bundle", str(folder / "small.zip")) == 2
    assert "it would be a foreign file in a results folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["small.txt", "small", "nothing/small.zip", "small/inside.zip"])
def test_places_of_a_bundle(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    copied = Path(shutil.copytree(folder, tmp_path / "small"))
    before = sorted(copied.iterdir())
    assert ended("report", str(copied), "--bundle", str(tmp_path / name)) == 2
    assert capsys.readouterr().err.startswith("pl-mc: --bundle: ")
    assert sorted(copied.iterdir()) == before
    assert ended("run", "ramp", "--out", str(copied), "--bundle", str(tmp_path / name)) == 2
    assert capsys.readouterr().err.startswith("pl-mc: --bundle: ")
    assert ended("run", "ramp", "--shard", "1/2", "--bundle", str(tmp_path / "small.zip")) == 2
    assert "a share of a run has no results yet" in capsys.readouterr().err


def test_a_run_and_a_page_with_a_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(
        'kind = "sweep"\ntitle = "Small"\ndraws = 64\ngeometry.epoch = 2\n'
        'faults = { satellite = "G02", otherwise = "median_redundancy", start_m = 10, stop_m = 40, step_m = 15 }\n'
    )
    assert ended("run", "small.toml", "--bundle", "small.zip", "--no-progress") == 0
    assert capsys.readouterr().out.endswith("Bundle: small.zip\n")
    assert ended("report", "runs/small", "--bundle", "again.zip") == 0
    assert capsys.readouterr().out.endswith("Report: runs/small/report.html, bundle: again.zip\n")
    assert Path("small.zip").read_bytes() == Path("again.zip").read_bytes()
    assert verify_bundle(Path("small.zip")).passed
    assert ended("report", "runs/small", "--bundle", "again.zip", "--json") == 0
    assert json.loads(capsys.readouterr().out)["bundle"] == "again.zip"
