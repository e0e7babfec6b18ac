"""Kernels: pure functions from arrays to arrays, for one scenario or many along the last axis."""

from pl_mc.kernels.counting import count_events
from pl_mc.kernels.estimate import Estimate, LeastSquaresSolution, start_from
from pl_mc.kernels.irls_options import IrlsOptions
from pl_mc.kernels.levels import ProtectionLevels, protection_levels
from pl_mc.kernels.linear_model import LinearModel, linear_model
from pl_mc.kernels.noise import epoch_key
from pl_mc.kernels.outcome import Method, Outcome
from pl_mc.kernels.parameters import static, traced
from pl_mc.kernels.reweighting import irls
from pl_mc.kernels.solvers import igg3, least_squares, ls
from pl_mc.kernels.weights import (
    DanishWeight,
    HampelWeight,
    HuberWeight,
    Igg3Weight,
    L1Weight,
    TukeyWeight,
    WeightFunction,
)

__all__ = [
    "DanishWeight",
    "Estimate",
    "HampelWeight",
    "HuberWeight",
    "Igg3Weight",
    "IrlsOptions",
    "L1Weight",
    "LeastSquaresSolution",
    "LinearModel",
    "Method",
    "Outcome",
    "ProtectionLevels",
    "TukeyWeight",
    "WeightFunction",
    "count_events",
    "epoch_key",
    "igg3",
    "irls",
    "least_squares",
    "linear_model",
    "ls",
    "protection_levels",
    "start_from",
    "static",
    "traced",
]
