"""Experiments by name or by file, checked as a whole before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pl_mc.experiments.source_files import read_source
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.studies.figure_fields import with_figures
from pl_mc.studies.registry import FORMER, KINDS, in_todays_words, with_faults
from pl_mc.studies.spec import Experiment
from pl_mc.studies.validation import FieldProblem, problems_of, validated


def load_experiment(
    which: str,
    overrides: Mapping[str, Any] | None = None,
    *,
    faults: Sequence[str] = (),
    figures: Mapping[str, Any] | None = None,
) -> tuple[str, Experiment]:
    """Name and record of an experiment.

    Args:
        which: a name of `experiment_files`, the path of a TOML file, or the path of a run's ``manifest.json``.
        overrides: top-level fields that replace the file's.
        faults: as texts, in place of the experiment's; none to leave these.
        figures: fields of its figures that replace the file's.

    Raises:
        InputError: no such experiment or file, a kind that takes no faults, text that is no TOML, or fields that are
            wrong (all are named).
    """
    source = read_source(which)
    content = dict(source.content) | dict(overrides or {})
    if faults:
        content = with_faults(content, faults)
    content = with_figures(content, figures or {})
    return source.name, build_experiment(content, source=str(source.path.name))


def build_experiment(content: Mapping[str, Any], *, source: str) -> Experiment:
    """The record of an experiment's fields; an `InputError` names every wrong one."""
    content = in_todays_words(content)
    if (problem := _kind_problem(content)) is not None:
        raise InputError(f"{source}: {problem.field}: {problem.reason}")
    return validated(KINDS[content["kind"]].model, content, source=source)


def in_this_version(content: Mapping[str, Any], *, source: str) -> Mapping[str, Any]:
    """The fields of an earlier version's record as this one would write them, with the defaults that it lacked."""
    try:
        return build_experiment(content, source=source).model_dump(mode="json")
    except InputError:
        return content


def field_problems(content: Mapping[str, Any]) -> list[FieldProblem]:
    """Every field that its record refuses, as far as the record alone can tell."""
    content = in_todays_words(content)
    kind = _kind_problem(content)
    return [kind] if kind is not None else problems_of(KINDS[content["kind"]].model, content)


def _kind_problem(content: Mapping[str, Any]) -> FieldProblem | None:
    kind = content.get("kind")
    if isinstance(kind, str) and kind in KINDS:
        return None
    if kind is None:
        return FieldProblem("kind", f"it has to be given (valid: {', '.join(KINDS)}).")
    close = nearest(str(kind)[:40], [*KINDS, *FORMER])
    return FieldProblem("kind", f"{shown(kind)} is unknown ({close}).")
