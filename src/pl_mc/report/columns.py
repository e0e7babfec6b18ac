"""What the columns of tables mean, whatever the kind of experiment: for headings of pages and for ``pl-mc explain``.

Names are made by rules: ``X_low`` and ``X_high`` are bounds of ``X`` or of ``X_rate``, numbers in a name are sizes,
times or shares. What a rule says is said once.
"""

from __future__ import annotations

import re

from pl_mc.engine.swamping import WATCHED
from pl_mc.kernels.events import EVENTS, EXCLUSIONS

# What the literature calls two of the events.
LITERATURE = {"misleading": ("MI", "misleading information"), "missed": ("HMI", "hazardously misleading information")}

_SHARES = {"05": "5 %", "50": "50 %", "95": "95 %", "99": "99 %"}

_MEANINGS = {
    # Of what a row is.
    "method": "the method, with the options that are not the default",
    "test": "the test",
    "reading": "the reading of the test or of the paper, with further options that are not the default",
    "noise": "the law of the errors, with the options that are not the default",
    "fault": "the fault's label, as --fault takes it",
    "bias_m": "bias of a fault on one satellite [m]; 0 without a fault, missing for several satellites",
    "bias_1_m": "bias of the first satellite of a pair [m]",
    "bias_2_m": "bias of the second satellite of a pair [m]",
    "axis": "what decides: the vertical limit, the horizontal one or either",
    "event": "the event that the row counts or estimates",
    "epoch": "number of the epoch in the series, counted from 0",
    "epochs": "number of epochs",
    "time": "GPS time of the epoch",
    "geometry": "the geometry: its place in a sky, or what it is called",
    "geometries": "number of geometries",
    "sky": "the set of geometries",
    "site": "number of the cell of the grid",
    "sites": "number of cells of the grid",
    "satellite": "the satellite that has the fault",
    "satellites": "satellites: their names where they have the fault, else how many are in view",
    "names": "names of the satellites",
    "gps": "mean number of GPS satellites",
    "bds": "mean number of BeiDou satellites",
    "part": "which satellites of the receiver's files were used",
    "name": "name of the satellite",
    "budget": "number of the budget in the experiment, counted from 0",
    "k0": "standardised residual where the weight begins to fall",
    "k1": "standardised residual where the weight reaches zero",
    "scheme": "how many iterations the estimate takes, and how",
    "variant": "name of the variant",
    "group": "variants of one group stand together in a figure",
    "fault_class": "which satellites have the fault: none, one in the middle, the most influential one, or a pair",
    "faults": "the faults: pairs of satellites, or all of one constellation",
    "varies": "the question that the reading answers",
    "role": "whether the method is the plain one (before) or the robust one (after)",
    "redraw": "number of the draw of satellites, sizes and noise, 0 for the one that the figures show",
    "line": "line of the paper's table",
    "direction": "direction of the position error: east, north or up",
    "statistic": "what is told of the errors: 95 % quantile of their size, or root mean square",
    "level": "protection level, VPL or HPL; of a test whether its threshold is nominal or that of equal false alarms",
    "region": "region of a Stanford diagram",
    "operation": "the operation whose alert limits are judged",
    "mode": "kind of a fault mode",
    "stage": "how far a pair of satellites came in the search: screened, shortlisted or refined",
    "limits": "whether the limits are those of the start, the tuned ones or the best of a grid",
    "tuned_for": "method, event and target that the limits were tuned for",
    "assumption": "what is not as the method takes it",
    "claim": "what a receiver or a program says of its own position",
    # Errors, levels and geometry.
    "vpl_m": "vertical protection level [m]; missing where there is no solution",
    "hpl_m": "horizontal protection level [m]; missing where there is no solution",
    "vpl_mean_m": "mean vertical protection level [m]; infinite where an epoch has none",
    "vpl_max_m": "largest vertical protection level [m]; infinite where an epoch has none",
    "level_m": "mean protection level without a fault [m]",
    "level_mean_m": "mean protection level without a fault, over the geometries [m]",
    "level_from_m": "where the cell begins, as a protection level [m]",
    "level_to_m": "where the cell ends, as a protection level [m]",
    "error_from_m": "where the cell begins, as a position error [m]",
    "error_to_m": "where the cell ends, as a position error [m]",
    "east_m": "east error of the position [m]",
    "north_m": "north error of the position [m]",
    "up_m": "up error of the position [m]",
    "vertical_m": "mean vertical error under the fault [m]",
    "horizontal_m": "length of the mean horizontal error under the fault [m]",
    "vertical_metres_per_metre": "vertical error of least squares per metre of the bias",
    "vertical_effect_m": "external reliability: the vertical error that a bias of mdb_m causes [m]",
    "mdb_m": "minimal detectable bias [m]; infinite where nothing checks the satellite",
    "redundancy": "redundancy number of the satellite, r of (0, 1): what of its error shows in its own residual",
    "redundant": "satellites in view less unknowns",
    "redundant_min": "smallest number of satellites less unknowns",
    "redundant_max": "largest number of satellites less unknowns",
    "satellites_min": "smallest number of satellites in view",
    "satellites_mean": "mean number of satellites in view",
    "satellites_max": "largest number of satellites in view",
    "faulted": "whether, or on which satellite, there is a fault",
    "faulted_epochs": "number of epochs with a fault",
    "vdop_min_m": "smallest standard deviation of the vertical error of least squares [m]",
    "vdop_max_m": "largest standard deviation of the vertical error of least squares [m]",
    "sigma_m": "standard deviation of the satellite's error by the error model [m]",
    "sigma_up_m": "standard deviation of the vertical error of least squares [m]",
    "sigma_mean_m": "mean standard deviation of the vertical error as a filter believes it [m]",
    "sigma_ratio": "largest ratio of a true standard deviation to the believed one: above 1 the level proves nothing",
    "slope": "largest error of a fault per unit of its trace in the residuals, in sigma of the error",
    "slope_m": "vertical error that a bias causes per unit of the root of its noncentrality [m]",
    "dof": "satellites less unknowns",
    "elevation_deg": "elevation of the satellite [deg]",
    "azimuth_deg": "azimuth of the satellite [deg]",
    "latitude_deg": "latitude [deg]",
    "longitude_deg": "longitude [deg]",
    "height_m": "height over the ellipsoid [m]",
    "speed_m_s": "speed over ground [m/s]",
    "climb_m_s": "vertical speed [m/s]",
    "heading_deg": "heading [deg]",
    "bank_deg": "bank of the aircraft [deg]",
    # Counts and rates.
    "draws": "noise draws that the row counts",
    "count": "draws with the event",
    "number": "number of the row, or of epochs",
    "rate": "share of the draws or epochs with the event",
    "low": "lower end of the 95 % interval of the row's rate or probability",
    "high": "upper end of the 95 % interval of the row's rate or probability",
    "independent": "independent epochs that the row is worth by the autocorrelation of its errors",
    "independent_draws": "draws that are independent of each other: faults at one epoch share theirs",
    "rank": "place of the method by its mean rate, 1 for the smallest",
    "scenarios": "cases of fault and noise",
    "available": "epochs or scenarios with a level within the limits",
    "within": "draws or epochs with what is judged within its limits: levels within those of the alert, or errors "
    "within a multiple of what is claimed",
    "within_rate": "share of the epochs whose error is within the multiple of what is claimed",
    "availability": "share of the fault-free draws with levels within the alert limits",
    "availability_rate": "share of area and time with levels within the alert limits",
    "coverage_rate": "share of the area whose sites have an availability of 99.5 % or more",
    "coverage_sites": "number of sites with an availability of 99.5 % or more",
    "worst_rate": "availability at the worst site",
    "worst_latitude_deg": "latitude of the worst site [deg]",
    "worst_longitude_deg": "longitude of the worst site [deg]",
    "multiplier": "multiple of what is claimed",
    "expected": "share that a Gaussian error has within it",
    "hazard_bias_m": "bias with the largest rate of hazards, the first of several [m]",
    "missed_bias_m": "bias with the largest rate of missed detections [m]; none where there was none",
    "misleading_bias_m": "bias with the largest rate of misleading information [m]; none where there was none",
    "fault_free_alarm_rate": "share of the draws without a fault that have an alarm",
    "fault_free_misleading_rate": "share of the draws without a fault that have misleading information",
    "fits": "whether the count of false alarms agrees with the probability that was asked for",
    "p_value": "how surprising the count of false alarms is where the probability is what was asked for",
    "unalerted": "epochs with an error beyond the alert limit and no alarm",
    # Risk.
    "probability": "probability of the event; missing where a warning takes it back",
    "standard_error": "standard error of the probability",
    "error": "standard error of the row's largest probability or of its risk",
    "estimator": "counting, importance, exact, or certain where no noise changes the answer",
    "ess": "effective number of draws in the event",
    "evaluations": "scenarios that were computed for the estimate",
    "subset_probability": "the same probability by subset simulation, whose random numbers are others",
    "subset_standard_error": "standard error of subset_probability",
    "subset_evaluations": "scenarios that were computed for subset_probability",
    "warning": "empty, or what is in doubt",
    "grid_bias_m": "bias of 5, 10, ..., 100 m with the largest probability [m]",
    "grid_bias_1_m": "bias of the first satellite of a pair on that grid [m]",
    "grid_bias_2_m": "bias of the second satellite of a pair on that grid [m]",
    "grid_probability": "largest probability on that grid",
    "noncentrality": "noncentrality of V'PV under the fault",
    "refined": "whether the probability is a last estimate with noise of its own",
    "rough": "probability as the screening has it, without an error",
    "failed": "satellites or constellation that fail in the mode",
    "prior": "probability of the fault mode, or that the fault begins in an exposure",
    "bias": "whether the fault has the worst size or given ones",
    "found": "how a number was found: exact, counting, rare events, estimated, or bounded by the prior",
    "risk": "probability of the event per sample, weighted with the priors of the faults",
    "risk_per_sample": "prior of the mode times the probability of the event",
    "risk_per_approach": "risk_per_sample times the samples of an approach, by the union bound at most so much",
    "of_target": "risk of the approach over what is allowed",
    "verdict": "whether the target is met, not met, or not shown",
    "target": "probability that is allowed",
    "allowed": "risk that the budget leaves to what is analysed",
    "kept": "geometries at which the budget is kept",
    "risk_mean": "mean risk over the geometries",
    "risk_most": "largest upper bound of the risk over the geometries",
    "risk_fault": "fault under which the risk is largest",
    "risk_as_assumed": "the risk where everything is as the method takes it",
    "times": "median factor by which the risk is larger than risk_as_assumed",
    "times_most": "largest factor by which the risk is larger than risk_as_assumed",
    "worst_fault": "fault with the largest contribution, of the size that is worst",
    "worst_probability": "probability of the event under worst_fault",
    "contribution": "probability that the fault occurs and the event with it",
    "contribution_most": "largest contribution at a geometry",
    "contribution_fault_free": "probability of the event without a fault, times the prior of that",
    "contribution_single": "priors of single satellites times the probability of the event under their worst faults",
    "contribution_pairs": "priors of pairs of satellites, which count as lost",
    "contribution_lost": "priors of all that is not analysed, which counts as lost",
    "sets": "sets of satellites that were looked at",
    "unseen": "sets of which no residual shows the fault",
    "exposed": "probability of at least one alarm in an exposure",
    "allocation": "what the false-alarm budget, or continuity in total, allows",
    "discontinuity": "alarms of an approach: of its independent samples without a fault, and the prior of each "
    "satellite times the alarms under its worst size",
    # Multipliers.
    "k": "multiplier that keeps the budget",
    "k_vertical": "multiplier of the vertical level: best estimate, or the one that keeps the target",
    "k_horizontal": "multiplier of the horizontal level: best estimate, or the one that keeps the target",
    "k_best": "best estimate of the multiplier",
    "k_50": "median over geometries of the multiplier that keeps the budget, k_50_low and k_50_high that of its bounds",
    "k_99": "multiplier that is enough at 99 % of the geometries",
    "k_mean": "mean multiplier of the formula over the geometries",
    "k_of_even": "largest multiplier at the even geometries, from which one was chosen",
    "k_low": "multiplier that, with the confidence, does not keep the target",
    "k_high": "multiplier that, with the confidence, keeps the target",
    "share_kept": "share of all geometries that such a multiplier serves, with 95 % confidence",
    "odd": "number of odd geometries, by which what was chosen at the even ones is checked",
    "odd_beyond": "odd geometries that need a larger multiplier than was chosen",
    "constant": "constant term of the formula for log K",
    "of_slope": "number of the formula for log K beside the slope",
    "of_square": "number of the formula for log K beside the square of the slope",
    "of_dof": "number of the formula for log K beside 1 / (n - t)",
    "margin": "factor by which the formula was raised to be enough at each even geometry",
    "explained": "share of the variance of log K at the odd geometries that the formula explains",
    "inflation": "k_high over the multiplier of the record",
    "decides": "whether the fault needs the largest multiplier at its epoch",
    "asked": "fault or target of the curve",
    "alarm_rate_before": "share of draws with an alarm at the record's multiplier",
    "alarm_rate_after": "share of draws with an alarm at k_high",
    "check_low": "lower end of the 95 % interval of check_probability",
    "check_high": "upper end of the 95 % interval of check_probability",
    "check_probability": "the probability by importance sampling, which shares no draw with the count",
    "objective": "what was made small, at the limits of the row",
    "objective_error": "standard error of the objective",
    "change": "change of the objective from the start",
    "change_error": "standard error of the change",
    # Errors in time.
    "tau_s": "correlation time of the errors [s]",
    "rate_m_per_s": "rate of the ramp [m/s]",
    "share": "share of the correlated part in the variance of an error",
    "smoothing_s": "time constant of the carrier smoothing of the code noise [s]",
    "passes": "passes that were drawn",
    "monitored_s": "time from the onset of the ramp to the end of a pass [s]",
    "threshold": "threshold of the test, over its nominal one where it is that of equal false alarms",
    "false_alarm_passes": "fault-free passes in which false alarms were counted",
    "detected": "passes with an alarm",
    "detected_rate": "share of the passes with an alarm",
    "misleading_after_s": "time after the onset at which misleading information is likeliest [s]",
    "misleading_bound": "largest probability of misleading information that the level's equation allows for",
    "exposures": "number of exposures",
    "exposures_with": "exposures with the event at least once",
    "any_rate": "share of the exposures with the event at least once",
    "samples": "samples of an exposure",
    "samples_with": "samples with the event",
    "sample_rate": "rate of the event per sample",
    "sample_error": "standard error of sample_rate, by the scatter of exposures",
    "independent_rate": "share of exposures with the event if its samples were independent",
    "effective_samples": "number of independent samples with the same share of exposures",
    "effective_low": "lower end of the 95 % interval of effective_samples",
    "effective_high": "upper end of the 95 % interval of effective_samples",
    "factor": "how many times larger a rate, a level or an error is than what it is held against",
    "gaussian_rate": "the rate under Gaussian errors",
    # Tests, and the papers.
    "detections": "draws in which the test rejects",
    "detection_rate": "share of the draws in which the test rejects",
    "identified_rate": "share of the draws in which the test rejects and suspects a satellite with a fault",
    "p_fa_nominal": "false-alarm probability that the threshold is said to have",
    "p_fa_measured": "false-alarm rate that it has",
    "p_fa_trials": "fault-free draws in which that was counted",
    "p_fa_low": "lower end of the 95 % interval of p_fa_measured",
    "p_fa_high": "upper end of the 95 % interval of p_fa_measured",
    "predicted": "number of detections that the exact rate lets expect",
    "predicted_low": "lower end of the range that the prediction has in 95 % of cases",
    "predicted_high": "upper end of the range that the prediction has in 95 % of cases",
    "exact_rate": "rate by the closed form",
    "exact_p_value": "how surprising the count is where the closed form holds",
    "paper_rate": "rate that the paper reports",
    "difference": "the paper's rate less ours, or the second run's less the first one's",
    "inside": "whether the paper's rate is within the predicted range",
    "factor_low": "smallest factor, over the draws or by the bounds",
    "factor_high": "largest factor, over the draws or by the bounds",
    "clean_alarm_rate": "share of the epochs without a fault that have an alarm",
    "median_clean_vpl_m": "median vertical level of the epochs without a fault [m]",
}

