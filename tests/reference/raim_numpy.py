"""Classical RAIM, slow and plain: every set of satellites is solved anew, nothing is updated from another solution.

The oracle of the methods `slope`, `max_dop`, `parity`, `w_test`, `leave_one_out`, `range_comparison`, `nioraim` and
`sbas`. Everything is for one scenario.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, stats


@dataclass(frozen=True)
class Fit:
    """Weighted least squares of some satellites; all vectors over satellites are those of the fit."""

    rows: np.ndarray
    state: np.ndarray
    residuals: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    redundancy_matrix: np.ndarray

    @property
    def error(self) -> np.ndarray:
        return self.state[:3]

    @property
    def square_sum(self) -> float:
        return float(self.residuals @ self.residuals)

    @property
    def dof(self) -> int:
        return len(self.rows) - len(self.covariance)

    @property
    def redundancy(self) -> np.ndarray:
        return np.diag(self.redundancy_matrix)


def fit(design, sigma, observed, rows) -> Fit:
    """Least squares of ``rows``, without the clocks that they do not observe; None where it is not determined."""
    rows = np.asarray(rows)
    a = design[rows] / sigma[rows, None]
    a = a[:, [k < 3 or a[:, k].any() for k in range(a.shape[1])]]
    if np.linalg.matrix_rank(a) < a.shape[1]:
        return None
    gain = np.linalg.pinv(a)
    z = observed[rows] / sigma[rows]
    covariance = np.linalg.inv(a.T @ a)
    return Fit(rows, gain @ z, z - a @ gain @ z, covariance, gain, np.eye(len(rows)) - a @ gain)


def slopes(design, sigma, rows) -> tuple[float, float]:
    """Largest horizontal and vertical error per sqrt(V'PV), of a bias on each satellite in turn and no noise."""
    largest = np.zeros(2)
    for i in rows:
        observed = np.zeros(len(sigma))
        observed[i] = sigma[i]
        found = fit(design, sigma, observed, rows)
        effects = np.array([np.hypot(*found.error[:2]), abs(found.error[2])])
        if found.square_sum < 1e-18:
            effects = np.where(effects > 1e-9, np.inf, 0.0)
        else:
            effects = effects / np.sqrt(found.square_sum)
        largest = np.maximum(largest, effects)
    return float(largest[0]), float(largest[1])


def size(form, dof, p_fa, p_md) -> float:
    """Protected size of a fault, by SciPy's own noncentral chi-square."""
    limit = stats.chi2.isf(p_fa, dof)
    if form.startswith("arp"):
        return float(np.sqrt(limit))
    if form == "line":
        return float(np.sqrt(limit) + stats.norm.isf(p_md))
    return float(np.sqrt(optimize.brentq(lambda x: stats.ncx2.cdf(limit, dof, x) - p_md, 1e-6, 2000.0)))


def major(covariance) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))


def slope_levels(design, sigma, rows, form, p_fa, p_md) -> tuple[float, float]:
    whole = fit(design, sigma, np.zeros(len(sigma)), rows)
    levels = np.array(slopes(design, sigma, rows)) * size(form, whole.dof, p_fa, p_md)
    if form.endswith("noise"):
        levels[0] += stats.rayleigh.isf(p_md) * major(whole.covariance)
        levels[1] += stats.norm.isf(p_md / 2) * np.sqrt(whole.covariance[2, 2])
    return tuple(levels)


def sigma_levels(covariance, k_horizontal, k_vertical) -> tuple[float, float]:
    return k_horizontal * major(covariance), k_vertical * float(np.sqrt(covariance[2, 2]))


def subset_dops(design, sigma, rows) -> np.ndarray:
    """(1 + n, 2), HDOP and VDOP of all satellites and without each; infinite where undetermined."""
    dops = []
    for left_out in (None, *rows):
        found = fit(design, sigma, np.zeros(len(sigma)), [k for k in rows if k != left_out])
        variances = np.full(3, np.inf) if found is None else np.diag(found.covariance)
        dops.append([np.sqrt(variances[0] + variances[1]), np.sqrt(variances[2])])
    return np.array(dops)


