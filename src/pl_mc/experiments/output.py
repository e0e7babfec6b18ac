"""A results folder that is either complete or not there, with a manifest that is enough to redo the run.

Beside it stands the folder of an unfinished run: its experiment and the finished parts of its sweeps.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pl_mc.engine import plan
from pl_mc.experiments.loading import in_this_version
from pl_mc.experiments.provenance import provenance
from pl_mc.experiments.source_files import experiment_of
from pl_mc.input_errors import InputError, shown, system_reason
from pl_mc.kernels.noise import LANES
from pl_mc.report.run_folder import MANIFEST, changed_fields, earlier_place, read_run_folder
from pl_mc.runtime.small_files import parsed_json, read_text
from pl_mc.runtime.typed_command import without_home
from pl_mc.runtime.whole_files import locked, write_whole
from pl_mc.studies.file_fields import named_files
from pl_mc.studies.spec import Experiment

RECORD = "experiment.json"
SUFFIX = ".unfinished"

# Where a manifest says how figures were drawn again since the run.
_REDRAWN = "redrawn"


# Beside a results folder stand, hidden: what a run is writing, and what it replaces, for the moment of two renames.
_WRITING = "writing-"


@contextlib.contextmanager
def result_folder(
    path: Path, *, sign: str = MANIFEST, then: Callable[[], None] = lambda: None, said: list[str] | None = None
) -> Iterator[Path]:
    """A folder to write into, which takes its place at ``path`` only when everything is written.

    An earlier result at ``path``, which is known by the file ``sign`` in it, is replaced; any other folder is left
    alone. What a killed run left is put in order first. Nobody else writes there meanwhile.

    Args:
        path: the place.
        sign: the file by which a result is known.
        then: what follows when the result is in its place.
        said: gets a sentence where a killed run had left something that counts.

    Raises:
        InputError: the place cannot be written to, holds something else, or another run is writing there.
    """
    path = absolute(path)
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: the output is a folder, but a file of that name is there.")
    if path.is_dir() and any(path.iterdir()) and not (path / sign).is_file():
        raise InputError(f"{path}: the folder holds something other than an earlier result; name another one.")
    with writing(path), contextlib.ExitStack() as last:
        try:
            found = _put_in_order(path, sign)
            # Made beside its final place, so that the last step is a rename within one file system.
            working = Path(tempfile.mkdtemp(prefix=f".{path.name}.{_WRITING}", dir=path.parent))
        except OSError as error:
            raise InputError(f"{path}: the output folder cannot be written to ({system_reason(error)}).") from None
        if said is not None and found:
            said.append(found)
        # However this ends: what was begun is brought to an end, what is left over goes.
        last.callback(_put_in_order, path, sign)
        try:
            working.chmod(0o755)
            yield working
            for file in filter(Path.is_file, working.rglob("*")):
                with file.open("rb+") as written:
                    os.fsync(written.fileno())
            if path.exists():
                os.replace(path, earlier_place(path))
            os.replace(working, path)
        except OSError as error:
            if error.filename is None or not str(error.filename).startswith(str(path.parent)):
                raise
            raise InputError(f"{path}: the results cannot be written ({system_reason(error)}).") from None
        last.close()
        then()


@contextlib.contextmanager
def writing(path: Path, *, shared: bool = False) -> Iterator[None]:
    """The right to write a results folder and what stands beside it, see `pl_mc.runtime.whole_files.locked`."""
    with contextlib.ExitStack() as held:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(locked(path, shared=shared))
        except OSError as error:
            raise InputError(f"{path}: the output folder cannot be written to ({system_reason(error)}).") from None
        yield


def absolute(path: Path) -> Path:
    """The place of a results folder; an `InputError` where it can be none."""
    if "\0" in str(path):
        raise InputError(f"out: {shown(str(path))} cannot be the name of a folder.")
    return Path(path).absolute()


def _put_in_order(path: Path, sign: str) -> str:
    """Finish a replacement that was begun, remove what dead runs were writing; a sentence where a result was hidden.

    Whoever calls has the right to write: nobody alive is at these.
    """
    earlier = earlier_place(path)
    left = sorted(path.parent.glob(f".{glob.escape(path.name)}.{_WRITING}*"))
    said = ""
    if earlier.exists() and not path.exists():
        # The earlier result is put aside only when the new one is whole.
        whole = [one for one in left if (one / sign).is_file()]
        os.replace(whole[0] if len(whole) == 1 else earlier, path)
        said = f"{path}: a run was ended while it put its results here; they are in their place now."
    for one in (earlier, *left):
        shutil.rmtree(one, ignore_errors=True)
    return said


def write_manifest(folder: Path, *, name: str, experiment: Experiment, notes: Sequence[str], seconds: float) -> None:
    """Everything that decides the numbers: the experiment in full, what it was made with, inputs and outputs.

    With hashes of what the run wrote, so that a file that has changed since then is known.
    """
    fields = experiment.model_dump(mode="json")
    content: dict[str, Any] = {
        "name": name,
        "experiment": _homeless(fields),
        **experiment.figures.told(),
        "inputs": input_hashes(experiment),
        "noise": {"generator": "threefry2x32", "lanes_per_block": LANES},
        "cut": {"scenarios_per_call": plan.SCENARIOS_PER_CALL, "calls_per_part": plan.CALLS_PER_PART},
        "notes": list(notes),
        **provenance(fields),
        "seconds": round(seconds, 2),
        "files": {path: file_hash(folder / path) for path in written_files(folder)},
    }
    _write_manifest(folder, content)


def written_files(folder: Path) -> list[str]:
    """Files in a results folder and in folders of it, by their path within it, but for the manifest."""
    paths = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())
    return [path for path in paths if path != MANIFEST]


def _homeless(content: Any) -> Any:
    """The fields of an experiment with ``~`` for the user's home in paths."""
    if isinstance(content, dict):
        return {key: _homeless(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_homeless(value) for value in content]
    return without_home(content) if isinstance(content, str) else content


def record_files(folder: Path, names: Sequence[str], redrawn: Mapping[str, Any] | None = None) -> None:
    """Add hashes of files that were made of a run to its manifest; not to a manifest that was changed.

    Args:
        folder: the results.
        names: of the files: the page, which is made of the manifest among others, or figures.
        redrawn: the fields of these figures, where they were drawn again.
    """
    manifest = parsed_json(read_text(folder / MANIFEST), path=folder / MANIFEST)
    total, files = manifest.pop("sha256", None), manifest.get("files")
    if total == content_hash(manifest) and isinstance(files, dict):
        files |= {name: file_hash(folder / name) for name in names}
        if redrawn is not None:
            # Of forms that are drawn once more the earlier ones are gone.
            earlier = [one for one in drawn_again(manifest) if not set(one["format"]) <= set(redrawn["format"])]
            manifest[_REDRAWN] = [*earlier, dict(redrawn)]
        _write_manifest(folder, manifest)


def drawn_again(manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The fields of figures that were drawn again since the run, time after time."""
    told = manifest.get(_REDRAWN)
    return [one for one in told if isinstance(one, dict) and "format" in one] if isinstance(told, list) else []


def _write_manifest(folder: Path, content: Mapping[str, Any]) -> None:
    whole = {**content, "sha256": content_hash(content)}
    write_whole(folder / MANIFEST, json.dumps(whole, indent=2, ensure_ascii=False) + "\n")


def input_hashes(experiment: Experiment) -> dict[str, dict[str, str]]:
    """Names and hashes of the files that an experiment reads, by field."""
    files = dict(experiment.input_files()) | named_files(experiment.model_dump(mode="json"))
    return {field: {"file": path.name, "sha256": file_hash(path)} for field, path in files.items()}


class Unfinished:
    """The unfinished run beside a results folder.

    Args:
        results: the results folder.
    """

    def __init__(self, results: Path) -> None:
        self.results = results
        self.folder = results.with_name(results.name + SUFFIX)

    @property
    def part_count(self) -> int:
        """Finished parts that are there."""
        return sum(1 for _ in self.folder.glob("*/part-*.parquet"))

    def begin(self, name: str, experiment: Experiment, *, resume: bool, fresh: bool) -> str:
        """Prepare the folder for a run; a sentence where its record was damaged.

        Raises:
            InputError: parts are there and neither ``resume`` nor ``fresh`` is asked for, or they are those of
                another experiment, or the folder cannot be written.
        """
        if fresh:
            self.remove()
        content: dict[str, Any] = {"name": name, "experiment": experiment.model_dump(mode="json")}
        content |= experiment.figures.told()
        said = ""
        if self.part_count:
            if not resume:
                raise InputError(
                    f"{self.folder}: {self.part_count} finished parts of an earlier run are here; --resume goes on "
                    "with it, --fresh starts anew."
                )
            try:
                before = in_this_version(read_record(self.folder)["experiment"], source=RECORD)
            except InputError:
                # Each part says what it is of, and is held against the sweep before it is used.
                before, said = content["experiment"], f"{self.folder / RECORD}: it was damaged and was written anew."
            changed = changed_fields(before, content["experiment"])
            if changed:
                raise InputError(
                    f"{self.folder}: the unfinished run is one of another experiment ({_told(changed)}); --fresh "
                    "starts anew, --out names another folder."
                )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(self.folder / RECORD, json.dumps(content | {"sha256": content_hash(content)}, indent=2) + "\n")
        except OSError as error:
            reason = system_reason(error)
            raise InputError(f"{self.results}: the output folder cannot be written to ({reason}).") from None
        return said

    def remove(self) -> None:
        """Remove the folder, as a whole: what is left of it when this is stopped is no unfinished run."""
        going = self.results.with_name(f".{self.results.name}.{_WRITING}parts")
        with contextlib.suppress(OSError):
            os.replace(self.folder, going)
        shutil.rmtree(going, ignore_errors=True)


def read_record(folder: Path) -> dict[str, Any]:
    """Name and experiment of an unfinished run, and how its figures are drawn where that is not as usual."""
    try:
        content = parsed_json(read_text(folder / RECORD), path=folder / RECORD)
        found = {"name": content["name"], "experiment": dict(content["experiment"])}
        found |= {"figures": dict(content["figures"])} if "figures" in content else {}
        if content.get("sha256", content_hash(found)) != content_hash(found):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{folder}: no record of an unfinished run ({RECORD}) is here, or it is damaged.") from None
    return found


def require_finished_alike(folder: Path, experiment: Experiment) -> None:
    """Raise `InputError` unless the finished run in a folder is of this experiment with these input files."""
    manifest = read_run_folder(folder).manifest
    before = in_this_version(experiment_of(manifest), source=MANIFEST)
    changed = changed_fields(before, experiment.model_dump(mode="json"))
    changed += changed_fields(manifest.get("inputs", {}), input_hashes(experiment))
    if changed:
        raise InputError(
            f"{folder}: the finished run there is one of another experiment ({_told(changed)}); without --resume it is "
            "replaced, --out names another folder."
        )


def require_as_written(
    folder: Path, *, only: tuple[str, ...] = ("",),
    advice: str = "without --resume the run is counted anew and replaces it",
) -> None:  # fmt: skip
    """Raise `InputError` where a file of a finished run is not what the run wrote, as far as its manifest says.

    Args:
        folder: the results.
        only: endings of the files that count.
        advice: what to do about it.
    """
    manifest = parsed_json(read_text(folder / MANIFEST), path=folder / MANIFEST)
    total, files = manifest.pop("sha256", None), manifest.get("files", {})
    changed = [MANIFEST] if total not in (None, content_hash(manifest)) else []
    if isinstance(files, dict) and not changed:
        changed = [name for name in changed_files(folder, files) if name.endswith(only)]
    if changed:
        raise InputError(f"{folder / changed[0]}: it is not what the run wrote; {advice}.")


def changed_files(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of files that are there and are not what their hashes say; what somebody has removed is no damage."""

    def as_written(name: str) -> bool:
        try:
            return (folder / name).is_file() and file_hash(folder / name) == files[name]
        except OSError:
            return False

    return [name for name in files if os.path.lexists(folder / name) and not as_written(name)]


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def content_hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of a record, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _told(changed: Iterable[tuple[str, str, str]]) -> str:
    return "; ".join(f"{field}: {old} before, {new} now" for field, old, new in changed)
