"""Experiments of the kind ``sweep``: a simulated geometry, faults, methods, noise draws, in one of three views."""

from __future__ import annotations

from typing import Any, Literal, NoReturn

from pydantic import Field, TypeAdapter, ValidationError, ValidationInfo, field_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from pl_mc.studies.fault_fields import AnyFaults, ListedFaults, RampFaults, RampSizes
from pl_mc.studies.spec import ByAxes, NoiseChoice, SimulatedGeometry

_FORMS: dict[str, TypeAdapter[Any]] = {
    "faults": TypeAdapter(AnyFaults),
    "satellites": TypeAdapter(RampFaults),
    "map": TypeAdapter(RampSizes),
}
# Fields of faults that other views than the fault by fault one have no use for.
_MISPLACED = {"faults": (), "satellites": ("biases",), "map": ("biases", "satellite", "otherwise")}
_GAUSSIAN = NoiseChoice(name="gaussian")


class SweepExperiment(ByAxes):
    """A sweep; see `pl_mc.sweep` for what is counted, `pl_mc.noise_models` for the noise.

    Attributes:
        view: faults for rates fault by fault; satellites for a ramp on one satellite of one epoch with many draws,
            and the same ramp on every other one in view; map for a ramp on every satellite at every epoch.
        draws_per_satellite: noise draws for each bias on every satellite, in the view satellites.
    """

    kind: Literal["sweep"] = "sweep"
    view: Literal["faults", "satellites", "map"] = "faults"
    draws: int = Field(ge=1)
    draws_per_satellite: int | None = Field(default=None, ge=1, validate_default=True)
    geometry: SimulatedGeometry = Field(default=SimulatedGeometry(), validate_default=True)
    faults: RampFaults | ListedFaults | RampSizes
    noise: NoiseChoice = _GAUSSIAN

    # The view is validated before what it decides about; where it is wrong, that is left alone.

    @field_validator("draws_per_satellite", "geometry", "noise")
    @classmethod
    def _of_use_in_the_view(cls, value: Any, info: ValidationInfo) -> Any:
        match info.data.get("view"), info.field_name:
            case "satellites", "draws_per_satellite" if value is None:
                _refuse("missing", None)
            case "faults" | "map" as view, "draws_per_satellite" if value is not None:
                _refuse(f"nothing can stand here in the view {view} (nearest: view = 'satellites')", value)
            case "satellites", "geometry" if value.epoch is None:
                last = value.epochs - 1
                _refuse(f"the view satellites needs one epoch of 0 to {last} (nearest: {last})", None, "epoch")
            case "satellites" | "map" as view, "noise" if value != _GAUSSIAN:
                rule = f"the view {view} is of Gaussian noise alone (nearest: {_GAUSSIAN.model_dump()})"
                _refuse(rule, value.model_dump())
        return value

    @field_validator("faults", mode="before")
    @classmethod
    def _in_the_form_of_the_view(cls, given: Any, info: ValidationInfo) -> Any:
        if "view" not in info.data:
            # Whatever form it has, another view may be meant.
            return RampSizes(start_m=0.0, stop_m=0.0, step_m=1.0)
        view = info.data["view"]
        for field in _MISPLACED[view]:
            if isinstance(given, dict) and field in given:
                _refuse(f"nothing can stand here in the view {view} (nearest: view = 'faults')", given[field], field)
        return _FORMS[view].validate_python(given)


def _refuse(rule: str, given: object, *inner: str) -> NoReturn:
    """Refuse the field that is validated, or one within it; ``missing`` is the rule of one that has to be given."""
    kind = rule if rule == "missing" else PydanticCustomError("view", rule)
    raise ValidationError.from_exception_data("sweep", [InitErrorDetails(type=kind, loc=inner, input=given)])
