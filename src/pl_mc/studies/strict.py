"""The common record of parts of experiment files: one rule for numbers, dates and names."""

from __future__ import annotations

import datetime
import math
import typing
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from pl_mc.engine.checks import LARGEST_DRAWS

_NUMBERS = (int, float, int | None, float | None)


def _is_truth(value: Any) -> bool:
    return isinstance(value, bool)


class Strict(BaseModel):
    """A record of an experiment file; unknown fields are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _in_one_form(cls, value: Any, info: ValidationInfo) -> Any:
        """One rule for numbers, dates and names wherever they stand, that of functions."""
        field = str(info.field_name)
        form = cls.model_fields[field].annotation
        if form in _NUMBERS:
            if isinstance(value, str | bool):
                raise PydanticCustomError("number", "a number is needed")
            counted = form in (int, int | None)
            most = LARGEST_DRAWS if counted and "draws" in field else 2**63 if counted else 10**300
            if isinstance(value, int | float) and abs(value) > most and value not in (math.inf, -math.inf):
                raise PydanticCustomError(
                    "number", f"a {'whole ' * counted}number of at most {most if counted else 1e300} is needed"
                )
        if isinstance(value, list | tuple) and typing.get_origin(form) is tuple and any(map(_is_truth, value)):
            inner = typing.get_args(form)[0]
            if inner in _NUMBERS or typing.get_args(inner)[:1] in ((int,), (float,)):
                raise PydanticCustomError("number", "numbers are needed")
        if form is str and isinstance(value, datetime.date):
            return value.isoformat()
        if isinstance(value, str) and typing.get_origin(form) is tuple:
            # One name may stand alone, but not several in one word.
            value = (value,)
        return value


def once(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """The values of a field in which each may stand once."""
    twice = next((value for place, value in enumerate(values) if value in values[:place]), None)
    if twice is not None:
        raise PydanticCustomError("twice", "{value} stands there twice", {"value": f"{twice:g}"})
    return values
