"""Continuity: does an operation that starts available stay available to its end?

The grid of epochs tells it at whole steps: R_j is the probability that service is there at the j epochs after one
at which it is there. An operation of T = (q + f) steps starts at any moment of a step, so a share f of them sees
q + 1 further epochs and the others see q:

    continuity = (1 - f) R_q + f R_(q + 1),   R_0 = 1.

For T within one step that is 1 - f P(lost at the next epoch): each loss falls at some moment of its step, and f is
the share of operations that it meets. Limits: an outage between two epochs is not seen; every epoch draws its own
noise, as if errors a step apart were independent and stood still in between; a receiver's false alerts and failures
of satellites are not part of it.

Bounds are about the noise alone. Where levels depend on the geometry alone there is none: what the epochs of a site
say is the same whenever it is asked, and both bounds are the value itself. With noise, runs of j steps that start
less than j epochs apart share draws; of those that start j epochs apart the end of one is the start of the next,
which that one takes as given, and they share nothing else. All runs are j such sets, so that the bounds are those
of a j-th of the starts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError, plain_number, require_numbers, require_within
from pl_mc.statistics.intervals import shared_noise_bounds


@dataclass(frozen=True)
class Duration:
    """An operation's length in steps of the grid of epochs.

    Attributes:
        seconds: its length [s].
        whole: q, whole steps in it.
        part: f, what is left of it, 0 to below 1.
    """

    seconds: float
    whole: int
    part: float

    @property
    def label(self) -> str:
        """As columns name it: ``15s``."""
        return f"{plain_number(self.seconds)}s"

    @property
    def runs(self) -> tuple[int, ...]:
        """The j of the R_j that it needs; R_0 needs no count."""
        wanted = (self.whole, self.whole + 1) if self.part > 0 else (self.whole,)
        return tuple(j for j in wanted if j > 0)

    @property
    def confidence(self) -> float:
        """That of the bounds of each R_j which makes 95 % of all together."""
        return 1.0 - 0.05 / len(self.runs)


def as_durations(durations_s: Any, *, step_s: float, epochs: int) -> tuple[Duration, ...]:
    """Operations of this length or these; an `InputError` for one that the epochs do not hold."""
    made: list[Duration] = []
    for value in np.ravel(require_numbers(durations_s, field="durations_s")).tolist():
        seconds = require_within(value, field="durations_s", low=1e-3, high=1e9)
        steps = seconds / step_s
        # A length that is a whole number of steps but for rounding is one.
        is_whole = round(steps) > 0 and abs(steps - round(steps)) < 1e-9 * steps
        whole = round(steps) if is_whole else int(steps)
        duration = Duration(seconds, whole, 0.0 if is_whole else steps - whole)
        if duration.runs[-1] >= epochs:
            raise InputError(
                f"durations_s: an operation of {seconds:g} s needs more than the {epochs} epochs of {step_s:g} s; "
                f"at most {(epochs - 1) * step_s:g} s fit."
            )
        if any(duration.seconds == other.seconds for other in made):
            raise InputError(f"durations_s: {seconds:g} s is asked for twice.")
        made.append(duration)
    return tuple(made)


def run_counts(serves: NDArray[np.bool_], j: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(sites,) starts with service that have j further epochs (1 or more), and those that keep it at all of these.

    ``serves`` is (sites, epochs, draws); a draw is followed from epoch to epoch.
    """
    starts = serves[:, : serves.shape[1] - j]
    stays = starts.copy()
    for later in range(1, j + 1):
        stays &= serves[:, later : later + starts.shape[1]]
    return starts.sum(axis=(1, 2)), stays.sum(axis=(1, 2))


def continuity(
    duration: Duration, counts: Mapping[int, tuple[NDArray[np.int64], NDArray[np.int64]]], *, exact: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(...,) continuity over an operation, and its 95 % bounds; NaN, 0 and 1 where no operation starts.

    Bounds are those of R_j in the same combination: after Clopper and Pearson, the starts being the trials, and for
    j of 2 or more with a j-th of the starts as trials (`pl_mc.statistics.intervals.shared_noise_bounds`). Where
    there are two R_j each takes half of the 5 %. Where no noise is behind the counts (``exact``) both bounds are
    the value. ``counts`` are starts and stays (...,) of `run_counts`, by j.
    """
    rates = {}
    for j in duration.runs:
        started, stayed = counts[j]
        rate = np.where(started > 0, stayed / np.maximum(started, 1), np.nan)
        if exact:
            rates[j] = (rate, rate, rate)
        else:
            rates[j] = (rate, *shared_noise_bounds(np.nan_to_num(rate), started // j, duration.confidence))
    return joined(duration, rates)


def joined(
    duration: Duration, rates: Mapping[int, tuple[FloatArray, ...]]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Continuity, lower and upper bound, from those of each R_j."""
    parts = []
    for place in range(3):
        here = np.ones_like(rates[duration.runs[0]][place]) if duration.whole == 0 else rates[duration.whole][place]
        further = rates[duration.whole + 1][place] if duration.part > 0 else here
        parts.append((1.0 - duration.part) * here + duration.part * further)
    # Where nothing starts there is nothing to be said.
    unknown = np.isnan(parts[0])
    return parts[0], np.where(unknown, 0.0, parts[1]), np.where(unknown, 1.0, parts[2])
