"""Reference numbers that nobody here made, as tasks that any tool can answer, and what its answers are worth."""

from pl_mc.conformance.running import conform, summary

__all__ = ["conform", "summary"]
