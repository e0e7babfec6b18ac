"""Faults as experiment files name them: a ramp of sizes, or a list of tables and texts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from pl_mc.faults import Faults, biases, biases_of_table, fault_label, fault_text, ramps, require_text
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.studies.spec import median_redundancy_satellite, require_existing
from pl_mc.studies.strict import Strict


class RampSizes(Strict):
    """Biases of the ramp [m]."""

    start_m: float
    stop_m: float
    step_m: float


class RampFaults(Strict):
    """The same ramp on one satellite.

    ``otherwise = "median_redundancy"``: where the satellite is out of view, the satellite of its system with the
    median redundancy number takes its place (the lower one of two), which the summary says.
    """

    satellite: str
    otherwise: Literal["median_redundancy"] | None = None
    start_m: float
    stop_m: float
    step_m: float

    def build(self, g: Geometry) -> tuple[Faults, tuple[str, ...]]:
        """The faults, and a sentence about the satellite."""
        name, why = self.satellite, "as asked for"
        if name not in g.names and self.otherwise is not None:
            require_existing(name, g)
            name = median_redundancy_satellite(g, system=self.satellite[:1])
            why = f"{self.satellite} is out of view; {name} has the median redundancy number of its system"
        faults = ramps(g, satellites=[name], start_m=self.start_m, stop_m=self.stop_m, step_m=self.step_m)
        if g.is_series:
            return faults, (f"Faulted satellite: {name} ({why}).",)
        row = g.names.index(name)
        elevation = np.degrees(g.elevation_rad[row])
        redundancy = redundancy_numbers(g)[row]
        return faults, (
            f"Faulted satellite: {name} ({why}); elevation {elevation:.1f} deg, redundancy number {redundancy:.3f}.",
        )


def _read_fault(text: Any) -> Any:
    """Text as it is, if it is a fault; what only a geometry can tell is left."""
    if not isinstance(text, str):
        raise PydanticCustomError("fault", "text such as G02:+30m is needed")
    return _refused_in_words(lambda: require_text(text))


def _refused_in_words(made: Callable[[], str]) -> str:
    """What is made; the sentence of an `InputError` is that of the field."""
    try:
        return made()
    except InputError as error:
        raise PydanticCustomError("fault", "{why}", {"why": str(error).removeprefix("biases: ").rstrip(".")}) from None


def _one_fault(given: Any) -> Any:
    table = isinstance(given, Mapping) and all(
        isinstance(value, int | float | list | tuple) and not isinstance(value, bool) for value in given.values()
    )
    if not (table or isinstance(given, str)):
        raise PydanticCustomError(
            "fault", "a table of biases in metres by satellite, or text such as G02:+30m, is needed"
        )
    if table and any(isinstance(value, list | tuple) for value in given.values()):
        # A distribution, ["uniform", 5, 100], has the text of its fault.
        return _refused_in_words(lambda: fault_text(biases_of_table(given)))
    return _read_fault(given) if isinstance(given, str) else given


# A fault as text; and as a table of biases by satellite too.
FaultText = Annotated[str, BeforeValidator(_read_fault)]
OneFault = Annotated[dict[str, float] | str, BeforeValidator(_one_fault)]


class ListedFaults(Strict):
    """Faults one by one, each a table of biases [m] or distributions by satellite, or a text, see
    `pl_mc.biases`.

    An empty table and ``none`` are the fault-free case.
    """

    biases: Annotated[tuple[OneFault, ...], Field(min_length=1)]

    def build(self, g: Geometry) -> tuple[Faults, tuple[str, ...]]:
        """The faults, in order."""
        return Faults.joined([biases(g, one) for one in self.biases]), ()

    def describe(self) -> str:
        """The faults in words."""
        return "; ".join(one if isinstance(one, str) else fault_label(one) for one in self.biases)


def fields_of(given: Any) -> Collection[str]:
    """The fields of a part of an experiment, as it is written or as a record."""
    return given if isinstance(given, Mapping) else getattr(type(given), "model_fields", ())


_FORM = Discriminator(lambda given: "Listed" if "biases" in fields_of(given) else "Ramp")
AnyFaults = Annotated[Annotated[RampFaults, Tag("Ramp")] | Annotated[ListedFaults, Tag("Listed")], _FORM]
SizesOrFaults = Annotated[Annotated[RampSizes, Tag("Ramp")] | Annotated[ListedFaults, Tag("Listed")], _FORM]
