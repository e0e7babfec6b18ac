"""Methods: estimators with their protection levels and tests, one signature for all."""

from pl_mc.methods.araim import Araim
from pl_mc.methods.base import Method, Outcome
from pl_mc.methods.exclusion import LeaveOneOut, WTest
from pl_mc.methods.ls import Ls, Sbas
from pl_mc.methods.m_estimator import L1, MM, Danish, GatedIgg3, Hampel, Huber, Igg3, MEstimator, Tukey
from pl_mc.methods.nioraim import Nioraim
from pl_mc.methods.parity import Parity
from pl_mc.methods.range_comparison import RangeComparison
from pl_mc.methods.registry import METHODS, as_methods, method
from pl_mc.methods.slope import MaxDop, Slope

__all__ = [
    "L1",
    "METHODS",
    "MM",
    "Araim",
    "Danish",
    "GatedIgg3",
    "Hampel",
    "Huber",
    "Igg3",
    "LeaveOneOut",
    "Ls",
    "MEstimator",
    "MaxDop",
    "Method",
    "Nioraim",
    "Outcome",
    "Parity",
    "RangeComparison",
    "Sbas",
    "Slope",
    "Tukey",
    "WTest",
    "as_methods",
    "method",
]
