"""Methods: estimators with their protection levels and tests, one signature for all."""

from pl_mc.methods.araim import Araim
from pl_mc.methods.base import Method, Outcome
from pl_mc.methods.danish import Danish
from pl_mc.methods.hampel import Hampel
from pl_mc.methods.huber import Huber
from pl_mc.methods.ibpl import Ibpl
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.igg3_gated import GatedIgg3
from pl_mc.methods.l1 import L1
from pl_mc.methods.leave_one_out import LeaveOneOut
from pl_mc.methods.ls import Ls
from pl_mc.methods.m_estimator import MEstimator
from pl_mc.methods.max_dop import MaxDop
from pl_mc.methods.mm import MM
from pl_mc.methods.monitoring import Monitoring
from pl_mc.methods.nioraim import Nioraim
from pl_mc.methods.parity import Parity
from pl_mc.methods.range_comparison import RangeComparison
from pl_mc.methods.registry import METHODS, as_methods, method
from pl_mc.methods.sbas import Sbas
from pl_mc.methods.separated import Separated
from pl_mc.methods.slope import Slope
from pl_mc.methods.tukey import Tukey
from pl_mc.methods.w_test import WTest

__all__ = [
    "L1",
    "METHODS",
    "MM",
    "Araim",
    "Danish",
    "GatedIgg3",
    "Hampel",
    "Huber",
    "Ibpl",
    "Igg3",
    "LeaveOneOut",
    "Ls",
    "MEstimator",
    "MaxDop",
    "Method",
    "Monitoring",
    "Nioraim",
    "Outcome",
    "Parity",
    "RangeComparison",
    "Sbas",
    "Separated",
    "Slope",
    "Tukey",
    "WTest",
    "as_methods",
    "method",
]
