"""A sweep that was stopped, in whatever way, ends as if nothing had happened; what cannot go on says why."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import random
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pl_mc
from pl_mc.engine.task import SweepTask
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3
from pl_mc.runtime import whole_files
from reference import killed_sweep
from reference import small_sweep as small
from reference.damage import CHANGED, changed
from reference.forked import Forked
from reference.killed_sweep import PARTS
from reference.small_sweep import assert_same, cut

TESTS = Path(__file__).parents[1]
IDENTITY_FILE = SweepTask.kind.record


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[pd.DataFrame, Path]:
    """The table of an uninterrupted sweep, and its folder of twelve parts of two calls."""
    folder = tmp_path_factory.mktemp("finished") / "sweep"
    with cut(2):
        table = small.run(folder=folder)
        small.run(folder=folder.with_name("other"), seed=52)
    assert len(list(folder.glob("part-*.parquet"))) == PARTS
    return table, folder


def damaged(kind: str, number: int, folder: Path, where: float) -> bytes | None:
    """What is left of a part."""
    content = (folder / f"part-{number:06d}.parquet").read_bytes()
    if kind in ("whole", "lost"):
        return content if kind == "whole" else None
    neighbour = (folder / f"part-{(number + 1) % PARTS:06d}.parquet").read_bytes()
    stranger = (folder.with_name("other") / f"part-{number:06d}.parquet").read_bytes()
    return changed(kind, content, where, neighbour=neighbour, stranger=stranger)


KINDS = ("whole", "lost", *CHANGED)


@given(
    kinds=st.lists(st.sampled_from(KINDS), min_size=PARTS, max_size=PARTS),
    where=st.floats(0, 1, exclude_max=True),
    workers=st.sampled_from([1, 2, None]),
    named=st.booleans(),
)
@settings(max_examples=25)
def test_whatever_is_left_of_a_folder(finished, kinds, where, workers, named):
    table, folder = finished
    with cut(2), tempfile.TemporaryDirectory() as name:
        here = Path(name)
        for number, kind in enumerate(kinds):
            content = damaged(kind, number, folder, where)
            if content is not None:
                (here / f"part-{number:06d}.parquet").write_bytes(content)
        if named:
            (here / IDENTITY_FILE).write_bytes((folder / IDENTITY_FILE).read_bytes())
        with small.counted_calls() as calls:
            found = small.run(folder=here, resume=True, workers=workers)
        assert_same(found, table)
        # Nothing that was whole was computed again, nothing else was left out.
        expected = [chunk for k in range(PARTS) if kinds[k] != "whole" for chunk in small.task().plan.chunks(k)]
        assert sorted(calls, key=repr) == sorted(expected, key=repr)
        notes = found.attrs["notes"]
        for number, kind in enumerate(kinds):
            about = [note for note in notes if f"part-{number:06d}.parquet" in note]
            assert len(about) == (kind not in ("whole", "lost")), (kind, notes)
            assert all(note.endswith("; it was counted again.") for note in about)
        # The files, too, are those of the uninterrupted sweep, to the byte.
        assert small.contents(here) == small.contents(folder)


def test_damage_leaves_no_byte_out(finished):
    """The property above is not empty: each kind of damage changes the file."""
    folder = finished[1]
    for kind in set(KINDS) - {"whole"}:
        assert damaged(kind, 3, folder, 0.5) != damaged("whole", 3, folder, 0.5)


@given(stops=st.lists(st.integers(0, 23), max_size=5), workers=st.sampled_from([1, 3]))
@settings(max_examples=10)
def test_stopped_by_the_user_again_and_again(finished, stops, workers):
    table, folder = finished
    count = SweepTask.count
    with cut(2), tempfile.TemporaryDirectory() as name:
        here = Path(name, "sweep")
        for stop in stops:
            kept = set(here.glob("part-*.parquet"))
            calls = iter(range(stop + 1))

            def stopped(self, chunk, *noise, devices=1, calls=calls, stop=stop):
                if next(calls, stop) >= stop:
                    raise KeyboardInterrupt
                return count(self, chunk, *noise, devices=devices)

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(SweepTask, "count", stopped)
                try:
                    small.run(folder=here, resume=True, workers=workers)
                except KeyboardInterrupt:
                    pass
                else:
                    assert len(kept) * 2 + stop >= 24
            # All calls of a part, and the one that makes room for its last one, had to end.
            assert len(set(here.glob("part-*.parquet"))) >= min(len(kept) + (stop - 1) // 2, PARTS - 1)
            assert kept <= set(here.glob("part-*.parquet"))
        assert_same(small.run(folder=here, resume=True, workers=workers), table)
        assert small.contents(here) == small.contents(folder)


def test_killed_at_any_moment(tmp_path):
    """Most of its time the sweep is between writing a temporary file and replacing the part by it."""
    folder = tmp_path / "finished"
    with cut(2):
        table = small.run(folder=folder, methods=killed_sweep.METHODS)
    here = tmp_path / "sweep"
    program = killed_sweep.program(here)
    moments = random.Random(61)
    killed = 0
    for _ in range(3):
        before = len(list(here.glob("part-*.parquet")))
        if before >= PARTS - 1:
            break

        def more(before=before):
            return len(list(here.glob("part-*.parquet"))) > before

        killed += killed_sweep.ended_after(program, more, moments.uniform(0, 0.15)) == -signal.SIGKILL
        # What stands under the name of a part is a whole part.
        assert len(killed_sweep.whole_parts(here)) >= before
    assert killed >= 2
    done = Forked(program)
    said = done.communicate()[1]
    assert done.returncode == 0, said
    assert_same(pd.read_pickle(killed_sweep.table_of(here)), table)
    assert small.contents(here) == small.contents(folder)


def test_half_written_files_go(finished, tmp_path):
    table, folder = finished
    half = (".part-000003.parquet.77-0a1b2c3d", f".{IDENTITY_FILE}.77-0a1b2c3d", ".part-000004.parquet.1-00000000")
    for name in half:
        (tmp_path / name).write_bytes(b"PAR1")
    (tmp_path / ".mine").write_bytes(b"x")
    with cut(2):
        # A shard leaves what another one may be at.
        small.run(folder=tmp_path, shard=(4, PARTS))
        assert {name for name in half if (tmp_path / name).exists()} == {half[1], half[2]}
        assert_same(small.run(folder=tmp_path, resume=True), table)
    assert small.contents(tmp_path) == small.contents(folder) | {".mine": b"x"}


CHANGES = {
    "draws": ({"draws": small.DRAWS + 1}, r"draws: 1287 before, 1288 now"),
    "seed": ({"seed": 50}, r"seed: 51 before, 50 now"),
    "method": ({"methods": ("ls",)}, r"methods: .*Igg3\(.* before, .* now"),
    "option": ({"methods": ("ls", Igg3(iterations=2))}, r"methods: .*iterations=1.* before, .*iterations=2.* now"),
    "alert": ({"alert": pl_mc.APV_I}, r"vertical alert limit \[m\]: 35\.0 before, 50\.0 now"),
    "precision": ({"precision": "float32"}, r"precision: float64 before, float32 now"),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_another_experiment_is_refused(finished, kind):
    change, said = CHANGES[kind]
    folder = finished[1]
    before = small.contents(folder)
    with cut(2), pytest.raises(InputError, match=rf"another sweep, which cannot be resumed \({said}\)"):
        small.run(folder=folder, resume=True, **change)
    assert small.contents(folder) == before


def test_other_faults_or_skies_are_refused(finished):
    folder = finished[1]
    before = small.contents(folder)
    options = {"draws": small.DRAWS, "seed": small.SEED, "methods": small.METHODS, "folder": folder, "resume": True}
    bias_m = small.FAULTS.bias_m.copy()
    bias_m[1] *= 1 + 1e-15
    sigma_m = small.SERIES.sigma_m.copy()
    sigma_m[0, 0] *= 1 + 1e-15
    with cut(2):
        with pytest.raises(InputError, match=r"cannot be resumed \(faults\)"):
            pl_mc.sweep(small.SERIES, dataclasses.replace(small.FAULTS, bias_m=bias_m), **options)
        with pytest.raises(InputError, match=r"cannot be resumed \(geometry\)"):
            pl_mc.sweep(dataclasses.replace(small.SERIES, sigma_m=sigma_m), small.FAULTS, **options)
    with cut(3), pytest.raises(InputError, match=r"cannot be resumed \(calls per part: 2 before, 3 now\)"):
        small.run(folder=folder, resume=True)
    assert small.contents(folder) == before


def test_finished_parts_are_not_overwritten(finished):
    folder = finished[1]
    before = small.contents(folder)
    for options in ({}, {"seed": 3}):
        with cut(2), pytest.raises(InputError, match=r"12 finished parts of an earlier run are here; resume it, or"):
            small.run(folder=folder, **options)
    assert small.contents(folder) == before


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"experiment": 3}', b"\xff\xfe\x00"])
def test_a_record_that_cannot_be_read(finished, tmp_path, content):
    table, folder = finished
    (tmp_path / IDENTITY_FILE).write_bytes(content)
    with cut(2):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", lambda number: None)
            # Without any part there is nothing to protect.
            small.run(folder=tmp_path, resume=True, shard=(12, 12))
        (tmp_path / IDENTITY_FILE).write_bytes(content)
        before = small.contents(tmp_path)
        # Where no part is of this sweep they are somebody else's.
        with pytest.raises(InputError, match=r"another sweep, which .* \(its record cannot be read, and no part is of"):
            small.run(folder=tmp_path, resume=True, seed=50)
        assert small.contents(tmp_path) == before
        # The parts speak for themselves.
        found = small.run(folder=tmp_path, resume=True)
        assert_same(found, table)
        assert f"{tmp_path / IDENTITY_FILE}: it was damaged; the parts say" in " ".join(found.attrs["notes"])
        (tmp_path / IDENTITY_FILE).unlink()
        assert_same(small.run(folder=tmp_path, resume=True), table)
    assert small.contents(tmp_path) == small.contents(folder)


def test_a_flipped_bit_of_the_record_costs_nothing(finished, tmp_path):
    """Wherever it is, in a number or in a name; the parts are not counted again, and the record is what it was."""
    table, folder = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    content = (folder / IDENTITY_FILE).read_bytes()
    place, rng = tmp_path / IDENTITY_FILE, np.random.default_rng(64)
    told = 0
    with cut(2):
        for at in [content.index(b"1287") + 2, *rng.integers(0, len(content), 12).tolist()]:
            place.write_bytes(content[:at] + bytes([content[at] ^ 1 << int(rng.integers(7))]) + content[at + 1 :])
            with small.counted_calls() as calls:
                found = small.run(folder=tmp_path, resume=True)
            assert calls == []
            assert_same(found, table)
            told += f"{place}: it was damaged" in " ".join(found.attrs["notes"])
            if told:
                assert small.contents(tmp_path) == small.contents(folder)
    assert told >= 10


@pytest.mark.parametrize("make", [os.mkfifo, lambda place: os.symlink(place, place)], ids=["pipe", "link to itself"])
def test_what_stands_in_the_place_of_the_record_is_told(finished, tmp_path, make):
    table, folder = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    place = tmp_path / IDENTITY_FILE
    place.unlink()
    make(place)
    with cut(2):
        found = small.run(folder=tmp_path, resume=True)
    assert_same(found, table)
    assert f"{place}: it was damaged" in " ".join(found.attrs["notes"])
    assert small.contents(tmp_path) == small.contents(folder)


def test_the_record_can_be_read_by_others(finished):
    found = json.loads((finished[1] / IDENTITY_FILE).read_text())
    assert found["experiment"]["draws"] == small.DRAWS
    assert set(found["environment"]) >= {"pl_mc", "jax", "jaxlib", "backend", "instruction set", "compiler options"}
    assert found["experiment"]["draws per block"] == 256


@given(file=st.integers(0, PARTS), workers=st.sampled_from([1, 2]))
@settings(max_examples=8)
def test_a_full_disk(finished, file, workers):
    """The file that does not fit is named, those before it are kept; file 0 is the record of the sweep."""
    table, folder = finished
    sync, writes = os.fsync, iter(range(PARTS + 1))

    def full(number):
        if next(writes) >= file:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(number)

    with cut(2), tempfile.TemporaryDirectory() as name:
        here = Path(name, "sweep")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(whole_files.os, "fsync", full)
            with pytest.raises(InputError) as caught:
                small.run(folder=here, workers=workers)
        place = here / (f"part-{file - 1:06d}.parquet" if file else IDENTITY_FILE)
        assert str(caught.value) == (
            f"{place}: it cannot be written (no space left on device); what was finished before is kept and can be "
            "resumed."
        )
        whole = small.contents(folder)
        kept = small.contents(here)
        assert kept.items() <= whole.items()
        assert len(kept) == file
        with small.counted_calls() as calls:
            assert_same(small.run(folder=here, resume=True, workers=workers), table)
        assert len(calls) == 2 * (PARTS - max(file - 1, 0))
        assert small.contents(here) == whole


def test_a_disk_that_is_full_in_earnest(finished, tmp_path):
    table, folder = finished
    here = tmp_path / "disk"
    here.mkdir()
    size = sum(len(content) for content in small.contents(folder).values())

    def mount(*arguments: str) -> None:
        done = subprocess.run(["mount", *arguments, str(here)], capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"no file system can be mounted here ({done.stderr.strip()})")

    mount("-t", "tmpfs", "-o", f"size={size // 2 // 4096 * 4096}", "tmpfs")
    try:
        with cut(2):
            with pytest.raises(InputError, match=r"part-0000\d\d\.parquet: it cannot be written \(no space left on"):
                small.run(folder=here)
            kept = small.contents(here)
            assert 1 < len(kept) < PARTS + 1
            assert kept.items() <= small.contents(folder).items()
            mount("-o", "remount,size=4m", "tmpfs")
            assert_same(small.run(folder=here, resume=True), table)
        assert small.contents(here) == small.contents(folder)
    finally:
        subprocess.run(["umount", str(here)], check=True)


def test_folders_that_cannot_be(tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    for folder, reason in ((file, "file exists"), (file / "below", "not a directory"), (Path("/proc/pl_mc"), "")):
        with cut(2), small.counted_calls() as calls:
            with pytest.raises(InputError, match=rf"{IDENTITY_FILE}: it cannot be written \({reason}.+|$\)"):
                small.run(folder=folder)
            assert calls == []
    with pytest.raises(InputError, match="folder"):
        small.run(resume=True)


def test_resuming_in_an_empty_or_new_folder_starts(finished, tmp_path):
    """So that a script can always ask to resume."""
    table, folder = finished
    with cut(2):
        assert_same(small.run(folder=tmp_path / "new" / "deep", resume=True), table)
        assert small.contents(tmp_path / "new" / "deep") == small.contents(folder)
        with small.counted_calls() as calls:
            by_epoch = small.run(folder=folder, resume=True, by_epoch=True)
        assert calls == []
    assert_same(by_epoch, small.run(by_epoch=True))


MEMORY = """
import sys
sys.path.insert(0, {tests!r})
import numpy as np, pl_mc
from pl_mc.benchmark.scaling_point import peak_memory_bytes
from pl_mc.engine import plan
from reference.problems import random_series

