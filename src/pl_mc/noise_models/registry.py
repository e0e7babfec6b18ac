"""Noise models by name, as experiment files and the command line call them."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, shown
from pl_mc.named import build_named, registry
from pl_mc.noise_models.base import Gaussian, NoiseModel
from pl_mc.noise_models.empirical import Empirical
from pl_mc.noise_models.gauss_markov import GaussMarkov
from pl_mc.noise_models.heavy_tails import GaussianMixture, StudentT
from pl_mc.noise_models.off_centre import Multipath, NominalBias
from pl_mc.runtime.model_files import is_model_file, model_in_file

NOISE_MODELS = registry(
    "noise",
    {
        "gaussian": Gaussian,
        "student_t": StudentT,
        "gaussian_mixture": GaussianMixture,
        "multipath": Multipath,
        "nominal_bias": NominalBias,
        "empirical": Empirical,
    },
)


def noise_model(name: str, **options: Any) -> NoiseModel:
    """A noise model by name with its options; an `InputError` names what is unknown and the nearest choice.

    A TOML file, such as `pl_mc.fit_overbound` writes, serves as a name as well.

    Example:
        >>> import pl_mc
        >>> pl_mc.noise_model("student_t", nu=5.0) == pl_mc.student_t(nu=5.0)
        True
    """
    if is_model_file(name):
        return model_in_file(name, "noise", noise_model, **options)
    return build_named(name, NOISE_MODELS, options, what="noise")


def as_noise_model(noise: str | NoiseModel, g: Geometry | None = None, *, rare: bool = False) -> NoiseModel:
    """A name or a record, made a record; an `InputError` for strangers and for what cannot serve a geometry.

    ``rare`` asks for one that has a tail, which searches for rare events follow.
    """
    if isinstance(noise, str):
        noise = noise_model(noise)
    if isinstance(noise, GaussMarkov):
        raise InputError(
            "noise: errors correlated in time are Gaussian at every epoch, so that no rate per epoch changes; "
            "pl_mc.exposure counts what does."
        )
    # A compiled function is found again by its records, so they have to be hashable.
    if isinstance(noise, type) or not isinstance(noise, NoiseModel) or not isinstance(noise, Hashable):
        raise InputError(f"noise: {shown(noise)} is no noise model (valid names: {', '.join(NOISE_MODELS)}).")
    if rare and not getattr(noise, "has_tail", True):
        raise InputError(
            f"noise: {noise.name} has nothing beyond the errors of its file, and this needs a tail; "
            "pl_mc.fit_overbound fits a law to them."
        )
    if g is not None:
        noise.require_geometry(g)
    return noise
