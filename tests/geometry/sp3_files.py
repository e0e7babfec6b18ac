"""SP3 files of exact Kepler orbits, written by the tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike, NDArray

START = datetime(2024, 3, 20)
START_GPS_S = (START - datetime(1980, 1, 6)).total_seconds()
TURN_RAD_S = 7.2921151467e-5
GM_M3_S2 = 3.986005e14


@dataclass(frozen=True)
class Orbit:
    """An ellipse that stands still in inertial axes, those of the Earth at `START_GPS_S`; angles in rad."""

    axis_m: float
    eccentricity: float
    inclination: float
    node: float
    perigee: float
    mean: float

    def position_m(self, time_gps_s: ArrayLike) -> NDArray[np.float64]:
        """Earth-fixed (e, 3) at the times [m]."""
        t = np.asarray(time_gps_s, dtype=float) - START_GPS_S
        mean = self.mean + np.sqrt(GM_M3_S2 / self.axis_m**3) * t
        e, anomaly = self.eccentricity, mean
        for _ in range(60):
            anomaly = mean + e * np.sin(anomaly)
        along = self.axis_m * (np.cos(anomaly) - e)
        across = self.axis_m * np.sqrt(1 - e * e) * np.sin(anomaly)
        u = along * np.cos(self.perigee) - across * np.sin(self.perigee)
        v = along * np.sin(self.perigee) + across * np.cos(self.perigee)
        node = self.node - TURN_RAD_S * t
        return np.stack(
            [
                u * np.cos(node) - v * np.cos(self.inclination) * np.sin(node),
                u * np.sin(node) + v * np.cos(self.inclination) * np.cos(node),
                v * np.sin(self.inclination),
            ],
            axis=-1,
        )


def constellation(gps: int = 12, galileo: int = 6) -> dict[str, Orbit]:
    """Satellites of all kinds, two of Galileo in eccentric orbits; names are in the order of a file."""
    medium, synchronous = np.radians(55.0), 42_164e3
    orbits = {
        f"G{k + 1:02d}": Orbit(26_560e3, 0.002 * (k % 8), medium, np.pi / 3 * k, 0.7 * k, 2.1 * k) for k in range(gps)
    }
    orbits |= {
        f"E{k + 1:02d}": Orbit(29_600e3, 0.16 if k < 2 else 1e-4, medium, 2.1 * k, 0.3 * k, 1.3 * k)
        for k in range(galileo)
    }
    orbits |= {
        "C01": Orbit(synchronous, 3e-4, np.radians(1.5), 0.4, 0.0, 2.2),
        "C06": Orbit(synchronous, 4e-3, medium, 1.0, 3.0, 4.0),
        "C11": Orbit(27_906e3, 1e-3, medium, 2.0, 1.0, 0.5),
        "C19": Orbit(27_906e3, 1e-3, medium, 4.0, 1.0, 0.1),
        "C59": Orbit(synchronous, 3e-4, np.radians(1.5), 0.4, 0.0, 2.0),
        "R01": Orbit(25_510e3, 1e-3, np.radians(64.8), 1.0, 1.0, 1.0),
    }
    return orbits


def sp3(
    orbits: Mapping[str, Orbit],
    *,
    epochs: int = 97,
    interval_s: float = 900.0,
    version: str = "d",
    velocities: bool = False,
    time_system: str = "GPS",
    position: Callable[[str, int, str], str] = lambda name, epoch, line: line,
) -> str:
    """The text of a file; ``position`` may change the line of a satellite at an epoch."""
    names = list(orbits)
    rows = [names[k : k + 17] for k in range(0, max(len(names), 85), 17)]
    week, second = divmod(START_GPS_S, 604_800)
    lines = [
        f"#{version}{'V' if velocities else 'P'}{_date(START)} {epochs:7d} ORBIT IGS20 FIT TEST",
        f"## {week:4.0f} {second:15.8f} {interval_s:14.8f} 60389 0.0000000000000",
    ]
    lines += [
        f"+  {len(names) if k == 0 else '':>3}   " + "".join(row) + "  0" * (17 - len(row))
        for k, row in enumerate(rows)
    ]
    lines += ["++       " + "  0" * 17] * len(rows)
    lines += [f"%c M  cc {time_system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc"]
    lines += ["%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc"]
    lines += ["%f  1.2500000  1.025000000  0.00000000000  0.000000000000000"] * 2
    lines += ["%i    0    0    0    0      0      0      0      0         0"] * 2
    lines += ["/* Orbits of the tests"] * 4
    seconds = interval_s * np.arange(epochs)
    kilometres = {name: orbit.position_m(START_GPS_S + seconds) / 1e3 for name, orbit in orbits.items()}
    for k, after in enumerate(seconds):
        lines.append(f"*  {_date(START + timedelta(seconds=float(after)))}")
        for name in names:
            x, y, z = kilometres[name][k]
            lines.append(position(name, k, f"P{name}{x:14.6f}{y:14.6f}{z:14.6f}{999_999.999999:14.6f}"))
            if velocities:
                lines.append(f"V{name}" + f"{0:14.6f}" * 4)
    return "\n".join([*lines, "EOF", ""])


def changed(line: str, *coordinates: float) -> str:
    """A position line with other coordinates [km]."""
    return line[:4] + "".join(f"{value:14.6f}" for value in coordinates) + line[46:]


def _date(moment: datetime) -> str:
    return (
        f"{moment.year:4d} {moment.month:2d} {moment.day:2d} {moment.hour:2d} {moment.minute:2d} "
        f"{moment.second + moment.microsecond / 1e6:11.8f}"
    )
