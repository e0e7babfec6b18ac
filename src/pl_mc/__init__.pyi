# The public names, once: editors and type checkers read this file, and so does `pl_mc` itself.
from pl_mc import araim as araim
from pl_mc import kernels as kernels
from pl_mc import methods as methods
from pl_mc import noise_models as noise_models
from pl_mc.alert import APV_I as APV_I
from pl_mc.alert import APV_II as APV_II
from pl_mc.alert import LPV_200 as LPV_200
from pl_mc.alert import AlertLimits as AlertLimits
from pl_mc.engine import detect as detect
from pl_mc.engine import sample as sample
from pl_mc.engine import solve as solve
from pl_mc.engine import sweep as sweep
from pl_mc.error_models import error_model as error_model
from pl_mc.faults import Faults as Faults
from pl_mc.faults import biases as biases
from pl_mc.faults import no_fault as no_fault
from pl_mc.faults import pairs as pairs
from pl_mc.faults import ramp as ramp
from pl_mc.faults import ramps as ramps
from pl_mc.geometry import Geometry as Geometry
from pl_mc.geometry import simulate as simulate
from pl_mc.input_errors import InputError as InputError
from pl_mc.integrity_risk.budget import continuity as continuity
from pl_mc.integrity_risk.budget import risk_budget as risk_budget
from pl_mc.integrity_risk.given_residuals import RiskBudget as RiskBudget
from pl_mc.integrity_risk.given_residuals import level_risk as level_risk
from pl_mc.integrity_risk.k_factor import calibrate as calibrate
from pl_mc.integrity_risk.rare import exposure as exposure
from pl_mc.integrity_risk.rare import risk as risk
from pl_mc.integrity_risk.tuning import tune as tune
from pl_mc.integrity_risk.worst import worst_case as worst_case
from pl_mc.noise_models import noise_model as noise_model
from pl_mc.service.volume import service_volume as service_volume
from pl_mc.statistics import exact as exact
from pl_mc.statistics import reliability as reliability
from pl_mc.statistics.fitting import fit_overbound as fit_overbound
from pl_mc.time_ramps import sequential_levels as sequential_levels
from pl_mc.time_ramps import time_to_alert as time_to_alert

# Records that are called like functions.
empirical = noise_models.Empirical
gaussian_mixture = noise_models.GaussianMixture
igg3 = methods.Igg3
ls = methods.Ls
multipath = noise_models.Multipath
nominal_bias = noise_models.NominalBias
student_t = noise_models.StudentT

__version__: str
