"""README and the pages of the site: their Python runs, their commands can be read, their links and numbers hold."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import pl_mc
from pl_mc.cli.main import app

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]
DATA = "PL_MC_DATA"


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[Path, list[str]], None]:
    """Runs blocks of a page, each going on where the one before ended; in README every block stands alone.

    Files that they write are gone with the test.
    """
    if DATA in os.environ:
        monkeypatch.setenv(DATA, str(Path(os.environ[DATA]).absolute()))
    monkeypatch.chdir(tmp_path)

    def run(path: Path, sources: list[str]) -> None:
        # A module of its own, since records look up the one that they are defined in.
        module = ModuleType("page")
        monkeypatch.setitem(sys.modules, "page", module)
        for source in sources:
            names = {"__name__": "page"} if path.parent == ROOT else vars(module)
            exec(compile(source, name_of(path), "exec"), names)

    return run


def with_blocks(language: str, *, of_data: bool = False) -> list[Path]:
    return [path for path in DOCUMENTS if any((DATA in block) == of_data for block in blocks(path, language))]


# They make tens of thousands of draws with one program.
LONG = (ROOT / "README.md", DOCS / "tutorial.md")


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.counting if path in LONG else ()) for path in with_blocks("python")],
    ids=name_of,
)
def test_python_runs(path: Path, page: Any, capsys: pytest.CaptureFixture[str]) -> None:
    page(path, [block for block in blocks(path, "python") if DATA not in block])
    # What is behind the guard of a script runs below.
    assert capsys.readouterr().out or '__name__ == "__main__"' in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", with_blocks("python", of_data=True), ids=name_of)
def test_python_on_receiver_data_runs(
    path: Path, page: Any, data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page(path, [block for block in blocks(path, "python") if DATA in block])
    assert "igg3" in capsys.readouterr().out


@pytest.mark.counting
def test_the_script_for_a_cluster(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Its processes are started in tests/engine/test_dask.py; here the same sweep runs without them."""
    (source,) = blocks(DOCS / "how-to" / "cluster.md", "python")
    sweep, asked = pl_mc.sweep, []

    def here(*args: Any, scheduler: str, **options: Any) -> Any:
        asked.append(scheduler)
        return sweep(*args, **options)

    monkeypatch.setattr(pl_mc, "sweep", here)
    exec(compile(source, "cluster.md", "exec"), {"__name__": "__main__"})
    assert asked == ["local:2"]
    assert "G01:+100m" in capsys.readouterr().out


@pytest.mark.parametrize("path", with_blocks("console"), ids=name_of)
def test_commands_can_be_read(path: Path) -> None:
    lines = [line for block in blocks(path, "console") for line in block.splitlines()]
    assert lines
    for line in lines:
        # A line may end in a comment, or go on after &&.
        for command in re.split(r"\s&&\s|\s\|\s", line.split("  #")[0]):
            words = shlex.split(command)
            if words and words[0].endswith("pl-mc"):
                app.parse_args(words[1:], exit_on_error=False, print_error=False)


@pytest.mark.parametrize("path", DOCUMENTS, ids=name_of)
def test_blocks_and_links(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    fences = re.findall(r"^```(.*)$", text, flags=re.MULTILINE)
    assert all(fences[0::2]), "a block without a language"
    assert not any(fences[1::2])
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)):
        assert (path.parent / target.split("#")[0]).exists(), target


def test_every_test_that_the_theory_names_exists() -> None:
    named = set(re.findall(r"`(test_\w+)`", (DOCS / "theory.md").read_text(encoding="utf-8")))
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    assert named
    assert named <= set(re.findall(r"def (test_\w+)", sources))


def test_how_exact_a_check_is_stands_in_it() -> None:
    section = (DOCS / "theory.md").read_text(encoding="utf-8").split("## How exact the checks are")[1].split("\n## ")[0]
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    bodies: dict[str, str] = {}
    for name, body in re.findall(r"^def (test_\w+)\((.*?)(?=^def |^@|\Z)", sources, re.MULTILINE | re.DOTALL):
        bodies[name] = bodies.get(name, "") + body
    rows = re.findall(r"\| ([\d.e-]+) \| `(test_\w+)` \|$", section, re.MULTILINE)
    assert len(rows) > 25
    for tolerance, name in rows:
        assert re.search(rf"(?<![\d.]){re.escape(tolerance)}\b", bodies[name]), (name, tolerance)


def test_every_method_is_in_the_theory_and_the_reference() -> None:
    theory = (DOCS / "theory.md").read_text(encoding="utf-8")
    reference = (DOCS / "reference" / "methods.md").read_text(encoding="utf-8")
    for name, made in pl_mc.methods.METHODS.items():
        assert f"`{name}`" in theory or name in ("ls", "igg3", "araim"), name
        assert re.search(rf"^\.\. autoclass:: pl_mc\.methods\.{made.__name__}$", reference, re.MULTILINE), name


def test_every_public_function_and_class_is_in_the_reference() -> None:
    reference = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "reference").glob("*.md"))
    documented = {line.rsplit(".", 1)[1] for line in re.findall(r"^\.\. auto\w+:: (.*)$", reference, re.MULTILINE)}
    names = "araim detectors geometry kernels methods noise_models receiver statistics time_ramps"
    rooms = [importlib.import_module(f"pl_mc.{name}") for name in names.split()]
    for room in (pl_mc, *rooms):
        public = {name: getattr(room, name) for name in room.__all__ if not name.startswith("as_")}
        named = {one.__name__ for one in public.values() if inspect.isfunction(one) or inspect.isclass(one)}
        assert named - documented == set(), room.__name__
        # A name that stands for another one is said somewhere.
        for name, one in public.items():
            if room is pl_mc and inspect.isclass(one) and name != one.__name__:
                assert f"pl_mc.{name}" in reference


def test_the_numbers_on_the_papers_are_those_of_the_results() -> None:
    number = r"(?<![\w.])\d[\d,]*(?:\.\d+)?(?:e-?\d+)?"
    results = "".join(
        (ROOT / "results" / f"{name}.md").read_text(encoding="utf-8") for name in ("zhao2021", "guo2022", "risk")
    )
    page = (DOCS / "papers.md").read_text(encoding="utf-8")
    stated = set(re.findall(number, page))
    assert len(stated) > 100
    assert stated - set(re.findall(number, results)) == set()
