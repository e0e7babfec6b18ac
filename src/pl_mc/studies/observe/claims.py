"""What receivers and programs claim of their own positions, made rows beside those of the methods."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from pl_mc.alert import Judged
from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.geometry import Geometry
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.record import EAST, NORTH, UP
from pl_mc.input_errors import InputError
from pl_mc.receiver import Truth, read_claims
from pl_mc.statistics.autocorrelation import effective_number, places_in_time
from pl_mc.statistics.intervals import rate_columns, shared_noise_bounds

# A claim belongs to the epoch whose time is this near, and nearer than half a step of the epochs.
_SAME_EPOCH_S = 0.5

_NOTHING = 1e-6

# Shares at which claimed standard deviations are judged: those of one and of 1.96 normal ones.
_SHARES = (0.683, 0.95)


class Claims:
    """A file of claims, judged at the epochs of a series.

    Attributes:
        name: of the file.
        fixes: what it says.
        notes: sentences about what was left out.
        error_m: (k, 3), errors east, north, up at k epochs of the series [m].
        place: (k,), places of those epochs in the series.
        kept: (k,), places of their claims in the file.
    """

    def __init__(self, path: Path, name: str, g: Geometry, truth: Truth) -> None:
        self.name, self.fixes = name, read_claims(path)
        times, epochs_s = self.fixes.time_gps_s, g.time_gps_s
        step_s = float(np.median(np.diff(epochs_s))) if epochs_s.size > 1 else 2.0 * _SAME_EPOCH_S
        after = np.searchsorted(epochs_s, times).clip(1, max(epochs_s.size - 1, 1)).clip(max=epochs_s.size - 1)
        before = (after - 1).clip(0)
        place = np.where(np.abs(epochs_s[after] - times) < np.abs(epochs_s[before] - times), after, before)
        off_s = np.abs(epochs_s[place] - times)
        position_m, known = truth.at(times)
        near = np.flatnonzero(known & (off_s <= min(_SAME_EPOCH_S, 0.5 * step_s)))
        # Of several claims about one epoch the nearest.
        near = near[np.lexsort((off_s[near], place[near]))]
        _, first = np.unique(place[near], return_index=True)
        self.kept = near[first]
        self.place = place[self.kept]
        if not self.kept.size:
            raise InputError(f"{path}: none of its {times.size:,} times is that of an epoch with a known position.")
        left = times.size - self.kept.size
        without = f"{name}: {left:,} of {times.size:,} positions are at no epoch that is judged, and were left out."
        self.notes = (*self.fixes.notes, *((without,) if left else ()))
        self.error_m = self._errors_m(position_m[self.kept])

    def _errors_m(self, truth_m: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.fixes.error_m is not None:
            return self.fixes.error_m[self.kept]
        latitude, longitude, _ = geodetic(truth_m)
        return np.einsum("kij,kj->ki", enu_rotation(latitude, longitude), self.fixes.position_m[self.kept] - truth_m)

    def levels_m(self, multiplier: float | None) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Names of methods with their horizontal and vertical levels, each (k,) [m]; NaN where none is claimed."""
        found = {}
        if self.fixes.level_m:
            nothing = np.full(self.kept.size, np.nan)
            claimed = {name: level_m[self.kept] for name, level_m in self.fixes.level_m.items()}
            found[self.name] = claimed.get("hpl", nothing), claimed.get("vpl", nothing)
        if self.fixes.covariance_m2 is not None:
            covariance = self.fixes.covariance_m2[self.kept]
            horizontal, up = _largest_sigma_m(covariance), np.sqrt(covariance[:, UP, UP])
            k_h, k_v = multipliers(multiplier)
            name = f"{self.name} sigma" if self.name in found else self.name
            found[name] = k_h * horizontal, k_v * up
        return found

    def rows(self, g: Geometry, judged: Judged, multiplier: float | None) -> Iterator[pd.DataFrame]:
        """Rows such as those of `pl_mc.solve`, one table for each sort of claim."""
        count = self.fixes.satellites
        for name, (hpl_m, vpl_m) in self.levels_m(multiplier).items():
            levels = {"hpl": hpl_m, "vpl": vpl_m}
            told = np.all([np.isfinite(levels[pl]) for pl, _, _ in judged.levels], axis=0)
            alarm = ~told | np.any([levels[pl] > limit_m for pl, _, limit_m in judged.levels], axis=0)
            error_m = np.where(told[:, None], self.error_m, np.nan)
            yield pd.DataFrame(
                {
                    "epoch": g.epoch[self.place], "time_gps_s": g.time_gps_s[self.place], "method": name,
                    "satellites": g.satellite_count[self.place] if count is None else count[self.kept],
                    "east_m": error_m[:, EAST], "north_m": error_m[:, NORTH], "up_m": error_m[:, UP],
                    "hpl_m": hpl_m, "vpl_m": vpl_m, "available": told, "alarm": alarm, "unconverged": False,
                    "tied": False, "rejected": False,
                }
            )  # fmt: skip

    def coverage(self, g: Geometry) -> list[dict[str, object]]:
        """How often errors are within what the standard deviations say of 68.3 % and 95 % of them."""
        if self.fixes.covariance_m2 is None:
            return []
        covariance = self.fixes.covariance_m2[self.kept]
        there = np.isfinite(covariance[:, UP, UP])
        covariance, error_m, place = (
            covariance[there],
            self.error_m[there],
            places_in_time(g.time_gps_s[self.place[there]]),
        )
        flat = covariance[:, :2, :2]
        distance = np.sqrt(np.einsum("ki,ki->k", error_m[:, :2], np.linalg.solve(flat, error_m[:, :2, None])[..., 0]))
        unit = error_m / np.sqrt(covariance[:, [EAST, NORTH, UP], [EAST, NORTH, UP]])
        number = {
            "horizontal": min(effective_number(unit[:, k], place) for k in (EAST, NORTH)),
            "vertical": effective_number(unit[:, UP], place),
        }
        rows = []
        for axis, size in (("horizontal", distance), ("vertical", np.abs(unit[:, UP]))):
            for share in _SHARES:
                # Rayleigh of two directions, normal of one.
                radius = np.sqrt(-2.0 * np.log1p(-share)) if axis == "horizontal" else special.ndtri(0.5 + 0.5 * share)
                rows.append((axis, float(radius), share, size <= radius))
            if axis == "horizontal" and self.fixes.of_sigma.startswith("vacc_m"):
                # The length itself, which is the root of two times the standard deviation of a direction.
                rows.append((axis, float(np.sqrt(2.0)), float(-np.expm1(-1.0)), size <= np.sqrt(2.0)))
        return [
            {
                "method": self.name, "axis": axis, "multiplier": radius, "expected": share, "epochs": int(there.sum()),
                "independent": number[axis], "within": int(inside.sum()),
                **bounded(int(inside.sum()), int(there.sum()), number[axis], "within"),
            }
            for axis, radius, share, inside in rows
        ]  # fmt: skip


