"""Exact probabilities and the statistics of counts, against which Monte Carlo results are held."""

from pl_mc.statistics.exact import ls_rates
from pl_mc.statistics.intervals import binomial_p_value, clopper_pearson, shared_noise_bounds
from pl_mc.statistics.least_squares import FaultEffects, LsQuantities, fault_effects, ls_quantities
from pl_mc.statistics.noncentral import joint_exceedance, split_at_threshold
from pl_mc.statistics.reliability import least_detectable, noncentral_shift, reliability, reliability_matrix
from pl_mc.statistics.student import chi2_threshold, fault_free_exceeded, student_factor

__all__ = [
    "FaultEffects",
    "LsQuantities",
    "binomial_p_value",
    "chi2_threshold",
    "clopper_pearson",
    "fault_effects",
    "fault_free_exceeded",
    "joint_exceedance",
    "least_detectable",
    "ls_quantities",
    "ls_rates",
    "noncentral_shift",
    "reliability",
    "reliability_matrix",
    "shared_noise_bounds",
    "split_at_threshold",
    "student_factor",
]
