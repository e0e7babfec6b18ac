"""Limits of IGG-III that keep a risk at the smallest price."""

from pl_mc.integrity_risk.tuning.tune import tune

__all__ = ["tune"]
