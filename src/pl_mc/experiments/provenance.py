"""What a run was made with: when, by which command, of which code, packages and machine, from which seeds.

Nothing of it names a person, a folder outside the working one, or a host.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import importlib.metadata
import platform
import re
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any

import pl_mc
from pl_mc.engine.part_task import environment
from pl_mc.report.run_folder import flat_fields
from pl_mc.runtime.threads import cores, processor_name
from pl_mc.runtime.typed_command import typed_command

# Packages whose version can change a number or a picture.
_RECORDED = ("pl_mc", "jax", "jaxlib", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pymap3d", "sidereon")

# Extras that runs may use; those of tests and of the site are no part of what a number rests on.
_EXTRAS = ("dask", "maps", "ubx")

# Files of a record of what is installed that are the package's own; the installer adds some about itself.
_OWN_METADATA = ("METADATA", "WHEEL")

_LONGEST_REFERENCE = 3


def provenance(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Date, command, seeds, code, packages and machine of a run whose experiment has these ``fields``."""
    seeds = {path: value for path, value in flat_fields(fields).items() if path.rpartition(".")[2] == "seed"}
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        "command": typed_command(),
        "seeds": seeds,
        "code": dict(_code()),
        "versions": recorded_versions(),
        "installed": {name: dict(about) for name, about in _installed().items()},
        "machine": machine(),
    }


def recorded_versions() -> dict[str, str]:
    """Versions of Python and of the packages that can change a number or a picture."""
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in _RECORDED}


def machine() -> dict[str, Any]:
    """System, processor and what compiled programs depend on."""
    return {"system": platform.system(), "processor": processor_name(), "cores": cores(), **environment()}


@functools.cache
def _code() -> Mapping[str, str]:
    """A hash of the package's files, and the commit of the checkout that they lie in, if they do."""
    root = Path(pl_mc.__file__).parent
    whole = hashlib.sha256()
    for path in sorted(root.rglob("*"), key=lambda path: path.relative_to(root).as_posix()):
        if path.is_file() and "__pycache__" not in path.parts:
            whole.update(
                f"{path.relative_to(root).as_posix()}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode()
            )
    commit = _commit(root.parents[1]) if root.parent.name == "src" else None
    return {"sha256": whole.hexdigest()} | ({} if commit is None else {"commit": commit})


def _commit(checkout: Path) -> str | None:
    """The commit that a checkout stands at, from git's own files; None where it is none."""
    try:
        git = checkout / ".git"
        if git.is_file():
            # A further work tree of a repository.
            git = checkout / git.read_text(encoding="utf-8").removeprefix("gitdir:").strip()
        common = git / (git / "commondir").read_text().strip() if (git / "commondir").is_file() else git
        said = (git / "HEAD").read_text(encoding="utf-8").strip()
        for _ in range(_LONGEST_REFERENCE):
            if not said.startswith("ref:"):
                break
            name = said.removeprefix("ref:").strip()
            place = next((folder / name for folder in (git, common) if (folder / name).is_file()), None)
            packed = (common / "packed-refs").read_text(encoding="utf-8") if place is None else ""
            found = re.search(rf"^([0-9a-f]+) {re.escape(name)}$", packed, re.MULTILINE)
            said = place.read_text(encoding="utf-8").strip() if place is not None else found[1] if found else ""
    except (OSError, ValueError):
        return None
    return said if re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", said) else None


@functools.cache
def _installed() -> Mapping[str, Mapping[str, str]]:
    """Version and hash of every package that this one needs, and of what these need, by name.

    The hash is that of `_record_hash`; none where there is no RECORD. The package itself is what `_code` says it is.
    """
    found: dict[str, Mapping[str, str]] = {}
    waiting = _needed(importlib.metadata.distribution("pl_mc"), _EXTRAS)
    while waiting:
        name = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        try:
            package = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            # Of another system or another Python.
            continue
        if name not in found:
            digest = _record_hash(package)
            found[name] = {"version": package.version} | ({"sha256": digest} if digest else {})
            waiting += _needed(package)
    return dict(sorted(found.items()))


def _needed(package: importlib.metadata.Distribution, extras: Collection[str] = ()) -> list[str]:
    """Names of the packages that one needs, and of those that its ``extras`` do."""
    names = []
    for requirement in package.requires or ():
        extra = re.search(r"extra\s*==\s*['\"]([^'\"]*)", requirement)
        if extra is None or extra[1] in extras:
            names += re.findall(r"^[A-Za-z0-9._-]+", requirement)
    return names


def _record_hash(package: importlib.metadata.Distribution) -> str:
    """SHA-256 of what is installed: the lines of its RECORD, path and hash, in order.

    Without what the installer says of itself and what it makes for this machine, such as scripts, so that the same
    wheel has the same hash wherever it is installed. Empty where there is no RECORD.
    """
    rows = [row[:2] for row in csv.reader((package.read_text("RECORD") or "").splitlines()) if len(row) > 1 and row[1]]
    lines = sorted(f"{path},{digest}" for path, digest in rows if _is_of_the_wheel(PurePosixPath(path)))
    return hashlib.sha256("\n".join(lines).encode()).hexdigest() if lines else ""


def _is_of_the_wheel(path: PurePosixPath) -> bool:
    if path.is_absolute() or ".." in path.parts:
        return False
    own = path.parent.suffix == ".dist-info" and len(path.parts) == 2
    return not own or path.name in _OWN_METADATA
