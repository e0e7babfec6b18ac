"""The fault of each satellite or pair that makes a dangerous event likeliest."""

from pl_mc.integrity_risk.worst.worst_case import worst_case

__all__ = ["worst_case"]
