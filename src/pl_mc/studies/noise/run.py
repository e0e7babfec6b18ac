"""Experiments of the kind ``noise``: the same faults under noise models that the receiver does not believe in.

All of them are made from the same standard normal numbers. What counting does not see is left to the rare-event
estimator; what correlation in time does is counted in exposures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL, Judged
from pl_mc.engine import EVENTS, Execution
from pl_mc.faults import Faults, biases, no_fault, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.integrity_risk.rare.exposure import exposure, samples_of
from pl_mc.integrity_risk.rare.risk import risk
from pl_mc.methods import Ls, Method
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.report.document import Chart, Heading, Quantity, Summary, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.findings import Findings, Picture, Table, event_quantities
from pl_mc.report.text import ANSWERED, event_text, listed, method_key, metres, percent, rate_text
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import in_order
from pl_mc.statistics.exact import ls_rates
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.noise.figures import assumed_share, exposure_figure, fault_words, noise_figure
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import ByOneAxis, NoiseChoice, SimulatedGeometry
from pl_mc.studies.strict import Strict
from pl_mc.studies.study import Check, Work

COMPARED = ("alarm", "misleading", "missed")

# On two cores: exposures as timed alone, rare events by what they leave of the seconds in the manifest of the
# shipped experiment; of evaluations those that are allowed.
_EXPOSURE_SAMPLES_PER_S, _RARE_EVALUATIONS_PER_S = 2.0e6, 5.9e4

_BESIDE_GAUSSIAN = (
    Quantity("rate", "rate", "low", "high", "count"),
    Quantity("gaussian", "gaussian_rate", "gaussian_low", "gaussian_high"),
)
_CHARTS = {
    "rates": Chart("Rates of events against the bias", ("method",), event_quantities(), ("noise",)),
    "factors": Chart("Rates beside those of Gaussian errors", ("method",), _BESIDE_GAUSSIAN, ("event", "noise")),
}


class FaultChoice(Strict):
    """Biases of one satellite.

    Attributes:
        sizes_m: biases, one at a time, besides the fault-free case.
    """

    satellite: str
    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)]

    def of_sizes(self, g: Geometry, sizes_m: tuple[float, ...]) -> Faults:
        """Biases of these sizes on the satellite, each once; of 0 the fault-free case."""
        made = [biases(g, {self.satellite: size}) if size else no_fault(g) for size in dict.fromkeys(sizes_m)]
        return sum(made[1:], made[0])


class RareChoice(Strict):
    """What is left to the rare-event estimator, `pl_mc.risk`.

    Attributes:
        event: the event that is estimated.
        fewest_events: number of counted events below which it is estimated.
        sizes_m: biases under which it is estimated, 0 for no fault.
        methods: names of methods of the experiment.
    """

    event: Literal["missed", "misleading"] = "missed"
    fewest_events: int = Field(default=16, ge=1)
    sizes_m: tuple[float, ...] = (0.0,)
    methods: tuple[str, ...] = ("ls",)
    target_cov: float = Field(default=0.15, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)


class ExposureChoice(Strict):
    """Exposures to Gaussian errors that are correlated in time; see `pl_mc.exposure`.

    Attributes:
        sizes_m: biases, 0 for no fault.
        taus_s: correlation times [s].
        duration_s: length of an exposure.
        interval_s: time between the samples of an exposure.
        draws: number of exposures.
        event: the event that is counted.
        assumed_samples: the number of independent samples that a budget assumes.
    """

    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)] = (0.0,)
    taus_s: Annotated[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...], Field(min_length=1)]
    duration_s: float = Field(default=150.0, gt=0)
    interval_s: float = Field(default=1.0, gt=0)
    draws: int = Field(default=10_000, ge=1)
    event: Literal["alarm", "missed", "misleading", "exceeded", "hazard"] = "misleading"
    assumed_samples: int = Field(default=25, ge=1)


class NoiseExperiment(ByOneAxis):
    """Noise models at one epoch, each compared with Gaussian noise.

    Attributes:
        noises: models of the noise to compare, the first of them gaussian, each a table with a name and options.
        rare: what is left to the rare-event estimator.
        exposure: exposures to errors that are correlated in time.
    """

    kind: Literal["noise"] = "noise"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry
    faults: FaultChoice
    noises: Annotated[tuple[NoiseChoice, ...], Field(min_length=2)]
    rare: RareChoice = RareChoice()
    exposure: ExposureChoice

    def noise_records(self) -> tuple[NoiseModel, ...]:
        """The noise models, made records; an `InputError` where the first is not Gaussian or two are the same."""
        made = tuple(choice.build() for choice in self.noises)
        if made[0] != GAUSSIAN:
            raise InputError(
                f"noises: the first has to be gaussian, since the others are compared with it, not {made[0].name}."
            )
        for noise in made:
            if made.count(noise) > 1:
                raise InputError(f"noises: {noise.name} is asked for twice.")
        return made


def sweeps(experiment: NoiseExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment, one for each noise model."""
    g = experiment.geometry.one_epoch()
    faults = experiment.faults.of_sizes(g, (0.0, *experiment.faults.sizes_m))
    return tuple(
        PlannedSweep(f"noise-{k:02d}", g, faults, experiment.draws, noise)
        for k, noise in enumerate(experiment.noise_records())
    )


