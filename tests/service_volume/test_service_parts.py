"""A service volume in parts: stopped, damaged, shared and under other noise, it counts what it should."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import pl_mc
from pl_mc import AlertLimits, InputError
from pl_mc.engine import Execution
from pl_mc.engine import part_task as identity
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import merge, run_experiment, run_shard
from pl_mc.geometry.frames import from_geodetic
from pl_mc.service.task import ServiceTask
from pl_mc.service.volume import service_volume

# Bits, across threads, parts and processes: as users compile.
pytestmark = pytest.mark.optimised

STEP_S, EPOCHS, DRAWS, SEED = 5_400.0, 6, 8, 11
NEAR = AlertLimits("near", vertical_m=5.0, horizontal_m=7400.0)
TABLES = ("sites", "world", "levels", "satellites", "by_epoch")
OPTIONS = {
    "step_deg": 60.0, "step_s": STEP_S, "duration_s": EPOCHS * STEP_S, "methods": ("ls", "sbas"),
    "operations": NEAR, "durations_s": (STEP_S,), "draws": DRAWS, "seed": SEED, "progress": False, "workers": 2,
}  # fmt: skip


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    """Eighteen sites in batches of three and parts of six: three parts."""
    monkeypatch.setattr("pl_mc.service.task.GEOMETRIES_PER_BATCH", 3 * EPOCHS)
    monkeypatch.setattr("pl_mc.service.task.SCENARIOS_PER_PART", 6 * EPOCHS * DRAWS)


@pytest.fixture(scope="module")
def whole():
    """The same at once, in one part."""
    return service_volume(**OPTIONS)


def assert_same(found, expected) -> None:
    for name in TABLES:
        pd.testing.assert_frame_equal(getattr(found, name), getattr(expected, name), check_exact=True)


def test_a_run_that_was_stopped_ends_the_same(tmp_path, monkeypatch, whole):
    folder, calls = tmp_path / "parts", []
    levels = ServiceTask.levels

    def stopped(self, sites):
        if sites.start >= 6:
            raise KeyboardInterrupt
        return levels(self, sites)

    with monkeypatch.context() as patched:
        patched.setattr(ServiceTask, "levels", stopped)
        with pytest.raises(KeyboardInterrupt):
            service_volume(**OPTIONS, folder=folder)
    assert sorted(path.name for path in folder.iterdir()) == [ServiceTask.kind.record, "part-000000.parquet"]
    monkeypatch.setattr(ServiceTask, "levels", lambda self, sites: (calls.append(sites.start), levels(self, sites))[1])
    with pytest.raises(InputError, match="1 finished parts of an earlier run are here; resume it"):
        service_volume(**OPTIONS, folder=folder)
    assert not calls
    resumed = service_volume(**OPTIONS, folder=folder, resume=True)
    # Sums over parts are sums over batches in another order only where there is one part.
    assert sorted(calls) == [6, 9, 12, 15]
    assert resumed.notes == ()
    again = service_volume(**OPTIONS, folder=folder, resume=True)
    assert_same(again, resumed)
    for name in ("sites", "levels", "satellites"):
        pd.testing.assert_frame_equal(getattr(resumed, name), getattr(whole, name), check_exact=True)
    np.testing.assert_allclose(resumed.by_epoch.area_share, whole.by_epoch.area_share, rtol=1e-13)
    fresh = service_volume(**OPTIONS, folder=tmp_path / "other")
    assert_same(fresh, resumed)


def test_a_damaged_part_is_counted_again_and_a_strange_one_refused(tmp_path):
    folder = tmp_path / "parts"
    first = service_volume(**OPTIONS, folder=folder)
    place = folder / "part-000001.parquet"
    content = bytearray(place.read_bytes())
    content[40] ^= 1
    place.write_bytes(bytes(content))
    (folder / ".part-000001.parquet.123-abc").write_bytes(b"half")
    mended = service_volume(**OPTIONS, folder=folder, resume=True)
    assert_same(mended, first)
    assert len(mended.notes) == 1
    assert "part-000001.parquet: it is not what was written; it was counted again." in mended.notes[0]
    assert not list(folder.glob(".*"))
    with pytest.raises(InputError, match=r"belong to another service volume.*seed: 11 before, 12 now"):
        service_volume(**OPTIONS | {"seed": 12}, folder=folder, resume=True)
    with pytest.raises(InputError, match="folder: to resume a service volume, a folder"):
        service_volume(**OPTIONS, resume=True)


FORGERIES = {
    "ten times": lambda rows: rows.assign(counts=[c if c is None else [10 * v for v in c] for c in rows.counts]),
    "reversed": lambda rows: rows[::-1],
    "another name": lambda rows: rows.assign(array=["served", *rows.array[1:]]),
    "another shape": lambda rows: rows.assign(shape=[s[::-1] for s in rows["shape"]]),
    "one more": lambda rows: rows.assign(counts=[[rows.counts[0][0] + 1, *rows.counts[0][1:]], *rows.counts[1:]]),
    "negative": lambda rows: rows.assign(counts=[c if c is None else [-v for v in c] for c in rows.counts]),
}


@pytest.mark.parametrize("kind", FORGERIES)
def test_forged_parts_are_held_against_the_plan(tmp_path, monkeypatch, kind):
    """With a checksum that is right: sums over sites and over epochs are of the same scenarios."""
    first, part_rows = service_volume(**OPTIONS, folder=tmp_path), ServiceTask.part_rows

    def forged(self, part):
        table = part_rows(self, part)
        rows = pd.DataFrame(table.to_pylist())
        return pa.Table.from_pylist(FORGERIES[kind](rows).to_dict("records"), schema=table.schema)

    with monkeypatch.context() as patched:
        patched.setattr(ServiceTask, "part_rows", forged)
        (tmp_path / "part-000001.parquet").unlink()
        service_volume(**OPTIONS, folder=tmp_path, resume=True)
    mended = service_volume(**OPTIONS, folder=tmp_path, resume=True)
    assert_same(mended, first)
    assert "part-000001.parquet: not a part as this version writes it (" in mended.notes[0]


def test_parts_of_another_machine_are_merged_and_not_resumed(tmp_path, monkeypatch):
    folder, here = tmp_path / "parts", identity.environment()
    with monkeypatch.context() as patched:
        patched.setattr(identity, "environment", lambda: here | {"instruction set": "aarch64 asimd"})
        first = service_volume(**OPTIONS, folder=folder)
    with pytest.raises(InputError, match=r"another service volume, which cannot be resumed \(instruction set: aar"):
        service_volume(**OPTIONS, folder=folder, resume=True)
    monkeypatch.setattr("pl_mc.service.volume.Execution", partial(Execution, stored_only=True))
    stored = service_volume(**OPTIONS, folder=folder)
    assert_same(stored, first)
    assert len(stored.notes) == 1
    assert "where a single scenario at the edge of a limit can count otherwise." in stored.notes[0]
    (folder / "part-000002.parquet").unlink()
    with pytest.raises(InputError, match=r"part 2 of 3 \(counted from 0\) is missing or damaged; run the shards"):
        service_volume(**OPTIONS, folder=folder)


def test_shares_make_the_run(tmp_path, monkeypatch):
    content = {
        "kind": "service", "title": "shares", "draws": DRAWS, "step_deg": 60.0, "step_s": STEP_S,
        "duration_s": EPOCHS * STEP_S, "methods": [{"name": "ls"}, {"name": "sbas"}], "durations_s": [STEP_S],
        "operations": ["CAT-I"],
    }  # fmt: skip
    # Pictures are not what this is about.
    monkeypatch.setattr("pl_mc.report.files.save_figure", lambda *_: None)
    experiment = build_experiment(content, source="test")
    for index in (1, 2):
        run_shard("shares", experiment, tmp_path / "day", Execution(shard=(index, 2), progress=False))
    merged = merge([tmp_path / "day"], tmp_path / "merged", progress=False)
    assert Path(merged.folder / "sites.parquet").is_file()
    run_experiment("shares", experiment, tmp_path / "once", execution=Execution(progress=False))
    for name in ("world.csv", "worst_sites.csv"):
        assert (tmp_path / "merged" / name).read_bytes() == (tmp_path / "once" / name).read_bytes()
    assert not (tmp_path / "once.unfinished").exists()
    with pytest.raises(InputError, match="devices: a service volume runs in threads of one process"):
        run_experiment("shares", experiment, tmp_path / "two", execution=Execution(devices=2))


def test_availability_under_another_noise_is_what_sweeps_count(whole):
    """Multipath, which takes two numbers a satellite, moves levels that follow from residuals and no others."""
    noise = pl_mc.multipath(chance=0.2, size=8.0)
    found = service_volume(**OPTIONS, noise=noise)
    site = 14
    row = found.satellites.iloc[site]
    position = from_geodetic(np.radians(row.latitude_deg), np.radians(row.longitude_deg), 0.0)
    g = pl_mc.simulate(
        site=position, start="2017-11-21T00:00:00", epochs=EPOCHS, interval_s=STEP_S, mask_deg=10.0,
        constellations=("GPS", "GAL"),
    )  # fmt: skip
    g = dataclasses.replace(g, epoch=site * EPOCHS + np.arange(EPOCHS))
    swept = pl_mc.sweep(
        g, pl_mc.no_fault(g), draws=DRAWS, seed=SEED, methods=("ls",), alert=NEAR, noise=noise, progress=False
    )
    sites = found.sites.set_index(["site", "method"])
    assert sites.available[site, "ls"] == EPOCHS * DRAWS - swept.alarms[0]
    assert found.noise == noise.name
    before = whole.sites.set_index(["site", "method"])
    # What depends on the geometry alone knows nothing of it.
    assert (sites.available.xs("sbas", level=1) == before.available.xs("sbas", level=1)).all()
    assert not (sites.available.xs("ls", level=1) == before.available.xs("ls", level=1)).all()


def test_noise_that_cannot_serve_a_world_is_refused():
    with pytest.raises(InputError, match="nominal_bias: bias_m: one number"):
        service_volume(**OPTIONS, noise=pl_mc.nominal_bias(bias_m=(0.5, 0.1), sign="given"))
    with pytest.raises(InputError, match="noise: 'student' is unknown"):
        service_volume(**OPTIONS, noise="student")
