"""Sums over windows of samples and their quadratic tests: what all sequential tests have in common.

A test's vectors v_k (residuals, weighted innovations) are linear in errors and fault. Over the last W samples they
have a sum b with a known covariance of rank r, so that |M b|^2 with a whitening M is chi-square with r degrees of
freedom, noncentral under a fault (lambda = |M b_fault|^2), however correlated and however changing the samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError, require_number, shown
from pl_mc.kernels.linear_model import product
from pl_mc.methods.raim_levels import thresholds
from pl_mc.runtime.precision import on_device
from pl_mc.time_ramps.signals import whole_samples


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class WindowTests:
    """A bank of windows at the monitored epochs.

    Attributes:
        whitener: (epochs, windows, m, m), M over the root of the nominal threshold.
        response: (epochs, windows, m), M b of the unit ramp over the same.
        samples: lengths of the windows.
    """

    whitener: Array
    response: Array
    samples: tuple[int, ...] = field(metadata={"static": True})


def window_seconds(owner: str, windows_s: Iterable[float]) -> tuple[float, ...]:
    """Windows of a record as a tuple of floats; an `InputError` for none, repeated or negative ones."""
    try:
        given = tuple(require_number(value, field=f"{owner}: windows_s") for value in windows_s)
    except TypeError:
        raise InputError(f"{owner}: windows_s: a list of times in seconds is needed, not {shown(windows_s)}.") from None
    if not given or min(given) < 0.0 or len(set(given)) < len(given):
        raise InputError(
            f"{owner}: windows_s: different times of at least 0 s (one sample) are needed, not {list(given)}."
        )
    return tuple(float(value) for value in given)


def window_samples(owner: str, windows_s: tuple[float, ...], interval_s: float, onset: int) -> tuple[int, ...]:
    """Lengths in samples, at least one; an `InputError` where a window would not be full when the ramp begins."""
    samples = tuple(max(1, whole_samples(w, interval_s, field=f"{owner}: windows_s")) for w in windows_s)
    if max(samples) > onset:
        raise InputError(
            f"{owner}: windows_s: a window of {max(samples) * interval_s:g} s is not full when the ramp begins at "
            f"{onset * interval_s:g} s; nearest: {onset * interval_s:g} s."
        )
    return samples


def name_with_windows(name: str, windows_s: tuple[float, ...]) -> str:
    """``kalman[0+30 s]``, with whatever brackets ``name`` has."""
    return f"{name}[{'+'.join(f'{w:g}' for w in windows_s)} s]"


def whitened(covariance: FloatArray, basis: FloatArray, sums: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
    """Whitener and response of one window at every epoch, both over the root of the threshold at ``p_fa``.

    Args:
        covariance: (epochs, m, m), of the sum.
        basis: (epochs, m, m), orthonormal columns that span what the test looks at; the others are zero.
        sums: (epochs, m), the sum of the unit ramp.
        p_fa: nominal false-alarm probability of a single test.
    """
    turned = np.swapaxes(basis, 1, 2)
    used = np.abs(basis).max(axis=1) > 0
    # Columns that are not used get a variance of one, which the zero rows of the basis never show.
    square = turned @ covariance @ basis + np.einsum("ei,ij->eij", ~used, np.eye(used.shape[1]))
    root: FloatArray = np.linalg.cholesky(square)
    whitener: FloatArray = np.linalg.solve(root, turned).astype(np.float64)
    limit = thresholds(used.shape[1], p_fa)[used.sum(axis=1)]
    scale = np.where(np.isfinite(limit), 1.0 / np.sqrt(np.where(np.isfinite(limit), limit, 1.0)), 0.0)
    whitener = whitener * scale[:, None, None]
    response: FloatArray = np.einsum("ejk,ek->ej", whitener, sums)
    return whitener, response


def window_tests(made: Iterable[tuple[FloatArray, FloatArray]], samples: tuple[int, ...]) -> WindowTests:
    """The bank of the windows that `whitened` made, one for each length."""
    whiteners, responses = (on_device(np.stack(parts, axis=1)) for parts in zip(*made, strict=True))
    return WindowTests(whiteners, responses, samples)


def window_sums(values: FloatArray, samples: int, onset: int) -> FloatArray:
    """(T - onset, ...), sums over the last ``samples`` values at every epoch from ``onset`` on."""
    total = np.cumsum(values, axis=0)
    return total[onset:] - total[onset - samples : len(values) - samples]


def largest_ratio(tests: WindowTests, sums: list[Array], rates: Array) -> Array:
    """(f, lanes), the largest of the windows' statistics over their nominal thresholds.

    Args:
        tests: at one epoch, without its leading axis.
        sums: for each window (m, lanes), of the noise alone.
        rates: (f,) [m/s].
    """
    ratios = []
    for k, total in enumerate(sums):
        noise, fault = product(tests.whitener[k], total), tests.response[k]
        own, cross, full = jnp.sum(noise * noise, axis=0), product(fault[None], noise)[0], jnp.sum(fault * fault)
        ratios.append(own[None] + 2.0 * rates[:, None] * cross[None] + (rates * rates)[:, None] * full)
    return jnp.max(jnp.stack(ratios), axis=0)