def beside(experiment: NoiseExperiment) -> Work:
    """What exposures and rare events cost."""
    rare, given = experiment.rare, experiment.exposure
    estimates = len(experiment.noises) * len(set(rare.sizes_m)) * len(rare.methods)
    samples = samples_of(given.duration_s, given.interval_s) * given.draws
    solved = samples * len(set(given.sizes_m)) * len(set(given.taus_s)) * len(experiment.method_records())
    return Work(
        None,
        estimates * rare.max_evaluations / _RARE_EVALUATIONS_PER_S + solved / _EXPOSURE_SAMPLES_PER_S,
        f"as if all {estimates} rare events had to be estimated, which only a run can tell",
    )


def checks(experiment: NoiseExperiment, g: Geometry | None) -> Iterator[Check]:
    """Exposures have samples, the satellite is in view, and rare events are those of methods of the experiment."""
    given = experiment.exposure
    yield "exposure.interval_s", lambda: samples_of(given.duration_s, given.interval_s)
    if g is not None:
        yield "faults.satellite", lambda: require_satellite(g, experiment.faults.satellite)
    try:
        known = [method.name for method in experiment.method_records()]
    except (InputError, TypeError):
        # The wrong method has been named.
        return
    for name in experiment.rare.methods:
        yield "rare.methods", partial(require_choice, name, known, field="rare.methods")


def run(experiment: NoiseExperiment, execution: Execution) -> Findings:
    """Rates under every noise model, alone and beside those of Gaussian noise; rare events; exposures."""
    planned = sweeps(experiment)
    g, judged = planned[0].g, experiment.decides
    given, methods = experiment.exposure, experiment.method_records()
    for name in experiment.rare.methods:
        require_choice(name, [method.name for method in methods], field="rare.methods")
    rates = pd.concat(
        [sweep.run(experiment, execution).assign(noise=sweep.noise.name) for sweep in planned], ignore_index=True
    )
    tables = {
        "rates": rates,
        "factors": experiment.with_axis(factor_table(rates, g, planned[0].faults, methods, judged)),
        "risks": _risks(experiment, planned, rates, execution),
        "exposures": exposure(
            g, experiment.faults.of_sizes(g, given.sizes_m), tau_s=given.taus_s, draws=given.draws,
            seed=experiment.seed, duration_s=given.duration_s, interval_s=given.interval_s, methods=methods,
            alert=judged.alert, axis=_asked(experiment), precision=experiment.precision,
            progress=execution.progress,
        ),
    }  # fmt: skip
    return Findings(
        summary=summary(experiment, g, tables),
        tables=tuple(Table(name, table, _CHARTS.get(name)) for name, table in tables.items()),
        notes=g.notes,
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: NoiseExperiment) -> tuple[Picture, ...]:
    """Rates under each noise model, and exposures."""
    given = experiment.exposure
    drawn: Any = {"event": given.event, "assumed": given.assumed_samples, "axis": experiment.decides.axis}
    return (
        Picture(
            "noise_models", "Rates of events under each model of the noise, beside Gaussian noise.",
            lambda: noise_figure(stored["factors"], experiment),
        ),
        Picture(
            "exposures", "How often an event happens at least once in an exposure, by the correlation of its errors.",
            lambda: exposure_figure(stored["exposures"], title=experiment.title, **drawn),
        ),
    )  # fmt: skip


