"""pl_mc: how often does a protection level alarm, how often does it miss, under which fault, at which confidence?

The names below are the public interface. They are found on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pl_mc import araim, kernels, methods, noise_models
    from pl_mc.alert import APV_I, APV_II, LPV_200, AlertLimits
    from pl_mc.engine import detect, sample, solve, sweep
    from pl_mc.error_models import error_model
    from pl_mc.faults import Faults, biases, no_fault, ramp, ramps
    from pl_mc.geometry import Geometry, simulate
    from pl_mc.input_errors import InputError
    from pl_mc.integrity_risk.budget import risk_budget
    from pl_mc.integrity_risk.k_factor import calibrate
    from pl_mc.integrity_risk.rare import exposure, risk
    from pl_mc.integrity_risk.tuning import tune
    from pl_mc.integrity_risk.worst import worst_case
    from pl_mc.methods import Igg3 as igg3
    from pl_mc.methods import Ls as ls
    from pl_mc.noise_models import GaussianMixture as gaussian_mixture
    from pl_mc.noise_models import Multipath as multipath
    from pl_mc.noise_models import NominalBias as nominal_bias
    from pl_mc.noise_models import StudentT as student_t
    from pl_mc.noise_models import noise_model
    from pl_mc.service.volume import service_volume
    from pl_mc.statistics import exact, reliability
    from pl_mc.time_ramps import time_to_alert

__version__ = "0.1.0"

# Public name -> module, and its name there.
_PUBLIC = {
    "APV_I": ("pl_mc.alert", "APV_I"),
    "APV_II": ("pl_mc.alert", "APV_II"),
    "AlertLimits": ("pl_mc.alert", "AlertLimits"),
    "Faults": ("pl_mc.faults", "Faults"),
    "Geometry": ("pl_mc.geometry", "Geometry"),
    "InputError": ("pl_mc.input_errors", "InputError"),
    "LPV_200": ("pl_mc.alert", "LPV_200"),
    "araim": ("pl_mc.araim", None),
    "biases": ("pl_mc.faults", "biases"),
    "calibrate": ("pl_mc.integrity_risk.k_factor", "calibrate"),
    "detect": ("pl_mc.engine", "detect"),
    "error_model": ("pl_mc.error_models", "error_model"),
    "exact": ("pl_mc.statistics.exact", None),
    "exposure": ("pl_mc.integrity_risk.rare", "exposure"),
    "gaussian_mixture": ("pl_mc.noise_models", "GaussianMixture"),
    "igg3": ("pl_mc.methods", "Igg3"),
    "kernels": ("pl_mc.kernels", None),
    "ls": ("pl_mc.methods", "Ls"),
    "methods": ("pl_mc.methods", None),
    "multipath": ("pl_mc.noise_models", "Multipath"),
    "no_fault": ("pl_mc.faults", "no_fault"),
    "noise_model": ("pl_mc.noise_models", "noise_model"),
    "noise_models": ("pl_mc.noise_models", None),
    "nominal_bias": ("pl_mc.noise_models", "NominalBias"),
    "ramp": ("pl_mc.faults", "ramp"),
    "ramps": ("pl_mc.faults", "ramps"),
    "reliability": ("pl_mc.statistics", "reliability"),
    "risk": ("pl_mc.integrity_risk.rare", "risk"),
    "risk_budget": ("pl_mc.integrity_risk.budget", "risk_budget"),
    "sample": ("pl_mc.engine", "sample"),
    "service_volume": ("pl_mc.service.volume", "service_volume"),
    "simulate": ("pl_mc.geometry", "simulate"),
    "solve": ("pl_mc.engine", "solve"),
    "student_t": ("pl_mc.noise_models", "StudentT"),
    "sweep": ("pl_mc.engine", "sweep"),
    "time_to_alert": ("pl_mc.time_ramps", "time_to_alert"),
    "tune": ("pl_mc.integrity_risk.tuning", "tune"),
    "worst_case": ("pl_mc.integrity_risk.worst", "worst_case"),
}

__all__ = [
    "APV_I",
    "APV_II",
    "LPV_200",
    "AlertLimits",
    "Faults",
    "Geometry",
    "InputError",
    "__version__",
    "araim",
    "biases",
    "calibrate",
    "detect",
    "error_model",
    "exact",
    "exposure",
    "gaussian_mixture",
    "igg3",
    "kernels",
    "ls",
    "methods",
    "multipath",
    "no_fault",
    "noise_model",
    "noise_models",
    "nominal_bias",
    "ramp",
    "ramps",
    "reliability",
    "risk",
    "risk_budget",
    "sample",
    "service_volume",
    "simulate",
    "solve",
    "student_t",
    "sweep",
    "time_to_alert",
    "tune",
    "worst_case",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'pl_mc' has no attribute {name!r}")
    module_name, inside = _PUBLIC[name]
    module = importlib.import_module(module_name)
    value = module if inside is None else getattr(module, inside)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
