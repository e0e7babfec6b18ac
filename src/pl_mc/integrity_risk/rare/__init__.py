"""Probabilities of rare events: importance sampling, subset simulation, and exposures counted in time."""

from pl_mc.integrity_risk.rare.exposure import exposure
from pl_mc.integrity_risk.rare.risk import risk

__all__ = ["exposure", "risk"]
