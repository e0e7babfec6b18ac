"""The accumulated parity test: parity vectors summed over windows, against noise that is correlated in time.

A slow ramp hides in the noise of every single parity vector, but not in their mean. Sequential RAIM takes several
epochs together (Clot, Macabiau, Nikiforov & Roturier 2006, Sequential RAIM designed to detect combined step/slope
pseudorange errors). That paper was not at hand: by its title and by abstracts of the same authors, theirs is a
generalised likelihood-ratio test, constrained to faults that harm the position, for steps and slopes. This file's
test is a plainer one of its own: sums over fixed windows, as for a step, with their exact
covariance, and no constraint.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import require_fraction
from pl_mc.methods.raim_levels import P_FA
from pl_mc.time_ramps.sequential import Sample
from pl_mc.time_ramps.signals import LANES, NoiseInTime, Rows
from pl_mc.time_ramps.windows import (
    WindowTests,
    name_with_windows,
    whitened,
    window_samples,
    window_seconds,
    window_sums,
    window_tests,
)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ParityPlan:
    """The tests of the summed residuals, which guard the least-squares position."""

    tests: WindowTests
    up_m: Array
    own_position: bool = field(default=False, metadata={"static": True})
    motions: int = field(default=0, metadata={"static": True})

    def epochs(self) -> tuple[()]:
        return ()

    def begin(self) -> Array:
        return jnp.zeros((self.tests.whitener.shape[-1], LANES))

    def advance(self, epoch: tuple[()], state: Array, sample: Sample) -> tuple[Array, Array, Array]:
        total = state + sample.noise - sample.fitted
        return total, total, jnp.zeros(LANES)


@dataclass(frozen=True)
class SequentialParity:
    """Parity vectors summed over the last samples, one test or a bank of them; guards the least-squares position.

    Residuals e_k = R_k z_k stand for parity vectors, since their coordinates stay with their satellites while the
    sky turns; the sum is seen in the parity space of the last epoch. Its covariance follows from the
    autocorrelation of the noise, exactly, and the statistic is chi-square with as many degrees of freedom as that
    space has. A bank takes the largest ratio of statistic and threshold.

    Attributes:
        windows_s: lengths of the windows, 0 for one sample [s].
        p_fa: false-alarm probability behind the nominal thresholds; with several windows it decides, slightly, how
            they share the false alarms.
    """

    windows_s: tuple[float, ...] = (10.0, 30.0, 100.0, 300.0)
    p_fa: float = P_FA

    def __post_init__(self) -> None:
        object.__setattr__(self, "windows_s", window_seconds("sequential_parity", self.windows_s))
        require_fraction(self.p_fa, field="sequential_parity: p_fa")

    @property
    def name(self) -> str:
        return name_with_windows("sequential_parity", self.windows_s)

    def plan(self, rows: Rows, noise: NoiseInTime, ramp_m: FloatArray, onset: int) -> ParityPlan:
        maps = residual_maps(rows)
        ramp = np.einsum("eij,ej->ei", maps, ramp_m / rows.sigma_m * rows.in_view)
        size, basis = np.linalg.eigh(maps[onset:])
        basis = basis * (size > 0.5)[:, None, :]
        samples = window_samples("sequential_parity", self.windows_s, rows.interval_s, onset)
        correlation, code = noise.correlation(rows.interval_s), noise.code_correlation(rows.interval_s)
        made = []
        for w in samples:
            covariance = summed_covariance(maps, correlation, noise.share, w, onset)
            if code > 0:
                # Code noise that is smoothed, in place of white.
                own = summed_covariance(maps, code, 1.0, w, onset) - summed_covariance(maps, code, 0.0, w, onset)
                covariance = covariance + (1.0 - noise.share) * own
            made.append(whitened(covariance, basis, window_sums(ramp, w, onset), self.p_fa))
        return ParityPlan(window_tests(made, samples), up_m=jnp.zeros(len(rows.design)))


def residual_maps(rows: Rows) -> FloatArray:
    """(T, m, m), R with e = R z of whitened errors: the orthogonal projection on the parity space of each epoch."""
    seen = rows.in_view.astype(float)
    design = rows.design * (seen / rows.sigma_m)[:, :, None]
    # Columns of very different size (clocks without a satellite are zero) are no obstacle to an SVD.
    fitted = design @ np.linalg.pinv(design, rcond=1e-10)
    return np.einsum("ei,ij->eij", seen, np.eye(seen.shape[1])) - fitted


def summed_covariance(maps: FloatArray, correlation: float, share: float, samples: int, onset: int) -> FloatArray:
    """(T - onset, m, m), covariance of the sum of the last residuals, in units of sigma^2.

    sum over i, j in the window of rho(i - j) R_i R_j', by prefix sums over all pairs: those of the window (o, t]
    are all pairs up to t, less those up to o, less those with one sample on either side of o. The latter are
    U_o (D_o - phi^W D_t)' and its transpose, with U_o = sum over i <= o of phi^(o - i) R_i and
    D_o = sum over j > o of phi^(j - o) R_j.

    Args:
        maps: (T, m, m), R of every epoch.
        correlation: phi, of the correlated part from sample to sample.
        share: of the correlated part in the variance.
        samples: W, at most ``onset``.
        onset: first epoch of the result.
    """
    last, before = slice(onset, None), slice(onset - samples, len(maps) - samples)
    white = np.cumsum(maps, axis=0)
    past, future = np.empty_like(maps), np.zeros_like(maps)
    past[0] = maps[0]
    for k in range(1, len(maps)):
        past[k] = maps[k] + correlation * past[k - 1]
    for k in range(len(maps) - 2, -1, -1):
        future[k] = correlation * (maps[k + 1] + future[k + 1])
    # R_k with everything up to k, both orders, the pair of k with itself once.
    joint = maps @ np.swapaxes(past, 1, 2)
    pairs = np.cumsum(joint + np.swapaxes(joint, 1, 2) - maps, axis=0)
    cross = past[before] @ np.swapaxes(future[before] - correlation**samples * future[last], 1, 2)
    slow = pairs[last] - pairs[before] - cross - np.swapaxes(cross, 1, 2)
    return (1.0 - share) * (white[last] - white[before]) + share * slow
