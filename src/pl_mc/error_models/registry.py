"""Error models by name, and the check of whatever a caller offers as one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from pl_mc.error_models.base import ErrorModel
from pl_mc.error_models.by_elevation import by_elevation
from pl_mc.error_models.constant import constant
from pl_mc.error_models.dual_frequency import dual_frequency
from pl_mc.error_models.equation3 import none, residual, uire, user
from pl_mc.error_models.with_ism import WithIsm
from pl_mc.input_errors import InputError, require_choice, shown
from pl_mc.ism import as_ism
from pl_mc.runtime.model_files import is_model_file, model_in_file

DEFAULT_ERROR_MODEL = "residual"

ERROR_MODELS: Mapping[str, Callable[..., ErrorModel]] = MappingProxyType(
    {
        "residual": residual,
        "none": none,
        "uire": uire,
        "user": user,
        "constant": constant,
        "dual_frequency": dual_frequency,
        "by_elevation": by_elevation,
    }
)


def error_model(name: str = DEFAULT_ERROR_MODEL, *, ism: Any = None, **options: Any) -> ErrorModel:
    """The error model of that name.

    Args:
        name: one of `ERROR_MODELS`: ``residual`` (0.5 m of vertical ionosphere, DO-229 troposphere), ``none`` (the
            sigma0 term of equation 3 alone), ``uire`` (the bound of DO-229), ``user`` (figures of the caller),
            ``constant`` (one variance for each class of orbit, whatever the elevation), ``dual_frequency`` (code of
            two frequencies as in the ARAIM description, GPS and Galileo), ``by_elevation`` (one sigma for each range of
            elevations). Or a TOML file with one, as `pl_mc.fit_overbound` writes it.
        ism: an integrity support message, see `pl_mc.araim.Ism`, as a record, a table or the path of a CSV file: its
            sigma_URA, squared, adds to the variances of the model.
        options: options of the model; ``user``, ``constant`` and ``by_elevation`` have some, see
            `pl_mc.error_models.equation3.user`, `pl_mc.error_models.constant.constant` and
            `pl_mc.error_models.by_elevation.by_elevation`.

    Raises:
        InputError: an unknown name or option, with the nearest valid ones, or a figure out of range; an ISM that
            cannot be used.

    Example:
        >>> import pl_mc
        >>> model = pl_mc.error_model("constant", gps_m2=4.0)
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1, error_model=model)
        >>> g[0].sigma_m
        array([2., 2., 2., 2., 2., 2., 2., 2.])
    """
    if is_model_file(name):
        return model_in_file(name, "error_model", error_model, **({} if ism is None else {"ism": ism}), **options)
    model = ERROR_MODELS[require_choice(name, ERROR_MODELS, field="error model")](**options)
    return model if ism is None else WithIsm(model, as_ism(ism).with_field("sigma_ura_m"))


def as_error_model(value: str | ErrorModel) -> ErrorModel:
    """``value`` itself if it is an error model, else the model of that name.

    Any object with ``name``, ``sigma_m(sky)`` and ``describe()`` is an error model.

    Raises:
        InputError: an unknown name, or an object that lacks one of the three.
    """
    if isinstance(value, str):
        return error_model(value)
    if not isinstance(value, ErrorModel):
        raise InputError(
            f"error model: {shown(value)} is none; a name ({', '.join(ERROR_MODELS)}) or an object with name, "
            "sigma_m(sky) and describe() is needed."
        )
    return value
