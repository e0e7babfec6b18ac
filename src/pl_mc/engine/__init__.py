"""The engine: geometry x fault x noise, through the methods, to counts or single outcomes."""

from pl_mc.engine.detect import detect, examine
from pl_mc.engine.events import EVENTS, Event
from pl_mc.engine.outcomes import sample, solve
from pl_mc.engine.sweep import sweep

__all__ = ["EVENTS", "Event", "detect", "examine", "sample", "solve", "sweep"]
