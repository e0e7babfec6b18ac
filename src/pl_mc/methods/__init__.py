"""Methods: estimators with their protection levels and tests, one file each, one signature."""

from pl_mc.methods.base import Method, Outcome
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.ls import Ls
from pl_mc.methods.registry import METHODS, as_methods, method

__all__ = ["METHODS", "Igg3", "Ls", "Method", "Outcome", "as_methods", "method"]