plan.CALLS_PER_PART = 2

def peak(epochs, folder):
    g = random_series(np.random.default_rng(62), np.ones((epochs, 8), dtype=bool), "GGGGGCCC")
    faults = pl_mc.ramp(g, satellite="G01", start_m=10, stop_m=40, step_m=10)
    table = pl_mc.sweep(g, faults, draws=1024, seed=63, methods=("ls",), folder=folder, workers=2)
    assert table["draws"].sum() == 4 * 1024 * epochs
    return peak_memory_bytes() / 2**20

first = peak(256, {folder!r} + "/small")
print(first, peak(256 * 20, {folder!r} + "/large"))
"""


def test_memory_does_not_grow_with_the_number_of_scenarios(tmp_path):
    """1e6 and 2e7 scenarios, in parts of 2e6; the geometry of 5000 epochs, its plan and its counts are 10 MB."""
    program = MEMORY.format(tests=str(TESTS), folder=str(tmp_path))
    # It counts longer than it compiles.
    done = Forked(program, env={name: value for name, value in os.environ.items() if name != "XLA_FLAGS"})
    out, err = done.communicate()
    assert done.returncode == 0, err
    first, second = (float(number) for number in out.split())
    assert len(list((tmp_path / "large").glob("part-*.parquet"))) >= 10
    assert second < 1024
    assert second - first < 150
