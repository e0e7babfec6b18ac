"""The course of errors and levels in time, few enough rows for the interactive chart of the page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pl_mc.report.document import Chart, Quantity
from pl_mc.report.figures import short_label
from pl_mc.report.findings import Table
from pl_mc.studies.observe.figures import longest_step

# Parts of the time: about one for each point that a page is wide.
_MOST_PARTS = 240

# Units of the time axis, by the shortest span that they are used for [s].
_UNITS = (("h", 3600.0), ("min", 60.0), ("s", 1.0))
_LEAST_UNITS = 3.0

_AXES = ("vertical", "horizontal")
_BOUNDS = {"": "median", "_low": "min", "_high": "max"}


def course_table(table: pd.DataFrame) -> Table:
    """Errors and levels of each method in equal parts of the time: the median, the smallest and the largest.

    A part has the errors of the epochs at which the method is available. ``table`` is that of the epochs.
    """
    since_s = (table.time - table.time.min()) / pd.Timedelta(seconds=1)
    step_s = longest_step(table) / pd.Timedelta(seconds=1)
    unit, unit_s = next(((u, s) for u, s in _UNITS if since_s.max() >= _LEAST_UNITS * s), _UNITS[-1])
    times_s = np.unique(since_s)
    # Where there are few epochs each is a part.
    width_s = (times_s[-1] / _MOST_PARTS) if times_s.size > _MOST_PARTS else 0.0
    start_s = since_s if width_s == 0.0 else (since_s // width_s).clip(upper=_MOST_PARTS - 1) * width_s
    sizes = {
        "error": (table.up_m.abs(), np.hypot(table.east_m, table.north_m)),
        "level": (table.vpl_m, table.hpl_m),
    }  # fmt: skip
    found = []
    for name in dict.fromkeys(table.method):
        for what, values in sizes.items():
            mine = (table.method == name) & table.available
            numbers = pd.DataFrame(dict(zip(_AXES, values, strict=True))).replace([np.inf, -np.inf], np.nan)[mine]
            parts = numbers.groupby(start_s[mine])
            made = {f"{axis}{end}_m": parts[axis].agg(of) for axis in _AXES for end, of in _BOUNDS.items()}
            middle = pd.DataFrame({"time": (parts.size().index + 0.5 * width_s) / unit_s, "epochs": parts.size()})
            found.append(middle.assign(curve=f"{short_label(str(name))}, {what}", **made).reset_index(drop=True))
    rows = pd.concat(found, ignore_index=True)
    columns = ["curve", "time", "epochs", *(f"{axis}{end}_m" for axis in _AXES for end in _BOUNDS)]
    spread = ", median and range" if width_s else ""
    each = f"{_MOST_PARTS} equal parts of the time" if width_s else "each epoch"
    chart = Chart(
        f"Errors and levels in time, {each}", ("curve",),
        tuple(
            Quantity(
                f"{axis}{spread} [m]", f"{axis}_m", f"{axis}_low_m", f"{axis}_high_m", is_rate=False,
                bounds="smallest to largest",
            )
            for axis in _AXES
        ),
        x="time", x_label=f"time since {table.time.min():%Y-%m-%d %H:%M:%S} [{unit}]",
        gap=max(1.5 * width_s, step_s) / unit_s,
    )  # fmt: skip
    return Table("course", rows[columns], chart=chart)
