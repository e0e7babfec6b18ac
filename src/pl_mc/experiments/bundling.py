"""A run as one file to hand over: page, tables, figures, manifest, experiment, assumptions and environment in a zip.

Its bytes are those of its content: members in order, of one time, stored as they are, so that two bundles of one folder
are equal, and one that differs anywhere from what is made of its members is known.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from pl_mc.experiments.assuming import assumed_of
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.output import content_hash, written_files
from pl_mc.experiments.source_files import experiment_of
from pl_mc.experiments.template import template
from pl_mc.experiments.verifying import Verified, is_plain, verify
from pl_mc.input_errors import InputError, shown, system_reason
from pl_mc.report.assumed import ASSUMED
from pl_mc.report.page import PAGE, page_of_run
from pl_mc.report.run_folder import MANIFEST, read_manifest, read_run_folder
from pl_mc.runtime.small_files import read_bytes, shown_reason
from pl_mc.runtime.whole_files import write_whole
from pl_mc.studies.file_fields import without_folders
from pl_mc.studies.spec import Experiment

SUMS, README, LOCK, EXPERIMENT, RESULTS = "SHA256SUMS", "README.txt", "environment.txt", "experiment.toml", "results"
SUFFIX = ".zip"
_FIGURES = (".svg", ".png", ".pdf")

# The largest results folders have a few tens of megabytes.
_MOST_BYTES, _MOST_MEMBERS = 1_000_000_000, 20_000

_INPUTS = """The run read these files, which are not in the bundle (SHA-256, name). They are looked for in the folder
that the environment variable PL_MC_DATA names, and in the current one:
"""

# The first time that a zip can say, and a file that all may read.
_TIME, _UNIX, _MODE = (1980, 1, 1, 0, 0, 0), 3, 0o100644


def require_whole_run(folder: Path, *, but_figures: bool = False) -> None:
    """Raise `InputError` where a results folder is not what its run wrote; figures aside, if they are to be drawn."""
    found = verify(folder)
    wrong = [*found.changed, *found.missing, *found.foreign]
    others = [name for name in wrong if not name.endswith(_FIGURES)]
    if not found.passed and (others or not wrong or not but_figures):
        hint = "" if others or not wrong else "; pl-mc report FOLDER --format png,svg draws figures again"
        first = found.sentences()[0].rstrip(".")
        raise InputError(f"{folder}: no bundle is made of a folder that is not what its run wrote ({first}){hint}.")


def write_bundle(folder: Path, place: Path) -> None:
    """Write the bundle of a results folder.

    Raises:
        InputError: a folder that is not what its run wrote, or whose experiment this version does not know; a place
            that cannot be written to.
    """
    require_whole_run(folder)
    try:
        write_whole(place, archive_of(_members(folder)))
    except OSError as error:
        raise InputError(f"--bundle: {place}: it cannot be written ({system_reason(error)}).") from None


def archive_of(members: Mapping[str, bytes]) -> bytes:
    """The bytes of an archive, which depend on its members alone."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(members):
            about = zipfile.ZipInfo(name, _TIME)
            about.create_system, about.external_attr = _UNIX, _MODE << 16
            archive.writestr(about, members[name])
    return whole.getvalue()


def _members(folder: Path) -> dict[str, bytes]:
    """What a bundle holds, by name: in it no path leads out of it."""
    manifest = read_manifest(folder)
    experiment = build_experiment(experiment_of(manifest), source=MANIFEST)
    fields = without_folders(manifest["experiment"])
    assumed = assumed_of(experiment)
    files = {name: (folder / name).read_bytes() for name in written_files(folder)}
    notes = [str(note) for note in manifest.get("notes") or ()]
    files.setdefault(ASSUMED, assumed.markdown(experiment.title, notes).encode())
    told = {key: value for key, value in manifest.items() if key not in ("sha256", "files")} | {"experiment": fields}
    with tempfile.TemporaryDirectory(prefix="pl-mc-bundle-") as made:
        # The page names the folder and the fields as they are in the bundle.
        place = Path(made, RESULTS)
        for name, content in files.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(content)
        (place / MANIFEST).write_text(json.dumps(told), encoding="utf-8")
        run = read_run_folder(place)
        if run.document is not None:
            files[PAGE] = page_of_run(run, assumed=assumed, shown_as=Path(RESULTS)).encode()
    told["files"] = {name: _hash(content) for name, content in sorted(files.items())}
    whole = json.dumps(told | {"sha256": content_hash(told)}, indent=2, ensure_ascii=False) + "\n"
    members = {f"{RESULTS}/{name}": content for name, content in files.items()}
    members |= {
        f"{RESULTS}/{MANIFEST}": whole.encode(),
        EXPERIMENT: template(_without_folders(manifest)).encode(),
        LOCK: _lock(run.manifest).encode(),
        README: _readme(run.manifest).encode(),
    }
    return members | {SUMS: "".join(f"{_hash(members[name])}  {name}\n" for name in sorted(members)).encode()}


