"""Kinds of experiments by name: a folder each, with a `Study` called ``STUDY``, which is loaded on first use."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pl_mc.input_errors import InputError

if TYPE_CHECKING:
    from pl_mc.studies.spec import Experiment
    from pl_mc.studies.study import Study

_FOLDERS = {
    "compare": "pl_mc.studies.compare",
    "frontier": "pl_mc.studies.frontier",
    "guo": "pl_mc.studies.guo",
    "noise": "pl_mc.studies.noise",
    "observe": "pl_mc.studies.observe",
    "readings": "pl_mc.studies.readings",
    "risk": "pl_mc.studies.risk",
    "series": "pl_mc.studies.series",
    "service": "pl_mc.studies.service",
    "stanford": "pl_mc.studies.stanford",
    "sweep": "pl_mc.studies.sweep",
    "time-ramps": "pl_mc.studies.time_ramps",
    "tuning": "pl_mc.studies.tuning",
    "variants": "pl_mc.studies.variants",
}

# Where the experiments of the package are, and files that come with them: in a wheel, and in a checkout.
PACKAGED_FOLDERS = (Path(__file__).parents[1] / "experiments" / "files", Path(__file__).parents[3] / "experiments")

# What experiments of kinds that have become an option of another one say today.
FORMER = {"map": {"kind": "sweep", "view": "map"}, "satellite-ramps": {"kind": "sweep", "view": "satellites"}}

# Extras of the package that make the results of a kind whole.
EXTRAS = {"service": ("maps",)}

# What a title says of faults in place of the file's, and how many it names.
_INSTEAD, _MOST_IN_TITLE = "; faults instead: ", 3


class Registry(Mapping[str, "Study"]):
    """Studies by the name of their kind.

    Args:
        folders: the package of each kind.
    """

    def __init__(self, folders: Mapping[str, str]) -> None:
        self.folders = dict(folders)

    def __getitem__(self, kind: str) -> Study:
        study: Study = importlib.import_module(self.folders[kind]).STUDY
        return study

    def __contains__(self, kind: object) -> bool:
        return isinstance(kind, str) and kind in self.folders

    def __iter__(self) -> Iterator[str]:
        return iter(self.folders)

    def __len__(self) -> int:
        return len(self.folders)


KINDS = Registry(_FOLDERS)


def in_todays_words(content: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an experiment, where an earlier version has written them under the name of a former kind.

    With a view beside it a former kind is no experiment of that version, and stays as it is, to be refused.
    """
    former = {} if "view" in content else FORMER.get(str(content.get("kind")), {})
    return dict(content) | former


def with_faults(content: Mapping[str, Any], texts: Sequence[str]) -> dict[str, Any]:
    """The fields of an experiment with faults as texts in place of its own.

    Raises:
        InputError: a kind that injects none, or those of a form of its own alone.
    """
    content = in_todays_words(content)
    kind = content.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        # Which the check of its fields tells.
        return content
    change = KINDS[kind].with_faults
    if change is None:
        able = ", ".join(name for name in KINDS if KINDS[name].with_faults is not None)
        raise InputError(f"--fault: an experiment of the kind {kind} takes none from outside (kinds that do: {able}).")
    told = "; ".join(texts) if len(texts) <= _MOST_IN_TITLE else f"{len(texts)} others"
    title = f"{str(content.get('title')).partition(_INSTEAD)[0]}{_INSTEAD}{told}"
    return content | {"title": title} | dict(change(content, tuple(texts)))


def study_of(experiment: Experiment) -> Study:
    """The study of an experiment."""
    from pl_mc.studies.spec import kind_of

    return KINDS[kind_of(experiment)]
