"""Injection: faults added to the errors of a real receiver, over a window of epochs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.faults import require_satellite
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, plain_number, require_list, require_numbers, shown

_FORM = re.compile(r"(?P<satellite>[^:]+):(?P<bias>[^:]+?)m?(?::(?P<first>\d+)-(?P<last>\d+))?")


@dataclass(frozen=True)
class Injection:
    """A bias on one satellite over a window of epochs.

    Attributes:
        satellite: its name.
        bias_m: bias [m].
        first_epoch, last_epoch: epoch numbers, both included; None for all epochs.
    """

    satellite: str
    bias_m: float
    first_epoch: int | None = None
    last_epoch: int | None = None

    def __str__(self) -> str:
        window = "" if self.first_epoch is None else f":{self.first_epoch}-{self.last_epoch}"
        return f"{self.satellite}:{plain_number(self.bias_m, sign=True)}m{window}"


def parse_injection(text: str) -> Injection:
    """``G02:+30m:545-645`` or, for all epochs, ``G02:+30m``.

    Raises:
        InputError: another form, a bias that is not a finite number, or a window that ends before it begins.
    """
    rule = "satellite:bias:first-last is needed, such as G02:+30m:545-645"
    if not isinstance(text, str):
        raise InputError(f"fault {shown(text)}: {rule}.")
    found = _FORM.fullmatch(text.strip())
    if found is None:
        raise InputError(f"fault {shown(text)}: {rule}.")
    try:
        # Python reads digits of other alphabets and underscores too.
        bias = float(found["bias"] if text.isascii() and "_" not in found["bias"] else "none")
    except ValueError:
        raise InputError(f"fault {shown(text)}: {shown(found['bias'])} is no number of metres; {rule}.") from None
    if not np.isfinite(bias):
        raise InputError(f"fault {shown(text)}: the bias is a finite number of metres.")
    if found["first"] is None:
        return Injection(found["satellite"], bias)
    first, last = int(found["first"]), int(found["last"])
    if last < first:
        raise InputError(f"fault {shown(text)}: the window ends before it begins; did you mean {last}-{first}?")
    return Injection(found["satellite"], bias, first, last)


@ordinary_arithmetic
def inject(
    g: Geometry, errors_m: NDArray[np.float64], injections: Sequence[Injection]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], tuple[str, ...]]:
    """Add faults to the errors of a series.

    Args:
        g: a series of epochs.
        errors_m: (epochs, n), pseudorange errors in the rows of ``g`` [m].
        injections: the faults; faults on the same satellite and epoch add up.

    Returns:
        The errors (epochs, n) [m]; whether each epoch is faulted (epochs,); and a sentence for each fault whose
        satellite is out of view in part of its window.

    Raises:
        InputError: a satellite that is never in view, or a window outside the series.
    """
    errors = require_numbers(errors_m, field="errors_m")
    if errors.shape != require_geometry(g).sigma_m.shape or not g.is_series:
        raise InputError(f"errors_m: a series and errors of its shape are needed, not {errors.shape}.")
    for one in require_list(injections, field="injections", of="faults"):
        if not isinstance(one, Injection):
            raise InputError(f"injections: faults such as those of parse_injection are needed, not {shown(one)}.")
    faulted = np.zeros(len(g), dtype=bool)
    notes = []
    for one in injections:
        index = require_satellite(g, one.satellite)
        first, last = int(g.epoch[0]), int(g.epoch[-1])
        begin = first if one.first_epoch is None else one.first_epoch
        end = last if one.last_epoch is None else one.last_epoch
        window = (g.epoch >= begin) & (g.epoch <= end)
        if begin < first or end > last:
            raise InputError(f"fault {one}: epochs run from {first} to {last}.")
        hit = (g.satellite == index) & g.in_view & window[:, None]
        errors[hit] += one.bias_m
        seen = hit.any(axis=1)
        faulted |= seen
        if not seen.any():
            present = np.unique(g.satellite[window][g.in_view[window]])
            raise InputError(
                f"fault {one}: {one.satellite} is out of view at all epochs of the window (in view: "
                f"{', '.join(g.names[k] for k in present)})."
            )
        if hidden := window.sum() - seen.sum():
            notes.append(f"Fault {one}: {one.satellite} is out of view at {hidden} of {window.sum()} epochs.")
    return errors, faulted, tuple(notes)
