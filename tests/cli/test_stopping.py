"""A run that is stopped from outside: a sentence, an exit code of its own, and nothing lost or half-written."""

from __future__ import annotations

import gc
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from pl_mc.cli.main import main
from pl_mc.experiments import output
from pl_mc.experiments.output import result_folder
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import MANIFEST, earlier_place
from pl_mc.runtime.stopping import stoppable
from reference.forked import Forked

# Few solutions, which are compiled soon.
METHODS = 'methods = ["ls", { name = "igg3", iterations = 2 }]'
EXPERIMENT = f"""
kind = "sweep"
title = "A ramp"
{METHODS}
draws = 16000
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

# Whoever started the tests may have asked that signals be ignored.
SIGNALS = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
"""

# Some calls of one block make a part, so that there are many; a slow disk makes time to look.
PROGRAM = (
    SIGNALS
    + """
import os, time
sync = os.fsync
os.fsync = lambda number: [sync(number), time.sleep(float(os.environ.get("SLOW_DISK_S", 0)))]
from pl_mc.engine import plan
plan.SCENARIOS_PER_CALL, plan.CALLS_PER_PART = 1, 4
from pl_mc.cli.main import main
main()
"""
)


def started(folder: Path, *arguments: str, slow_s: float = 0.0) -> Forked:
    (folder / "one.toml").write_text(EXPERIMENT)
    return Forked(PROGRAM, arguments, cwd=folder, env=os.environ | {"SLOW_DISK_S": str(slow_s)})


def wait_for(condition: Callable[[], bool], process: Forked, limit_s: float = 120.0) -> None:
    end = time.monotonic() + limit_s
    while not condition() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_each_signal_keeps_the_parts_and_says_so(tmp_path: Path, number: int, code: int) -> None:
    process = started(tmp_path, "run", "one.toml", "--workers", "1", slow_s=0.3)
    wait_for(lambda: any(tmp_path.glob("runs/one.unfinished/sweep/part-*.parquet")), process)
    process.send_signal(number)
    # A second one, as from a terminal and a parent both, changes nothing.
    process.send_signal(number)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == code
    by = "" if number == signal.SIGINT else f" by {signal.Signals(number).name}"
    assert said.startswith(f"pl-mc: interrupted{by}; ")
    assert "finished parts are kept in runs/one.unfinished, --resume goes on." in said
    assert said.count("\n") == 1
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["one.unfinished"]


def test_ctrl_c_ends_with_130_whenever_it_comes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While modules are loaded, functions are traced and compiled, and scenarios are counted."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    moments = random.Random(65)
    (tmp_path / "one.toml").write_text(EXPERIMENT.replace(METHODS, ""))
    # So many draws that it does not end by itself, however fast the machine.
    program = SIGNALS + "from pl_mc.cli.main import main; main()"
    command = [sys.executable, "-c", program, "run", "one.toml", "--fresh", "--draws", "400000000"]
    for _ in range(4):
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        time.sleep(1.0 + moments.uniform(0.0, 5.0))
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1]
        assert process.returncode == 130, said
        assert said.startswith("pl-mc: interrupted; ")
        assert [path for path in tmp_path.glob("runs/*") if path.name != "one.unfinished"] == []


@pytest.fixture
def interruptible() -> Iterator[None]:
    """A process that was started in the background may ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_that_is_swallowed_comes_again() -> None:
    """Python prints and forgets what is raised in a callback of the garbage collector; JAX has one."""
    came: list[str] = []

    def interrupted(phase: str, info: dict[str, int]) -> None:
        if not came:
            came.append(phase)
            signal.raise_signal(signal.SIGINT)
            # Bytecode at which the signal is seen.
            came.append("never")

    def collected_and_waited() -> None:
        gc.collect()
        threading.Event().wait(30)

    gc.callbacks.append(interrupted)
    try:
        with stoppable() as stops:
            with pytest.raises(KeyboardInterrupt):
                collected_and_waited()
            assert (stops.exit_code, stops.name) == (130, "SIGINT")
    finally:
        gc.callbacks.remove(interrupted)
    assert came == ["start"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_that_comes_while_the_one_before_is_seen_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine a thread takes so long to start that the next signal finds the hook at work still."""
    start, slow = threading.Timer.start, [True]

    def slowly(timer: threading.Timer) -> None:
        start(timer)
        if slow:
            slow.clear()
            end = time.monotonic() + 0.5
            while time.monotonic() < end:
                pass

    def interrupted(phase: str, info: dict[str, int]) -> None:
        if not came:
            came.append(phase)
            signal.raise_signal(signal.SIGINT)

    came: list[str] = []
    monkeypatch.setattr(threading.Timer, "start", slowly)
    gc.callbacks.append(interrupted)
    with stoppable():
        gc.collect()
        with pytest.raises(KeyboardInterrupt):
            threading.Event().wait(30)
    gc.callbacks.remove(interrupted)
    assert (came, slow) == (["start"], [])


