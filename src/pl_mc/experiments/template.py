"""Experiment files to begin with: every field with its meaning, rule and default above it.

What is written is read back as the same experiment.
"""

from __future__ import annotations

import dataclasses
import json
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from pl_mc.detectors.registry import DETECTORS
from pl_mc.experiments.field_meanings import meaning, rule
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.source_files import experiment_files
from pl_mc.input_errors import InputError, nearest
from pl_mc.methods.registry import METHODS
from pl_mc.noise_models import NOISE_MODELS
from pl_mc.studies.registry import KINDS, in_todays_words, study_of
from pl_mc.studies.spec import Experiment, kind_of

_WIDTH = 110


def template_for(which: str) -> str:
    """The text of an experiment file.

    Args:
        which: a name of `experiment_files`, or a kind, for which the first experiment of that kind is taken.

    Raises:
        InputError: neither a name nor a kind.
    """
    known = experiment_files()
    if which in known:
        return template(load_experiment(which)[1])
    # A former kind is an option of one of today.
    wanted = in_todays_words({"kind": which})
    if wanted["kind"] in KINDS:
        if outline := KINDS[wanted["kind"]].outline:
            return template(build_experiment({**outline, **wanted}, source=which))
        for name in known:
            record = load_experiment(name)[1]
            if all(getattr(record, field, None) == value for field, value in wanted.items()):
                return template(record)
        raise InputError(f"{which}: no experiment of this kind comes with the package (names: {', '.join(known)}).")
    raise InputError(f"{which}: it is neither an experiment nor a kind ({nearest(which, {**known, **KINDS})}).")


def template(experiment: Experiment) -> str:
    """The text of an experiment file that holds ``experiment``, with a comment above every field."""
    about = (study_of(experiment).model.__doc__ or "").strip().partition("\n")[0].rstrip(".").replace("`", "")
    head = [
        *_comment(f"An experiment of the kind {kind_of(experiment)}: {about[:1].lower()}{about[1:]}."),
        *_comment(
            "Above every field: its meaning and, in brackets, what it may be and its default. Lines that begin "
            "with # are comments; a field that is left out has its default. Tables of the same sort that follow "
            "each other are explained once."
        ),
        "# pl-mc check FILE says what is wrong with it and what it will cost; pl-mc run FILE runs it.",
        "",
    ]
    return "\n".join([*head, *_record(experiment, "")]).rstrip() + "\n"


def _record(record: BaseModel, path: str, *, again: bool = False) -> list[str]:
    """Plain fields first, then tables, as TOML wants it; ``again`` without what was said before."""
    plain: list[str] = []
    tables: list[str] = []
    fields = type(record).model_fields
    # The kind decides what all else means.
    for field in sorted(fields, key=lambda name: name != "kind"):
        info, value = fields[field], getattr(record, field)
        if info.annotation is type(None):
            continue
        about = [] if again else _about(record, field)
        inner = f"{path}.{field}" if path else field
        if isinstance(value, BaseModel):
            tables += ["", *about, f"[{inner}]", *_record(value, inner)]
        elif isinstance(value, tuple) and value and all(isinstance(one, BaseModel) for one in value):
            for k, one in enumerate(value):
                told = any(_name(one) == _name(earlier) for earlier in value[:k])
                tables += ["", *(about if k == 0 else []), f"[[{inner}]]", *_record(one, inner, again=told)]
        elif isinstance(value, Mapping) and len(_value(value)) > 80:
            tables += ["", *about, f"[{inner}]", *(f"{_key(key)} = {_value(one)}" for key, one in value.items())]
        elif value is None:
            plain += [*about, f"# {field} ="]
        else:
            plain += [*about, f"{field} = {_value(value)}"]
    return [*plain, *_options(record, again=again), *tables]


def _name(record: BaseModel) -> tuple[type, str]:
    """What a record's comments depend on: its class and, where it has options of its own, its name."""
    return type(record), str(getattr(record, "name", "")) if record.model_config.get("extra") == "allow" else ""


def _about(record: BaseModel, field: str) -> list[str]:
    info = type(record).model_fields[field]
    text, allowed = meaning(type(record), field), rule(info)
    default = info.default if info.default_factory is None else info.default_factory()  # type: ignore[call-arg]
    if default is PydanticUndefined:
        ends = "has to be given"
    elif default is None:
        ends = "default: not given"
    elif isinstance(default, BaseModel):
        ends = "default: the defaults of its fields"
    elif isinstance(default, tuple) and any(isinstance(one, BaseModel) for one in default):
        ends = f"default: {', '.join(str(getattr(one, 'name', one)) for one in default)}"
    else:
        ends = f"default: {_value(default)}"
    bracket = f"[{allowed}; {ends}]" if allowed else f"[{ends}]"
    return _comment(f"{text[:1].upper()}{text[1:]}. {bracket}" if text else bracket)


def _options(record: BaseModel, *, again: bool) -> list[str]:
    """Options of a method or a test: those that are given, then the others with their defaults, as comments."""
    if record.model_config.get("extra") != "allow":
        return []
    given = record.model_extra or {}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in given.items()]
    cls = (METHODS | DETECTORS | NOISE_MODELS).get(str(getattr(record, "name", "")))
    if cls is None or again:
        return lines
    for option in dataclasses.fields(cls):
        # A record of options of its own, such as a risk budget, has no form in these files.
        unwritten = option.default is dataclasses.MISSING or dataclasses.is_dataclass(option.default)
        if option.name in given or unwritten:
            continue
        text = meaning(cls, option.name)
        default = "not given" if option.default is None else _value(option.default)
        lines += _comment(f"Option{f': {text}' if text else ''}. [default: {default}]")
        lines.append(f"# {option.name} ={'' if option.default is None else f' {default}'}")
    return lines


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)]


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else json.dumps(key)


def _value(value: Any) -> str:
    """A value in TOML."""
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Path):
        return _value(str(value))
    if isinstance(value, int):
        return f"{value:_}" if abs(value) >= 10_000 and value % 1000 == 0 else str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, Mapping):
        inner = ", ".join(f"{_key(str(key))} = {_value(one)}" for key, one in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(one) for one in value)}]"
    raise TypeError(f"{value!r} has no form in TOML")
