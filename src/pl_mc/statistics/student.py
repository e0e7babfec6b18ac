"""Quantiles and tails that the residuals of least squares obey without a fault.

A protection level that multiplies the a-posteriori unit-weight error m by a normal quantile does not keep the risk
of that quantile: error over m VDOP is Student, not normal. These functions give the risk it really has, the factor
that would keep it, and the threshold of the chi-square test.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.constants import K_VERTICAL
from pl_mc.input_errors import require_fraction, require_numbers, require_positive, require_true


@ordinary_arithmetic
def fault_free_exceeded(dof: ArrayLike, k_vertical: float = K_VERTICAL) -> NDArray[np.float64]:
    """Fault-free P(|vertical error| > VPL) of least squares, 2 T_dof(-k), alarm or not.

    From Zhao et al. 2021, eqs 15-16: the vertical error over VDOP is standard normal, V'PV is chi-square and
    independent of it, so error / (m VDOP) is Student with n - t degrees of freedom. With 15 of them and k = 5.33
    this is 8.4e-5, where the normal distribution would give 1e-7.

    Args:
        dof: (...), degrees of freedom n - t, at least 1.
        k_vertical: factor of the protection level, positive.

    Returns:
        (...), probabilities.
    """
    return np.asarray(2.0 * special.stdtr(_require_dof(dof), -require_positive(k_vertical, field="k_vertical")))


@ordinary_arithmetic
def student_factor(dof: ArrayLike, risk: float = 1e-7) -> NDArray[np.float64]:
    """The factor of m VDOP that a fault-free vertical error exceeds with probability ``risk``, both signs together.

    Args:
        dof: (...), degrees of freedom n - t, at least 1.
        risk: probability, between 0 and 1.

    Returns:
        (...), factors; they tend to the normal quantile (5.3267 for 1e-7) as ``dof`` grows.
    """
    return np.asarray(-special.stdtrit(_require_dof(dof), require_fraction(risk, field="risk") / 2.0))


@ordinary_arithmetic
def chi2_threshold(dof: ArrayLike, p_fa: float = 1e-3) -> NDArray[np.float64]:
    """The value that a fault-free V'PV exceeds with probability ``p_fa``: central chi-square, (...), unitless.

    Args:
        dof: (...), degrees of freedom n - t, at least 1.
        p_fa: probability of a false alarm, between 0 and 1.
    """
    return np.asarray(special.chdtri(_require_dof(dof), require_fraction(p_fa, field="p_fa")))


def _require_dof(dof: ArrayLike) -> NDArray[np.float64]:
    value = require_numbers(dof, field="dof")
    rule = "at least one degree of freedom is needed, and a finite number of them"
    require_true(np.isfinite(value) & (value >= 1.0), field="dof", rule=rule, of=value)
    return value
