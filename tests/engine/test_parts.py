"""Parts of a sweep: any cut, order and share gives the same counts; their files say whether they are whole."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pl_mc
from pl_mc.engine import part_task as identity
from pl_mc.engine.checkpoint_store import BadPart, CheckpointStore, is_whole, read_rows
from pl_mc.engine.table import FaultTotals, fault_table
from pl_mc.engine.task import SweepTask
from pl_mc.input_errors import InputError
from pl_mc.kernels.noise import LANES
from reference import small_sweep as small
from reference.damage import FORGED_ROWS, FORGED_WORDS, forged
from reference.small_sweep import COUNTS, assert_same, cut

# Bits, across threads, parts and processes: as users compile.
pytestmark = pytest.mark.optimised


@pytest.fixture(scope="module")
def whole() -> pd.DataFrame:
    """The sweep in one part, computed by one thread."""
    return small.run(workers=1)


@pytest.fixture(scope="module")
def by_epoch() -> pd.DataFrame:
    return small.run(workers=1, by_epoch=True)


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    """A folder with the parts of three calls each."""
    folder = tmp_path_factory.mktemp("stored")
    with cut(3):
        small.run(folder=folder)
    return folder


@given(
    per_call=st.sampled_from([4 * LANES, 26 * LANES, 2**20]),
    per_part=st.integers(1, 30),
    workers=st.sampled_from([1, 2, 5, None]),
    kept=st.booleans(),
)
@settings(max_examples=12)
def test_any_cut_into_parts(whole, per_call, per_part, workers, kept):
    with cut(per_part, per_call), tempfile.TemporaryDirectory() as folder:
        assert_same(small.run(workers=workers, folder=folder if kept else None), whole)
        if kept:
            # And once more from the files alone.
            assert_same(small.run_stored(Path(folder)), whole)


def test_the_parts_are_many_and_cut_through_epochs():
    with cut(5):
        plan = small.task().plan
        parts = [list(plan.chunks(number)) for number in range(plan.part_count)]
    assert [len(chunks) for chunks in parts] == [5, 5, 5, 5, 4]
    assert len({chunk for chunks in parts for chunk in chunks}) == plan.chunk_count == 24
    assert any(chunks[0].first_block > 0 and chunks[-1].first_epoch > chunks[0].first_epoch for chunks in parts)


@given(order=st.permutations(range(8)), threads=st.sampled_from([1, 3]))
@settings(max_examples=10)
def test_any_order_of_parts(whole, order, threads):
    with cut(3):
        task = small.task()
        totals = FaultTotals.of(task)
        for part in task.count_parts(order, threads=threads):
            totals.add(task, part)
    assert_same(fault_table(task, totals), whole)


def test_what_is_written_is_read(stored):
    with cut(3):
        task = small.task()
        store = CheckpointStore(stored, task, resume=True)
        assert store.stored() == list(range(8))
        for part in task.count_parts(range(8), threads=1):
            found = store.read(part.number)
            assert found.number == part.number
            for name in ("places", "draws", "counts"):
                np.testing.assert_array_equal(getattr(found, name), getattr(part, name))
    assert store.elsewhere == []


def test_every_changed_byte_and_every_truncation_is_known(stored, tmp_path):
    content = (stored / "part-000002.parquet").read_bytes()
    assert is_whole(content)
    rng = np.random.default_rng(60)
    for k in range(len(content)):
        changed = bytearray(content)
        changed[k] ^= int(rng.integers(1, 256))
        assert not is_whole(bytes(changed)), k
        assert not is_whole(content[:k]), k
    with cut(3):
        store = CheckpointStore(tmp_path, small.task(), resume=True)
        place = tmp_path / "part-000002.parquet"
        place.write_bytes(content)
        store.read(2)
        for changed in (content + b"\0", content + content, content[:-1], b""):
            place.write_bytes(changed)
            with pytest.raises(BadPart, match=r"part-000002\.parquet: it is not what was written"):
                store.read(2)


def test_whole_files_of_another_place_are_known(stored, tmp_path, monkeypatch):
    with cut(3):
        store = CheckpointStore(tmp_path, small.task(), resume=True)
        shutil.copy(stored / "part-000001.parquet", tmp_path / "part-000002.parquet")
        with pytest.raises(BadPart, match=r"part-000002\.parquet: it holds part 1"):
            store.read(2)
        small.run(folder=tmp_path / "other", seed=52)
        shutil.copy(tmp_path / "other" / "part-000003.parquet", tmp_path)
        with pytest.raises(BadPart, match="another sweep"):
            store.read(3)
        (tmp_path / "part-000004.parquet").mkdir()
        with pytest.raises(BadPart, match=r"part-000004\.parquet: it is no regular file"):
            store.read(4)
        # A pipe without a writer would be waited for.
        os.mkfifo(tmp_path / "part-000005.parquet")
        with pytest.raises(BadPart, match=r"part-000005\.parquet: it is no regular file"):
            store.read(5)
        shutil.copy(stored / "part-000000.parquet", tmp_path)
        there = identity.environment() | {"jaxlib": "0.0.1"}
        monkeypatch.setattr(identity, "environment", lambda: there)
        with pytest.raises(BadPart, match=r"another environment \(jaxlib: .* before, 0\.0\.1 now\)"):
            CheckpointStore(tmp_path, small.task(), resume=True).read(0)


@pytest.mark.parametrize("kind", FORGED_WORDS)
def test_what_a_part_says_of_itself_is_read_with_care(stored, whole, tmp_path, kind):
    """An environment that was no table ended in a trace."""
    shutil.copytree(stored, tmp_path, dirs_exist_ok=True)
    place = tmp_path / "part-000002.parquet"
    place.write_bytes(forged(place.read_bytes(), words=FORGED_WORDS[kind]))
    with cut(3):
        table = small.run(folder=tmp_path, resume=True)
    assert_same(table, whole)
    (note,) = [note for note in table.attrs["notes"] if place.name in note]
    assert note.endswith("; it was counted again.")


@pytest.mark.parametrize("kind", FORGED_ROWS)
def test_forged_parts_are_held_against_the_plan(stored, whole, tmp_path, kind):
    """With a checksum that is right and the task named: everything but the counts is known beforehand."""
    shutil.copytree(stored, tmp_path, dirs_exist_ok=True)
    place = tmp_path / "part-000002.parquet"
    place.write_bytes(forged(place.read_bytes(), FORGED_ROWS[kind]))
    assert is_whole(place.read_bytes())
    with cut(3):
        with pytest.raises(BadPart, match=r"part-000002\.parquet: not a part as this version writes it \("):
            CheckpointStore(tmp_path, small.task(), resume=True).read(2)
        table = small.run(folder=tmp_path, resume=True)
    assert_same(table, whole)
    assert "part-000002.parquet: not a part" in " ".join(table.attrs["notes"])


def test_texts_are_compared_however_they_are_stored(stored, tmp_path):
    """Labels of which two are the same cannot be categories."""
    place = tmp_path / "part-000002.parquet"
    with cut(3):
        store = CheckpointStore(tmp_path, small.task(), resume=True)
        shutil.copy(stored / place.name, tmp_path)
        written = store.read(2)
        place.write_bytes(forged(place.read_bytes(), lambda rows: rows.astype({"fault": object, "method": object})))
        np.testing.assert_array_equal(store.read(2).counts, written.counts)


def test_rows_of_parts_add_up_to_the_table(stored, whole, by_epoch):
    rows = pd.concat(list(read_rows(stored))).astype({"fault": object, "method": object})
    assert list(rows.columns) == ["epoch", "fault", "bias_m", "method", "draws", *COUNTS]
    keys = ["method", "fault"]
    summed = rows.groupby(keys, sort=False)[["draws", *COUNTS]].sum()
    expected = whole.set_index(keys)[["draws", *COUNTS]]
    pd.testing.assert_frame_equal(summed.loc[expected.index], expected)

    keys = ["epoch", "method", "fault"]
    summed = rows.groupby(keys, sort=False)[["draws", *COUNTS]].sum()
    expected = by_epoch.set_index(keys)[["draws", *COUNTS]]
    pd.testing.assert_frame_equal(summed.loc[expected.index], expected)
    assert len(summed) == len(expected)
    # Several of the parts cut an epoch in two, which gives it rows in both.
    assert len(rows) > len(expected)


def test_table_by_epoch_adds_up_to_the_table(whole, by_epoch):
    summed = by_epoch.groupby(["method", "fault"], sort=False)[["draws", *COUNTS]].sum()
    expected = whole.set_index(["method", "fault"])
    pd.testing.assert_frame_equal(summed.loc[expected.index], expected[["draws", *COUNTS]])
    epochs = by_epoch.groupby(["method", "fault"], sort=False).size()
    np.testing.assert_array_equal(epochs.loc[expected.index], expected["epochs"])
    assert set(expected["epochs"]) == {1, 3, 4}
    np.testing.assert_array_equal(expected["draws"], small.DRAWS * expected["epochs"])


def test_any_reader_sees_a_folder_as_one_table(stored):
    together = pd.read_parquet(stored)
    expected = pd.concat(list(read_rows(stored)), ignore_index=True)
    pd.testing.assert_frame_equal(together, expected)
    assert together["fault"].dtype == "category"
    assert list(together["fault"].cat.categories) == list(small.FAULTS.labels)


@given(data=st.data(), count=st.integers(1, 11), apart=st.booleans())
@settings(max_examples=8)
def test_shards_make_the_whole(whole, data, count, apart):
    order = data.draw(st.permutations(range(1, count + 1)))
    with cut(3), tempfile.TemporaryDirectory() as place:
        gathered = Path(place, "gathered")
        tables = []
        for index in order:
            folder = Path(place, str(index)) if apart else gathered
            tables.append(small.run(folder=folder, shard=(index, count)))
            assert f"Shard {index} of {count}: the counts of its share alone." in tables[-1].attrs["notes"]
            if apart:
                shutil.copytree(folder, gathered, dirs_exist_ok=True)
        with small.counted_calls() as calls:
            assert_same(small.run_stored(gathered), whole)
        assert calls == []
        # The tables of the shares add up as well.
        summed = pd.concat(tables).groupby(["method", "fault"], sort=False)[["draws", *COUNTS]].sum()
        expected = whole.set_index(["method", "fault"])[["draws", *COUNTS]]
        pd.testing.assert_frame_equal(summed.loc[expected.index], expected)
        assert all((table["epochs"] <= 4).all() and (table["draws"] > 0).all() for table in tables)


def test_the_table_of_a_share_tells_its_own_epochs(tmp_path):
    with cut(6):  # One part for each epoch.
        table = small.run(folder=tmp_path, shard=(4, 4))
    # C06 is out of view at the last epoch.
    assert set(table["fault"]) == {"none", "G01:+40m", "C07:+70m"}
    assert set(table["epochs"]) == {1}
    assert set(table["draws"]) == {small.DRAWS}


def test_missing_shards_are_named(tmp_path):
    with cut(3):
        for index in (1, 3):
            small.run(folder=tmp_path, shard=(index, 3))
        before = small.contents(tmp_path)
        with pytest.raises(InputError, match=r"part 1, 4, 7 of 8 \(counted from 0\) is missing or damaged"):
            small.run_stored(tmp_path)
        small.run(folder=tmp_path, shard=(2, 3))
        place = tmp_path / "part-000004.parquet"
        place.write_bytes(place.read_bytes()[:-1])
        with pytest.raises(InputError, match=r"part 4 of 8 .* damaged \(.*part-000004\.parquet: it is not what"):
            small.run_stored(tmp_path)
        assert before.items() <= small.contents(tmp_path).items()
        with pytest.raises(InputError, match=r"part 0, 1, 2, 3, 4, 5, 6, 7 of 8 .* is missing"):
            small.run_stored(tmp_path / "nowhere")
        assert not (tmp_path / "nowhere").exists()


def test_more_shards_than_parts(tmp_path, whole):
    """Shards beyond the parts have nothing to do, and say so by an empty table."""
    with cut(12):
        tables = [small.run(folder=tmp_path, shard=(index, 5)) for index in range(1, 6)]
        assert [len(table) > 0 for table in tables] == [True, True, False, False, False]
        assert list(tables[4].columns) == list(whole.columns)
        assert_same(small.run_stored(tmp_path), whole)


def test_a_shard_needs_no_resume_for_the_parts_of_others(tmp_path):
    with cut(3):
        small.run(folder=tmp_path, shard=(1, 2))
        small.run(folder=tmp_path, shard=(2, 2))
        with pytest.raises(InputError, match=r"4 finished parts of an earlier run are here; resume it"):
            small.run(folder=tmp_path, shard=(2, 2))
        with pytest.raises(InputError, match=r"seed: 51 before, 52 now"):
            small.run(folder=tmp_path, shard=(2, 3), seed=52, resume=True)


@pytest.mark.parametrize(
    "shard", [(0, 2), (3, 2), (1, 0), (1.5, 2), (True, 2)], ids=["zeroth", "beyond", "none", "half", "truth"]
)
def test_shards_that_are_none(tmp_path, shard):
    with pytest.raises(InputError, match=r"shard: .* a whole number"):
        small.run(folder=tmp_path, shard=shard)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="folder"):
        small.run(shard=(1, 2))


@pytest.mark.parametrize("apart", [False, True], ids=["one folder", "folders"])
def test_shards_of_another_machine(tmp_path, whole, monkeypatch, apart):
    """Its parts are merged, with a note; to resume with them is refused."""
    here = identity.environment()
    # No processor has these, so that the other machine is another one wherever the test runs.
    there = here | {"instruction set": "another machine's", "compiler options": {"xla_of_that_machine": 1}}
    folders = [tmp_path / name for name in ("first", "second" if apart else "first")]
    with cut(3):
        small.run(folder=folders[0], shard=(1, 2))
        monkeypatch.setattr(identity, "environment", lambda: there)
        small.run(folder=folders[1], shard=(2, 2))
        monkeypatch.setattr(identity, "environment", lambda: here)
        for order in (folders, folders[::-1]):
            gathered = tmp_path / f"gathered-{order[0].name}"
            for folder in order:
                for path in folder.iterdir():
                    if not (gathered / path.name).exists():
                        gathered.mkdir(exist_ok=True)
                        shutil.copy(path, gathered)
            before = small.contents(gathered)
            table = small.run_stored(gathered)
            assert_same(table, whole)
            (note,) = [note for note in table.attrs["notes"] if "another environment" in note]
            assert "instruction set: another machine's before" in note
            assert small.contents(gathered) == before
        # The share itself does not go on with what another machine left of it: it counts that again.
        with small.counted_calls() as calls:
            table = small.run(folder=gathered, shard=(2, 2), resume=True)
        assert len(calls) == 12
        assert sum("counted in another environment" in note for note in table.attrs["notes"]) == 4
        assert not any("another environment" in note for note in small.run_stored(gathered).attrs["notes"])


def test_resuming_on_another_machine_is_refused(tmp_path, monkeypatch):
    with cut(3):
        small.run(folder=tmp_path)
        before = small.contents(tmp_path)
        there = identity.environment() | {"instruction set": "aarch64 asimd"}
        monkeypatch.setattr(identity, "environment", lambda: there)
        with pytest.raises(InputError, match=r"cannot be resumed \(instruction set: .* before, aarch64 asimd now\)"):
            small.run(folder=tmp_path, resume=True)
        assert small.contents(tmp_path) == before


def test_identity_tells_what_can_move_a_bit_and_nothing_else(monkeypatch):
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    plain = identity.environment()
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=2")
    assert identity.environment() == plain
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_force_host_platform_device_count=2")
    assert identity.differences({"environment": plain}, {"environment": identity.environment()}) == [
        "compiler flags: [] before, ['--xla_cpu_use_fusion_emitters=false'] now"
    ]
    first, second = identity.identity_of(small.task()), identity.identity_of(small.task())
    assert identity.differences(first, second) == []
    assert identity.fingerprint(first["experiment"]) == identity.fingerprint(second["experiment"])


def test_a_folder_for_one_epoch(tmp_path):
    """A single epoch is stored as a series of one."""
    one = small.SERIES[0]
    faults = pl_mc.Faults.from_array(one, small.FAULTS.bias_m)

    def sweep(**options):
        return pl_mc.sweep(one, faults, draws=small.DRAWS, seed=small.SEED, methods=small.METHODS, **options)

    with cut(9):
        table = sweep(folder=tmp_path)
        assert sorted(path.name for path in tmp_path.iterdir()) == [SweepTask.kind.record, "part-000000.parquet"]
        assert_same(sweep(folder=tmp_path, resume=True), table)
    rows = pd.read_parquet(tmp_path).set_index(["method", "fault"])
    for row in table.itertuples():
        assert rows.loc[(row.method, row.fault), "alarms"] == row.alarms