_RULES: tuple[tuple[str, str], ...] = (
    (r"(vpl|hpl|level)_(05|50|95|99)_m", "{0} that is not exceeded in {share} of the draws [m]"),
    (r"(alarm|exclusion|wrong_exclusion)_rate_(\d+)m",
     "share of draws with the event {0} under {1} m on one satellite, mean over the satellites"),
    (r"available_(\d+)m", "share of draws without a fault whose level is within {0} m"),
    (r"rate_(\d+)m", "rate at a bias of {0} m where the variances are multiplied by the factor"),
    (r"continuity_(\d+)s_rate", "share of starts with service that keep it for {0} s"),
    (r"started_(\d+)s", "epochs with service that have {0} s after them"),
    (r"stayed_(\d+)s", "those that keep service for {0} s"),
    (r"within_(\d+)", "passes with a hazard whose alarm came at most {0} s after it began"),
    (r"within_(\d+)_rate", "share of decided_{0} passes whose alarm came at most {0} s after the hazard began"),
    (r"decided_(\d+)", "passes with a hazard in which {0} s after it began can be judged"),
    (r"undecided_(\d+)", "passes that ended before {0} s after the hazard had gone by; left out"),
    (r"late_(\d+)", "passes whose alarm came later than {0} s after the hazard began, or never"),
    (r"late_(\d+)_rate", "share of the passes whose alarm came later than {0} s after the hazard began, or never"),
    (r"alert_after_onset_(50|95)_s",
     "time from the onset of the ramp to the alarm, not exceeded in {share} of the passes [s]"),
    (r"alert_after_hazard_(50|95)_s",
     "time from the hazard to the alarm, not exceeded in {share} of the passes with one [s]"),
    (r"error_at_alert_(50|95)_m", "error at the alarm, not exceeded in {share} of the detected passes [m]"),
    (r"alarm_(50|95)_s", "time after the onset from which on the test alarms with a probability of {share} [s]"),
    (r"error_at_alarm_(50)_m", "mean error when the test alarms with a probability of {share} [m]"),
    (r"(east|north|up)_95_m", "95 % quantile of the size of the {0} error [m]"),
    (r"(east|north|up)_rms_m", "root mean square of the {0} error [m]"),
    (r"paper_(before|after)_m", "what the paper's table reports {0} the robust method [m]"),
    (r"(before|after)_m", "error {0} the robust method takes the place of the plain one [m]"),
    (r"(before|after)_(low|high)_m", "the {1}est value of the error {0} it, over draws of faults and noise [m]"),
)  # fmt: skip
_ROLES = {"before": "of the plain method", "after": "of the robust one"}
_ENDS = {"low": "lower", "high": "upper"}
_BOUND = re.compile(r"(.+)_(low|high)((?:_(?:m|s))?)")


