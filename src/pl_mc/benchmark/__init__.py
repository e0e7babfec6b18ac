"""The benchmark: how fast a sweep runs on this machine beside other ways to do the same work, and how exactly."""

from pl_mc.benchmark.report import Bench
from pl_mc.benchmark.run import run_bench
from pl_mc.benchmark.scaling import run_scaling, scaling, scenario_counts

__all__ = ["Bench", "run_bench", "run_scaling", "scaling", "scenario_counts"]