def _asked(experiment: NoiseExperiment) -> str | None:
    """The axis, where a table names it."""
    return None if experiment.axes is None else experiment.decides.axis


def factor_table(
    rates: pd.DataFrame, g: Geometry, faults: Faults, methods: tuple[Method, ...], judged: Judged
) -> pd.DataFrame:
    """Rates beside those under Gaussian noise, of which those of least squares are exact.

    Returns:
        One row per noise, method, fault and event of `COMPARED`: ``rate, low, high`` (95 %), ``gaussian_rate,
        gaussian_low, gaussian_high``, and ``factor, factor_low, factor_high``, the quotient of the rates and those
        of opposite bounds; NaN where both were seen too rarely for one.
    """
    # Options other than the multiplier have no part in least squares; with another one it is counted.
    # Where either limit decides all of it is.
    known = {method.name for method in methods if method == Ls() and judged.axis != EITHER}
    axis: Literal["vertical", "horizontal"] = "vertical" if judged.axis == VERTICAL else "horizontal"
    exact = ls_rates(g, faults, alert=judged.alert, axis=axis).set_index("fault")
    gaussian = rates[rates.noise == GAUSSIAN.name].set_index(["method", "fault"])
    parts = ("rate", "low", "high")
    rows = []
    for row in rates.itertuples():
        for event in COMPARED:
            counted = [float(getattr(row, f"{event}_{part}")) for part in parts]
            if row.method in known:
                expected = [float(exact.loc[row.fault, f"{event}_rate"])] * len(parts)
            else:
                expected = [float(gaussian.loc[(row.method, row.fault), f"{event}_{part}"]) for part in parts]
            of = (row.noise, row.method, row.fault, row.bias_m, event)
            rows.append((*of, row.draws, round(counted[0] * row.draws), *counted, *expected))
    columns = ["noise", "method", "fault", "bias_m", "event", "draws", "count"]
    table = pd.DataFrame(rows, columns=[*columns, *parts, *(f"gaussian_{part}" for part in parts)])
    seen = table.rate > 0
    table["factor"] = (table.rate / table.gaussian_rate).where(seen & (table.gaussian_rate > 0))
    table["factor_low"] = (table.low / table.gaussian_high).where(seen & (table.gaussian_high > 0))
    table["factor_high"] = (table.high / table.gaussian_low).where(table.gaussian_low > 0)
    return table


