"""Error models: the standard deviation of each pseudorange, by name (equation 3 of Zhao et al. 2021)."""

from pl_mc.error_models.base import ORBIT_CLASSES, ErrorModel, Sky
from pl_mc.error_models.registry import DEFAULT_ERROR_MODEL, ERROR_MODELS, as_error_model, error_model

__all__ = ["DEFAULT_ERROR_MODEL", "ERROR_MODELS", "ORBIT_CLASSES", "ErrorModel", "Sky", "as_error_model", "error_model"]