def _lock(manifest: Mapping[str, Any]) -> str:
    """The packages of the run, in a form that installers read."""
    versions = manifest["versions"]
    installed = manifest["installed"] or {name: {"version": versions[name]} for name in sorted(versions)}
    lines = [
        f"# Python {versions.get('python', 'of an unknown version')}; pl_mc {versions['pl_mc']}",
        *(f"# {what} of pl_mc: {value}" for what, value in manifest["code"].items()),
        "# Behind each package the SHA-256 of what was installed of it: of the lines of its RECORD, path and hash, in",
        "# order, without what the installer adds. It is not the hash of an archive.",
    ]
    for name, about in installed.items():
        if name not in ("python", "pl_mc"):
            digest = f"  # sha256 {about['sha256']}" if "sha256" in about else ""
            lines.append(f"{name}=={about['version']}{digest}")
    return "\n".join(lines) + "\n"


def _readme(manifest: Mapping[str, Any]) -> str:
    """What is in the bundle, and how to verify and redo it."""
    versions, inputs = manifest["versions"], manifest.get("inputs", {})
    ends = "The run read no files.\n"
    if inputs:
        read = dict.fromkeys(f"  {one['sha256']}  {one['file']}" for one in inputs.values())
        ends = "\n".join([_INPUTS, *read, ""])
    return f"""{manifest["name"]}: {manifest["experiment"].get("title", "")}

results/         what the run wrote: report.html (the page), tables, figures, summary.md, and manifest.json with
                 date, command, versions, machine, seeds and hashes
results/{ASSUMED}
                 what was assumed: no number is to be quoted without it
{EXPERIMENT}  the experiment, every field with its meaning
{LOCK}  the packages that it ran with
{SUMS}       SHA-256 of every file

To verify it, any of:

  sha256sum -c {SUMS}
  pl-mc verify THIS_FILE.zip
  pl-mc verify results

To redo it, with Python {versions.get("python", "")} and pl_mc {versions["pl_mc"]} and the packages of {LOCK}:

  pl-mc verify THIS_FILE.zip --redo
  pl-mc run {EXPERIMENT} --out again && pl-mc compare results again

Counts come out bitwise the same on a processor of the same instruction set (manifest.json names it).

{ends}"""


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def verify_bundle(place: Path, *, partial: bool = False, redo: bool = False, progress: bool | None = None) -> Verified:
    """Hold a bundle against what it says of itself; arguments as of `pl_mc.experiments.verifying.verify`.

    Raises:
        InputError: a file that is no bundle: no archive, members that are packed or encrypted, names that lead
            elsewhere or stand there twice.
    """
    content = read_bytes(place, most_bytes=_MOST_BYTES)
    members = _read(content, place)
    sums, damaged = _sums(members.get(SUMS) or b""), {name for name, one in members.items() if one is None}
    inside = f"{RESULTS}/{MANIFEST}"
    if inside not in members and (partial or inside not in sums):
        raise InputError(f"{place}: it is no bundle: {inside}, against which the rest is held, is not in it.")
    changed = {name for name, one in members.items() if name in sums and (one is None or _hash(one) != sums[name])}
    changed |= damaged | ({SUMS} if not sums else set())
    missing = [] if partial else sorted({*sums, SUMS} - set(members))
    whole = {name: one for name, one in members.items() if one is not None}
    if not (changed or missing or partial) and archive_of(whole) != content:
        # Between its members.
        changed = {place.name}
    found = Verified(
        folder=place,
        intact=tuple(sorted(name for name in members if name not in changed)),
        changed=tuple(sorted(changed)),
        missing=tuple(missing),
        foreign=tuple(sorted(set(members) - set(sums) - {SUMS})) if sums else (),
        inputs=(),
    )
    if inside in changed or inside not in whole:
        unread = f"{inside}: it is not what the run wrote, or not there; nothing was held against it"
        return replace(found, notes=(f"{unread}{', and nothing was run again' if redo else ''}.",))
    with tempfile.TemporaryDirectory(prefix="pl-mc-verify-") as made:
        for name, one in whole.items():
            (Path(made) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(made) / name).write_bytes(one)
        try:
            inner = verify(Path(made, RESULTS), partial=partial, redo=redo, progress=progress)
        except InputError as error:
            raise InputError(str(error).replace(f"{made}{os.sep}", f"{place}: ")) from None
        other = _other_experiment(Path(made))

    def told(names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
        return tuple(f"{RESULTS}/{name}" for name in names if f"{RESULTS}/{name}" not in known)

    more = (*told(inner.changed, found.changed), *([EXPERIMENT] if other and EXPERIMENT not in found.changed else []))
    strange = told(inner.foreign, found.foreign)
    return replace(
        found,
        intact=tuple(name for name in found.intact if name not in (*more, *strange)),
        changed=(*found.changed, *more),
        missing=(*found.missing, *told(inner.missing, found.missing)),
        foreign=(*found.foreign, *strange),
        inputs=inner.inputs, redone=inner.redone, same=inner.same, notes=inner.notes,
    )  # fmt: skip


def _without_folders(manifest: Mapping[str, Any]) -> Experiment:
    """The experiment of a manifest as a bundle names its files."""
    fields = without_folders(manifest["experiment"])
    return build_experiment(experiment_of({**manifest, "experiment": fields}), source=MANIFEST)


def _other_experiment(made: Path) -> bool:
    """Whether the experiment of an unpacked bundle is another one than that of its manifest."""
    if not (made / EXPERIMENT).is_file():
        return False
    try:
        told, held = load_experiment(str(made / EXPERIMENT))[1], _without_folders(read_manifest(made / RESULTS))
    except InputError:
        # Files that it reads are not at hand, or it is of another version.
        return False
    return told.model_dump(mode="json") != held.model_dump(mode="json")


def _read(content: bytes, place: Path) -> dict[str, bytes | None]:
    """The members of an archive by name; None for one whose bytes are damaged.

    Each is stored as it is, so that none is larger than the archive.
    """
    members: dict[str, bytes | None] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            listed = archive.infolist()
            if len(listed) > _MOST_MEMBERS or sum(one.file_size for one in listed) > len(content):
                raise InputError(f"{place}: it is no bundle: its members are larger than itself.")
            folders = {str(above) for one in listed for above in PurePosixPath(one.filename).parents}
            for one in listed:
                if one.filename in members or not is_plain(one.filename):
                    raise InputError(f"{place}: it is no bundle: {shown(one.filename)} is no name of a member of one.")
                if one.filename in folders:
                    raise InputError(f"{place}: it is no bundle: {one.filename} is a file and a folder in it.")
                if one.compress_type != zipfile.ZIP_STORED or one.flag_bits & 1:
                    raise InputError(
                        f"{place}: it is no bundle as pl-mc writes it: {one.filename} is packed or encrypted; unpack "
                        f"it, and verify the folder {RESULTS}."
                    )
                try:
                    members[one.filename] = archive.read(one)
                except (zipfile.BadZipFile, EOFError, ValueError, OSError):
                    members[one.filename] = None
    except (zipfile.BadZipFile, EOFError, ValueError, OSError, NotImplementedError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{place}: it is no archive, or a damaged one ({shown_reason(str(error))}).") from None
    return members


def _sums(content: bytes) -> dict[str, str]:
    """Hashes by name; nothing where a line is of another form."""
    try:
        lines = [line.split("  ", 1) for line in content.decode().splitlines()]
    except UnicodeDecodeError:
        return {}
    sound = all(len(line) == 2 and is_plain(line[1]) for line in lines)
    return {line[1]: line[0] for line in lines} if sound else {}
