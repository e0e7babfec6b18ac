"""Continuity of ARAIM: alarms in an exposure, without a fault and under the faults that may begin in it.

Without a fault an alarm takes a failed test. Tests are half-spaces of the noise, so that the union of all of them is
sampled where it is: a test is chosen in proportion to its own probability p_j, noise is drawn given that it fails, and
counts with sum p / (number of tests that fail). That is unbiased for any event inside of the union, with weights that
no draw exceeds (Adler, Blanchet & Liu 2012, Annals of Applied Probability 22(3)).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.alert import LPV_200, AlertLimits, as_axis
from pl_mc.araim.budget import V42
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_SEED, require_geometry_and_alert, require_single
from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.input_errors import InputError, require_fraction, require_numbers, require_whole
from pl_mc.ism import satellite_codes
from pl_mc.kernels import LinearModel, linear_model
from pl_mc.kernels.counting import Biases
from pl_mc.kernels.events import alarms, limits_of
from pl_mc.kernels.linear_model import product
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.kernels.scenarios import each_fault
from pl_mc.methods import Method, as_methods
from pl_mc.methods.araim import NONE, Araim
from pl_mc.methods.raim_levels import thresholds
from pl_mc.runtime.precision import on_device, precision_scope
from pl_mc.statistics.intervals import clopper_pearson, shared_noise_bounds

FAULT_FREE, TOTAL = "none", "total"
_CONFIDENCE = 0.95
# Lanes of a call: at least, and at most.
_FEWEST_LANES, _LANES = 1024, 4096
# Continuity of LPV-200, 8e-6 in any 15 s (ICAO Annex 10), over the 150 s of an approach.
LPV_200_CONTINUITY = 8e-5


@dataclass(frozen=True)
class _Epoch:
    """One geometry for the compiled functions: design (n, t) [m/m], sigma [m] and codes of satellites (n,)."""

    design: FloatArray
    sigma_m: FloatArray
    satellite: Any

    def __call__(self) -> tuple[Array, Array, Any]:
        return on_device(self.design), on_device(self.sigma_m), self.satellite


def has_exposure(method: object) -> bool:
    """Whether a method is ARAIM with priors over an exposure."""
    return isinstance(method, Araim) and method.standard == V42 and method.budget.exposure_h > 0


@ordinary_arithmetic
def continuity(
    g: Geometry,
    methods: Sequence[str | Method],
    *,
    sizes_m: ArrayLike = (5.0, 10.0, 20.0, 50.0),
    draws: int = 2048,
    rare_draws: int = 65536,
    seed: int = 0,
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    required: float = LPV_200_CONTINUITY,
) -> pd.DataFrame:
    """Alarms of ARAIM v4.2 in an exposure, against what the false-alarm budget and continuity allow.

    An exposure has the budget's N_es independent samples. Noise is Gaussian with the standard deviation of the
    accuracy model (that of the geometry with sigma_URE in place of sigma_URA), unbiased. A fault interrupts an
    operation if it begins in it, with the probability of its rate times the exposure, and lasts to its end; of each
    satellite the size of ``sizes_m`` with the most alarms counts. Faults of constellations, of which nothing is
    simulated, count as alarms.

    Args:
        g: one epoch.
        methods: `pl_mc.methods.Araim` with standard v4.2 and an exposure, with exclusion or without.
        sizes_m: (s,), biases that are tried [m].
        draws: for each satellite and size.
        rare_draws: without a fault, all of them with a failed test.
        seed: chooses the noise, 0 to 2^32 - 1.
        alert: alert limits; a level beyond its limit is an alarm.
        axis: which of them decide, ``vertical``, ``horizontal`` or ``either``; as in a sweep unless given.
        required: probability of an interruption that the operation allows in an exposure.

    Returns:
        For each method one row without a fault (``none``), one for each satellite and each constellation, and one in
        ``total``:

        - ``method, fault, bias_m``;
        - ``alarm, alarm_low, alarm_high``, of a sample; without a fault by draws of failed tests;
        - ``exposed, exposed_low, exposed_high``, of at least one alarm in the exposure;
        - ``prior``, that the fault begins in it (1 without a fault), and ``contribution, contribution_low,
          contribution_high``, the product; in ``total`` their sums;
        - ``allocation``: without a fault P_FA of the budget, in ``total`` ``required``, else NaN.

        Bounds are 95 %, of Clopper and Pearson; sums of bounds bound sums more widely.

    Raises:
        InputError: what cannot be used.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> rates = {"r_sat_per_h": 1e-5, "mfd_sat_h": 1.0, "r_const_per_h": 1e-8, "mfd_const_h": 1.0}
        >>> araim = pl_mc.methods.method("araim", standard="v4.2", budget="LPV-200 v4.2", ism=rates)
        >>> table = pl_mc.continuity(g, araim, sizes_m=20.0, draws=1024, rare_draws=1024)
        >>> table[["fault", "prior", "allocation"]].iloc[[0, 1, -1]]
            fault         prior  allocation
        0    none  1.000000e+00    0.000004
        1     G01  4.166667e-07         NaN
        10  total           NaN    0.000080
    """
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    require_single(g, "continuity")
    judged = as_axis(axis, alert)
    records: list[Araim] = []
    for record in as_methods(methods, g):
        if not isinstance(record, Araim) or not has_exposure(record):
            raise InputError(
                f"methods: {record.name}: continuity is that of araim with standard='v4.2' and an exposure (nearest: "
                "method('araim', standard='v4.2', budget='LPV-200 v4.2', ism=...))."
            )
        records.append(record)
    sizes = np.atleast_1d(require_numbers(sizes_m, field="sizes_m"))
    if sizes.ndim != 1 or not sizes.size or not np.isfinite(sizes).all() or np.unique(sizes).size < sizes.size:
        raise InputError("sizes_m: one row of different finite sizes is needed, such as (5, 10, 20).")
    draws = require_whole(draws, field="draws", low=16, high=2**22)
    rare_draws = require_whole(rare_draws, field="rare_draws", low=256, high=2**22)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    required = require_fraction(required, field="required")
    series = g.as_series()
    epoch = _Epoch(np.asarray(g.design), np.asarray(g.sigma_m), satellite_codes(series, series.satellite[0]))
    with precision_scope("float64"):
        limits_m = limits_of(alert, np.float64)
        rows = [
            row
            for record in records
            for row in _of_method(g, epoch, record, sizes, (draws, rare_draws, seed), limits_m, judged, required)
        ]
    return pd.DataFrame(rows)


def _of_method(
    g: Geometry, epoch: _Epoch, method: Araim, sizes: FloatArray, numbers: tuple[int, int, int], limits_m: Any,
    axis: str, required: float,
) -> list[dict[str, Any]]:  # fmt: skip
    draws, rare_draws, seed = numbers
    n, budget, ism, trees = len(g.names), method.budget, method.ism, as_trees((method,))
    root, tests, limit = (np.asarray(part) for part in _tests(*epoch(), trees))

    bias = (sizes[:, None, None] * np.eye(n)).reshape(-1, n)
    width = int(np.clip(draws, _FEWEST_LANES, _LANES))

    def alarming(noise: FloatArray, bias_m: FloatArray) -> FloatArray:
        lanes, faults = noise.shape[1], len(bias_m)
        # Parts of one width and as many faults, of which some do not apply, so that one program does for all.
        padded = np.pad(noise, ((0, 0), (0, -lanes % width)))
        rows = on_device(np.pad(bias_m, ((0, len(bias) - faults), (0, 0))))
        applies = on_device(np.arange(len(bias)) < faults)
        found = [
            np.asarray(_alarms(*epoch(), on_device(part), rows, applies, limits_m, trees, axis=axis))
            for part in np.split(padded, padded.shape[1] // width, axis=1)
        ]
        return np.concatenate(found, axis=1)[:faults, :lanes]

    rows = [_row(method, FAULT_FREE, 0.0, 1.0)]
    noise, share, union = failing(tests, limit, root, _chi2(method, epoch, root), rare_draws, seed)
    # The first lane has no noise at all: where it alarms, all do.
    (always, *alarmed) = alarming(np.column_stack([np.zeros(n), noise]), np.zeros((1, n)))[0]
    weight = np.asarray(alarmed) * share
    # Shares of at most one spread no more than counts of the same mean.
    low, high = map(float, shared_noise_bounds(min(weight.mean(), 1.0), rare_draws, _CONFIDENCE))
    found = (1.0, 1.0, 1.0) if always else (union * weight.mean(), union * low, min(union * high, 1.0))
    rows[0] |= _columns("alarm", found)
    rng = np.random.Generator(np.random.Philox([seed, 1]))
    unit = root[:, None] * rng.standard_normal((n, draws))
    counts = alarming(unit, bias).sum(axis=1).reshape(len(sizes), n)
    begins = ism.values("r_sat_per_h", g.names, g.systems) * budget.exposure_h
    for k, name in enumerate(g.names):
        worst = int(np.argmax(counts[:, k]))
        rate = (counts[worst, k] / draws, *map(float, clopper_pearson(counts[worst, k], draws, _CONFIDENCE)))
        rows.append(_row(method, name, float(sizes[worst]), float(begins[k])) | _columns("alarm", rate))
    letters = list(dict.fromkeys(g.systems))
    for letter, rate_per_h in zip(letters, ism.values("r_const_per_h", letters, letters), strict=True):
        prior = float(rate_per_h) * budget.exposure_h
        rows.append(_row(method, SYSTEM_NAMES[letter], np.nan, prior) | _columns("alarm", (1.0, 1.0, 1.0)))
    for row in rows:
        # log(1 - 1) is minus infinity, and its exponential nothing.
        with np.errstate(divide="ignore"):
            exposed = [-np.expm1(budget.samples_continuity * np.log1p(-row[f"alarm{end}"])) for end in _ENDS]
        row |= _columns("exposed", exposed) | {"prior": row.pop("prior")}
        row |= _columns("contribution", [row["prior"] * value for value in exposed])
        allowed = budget.p_fa_vertical + budget.p_fa_horizontal if row["fault"] == FAULT_FREE else np.nan
        row |= {"allocation": allowed}
    sums = [min(sum(row[f"contribution{end}"] for row in rows), 1.0) for end in _ENDS]
    total = _row(method, TOTAL, np.nan, np.nan) | _columns("alarm", [np.nan] * 3) | _columns("exposed", [np.nan] * 3)
    total |= {"prior": total.pop("prior")} | _columns("contribution", sums)
    return [*rows, total | {"allocation": required}]


_ENDS = ("", "_low", "_high")


def _row(method: Method, fault: str, bias_m: float, prior: float) -> dict[str, Any]:
    return {"method": method.name, "fault": fault, "bias_m": bias_m, "prior": prior}


def _columns(name: str, values: Sequence[float]) -> dict[str, float]:
    return {f"{name}{end}": float(value) for end, value in zip(_ENDS, values, strict=True)}


def _chi2(method: Araim, epoch: _Epoch, root: FloatArray) -> tuple[FloatArray, float] | None:
    """Orthonormal columns (n, dof) that span what residuals see of the noise, and a radius inside of V'PV's limit."""
    if method.exclusion == NONE:
        return None
    whitened = epoch.design / epoch.sigma_m[:, None]
    basis = np.linalg.svd(whitened[:, whitened.any(axis=0)], full_matrices=False)[0]
    residual = np.eye(len(root)) - basis @ basis.T
    size, columns = np.linalg.eigh(root[:, None] * residual * root)
    seen = columns[:, size > 1e-9]
    limit = float(thresholds(len(root), method.p_fa_chi2)[seen.shape[1]])
    return seen, limit / float(size.max())


def failing(
    tests: FloatArray, limit: FloatArray, root: FloatArray, chi2: tuple[FloatArray, float] | None, draws: int,
    seed: int,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """Noise of which some test fails, its shares, and the sum of the tests' own probabilities.

    Args:
        tests: (j, n), what each test sees of whitened errors, and limit: (j,), the size that passes.
        root: (n,), standard deviation of the noise over that of the whitening.
        chi2: columns (n, dof) and a squared radius of the unit noise along them, beyond which V'PV may be too large.
        draws: how many.
        seed: chooses them.

    Returns:
        Whitened noise (n, draws), one over the number of tests that fail (draws,), and the sum.
    """
    rng = np.random.Generator(np.random.Philox([seed, 0]))
    along = tests * root
    length = np.linalg.norm(along, axis=1)
    kept = (length > 0) & np.isfinite(limit)
    along, beta = along[kept] / length[kept, None], limit[kept] / length[kept]
    own = 2.0 * special.ndtr(-beta)
    columns, square = chi2 if chi2 is not None else (np.zeros((len(root), 0)), np.inf)
    tail = float(special.chdtrc(columns.shape[1], square)) if columns.shape[1] else 0.0
    chances = np.append(own, tail)
    total = float(chances.sum())
    unit = rng.standard_normal((draws, len(root)))
    chosen = rng.choice(len(chances), size=draws, p=chances / total)
    part, sign = rng.uniform(size=draws), rng.choice([-1.0, 1.0], size=draws)
    plane = chosen < len(beta)
    j = chosen[plane]
    size = -sign[plane] * special.ndtri(part[plane] * special.ndtr(-beta[j]))
    unit[plane] += (size - np.einsum("di,di->d", unit[plane], along[j]))[:, None] * along[j]
    inside = unit[~plane] @ columns
    radius = np.sqrt(special.chdtri(columns.shape[1], part[~plane] * tail)) if columns.shape[1] else np.zeros(0)
    if inside.size:
        unit[~plane] += (inside * (radius / np.linalg.norm(inside, axis=1) - 1.0)[:, None]) @ columns.T
    fail = (np.abs(unit @ along.T) > beta * (1.0 - 1e-12)).sum(axis=1)
    fail = fail + (((unit @ columns) ** 2).sum(axis=1) > square * (1.0 - 1e-12))
    return (unit * root).T, 1.0 / np.maximum(fail, 1), total


@jax.jit
def _tests(design: Array, sigma_m: Array, satellite: Any, trees: Trees) -> tuple[Array, Array, Array]:
    """Root of the accuracy's over the integrity's variance (n,); the tests of all in view (j, n) and their limits."""
    (method,) = of_trees(trees)
    model = _model(design, sigma_m, satellite)
    whole = method.prepare(model).whole
    gain = whole.gain.reshape(-1, design.shape[0])
    # Of residuals, so of errors less what is fitted to them.
    seen = gain - product(product(gain, model.design), model.gain)
    return jnp.sqrt(method.accuracy(model)), seen, whole.limit_m.reshape(-1)


@functools.partial(jax.jit, static_argnames=("axis",))
def _alarms(
    design: Array, sigma_m: Array, satellite: Any, noise: Array, bias_m: Array, applies: Array, limits_m: Any,
    trees: Trees, *, axis: str,
) -> Array:  # fmt: skip
    """(f, lanes), which scenarios alarm: noise (n, lanes), whitened, plus biases (f, n) [m] where they apply (f,)."""
    (method,) = of_trees(trees)
    model = _model(design, sigma_m, satellite)
    prepared = method.prepare(model)
    return each_fault(
        model, Biases(bias_m, applies), noise,
        lambda start, _: alarms(method.solve(model, prepared, start), limits_m, axis),
        skipped=jnp.zeros(noise.shape[1], bool),
    )  # fmt: skip


def _model(design: Array, sigma_m: Array, satellite: Any) -> LinearModel:
    return linear_model(design, sigma_m, jnp.ones(sigma_m.shape, bool), satellite=satellite)
