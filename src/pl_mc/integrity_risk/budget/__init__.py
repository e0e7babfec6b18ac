"""The risk budget of an approach: what each fault mode adds to it."""

from pl_mc.integrity_risk.budget.budget import risk_budget
from pl_mc.integrity_risk.budget.continuity import continuity

__all__ = ["continuity", "risk_budget"]
