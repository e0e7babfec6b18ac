"""IONEX files of a known content, written by the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np


def ionex(
    folder: Path, content_tecu: Callable[[int, float, float], float], days: tuple[str, ...], name: str = "a.20i", *,
    exponent: int = -1, east: tuple[float, float] = (-180.0, 180.0), north: tuple[float, float] = (87.5, -87.5),
    layer_km: float = 450.0, radius_km: float = 6371.0, mapping: str = "COSZ",
) -> Path:  # fmt: skip
    """Maps of a content by number, latitude and longitude [deg], NaN where it is missing, in one layer."""
    step = np.copysign(2.5, north[1] - north[0])
    longitudes = np.arange(east[0], east[1] + 0.1, 5.0)

    def line(body: str, label: str) -> str:
        return f"{body:<60}{label}"

    def date(text: str) -> str:
        return "".join(f"{int(part):6d}" for part in text.split())

    lines = [
        line("     1.0            IONOSPHERE MAPS     GPS", "IONEX VERSION / TYPE"),
        line("made", "PGM / RUN BY / DATE"),
        line(date(days[0]), "EPOCH OF FIRST MAP"), line(date(days[-1]), "EPOCH OF LAST MAP"),
        line(f"{43200:6d}", "INTERVAL"), line(f"{len(days):6d}", "# OF MAPS IN FILE"),
        line(f"  {mapping}", "MAPPING FUNCTION"),
        line(f"{0.0:8.1f}", "ELEVATION CUTOFF"), line("", "OBSERVABLES USED"), line(f"{radius_km:8.1f}", "BASE RADIUS"),
        line(f"{2:6d}", "MAP DIMENSION"), line(f"  {layer_km:6.1f}{layer_km:6.1f}{0.0:6.1f}", "HGT1 / HGT2 / DHGT"),
        line(f"  {north[0]:6.1f}{north[1]:6.1f}{step:6.1f}", "LAT1 / LAT2 / DLAT"),
        line(f"  {east[0]:6.1f}{east[1]:6.1f}{5.0:6.1f}", "LON1 / LON2 / DLON"), line(f"{exponent:6d}", "EXPONENT"),
        line("", "END OF HEADER"),
    ]  # fmt: skip
    for k, day in enumerate(days):
        lines += [line(f"{k + 1:6d}", "START OF TEC MAP"), line(date(day), "EPOCH OF CURRENT MAP")]
        for latitude in np.arange(north[0], north[1] + step / 25, step):
            head = f"  {latitude:6.1f}{east[0]:6.1f}{east[1]:6.1f}{5.0:6.1f}{layer_km:6.1f}"
            lines.append(line(head, "LAT/LON1/LON2/DLON/H"))
            values = [content_tecu(k, latitude, longitude) for longitude in longitudes]
            row = [9999 if np.isnan(value) else round(value * 10.0**-exponent) for value in values]
            lines += ["".join(f"{one:5d}" for one in row[at : at + 16]) for at in range(0, len(row), 16)]
        lines.append(line(f"{k + 1:6d}", "END OF TEC MAP"))
    path = folder / name
    path.write_text("\n".join([*lines, line("", "END OF FILE")]) + "\n")
    return path
