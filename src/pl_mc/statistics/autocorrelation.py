"""How many independent epochs a series of correlated ones is worth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.input_errors import InputError, require_one_shape


@ordinary_arithmetic
def effective_number(values: ArrayLike, places: ArrayLike | None = None) -> float:
    """Number of independent values whose mean would scatter as much as that of a correlated series.

    n / tau with the integrated autocorrelation time tau = 1 + 2 sum of rho_k over lags k, summed in pairs of lags up to
    the first pair that is not positive and no larger than the one before (the initial monotone sequence of Geyer 1992,
    Statistical Science 7:473-483), which keeps noise of far lags out. Where events are a threshold that the series
    crosses, they are correlated for less long than the series itself (for a Gaussian one: of each rho_k no more than
    rho_k), so that bounds of their rate with this number are wide enough. What lasts as long as the series, such as an
    offset of a whole day, does not show in it.

    Args:
        values: (k,), the series; NaN where it is missing.
        places: (k,), place of each value on a regular grid, whole numbers that increase; 0, 1, 2... unless given.

    Returns:
        From 1 to the number of values that are there; 0 where there is none.

    Raises:
        InputError: places that do not increase.
    """
    if places is None:
        places = np.arange(np.size(values))
    series, at = require_one_shape(values=values, places=places)
    if series.ndim != 1 or (np.diff(at) <= 0).any() or (at != np.floor(at)).any():
        raise InputError("places: whole numbers that increase are needed, one for each value of a series.")
    there = np.isfinite(series)
    count = int(there.sum())
    if count < 2:
        return float(count)
    deviation = series[there] - series[there].mean()
    if not np.ptp(series[there]) > 0:
        return 1.0
    return float(np.clip(count / _correlation_time(deviation, at[there] - at[there][0]), 1.0, count))


def _correlation_time(deviation: NDArray[np.float64], at: NDArray[np.float64]) -> float:
    """Integrated autocorrelation time, in steps of the grid, as far as values follow each other on it."""
    # Where steps are missing everywhere, those that are there are one after the other.
    place = (at if at[-1] < 64 * at.size else np.arange(at.size)).astype(np.int64)
    length = int(place[-1]) + 1
    size = 1 << int(2 * length - 1).bit_length()
    value = np.zeros(size)
    value[place] = deviation
    products = np.fft.irfft(np.abs(np.fft.rfft(value)) ** 2, size)[:length]
    # Not divided by the number of pairs: a lag counts in the mean's variance by how many pairs have it.
    rho = products / products[0]
    even = rho[: 2 * (length // 2)].reshape(-1, 2).sum(axis=1)
    positive = int(np.argmax(even <= 0)) if (even <= 0).any() else even.size
    return max(1.0, 2.0 * float(np.minimum.accumulate(even[:positive]).sum()) - 1.0)
