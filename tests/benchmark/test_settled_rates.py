"""The figure that users pay: settled estimates beside forty plain solutions."""

from __future__ import annotations

import pytest

import pl_mc
from pl_mc.benchmark.problem import reference_faults, reference_geometry
from pl_mc.benchmark.report import Sizes
from pl_mc.benchmark.run import PLAIN, SEED, SETTLED, run_bench
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Igg3, Ls
from pl_mc.report.text import rate_text
from pl_mc.runtime.threads import cores
from pl_mc.statistics.intervals import shared_noise_bounds


def test_settled_estimates_stand_beside_plain_ones_with_what_had_not_settled():
    sizes = Sizes(seconds=0.01, repetitions=2, draws=LANES, accuracy_scenarios=16, limit_scenarios=16)
    record, text = run_bench(sizes=sizes, precisions=["float64"], progress=False)
    rates = {rate.what: rate for rate in record.rates if rate.what in (SETTLED, PLAIN)}
    assert [(rate.threads, rate.devices) for rate in rates.values()] == [(cores(), 1)] * 2
    (ratio,) = (one for one in record.ratios if one.what == SETTLED)
    by_round = sorted(a / b for a, b in zip(rates[SETTLED].rates, rates[PLAIN].rates, strict=True))
    assert (ratio.to, ratio.precision) == (PLAIN, "float64")
    assert (ratio.low, ratio.median, ratio.high) == pytest.approx((by_round[0], sum(by_round) / 2, by_round[1]))

    g = reference_geometry()
    faults = reference_faults(g)
    for what, method in ((SETTLED, Igg3()), (PLAIN, Igg3(iterations=40))):
        draws = rates[what].scenarios // len(faults)
        counted = pl_mc.sweep(g, faults, draws=draws, seed=SEED, methods=[Ls(), method])
        count = int(counted[counted.method == method.name].unconverged.sum())
        low, high = shared_noise_bounds(count / (draws * len(faults)), draws)
        told = rate_text(count, draws * len(faults), float(low), float(high))
        assert f"{what} in float64, {method.name}: draws that had not settled to 1 cm: {told}." in text
