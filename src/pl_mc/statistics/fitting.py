"""``pl_mc.fit_overbound``: an error model and a noise model from measured pseudorange errors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.error_models import ErrorModel, error_model
from pl_mc.input_errors import (
    InputError,
    require_fraction,
    require_list,
    require_numbers,
    require_positive,
    require_true,
    require_truth,
    require_within,
)
from pl_mc.noise_models import NoiseModel, noise_model
from pl_mc.runtime.whole_files import write_whole
from pl_mc.statistics.autocorrelation import effective_number, names_of, places_in_time
from pl_mc.statistics.overbound import FEWEST_SAMPLES, overbound

BINS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 90.0)

# Columns of a table of residuals, see `pl_mc.receiver.ReceiverSeries.residuals`.
_COLUMNS = ("error_m", "elevation_deg", "satellite", "time_gps_s")


@dataclass(frozen=True)
class OverboundFit:
    """What was fitted.

    Attributes:
        bins: one row per range of elevations: ``elevation_from_deg, elevation_to_deg, samples, independent, rms_m,
            sigma_m, bias_m, left_sigma_m, right_sigma_m, shown_to, unimodal``: the overbound N(+-bias, sigma) and the
            sigma that each tail alone needs; the tail probability down to which samples show it; whether a symmetric
            unimodal distribution goes between both, as errors that add up need it.
        laws: one row per distribution of errors over the RMS of their range: ``law, parameters, log_likelihood, aic``,
            likelihoods of as many samples as are independent; the smallest AIC is the best.
        confidence: probability that the bounds of all ranges hold together, down to ``shown_to``.
        notes: sentences about what was merged, taken for granted, and not shown.
    """

    bins: pd.DataFrame
    laws: pd.DataFrame
    confidence: float
    notes: tuple[str, ...]
    content: Mapping[str, Any]

    @property
    def error_model(self) -> ErrorModel:
        """The overbounding sigma by elevation, for weights and levels."""
        return error_model(**self.content["error_model"])

    @property
    def nominal_model(self) -> ErrorModel:
        """The RMS by elevation, of which nothing is bounded."""
        return error_model(**self.content["nominal_model"])

    @property
    def noise_model(self) -> NoiseModel:
        """The best law, in units of the overbounding sigma: what errors are where that sigma is believed."""
        return noise_model(**self.content["noise"])

    def write(self, path: str | Path) -> Path:
        """Store the models as TOML; its name then stands wherever an error model or a noise model is named."""
        lines = ["# Written by pl_mc.fit_overbound; its name stands wherever an error model or a noise model is named."]
        lines += [f"# {note}" for note in self.notes]
        for part, options in self.content.items():
            lines += ["", f"[{part}]", *(f"{key} = {json.dumps(value)}" for key, value in options.items())]
        for row in self.bins.to_dict("records"):
            lines += ["", "[[bins]]", *(f"{key} = {json.dumps(value)}" for key, value in row.items())]
        place = Path(path)
        write_whole(place, ("\n".join(lines) + "\n").encode())
        return place


@ordinary_arithmetic
def fit_overbound(
    residuals: ArrayLike | pd.DataFrame,
    *,
    elevation_deg: ArrayLike | None = None,
    satellite: ArrayLike | None = None,
    time_gps_s: ArrayLike | None = None,
    independent: float | None = None,
    bins_deg: Sequence[float] = BINS_DEG,
    confidence: float = 0.95,
    bias: bool = True,
) -> OverboundFit:
    """Gaussian overbound of measured errors by elevation, with a confidence, and the law that fits them best.

    See `pl_mc.statistics.overbound` for how the tails are bounded: by beta bands of order statistics, all at one level,
    of as many samples as are independent by the autocorrelation within each satellite. Ranges with fewer than 20 of
    these are joined with the next. What lies beyond the largest sample is extrapolated, and no data can show more.

    Args:
        residuals: (k,), pseudorange errors [m]; or a table with ``error_m`` and, each unless given beside,
            ``elevation_deg``, ``satellite`` and ``time_gps_s``, see `pl_mc.receiver.ReceiverSeries.residuals`.
        elevation_deg: (k,) [deg]; without it there is one range.
        satellite, time_gps_s: (k,), whose errors and when [s], for their correlation in time; without both the samples
            are taken as independent.
        independent: independent samples of all together, in place of that.
        bins_deg: edges of the ranges of elevation [deg].
        confidence: of all bounds together.
        bias: whether errors may be off zero, so that the bound is N(+-b, sigma); else both tails are taken for alike.

    Raises:
        InputError: fewer than 20 independent samples, errors that are no numbers, lists of different lengths.

    Example:
        >>> import numpy as np
        >>> import pl_mc
        >>> errors_m = np.random.default_rng(7).standard_normal(400)
        >>> pl_mc.fit_overbound(errors_m, bias=False).bins[["samples", "rms_m", "sigma_m"]].round(2)
           samples  rms_m  sigma_m
        0      400   0.93     1.38
    """
    given = {"elevation_deg": elevation_deg, "satellite": satellite, "time_gps_s": time_gps_s}
    if isinstance(residuals, pd.DataFrame):
        if "error_m" not in residuals:
            raise InputError("residuals: the table needs a column error_m.")
        given = {name: residuals.get(name) if value is None else value for name, value in given.items()}
        residuals = residuals["error_m"]
    values = require_numbers(residuals, field="residuals").ravel()
    require_fraction(confidence, field="confidence")
    with_bias = require_truth(bias, field="bias")
    if independent is not None:
        require_positive(independent, field="independent")
    for name, value in given.items():
        if value is not None:
            size = len(require_list(value, field=name, of="one for each residual"))  # type: ignore[arg-type]
            if size != values.size:
                raise InputError(f"{name}: {values.size} are needed, one for each residual, not {size}.")
    if not np.isfinite(values).all():
        raise InputError("residuals: every one is a finite number of metres.")
    notes: list[str] = []
    elevations = None if given["elevation_deg"] is None else _within_quarter(given["elevation_deg"])
    if elevations is None:
        elevations, edges = np.full(values.size, 45.0), np.array([0.0, 90.0])
    else:
        wanted = require_list(bins_deg, field="bins_deg", of="degrees")
        edges = np.array([require_within(one, field="bins_deg", low=0.0, high=90.0) for one in wanted])
        if edges.size < 2 or (np.diff(edges) <= 0).any():
            raise InputError(f"bins_deg: edges that increase are needed, two at least, not {wanted}.")
    place = np.searchsorted(edges, elevations, side="right") - 1
    place = place.clip(0, edges.size - 2)
    times = given["time_gps_s"] if given["satellite"] is not None else None
    places = None if times is None else places_in_time(_finite(times, "time_gps_s"))
    names = None if places is None else names_of(given["satellite"], field="satellite")  # type: ignore[arg-type]

    def number(rows: NDArray[np.bool_]) -> int:
        if independent is not None:
            return int(min(independent, values.size) * rows.mean())
        if places is None:
            return int(rows.sum())
        return int(effective_number(values[rows], places[rows], names[rows]))  # type: ignore[index]

    if independent is None and places is None:
        notes.append("The samples are taken as independent; satellite and time_gps_s would tell how far they are.")
    groups = _joined([place == k for k in range(edges.size - 1)], edges, number, notes)
    share = 1.0 - (1.0 - confidence) / len(groups)
    rows, unit = [], np.empty_like(values)
    for low, high, inside in groups:
        count = number(inside)
        found = overbound(values[inside], _rounded_down(count), share, with_bias=with_bias)
        rms = float(np.sqrt(np.mean(values[inside] ** 2)))
        unit[inside] = values[inside] / rms
        rows.append(
            {
                "elevation_from_deg": low, "elevation_to_deg": high, "samples": int(inside.sum()),
                "independent": count, "rms_m": rms, "sigma_m": found.sigma_m, "bias_m": found.bias_m,
                "left_sigma_m": found.left_m, "right_sigma_m": found.right_m, "shown_to": found.shown_to,
                "unimodal": found.unimodal,
            }
        )  # fmt: skip
    bins = pd.DataFrame(rows)
    if not bins.unimodal.all():
        notes.append(
            "No symmetric unimodal distribution lies between some bound and its samples: sums of such errors, as "
            "positions are, need not be bounded by it."
        )
    notes.append(
        f"Bounds hold with a confidence of {confidence:g} down to tail probabilities of {bins.shown_to.min():.2g} to "
        f"{bins.shown_to.max():.2g}; what a level at 1e-7 makes of them is extrapolated and shown by no sample."
    )
    laws, noise = _laws(
        unit, sum(row["independent"] for row in rows) / values.size, float((bins.rms_m / bins.sigma_m).max())
    )
    model = {"name": "by_elevation", "elevation_deg": [rows[0]["elevation_from_deg"], *bins.elevation_to_deg]}
    content = {
        "error_model": model | {"sigma_m": bins.sigma_m.tolist()},
        "nominal_model": model | {"sigma_m": bins.rms_m.tolist()},
        "noise": noise,
    }
    return OverboundFit(bins, laws, confidence, tuple(notes), content)


def _joined(
    inside: list[NDArray[np.bool_]], edges: NDArray[np.float64], number: Any, notes: list[str]
) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Ranges with enough independent samples each: those with fewer are joined with the next, the last backward."""
    groups: list[tuple[float, float, NDArray[np.bool_]]] = []
    start, rows = float(edges[0]), np.zeros_like(inside[0])
    for k, more in enumerate(inside):
        rows = rows | more
        if rows.any() and number(rows) >= FEWEST_SAMPLES:
            groups.append((start, float(edges[k + 1]), rows))
            start, rows = float(edges[k + 1]), np.zeros_like(rows)
    if start < edges[-1] and groups:
        low, _, before = groups.pop()
        groups.append((low, float(edges[-1]), before | rows))
    if not groups:
        there = number(rows) if rows.any() else 0
        raise InputError(f"residuals: at least {FEWEST_SAMPLES} independent samples are needed, not {there}.")
    if len(groups) < len(inside):
        notes.append(
            f"Ranges of elevation with fewer than {FEWEST_SAMPLES} independent samples are joined with others."
        )
    return groups


