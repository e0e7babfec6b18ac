"""Batches of random geometries against the slow reference, from single faults to triples.

The kernel solves normal equations whose pivots may fall to 1e-10 of their size, which leaves a relative accuracy of
1e-16 / 1e-10 = 1e-6 in the worst subset; the reference solves by a singular value decomposition.
"""

from __future__ import annotations

import numpy as np
import pytest

import pl_mc.araim
from reference import araim_numpy
from reference.problems import random_sky

ROWS, CLOCKS, GEOMETRIES = 14, 3, 30


def problems(seed, *, counts, p_sat, p_const):
    """A batch of random skies in random rows, what is out of view filled with NaN."""
    rng = np.random.default_rng(seed)
    batch = []
    for _ in range(GEOMETRIES):
        number = counts[int(rng.integers(len(counts)))]
        design, sigma, systems = random_sky(rng, counts=number)
        n = len(systems)
        place = np.sort(rng.permutation(ROWS)[:n])
        row = {
            "design": np.full((ROWS, 3 + CLOCKS), np.nan),
            "c_int": np.full(ROWS, np.nan),
            "c_acc": np.full(ROWS, np.nan),
            "b_nom": np.full(ROWS, np.nan),
            "p_sat": np.full(ROWS, np.nan),
            "systems": np.full(ROWS, ""),
            "in_view": np.zeros(ROWS, dtype=bool),
        }
        row["design"][place] = np.hstack([design, np.zeros((n, 3 + CLOCKS - design.shape[1]))])
        row["c_int"][place] = sigma**2
        row["c_acc"][place] = sigma**2 * rng.uniform(0.3, 1.0, n)
        row["b_nom"][place] = rng.uniform(0.0, 1.0, n)
        row["p_sat"][place] = rng.choice(p_sat, n)
        row["systems"][place] = list(systems)
        row["in_view"][place] = True
        batch.append(row)
    return {name: np.stack([row[name] for row in batch]) for name in batch[0]} | {"p_const": p_const}


SINGLES = {"counts": ((5, 5), (6, 4, 4), (7, 6), (9, 1), (4, 3)), "p_sat": (1e-5, 3e-6)}


@pytest.mark.parametrize("unmonitored", ["plain", "contained"])
@pytest.mark.parametrize(
    ("given", "p_const", "order"),
    [
        (SINGLES, {"G": 1e-8, "C": 1e-4, "E": 3e-5}, 1),
        ({"counts": ((7, 6), (4, 4, 4)), "p_sat": (1e-4,)}, {"G": 1e-8, "C": 1e-5, "E": 1e-9}, 2),
        ({"counts": ((7,), (6, 1)), "p_sat": (1.5e-3,)}, {"G": 1e-9, "C": 0.0}, 3),
    ],
    ids=["singles", "pairs", "triples"],
)
def test_against_the_reference(given, p_const, order, unmonitored):
    batch = problems(order, p_const=p_const, **given)
    found = pl_mc.araim.protection_levels(**batch, unmonitored=unmonitored)
    available = 0
    for k, rows in enumerate(batch["in_view"]):
        design = batch["design"][k, rows]
        used = np.r_[[True] * 3, design[:, 3:].any(axis=0)]
        vectors = [batch[name][k, rows] for name in ("c_int", "c_acc", "systems", "b_nom", "p_sat")]
        expected = araim_numpy.levels(design[:, used], *vectors, p_const, unmonitored=unmonitored)
        assert found.p_not_monitored[k] == pytest.approx(expected.p_not_monitored, rel=1e-6, abs=1e-15)
        assert found.available[k] == np.isfinite(expected.vpl)
        assert found.available[k] == np.isfinite(found.vpl_m[k])
        monitored = np.isfinite(found.threshold_m[k, :, 2])
        if not found.available[k]:
            assert not monitored.any()
            continue
        available += 1
        assert found.vpl_m[k] == pytest.approx(expected.vpl, rel=1e-6)
        assert found.hpl_m[k] == pytest.approx(expected.hpl, rel=1e-6)
        assert found.emt_m[k] == pytest.approx(expected.emt, rel=1e-6)
        assert found.sigma_v_acc_m[k] == pytest.approx(expected.sigma_v_acc, rel=1e-6)
        sets = [frozenset(np.flatnonzero(out[rows]).tolist()) for out in found.excluded[k, monitored]]
        assert set(sets) == set(expected.modes)
        mine = {
            (s, round(float(np.log(p)), 6)): t
            for s, p, t in zip(sets, found.probability[k, monitored], found.threshold_m[k, monitored], strict=True)
        }
        for s, p, t in zip(expected.modes, expected.probability, expected.thresholds, strict=True):
            np.testing.assert_allclose(mine[s, round(float(np.log(p)), 6)], t, rtol=1e-6, atol=1e-8)
    assert available > GEOMETRIES // 3
    # The regime is the one that its name says.
    sizes = found.excluded[found.available].sum(axis=2)
    assert (sizes.max() >= order) if order > 1 else (found.excluded.shape[1] <= ROWS + CLOCKS)
