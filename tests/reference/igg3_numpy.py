"""Least squares and IGG-III for one scenario, slowly and readably, from the formulas of the paper alone.

Zhao, Yang, Xu, Jing & Ma (2021), Geomatics and Information Science of Wuhan University 46(1):96-102. Nothing is
shared with the kernels: weight matrices are written out, solutions come from `numpy.linalg`, and what is out of
view is deleted before anything is computed.

Conventions that the paper leaves open:

* the scale of a standardised residual, its cofactor and the divisor of the unit-weight error are the arguments
  ``scale``, ``cofactor`` and ``redundancy``;
* the iteration starts from least squares, or (``start="huber"``) from five more solutions with Huber's weights;
* unless ``iterations`` is given, or with ``acceleration`` ``aitken``, some iterates are moved on along their last
  step, and a scenario that has settled before the first of these goes on with the last solution at once;
* no weight factor falls below ``weight_floor``, which is zero unless given;
* satellites whose fault-free residuals are correlated by 1 or -1 have one weight, where they are standardised alike;
* a satellite whose redundancy number is below 1e-10 keeps its weight;
* a solution is undetermined with fewer than t + 1 satellites of positive weight, or if a Cholesky pivot is below
  1e-10 of the same pivot of the fault-free normal matrix; a scenario is, if one of its solutions is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

K_V, K_H = 5.33, 6.18
K0, K1 = 1.5, 5.0

# Solutions of the default; those after which it is moved on, the largest ratio, the farthest of such a move and the
# smallest step that is followed, in the metric of fitted ranges over their sigma; the step of what has settled.
ITERATIONS, FROM, EVERY, RATIO, REACH, SMALLEST, SETTLED = 36, 15, 3, 0.95, 0.25, 1e-6, 1e-3


@dataclass
class Solution:
    """What the paper computes of one scenario; without ``available`` nothing else means anything."""

    available: bool
    x: np.ndarray | None = None  # (t,), east, north, up and the clocks in view [m]
    v: np.ndarray | None = None  # (n,), residuals of the satellites in view [m], eq 5
    w: np.ndarray | None = None  # (n,), weight factors of the satellites in view
    m: float = np.inf  # unit-weight error, eqs 16 and 17
    q: np.ndarray | None = None  # (3,), diagonal of the cofactor matrix for east, north, up [m^2]
    change_m: float = 0.0  # largest change of a position component in the last iteration [m]
    tied: bool = False  # whether satellites that no residual tells apart weigh less than one

    @property
    def vpl_m(self) -> float:
        """Eqs 15 and 19."""
        return K_V * self.m * np.sqrt(self.q[2]) if self.available else np.inf

    @property
    def hpl_m(self) -> float:
        """Eqs 14 and 18."""
        return K_H * self.m * np.sqrt(self.q[0] + self.q[1]) if self.available else np.inf


def delete_what_is_out_of_view(design, sigma_m, observed_m, in_view=None):
    """Rows out of view go, and with them the clocks that no row in view observes."""
    design, sigma_m, observed_m = (np.asarray(a, dtype=float) for a in (design, sigma_m, observed_m))
    if in_view is not None:
        rows = np.asarray(in_view, dtype=bool)
        design, sigma_m, observed_m = design[rows], sigma_m[rows], observed_m[rows]
    used = [j < 3 or np.any(design[:, j] != 0) for j in range(design.shape[1])]
    return design[:, used], sigma_m, observed_m


def least_squares(design, sigma_m, observed_m, in_view=None) -> Solution:
    """Eqs 4, 5 and 16."""
    a, sigma, observed = delete_what_is_out_of_view(design, sigma_m, observed_m, in_view)
    n, t = a.shape
    p = np.diag(1.0 / sigma**2)
    if n < t + 1 or np.linalg.matrix_rank(a / sigma[:, None]) < t:
        return Solution(available=False)
    normal = a.T @ p @ a
    x = np.linalg.solve(normal, a.T @ p @ observed)
    v = a @ x - observed
    return Solution(
        available=True, x=x, v=v, w=np.ones(n), m=np.sqrt(v @ p @ v / (n - t)), q=np.diag(np.linalg.inv(normal))[:3]
    )


def igg3_weight(u: float, k0: float = K0, k1: float = K1) -> float:
    """Eq 7."""
    u = abs(u)
    if u <= k0:
        return 1.0
    if u <= k1:
        return k0 / u * ((k1 - u) / (k1 - k0)) ** 2
    return 0.0


def huber_weight(u: float, k: float = 1.345) -> float:
    """Huber (1964)."""
    return 1.0 if abs(u) <= k else k / abs(u)


def igg3(
    design,
    sigma_m,
    observed_m,
    in_view=None,
    *,
    weight: Callable[[float], float] = igg3_weight,
    iterations: int | None = None,
    acceleration: str | None = None,
    scale: str = "posterior_floored",
    cofactor: str = "fault_free",
    redundancy: str = "all",
    start: str = "ls",
    weight_floor: float = 0.0,
) -> Solution:
    """Eqs 6, 7 and 17: least squares, then ``iterations`` times weights from the residuals and a new solution."""
    a, sigma, observed = delete_what_is_out_of_view(design, sigma_m, observed_m, in_view)
    now = least_squares(a, sigma, observed)
    if not now.available:
        return now
    n, t = a.shape
    p = np.diag(1.0 / sigma**2)
    fault_free_normal = a.T @ p @ a
    fault_free_pivots = np.diag(np.linalg.cholesky(fault_free_normal)) ** 2
    # Redundancy numbers: variance of a residual over the variance of its observation.
    fault_free_r = np.diag(np.eye(n) - a @ np.linalg.inv(fault_free_normal) @ a.T @ p)
    checked = fault_free_r >= 1e-10

    standard = np.sqrt(np.where(checked, fault_free_r, 1.0)) * sigma
    covariance = np.diag(sigma**2) - a @ np.linalg.inv(fault_free_normal) @ a.T
    twins = (covariance / np.outer(standard, standard)) ** 2 > 1 - 1e-9
    twins = (twins & np.outer(checked, checked)) | np.eye(n, dtype=bool)
    if cofactor != "fault_free":
        twins &= np.abs(fault_free_r[:, None] - fault_free_r[None]) < 1e-9

    accelerated = acceleration == "aitken" if acceleration else iterations is None
    states, number, settled = [now.x], -{"ls": 0, "huber": 5}[start], False
    iterations = iterations or ITERATIONS
    for one_weight in [huber_weight] * {"ls": 0, "huber": 5}[start] + [weight] * iterations:
        number += 1
        if settled and number < iterations:
            continue
        if cofactor == "none":
            sigma_v, standardised = sigma, np.ones(n, dtype=bool)
        else:
            r = fault_free_r.copy()
            if cofactor == "reweighted":
                p_bar = p @ np.diag(now.w)
                reweighted = np.diag(np.eye(n) - a @ np.linalg.inv(a.T @ p_bar @ a) @ a.T @ p)
                positive = reweighted > 1e-10
                r[positive] = reweighted[positive]
            sigma_v, standardised = sigma * np.sqrt(np.where(checked, r, 1.0)), checked
        u = np.where(standardised, np.abs(now.v) / sigma_v, 0.0)
        u = u / the_scale(scale, now, p, n - t, u[standardised])
        w = np.array([max(one_weight(value), weight_floor) for value in u])
        # Satellites that no residual tells apart weigh the same; so they do but for rounding, which would decide.
        w = np.array([np.mean(w[same]) for same in twins])

        p_bar = p @ np.diag(w)
        normal = a.T @ p_bar @ a
        if np.sum(w > 0) < t + 1 or not pivots_suffice(normal, fault_free_pivots):
            return Solution(available=False)
        x = np.linalg.solve(normal, a.T @ p_bar @ observed)
        step, step_before = x - states[-1], states[-1] - (states[-2] if len(states) > 1 else states[-1])
        states.append(x)
        settled = settled or (accelerated and number == FROM - 1 and step @ fault_free_normal @ step <= SETTLED**2)
        if accelerated and not settled and FROM <= number < iterations and (number - FROM) % EVERY == 0:
            # Aitken: along the last step to where steps would lead that shrink as the last two did.
            shared, length, length_before = (
                step @ fault_free_normal @ step_before,
                *(np.sqrt(one @ fault_free_normal @ one) for one in (step, step_before)),
            )
            if length > SMALLEST:
                ratio = np.clip(shared / length_before**2, 0, RATIO)
                x = x + min(length / SMALLEST - 1, 1) * min(ratio / (1 - ratio), REACH / length) * step
            states[-1] = x
        now = Solution(available=True, x=x, v=a @ x - observed, w=w)

    dof = {"all": n, "kept": np.sum(now.w > 0), "weights": np.sum(now.w)}[redundancy] - t
    if dof <= 0:
        return Solution(available=False)
    p_bar = p @ np.diag(now.w)
    now.m = np.sqrt(now.v @ p_bar @ now.v / dof)
    now.change_m = np.abs(states[-1] - states[-2])[:3].max()
    now.tied = bool(np.any((twins.sum(axis=1) > 1) & (now.w < 1)))
    now.q = np.diag(np.linalg.inv(a.T @ p_bar @ a))[:3]
    return now


def the_scale(scale: str, now: Solution, p: np.ndarray, dof: int, u: np.ndarray) -> float:
    """What a residual's standard deviation is multiplied by; ``u`` are the residuals in units of it."""
    if scale == "apriori":
        return 1.0
    if scale in ("posterior", "posterior_floored"):
        value = np.sqrt(now.v @ p @ np.diag(now.w) @ now.v / dof)
    else:
        value = 1.482602218505602 * np.median(u)
    if scale in ("posterior_floored", "mad_floored"):
        value = max(1.0, value)
    return value if value > 0 else 1.0


def pivots_suffice(normal: np.ndarray, fault_free_pivots: np.ndarray) -> bool:
    """Whether every Cholesky pivot reaches 1e-10 of the fault-free one."""
    try:
        pivots = np.diag(np.linalg.cholesky(normal)) ** 2
    except np.linalg.LinAlgError:
        return False
    return bool(np.all(pivots >= 1e-10 * fault_free_pivots))
