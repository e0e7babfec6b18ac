"""Experiments of the kind ``frontier``: every method with the multiplier that keeps a risk budget at each geometry.

A method whose level scales with K gets at each geometry the K with which the analysed modes take exactly what the
budget leaves them; one whose level does not is taken as it is, and what its level is exceeded with is told.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
import pandas as pd

from pl_mc.engine import Execution
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.integrity_risk.given_residuals import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import LevelRisk, z_of
from pl_mc.integrity_risk.given_residuals.level_risk import columns
from pl_mc.integrity_risk.given_residuals.several import PAIRS, sets_of, several
from pl_mc.methods import Method
from pl_mc.methods.capabilities import scales_with_k, with_k
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import in_order
from pl_mc.studies.frontier.continuity import continuity_blocks, continuity_table, require_exposure
from pl_mc.studies.frontier.figures import frontier_figure, multiplier_figure
from pl_mc.studies.frontier.one_number import CONFIDENCE, by_slope, largest_slope, one_number
from pl_mc.studies.frontier.record import FrontierExperiment, Sky
from pl_mc.studies.frontier.text import EXCLUSION, WRONG_EXCLUSION, of_sizes, summary
from pl_mc.studies.study import Check, Work

# Draws of each geometry that make up the quantiles of levels, and of alarms under faults.
_LEVELS, _ALARM_DRAWS = 256, 256
# Multiples of the multiplier at which the curves of the figure stand.
FACTORS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.25)
# Scenarios of an estimate, draws aside, and how many a second on two cores.
_PER_DRAW, _SCENARIOS_PER_S, _OF_PAIRS = 110.0, 1.3e5, 2_000_000


def run(experiment: FrontierExperiment, execution: Execution) -> Findings:
    """What every method needs and gives at every geometry; over each sky; under wrong assumptions."""
    _some_stops(experiment)
    budget = experiment.risk_budget()
    judged = experiment.decides
    ((_, _, limit_m),) = judged.levels
    skies = [(sky, sky.geometries(experiment.seed)) for sky in experiment.skies]
    items = [
        (sky, place, g, method)
        for sky, geometries in skies
        for method in _of_sky(experiment, sky)
        for place, g in enumerate(geometries)
    ]

    def one(item: tuple[Sky, int, Geometry, Method]) -> dict[str, Any]:
        sky, place, g, method = item
        seed = (experiment.seed, zlib.crc32(sky.name.encode()), place)
        found = at_geometry(
            g, method, budget, judged.axis, limit_m, experiment, seed=seed, stressed=place < sky.stressed
        )
        key = {"sky": sky.name, "method": method.name}
        parts = {name: [key | part for part in found.pop(name)] for name in ("curve", "stress", "besides")}
        return {"sky": sky.name, "geometry": place, "method": method.name} | found | parts

    results = in_order(one, items, execution.threads)
    found = [row for _, row in with_progress(results, total=len(items), what="Frontier", show=execution.progress)]
    levels = pd.DataFrame([{"sky": row["sky"], "method": row["method"], "levels": row.pop("levels")} for row in found])
    of_curves = ["sky", "method", "factor", "level_m", "risk"]
    curve = pd.DataFrame([part for row in found for part in row.pop("curve")], columns=of_curves)
    stress = pd.DataFrame([part for row in found for part in row.pop("stress")])
    besides = pd.DataFrame([part for row in found for part in row.pop("besides")])
    geometries = pd.DataFrame(found)
    exclusions = [*of_sizes(experiment, EXCLUSION), *of_sizes(experiment, WRONG_EXCLUSION)]
    if not geometries.reindex(columns=exclusions).gt(0.0).any(axis=None):
        # None of the methods excludes.
        geometries = geometries.drop(columns=exclusions, errors="ignore")
    frontier = over_skies(geometries, levels, experiment, limit_m)
    multipliers, formula = one_number(geometries), by_slope(geometries)
    tables = [Table("frontier", frontier), Table("geometries", geometries)]
    if len(multipliers):
        tables.insert(1, Table("multipliers", multipliers))
    if len(formula):
        tables.insert(2, Table("by_slope", formula))
    curves = curve.groupby(["sky", "method", "factor"], sort=False, as_index=False).mean()
    tables.append(Table("curves", curves))
    if len(stress):
        stress = stress.groupby(["sky", "method", "assumption"], sort=False, as_index=False).agg(
            geometries=("risk", "size"), risk=("risk", "mean"), error=("error", "max"),
            risk_as_assumed=("risk_as_assumed", "mean"), times=("times", "median"), times_most=("times", "max"),
        )  # fmt: skip
        tables.append(Table("stress", stress))
    if len(besides):
        besides = besides.groupby(["sky", "method", "faults"], sort=False, as_index=False).agg(
            geometries=("sets", "size"), sets=("sets", "sum"), unseen=("unseen", "sum"),
            probability=("probability", "max"), error=("error", "max"), contribution=("contribution", "mean"),
            contribution_most=("contribution", "max"),
        )  # fmt: skip
        tables.append(Table("besides", besides))
    blocks = summary(experiment, frontier, multipliers, formula, stress, besides)
    if experiment.continuity is not None:
        places = [
            (sky.name, place, g, _of_sky(experiment, sky))
            for sky, geometries in skies
            for place, g in enumerate(geometries)
        ]
        interrupted = continuity_table(experiment, places)
        if len(interrupted):
            tables.append(Table("continuity", interrupted))
            blocks = (*blocks, *continuity_blocks(interrupted))
    return Findings(summary=blocks, tables=tuple(tables), notes=_notes(geometries))


def pictures(stored: Mapping[str, pd.DataFrame], experiment: FrontierExperiment) -> tuple[Picture, ...]:
    """Level against risk, and multipliers where there are any."""
    drawn: dict[str, Any] = {"axis": experiment.decides.axis, "title": experiment.title}
    level = Picture(
        "frontier",
        "Mean level against proven risk, one curve a method along its multiplier; single points are levels without "
        "one.",
        lambda: frontier_figure(stored["curves"], stored["frontier"], **drawn),
    )
    needed = Picture(
        "multipliers",
        "Multipliers that keep the budget at each geometry, sorted: the share of geometries whose K is at most this.",
        lambda: multiplier_figure(stored["geometries"], stored["multipliers"], stored["frontier"], **drawn),
    )
    return (level, needed) if "multipliers" in stored else (level,)


def at_geometry(
    g: Geometry, method: Method, budget: RiskBudget, axis: str, limit_m: float, experiment: FrontierExperiment, *,
    seed: tuple[int, ...], stressed: bool,
) -> dict[str, Any]:  # fmt: skip
    """Multiplier, risk, level and alarms of one method at one geometry."""
    scaled = scales_with_k(method) is not None
    unit = with_k(method, 1.0, axis) if scaled else method
    options: dict[str, Any] = {"draws": experiment.draws, "seed": seed}
    risk = LevelRisk(g, unit, budget, axis, **options)
    if scaled:
        found, low, high = risk.multiplier(z_of(CONFIDENCE))
    else:
        found, low, high = risk.at(1.0), math.nan, math.nan
    head = {"satellites": len(g.names), "dof": risk.parts.dof, "slope": largest_slope(risk.parts)}
    head["allowed"] = risk.allowed
    empty: dict[str, Any] = {"levels": np.full(_LEVELS, np.inf), "curve": [], "stress": [], "besides": []}
    if found is None or not risk.free.silent.any():
        nothing = dict.fromkeys(("k", "k_low", "k_high"), math.inf)
        nothing |= dict.fromkeys((*_TOLD, "unconverged_rate"), math.nan)
        rates = {"alarm_rate": 1.0, "discontinuity": 1.0, "level_m": math.inf}
        rates |= dict.fromkeys(of_sizes(experiment, "alarm"), 1.0)
        rates |= dict.fromkeys((*of_sizes(experiment, EXCLUSION), *of_sizes(experiment, WRONG_EXCLUSION)), 0.0)
        return head | nothing | rates | {"kept": False, "worst_fault": ""} | empty
    k, free = found.k, risk.free
    plain = np.s_[0, : risk.plain]
    level = np.where(free.silent[plain], k * free.level_m[plain], np.inf)
    alarm_rate = risk.alarm_rate(k, limit_m)
    faulty, right, wrong = (
        rates[:, : len(g.names)]
        for rates in risk.rates_under_faults(k, limit_m, np.array(experiment.sizes_m), _ALARM_DRAWS)
    )
    discontinuity = experiment.independent * alarm_rate + float(risk.shares.single @ faulty.max(axis=0))
    told = columns(g, risk, found, CONFIDENCE)
    curve = []
    for factor in FACTORS if scaled else (1.0,):
        at = risk.at(k * factor, found.faults)
        finite = free.level_m[plain][free.silent[plain]]
        curve.append({"factor": factor, "level_m": float(k * factor * finite.mean()), "risk": at.analysed})
    stress = _stressed(g, unit, budget, axis, experiment, k, found.analysed, options) if stressed else []
    besides = [row for kind in experiment.besides for row in _besides(g, risk, k, kind)]
    return (
        head
        | {"k": k if scaled else math.nan, "k_low": low, "k_high": high}
        | {name: told[name] for name in _TOLD}
        | {
            "unconverged_rate": float(free.unsettled[plain].mean()),
            "level_m": float(level[np.isfinite(level)].mean()) if np.isfinite(level).any() else math.inf,
            "alarm_rate": alarm_rate,
        }
        | {
            f"{event}_rate_{size:g}m": float(row.mean())
            for event, rates in (("alarm", faulty), (EXCLUSION, right), (WRONG_EXCLUSION, wrong))
            for size, row in zip(experiment.sizes_m, rates, strict=True)
        }
        | {"discontinuity": min(discontinuity, 1.0), "worst_fault": told["worst_fault"]}
        # One that a multiplier was found for takes just what it may.
        | {"kept": scaled or told["kept"]}
        | {"levels": np.resize(level, _LEVELS), "curve": curve, "stress": stress, "besides": besides}
    )


_TOLD = ("risk", "risk_low", "risk_high", "contribution_fault_free", "contribution_single")


def _stressed(
    g: Geometry,
    unit: Method,
    budget: RiskBudget,
    axis: str,
    experiment: FrontierExperiment,
    k: float,
    assumed: float,
    options: dict[str, Any],
) -> list[dict[str, Any]]:
    """The risk at the same multiplier where errors, nominal biases or faults are not what they were taken for."""
    rows = []
    for truth in experiment.truths:
        rows.append((truth.name, LevelRisk(g, unit, budget, axis, truth=truth, **options).at(k)))
    for bias_m in experiment.biases_m:
        biased = replace(budget, b_nom_m=budget.b_nom_m + bias_m)
        rows.append((f"nominal biases of {bias_m:g} m more", LevelRisk(g, unit, biased, axis, **options).at(k)))
    for count in experiment.iterations:
        fewer = _stopped(unit, count)
        if fewer is not None:
            rows.append((f"{count} plain iterations", LevelRisk(g, fewer, budget, axis, **options).at(k)))
    found = [(what, at.analysed, at.error) for what, at in rows]
    if experiment.pair_priors:
        risk = LevelRisk(g, unit, budget, axis, **options)
        at, sets = risk.at(k), sets_of(g, PAIRS, risk.prior.size)[0]
        pairs = several(risk, k, sets)
        for prior in experiment.pair_priors:
            known = at.analysed + prior * float(pairs.probability.sum())
            error = math.hypot(at.error, prior * float(pairs.error.sum()))
            found.append((f"pairs of faults, prior {prior:g} each", known, error))
    return [
        {
            "assumption": what, "risk": risk, "error": error, "risk_as_assumed": assumed,
            "times": risk / assumed if assumed else math.nan,
        }
        for what, risk, error in found
    ]  # fmt: skip


def _stopped(method: Any, count: int) -> Method | None:
    """The same method whose estimate stops after so many iterations; None without any."""
    fields = getattr(method, "__dataclass_fields__", {})
    if "iterations" in fields:
        return cast(Method, replace(method, iterations=count))
    within = _stopped(method.estimate, count) if "estimate" in fields else None
    return None if within is None else cast(Method, replace(method, estimate=within))


def _besides(g: Geometry, risk: LevelRisk, k: float, kind: str) -> list[dict[str, Any]]:
    """The event under faults of several satellites: pairs, with the sum over their priors, or each constellation."""
    sets, members = sets_of(g, kind, risk.prior.size)
    found = several(risk, k, sets)
    if kind == PAIRS:
        prior = np.array([risk.prior[list(places)].prod() for places in members])
        parts = [(kind, np.arange(len(sets)), float(prior @ found.probability))]
    else:
        parts = [(f"all of {g.systems[places[0]]}", np.array([row]), np.nan) for row, places in enumerate(members)]
    return [
        {
            "faults": faults, "sets": len(rows), "unseen": int(found.unseen[rows].sum()),
            "probability": found.probability[rows].max(), "error": found.error[rows[found.probability[rows].argmax()]],
            "contribution": contribution,
        }
        for faults, rows, contribution in parts
    ]  # fmt: skip


def over_skies(
    geometries: pd.DataFrame, levels: pd.DataFrame, experiment: FrontierExperiment, limit_m: float
) -> pd.DataFrame:
    """One row per sky and method, the smallest mean level first within a sky."""
    rows = []
    for (sky, method), part in geometries.groupby(["sky", "method"], sort=False):
        drawn = np.concatenate(levels[(levels.sky == sky) & (levels.method == method)].levels.to_list())
        row: dict[str, Any] = {"sky": sky, "method": method, "geometries": len(part)}
        row |= {"k_50": part.k.median(), "k_50_low": part.k_low.median(), "k_50_high": part.k_high.median()}
        row |= {"k_99": part.k.quantile(0.99, interpolation="higher")}
        row |= {"level_mean_m": part.level_m.mean()}
        row |= {f"level_{q}_m": float(np.quantile(drawn, q / 100.0, method="higher")) for q in (95, 99)}
        row |= {name: part[name].mean() for name in ("alarm_rate", *of_sizes(experiment, "alarm"), "discontinuity")}
        for event in (EXCLUSION, WRONG_EXCLUSION):
            row |= {name: part[name].mean() for name in of_sizes(experiment, event) if name in part}
        row |= {f"available_{limit:g}m": float((drawn <= limit).mean()) for limit in (limit_m, *experiment.limits_m)}
        row |= {"risk_mean": part.risk.mean(), "risk_most": part.risk_high.max(), "allowed": part.allowed.mean()}
        row |= {"kept": int(part.kept.sum()), "unconverged_rate": part.unconverged_rate.mean()}
        rows.append(row)
    table = pd.DataFrame(rows)
    order = {sky: place for place, sky in enumerate(dict.fromkeys(table.sky))}
    return table.sort_values(
        ["sky", "level_mean_m"], key=lambda column: column.map(order) if column.name == "sky" else column,
        kind="stable", ignore_index=True,
    )  # fmt: skip


def _of_sky(experiment: FrontierExperiment, sky: Sky) -> list[Method]:
    records = experiment.method_records()
    return [one for one in records if not sky.methods or one.name in sky.methods]


def work(experiment: FrontierExperiment) -> Work:
    """Scenarios of all estimates."""
    wrong = len(experiment.truths) + len(experiment.biases_m) + len(experiment.iterations)
    looks = sum((sky.count + wrong * sky.stressed) * len(_of_sky(experiment, sky)) for sky in experiment.skies)
    scenarios = int(looks * experiment.draws * _PER_DRAW)
    # Some twenty satellites have two hundred pairs, each tried at several sizes.
    of_pairs = [(PAIRS in experiment.besides) * sky.count for sky in experiment.skies]
    of_pairs += [bool(experiment.pair_priors) * sky.stressed for sky in experiment.skies]
    methods = [len(_of_sky(experiment, sky)) for sky in experiment.skies] * 2
    scenarios += sum(count * each for count, each in zip(of_pairs, methods, strict=True)) * _OF_PAIRS
    return Work(scenarios, scenarios / _SCENARIOS_PER_S)


def checks(experiment: FrontierExperiment, g: Geometry | None) -> Iterator[Check]:
    """Budget, skies, and the methods that they name."""
    yield "budget", experiment.risk_budget
    yield "continuity", partial(require_exposure, experiment)
    yield "noises", lambda: experiment.truths
    yield "iterations", partial(_some_stops, experiment)
    names = [one.name for one in experiment.method_records()]
    for sky in experiment.skies:
        yield "skies", partial(_built, sky, experiment)
        for name in sky.methods:
            yield "skies", partial(require_choice, name, names, field=f"skies: {sky.name}: methods")


def _some_stops(experiment: FrontierExperiment) -> None:
    """An `InputError` where no method has iterations that could end early."""
    records = experiment.method_records()
    for count in experiment.iterations:
        if all(_stopped(one, count) is None for one in records):
            raise InputError("iterations: none of the methods has iterations, so that nothing ends early.")


def _built(sky: Sky, experiment: FrontierExperiment) -> None:
    """Whether one geometry of a sky can be made, and what the budget leaves it."""
    found = sky.model_copy(update={"count": 1}).geometries(0)
    if not found:
        raise InputError(f"skies: {sky.name}: its first geometry has no more satellites than unknowns.")
    try:
        budget, axis = experiment.risk_budget(), experiment.level_axis
    except InputError:
        # Told of as such.
        return
    budget.allowed(budget.shared(found[0]), axis)


def _notes(geometries: pd.DataFrame) -> tuple[str, ...]:
    return (
        "Noise is Gaussian, independent and of the sigma of the model; faults are constant; two faults at a time and "
        "faults of constellations count as lost with their priors. Alarms under faults are counted in 256 draws a "
        "satellite, those without a fault in weighted draws.",
        f"Draws of estimates whose last iteration still moved by more than 1 cm: at most "
        f"{geometries.unconverged_rate.max():.2g} of a geometry without a fault.",
    )
