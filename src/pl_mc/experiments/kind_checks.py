"""What single kinds of experiments ask for besides what their records and a geometry can tell.

Each function yields fields and acts; an act that raises an `InputError` says that its field cannot be used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from pl_mc.alert import BY_NAME
from pl_mc.engine.stanford import Grid
from pl_mc.faults import require_satellite
from pl_mc.geometry import Geometry, simulate
from pl_mc.input_errors import InputError, require_choice
from pl_mc.integrity_risk.rare.exposure import samples_of
from pl_mc.service.continuity import as_durations
from pl_mc.service.grid import world_grid
from pl_mc.service.volume import MOST_EPOCHS, as_operations, epoch_count, require_epochs
from pl_mc.time_ramps.timing import require_calibration, require_onset

Act = Callable[[], object]


def checks_of_kind(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    """The checks of an experiment's kind.

    Args:
        record: the experiment.
        g: its geometry; None where it has none or an unsound one, with which nothing can be compared.
    """
    checks = _CHECKS.get(str(record.kind))
    if checks is not None:
        yield from checks(record, g)


def _risk(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    if g is None:
        return
    if g.is_series:
        yield "geometry.epoch", lambda: _refuse("this kind of experiment needs one epoch.")
        return
    estimated = record.worst.estimated
    named = [
        ("curves.satellites", record.curves.satellites),
        ("worst.estimated", () if estimated == ("all",) else estimated),
        ("calibration.alarm_satellite", (record.calibration.alarm_satellite,)),
        *((f"calibration.faults.{k}", tuple(one)) for k, one in enumerate(record.calibration.faults)),
    ]
    for field, names in named:
        for name in names:
            yield field, partial(require_satellite, g, name)


def _stanford(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    limit_m = BY_NAME[record.alert].vertical_m if record.alert in BY_NAME else 0.0
    yield "reach_m", lambda: Grid(record.reach_m, record.cell_m).require_limit(limit_m)
    if record.faults is None and record.satellites:
        yield "satellites", lambda: _refuse("they get a ramp, which faults has to give.")
    if g is not None:
        for name in record.satellites:
            yield "satellites", partial(require_satellite, g, name)


def _noise(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    given = record.exposure
    yield "exposure.interval_s", lambda: samples_of(given.duration_s, given.interval_s)
    if g is not None:
        yield "faults.satellite", lambda: require_satellite(g, record.faults.satellite)
    try:
        known = [one.name for one in record.method_records()]
    except (InputError, TypeError):
        # The wrong method has been named.
        return
    for name in record.rare.methods:
        yield "rare.methods", partial(require_choice, name, known, field="rare.methods")


def _time_ramps(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    yield "calibration_draws", lambda: require_calibration(record.calibration_draws, record.p_fa)
    if g is None:
        return
    if not g.is_series:
        yield "geometry.epoch", lambda: _refuse("a ramp in time needs a series of epochs; leave it out.")
        return
    yield "onset_s", lambda: require_onset(record.onset_s, record.geometry.interval_s, len(g))
    yield "satellite", lambda: require_satellite(g, record.satellite)


def _service(record: Any, g: Geometry | None) -> Iterator[tuple[str, Act]]:
    yield "operations", lambda: as_operations(record.operations)
    yield "step_deg", lambda: world_grid(record.step_deg)
    yield "step_s", lambda: require_epochs(record.duration_s, record.step_s)
    epochs = epoch_count(record.duration_s, record.step_s)
    if epochs <= MOST_EPOCHS:
        yield "durations_s", lambda: as_durations(record.durations_s, step_s=record.step_s, epochs=epochs)
    yield "error_model", record.model
    # Fields one by one, so that one that is wrong hides no other.
    yield "site", lambda: simulate(site=record.site, epochs=1)
    yield "start", lambda: simulate(start=record.start, epochs=1)
    yield (
        "constellations",
        lambda: simulate(constellations=record.constellations, without=record.without, epochs=1),
    )


def _refuse(reason: str) -> None:
    raise InputError(reason)


_CHECKS: dict[str, Callable[[Any, Geometry | None], Iterator[tuple[str, Act]]]] = {
    "noise": _noise,
    "risk": _risk,
    "service": _service,
    "stanford": _stanford,
    "time-ramps": _time_ramps,
}