def leave_one_out(design, sigma, observed, rows, p_fa) -> tuple[Fit, bool]:
    """The solution in use, and whether there is an alarm."""
    whole = fit(design, sigma, observed, rows)
    if whole.square_sum <= stats.chi2.isf(p_fa, whole.dof):
        return whole, False
    sets = [fit(design, sigma, observed, [k for k in rows if k != i]) for i in rows]
    sets = [found for found in sets if found is not None and 1 <= found.dof < whole.dof]
    if not sets:
        return whole, True
    best, second = sorted(sets, key=lambda found: found.square_sum)[:2]
    # Equal reductions of the square sum: faults that look the same.
    reductions = [whole.square_sum - found.square_sum for found in (best, second)]
    if reductions[0] - reductions[1] <= 2e-7 * reductions[0]:
        return whole, True
    passed = best.square_sum <= stats.chi2.isf(p_fa, best.dof)
    return (best, False) if passed else (whole, True)


def parity_square_sum(design, sigma, observed, rows) -> float:
    """|p|^2 with the parity transformation from the null space of A'."""
    a = design[rows] / sigma[rows, None]
    transformation = linalg.null_space(a.T).T
    parity = transformation @ (observed[rows] / sigma[rows])
    return float(parity @ parity)


def w_test(design, sigma, observed, rows, alpha, exclusions, p_fa) -> tuple[Fit, bool, bool]:
    """The last solution, and what the local and the global test say of it."""
    critical = stats.norm.isf(alpha / 2)
    rows = list(rows)
    while True:
        found = fit(design, sigma, observed, rows)
        checked = found.redundancy > 1e-10
        w = np.where(checked, np.abs(found.residuals) / np.sqrt(np.where(checked, found.redundancy, 1)), 0)
        alike = np.sum(w >= w.max() * (1 - 1e-7)) > 1
        if w.max() <= critical or alike or exclusions == 0 or found.dof < 2:
            break
        rows.remove(found.rows[w.argmax()])
        exclusions -= 1
    return found, bool(w.max() > critical), bool(found.square_sum > stats.chi2.isf(p_fa, found.dof))


def range_comparison(design, sigma, observed, rows, p_fa, p_md, base) -> tuple[bool, float, float]:
    """Whether it rejects, and its levels: predictions from solutions that do not have the satellite."""
    rows = list(rows)
    whole = fit(design, sigma, observed, rows)
    redundant, kept = [], list(rows)
    while base == "minimal":
        left = fit(design, sigma, observed, kept)
        if left.dof == 0:
            break
        worst = kept[int(left.redundancy.argmax())]
        redundant.append(worst)
        kept.remove(worst)
    if base == "others":
        redundant = [i for i, r in zip(rows, whole.redundancy, strict=True) if r > 1e-10]
    threshold = stats.norm.isf(p_fa / (2 * len(redundant)))

    def comparisons(seen) -> np.ndarray:
        values = []
        for i in redundant:
            used = kept if base == "minimal" else [k for k in rows if k != i]
            left = fit(design, sigma, seen, used)
            columns = [k < 3 or (design[used, k] != 0).any() for k in range(design.shape[1])]
            line = design[i, columns] / sigma[i]
            spread = np.sqrt(1 + line @ left.covariance @ line)
            values.append((seen[i] / sigma[i] - line @ left.state) / spread)
        return np.abs(values)

    levels = np.zeros(2)
    for i in rows:
        bias = np.zeros(len(sigma))
        bias[i] = sigma[i]
        error, seen = fit(design, sigma, bias, rows).error, comparisons(bias).max()
        effects = np.array([np.hypot(*error[:2]), abs(error[2])])
        if seen < 1e-9:
            effects = np.where(effects > 1e-9, np.inf, 0.0)
        else:
            effects = effects * (threshold + stats.norm.isf(p_md)) / seen
        levels = np.maximum(levels, effects)
    return bool(comparisons(observed).max() > threshold), float(levels[0]), float(levels[1])


def least_slope(design, sigma, rows, coordinate) -> float:
    """min max |s_i| / sqrt(r_i) over all unbiased s of one coordinate, by linear programming."""
    whole = fit(design, sigma, np.zeros(len(sigma)), rows)
    a = design[rows] / sigma[rows, None]
    a = a[:, [k < 3 or a[:, k].any() for k in range(a.shape[1])]]
    n, t = a.shape
    root = np.sqrt(np.clip(whole.redundancy, 0, 1))
    # Unknowns: s and the bound; |s_i| <= bound root_i and s A = e.
    above = np.hstack([np.eye(n), -root[:, None]])
    below = np.hstack([-np.eye(n), -root[:, None]])
    found = optimize.linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.vstack([above, below]),
        b_ub=np.zeros(2 * n),
        A_eq=np.hstack([a.T, np.zeros((t, 1))]),
        b_eq=np.eye(t)[coordinate],
        bounds=[(None, None)] * n + [(0, None)],
    )
    return float(found.x[-1])
