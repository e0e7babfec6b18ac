"""The record of an experiment of the kind ``variants``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field

from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3, Method, as_methods, method
from pl_mc.studies.fault_fields import RampSizes
from pl_mc.studies.spec import ByOneLevel, MethodChoice, SimulatedGeometry
from pl_mc.studies.strict import Strict

# The variant that has nothing but defaults.
DEFAULT = "default"


class Variant(Strict):
    """One variant.

    Attributes:
        group: variants of one group stand together in a figure.
        label: its name in tables and figures.
        method: ``igg3``, or another method of the same kind, such as ``igg3_gated``.
        options: what differs from that method's defaults.
    """

    group: str
    label: str
    method: str = "igg3"
    options: dict[str, Any] = Field(default_factory=dict)

    def build(self) -> Igg3:
        """The method's record."""
        made = method(self.method, **self.options)
        if not isinstance(made, Igg3):
            raise InputError(f"variants: {self.label}: method: {self.method!r} is no variant of igg3.")
        return made


class VariantsExperiment(ByOneLevel):
    """Variants of IGG-III, with its defaults in front and ``methods`` beside.

    Attributes:
        draws: noise draws for each fault.
        weight_draws: draws, of those, whose weights are looked at.
        geometry: a series, of which the epochs with the smallest and the largest VDOP (in metres) are taken; HDOP where
            the horizontal limit decides.
        faults: sizes of the ramps.
    """

    kind: Literal["variants"] = "variants"
    methods: tuple[MethodChoice, ...] = (MethodChoice(name="ls"),)
    draws: int = Field(ge=1)
    weight_draws: int = Field(default=2000, ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry()
    faults: RampSizes
    variants: Annotated[tuple[Variant, ...], Field(min_length=1)]

    def method_records(self) -> tuple[Method, ...]:
        """Those beside, the default, and the variants."""
        return as_methods([*super().method_records(), Igg3(), *(variant.build() for variant in self.variants)])

    def legend(self) -> pd.DataFrame:
        """``group, variant, method`` of each method, in order; ``group`` is empty for those beside the variants."""
        rows = [("", choice.build().name, choice.build().name) for choice in self.methods]
        rows += [("", DEFAULT, Igg3().name)]
        rows += [(variant.group, variant.label, variant.build().name) for variant in self.variants]
        return pd.DataFrame(rows, columns=["group", "variant", "method"])
