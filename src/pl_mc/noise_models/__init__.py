"""Noise models: how pseudorange errors are distributed, one file each, one signature.

Whatever the model, receivers and weights go on believing that an error has its satellite's sigma.
"""

from pl_mc.noise_models.base import NoiseModel
from pl_mc.noise_models.gauss_markov import GaussMarkov
from pl_mc.noise_models.gaussian import GAUSSIAN, Gaussian
from pl_mc.noise_models.gaussian_mixture import GaussianMixture
from pl_mc.noise_models.multipath import Multipath
from pl_mc.noise_models.nominal_bias import NominalBias
from pl_mc.noise_models.registry import NOISE_MODELS, as_noise_model, noise_model
from pl_mc.noise_models.student_t import StudentT

__all__ = [
    "GAUSSIAN",
    "NOISE_MODELS",
    "GaussMarkov",
    "Gaussian",
    "GaussianMixture",
    "Multipath",
    "NoiseModel",
    "NominalBias",
    "StudentT",
    "as_noise_model",
    "noise_model",
]
