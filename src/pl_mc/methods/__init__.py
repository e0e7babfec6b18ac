"""Methods: estimators with their protection levels and tests, one file each, one signature."""

from pl_mc.methods.araim import Araim
from pl_mc.methods.base import Method, Outcome
from pl_mc.methods.gated_igg3 import GatedIgg3
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.ls import Ls
from pl_mc.methods.registry import METHODS, as_methods, method

__all__ = ["METHODS", "Araim", "GatedIgg3", "Igg3", "Ls", "Method", "Outcome", "as_methods", "method"]