def column_meaning(column: str) -> str:
    """What a column means, without a full stop; empty where nobody says."""
    return _own(column) or _bound(column) or _of_role(column)


def _own(column: str) -> str:
    for event in (*EVENTS, *EXCLUSIONS):
        if column == event.count:
            return f"draws with the event {event.name}, {event.meaning}"
        if column == f"{event.name}_rate":
            return f"share of the draws with the event {event.name}, {event.meaning}"
    for name, text in WATCHED.items():
        if column in (f"{name}_count", f"{name}_rate"):
            return f"{'draws' if column.endswith('_count') else 'share of the draws'}: {text}"
    if column in _MEANINGS:
        return _MEANINGS[column]
    for pattern, text in _RULES:
        if found := re.fullmatch(pattern, column):
            return text.format(*found.groups(), share=_SHARES.get(found[found.lastindex or 0], ""))
    return ""


def _bound(column: str) -> str:
    found = _BOUND.fullmatch(column)
    if found is None:
        return ""
    whole = _whole(*found.groups())
    of = f"the rate of {found[1]}" if whole == f"{found[1]}_rate" else whole
    return f"{_ENDS[found[2]]} end of the 95 % interval of {of}" if whole else ""


def _whole(base: str, _: str, unit: str) -> str:
    """The column of which one is a bound; empty where there is none."""
    return next((name for name in (f"{base}_rate", f"{base}{unit}", base) if column_meaning(name)), "")


def _of_role(column: str) -> str:
    role, _, rest = column.partition("_")
    text = column_meaning(rest) if role in _ROLES and rest else ""
    return f"{text}; {_ROLES[role]}" if text else ""


def bounded(column: str) -> str:
    """The column that one of bounds bounds; empty where it is none."""
    found = _BOUND.fullmatch(column)
    return "" if found is None or _own(column) else _whole(*found.groups())


def named_columns() -> list[str]:
    """Columns whose names no rule makes."""
    events = [name for event in (*EVENTS, *EXCLUSIONS) for name in (event.count, f"{event.name}_rate")]
    return [*_MEANINGS, *events, *(f"{name}_{end}" for name in WATCHED for end in ("count", "rate"))]
