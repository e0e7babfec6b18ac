"""Parts on the workers of a Dask cluster: the table of this process, whatever happens to a worker."""

from __future__ import annotations

import builtins
import os
import signal
import threading
import time
from collections.abc import Iterator

import dask
import pandas as pd
import pytest
from distributed import Client, LocalCluster

from pl_mc.engine import dask_adapter
from pl_mc.engine import part_task as identity
from pl_mc.input_errors import InputError
from reference import small_sweep as small
from reference.forked import Forked
from reference.small_sweep import assert_same, cut

METHODS = ("ls",)


@pytest.fixture(scope="module")
def expected() -> pd.DataFrame:
    return small.run(methods=METHODS, workers=1)


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Two processes that know nothing of this one, as on other machines: of a server that has loaded Dask alone."""
    with (
        dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}),
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", silence_logs=50
        ) as cluster,
    ):
        yield cluster


def test_processes_of_this_machine(expected, tmp_path):
    with cut(2):
        table = small.run(methods=METHODS, scheduler="local:2", folder=tmp_path)
        assert_same(table, expected)
        # What they counted is stored here, and is what this process would have counted.
        with small.counted_calls() as calls:
            assert_same(small.run(methods=METHODS, folder=tmp_path, resume=True), expected)
        assert calls == []


def test_a_scheduler_at_an_address(cluster, expected):
    with cut(2):
        assert_same(small.run(methods=METHODS, scheduler=cluster.scheduler_address), expected)
        # More parts than are in flight at once, and fewer.
        with cut(1):
            assert_same(small.run(methods=METHODS, scheduler=cluster.scheduler_address, workers=2), expected)
        with cut(30):
            assert_same(small.run(methods=METHODS, scheduler=cluster.scheduler_address), expected)


def test_only_what_is_missing_is_sent(cluster, expected, tmp_path):
    with cut(2):
        small.run(methods=METHODS, folder=tmp_path, shard=(1, 2))
        first = small.contents(tmp_path)
        table = small.run(methods=METHODS, scheduler=cluster.scheduler_address, folder=tmp_path, resume=True)
        assert_same(table, expected)
        assert first.items() <= small.contents(tmp_path).items()
        assert len(small.contents(tmp_path)) == 13


def test_a_worker_that_dies_costs_time_alone(cluster, expected, tmp_path):
    """One is killed after the first part was stored; many are still to come."""
    with Client(cluster) as client:
        victims = sorted(client.run(os.getpid).values())
    assert len(victims) == 2
    assert os.getpid() not in victims
    killed = []

    def kill() -> None:
        limit = time.monotonic() + 100
        while time.monotonic() < limit:
            if list(tmp_path.glob("part-*.parquet")):
                os.kill(victims[0], signal.SIGKILL)
                killed.append(len(list(tmp_path.glob("part-*.parquet"))))
                return
            time.sleep(0.002)

    thread = threading.Thread(target=kill)
    thread.start()
    with cut(1):
        table = small.run(methods=METHODS, scheduler=cluster.scheduler_address, folder=tmp_path)
    thread.join()
    assert_same(table, expected)
    assert 1 <= killed[0] < 24
    with Client(cluster) as client:
        assert victims[0] not in client.run(os.getpid).values()


def test_when_all_workers_are_gone_it_ends(tmp_path, monkeypatch):
    """Workers of a scheduler that starts none anew: a sentence within half a minute, and the parts are kept."""
    monkeypatch.setattr(dask_adapter, "LONELY_S", 3.0)
    program = "import runpy\nrunpy.run_module('distributed.cli.dask_worker', run_name='__main__')"
    options = ("--no-nanny", "--nthreads", "1", "--no-dashboard")
    with (
        LocalCluster(
            n_workers=0, processes=False, protocol="tcp", dashboard_address="127.0.0.1:0", silence_logs=50
        ) as empty,
        Client(empty) as client,
        open(os.devnull, "wb") as nowhere,
    ):
        quiet = {"stdout": nowhere, "stderr": nowhere}
        both = [Forked(program, [*options, empty.scheduler_address], **quiet) for _ in range(2)]
        client.wait_for_workers(2, timeout=60)
        ended = []

        def kill() -> None:
            limit = time.monotonic() + 100
            while time.monotonic() < limit and not list(tmp_path.glob("part-*.parquet")):
                time.sleep(0.002)
            for process in both:
                process.kill()
            ended.append(time.monotonic())

        thread = threading.Thread(target=kill)
        thread.start()
        with cut(1), pytest.raises(InputError, match=r"all its workers are gone, .* is kept and can be resumed\."):
            small.run(methods=METHODS, scheduler=empty.scheduler_address, folder=tmp_path)
        thread.join()
        assert time.monotonic() - ended[0] < 30
        assert list(tmp_path.glob("part-*.parquet"))
        for process in both:
            process.wait()


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (OSError("Timed out trying to connect"), "workers were lost while they were asked .*Timed out"),
        (ModuleNotFoundError("No module named 'pl_mc'"), r"its workers need pl_mc \S+ installed .No module"),
    ],
)
def test_what_workers_say_of_their_versions(said, words):
    class Asked:
        def run(self, function, on_error):
            assert on_error == "return"
            return {"tcp://one": said}

    with pytest.raises(InputError, match=words):
        dask_adapter._require_equal_workers(Asked(), identity.environment())


def test_a_worker_that_is_lost_while_it_is_asked_counts_nothing():
    class Asked:
        def run(self, function, on_error):
            return {"tcp://one": OSError("gone"), "tcp://two": identity.environment()}

    dask_adapter._require_equal_workers(Asked(), identity.environment())


def test_workers_of_another_environment_are_refused(cluster, monkeypatch):
    other = identity.environment() | {"jax": "0.0.1"}
    there = r"would count in another environment \(jax \S+ there, 0\.0\.1 here\)"
    with Client(cluster) as client, pytest.raises(InputError, match=rf"worker tcp://\S+ {there}"):
        dask_adapter._require_equal_workers(client, other)
    # One that came later finds out when it is given a part.
    monkeypatch.setattr(dask_adapter, "environment", lambda: other)
    with pytest.raises(InputError, match=rf"the worker that was given a part {there}"):
        small.run(methods=METHODS, scheduler=cluster.scheduler_address)


def test_a_scheduler_without_workers():
    with (
        LocalCluster(
            n_workers=0, processes=False, protocol="tcp", dashboard_address="127.0.0.1:0", silence_logs=50
        ) as empty,
        pytest.raises(InputError, match=r"scheduler: it has no workers; start some with dask worker\."),
    ):
        small.run(methods=METHODS, scheduler=empty.scheduler_address)


def test_no_scheduler_answers(monkeypatch, tmp_path):
    monkeypatch.setattr(dask_adapter, "PATIENCE", "1s")
    start = time.monotonic()
    with pytest.raises(InputError, match=r"scheduler: no scheduler answers at tcp://127\.0\.0\.1:9 \(") as caught:
        small.run(methods=METHODS, scheduler="tcp://127.0.0.1:9")
    assert time.monotonic() - start < 15
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"scheduler: no scheduler answers at tls://127\.0\.0\.1:9 \("):
        small.run(methods=METHODS, scheduler="tls://127.0.0.1:9")


@pytest.mark.parametrize(
    "scheduler",
    ["nonsense", "tcp://", "tcp://host", "tcp://host:port", "tcp://host:99999", "host:8786", "http://host:1",
     "tcp://[", "local:", "local:x", "local:0", "local:-1", "localhost", ""],
)  # fmt: skip
def test_addresses_that_are_none(scheduler):
    with pytest.raises(InputError, match=r"^scheduler: .* is needed|^scheduler: local:N needs") as caught:
        small.run(methods=METHODS, scheduler=scheduler)
    assert repr(scheduler) in str(caught.value)


@pytest.mark.parametrize("scheduler", ["local:2", "tcp://host:8786"])
def test_without_dask(monkeypatch, scheduler):
    imported = builtins.__import__

    def missing(name, *rest, **options):
        if name.partition(".")[0] in ("dask", "distributed"):
            raise ModuleNotFoundError(f"No module named {name!r}")
        return imported(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"Dask is not installed; pip install 'pl_mc\[dask\]' brings it\."):
        small.run(methods=METHODS, scheduler=scheduler)


def test_nothing_is_started_where_nothing_is_missing(expected, tmp_path):
    with cut(2):
        small.run(methods=METHODS, folder=tmp_path)
        table = small.run(methods=METHODS, folder=tmp_path, resume=True, scheduler="tcp://127.0.0.1:9")
    assert_same(table, expected)
