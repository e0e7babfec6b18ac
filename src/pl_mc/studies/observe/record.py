"""What a file says of an observation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from pl_mc.studies.fault_fields import FaultText
from pl_mc.studies.sources import where_it_is
from pl_mc.studies.spec import ByOneAxis, ReceiverFiles, numbered


class ObserveExperiment(ByOneAxis, ReceiverFiles):
    """Receiver files and a true position or track; see `pl_mc.receiver.read_receiver_series`.

    ``faults`` holds texts such as ``G02:+30m:545-645``, see `pl_mc.biases`; all of them are added to the errors, those
    that are drawn as the seed has them, anew at each epoch. ``claims`` are files in which the receiver, or a program,
    says how good its own positions are: a ``.pos`` of RTKLIB, an NMEA log with GST, a UBX log, a table; a standard
    deviation in them becomes a protection level by ``claim_multiplier``, 6.18 horizontally and 5.33 vertically unless
    given.
    """

    kind: Literal["observe"] = "observe"
    faults: tuple[FaultText, ...] = ()
    claims: tuple[Path, ...] = ()
    claim_multiplier: float | None = Field(default=None, gt=0)
    residuals: bool = False

    @field_validator("claim_multiplier")
    @classmethod
    def _of_claims(cls, multiplier: float | None, info: ValidationInfo) -> float | None:
        if multiplier is not None and info.data.get("claims") == ():
            raise PydanticCustomError(
                "claims", "without claims there is nothing that it makes levels of, and none is to be given"
            )
        return multiplier

    def input_files(self) -> Mapping[str, Path]:
        """The RINEX files, the track where the truth is one, and the claims, each where it is found."""
        given = self.receiver_files() | numbered("claims", self.claims)
        return {field: where_it_is(path) for field, path in given.items()}
