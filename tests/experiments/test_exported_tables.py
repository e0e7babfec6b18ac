"""Tables leave as pandas, xarray and MATLAB can take them: plain columns, names that are identifiers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.report.files import write_table

RESULTS = Path(__file__).parents[2] / "results"
STORED = sorted(RESULTS.glob("*/*.csv"))

# Small experiments of the kinds that write Parquet.
SITE = {"epochs": 8, "interval_s": 600.0}
WITH_PARQUET = {
    "series": {
        "compare": "static", "redraws": 0, "methods": [{"name": "ls"}, {"name": "huber"}],
        "source": {"kind": "site", **SITE},
        "faults": {"windows": [[1, 3], [5, 7]], "satellites": 1, "lowest_m": 5.0, "highest_m": 100.0},
    },
    "sweep": {
        "view": "map", "draws": 20, "geometry": SITE, "faults": {"start_m": 10.0, "stop_m": 20.0, "step_m": 10.0},
    },
    "service": {
        "draws": 2, "step_deg": 45.0, "step_s": 21600.0, "duration_s": 86400.0, "durations_s": [15.0],
        "start": "2017-11-21T00:00:00", "constellations": ["GPS"],
    },
}  # fmt: skip

# MATLAB: a letter, then letters, digits and underscores, 63 in all; Python's rule is wider but for its keywords.
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
MATLAB_WORDS = {"end", "if", "for", "while", "function", "return", "global", "case", "else", "break", "continue"}

PLAIN = {"BOOLEAN", "INT32", "INT64", "FLOAT", "DOUBLE"}


def require_plain(path: Path) -> None:
    """Fail unless the file is a table of plain columns with names that are identifiers."""
    if path.suffix == ".csv":
        table = pd.read_csv(path, nrows=200)
        names = [str(name) for name in table.columns]
        for name in names:
            text = table[name].dropna()
            nested = text.astype(str).str.match(r"^[\[{(]").any() if text.dtype.kind not in "bif" else False
            assert not nested, f"{path}: {name}"
    else:
        schema = pq.ParquetFile(path).schema
        columns = [schema.column(k) for k in range(len(schema))]
        names = [column.path for column in columns]
        for column in columns:
            # A repeated value is a list, a deeper definition a structure.
            assert column.max_repetition_level == 0, f"{path}: {column.path}"
            assert column.max_definition_level <= 1, f"{path}: {column.path}"
            text = column.physical_type == "BYTE_ARRAY" and str(column.logical_type) == "String"
            assert text or column.physical_type in PLAIN, f"{path}: {column.path}"
    for name in names:
        assert IDENTIFIER.fullmatch(name), f"{path}: {name}"
        assert name not in MATLAB_WORDS, f"{path}: {name}"
    assert len({name.lower() for name in names}) == len(names), f"{path}: names that differ in case alone"


@pytest.mark.parametrize("path", STORED, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_stored_tables_are_plain(path: Path) -> None:
    require_plain(path)


def test_there_are_stored_tables() -> None:
    assert {"stanford.csv", "regions.csv"} <= {path.name for path in STORED}


@pytest.mark.parametrize("kind", WITH_PARQUET)
@pytest.mark.usefixtures("without_figures")
def test_tables_of_many_rows_are_plain(kind: str, tmp_path: Path) -> None:
    content = {"kind": kind, "title": "small", "methods": [{"name": "ls"}], **WITH_PARQUET[kind]}
    run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    made = sorted((tmp_path / "out").rglob("*.parquet"))
    assert made
    for path in [*made, *(tmp_path / "out").glob("*.csv")]:
        require_plain(path)


@pytest.mark.parametrize(
    "table",
    [pd.DataFrame({"a": [[1, 2]]}), pd.DataFrame({"a": [{"b": 1}]}), pd.DataFrame({"a b": [1.0]})],
    ids=["list", "structure", "blank"],
)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_other_tables_would_be_seen(table: pd.DataFrame, ending: str, tmp_path: Path) -> None:
    write_table(table, tmp_path, "bad", stored="both")
    with pytest.raises(AssertionError):
        require_plain(tmp_path / f"bad.{ending}")


def test_what_functions_return_comes_back_from_both_forms(tmp_path: Path) -> None:
    series = pl_mc.simulate(site="CUT0", epochs=3, interval_s=600.0)
    errors_m = np.random.default_rng(3).normal(size=series.sigma_m.shape) * series.sigma_m
    made = {
        "solved": pl_mc.solve(series, errors_m, methods=("ls",), alert=pl_mc.LPV_200),
        "reliability": pl_mc.reliability(series[0]),
        "exact": pl_mc.exact.ls_rates(series[0], pl_mc.no_fault(series[0]), alert=pl_mc.LPV_200),
    }
    for name, table in made.items():
        write_table(table, tmp_path, name, stored="both")
        for ending in ("csv", "parquet"):
            require_plain(tmp_path / f"{name}.{ending}")
        pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / f"{name}.parquet"), table)
        read = pd.read_csv(tmp_path / f"{name}.csv", dtype=str)
        assert list(read.columns) == list(table.columns)
        for column in table.select_dtypes("number"):
            # Every digit is written, so that the numbers are the same to the last bit.
            np.testing.assert_array_equal(read[column].astype(float), table[column].to_numpy(float))
