"""Exclusions as columns of a sweep: what single draws say, a partition, and absent where nobody excludes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.araim import LPV_200_V42, Ism
from pl_mc.engine.checkpoint_store import read_rows
from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.methods import Ls, method
from pl_mc.statistics import clopper_pearson

ISM = Ism(
    sigma_ura_m=1.0, sigma_ure_m=2 / 3, b_nom_m=0.75, r_sat_per_h={"G": 1e-5, "E": 2e-5},
    mfd_sat_h={"G": 1.0, "E": 1.5}, r_const_per_h={"G": 1e-8, "E": 1e-4}, mfd_const_h={"G": 1.0, "E": 2.0},
)  # fmt: skip
SERIES = pl_mc.simulate(
    site=(48.1, 11.6, 500.0), start="2017-11-15T00:00:00", constellations="ADD-24+24", epochs=2, interval_s=7200.0,
    mask_deg=5.0, error_model=pl_mc.error_model("dual_frequency", ism=ISM),
)  # fmt: skip
G = SERIES[0]
EXCLUDES = method("araim", ism=ISM, standard="v4.2", budget=LPV_200_V42, exclusion="satellites")
DETECTS = method("araim", ism=ISM, standard="v4.2", budget=LPV_200_V42)
COLUMNS = [event.count for event in EXCLUSIONS]
FIRST, SECOND, THIRD = G.names[:3]
FAULTS = (
    pl_mc.no_fault(G)
    + pl_mc.biases(G, {FIRST: 9.0})
    + pl_mc.biases(G, {FIRST: 30.0})
    + pl_mc.biases(G, {FIRST: 12.0, SECOND: 12.0, THIRD: -12.0})
)
DRAWS = 1500


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return pl_mc.sweep(G, FAULTS, draws=DRAWS, seed=3, methods=(DETECTS, EXCLUDES), axes=("vertical", "either"))


def test_counts_are_those_of_single_draws(table: pd.DataFrame) -> None:
    drawn = pl_mc.sample(G, FAULTS, draws=DRAWS, seed=3, methods=(EXCLUDES,))
    for (label, rows), faulted in zip(
        drawn.groupby("fault", sort=False), ([], [FIRST], [FIRST], [FIRST, SECOND, THIRD]), strict=True
    ):
        out = rows.excluded.astype(str).to_numpy()
        none = out == ""
        right = np.isin(out, faulted)
        expected = [right.sum(), (~right & ~none).sum()]
        found = table[(table.fault == label) & (table.method == EXCLUDES.name)]
        assert found[COLUMNS[:2]].drop_duplicates().to_numpy().tolist() == [expected]
        # Where no level is beyond its limit a failed exclusion is the only alarm.
        assert (found.failed_exclusions == found.alarms).all()
        assert found.failed_exclusions.iloc[0] == (none & rows.alarm.to_numpy()).sum()
    by_fault = table[(table.method == EXCLUDES.name) & (table.axis == "vertical")].set_index("fault")
    free, small, large, three = (by_fault.loc[label] for label in FAULTS.labels)
    assert free.no_exclusions > 0.99 * DRAWS
    assert free.right_exclusions == 0
    assert 0 < small.no_exclusions < DRAWS
    assert large.right_exclusions > 0.99 * DRAWS
    assert three.failed_exclusions > 0


def test_each_draw_is_one_of_them_with_its_bounds(table: pd.DataFrame) -> None:
    own = table[table.method == EXCLUDES.name]
    assert (own[COLUMNS].sum(axis=1) == own.draws - own.unavailable).all()
    # Of who excludes nobody nothing is said.
    assert (table.loc[table.method == DETECTS.name, COLUMNS] == 0).all(axis=None)
    for event in EXCLUSIONS:
        low, high = clopper_pearson(own[event.count].to_numpy(), own.draws.to_numpy())
        np.testing.assert_allclose(own[f"{event.name}_rate"], own[event.count] / own.draws)
        np.testing.assert_allclose(own[[f"{event.name}_low", f"{event.name}_high"]], np.stack([low, high], axis=1))
    # Exclusions follow all other counts.
    assert list(table.columns[table.columns.get_loc("draws") + 1 :][: len(EVENTS) + 4]) == [
        *(event.count for event in EVENTS), *COLUMNS,
    ]  # fmt: skip


def test_without_exclusion_there_is_none_of_it(table: pd.DataFrame) -> None:
    alone = pl_mc.sweep(G, FAULTS, draws=DRAWS, seed=3, methods=(DETECTS,), axes=("vertical", "either"))
    assert not any("exclusion" in column for column in alone.columns)
    there = table.loc[table.method == DETECTS.name, alone.columns].reset_index(drop=True)
    assert alone.to_csv() == there.to_csv()


def test_parts_sums_and_drawn_faults_have_them(tmp_path: Path) -> None:
    faults = pl_mc.biases(SERIES, f"{FIRST}:normal(20,5)m") + pl_mc.biases(SERIES, f"{SECOND}:+30m")
    options = {"draws": 600, "seed": 3, "methods": (EXCLUDES, "ls")}
    whole = pl_mc.sweep(SERIES, faults, **options, folder=tmp_path)
    again = pl_mc.sweep(SERIES, faults, **options, folder=tmp_path, resume=True)
    assert again.to_csv() == whole.to_csv()
    stored = pd.concat(read_rows(tmp_path))
    assert stored[COLUMNS].sum().tolist() == whole[COLUMNS].sum().tolist()
    by_epoch = pl_mc.sweep(SERIES, faults, **options, by_epoch=True)
    assert by_epoch[COLUMNS].sum().tolist() == whole[COLUMNS].sum().tolist()
    # A satellite with a bias that is drawn has a fault, whatever its size.
    drawn = whole[(whole.method == EXCLUDES.name) & (whole.fault == faults.labels[0])].iloc[0]
    assert drawn.right_exclusions > 0.5 * drawn.draws


@dataclass(frozen=True)
class Blames(Ls):
    """Excludes the first row, whatever happens."""

    key = "blames"
    names_exclusions = True

    def solve(self, model, prepared, start):
        outcome = super().solve(model, prepared, start)
        nobody = np.int32(0) * outcome.available
        return type(outcome)(**{**vars(outcome), "excluded": nobody.astype("int32")})


def test_a_method_of_ones_own_is_counted_by_what_it_says() -> None:
    found = pl_mc.sweep(G, FAULTS, draws=300, seed=1, methods=(Blames(),)).set_index("fault")
    assert found.right_exclusions.tolist() == [0, 300, 300, 300]
    assert found.wrong_exclusions.tolist() == [300, 0, 0, 0]
