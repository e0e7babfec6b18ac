"""What an experiment assumes: every field and every option with its value, those that nobody typed by default.

The words are those of the records themselves, as in templates, refusals and ``pl-mc explain``.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from pl_mc.detectors.registry import DETECTORS
from pl_mc.error_models import error_model
from pl_mc.experiments.field_meanings import first_sentence, meaning
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget
from pl_mc.ism import Ism
from pl_mc.kernels.events import EVENTS
from pl_mc.kernels.noise import LANES
from pl_mc.methods.registry import METHODS
from pl_mc.noise_models.registry import NOISE_MODELS
from pl_mc.report.assumed import Assumed, Condition
from pl_mc.report.columns import LITERATURE
from pl_mc.report.run_folder import flat_fields, number_text, value_text
from pl_mc.studies.file_fields import without_folders
from pl_mc.studies.spec import Experiment, NamedChoice
from pl_mc.time_ramps.timing import SEQUENTIAL

THREAT, ERRORS, LIMITS, SKY, METHOD, COUNTED = (
    "Threat model: faults, their sizes and priors",
    "Errors and noise",
    "Limits, targets and what is judged",
    "Geometry and data",
    "Methods, tests and their readings",
    "How it was counted",
)

# The topic of a field and of all in it; fields of one of these names have theirs wherever they stand.
TOPICS: dict[str, tuple[str, ...]] = {
    THREAT: (
        "faults", "biases_m", "sizes_m", "satellite", "satellites", "rates_m_per_s", "onset_s", "budget", "budgets",
        "pair_priors", "besides", "independent", "worst", "system", "curves",
    ),
    ERRORS: (
        "noise", "noises", "noise_scale", "error_model", "error_options", "sigma_factors", "correlations", "angles_deg",
        "taus_s", "share", "smoothing_s", "exposure",
    ),
    LIMITS: (
        "alert", "axes", "operations", "limits_m", "continuity", "event", "targets", "objectives", "p_fa", "confidence",
        "durations_s", "calibration", "claims", "claim_multiplier",
    ),
    SKY: (
        "geometry", "source", "skies", "site", "start", "step_deg", "step_s", "duration_s", "mask_deg",
        "constellations", "without", "observations", "navigation", "truth", "systems", "signals", "ionosphere",
        "snr_dbhz", "ionex",
    ),
    METHOD: ("methods", "tests", "sequential", "variants", "readings", "compare", "iterations", "equal"),
    COUNTED: (
        "view", "seed", "precision", "draws", "draws_per_satellite", "calibration_draws", "search_draws",
        "weight_draws", "redraws", "steps", "target_cov", "max_evaluations", "rare", "day", "reach_m", "cell_m",
        "residuals", "remarks",
    ),
}  # fmt: skip
_TOPIC = {field: topic for topic, fields in TOPICS.items() for field in fields}
_EVERYWHERE = ("error_model", "error_options", "noise", "p_fa")

# A title is the heading of all this, the kind decides which fields there are, and how a figure looks changes no number.
UNSAID = ("title", "kind", "figures")

_NAMED: Mapping[str, Any] = METHODS | DETECTORS | NOISE_MODELS | SEQUENTIAL
# Tables of fields that a record keeps as they are written.
_ISM = tuple(one.name for one in dataclasses.fields(Ism) if one.name not in ("name", "source"))
_TABLES = {"ism": Ism, "budget": RiskBudget}

_DECIDES = {
    "vertical": "the vertical limit decides", "horizontal": "the horizontal limit decides",
    "either": "either limit decides",
}  # fmt: skip


def assumed_of(experiment: Experiment) -> Assumed:
    """All that an experiment assumes."""
    found = sorted(_Walk(_parts(experiment)).record(experiment, ""), key=lambda one: list(TOPICS).index(one.topic))
    return Assumed(tuple(_lead(experiment)), tuple(found))


def _parts(experiment: Experiment) -> dict[str, BaseModel]:
    """Records of what an experiment has as tables, with their defaults; nothing where they are no records alone."""
    base = getattr(experiment, "base", None)
    try:
        return {} if base is None else {name: getattr(base(), name) for name in ("source", "faults")}
    except InputError:
        return {}


def _lead(experiment: Experiment) -> Iterator[str]:
    limits, axes = experiment.alert_limits(), experiment.judged_axes()
    given = ((limits.vertical_m, "VAL"), (limits.horizontal_m, "HAL"))
    words = " and ".join(f"{name} {value:g} m" for value, name in given if value is not None)
    if axes:
        decide = " and, apart, ".join(_DECIDES[axis] for axis in axes)
        yield f"The alert limits are those of {limits.name}, {words}; {decide}."
    else:
        yield "No alert limit decides in this kind of experiment."
    means = {event.name: event.meaning for event in EVENTS}
    said = "; ".join(
        f"{event}, in the literature {name} ({short}), is: {means[event]}"
        for event, (short, name) in LITERATURE.items()
    )
    yield (
        f"An alarm is: {means['alarm']}; a hazard is: {means['hazard']}; exceeded is: {means['exceeded']}; {said}. A "
        "rate under a fault is given that the fault is there; its prior is in it only where a table says so."
    )
    yield (
        "Bounds of counted rates are two-sided 95 % Clopper-Pearson intervals of independent draws, where a table or a "
        "note does not say otherwise; nothing seen is an upper bound and no proof of zero."
    )
    yield (
        "Errors that are drawn are Gaussian with the standard deviations of the error model, without nominal biases, "
        "and independent of each other from satellite to satellite and draw to draw, but for what is said below."
    )
    if any("observations" in path.split(".") for path in flat_fields(experiment.model_dump(mode="json"))):
        yield "The errors of a receiver's files are its own, whatever their law; faults are added to its pseudoranges."
    yield from experiment.conditions
    yield (
        f"Random numbers are chosen by the seed {experiment.seed}: those of counted draws are of threefry2x32, {LANES} "
        "draws a block; those of rare events, of risks given the residuals and of random places are NumPy's."
    )
    yield "Satellites, faults and laws of errors that are not named here are not covered by any of these numbers."


@dataclasses.dataclass(frozen=True)
class _Walk:
    """Reads records; ``parts`` stand for tables as they are written, of files the name alone is told."""

    parts: Mapping[str, BaseModel]

    def record(self, record: BaseModel, above: str) -> Iterator[Condition]:
        """The conditions of a record's fields and of the records in it."""
        for field, info in type(record).model_fields.items():
            path, value = f"{above}{field}", getattr(record, field)
            if info.annotation is type(None) or path in UNSAID:
                continue
            default = info.get_default(call_default_factory=True)
            same = default is not PydanticUndefined and value == default
            several = value if isinstance(value, tuple) else (value,)
            if several and all(isinstance(one, BaseModel) for one in several):
                seen: dict[str, set[str]] = {}
                for k, one in enumerate(several):
                    place = f"{path}.{k}" if isinstance(value, tuple) else path
                    if isinstance(one, NamedChoice):
                        yield from self.choice(one, place, same, meaning(type(record), field), seen)
                    else:
                        yield from self.record(one, f"{place}.")
            else:
                yield from self.field(record, field, path, value, same)

    def field(self, record: BaseModel, field: str, path: str, value: Any, same: bool) -> Iterator[Condition]:
        """The conditions of a field that is no record; a table has one for each of its fields."""
        text = meaning(type(record), field)
        method = _NAMED.get(str(getattr(record, "method", "")))
        if field in self.parts and isinstance(value, dict):
            yield from self.record(self.parts[field], f"{path}.")
        elif field == "error_model":
            yield self.one(path, value, text, same)
            yield from self.error_model(record, path)
        elif field == "error_options":
            yield from self.table(path, value, text, same, None)
        elif isinstance(value, dict):
            cls = _TABLES.get(field) or (method if field == "options" else METHODS.get(field))
            yield from self.table(path, value, text, same, cls)
            if field == "budget":
                yield from self.defaults(path, cls, value)
        else:
            yield self.one(path, value, text, same)

    def choice(
        self, choice: NamedChoice, path: str, same: bool, text: str, seen: dict[str, set[str]]
    ) -> Iterator[Condition]:
        """A method or the like with its options, those with defaults once for all of a name."""
        cls = _NAMED.get(choice.name)
        about = text if cls is None else first_sentence(cls)
        also = "; its further options are by default, as said of the first one" if choice.name in seen else ""
        yield self.one(path, choice.name, f"{about}{also}", same)
        for option, value in choice.options.items():
            yield from self.option(f"{path}.{option}", cls, option, value)
        yield from self.defaults(path, cls, choice.options, seen.setdefault(choice.name, set()))

    def option(self, path: str, cls: Any, option: str, value: Any) -> Iterator[Condition]:
        """An option that is given."""
        text = meaning(cls, option) if inspect.isclass(cls) else ""
        if isinstance(value, dict):
            yield from self.table(path, value, text, False, _TABLES.get(option))
        else:
            yield self.one(path, value, text, value == _default(cls, option))

    def defaults(
        self, path: str, cls: Any, given: Mapping[str, Any], told: set[str] | None = None
    ) -> Iterator[Condition]:
        """The options that are not given, but for those that are ``told`` already, to which these are added."""
        told = set() if told is None else told
        for option in _options(cls):
            value = _default(cls, option.name)
            # What a message says takes the place of its options.
            said = option.name in given or option.name in told or ("ism" in given and option.name in _ISM)
            if said or not option.init or value is dataclasses.MISSING:
                continue
            told.add(option.name)
            place = f"{path}.{option.name}"
            if dataclasses.is_dataclass(value) and not isinstance(value, type):
                for inner in dataclasses.fields(value):
                    own = getattr(value, inner.name)
                    yield self.one(f"{place}.{inner.name}", own, meaning(type(value), inner.name), True)
            else:
                yield self.one(place, value, meaning(cls, option.name), True)

    def table(self, path: str, value: Mapping[str, Any], text: str, same: bool, cls: Any) -> Iterator[Condition]:
        """The leaves of a table as it is written."""
        if not value:
            yield self.one(path, value, text, same)
        for key, one in flat_fields(value).items():
            names = key.split(".")
            of, name = (Ism, names[1]) if names[0] == "ism" and len(names) > 1 else (cls, names[0])
            own = meaning(of, name) if of is not None else ""
            yield self.one(f"{path}.{key}", one, own or text, False)

    def error_model(self, record: BaseModel, path: str) -> Iterator[Condition]:
        """The figures of an error model."""
        name, options = record.error_model, record.error_options  # type: ignore[attr-defined]
        try:
            figures = error_model(name, **{key: value for key, value in options.items() if key != "ism"}).describe()
        except (InputError, OSError):
            # A file that is not at hand.
            return
        for figure, value in figures.items():
            if figure != "name":
                yield self.one(f"{path}.{figure}", value, f"figure of the error model {name}", figure not in options)

    def one(self, path: str, value: Any, text: str, by_default: bool) -> Condition:
        """One condition."""
        names = path.split(".")
        topic = next((_TOPIC[name] for name in names if name in _EVERYWHERE), _TOPIC[names[0]])
        said = str(value) if names[-1] == "seed" else _text(without_folders(value, names[-1]))
        return Condition(topic, path, said, text, by_default)


def _text(value: Any) -> str:
    """A value as a file would say it."""
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value)) or "none"
    if dataclasses.is_dataclass(value):
        return str(getattr(value, "name", value))
    return number_text(value, 12) if isinstance(value, float) else value_text(value)


def _default(cls: Any, option: str) -> Any:
    """The default of an option; ``MISSING`` where it has none."""
    fields = {one.name: one for one in _options(cls)}
    if option not in fields:
        return dataclasses.MISSING
    factory = fields[option].default_factory
    return fields[option].default if factory is dataclasses.MISSING else factory()


def _options(cls: Any) -> tuple[dataclasses.Field[Any], ...]:
    """The options of what has a name; none where it is no record."""
    return dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ()
