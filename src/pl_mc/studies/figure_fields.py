"""What an experiment file and the command line say of figures; numbers do not depend on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from pl_mc.input_errors import InputError
from pl_mc.report.look import USUAL_ENDINGS, Look, endings_of, width_mm
from pl_mc.studies.strict import Strict


class FigureFields(Strict):
    """How figures are drawn and stored.

    Attributes:
        format: files of each figure: png, svg and pdf, one or several; a page shows one of the first two.
        style: screen; paper (in colours) or grey (told apart by lines, markers and hatches) for print, with text of 7
            to 8 points, thin lines and no heading.
        width: the width of every figure with its unit, 88mm, 8.8cm or 3.5in; that of each figure on a screen and 180mm
            in print unless given.
    """

    format: tuple[str, ...] = USUAL_ENDINGS
    style: Literal["screen", "paper", "grey"] = "screen"
    width: str | None = None

    @field_validator("format", "width")
    @classmethod
    def _usable(cls, given: Any, info: ValidationInfo) -> Any:
        try:
            if info.field_name == "format":
                return endings_of(given)
            if given is not None:
                width_mm(given)
        except InputError as error:
            rule = str(error).partition(": ")[2].rstrip(".")
            raise PydanticCustomError("figures", "{rule}", {"rule": rule}) from None
        return given

    @property
    def look(self) -> Look:
        """The look."""
        return Look(self.style, None if self.width is None else width_mm(self.width), self.format)

    def told(self) -> dict[str, Any]:
        """What a record says under ``figures``; nothing where all is as usual."""
        return {} if self == FigureFields() else {"figures": self.model_dump(mode="json")}


def with_figures(content: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an experiment with those of its figures that a command gives."""
    own = content.get("figures", {})
    if not given or not isinstance(own, Mapping):
        return dict(content)
    return dict(content) | {"figures": dict(own) | dict(given)}
