"""Ramps in time: how long errors that grow on one satellite stay unseen, by snapshot and sequential tests."""

from pl_mc.time_ramps.filter_bank import FilterBank
from pl_mc.time_ramps.kalman_innovation import KalmanInnovation
from pl_mc.time_ramps.protection import sequential_levels
from pl_mc.time_ramps.sequential_parity import SequentialParity
from pl_mc.time_ramps.signals import NoiseInTime
from pl_mc.time_ramps.timing import DEFAULT_METHODS, SEQUENTIAL, sequential, time_to_alert

__all__ = [
    "DEFAULT_METHODS",
    "SEQUENTIAL",
    "FilterBank",
    "KalmanInnovation",
    "NoiseInTime",
    "SequentialParity",
    "sequential",
    "sequential_levels",
    "time_to_alert",
]
