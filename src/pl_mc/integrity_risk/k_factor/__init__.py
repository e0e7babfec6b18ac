"""The multiplier that a protection level needs, so that an event has the probability that is asked for."""

from pl_mc.integrity_risk.k_factor.calibrate import calibrate

__all__ = ["calibrate"]
