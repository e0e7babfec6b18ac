"""Every function of the reference with sound arguments, and values that no argument is meant for."""

from __future__ import annotations

import dataclasses
import importlib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.random import Generator

import pl_mc
from pl_mc.faults import Bias, parse_fault
from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.flight import fly, survey_plan
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.sites import site_position_m

STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 10**30, -(10**30), 0.5, -0.0, math.nan, math.inf, -math.inf, 1e308, 5e-324,
    1j, "", " ", "G01", "nan", "1,2,3", "a\0b", "é" * 300, b"G01", (), [], {}, [None], [math.nan], [[1.0], [2.0,
    3.0]], [1, 2, 3], ["G01", "G01"], {"G01": math.nan}, {"G01": 1.0, 2: "x"}, {1, 2}, np.float32(1.5),
    np.int64(3), np.array(7), np.zeros(0), np.zeros((0, 3)), np.full((4, 3), np.nan), np.array(["x"]),
    np.array([None], object), np.ones((2, 2, 2, 2)), datetime(1970, 1, 1), datetime(2020, 1, 1, tzinfo=UTC),
    datetime.max, object(), len, range(3), "CUT0", "2017-11-21", "ls", "GPS", ["GPS", "GPS"], "float16",
    "../..", "x" * 5000, 10**400, 1e-300, "5", "1e4", np.bool_(True), pd.NA, np.datetime64("2020-01-01"),
    Path("/dev/null"), np.float64("nan"), [0.5, 0.5, 0.5], np.int64(-3), pl_mc.igg3, np.ma.masked, 1e17,
    -5e-324,
)  # fmt: skip


