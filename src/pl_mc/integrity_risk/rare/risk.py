"""The probability of an event that is too rare to count, with the confidence that one may have in the number.

Each row is estimated twice: by importance sampling, whose estimate is given, and by subset simulation with random
numbers of its own. Where the two do not agree, or a few draws carry the estimate, there is a warning and no number.
Events that are not rare are counted.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special

from pl_mc.alert import LPV_200, VERTICAL, AlertLimits, as_axis, unjudged_note
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_SEED, notes_on_faults, require_inputs, solved_epochs
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.injection import at_epoch
from pl_mc.input_errors import require_choice, require_whole, require_within
from pl_mc.integrity_risk.rare.importance import FEWEST_SEARCHES, ImportanceRun, importance_sampling
from pl_mc.integrity_risk.rare.limit_state import RISK_EVENTS, LimitState, all_axes
from pl_mc.integrity_risk.rare.subset import Sampled, SubsetRun, subset_simulation
from pl_mc.methods import Method, as_methods
from pl_mc.noise_models import GAUSSIAN, NoiseModel, as_noise_model
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import cores, in_order
from pl_mc.statistics.intervals import clopper_pearson

CONFIDENCE = 0.95
FEWEST_EVALUATIONS = 500_000
# Years of computing.
MOST_EVALUATIONS = 10**12

# An event seen this often in the first draws is counted, if that needs no more draws than the last number, or if it
# is common.
_FIRST_DRAWS = 2**17
_ENOUGH_EVENTS = 16
_COMMON = 0.01
_COUNTED_DRAWS = 2**21
# Draws at once.
_BLOCK = 8192
# Draws that bound an event which nothing reached.
_BOUNDING_DRAWS = 2**20

# Evaluations without which one more search cannot come far.
_SEARCH = 200_000

# Importance sampling gets this share of the evaluations; the second estimator is asked for a coarser answer.
_FIRST_SHARE = 0.6
_SECOND_COV = 0.25
# Fewer effective draws, or one draw with more of the sum, are no estimate.
_LEAST_ESS = 30.0
_LARGEST_SHARE = 0.25
# How improbable a difference between two sound estimators has to be for neither to be believed; a smaller one, beyond
# what the confidence of their intervals admits, makes one interval of both.
_DISAGREEMENT_LEVEL = 1e-3
# Beyond this coefficient of variation the second estimator confirms nothing.
_LOOSE_COV = 0.5

COUNTING, IMPORTANCE, CERTAIN = "counting", "importance", "certain"
_WORDS = ("estimator", "warning")

# Plain draws that tell how often the iterations of a method have not settled.
_SETTLING_DRAWS = 2**15


@dataclass(frozen=True)
class RiskEstimate:
    """One row of `risk`; the columns are explained there."""

    probability: float
    standard_error: float
    low: float
    high: float
    ess: float
    evaluations: int
    estimator: str
    subset_probability: float = np.nan
    subset_standard_error: float = np.nan
    subset_evaluations: int = 0
    warning: str = ""
    unconverged_rate: float = 0.0
    unconverged_low: float = 0.0
    unconverged_high: float = 0.0


@ordinary_arithmetic
def risk(
    g: Geometry,
    faults: Faults,
    *,
    seed: int,
    event: str = "missed",
    method: str | Method = "igg3",
    target_cov: float = 0.1,
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    noise: str | NoiseModel = GAUSSIAN,
    max_evaluations: int = 10_000_000,
    workers: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """The probability of one event under each fault, however rare.

    Importance sampling with a mixture that is adapted to every region found, checked by subset simulation; see
    `pl_mc.integrity_risk.rare.importance` and `pl_mc.integrity_risk.rare.subset`. An event that happens often
    enough is counted instead. Double precision throughout.

    Args:
        g: one epoch or a series.
        faults: bias vectors, from `ramp`, `biases` or `no_fault`.
        seed: chooses the random numbers, 0 to 2^32 - 1. A row's numbers depend on seed, epoch, fault, method,
            event and noise alone, not on the other rows.
        event: ``missed``, ``misleading``, ``exceeded`` or ``alarm``, as `pl_mc.sweep` defines them.
        method: name or record of a method.
        target_cov: standard error / probability that is aimed at, above 0 and below 1.
        alert: alert limits.
        axis: which of them decide, ``vertical``, ``horizontal`` (the length of the horizontal error, by HPL and HAL) or
            ``either``; the vertical one unless given, the horizontal one where there is no other.
        noise: how errors are distributed, a name or a record of `pl_mc.noise_models`. Unless they are Gaussian but
            for a constant every number behind them is a coordinate, and estimates cost more.
        max_evaluations: scenarios that a row may cost, both estimators together; at least 500,000.
        workers: threads that compute rows; as many as cores unless given. No effect on the numbers.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        One row per fault (per epoch and fault for a series: a fault gives no row where one of its satellites is out
        of view, see ``table.attrs["notes"]``): ``epoch`` (series only), ``fault, bias_m, method, event``, a column
        ``axis`` behind the method where one was given or the horizontal limit decides, and

        ``probability``: the estimate; NaN where the warning takes it back or nothing reached the event;
        ``standard_error``: its standard error;
        ``low, high``: 95 % interval: Clopper-Pearson for counts, else probability times exp(-+ quantile times
        coefficient of variation); where the estimators disagree it holds the intervals of both, where nothing
        reached the event it runs from 0 to the bound that plain draws without the event give;
        ``ess``: effective number of draws in the event (for counts, events);
        ``evaluations``: scenarios computed for this estimate;
        ``estimator``: ``counting``, ``importance``, or ``certain`` where no noise changes the answer (no
        determined solution);
        ``subset_probability, subset_standard_error, subset_evaluations``: the second estimator, where one ran;
        ``warning``: empty, or what is wrong;
        ``unconverged_rate, unconverged_low, unconverged_high``: share of 32,768 plain draws under the fault whose last
        iteration moved the position by more than 1 cm, with 95 % Clopper-Pearson bounds; they are no evaluations.

    Raises:
        InputError: bad options, an axis without a limit, or faults of another geometry.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> fault = pl_mc.biases(g, "G08:+10m")
        >>> table = pl_mc.risk(g, fault, event="misleading", method="ls", seed=7, target_cov=0.3, progress=False)
        >>> exact = pl_mc.exact.ls_rates(g, fault).misleading_rate[0]
        >>> bool(table.low[0] < exact < table.high[0])
        True
    """
    alert = require_inputs(g, faults, alert, any_axis=True)
    judged = as_axis(axis, alert)
    require_choice(event, RISK_EVENTS, field="event")
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    most = require_whole(max_evaluations, field="max_evaluations", low=FEWEST_EVALUATIONS, high=MOST_EVALUATIONS)
    require_within(target_cov, field="target_cov", low=1e-3, high=1.0)
    threads = cores() if workers is None else require_whole(workers, field="workers", low=1)
    (chosen,) = as_methods([method], g)
    model = as_noise_model(noise, g, rare=True)
    series = g.as_series()
    available = solved_epochs(series, chosen)
    rows = [(int(epoch), int(fault)) for epoch, fault in zip(*np.nonzero(faults.applies(g)), strict=True)]

    def run(row: tuple[int, int]) -> RiskEstimate:
        epoch, fault = row
        if not available[epoch]:
            certain = float(event == "alarm")
            return RiskEstimate(certain, 0.0, certain, certain, np.inf, 0, CERTAIN)
        axes = None if model.shifts_only else all_axes(series.in_view[epoch], model.inputs_per_row)
        bias_m = at_epoch(g, faults, epoch)[fault]
        limit = LimitState.of(series, epoch, bias_m, chosen, event, alert, axes, judged, noise=model)
        # Gaussian errors and the vertical are not named: they have had these random numbers all along.
        named = (*([] if model == GAUSSIAN else [model.name]), *([] if judged == VERTICAL else [judged]))
        name = "/".join((chosen.name, event, faults.labels[fault], *named))
        key = (seed, int(series.epoch[epoch]), zlib.crc32(name.encode()))
        found = estimate_risk(limit, key, target_cov=target_cov, most_evaluations=most)
        points = np.random.default_rng((*key, 1)).standard_normal((_SETTLING_DRAWS, limit.dimension))
        count = int(limit.unconverged(points).sum())
        low, high = (float(bound) for bound in clopper_pearson(count, len(points), CONFIDENCE))
        rate = count / len(points)
        return replace(found, unconverged_rate=rate, unconverged_low=low, unconverged_high=high)

    results = with_progress(in_order(run, rows, threads), total=len(rows), what="Risk", show=progress)
    found = [estimate for _, estimate in results]
    keys: dict[str, object] = {"epoch": [int(series.epoch[epoch]) for epoch, _ in rows]} if g.is_series else {}
    keys |= {
        "fault": np.array([faults.labels[fault] for _, fault in rows], dtype=object),
        "bias_m": faults.scalar_bias_m[[fault for _, fault in rows]],
        "method": np.full(len(rows), chosen.name, dtype=object),
        **({} if axis is None and judged == VERTICAL else {"axis": np.full(len(rows), judged, dtype=object)}),
        "event": np.full(len(rows), event, dtype=object),
    }
    for field in RiskEstimate.__dataclass_fields__:
        values = [getattr(one, field) for one in found]
        keys[field] = np.array(values, dtype=object if field in _WORDS else None)
    table = pd.DataFrame(keys)
    table.attrs["notes"] = list(notes_on_faults(g, faults))
    table.attrs["unjudged"] = unjudged_note(alert, (judged,))
    return table


def estimate_risk(limit: Sampled, key: tuple[int, ...], *, target_cov: float, most_evaluations: int) -> RiskEstimate:
    """P(limit state > 0); ``key`` are whole numbers that choose the random numbers."""
    first, second, counts = (np.random.default_rng(s) for s in np.random.SeedSequence(key).spawn(3))
    # Of a small budget no more than an eighth, so that something is left to search with.
    spent = min(_FIRST_DRAWS, most_evaluations // 8)
    met = _events(limit, counts, spent)
    events = len(met)
    draws = _draws_to_count(events, spent, target_cov)
    common = events >= _COMMON * spent
    if events >= _ENOUGH_EVENTS and (common or draws <= _COUNTED_DRAWS):
        # A fresh count: the first one decided that there is one.
        draws = min(draws, most_evaluations - spent)
        return _counted(len(_events(limit, counts, draws)), draws, spent + draws, target_cov)

    budget = int(_FIRST_SHARE * (most_evaluations - spent))
    found = importance_sampling(
        limit, first, target_cov=target_cov, most_evaluations=budget, known=met,
        fewest_searches=int(np.clip(budget // _SEARCH, 1, FEWEST_SEARCHES)),
    )  # fmt: skip
    spent += found.evaluations
    if np.isnan(found.probability):
        # Several searches shared a budget that was too small for them; the rest is enough for one, or not.
        budget = int(_FIRST_SHARE * (most_evaluations - spent))
        found = importance_sampling(
            limit, first, target_cov=target_cov, most_evaluations=budget, known=met, fewest_searches=1
        )
        spent += found.evaluations
    if np.isnan(found.probability):
        draws = min(_BOUNDING_DRAWS, most_evaluations - spent)
        events = len(_events(limit, counts, draws))
        return _counted(events, draws, spent + draws, target_cov, searched=True)
    coarse, left = max(_SECOND_COV, target_cov), most_evaluations - spent
    check = subset_simulation(limit, second, target_cov=coarse, most_evaluations=left)
    return judge(found, check, evaluations=spent, target_cov=target_cov)


def judge(found: ImportanceRun, check: SubsetRun, *, evaluations: int, target_cov: float) -> RiskEstimate:
    """The row that two estimates give: a number where they bear each other out, else an interval and a warning."""
    cov = found.standard_error / found.probability
    low, high = _log_interval(found.probability, cov, found.dof)
    probability, warnings = found.probability, []
    if found.ess < _LEAST_ESS or found.largest_share > _LARGEST_SHARE:
        warnings.append(
            f"few draws carry the estimate {found.probability:.3g} (effective {found.ess:.0f}, the heaviest "
            f"{100 * found.largest_share:.0f} %)"
        )
        probability = np.nan
    if check.probability > 0 and check.populations > 1:
        loose = check.standard_error / check.probability
        below, above = _log_interval(check.probability, loose, check.populations - 1.0)
    else:
        loose, below, above = np.inf, low, high
    if _disagree(found, check, _DISAGREEMENT_LEVEL):
        warnings.append(
            f"importance sampling found {found.probability:.3g} +- {found.standard_error:.1g}, subset simulation "
            f"{check.probability:.3g} +- {check.standard_error:.1g}"
        )
        probability = np.nan
    elif loose > _LOOSE_COV:
        warnings.append("subset simulation scatters too much to confirm the estimate")
    if np.isnan(probability) or _disagree(found, check, 1.0 - CONFIDENCE):
        # Each interval claims the truth with the confidence; where a test at that level tells the two apart, one that
        # claims it has to hold both.
        low, high = min(low, below), max(high, above)
    if not np.isnan(probability) and cov > target_cov:
        warnings.append(f"coefficient of variation {cov:.2g} when the evaluations ran out")
    first = (probability, found.standard_error, low, high, found.ess, evaluations)
    second = (check.probability, check.standard_error, check.evaluations)
    return RiskEstimate(*first, IMPORTANCE, *second, "; ".join(warnings))


def _disagree(found: ImportanceRun, check: SubsetRun, level: float) -> bool:
    """Whether the difference is beyond what both errors explain (Welch's test, errors of log-normal size)."""
    if check.populations < 2:
        return False
    if check.probability == 0.0:
        return True
    first = found.standard_error / found.probability
    second = check.standard_error / check.probability
    variance = first**2 + second**2
    if variance == 0.0:
        return found.probability != check.probability
    dof = variance**2 / (first**4 / found.dof + second**4 / (check.populations - 1.0))
    limit = -special.stdtrit(dof, level / 2.0)
    return bool(abs(np.log(found.probability / check.probability)) > limit * np.sqrt(variance))


def _log_interval(probability: float, cov: float, dof: float) -> tuple[float, float]:
    """Bounds of an estimate whose logarithm is about Student distributed."""
    width = -special.stdtrit(dof, (1.0 - CONFIDENCE) / 2.0) * cov
    return float(probability * np.exp(-width)), float(min(probability * np.exp(min(width, 700.0)), 1.0))


def _draws_to_count(events: int, draws: int, target_cov: float) -> int:
    """Draws that give a count the relative error asked for, judged from the first draws, with a third to spare."""
    rate = max(events, 1) / draws
    needed = 1.33 * (1.0 - rate) / rate / target_cov**2
    return int(np.clip(needed, 2**15, 2**40))


def _events(limit: Sampled, rng: np.random.Generator, draws: int) -> FloatArray:
    """The plain draws that are in the event."""
    parts = [np.empty((0, limit.dimension))]
    for start in range(0, draws, _BLOCK):
        points = rng.standard_normal((min(_BLOCK, draws - start), limit.dimension))
        parts.append(points[limit(points) > 0])
    return np.concatenate(parts)


def _counted(events: int, draws: int, evaluations: int, target_cov: float, *, searched: bool = False) -> RiskEstimate:
    """The row of a count; ``searched`` in vain by importance sampling, or not."""
    low, high = (float(bound) for bound in clopper_pearson(events, draws, CONFIDENCE))
    rate = events / draws
    error = float(np.sqrt(rate * (1.0 - rate) / draws))
    warning = ""
    if events == 0:
        warning = f"nothing reached the event; {draws} plain draws without it bound it from above"
    elif error > target_cov * rate:
        warning = f"coefficient of variation {error / rate:.2g} from {events} of {draws} draws"
    if warning and searched:
        warning += (
            " (importance sampling searches further with more evaluations, max_evaluations of "
            f"{max(4 * evaluations, 4_000_000):,}, say)"
        )
    value = (rate, error) if events else (np.nan, np.nan)
    return RiskEstimate(*value, low, high, float(events), evaluations, COUNTING, warning=warning)