def _risks(
    experiment: NoiseExperiment, planned: tuple[PlannedSweep, ...], rates: pd.DataFrame, execution: Execution
) -> pd.DataFrame:
    """`pl_mc.risk` wherever too few events were counted."""
    rare, faults = experiment.rare, experiment.faults
    column = {event.name: event.count for event in EVENTS}[rare.event]
    counts = rates.set_index(["noise", "method", "fault"])[column]
    records = {method.name: method for method in experiment.method_records()}
    labels = {size: faults.of_sizes(planned[0].g, (size,)).labels[0] for size in rare.sizes_m}
    cases = []
    for sweep, name in product(planned, rare.methods):
        # A fault that the sweep did not have counts as seen never.
        seen = {size: counts.get((sweep.noise.name, name, label), 0) for size, label in labels.items()}
        few = tuple(size for size, count in seen.items() if count < rare.fewest_events)
        if few:
            cases.append((sweep, records[name], faults.of_sizes(sweep.g, few)))

    def estimate(case: tuple[PlannedSweep, Method, Faults]) -> pd.DataFrame:
        sweep, method, few = case
        table = risk(
            sweep.g, few, seed=experiment.seed, event=rare.event, method=method, target_cov=rare.target_cov,
            alert=experiment.alert_limits(), axis=_asked(experiment), noise=sweep.noise,
            max_evaluations=rare.max_evaluations, workers=1, progress=False,
        )  # fmt: skip
        table.insert(0, "noise", sweep.noise.name)
        return table

    # Every case has a function of its own to compile, so that none need run alone.
    results = in_order(estimate, cases, execution.threads, compiled=True)
    shown = with_progress(results, total=len(cases), what="Risk", show=execution.progress)
    tables = [table for _, table in shown]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=["noise", "method", "fault"])


def summary(experiment: NoiseExperiment, g: Geometry, tables: Mapping[str, pd.DataFrame]) -> Summary:
    """One screen for every part, of the epoch and the tables by name."""
    factors, exposures = tables["factors"], tables["exposures"]
    quantities, judged, satellite = ls_quantities(g), experiment.decides, experiment.faults.satellite
    row = g.names.index(satellite)
    up, sideways = float(quantities.gain[row]), float(np.hypot(*quantities.horizontal_gain[:, row]))
    dop_m = {"VDOP": float(quantities.vdop_m), "HDOP": float(quantities.hdop_m)}
    spread = [f"{called.level[0]}DOP {metres(dop_m[f'{called.level[0]}DOP'])} m" for called in judged.called]
    moves = {VERTICAL: f"{'up' if up > 0 else 'down'} by {abs(up):.2f} m", HORIZONTAL: f"sideways by {sideways:.2f} m"}
    moves[EITHER] = f"{moves[VERTICAL]} and {moves[HORIZONTAL]}"
    rare, given = experiment.rare, experiment.exposure
    return (
        f"{len(g.names)} satellites, {int(quantities.dof)} redundant, {listed(spread)} of "
        f"least squares; alert limit {judged.alert.name}, {judged.limits(metres)}. "
        f"{int(factors.draws.iloc[0]):,} draws for each fault and noise model, seed {experiment.seed}, all models "
        "made from the same numbers. Whatever the noise, methods believe in Gaussian errors with the satellites' "
        f"sigma. A metre on {satellite} moves least squares {moves[judged.axis]}.",
        "Rates with 95 % Clopper-Pearson bounds; in brackets the factor against Gaussian noise with the quotients "
        "of opposite bounds (least squares under Gaussian noise: the exact rate). `0 (< x %)` is the upper bound "
        "where nothing was seen.",
        Heading("Alarms"),
        _rates(factors[factors.event == "alarm"]),
        Heading(f"Misleading: {judged.beyond_level} and no alarm"),
        _rates(factors[factors.event == "misleading"]),
        Heading(f"P({rare.event}) where the sweep counted fewer than {rare.fewest_events}"),
        "By `pl_mc.risk`: importance sampling checked by subset simulation, or plain counts; no number where they "
        "do not bear each other out.",
        _risk_table(tables["risks"]) if len(tables["risks"]) else "None.",
        Heading(f"{given.event} at least once in an exposure, Gauss-Markov errors"),
        *_exposures(exposures[exposures.event == given.event], given.assumed_samples, judged.axis),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: NoiseExperiment) -> tuple[str, ...]:
    """Each event under Gaussian noise and under the model that makes it most frequent."""
    rates, judged = tables["rates"], experiment.judged()[0]
    sentences = []
    for event in ANSWERED:
        clauses = []
        for name, group in rates.groupby("method", sort=False):
            parts = []
            # Gaussian noise first, then all other models.
            for _, part in group.groupby(group.noise != GAUSSIAN.name):
                row = part.loc[part[f"{event}_rate"].idxmax()]
                seen = row[f"{event}_rate"] > 0
                model = f"{row.noise}, the most" if seen else "any other model"
                under = GAUSSIAN.name if row.noise == GAUSSIAN.name else model
                parts.append(f"{event_text(row, event)}{f' at {row.fault}' if seen else ''} with {under}")
            clauses.append(f"{method_label(str(name), judged.axis)} {', '.join(parts)}")
        sentences.append(f"{judged.means(event)}, at the worst fault: {'; '.join(clauses)}.")
    return tuple(sentences)