@dataclass(frozen=True)
class Call:
    """A function and sound arguments, all by name."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]


@cache
def _geometry() -> pl_mc.Geometry:
    return pl_mc.simulate(site="CUT0", epochs=3)[1]


def _rows(g: pl_mc.Geometry) -> dict[str, Any]:
    return {"design": g.design, "sigma_m": g.sigma_m, "systems": g.systems, "names": g.names}


@cache
def _timed_araim() -> Any:
    """ARAIM of v4.2 with rates of faults."""
    ism = {"b_nom_m": 0.5, "r_sat_per_h": 1e-5, "mfd_sat_h": 1.0, "r_const_per_h": 1e-8, "mfd_const_h": 1.0}
    return pl_mc.methods.method("araim", standard="v4.2", budget="LPV-200 v4.2", ism=ism)


# Functions that compile for long; the tests leave them to the study.
HEAVY = ("tune", "service_volume", "time_to_alert", "exposure", "calibrate", "risk", "risk_budget", "level_risk",
         "continuity", "detect", "examine", "solve", "sample", "sweep")  # fmt: skip
# Kernels are pure functions, used inside compiled ones: arrays that may be traced, which nothing can check.
KERNELS = "pl_mc.kernels."
# What takes no argument, and readers of files, which have studies of their own; records that functions return are not
# made by users.
ELSEWHERE = (
    "pl_mc.geometry.constellations.add_24_24",
    "pl_mc.ism.read_ism",
    "pl_mc.receiver.read_rinex",
    "pl_mc.receiver.read_receiver_series",
    "pl_mc.noise_models.Empirical",
)


def documented(kind: str) -> dict[str, Any]:
    """Everything that the reference has of a kind, ``function`` or ``class``, by its path."""
    pages = Path(__file__).parents[2].joinpath("docs", "reference").glob("*.md")
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    found = {}
    for path in re.findall(rf"^\.\. auto{kind}:: (\S+)", text, re.MULTILINE):
        place, _, name = path.rpartition(".")
        found[path] = getattr(importlib.import_module(place), name)
    return found


@cache
def calls() -> Mapping[str, Call]:
    """The functions of the reference by path with sound arguments, and the records whose options have defaults."""
    g = _geometry()
    series = g.as_series()
    many = {"in_view": series.in_view, "clocks": g.clocks, "epoch": series.epoch, "time_gps_s": series.time_gps_s}
    many |= _rows(series)
    faults = pl_mc.biases(g, {g.names[0]: 5.0})
    both = {"g": g, "faults": faults}
    counted = both | {"draws": 20, "seed": 1, "alert": pl_mc.LPV_200, "precision": "float64"}
    drawn = counted | {"methods": ("ls",), "noise": "gaussian"}
    errors = {"g": g, "errors_m": np.zeros(len(g.names))}
    rare = {"method": "ls", "alert": pl_mc.LPV_200, "seed": 1, "max_evaluations": 500_000, "target_cov": 0.5}
    minutes = pl_mc.simulate(site="CUT0", epochs=40, interval_s=10.0)
    ramp = {"start_m": 5.0, "stop_m": 100.0, "step_m": 5.0}
    tail = {"threshold": 20.0, "dof": [3.0, 4.0], "noncentrality": 7.0}
    araim = {
        "design": g.design, "c_int": g.sigma_m**2, "c_acc": g.sigma_m**2, "systems": g.systems, "b_nom": 0.75,
        "p_sat": 1e-5, "p_const": {"G": 1e-4, "C": 1e-4}, "budget": pl_mc.araim.LPV_200, "unmonitored": "contained",
        "in_view": g.in_view,
    }  # fmt: skip
    sound: dict[str, dict[str, Any]] = {
        "pl_mc.ramp": {"g": g, "satellite": "G01"} | ramp,
        "pl_mc.ramps": {"g": g, "satellites": ("G01",)} | ramp,
        "pl_mc.biases": {"g": g, "bias_m": {"G01": 5.0}},
        "pl_mc.pairs": {"g": g, "first_m": 5.0, "second_m": -3.0},
        "pl_mc.no_fault": {"g": g},
        "pl_mc.sweep": drawn | {
            "axes": ("vertical", "either"), "by_epoch": False, "workers": 1, "devices": None, "scheduler": None,
            "folder": None, "resume": False, "shard": None, "progress": False,
        },
        "pl_mc.sample": drawn | {"axis": "vertical"},
        "pl_mc.solve": errors | {"methods": ("ls",), "alert": pl_mc.LPV_200, "axis": "either", "precision": "float64"},
        "pl_mc.detect": both | {"tests": ("chi2",), "draws": 20, "seed": 1, "p_fa": 0.1, "calibration_draws": 200,
                                "precision": "float64", "workers": 1, "progress": False},
        "pl_mc.engine.examine": errors | {"tests": ("chi2",), "p_fa": 0.1, "precision": "float64"},
        "pl_mc.simulate": {
            "site": "CUT0", "start": "2017-11-21", "epochs": 2, "interval_s": 30.0, "mask_deg": 10.0, "visible": None,
            "constellations": ("GPS", "BDS-2"), "without": (), "almanac": None, "sp3": None,
            "error_model": "residual", "track_m": None,
        },
        "pl_mc.geometry.dops": {"g": g, "weighted": True},
        "pl_mc.geometry.redundancy_numbers": {"g": g},
        "pl_mc.geometry.constellations.constellation_slots": {"constellations": ("GPS",), "without": (),
                                                              "gps_slots": None},
        "pl_mc.ism.as_ism": {"given": {"sigma_ura_m": {"G": 1.0, "G07": 2.4}}, "field": "ism"},
        "pl_mc.ism.codes_of": {"names": ("G01", "E03", "own"), "systems": ("G", "E", "C")},
        "pl_mc.geometry.orbits.satellite_positions_m": {"slots": constellation_slots("GPS"), "time_gps_s": [1e9]},
        "pl_mc.geometry.frames.geodetic": {"position_m": [3582104.9, 532590.2, 5232755.3]},
        "pl_mc.geometry.frames.enu_rotation": {"latitude_rad": 0.5, "longitude_rad": [1.0, 2.0]},
        "pl_mc.error_model": {"name": "residual"},
        "pl_mc.methods.method": {"name": "igg3", "k0": 1.5},
        "pl_mc.detectors.detector": {"name": "chi2", "reading": "apriori"},
        "pl_mc.detectors.satterthwaite": {"variance_1": 2.5, "variance_2": 4.5, "count_1": 8, "count_2": [9, 10]},
        "pl_mc.noise_model": {"name": "student_t", "nu": 5.0},
        "pl_mc.receiver.read_claims": {"path": Path(__file__).parents[1] / "receiver" / "files" / "esbjerg_llh.pos"},
        "pl_mc.fit_overbound": {
            "residuals": np.sin(np.arange(90.0)), "elevation_deg": np.arange(90.0),
            "satellite": ["G01"] * 45 + ["G02"] * 45,
            "time_gps_s": np.tile(30.0 * np.arange(45), 2), "independent": 60, "bins_deg": (0.0, 45.0, 90.0),
            "confidence": 0.9, "bias": True,
        },
        "pl_mc.statistics.autocorrelation.effective_number": {
            "values": np.sin(np.arange(40.0)), "places": np.arange(40), "series": ["G01"] * 40,
        },
        "pl_mc.receiver.read_truth": {"text": "3582104.9,532590.2,5232755.3"},
        "pl_mc.faults.parse_fault": {"text": "G02:+30m:545-645"},
        "pl_mc.faults.fault_text": {"biases": parse_fault("G01:+3m")},
        "pl_mc.injection.inject": {
            "g": series, "errors_m": np.zeros((1, len(g.names))), "faults": pl_mc.biases(series, "G01:30m"),
        },
        "pl_mc.araim.protection_levels": araim,
        "pl_mc.araim.fault_modes": {
            "systems": g.systems, "clocks": g.design[:, 3:] != 0, "p_sat": np.full(len(g.names), 1e-5),
            "p_const": araim["p_const"], "budget": pl_mc.araim.LPV_200, "unmonitored": "contained",
        },
        "pl_mc.risk": both | rare | {"event": "missed", "noise": "gaussian", "workers": 1, "progress": False,
                                      "axis": "vertical"},
        "pl_mc.worst_case": {"g": g, "axis": "vertical", "satellites": ("G01",), "alarm": "pl", "event": "missed",
                             "p_fa": 1e-3, "refine": 1} | rare,
        "pl_mc.risk_budget": {"g": g, "axis": "vertical", "event": "missed", "alarm": "pl", "p_fa": 1e-3, "p_sat": 1e-5,
                              "p_const": 1e-4, "bias": "worst", "weights": None} | rare,
        "pl_mc.level_risk": {"g": g, "method": "ls", "budget": {"p_sat": 1e-5}, "axis": "vertical",
                             "alert": pl_mc.LPV_200, "confidence": 0.95, "draws": 1024, "seed": 1},
        "pl_mc.continuity": {"g": g, "methods": (_timed_araim(),), "sizes_m": (10.0,), "draws": 16, "rare_draws": 256,
                             "seed": 1, "alert": pl_mc.LPV_200, "axis": "vertical", "required": 1e-4},
        "pl_mc.calibrate": {"g": g, "axis": "horizontal", "target": 1e-3, "faults": faults, "event": "exceeded",
                            "confidence": 0.95, "pooled": False, "draws": 2000} | rare,
        "pl_mc.tune": {"g": g, "method": "igg3", "target": 0.1, "objective": "vpl", "faults": faults, "draws": 500,
                       "steps": 1, "grid": 1, "seed": 1, "parameters": ("k0",), "confidence": 0.95},
        "pl_mc.service_volume": {
            "constellations": "GPS", "without": (), "step_deg": 60.0, "step_s": 300.0, "duration_s": 600.0,
            "start": "2017-11-21", "mask_deg": 10.0, "error_model": "residual", "methods": ("ls",),
            "operations": "LPV-200", "draws": 10, "seed": 1, "durations_s": 300.0,
        },
        "pl_mc.time_to_alert": {
            "g_series": minutes, "satellite": "G01", "rates_m_per_s": [0.5], "methods": ("ls",), "tau_s": 100.0,
            "draws": 20, "seed": 1, "share": 0.5, "onset_s": 100.0, "p_fa": 0.1, "calibration_draws": 100,
            "alert": pl_mc.LPV_200, "axis": "horizontal", "smoothing_s": 50.0,
        },
        "pl_mc.sequential_levels": {
            "g_series": minutes, "satellite": "G01", "rates_m_per_s": [0.5], "banks": (pl_mc.time_ramps.FilterBank(),),
            "tau_s": 100.0, "share": 0.5, "smoothing_s": 50.0, "onset_s": 100.0, "alert": pl_mc.LPV_200,
        },
        "pl_mc.time_ramps.sequential": {"name": "kalman"},
        "pl_mc.exposure": drawn | {"tau_s": 100.0, "duration_s": 3.0, "interval_s": 1.0, "progress": False},
        "pl_mc.statistics.exact.ls_rates": both | {"alert": pl_mc.LPV_200, "axis": "horizontal", "k_vertical": 5.33,
                                                   "k_horizontal": 6.18, "alarm": "pl",
                                                   "p_fa": 1e-3},
        "pl_mc.reliability": {"g": g, "p_fa": 1e-3, "power": 0.8},
        "pl_mc.statistics.reliability_matrix": {"g": g},
        "pl_mc.statistics.least_detectable": {"g": g, "system": "G"},
        "pl_mc.statistics.noncentral_shift": {"p_fa": 1e-3, "power": 0.8},
        "pl_mc.statistics.ls_quantities": {"g": g},
        "pl_mc.statistics.fault_effects": both | {"quantities": None},
        "pl_mc.statistics.fault_free_exceeded": {"dof": [3, 4], "k_vertical": 5.33},
        "pl_mc.statistics.student_factor": {"dof": [3, 4], "risk": 1e-7},
        "pl_mc.statistics.chi2_threshold": {"dof": [3, 4], "p_fa": 1e-3},
        "pl_mc.statistics.split_at_threshold": tail,
        "pl_mc.statistics.joint_exceedance": tail | {"slope": 1.2, "shift": [-0.3, 2.0]},
        "pl_mc.statistics.clopper_pearson": {"events": [0, 3], "draws": 10, "confidence": 0.95},
        "pl_mc.statistics.shared_noise_bounds": {"rate": 0.1, "independent_draws": [10, 20], "confidence": 0.95},
        "pl_mc.statistics.binomial_p_value": {"events": [0, 3], "draws": 10, "probability": 0.2},
    }  # fmt: skip
    known = documented("function")
    made = {path: Call(known[path], arguments) for path, arguments in sound.items()}
    made |= {
        "pl_mc.Geometry.from_arrays": Call(pl_mc.Geometry.from_arrays, _rows(g)),
        "pl_mc.Geometry.from_rows": Call(pl_mc.Geometry.from_rows, many),
        "pl_mc.Geometry[...]": Call(lambda index: series[index], {"index": 0}),
        "pl_mc.Faults.from_array": Call(pl_mc.Faults.from_array, {"g": g, "bias_m": np.eye(len(g.names))}),
        "pl_mc.faults.Bias": Call(
            Bias,
            {
                "of": ("G01", "G"),
                "numbers": (5.0, 100.0),
                "law": "uniform",
                "either_sign": True,
                "independent": False,
                "per_second": False,
                "first_epoch": 3,
                "last_epoch": 5,
            },
        ),
        "pl_mc.araim.Ism": Call(
            pl_mc.araim.Ism,
            {
                "sigma_ura_m": 1.0,
                "sigma_ure_m": {"G": 0.5, "E": 0.7},
                "b_nom_m": 0.75,
                "p_sat": 1e-5,
                "p_const": {"G": 1e-8, "E": 1e-4},
                "name": "own",
            },
        ),
        "pl_mc.AlertLimits": Call(pl_mc.AlertLimits, {"name": "mine", "vertical_m": 35.0, "horizontal_m": 40.0}),
        "site_position_m": Call(site_position_m, {"site": "CUT0"}),
        "gps_seconds": Call(gps_seconds, {"date": "2017-11-21"}),
        "fly": Call(fly, {"plan": survey_plan(), "epochs": 5, "interval_s": 1.0}),
    }
    return _records() | made


def _records() -> dict[str, Call]:
    """Records of the reference that are made of options with defaults."""
    found = {}
    for path, record in documented("class").items():
        fields = dataclasses.fields(record) if dataclasses.is_dataclass(record) else ()
        options = {field.name: field.default for field in fields if field.init}
        abstract = getattr(record, "__abstractmethods__", None)
        if path in ELSEWHERE:
            continue
        if options and dataclasses.MISSING not in options.values() and not abstract and not path.startswith(KERNELS):
            found[path] = Call(record, options)
    return found


def with_strange(call: Call, rng: Generator) -> dict[str, Any]:
    """The arguments of a call, one or two of them strange."""
    arguments = dict(call.arguments)
    count = int(rng.integers(1, min(2, len(arguments)) + 1))
    for name in rng.choice(list(arguments), count, replace=False):
        arguments[str(name)] = STRANGE[int(rng.integers(len(STRANGE)))]
    return arguments
