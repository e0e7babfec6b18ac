"""Reference numbers of others: this program passes all of them, and what does not answer rightly is told."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.cli.main import main
from pl_mc.conformance import conform, summary
from pl_mc.conformance.row_set import RowSet, Tolerance, deviations
from reference.problems import VECTORS

VARIABLE = "PL_MC_VECTORS"
OWN = f"{sys.executable} -m pl_mc.conformance.subject"


@pytest.fixture(scope="module")
def shipped() -> pd.DataFrame:
    return conform()


def test_all_that_is_shipped_passes(shipped):
    assert shipped[~shipped["passed"]].empty
    assert shipped.attrs["notes"] == ()
    cases = shipped.attrs["cases"]
    assert cases.pop("closed form") == 48 + 34 + 136 - 82  # The largest of the three counts their rows together.
    for file, number in cases.items():
        lines = len((VECTORS / file).read_text().splitlines()) - 1
        assert number == (1 if file == "add_v3_appendix_d.csv" else lines), file


def test_the_last_line_counts_cases_by_file(shipped):
    words = summary(shipped)
    assert words.startswith(f"All {len(shipped)} sets passed; cases by file: ")
    assert "maast_v42_levels.csv 320" in words
    assert "maast_v42_exclusions.csv 1098" in words


def test_modes_are_found_and_candidates_met(shipped):
    by_set = shipped.set_index("set")
    assert by_set.loc["v4.2 h_fd: fault modes", "cases"] == 2725
    assert by_set.loc["v4.2 v_fde: candidates, own modes", "deviation"] < 1e-6
    assert (by_set.loc[[name for name in by_set.index if "listed modes" in name], "tolerance"] == 1e-6).all()


def folder_of(tmp_path: Path, *files: str) -> Path:
    for file in files:
        shutil.copy(VECTORS / file, tmp_path)
    return tmp_path


def test_any_subset_of_files_and_a_subject_of_another_process(tmp_path, capfd):
    """The task goes out as files, and answers come back as one."""
    place = folder_of(tmp_path, "sbas_five_satellites.csv", "sbas_five_satellites_expected.csv")
    main(["conform", "--vectors", str(place), "--subject", OWN, "--out", str(tmp_path / "table.csv")])
    last = capfd.readouterr().out.splitlines()[-1]
    assert last == "All 2 sets passed; cases by file: sbas_five_satellites_expected.csv 19."
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["passed"].all()
    # Only a file changes on the way: the same digits within a rounding.
    assert (table["deviation"] < 1e-12).all()


def test_a_wrong_number_fails(tmp_path, capfd):
    place = folder_of(tmp_path, "sbas_five_satellites.csv", "sbas_five_satellites_expected.csv")
    path = place / "sbas_five_satellites_expected.csv"
    table = pd.read_csv(path)
    table.loc[table["quantity"] == "vpl_m", "value"] += 1e-9
    table.to_csv(path, index=False)
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--vectors", str(place)])
    assert caught.value.code == 1
    out = capfd.readouterr().out
    assert out.splitlines()[-1].startswith("1 of 2 sets failed; cases by file")
    assert "FAILED  SBAS five satellites" in out


@pytest.mark.parametrize(
    ("program", "remark"),
    [
        ("import sys; sys.exit(77)", "declined"),
        ("import sys; sys.exit(3)", "exit code 3"),
        ("pass", "answers.csv cannot be read"),
        (
            "import sys, pathlib; pathlib.Path(sys.argv[1], 'answers.csv').write_text('a,b\\n1,2\\n')",
            "lacks the column",
        ),
    ],
)
def test_subjects_that_do_not_answer(tmp_path, program, remark):
    place = folder_of(tmp_path, "sbas_five_satellites.csv", "sbas_five_satellites_expected.csv")
    (place / "subject.py").write_text(program)
    table = conform(f"{sys.executable} {place / 'subject.py'}", place)
    assert not table["passed"].any()
    assert table["remark"].str.contains(remark, regex=False).all()
    assert np.isinf(table["deviation"]).all()


def test_no_row_at_all_is_no_pass(tmp_path, capfd):
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--vectors", str(folder_of(tmp_path, "maast_v42_geometry.csv")), "-q"])
    assert caught.value.code == 1
    assert capfd.readouterr().out == "Nothing was checked: there is no reference number.\n"


def test_what_is_not_checked_is_told(tmp_path, capfd):
    """A file without its geometry, and rows of a setting that nobody knows."""
    place = folder_of(tmp_path, "add_v31_expected.csv", "sbas_five_satellites.csv", "sbas_five_satellites_expected.csv")
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--vectors", str(place)])
    assert caught.value.code == 1
    assert "nothing of it is checked without add_v31_geometry.csv beside it" in capfd.readouterr().err
    levels = pd.read_csv(VECTORS / "maast_v42_levels.csv").iloc[:1].assign(setting="v_fx")
    levels.to_csv(place / "maast_v42_levels.csv", index=False)
    shutil.copy(VECTORS / "maast_v42_geometry.csv", place)
    notes = conform(vectors=place).attrs["notes"]
    assert "maast_v42_levels.csv: 1 of 1 rows are not checked; what they belong to is not known." in notes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vectors": "nowhere"}, "vectors: nowhere: there is no such folder"),
        ({"subject": "no-such-program-at-all"}, "subject: no-such-program-at-all: the command cannot be started"),
        ({"subject": "'"}, "subject: ': the command cannot be started"),
    ],
)
def test_sentences(change, words):
    with pytest.raises(pl_mc.InputError, match=words):
        conform(**change)


@pytest.mark.parametrize("out", ["table.txt", "nowhere/table.csv", "table"])
def test_tables_go_where_they_are_asked_for_or_nowhere(tmp_path, capfd, out):
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--out", str(tmp_path / out)])
    assert caught.value.code == 2
    assert "the name of a CSV file in a folder that is there is needed" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_json_says_what_the_exit_code_says(tmp_path, capfd):
    """Numbers without their geometry are no pass in either form."""
    place = folder_of(tmp_path, "add_v31_expected.csv", "sbas_five_satellites.csv", "sbas_five_satellites_expected.csv")
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--vectors", str(place), "--json"])
    assert caught.value.code == 1
    content = json.loads(capfd.readouterr().out)
    assert content["passed"] is False
    assert all(one["passed"] for one in content["sets"])
    assert len(content["notes"]) == 1
    with pytest.raises(SystemExit) as caught:
        main(["conform", "--vectors", str(place), "--json", "--subject", "false"])
    assert caught.value.code == 1
    content = json.loads(capfd.readouterr().out)
    assert {(one["deviation"], one["remark"]) for one in content["sets"]} == {(None, "exit code 1")}


def test_a_file_that_is_no_such_table(tmp_path):
    place = folder_of(tmp_path, "sbas_five_satellites.csv")
    (place / "sbas_five_satellites_expected.csv").write_text("a,b\n1,2\n")
    with pytest.raises(pl_mc.InputError, match=r"expected.csv: the column quantity is needed, and there are a, b"):
        conform(vectors=place)
    (place / "sbas_five_satellites_expected.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(pl_mc.InputError, match="it cannot be read as a table"):
        conform(vectors=place)


def test_deviations_by_key_and_column():
    expected = pd.DataFrame({"case": [1, 2, 3], "vpl_m": [10.0, 20.0, np.nan]})
    row_set = RowSet("x", "x.csv", "", {}, {}, expected, ("case",), {"vpl_m": Tolerance(0.1, 0.01)})
    found = deviations(row_set, pd.DataFrame({"case": [2.0, 1.0], "vpl_m": [20.15, 9.0]}))
    assert found["row"].tolist() == [0, 1]
    np.testing.assert_allclose(found["deviation"], [1.0, 0.15])
    np.testing.assert_allclose(found["tolerance"], [0.2, 0.3])
    assert np.isinf(deviations(row_set, pd.DataFrame({"case": [1], "vpl_m": ["?"]}))["deviation"]).all()


def test_numbers_that_are_not_ours_to_ship(tmp_path):
    """Of a folder that the environment names: levels of WAAS users and another program's, RTKLIB's decisions."""
    named = os.environ.get(VARIABLE)
    if not named:
        pytest.skip(f"{VARIABLE} names no folder of reference numbers")
    for file in Path(named).glob("*.csv"):
        if file.name.startswith(("sbas_levels", "sbas_geometry", "rtklib", "araim_orbits")):
            shutil.copy(file, tmp_path)
    table = conform(vectors=tmp_path)
    assert table["passed"].all(), table[~table["passed"]]
    assert {"sbas_levels.csv", "rtklib_raim_injections.csv", "araim_orbits_levels.csv"} == set(table["file"]) - {
        "rtklib_raim_levels.csv"
    }
