"""Real receivers: from RINEX files and a known position to a series `Geometry` with pseudorange errors."""

from pl_mc.receiver.fixes import Fixes
from pl_mc.receiver.observation_records import Event
from pl_mc.receiver.observations import ReceiverSeries, read_receiver_series
from pl_mc.receiver.rinex import ReceiverData, read_rinex
from pl_mc.receiver.truth import Truth, read_claims, read_truth

__all__ = [
    "Event",
    "Fixes",
    "ReceiverData",
    "ReceiverSeries",
    "Truth",
    "read_claims",
    "read_receiver_series",
    "read_rinex",
    "read_truth",
]
