"""Faults: which satellites are biased, by how much, and when.

A `Faults` record is a list of faults over the satellites of a geometry, each with a label such as
``G02:+30m,C11:-20m`` from which it can be made again. In a series of epochs a fault counts in those epochs alone in
which all of its satellites are in view.
"""

from pl_mc.faults.bias import MOST_BIAS_M, NO_FAULT, Bias, fault_text, parse_fault
from pl_mc.faults.lists import biases, biases_of_table, no_fault, pairs, ramp, ramp_sizes_m, ramps, require_text
from pl_mc.faults.record import Faults, fault_label, require_faults, require_satellite

__all__ = [
    "MOST_BIAS_M", "NO_FAULT", "Bias", "Faults", "biases", "biases_of_table", "fault_label", "fault_text", "no_fault",
    "pairs", "parse_fault", "ramp", "ramp_sizes_m", "ramps", "require_faults", "require_satellite", "require_text",
]  # fmt: skip
