"""Functions of the public interface with sound arguments, and values that no argument is meant for.

Only what is cheap: functions that check all their arguments before they compute, and are given little to compute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np
from numpy.random import Generator

import pl_mc
from pl_mc.error_models import error_model
from pl_mc.geometry.flight import fly, survey_plan
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.sites import site_position_m
from pl_mc.injection import parse_injection
from pl_mc.methods import method
from pl_mc.receiver import read_truth

STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 10**30, -(10**30), 0.5, -0.0, math.nan, math.inf, -math.inf, 1e308, 5e-324, 1j,
    "", " ", "G01", "nan", "1,2,3", "a\0b", "é" * 300, b"G01", (), [], {}, [None], [math.nan], [[1.0], [2.0, 3.0]],
    [1, 2, 3], ["G01", "G01"], {"G01": math.nan}, {"G01": 1.0, 2: "x"}, {1, 2}, np.float32(1.5), np.int64(3),
    np.array(7), np.zeros(0), np.zeros((0, 3)), np.full((4, 3), np.nan), np.array(["x"]), np.array([None], object),
    np.ones((2, 2, 2, 2)), datetime(1970, 1, 1), datetime(2020, 1, 1, tzinfo=UTC), datetime.max, object(), len,
    range(3), "CUT0", "2017-11-21", "ls", "GPS", ["GPS", "GPS"], "float16", "../..", "x" * 5000,
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
def calls() -> Mapping[str, Call]:
    """The functions by name."""
    g = _geometry()
    series = g.as_series()
    many = {"in_view": series.in_view, "clocks": g.clocks, "epoch": series.epoch, "time_gps_s": series.time_gps_s}
    many |= _rows(series)
    return {
        "simulate": Call(
            pl_mc.simulate,
            {
                "site": "CUT0",
                "start": "2017-11-21",
                "epochs": 2,
                "interval_s": 30.0,
                "mask_deg": 10.0,
                "visible": None,
                "constellations": ("GPS", "BDS-2"),
                "without": (),
                "almanac": None,
                "sp3": None,
                "error_model": "residual",
                "track_m": None,
            },
        ),
        "Geometry.from_arrays": Call(pl_mc.Geometry.from_arrays, _rows(g)),
        "Geometry.from_rows": Call(pl_mc.Geometry.from_rows, many),
        "Geometry[...]": Call(lambda index: series[index], {"index": 0}),
        "read_truth": Call(read_truth, {"text": "3582104.9,532590.2,5232755.3"}),
        "site_position_m": Call(site_position_m, {"site": "CUT0"}),
        "ramp": Call(
            lambda **fields: pl_mc.ramp(g, **fields),
            {"satellite": "G01", "start_m": 5.0, "stop_m": 100.0, "step_m": 5.0},
        ),
        "ramps": Call(
            lambda **fields: pl_mc.ramps(g, **fields),
            {"satellites": ("G01",), "start_m": 5.0, "stop_m": 100.0, "step_m": 5.0},
        ),
        "biases": Call(lambda sizes: pl_mc.biases(g, sizes), {"sizes": {"G01": 5.0}}),
        "error_model": Call(error_model, {"name": "residual"}),
        "huber": Call(lambda **fields: method("huber", **fields), {"k": 1.5}),
        "slope": Call(lambda **fields: method("slope", **fields), {"p_fa": 1e-4, "p_md": 1e-3}),
        "method": Call(method, {"name": "ls"}),
        "AlertLimits": Call(pl_mc.AlertLimits, {"name": "mine", "vertical_m": 35.0, "horizontal_m": 40.0}),
        "reliability": Call(lambda **fields: pl_mc.reliability(g, **fields), {"p_fa": 1e-3, "power": 0.8}),
        "exact.ls_rates": Call(
            lambda **fields: pl_mc.exact.ls_rates(g, **fields), {"faults": pl_mc.no_fault(g), "alert": pl_mc.LPV_200}
        ),
        "parse_injection": Call(parse_injection, {"text": "G02:+30m:545-645"}),
        "noise_model": Call(pl_mc.noise_model, {"name": "student_t", "nu": 5.0}),
        "fly": Call(lambda **fields: fly(survey_plan(), **fields), {"epochs": 5, "interval_s": 1.0}),
        "gps_seconds": Call(gps_seconds, {"date": "2017-11-21"}),
    }


def with_strange(call: Call, rng: Generator) -> dict[str, Any]:
    """The arguments of a call, one or two of them strange."""
    arguments = dict(call.arguments)
    count = int(rng.integers(1, min(2, len(arguments)) + 1))
    for name in rng.choice(list(arguments), count, replace=False):
        arguments[str(name)] = STRANGE[int(rng.integers(len(STRANGE)))]
    return arguments
