"""The engine: geometry x fault x noise, through the methods, to counts or single outcomes."""

from pl_mc.engine.detect import detect, examine
from pl_mc.engine.execution import Execution
from pl_mc.engine.outcomes import sample, solve
from pl_mc.engine.sweep import run_sweep, sweep
from pl_mc.kernels.events import EVENTS, Event

__all__ = ["EVENTS", "Event", "Execution", "detect", "examine", "run_sweep", "sample", "solve", "sweep"]
