"""The risk budget of an approach: what each fault mode adds to it."""

from pl_mc.integrity_risk.budget.budget import risk_budget

__all__ = ["risk_budget"]
