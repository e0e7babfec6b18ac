"""Noise models: how pseudorange errors are distributed, one signature for all.

Whatever the model, receivers and weights go on believing that an error has its satellite's sigma.
"""

from pl_mc.noise_models.base import GAUSSIAN, Gaussian, NoiseModel
from pl_mc.noise_models.empirical import Empirical
from pl_mc.noise_models.gauss_markov import GaussMarkov
from pl_mc.noise_models.heavy_tails import GaussianMixture, StudentT
from pl_mc.noise_models.off_centre import Multipath, NominalBias
from pl_mc.noise_models.registry import NOISE_MODELS, as_noise_model, noise_model

__all__ = [
    "GAUSSIAN",
    "NOISE_MODELS",
    "Empirical",
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
