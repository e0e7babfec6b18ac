"""IONEX files of one content everywhere, written by the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np


def ionex(folder: Path, content_tecu: Callable[[int], float], days: tuple[str, ...], name: str = "a.20i") -> Path:
    """Maps of one content everywhere, half a day apart, in a layer at 450 km with the mapping 1 / cos z."""

    def line(body: str, label: str) -> str:
        return f"{body:<60}{label}"

    def date(text: str) -> str:
        return "".join(f"{int(part):6d}" for part in text.split())

    lines = [
        line("     1.0            IONOSPHERE MAPS     GPS", "IONEX VERSION / TYPE"),
        line("made", "PGM / RUN BY / DATE"),
        line(date(days[0]), "EPOCH OF FIRST MAP"), line(date(days[-1]), "EPOCH OF LAST MAP"),
        line(f"{43200:6d}", "INTERVAL"), line(f"{len(days):6d}", "# OF MAPS IN FILE"),
        line("  COSZ", "MAPPING FUNCTION"),
        line(f"{0.0:8.1f}", "ELEVATION CUTOFF"), line("", "OBSERVABLES USED"), line(f"{6371.0:8.1f}", "BASE RADIUS"),
        line(f"{2:6d}", "MAP DIMENSION"), line(f"  {450.0:6.1f}{450.0:6.1f}{0.0:6.1f}", "HGT1 / HGT2 / DHGT"),
        line(f"  {87.5:6.1f}{-87.5:6.1f}{-2.5:6.1f}", "LAT1 / LAT2 / DLAT"),
        line(f"  {-180.0:6.1f}{180.0:6.1f}{5.0:6.1f}", "LON1 / LON2 / DLON"), line(f"{-1:6d}", "EXPONENT"),
        line("", "END OF HEADER"),
    ]  # fmt: skip
    for k, day in enumerate(days):
        lines += [line(f"{k + 1:6d}", "START OF TEC MAP"), line(date(day), "EPOCH OF CURRENT MAP")]
        for latitude in np.arange(87.5, -87.6, -2.5):
            lines.append(
                line(f"  {latitude:6.1f}{-180.0:6.1f}{180.0:6.1f}{5.0:6.1f}{450.0:6.1f}", "LAT/LON1/LON2/DLON/H")
            )
            row = [round(10 * content_tecu(k))] * 73
            lines += ["".join(f"{one:5d}" for one in row[at : at + 16]) for at in range(0, 73, 16)]
        lines.append(line(f"{k + 1:6d}", "END OF TEC MAP"))
    path = folder / name
    path.write_text("\n".join([*lines, line("", "END OF FILE")]) + "\n")
    return path
