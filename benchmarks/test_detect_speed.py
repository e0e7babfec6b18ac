"""Fault detection by the chi-square test, calibration of its threshold included."""

from __future__ import annotations

import pl_mc


def test_detect(benchmark, g, faults):
    options = {"draws": 256, "seed": 1, "p_fa": 0.05, "calibration_draws": 512, "workers": 1, "progress": False}
    table = benchmark(pl_mc.detect, g, faults, tests=("chi2",), **options)
    benchmark.extra_info["scenarios"] = 256 * len(faults)
    nominal = table[table.level == "nominal"]
    assert len(table) == 2 * len(faults)
    # A bias of 100 m is found every time; of 5 m seldom enough that the order is plain.
    assert nominal.detections.iloc[-1] == 256
    assert nominal.detections.iloc[0] < 256