def test_an_interrupt_that_a_library_makes_something_else_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(*_: object, **__: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            raise RuntimeError("INTERNAL: error in a callback") from None

    monkeypatch.setattr("pl_mc.cli.main.app", stopped)
    assert "interrupted by SIGTERM; finished parts, where there are any" in said_by(capsys, "run", "ramp", code=143)


def test_signals_that_are_ignored_stay_ignored() -> None:
    """``nohup pl-mc run ...`` goes on when its terminal is gone; other threads leave signals alone."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stoppable():
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.01)
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        found: list[object] = []

        def elsewhere() -> None:
            with stoppable():
                found.append(signal.getsignal(signal.SIGTERM))

        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()
        assert found == [signal.SIG_DFL]
    finally:
        signal.signal(signal.SIGHUP, before)


def test_two_runs_into_one_folder_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second gets a sentence; the lock of one that was killed is nobody's; shares may write together."""
    first = started(tmp_path, "run", "one.toml", slow_s=0.8)
    wait_for(lambda: any(tmp_path.glob("runs/one.unfinished/sweep/part-*.parquet")), first)
    monkeypatch.chdir(tmp_path)
    said = said_by(capsys, "run", "one.toml", "--resume", code=2)
    assert f"runs/one: another run is writing there (process {first.pid}); wait for its end, or" in said
    assert "another run is writing there" in said_by(capsys, "run", "one.toml", "--shard", "1/2", code=2)
    first.kill()
    first.communicate()
    assert len(list((tmp_path / "runs").iterdir())) > 1
    shares = [started(tmp_path, "run", "one.toml", "--shard", f"{k}/2", "-q") for k in (1, 2)]
    for share in shares:
        said = share.communicate(timeout=120)[1]
        assert share.returncode == 0, said
    done = started(tmp_path, "run", "one.toml", "--resume", "-q")
    assert done.communicate(timeout=120)[0] == "runs/one\n"
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["one"]


REPLACING = """
import os, sys
from pathlib import Path
from pl_mc.experiments.output import result_folder

renames = int(sys.argv[2])
replace = os.replace

def killed(source, target):
    global renames
    if Path(target).name.endswith("one") or Path(target).name.endswith(".earlier"):
        if renames == 0:
            os.kill(os.getpid(), 9)
        renames -= 1
    replace(source, target)

os.replace = killed
with result_folder(Path(sys.argv[1])) as working:
    (working / "manifest.json").write_text("new")
    if renames == 0:
        os.kill(os.getpid(), 9)
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize(("renames", "left"), [(0, "old"), (1, "new"), (2, "new")])
def test_killed_while_a_result_is_replaced(tmp_path: Path, renames: int, left: str) -> None:
    """Before, between and after the two renames; the next run finds what there is and removes the rest."""
    folder = tmp_path / "one"
    folder.mkdir()
    (folder / MANIFEST).write_text("old")
    done = Forked(REPLACING, [str(folder), str(renames)])
    done.communicate()
    assert done.returncode == -signal.SIGKILL
    assert folder.exists() == (renames != 1)
    if renames == 1:
        with pytest.raises(SystemExit):
            main(["report", str(folder)])
    said: list[str] = []
    with suppress(RuntimeError), result_folder(folder, said=said):
        assert (folder / MANIFEST).read_text() == left
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["one"]
    assert (folder / MANIFEST).read_text() == left
    assert said == ([f"{folder}: a run was ended while it put its results here; they are in their place now."]
                    if renames == 1 else [])  # fmt: skip


def test_a_result_that_is_being_replaced_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    earlier_place(tmp_path / "one").mkdir()
    with pytest.raises(SystemExit):
        main(["report", str(tmp_path / "one")])
    assert "a run was ended while it replaced this result, which is in " in capsys.readouterr().err


def test_an_interrupt_between_the_renames_leaves_no_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, replace = tmp_path / "one", os.replace
    folder.mkdir()
    (folder / MANIFEST).write_text("old")

    def stopped(source: Path, target: Path) -> None:
        replace(source, target)
        if Path(target) == earlier_place(folder):
            monkeypatch.setattr(output.os, "replace", replace)
            raise KeyboardInterrupt

    monkeypatch.setattr(output.os, "replace", stopped)
    with pytest.raises(KeyboardInterrupt), result_folder(folder) as working:
        (working / MANIFEST).write_text("new")
    assert (folder / MANIFEST).read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["one"]


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.toml").write_text(EXPERIMENT.replace("16000", "300"))
    return tmp_path


def said_by(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> str:
    """What a command says: on standard output, or on standard error where it must end with a code."""
    if code == 0:
        main(arguments)
        return capsys.readouterr().out
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == code
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    return err


def test_resuming_a_finished_run(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It ends at once, says so, and changes nothing; of another experiment it says what differs."""
    said_by(capsys, "run", "one.toml")
    before = {path: path.stat().st_mtime_ns for path in (small / "runs").rglob("*")}
    again = said_by(capsys, "run", "one.toml", "--resume")
    assert again.startswith("runs/one: this run was finished before, and nothing was counted; without --resume")
    assert "# A ramp" in again
    found = json.loads(said_by(capsys, "run", "one.toml", "--resume", "--json"))
    assert "nothing was counted" in found["notes"][0]
    assert len(found["answer"]) == 3
    other = said_by(capsys, "run", "one.toml", "--resume", "--draws", "400", code=2)
    assert "of another experiment (draws: 300 before, 400 now); without --resume it is replaced" in other
    assert {path: path.stat().st_mtime_ns for path in (small / "runs").rglob("*")} == before
    said_by(capsys, "run", "one.toml", "--draws", "400")
    assert "finished" in said_by(capsys, "run", "one.toml", "--resume", "--draws", "400")


@pytest.mark.parametrize("name", ["report.json", "summary.md", "rates.csv", "rates.png", MANIFEST])
def test_a_finished_run_that_has_changed_is_not_handed_back(
    small: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """Other digits were handed back as the result; what somebody has removed is another matter."""
    said_by(capsys, "run", "one.toml")
    place = small / "runs" / "one" / name
    content = place.read_bytes()
    # In the manifest, of its notes: the experiment is compared by its fields.
    at = content.index(b"0", content.find(b'"notes"') + 1)
    place.write_bytes(content[:at] + b"9" + content[at + 1 :])
    said = said_by(capsys, "run", "one.toml", "--resume", code=2)
    assert f"runs/one/{name}: it is not what the run wrote; without --resume the run is counted anew" in said
    place.write_bytes(content)
    assert "nothing was counted" in said_by(capsys, "run", "one.toml", "--resume")
    if name != MANIFEST:
        place.unlink()
        assert "nothing was counted" in said_by(capsys, "run", "one.toml", "--resume")
    else:
        # A run of a version that wrote none.
        fields = json.loads(content)
        place.write_text(json.dumps({field: fields[field] for field in fields if field not in ("files", "sha256")}))
        assert "nothing was counted" in said_by(capsys, "run", "one.toml", "--resume")


def test_a_share_that_has_nothing_to_do(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said_by(capsys, "run", "one.toml", "--shard", "1/2", "--out", "first")
    said = said_by(capsys, "run", "one.toml", "--shard", "2/2", "--out", "second")
    assert "Shard 2 of 2: there are fewer parts, none for this one; pl-mc merge makes the results." in said
    assert said.splitlines()[-1] == "Results: second.unfinished"
    assert (small / "second.unfinished").is_dir()
    assert "A ramp" in said_by(capsys, "merge", "first", "second", "--out", "whole")


@pytest.mark.parametrize(
    "damage", [lambda t: b"", lambda t: t[: len(t) // 2], lambda t: t.replace(b"300", b"301"), lambda t: b"[]"]
)
def test_a_damaged_record_costs_no_part(
    small: Path, capsys: pytest.CaptureFixture[str], damage: Callable[[bytes], bytes]
) -> None:
    said_by(capsys, "run", "one.toml", "--shard", "1/1")
    record = small / "runs" / "one.unfinished" / "experiment.json"
    sound = record.read_bytes()
    record.write_bytes(damage(sound))
    assert "it was damaged" in said_by(capsys, "run", "one.toml", "--shard", "1/1")
    assert record.read_bytes() == sound
    record.write_bytes(damage(sound))
    assert "experiment.json: it was damaged and was written anew." in said_by(capsys, "run", "one.toml", "--resume")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """The manifest of a finished run."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "one.toml").write_text(EXPERIMENT.replace("16000", "300"))
    main(("run", str(folder / "one.toml"), "--out", str(folder / "made")))
    return json.loads((folder / "made" / MANIFEST).read_text())


@pytest.mark.parametrize(
    "name", ["/elsewhere/x", "../../x", "..", ".", "", " ", ".hidden", None, 3, ["a"], {"a": 1}, "a\0b", "a\nb",
             "x" * 300, "\ud800", "a\\b"],
)  # fmt: skip
def test_the_name_in_a_manifest_is_that_of_one_folder(
    small: Path, made: dict, capsys: pytest.CaptureFixture[str], name: object
) -> None:
    (small / "strange.json").write_text(json.dumps(made | {"name": name}))
    assert "name: " in said_by(capsys, "run", "strange.json", code=2)
    assert sorted(path.name for path in small.iterdir()) == ["one.toml", "strange.json"]


def test_usual_names_are_taken(small: Path, made: dict, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("Fälle 2024 (a&b)", "x" * 200, "v1.2"):
        (small / "usual.json").write_text(json.dumps(made | {"name": name}))
        assert said_by(capsys, "run", "usual.json", "-q") == f"runs/{name}\n"


def test_a_folder_can_have_no_zero_byte(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no name of a file can" in said_by(capsys, "run", "one.toml", "--out", "a\0b", code=2)
    with pytest.raises(InputError, match="cannot be the name of a folder"), result_folder(Path("a\0b")):
        pass
