"""Risk of a level given the residuals: what is Gaussian and independent of them is integrated, not drawn."""

from pl_mc.integrity_risk.given_residuals.budget import RiskBudget
from pl_mc.integrity_risk.given_residuals.level_risk import level_risk

__all__ = ["RiskBudget", "level_risk"]