def _rates(rows: pd.DataFrame) -> TextTable:
    faults = list(dict.fromkeys(rows.fault))
    cells = [
        [*key, *map(_rate, group.set_index("fault").loc[faults].reset_index().itertuples())]
        for key, group in rows.groupby(["noise", "method"], sort=False)
    ]
    return TextTable.of(["noise", "method", *map(fault_words, faults)], cells)


def _rate(row: Any) -> str:
    text = rate_text(int(row.count), int(row.draws), row.low, row.high)
    certain = abs(row.factor - 1.0) < 5e-4 and row.rate > 0.99
    if row.noise == GAUSSIAN.name or certain:
        return text
    if np.isfinite(row.factor):
        return f"{text} (x{_short(row.factor)} [{_short(row.factor_low)}, {_short(row.factor_high)}])"
    return f"{text} (> x{_short(row.factor_low)})" if np.isfinite(row.factor_low) else text


def _short(value: float) -> str:
    if not np.isfinite(value):
        return "?"
    return f"{value:.3g}" if value < 1e4 else f"{value:.1e}"


def _risk_table(risks: pd.DataFrame) -> TextTable:
    rows = []
    for row in risks.itertuples():
        number = f"[{row.low:.1e}, {row.high:.1e}]"
        if np.isfinite(row.probability):
            number = f"{row.probability:.2e} [{row.low:.2e}, {row.high:.2e}]"
        rows.append([row.noise, row.method, row.fault, number, row.estimator, row.warning or "-"])
    return TextTable.of(["noise", "method", "fault", "probability [95 %]", "by", "warning"], rows)


def _exposures(rows: pd.DataFrame, assumed: int, axis: str) -> Summary:
    methods, first = list(dict.fromkeys(rows.method)), rows.iloc[0]
    cases = list(product(dict.fromkeys(rows.fault), methods))
    by_case = rows.set_index(["tau_s", "fault", "method"]).sort_index()
    cells = [[f"{tau:g}", *(_exposure(by_case.loc[tau, *case]) for case in cases)] for tau in dict.fromkeys(rows.tau_s)]
    budget = [
        f"{percent(assumed_share(rows[(rows.fault == fault) & (rows.method == method)], assumed))} %"
        for fault, method in cases
    ]
    header = ["tau [s]", *(f"{fault_words(fault)}, {method}" for fault, method in cases)]
    return (
        f"{int(first.samples)} samples an exposure, {int(first.exposures):,} exposures a cell; m is the number of "
        "independent samples that would have the same share (95 %; from ten exposures with the event on). Last "
        f"line: what the rate per sample, pooled over all lines, gives with {assumed} independent samples. "
        f"{method_key(methods, axis)}",
        TextTable.of(header, [*cells, [f"{assumed} independent", *budget]]),
    )


def _exposure(row: pd.Series) -> str:
    share = rate_text(int(row.exposures_with), int(row.exposures), row.any_low, row.any_high)
    if not np.isfinite(row.effective_low):
        return share
    return f"{share}; m = {row.effective_samples:.3g} [{row.effective_low:.3g}, {row.effective_high:.3g}]"
