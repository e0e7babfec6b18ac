"""The inter-system mean check, slowly and literally: one mean-shift fit by ``numpy.linalg`` for each satellite.

Guo et al. 2022, eqs 9-13 and 16-22. Nothing is shared with the kernel but the definitions of the readings.
"""

from __future__ import annotations

import numpy as np


def mean_check(
    design: np.ndarray,
    sigma_m: np.ndarray,
    observed_m: np.ndarray,
    systems: str,
    *,
    reading: str,
    keep: bool,
    variances_m2: tuple[float, float] = (2.5, 4.5),
) -> tuple[float, int, float]:
    """The largest T, the place of its satellite and the estimated shift [m]; GPS first, BeiDou second.

    Args:
        design: (n, 5), position, GPS clock, BeiDou clock; sigma_m, observed_m: (n,); systems: n letters G and C.
        reading: ``shift_kept``, ``shared_clock``, ``separate_fits`` or ``weighted``.
        keep: whether the shift stays in the residual of its satellite.
    """
    letters = np.array(list(systems))
    gps, bds = letters == "G", letters == "C"
    if reading == "shared_clock":
        design = np.hstack([design[:, :3], np.ones((len(design), 1))])
    if reading == "separate_fits":
        design = np.hstack([np.hstack([design[:, :3], np.ones((len(design), 1))]) * m[:, None] for m in (gps, bds)])
    root = 1.0 / sigma_m
    spread = np.sqrt(variances_m2[0] / gps.sum() + variances_m2[1] / bds.sum())
    found = []
    for i in range(len(design)):
        unit = np.zeros((len(design), 1))
        unit[i] = 1.0
        extended = np.hstack([design, unit])
        solution = np.linalg.lstsq(extended * root[:, None], observed_m * root, rcond=None)[0]
        state, shift = solution[:-1], solution[-1]
        residual = design @ state - observed_m
        if not keep:
            residual = residual + unit[:, 0] * shift
        found.append((abs(residual[bds].mean() - residual[gps].mean()) / spread, shift))
    largest = int(np.argmax([t for t, _ in found]))
    return found[largest][0], largest, found[largest][1]