def read_all(paths: Sequence[Path], g: Geometry, truth: Truth) -> list[Claims]:
    """The files, each with a name that no other one has."""
    names = [path.name for path in paths]
    return [
        Claims(path, name if names.count(name) == 1 else f"{name} ({k})", g, truth)
        for k, (path, name) in enumerate(zip(paths, names, strict=True), start=1)
    ]


def multipliers(multiplier: float | None) -> tuple[float, float]:
    """By what a claimed standard deviation becomes a horizontal and a vertical level."""
    return (K_HORIZONTAL, K_VERTICAL) if multiplier is None else (multiplier, multiplier)


def independent_epochs(part: pd.DataFrame, judged: Judged) -> float:
    """How many independent epochs the rows of a method are worth, by their errors over the levels that are judged."""
    place = places_in_time(part.time.to_numpy().astype("datetime64[ns]").astype(np.int64) / 1e9)
    errors = {"vpl": ("up_m",), "hpl": ("east_m", "north_m")}
    ratios = [
        (part[error] / part[f"{pl}_m"]).where(part.available).replace([np.inf, -np.inf], np.nan)
        for pl, _, _ in judged.levels
        for error in errors[pl]
    ]
    # Where no level is known nothing is either: as many as there are epochs.
    return min((n for n in (effective_number(ratio, place) for ratio in ratios) if n > 0), default=float(len(part)))


def bounded(count: int, total: int, independent: float, name: str) -> dict[str, float]:
    """A rate with 95 % bounds of so many independent epochs."""
    rate = count / total if total else np.nan
    low, high = shared_noise_bounds(rate, np.floor(max(independent, 1.0))) if total else (0.0, 1.0)
    # Of numbers that need not be whole a bound may be a rounding error from one that says nothing.
    low, high = (0.0 if low < _NOTHING else low), (1.0 if high > 1.0 - _NOTHING else high)
    return rate_columns(name, rate, float(low), float(high))


def _largest_sigma_m(covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,), standard deviation along the longer axis of the horizontal ellipse [m]."""
    east, north, both = (covariance_m2[:, i, j] for i, j in ((0, 0), (1, 1), (0, 1)))
    return np.sqrt(0.5 * (east + north) + np.hypot(0.5 * (east - north), both))