def _within_quarter(values: ArrayLike) -> NDArray[np.float64]:
    degrees = require_numbers(values, field="elevation_deg").ravel()
    require_true((degrees >= 0) & (degrees <= 90), field="elevation_deg", rule="0 to 90 degrees", of=degrees)
    return degrees


def _finite(values: ArrayLike, field: str) -> NDArray[np.float64]:
    numbers = require_numbers(values, field=field).ravel()
    require_true(np.abs(numbers) < 2**53, field=field, rule="a finite number of seconds is needed", of=numbers)
    return numbers


def _rounded_down(count: int) -> int:
    """Two digits of a count, so that bands are found once for many."""
    step = 10 ** max(0, len(str(count)) - 2)
    return count // step * step


def _laws(unit: NDArray[np.float64], weight: float, of_sigma: float) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Distributions of errors over their RMS by likelihood, and the best one as a noise model's name and options."""
    from scipy import optimize

    def best(density: Any, start: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        found = optimize.minimize(
            lambda parameters: -float(density(parameters).sum()), start, method="Nelder-Mead",
            options={"maxiter": 2000, "xatol": 1e-5, "fatol": 1e-4},
        )  # fmt: skip
        return found.x, -weight * float(found.fun)

    def normal(log_sigma: Any) -> NDArray[np.float64]:
        return -0.5 * (unit * np.exp(-log_sigma)) ** 2 - log_sigma - 0.5 * np.log(2.0 * np.pi)

    def student(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        nu, log_scale = 1.0 + np.exp(min(parameters[0], 8.0)), parameters[1]
        constant = special.gammaln((nu + 1) / 2) - special.gammaln(nu / 2) - 0.5 * np.log(nu * np.pi) - log_scale
        return constant - (nu + 1) / 2 * np.log1p((unit * np.exp(-log_scale)) ** 2 / nu)

    def mixture(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        chance, ratio = special.expit(parameters[0]), np.exp(min(parameters[1], 4.6))
        parts = np.log1p(-chance) + normal(parameters[2]), np.log(chance) + normal(parameters[2] + np.log1p(ratio))
        return np.logaddexp(*parts)

    rows: list[tuple[str, str, float, int]] = []
    noises: list[dict[str, Any]] = []
    parameters, likelihood = best(lambda p: normal(p[0]), [0.0])
    rows.append(("gaussian", f"sigma={np.exp(parameters[0]):.3g}", likelihood, 1))
    noises.append({"name": "gaussian"})
    (log_nu, log_scale), likelihood = best(student, [1.0, -0.2])
    nu, scale = 1.0 + float(np.exp(min(log_nu, 8.0))), float(np.exp(log_scale))
    # In units of the usual errors, which there are for every nu.
    unit_core = float(-special.stdtrit(nu, special.ndtr(-1.0)))
    rows.append(("student_t", f"nu={nu:.3g}, scale={scale:.3g}", likelihood, 2))
    noises.append({"name": "student_t", "nu": nu, "match": "core", "of_sigma": scale * unit_core * of_sigma})
    (logit, log_ratio, log_core), likelihood = best(mixture, [-2.5, 0.3, -0.2])
    chance, ratio = float(special.expit(logit)), 1.0 + float(np.exp(min(log_ratio, 4.6)))
    core = float(np.exp(log_core))
    rows.append(("gaussian_mixture", f"chance={chance:.3g}, scale={ratio:.3g}, core={core:.3g}", likelihood, 3))
    noises.append({"name": "gaussian_mixture", "chance": chance, "scale": ratio, "of_sigma": core * of_sigma})
    laws = pd.DataFrame(rows, columns=["law", "parameters", "log_likelihood", "numbers"])
    laws["aic"] = 2.0 * laws.pop("numbers") - 2.0 * laws.log_likelihood
    return laws, noises[int(laws.aic.argmin())]
