"""Events over an exposure: how often does at least one happen in 150 s, where errors are correlated in time?

A rate per sample does not say. Were the samples independent, 1 - (1 - p)^m of m samples would hold an event, about
m p; were the error one and the same throughout, p. What lies between is counted here, exposure by exposure, and
told as the number of independent samples that would do the same.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.alert import LPV_200, VERTICAL, AlertLimits, as_axis, unjudged_note
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.engine.calls import Chunk, run_calls
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_inputs, require_single
from pl_mc.engine.core import EpochBatch, prepare_epoch
from pl_mc.engine.plan import make_plan
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_numbers, require_positive, require_whole, shown
from pl_mc.kernels.events import EVENTS, events, limits_of
from pl_mc.kernels.noise import LANES, epoch_key, live_lanes
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.kernels.scenarios import each_outcome
from pl_mc.methods import Method, Outcome, as_methods
from pl_mc.noise_models import GAUSSIAN, NoiseModel, as_noise_model
from pl_mc.noise_models.gauss_markov import GaussMarkov, step
from pl_mc.runtime.precision import dtype_of, on_device
from pl_mc.runtime.progress import progress_bar
from pl_mc.statistics.intervals import clopper_pearson, rate_columns

CONFIDENCE = 0.95

# Numbers of exposures come from keys beyond those of blocks and of the further numbers of single epochs.
_EXPOSURES = 2**31 + 2**30
_MOST_SAMPLES = 100_000
# Fewer exposures with an event have no normal distribution, and the number of independent samples no interval.
_FEWEST = 10


@ordinary_arithmetic
def exposure(
    g: Geometry,
    faults: Faults,
    *,
    tau_s: ArrayLike,
    draws: int,
    seed: int,
    duration_s: float = 150.0,
    interval_s: float = 1.0,
    methods: Sequence[str | Method] = ("ls", "igg3"),
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    noise: str | NoiseModel = GAUSSIAN,
    precision: str = "float64",
    progress: bool | None = None,
) -> pd.DataFrame:
    """Events in exposures to errors that are correlated in time.

    The standard normal numbers behind every satellite's error are stationary first-order Gauss-Markov processes,
    independent of each other, see `pl_mc.noise_models.gauss_markov`. Under any other noise model the errors that
    are made of them keep that model's distribution at every sample. Geometry, biases and sigma stay as they are for
    the whole exposure, so that nothing but noise changes from sample to sample.

    Args:
        g: one epoch.
        faults: bias vectors, from `ramp`, `biases` or `no_fault`.
        tau_s: (k,), correlation times [s]; 0 for independent samples, infinite for an error that stays.
        draws: exposures for each fault and correlation time; every method sees the same ones.
        seed: chooses the noise, 0 to 2^32 - 1.
        duration_s: length of an exposure [s].
        interval_s: between samples [s], a whole number of times in the duration.
        methods, alert, noise, precision: as for `pl_mc.sweep`.
        axis: which limit decides, ``vertical``, ``horizontal`` or ``either``; the vertical one unless given, the
            horizontal one where there is no other.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        One row per correlation time, fault, method and event of `pl_mc.kernels.events`: ``tau_s, fault, bias_m,
        method, event`` (and ``axis`` behind the method where one was given or the horizontal limit decides);
        ``exposures``, ``samples`` of each; ``exposures_with``, those with the event at least once, and ``any_rate,
        any_low, any_high``, their share with 95 % Clopper-Pearson bounds; ``samples_with``, ``sample_rate`` and
        ``sample_error``, the rate per sample with the standard error that exposures scatter by (samples of one
        exposure are no independent ones); ``independent_rate``, 1 - (1 - sample_rate)^samples; and
        ``effective_samples``, log(1 - any_rate) / log(1 - sample_rate), the number of independent samples with the
        same share of exposures, with ``effective_low, effective_high`` (95 %, delta method on its logarithm;
        from ten exposures with the event on); NaN
        where the event was seen in no exposure or in all.

    Raises:
        InputError: a series of epochs, options outside their range, or a duration that is no multiple of the
            interval.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> options = {"tau_s": 30.0, "duration_s": 10.0, "draws": 20, "seed": 7, "progress": False}
        >>> table = pl_mc.exposure(g, pl_mc.biases(g, "G08:+20m"), methods="ls", **options)
        >>> table[["event", "exposures", "exposures_with"]].head(2)
            event  exposures  exposures_with
        0   alarm         20              20
        1  hazard         20               0
    """
    alert = require_inputs(g, faults, alert, any_axis=True)
    judged = as_axis(axis, alert)
    require_single(g, "an exposure")
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    model = as_noise_model(noise, g, rare=True)
    chosen = as_methods(methods, g)
    samples = samples_of(duration_s, interval_s)
    taus = _taus(tau_s)
    plan, dtype = make_plan(g, faults, draws).block_by_block(), dtype_of(precision)

    def count(tau_s: float, chunk: Chunk, *blocks: np.int32) -> Array:
        return _block_sums(
            plan.batch(chunk, dtype), np.uint32(seed), *blocks,
            on_device(GaussMarkov(tau_s).correlation(interval_s), dtype),
            limits_of(alert, dtype), as_trees(chosen), noise_model=model, samples=samples, axis=judged,
        )  # fmt: skip

    sums = np.zeros((len(taus), 3, len(faults), len(chosen), len(EVENTS)))
    with progress_bar(total=len(taus) * plan.chunk_count, what="Exposures", show=progress) as advance:
        for place, tau in enumerate(taus):
            for _, of_block in run_calls(plan, functools.partial(count, tau), precision=precision):
                sums[place] += of_block
                advance()
    # Faults stand in the plan's order, which for one epoch is theirs.
    of_fault = list(zip(faults.labels, faults.scalar_bias_m.tolist(), strict=True))
    named = () if axis is None and judged == VERTICAL else (judged,)
    names = ("tau_s", "fault", "bias_m", "method", *(["axis"] if named else []), "event")
    rows = []
    for (place, tau), (f, fault), (m, method), (kind, event) in product(
        enumerate(taus), enumerate(of_fault), enumerate(chosen), enumerate(EVENTS)
    ):
        keys = dict(zip(names, (tau, *fault, method.name, *named, event.name), strict=True))
        seen, total, squares = sums[place, :, f, m, kind].tolist()
        rows.append(keys | _columns(seen, total, squares, draws, samples))
    table = pd.DataFrame(rows)
    table.attrs["unjudged"] = unjudged_note(alert, (judged,))
    return table


def samples_of(duration_s: float, interval_s: float) -> int:
    """The samples of an exposure; an `InputError` unless whole intervals make its duration."""
    ratio = require_positive(duration_s, field="duration_s") / require_positive(interval_s, field="interval_s")
    samples = round(min(ratio, 2.0 * _MOST_SAMPLES))
    if not 1 <= samples <= _MOST_SAMPLES or abs(ratio - samples) > 1e-9 * samples:
        raise InputError(
            f"interval_s: from 1 to {_MOST_SAMPLES} whole intervals make a duration, but {shown(duration_s)} s is "
            f"{ratio:.6g} times {shown(interval_s)} s."
        )
    return samples


def _taus(tau_s: ArrayLike) -> list[float]:
    values = np.atleast_1d(require_numbers(tau_s, field="tau_s"))
    if values.ndim != 1 or values.size == 0 or np.unique(values).size < values.size:
        raise InputError("tau_s: one row of different correlation times is needed.")
    return [GaussMarkov(float(value)).tau_s for value in values]


@functools.partial(jax.jit, static_argnames=("noise_model", "samples", "axis"))
def _block_sums(
    batch: EpochBatch, seed: Array, block: Array, full_blocks: Array, remainder: Array, correlation: Array,
    limits_m: Array, methods: Trees, *, noise_model: NoiseModel, samples: int,
    axis: str,
) -> Array:  # fmt: skip
    """(3, f, methods, events), over the exposures of a block at the one epoch of a batch.

    How many have the event, and the sum and the square sum of the number of samples with it.
    """
    one: EpochBatch = jax.tree.map(lambda part: part[0], batch)
    chosen = of_trees(methods)
    model, prepared = prepare_epoch(one, chosen)
    rows, dtype = model.design.shape[0], model.design.dtype
    key = jax.random.fold_in(jax.random.fold_in(epoch_key(seed, one.epoch), np.uint32(_EXPOSURES)), block)
    shape = (noise_model.inputs_per_row, rows, LANES)

    def fresh(time: Array) -> Array:
        keys = [jax.random.fold_in(jax.random.fold_in(key, time), k) for k in range(shape[0])]
        return jnp.stack([jax.random.normal(one, (rows, LANES), dtype) for one in keys])

    def count(outcomes: list[Outcome]) -> Array:
        return jnp.stack([events(outcome, limits_m, axis) for outcome in outcomes])

    def one_sample(carry: tuple[Array, Array], time: Array) -> tuple[tuple[Array, Array], None]:
        units, counts = carry
        units = jnp.where(time == 0, fresh(time), step(units, fresh(time), correlation))
        noise = noise_model.shape(model, list(units))
        seen = each_outcome(model, prepared, chosen, one, noise, count)
        return (units, counts + seen.astype(jnp.int32)), None

    none = jnp.zeros((one.bias_m.shape[0], len(chosen), len(EVENTS), LANES), jnp.int32)
    start = (jnp.zeros(shape, dtype), none)
    (_, counts), _ = jax.lax.scan(one_sample, start, jnp.arange(samples, dtype=jnp.int32))
    live = live_lanes(block, full_blocks, remainder)
    number = jnp.where(live, counts, 0).astype(dtype)
    return jnp.stack([jnp.sum(number > 0, axis=-1).astype(dtype), number.sum(axis=-1), (number**2).sum(axis=-1)])


def _columns(seen: float, total: float, squares: float, draws: int, samples: int) -> dict[str, float]:
    share, rate = seen / draws, total / draws / samples
    # Moments over exposures of whether the event happened and of the share of samples with it.
    variance = max(squares / draws / samples**2 - rate**2, 0.0)
    effective = effective_low = effective_high = np.nan
    if 0 < seen < draws:
        effective = math.log1p(-share) / math.log1p(-rate)
        by_share = 1.0 / ((1.0 - share) * -math.log1p(-share))
        by_rate = 1.0 / ((1.0 - rate) * -math.log1p(-rate))
        # Samples with the event are in exposures with it: the covariance is rate (1 - share).
        relative = (
            by_share**2 * share * (1 - share) + by_rate**2 * variance - 2 * by_share * by_rate * rate * (1 - share)
        )
        reach = float(-special.ndtri((1 - CONFIDENCE) / 2)) * math.sqrt(max(relative, 0.0) / draws)
        if seen >= _FEWEST:
            effective_low, effective_high = effective * math.exp(-reach), effective * math.exp(min(reach, 700.0))
    return {
        "exposures": draws,
        "samples": samples,
        "exposures_with": int(seen),
        **rate_columns("any", share, *(float(bound) for bound in clopper_pearson(seen, draws, CONFIDENCE))),
        "samples_with": int(total),
        "sample_rate": rate,
        "sample_error": math.sqrt(variance / draws),
        "independent_rate": -math.expm1(samples * math.log1p(-rate)) if rate < 1.0 else 1.0,
        **{"effective_samples": effective, "effective_low": effective_low, "effective_high": effective_high},
    }
