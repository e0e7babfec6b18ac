"""The order of the packages: what each may import, read from the source itself, and that no file grows too long.

An import counts wherever it stands, inside functions too: one that is put off still ties two files together. Those
under ``TYPE_CHECKING`` count as well, but for the list of public names in the package's own file, which gives types
to what is found on first use and is there to point at everything.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "pl_mc"
PACKAGE = "pl_mc"

# From what knows nothing of the others to what knows all; packages of one line do not know each other.
LAYERS = (
    ("arrays", "constants", "deprecated", "input_errors"),
    ("alert", "named"),
    ("runtime",),
    ("ism",),
    ("error_models",),
    ("kernels",),
    ("geometry",),
    ("faults", "noise_models"),
    ("injection",),
    ("statistics", "receiver"),
    ("araim", "detectors"),
    ("methods",),
    ("engine",),
    ("integrity_risk", "service", "time_ramps"),
    ("report",),
    ("studies",),
    ("experiments", "benchmark", "conformance"),
    ("cli",),
)
# Rooms of integrity risk: each may know those before it; nobody knows of the last, which knows nothing of the two
# before it.
RISK_ROOMS = ("modes", "rare", "worst", "given_residuals", "k_factor", "tuning", "budget")
OF_BUDGET = {"modes", "rare", "worst"}
# A study may know its own room, what all share (files beside the rooms) and these rooms of others.
STUDY_ROOMS = {"readings": {"series"}}
MOST_LINES = 420

# A file that imports another: names of both, and the line.
Import = tuple[str, str, int]


def files(root: Path) -> dict[str, Path]:
    """Every file of a package by the name that it is imported by."""
    names = {}
    for path in sorted(root.rglob("*.py")):
        parts = (root.name, *path.relative_to(root).with_suffix("").parts)
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


@functools.cache
def imports(root: Path) -> list[Import]:
    """Every import of one file of a package by another, at the top or inside a function.

    But for imports of the package itself, whose public names are found on first use.
    """
    known = files(root)
    found = []
    for name, path in known.items():
        for node in ast.walk(_without_public_names(ast.parse(path.read_text(encoding="utf-8")), name == root.name)):
            for target in _targets(node, known, name if path.name == "__init__.py" else name.rpartition(".")[0]):
                if target not in (name, root.name):
                    found.append((name, target, getattr(node, "lineno", 0)))
    return found


def _targets(node: ast.AST, known: Mapping[str, Path], here: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name in known)
    elif isinstance(node, ast.ImportFrom):
        above = here.split(".")[: len(here.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        for alias in node.names:
            inside = f"{base}.{alias.name}"
            if inside in known or base in known:
                yield inside if inside in known else base


def _without_public_names(tree: ast.Module, own_file: bool) -> ast.Module:
    if own_file:
        tree.body = [
            node for node in tree.body if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))
        ]
    return tree


def layer_of(name: str) -> int:
    """Place of a file's package in `LAYERS`; a `KeyError` for one that has none."""
    places = {package: place for place, packages in enumerate(LAYERS) for package in packages}
    return places[name.split(".")[1]]


def upward(root: Path) -> list[str]:
    """Imports of a later package, or of another one of the same place, as ``file:line -> file``."""
    wrong = []
    for name, target, line in imports(root):
        if name == root.name:
            continue
        ours, theirs = layer_of(name), layer_of(target)
        if name.split(".")[1] != target.split(".")[1] and theirs >= ours:
            wrong.append(f"{name}:{line} -> {target}")
    return sorted(wrong)


def circles(root: Path) -> list[list[str]]:
    """Groups of files each of which imports all others, if not itself then by way of others (Tarjan 1972)."""
    graph: dict[str, set[str]] = {name: set() for name in files(root)}
    for name, target, _ in imports(root):
        graph[name].add(target)
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    waiting: list[str] = []
    groups: list[list[str]] = []

    def visit(name: str) -> None:
        number[name] = lowest[name] = len(number)
        waiting.append(name)
        for target in sorted(graph[name]):
            if target not in number:
                visit(target)
                lowest[name] = min(lowest[name], lowest[target])
            elif target in waiting:
                lowest[name] = min(lowest[name], number[target])
        if lowest[name] == number[name]:
            start = waiting.index(name)
            groups.append(sorted(waiting[start:]))
            del waiting[start:]

    for name in graph:
        if name not in number:
            visit(name)
    return [group for group in groups if len(group) > 1]


def between_rooms(root: Path, package: str) -> list[tuple[str, str, str]]:
    """Rooms (folders) of a package that import each other: room, room, and where."""
    inside = f"{root.name}.{package}."
    rooms = {path.name for path in (root / package).iterdir() if (path / "__init__.py").exists()}
    found = []
    for name, target, line in imports(root):
        if name.startswith(inside) and target.startswith(inside):
            one, other = (part.removeprefix(inside).split(".")[0] for part in (name, target))
            if one != other and {one, other} <= rooms:
                found.append((one, other, f"{name}:{line} -> {target}"))
    return found


def test_every_package_has_its_place() -> None:
    packages = {name.split(".")[1] for name in files(SOURCE) if "." in name}
    assert packages == {package for packages in LAYERS for package in packages}


def test_no_package_imports_a_later_one() -> None:
    assert upward(SOURCE) == []


def test_no_files_import_each_other() -> None:
    assert circles(SOURCE) == []


def test_rooms_of_integrity_risk_know_those_before_them() -> None:
    wrong = []
    for room, other, where in between_rooms(SOURCE, "integrity_risk"):
        before = OF_BUDGET if room == "budget" else set(RISK_ROOMS[: RISK_ROOMS.index(room)])
        if other not in before:
            wrong.append(where)
    assert wrong == []


def test_studies_do_not_know_each_other() -> None:
    rooms = between_rooms(SOURCE, "studies")
    assert [where for room, other, where in rooms if other not in STUDY_ROOMS.get(room, set())] == []


def test_no_file_is_too_long() -> None:
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in files(SOURCE).items()}
    assert {name: lines for name, lines in lengths.items() if lines > MOST_LINES} == {}


def test_the_reader_of_imports_sees_them(tmp_path: Path) -> None:
    """The tests above are not empty: imports that go up, in a circle and between rooms are found, however put."""
    root = tmp_path / PACKAGE
    made = {
        "__init__.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pl_mc import engine\n",
        "kernels/__init__.py": "",
        "kernels/weights.py": "def late() -> None:\n    from pl_mc.engine import core\n",
        "engine/__init__.py": "from pl_mc.engine.core import LANES\n",
        "engine/core.py": "from ..kernels.weights import late\nLANES = 256\n",
        "service/__init__.py": "",
        "service/sky.py": "import typing\nif typing.TYPE_CHECKING:\n    import pl_mc.time_ramps.passes\n",
        "time_ramps/__init__.py": "",
        "time_ramps/passes.py": "",
        "studies/__init__.py": "",
        "studies/risk/__init__.py": "",
        "studies/risk/run.py": "from pl_mc.studies.noise import run\n",
        "studies/noise/__init__.py": "",
        "studies/noise/run.py": "",
    }
    for place, text in made.items():
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        (root / place).write_text(text)
    assert upward(root) == [
        "pl_mc.kernels.weights:2 -> pl_mc.engine.core",
        "pl_mc.service.sky:3 -> pl_mc.time_ramps.passes",
    ]
    assert circles(root) == [["pl_mc.engine.core", "pl_mc.kernels.weights"]]
    assert between_rooms(root, "studies") == [("risk", "noise", "pl_mc.studies.risk.run:1 -> pl_mc.studies.noise.run")]
