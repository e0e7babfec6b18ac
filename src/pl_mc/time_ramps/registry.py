"""Sequential tests by name, as experiment files call them."""

from __future__ import annotations

from typing import Any

from pl_mc.named import build_named
from pl_mc.time_ramps.kalman_innovation import KalmanInnovation
from pl_mc.time_ramps.sequential import SequentialTest
from pl_mc.time_ramps.sequential_parity import SequentialParity

SEQUENTIAL: dict[str, type] = {"sequential_parity": SequentialParity, "kalman": KalmanInnovation}


def sequential(name: str, **options: Any) -> SequentialTest:
    """A sequential test by name with its options; an `InputError` names what is unknown and the nearest choice."""
    return build_named(name, SEQUENTIAL, options, what="sequential test")
