"""Problems for the tests: random skies, the example of the ARAIM description, and observations with faults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pl_mc
from pl_mc import Geometry

# Reference numbers of others, which the package carries.
VECTORS = Path(pl_mc.__file__).parent / "conformance" / "vectors"

LETTERS = "GCE"

# ARAIM Algorithm Description Document v3.0, Appendix D: system, then line of sight east, north, up with its sign
# turned, and the integrity variance C_int [m^2].
APPENDIX_D = (
    ("G", 0.0225, 0.9951, -0.0966, 3.8865),
    ("G", 0.6750, -0.6900, -0.2612, 1.4377),
    ("G", 0.0723, -0.6601, -0.7477, 0.8604),
    ("G", -0.9398, 0.2553, -0.2269, 1.6383),
    ("G", -0.5907, -0.7539, -0.2877, 1.3229),
    ("E", -0.3236, -0.0354, -0.9455, 0.8434),
    ("E", -0.6748, 0.4356, -0.5957, 0.8963),
    ("E", 0.0938, -0.7004, -0.7075, 0.8669),
    ("E", 0.5571, 0.3088, -0.7709, 0.8573),
    ("E", 0.6622, 0.6958, -0.2780, 1.3616),
)


@dataclass(frozen=True)
class Problem:
    """One scenario: design (n, t) [m/m], sigma (n,) [m], observations (n,) [m], n letters of systems."""

    design: np.ndarray
    sigma_m: np.ndarray
    observed_m: np.ndarray
    systems: str

    def padded(self, rows: int, clocks: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        """Design, sigma, observations and mask: rows out of view at random places, unobserved clocks at the end.

        What is out of view holds NaN.
        """
        n, t = self.design.shape
        place = np.sort(rng.permutation(rows)[:n])
        in_view = np.zeros(rows, dtype=bool)
        in_view[place] = True
        design = np.full((rows, 3 + clocks), np.nan)
        design[place] = 0.0
        design[place, :t] = self.design
        sigma, observed = np.full(rows, np.nan), np.full(rows, np.nan)
        sigma[place], observed[place] = self.sigma_m, self.observed_m
        return design, sigma, observed, in_view


def appendix_d(*, noise: float = 1.0) -> Geometry:
    """The geometry of Appendix D with P = 1 / C_int, its standard deviations multiplied by ``noise``."""
    systems = "".join(row[0] for row in APPENDIX_D)
    clocks = np.array([[letter == "G", letter == "E"] for letter in systems], dtype=float)
    design = np.hstack([np.array([row[1:4] for row in APPENDIX_D]), clocks])
    sigma = noise * np.sqrt([row[4] for row in APPENDIX_D])
    return Geometry.from_arrays(design, sigma, systems, [f"{s}{k + 1:02d}" for k, s in enumerate(systems)])


def random_sky(rng: np.random.Generator, *, counts: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, str]:
    """Design, sigma and systems of ``counts`` satellites of each system, above 10 deg; smallest singular value 0.1.

    The bound keeps the normal matrix far from singular, so that two correct computations agree to many digits.
    """
    systems = "".join(letter * count for letter, count in zip(LETTERS, counts, strict=False))
    n = len(systems)
    clocks = np.array([[s == letter for letter in LETTERS[: len(counts)]] for s in systems], dtype=float)
    while True:
        elevation, azimuth = np.arcsin(rng.uniform(np.sin(np.radians(10)), 1, n)), rng.uniform(0, 2 * np.pi, n)
        sight = np.stack(
            [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1
        )
        design = np.hstack([-sight, clocks])
        if np.linalg.svd(design, compute_uv=False)[-1] > 0.1:
            break
    sigma = rng.uniform(0.3, 1.0, n) / np.sqrt(np.sin(elevation))
    return design, sigma, systems


def random_counts(rng: np.random.Generator, *, most: int = 24) -> tuple[int, ...]:
    """Satellites of one to three systems, of which some have a single one; at least t + 1 in all."""
    kinds = int(rng.integers(1, 4))
    while True:
        counts = rng.integers(1, most // kinds + 1, kinds)
        if kinds > 1 and rng.random() < 0.3:
            counts[rng.integers(1, kinds)] = 1
        if counts.sum() > 3 + kinds:
            return tuple(int(c) for c in counts)


def random_problem(rng: np.random.Generator, *, faults: int | None = None, largest_m: float = 100.0) -> Problem:
    """A random sky with noise of its sigma and up to three faults between 0 and ``largest_m``, of either sign."""
    design, sigma, systems = random_sky(rng, counts=random_counts(rng))
    observed = sigma * rng.standard_normal(sigma.size)
    number = int(rng.integers(0, 4)) if faults is None else faults
    faulted = rng.permutation(sigma.size)[:number]
    observed[faulted] += rng.uniform(0, largest_m, faulted.size) * rng.choice([-1, 1], faulted.size)
    return Problem(design, sigma, observed, systems)


def random_geometry(rng: np.random.Generator, *, counts: tuple[int, ...], noise: float = 1.0) -> Geometry:
    """A random sky as a `Geometry` of one epoch, sigma multiplied by ``noise``."""
    design, sigma, systems = random_sky(rng, counts=counts)
    return Geometry.from_arrays(design, noise * sigma, systems, [f"{s}{k + 1:02d}" for k, s in enumerate(systems)])


def random_series(rng: np.random.Generator, in_view: np.ndarray, systems: str, *, noise: float = 1.0) -> Geometry:
    """A series over satellites that are in view as ``in_view`` (epochs, m) says, with one sky per epoch."""
    epochs, m = in_view.shape
    letters = list(dict.fromkeys(systems))
    elevation = rng.uniform(np.radians(10), np.radians(90), (epochs, m))
    azimuth = rng.uniform(0, 2 * np.pi, (epochs, m))
    clocks = np.broadcast_to([[s == letter for letter in letters] for s in systems], (epochs, m, len(letters)))
    design = np.concatenate(
        [
            -np.stack(
                [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=-1
            ),
            clocks.astype(float),
        ],
        axis=-1,
    )
    return Geometry.from_rows(
        design=design,
        sigma_m=noise * rng.uniform(0.3, 1.0, (epochs, m)) / np.sqrt(np.sin(elevation)),
        in_view=in_view,
        names=[f"{s}{k + 1:02d}" for k, s in enumerate(systems)],
        systems=list(systems),
        clocks=letters,
    )
