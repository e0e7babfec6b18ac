"""How many independent epochs a series of correlated ones is worth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.input_errors import InputError, require_list, require_one_shape


@ordinary_arithmetic
def effective_number(values: ArrayLike, places: ArrayLike | None = None, series: ArrayLike | None = None) -> float:
    """Number of independent values whose mean would scatter as much as that of correlated ones.

    n / tau with the integrated autocorrelation time tau = 1 + 2 sum of rho_k over lags k, summed in pairs of lags up to
    the first pair that is not positive and no larger than the one before (the initial monotone sequence of Geyer 1992,
    Statistical Science 7:473-483), which keeps noise of far lags out. Where events are a threshold that the series
    crosses, they are correlated for less long than the series itself (for a Gaussian one: of each rho_k no more than
    rho_k), so that bounds of their rate with this number are wide enough. What lasts as long as the series, such as an
    offset of a whole day, does not show in it; where there are several, what one of them keeps to itself does.

    Args:
        values: (k,), the values; NaN where one is missing.
        places: (k,), place of each on a regular grid, whole numbers that increase within a series; 0, 1, 2... unless
            given.
        series: (k,), which series each belongs to, such as its satellite; all to one unless given. Values of different
            series are taken as independent, with one mean and one correlation in common.

    Returns:
        From 1 to the number of values that are there; 0 where there is none.

    Raises:
        InputError: places that do not increase.
    """
    if places is None:
        places = np.arange(np.size(values))
    given, at = require_one_shape(values=values, places=places)
    group = np.zeros(given.size, dtype=np.int64) if series is None else names_of(series, field="series")
    if given.ndim != 1 or group.shape != given.shape:
        raise InputError("places, series: one for each value of a list is needed.")
    if not np.isfinite(at).all() or (np.abs(at) > 2**53).any():
        raise InputError("places: whole numbers are needed, one for each value.")
    order = np.lexsort((np.arange(at.size) if series is None else at, group))
    given, at, group = given[order], at[order], group[order]
    if ((np.diff(at) <= 0) & (np.diff(group) == 0)).any() or (at != np.floor(at)).any():
        raise InputError("places: whole numbers that increase within each series are needed.")
    there = np.isfinite(given)
    given, at, group = given[there], at[there], group[there]
    if given.size < 2:
        return float(given.size)
    deviation = given - given.mean()
    if not np.ptp(given) > 0:
        return 1.0
    parts = np.split(np.arange(given.size), np.flatnonzero(np.diff(group)) + 1)
    products = np.zeros(max(_length(at[part]) for part in parts))
    for part in parts:
        of_one = _products(deviation[part], at[part] - at[part][0])
        products[: of_one.size] += of_one
    return float(np.clip(given.size / _correlation_time(products / products[0]), 1.0, given.size))


def names_of(values: ArrayLike, *, field: str) -> NDArray[np.int64]:
    """(k,), a number for each different name; an `InputError` where they are none."""
    try:
        texts = [str(one) for one in require_list(values, field=field, of="names")]  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{field}: a sequence of names is needed.") from None
    return np.unique(np.array(texts, dtype=object).astype(str), return_inverse=True)[1] if texts else np.zeros(0, int)


def places_in_time(time_gps_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """(k,), places of times on the grid of their usual step, equal ones in one place."""
    times, inverse = np.unique(time_gps_s, return_inverse=True)
    if times.size < 2:
        return np.zeros(inverse.size, dtype=np.int64)
    steps = np.diff(times)
    return np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / np.median(steps)), 1.0))]).astype(np.int64)[
        inverse
    ]


def _length(at: NDArray[np.float64]) -> int:
    """Steps that a series spans; where nearly all are missing, as many as it has values."""
    span = int(at[-1] - at[0]) + 1
    return span if span <= 64 * at.size else at.size


def _products(deviation: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of products by lag; not divided by their number: by it a lag counts in the variance of the mean."""
    length = _length(at)
    value = np.zeros(1 << int(2 * length - 1).bit_length())
    value[at.astype(np.int64) if length == int(at[-1]) + 1 else np.arange(at.size)] = deviation
    return np.fft.irfft(np.abs(np.fft.rfft(value)) ** 2, value.size)[:length]


def _correlation_time(rho: NDArray[np.float64]) -> float:
    """Integrated autocorrelation time, in steps of the grid."""
    even = rho[: 2 * (rho.size // 2)].reshape(-1, 2).sum(axis=1)
    positive = int(np.argmax(even <= 0)) if (even <= 0).any() else even.size
    return max(1.0, 2.0 * float(np.minimum.accumulate(even[:positive]).sum()) - 1.0)
