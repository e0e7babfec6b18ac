"""Time: dates to GPS seconds, and the angle by which the Earth has turned.

Nominal orbits need no leap seconds: both their reference epochs and the epochs of a simulation count in GPS time,
and the Earth is turned by GPS time where UT1 belongs. The difference, under 20 s, turns the whole sky by less than
0.08 degrees, alike at all epochs, while nominal satellites stand tens of degrees from the real ones anyway.
"""

from __future__ import annotations

from datetime import date as Day
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.input_errors import InputError, shown

if TYPE_CHECKING:
    import pandas as pd

GPS_EPOCH = datetime(1980, 1, 6)

_GPS_EPOCH_JULIAN_DATE = 2_444_244.5
_J2000_JULIAN_DATE = 2_451_545.0
_DAYS_PER_CENTURY = 36_525.0
_SECONDS_PER_DAY = 86_400.0


def gps_seconds(date: str | Day | np.datetime64, *, field: str = "start") -> float:
    """Seconds since 1980-01-06 00:00:00 of a date in GPS time [s].

    Args:
        date: ISO 8601 text, ``2017-11-21T00:00:00`` or ``2017-11-21``, or a date of Python, NumPy or pandas; no
            time zone.
        field: name of the option, for the sentence of an error.

    Raises:
        InputError: no such date, a time zone (GPS time has none), or a date before GPS time began.
    """
    try:
        if isinstance(date, np.datetime64) or hasattr(date, "nanosecond"):
            import pandas as pd

            # Dates of NumPy and pandas have nanoseconds, which Python's have not.
            moment = pd.Timestamp(date).round("us").to_pydatetime()
        else:
            moment = date if isinstance(date, datetime) else datetime.fromisoformat(_iso(date))
        if not isinstance(moment, datetime):
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{field}: {shown(date)} is not a date; GPS time is written as in 2017-11-21T00:00:00."
        ) from None
    if moment.tzinfo is not None:
        bare = moment.replace(tzinfo=None).isoformat()
        raise InputError(f"{field}: {shown(date)} has a time zone; it is GPS time, which has none: {bare}.")
    if moment < GPS_EPOCH:
        raise InputError(f"{field}: {shown(date)} is before GPS time began; the first is {GPS_EPOCH.isoformat()}.")
    return (moment - GPS_EPOCH).total_seconds()


def _iso(date: object) -> str:
    """The text of a day or of a word; whatever else is no date."""
    return date.isoformat() if isinstance(date, Day) else date if isinstance(date, str) else ""


def gps_dates(time_gps_s: ArrayLike) -> pd.DatetimeIndex:
    """Dates in GPS time of seconds since 1980-01-06 (...,) [s]; missing where there is no number."""
    import pandas as pd

    return pd.DatetimeIndex(pd.Timestamp(GPS_EPOCH) + pd.to_timedelta(np.asarray(time_gps_s, float), unit="s"))


def gmst_rad(time_gps_s: ArrayLike) -> NDArray[np.float64]:
    """Greenwich mean sidereal time, not reduced to one turn [rad].

    The polynomial of IAU 1982 (Aoki et al. 1982, Astronomy and Astrophysics 105, 359-361), in the form that takes
    the whole of UT1: 67310.54841 + (876600 * 3600 + 8640184.812866) T + 0.093104 T^2 - 6.2e-6 T^3 seconds of time,
    T in Julian centuries of UT1 since J2000. GPS time stands for UT1, see the head of this file.

    Args:
        time_gps_s: seconds since 1980-01-06 in GPS time (...) [s].
    """
    days = np.asarray(time_gps_s, dtype=float) / _SECONDS_PER_DAY + (_GPS_EPOCH_JULIAN_DATE - _J2000_JULIAN_DATE)
    t = days / _DAYS_PER_CENTURY
    seconds = 67_310.54841 + (876_600.0 * 3_600.0 + 8_640_184.812866 + (0.093104 - 6.2e-6 * t) * t) * t
    return seconds * (2 * np.pi / _SECONDS_PER_DAY)
