"""The integrity support message: forms in which it comes, what each satellite has of it, and what is refused."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle

import numpy as np
import pytest

import pl_mc
from pl_mc.araim import Ism
from pl_mc.ism import CODES, as_ism, codes_of, read_ism

CSV = """# A comment, and an empty line

satellite,sigma_ura_m,sigma_ure_m,b_nom_m,p_sat,p_const
G,1,0.5,0.75,1e-5,1e-8
E,1.5,1,0.75,3e-5,1e-4
G07, 2.4 ,,,1e-4,
"""
NAMES, SYSTEMS = ("G01", "G07", "E05", "rover"), "GGEE"


def written(tmp_path, text, name="ism.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


BY_FIELD = {
    "sigma_ura_m": {"G": 1, "E": 1.5, "G07": 2.4},
    "sigma_ure_m": {"G": 0.5, "E": 1},
    "b_nom_m": 0.75,
    "p_sat": {"G": 1e-5, "E": 3e-5, "G07": 1e-4},
    "p_const": {"G": 1e-8, "E": 1e-4},
}
BY_SATELLITE = {
    "G": {"sigma_ura_m": 1.0, "sigma_ure_m": 0.5, "b_nom_m": 0.75, "p_sat": 1e-5, "p_const": 1e-8},
    "E": {"sigma_ura_m": 1.5, "sigma_ure_m": 1.0, "b_nom_m": 0.75, "p_sat": 3e-5, "p_const": 1e-4},
    "G07": {"sigma_ura_m": 2.4, "p_sat": 1e-4},
}


@pytest.mark.parametrize("form", ["record", "by field", "by satellite", "csv", "path", "windows"])
def test_every_form_says_the_same(form, tmp_path):
    """A satellite has what stands under its name, else what its constellation has; so has a name of one's own."""
    given = {
        "record": Ism(**BY_FIELD),
        "by field": BY_FIELD,
        "by satellite": BY_SATELLITE,
        "csv": str(written(tmp_path, CSV)),
        "path": written(tmp_path, CSV),
        "windows": written(tmp_path, "\ufeff" + CSV.replace("\n", "\r\n")),
    }[form]
    ism = as_ism(given)
    for field, expected in {
        "sigma_ura_m": [1.0, 2.4, 1.5, 1.5],
        "sigma_ure_m": [0.5, 0.5, 1.0, 1.0],
        "b_nom_m": [0.75, 0.75, 0.75, 0.75],
        "p_sat": [1e-5, 1e-4, 3e-5, 3e-5],
        "p_const": [1e-8, 1e-8, 1e-4, 1e-4],
    }.items():
        np.testing.assert_array_equal(ism.values(field, NAMES, SYSTEMS), expected)
        # The same by the codes that compiled functions look satellites up by.
        np.testing.assert_array_equal(ism.table(field)[codes_of(NAMES, SYSTEMS)], expected)
    assert str(ism) == ("ism.csv" if form in ("csv", "path", "windows") else "own")


def test_a_record_is_a_value(tmp_path):
    """It can be compared, hashed, copied, changed, sent to another process, and written down."""
    ism = as_ism(written(tmp_path, CSV))
    assert dataclasses.replace(as_ism(BY_SATELLITE), name="ism.csv") == ism != as_ism(BY_SATELLITE)
    for same in (pickle.loads(pickle.dumps(ism)), copy.deepcopy(ism), dataclasses.replace(ism)):
        assert same == ism
        assert hash(same) == hash(ism)
    content = json.loads(json.dumps(ism.as_dict()))
    assert content["sigma_ura_m"] == {"G": 1.0, "E": 1.5, "G07": 2.4}
    assert as_ism(content) == ism
    assert Ism(b_nom_m=0.5).as_dict() == {"name": "own", "b_nom_m": 0.5}
    assert dataclasses.replace(ism, p_sat=2e-5).values("p_sat", ["G07"], "G") == 2e-5


def test_codes_are_those_of_names():
    codes = codes_of(["G01", "C63", "E36", "R27", "C64", "sat"], "GCERCE")
    assert codes.tolist() == [1, 64 + 63, 128 + 36, 192 + 27, 64, 128]
    assert codes.max() < CODES


HEAD = "satellite,sigma_ura_m,p_sat\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "ism.csv: it is empty; a first line such as 'satellite,sigma_ura_m"),
        (HEAD, "ism.csv: it has no line for a satellite"),
        (HEAD + "G01,1,1e-5\nG99,1,1e-5\n", r"line 3: satellite: 'G99' is neither .* .nearest: G"),
        (HEAD + "GPS,1,1e-5\n", r"line 2: satellite: 'GPS' is neither a satellite nor a constellation .nearest: G"),
        (HEAD + "g01,1,1e-5\n", r"line 2: satellite: 'g01' .* .nearest: G01"),
        (HEAD + ",1,1e-5\n", "line 2: satellite: '' is neither"),
        (HEAD + "G01,-1,1e-5\n", r"line 2: sigma_ura_m: -1.0 cannot be used; a standard deviation .*nearest: 0"),
        (HEAD + "G01,nan,1e-5\n", "line 2: sigma_ura_m: a finite number is needed, not nan"),
        (HEAD + "G01,inf,1e-5\n", "line 2: sigma_ura_m: a finite number"),
        (HEAD + "G01,one,1e-5\n", "line 2: sigma_ura_m: a finite number is needed, not 'one'"),
        (HEAD + "G01,1_0,1e-5\n", "line 2: sigma_ura_m: a finite number is needed, not '1_0'"),
        (HEAD + "G01,1,1\n", r"line 2: p_sat: 1.0 cannot be used; .* between 0 and 1, .*nearest: below 1"),
        (HEAD + "G01,1,1e-200\n", "line 2: p_sat: 1e-200 .*nearest: 0 or 1e-100"),
        (HEAD + "G01,1\n", "line 2: 3 cells are needed, as in the first line, not 2"),
        (HEAD + "G01,1,1e-5,\n", "line 2: 3 cells are needed, .* not 4"),
        (HEAD + "G01,1,1e-5\n\nG01,2,1e-5\n", "line 4: satellite: G01 is there already, in line 2"),
        ("satellite,sigma_ura,p_sat\n", "line 1: the column 'sigma_ura' is unknown .nearest: sigma_ura_m"),
        ("prn,sigma_ura_m\nG01,1\n", "line 1: the column 'prn' is unknown"),
        ("sigma_ura_m\n1\n", "line 1: the column satellite is missing"),
        ("satellite\nG01\n", "line 1: the column of a field .* is missing"),
        ("satellite,p_sat,p_sat\n", "line 1: the column p_sat is there twice"),
        ("satellite;p_sat\nG01;1e-5\n", "line 1: the column 'satellite;p_sat' is unknown"),
        ('satellite,p_sat\n"G01"x,1e-5\n', "line 2: it is no line of a CSV file"),
        ("satellite,p_const\nG01,1e-4\nG02,1e-8\n", "p_const: G02 has 1e-08 and G01 has 0.0001; a constel"),
        ("satellite,b_nom_m\nG,\n", "it says nothing; at least one of"),
    ],
)
def test_what_a_file_cannot_say(text, words, tmp_path):
    with pytest.raises(pl_mc.InputError, match=words) as caught:
        read_ism(written(tmp_path, text))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "ism: it says nothing; at least one of sigma_ura_m"),
        (1.0, "ism: an Ism, a table of its fields, or the path of a CSV file, is needed, not 1.0"),
        (None, "ism: an Ism, a table .* not None"),
        ("none.csv", "ism: none.csv: there is no such file"),
        ({"sigma_ura": 1.0}, "'sigma_ura' is no field, and no satellite .*nearest: sigma_ura_m"),
        ({"sigma_ura_m": 1.0, "r_sat": 1.0}, "ism: the field 'r_sat' is unknown .nearest: p_sat"),
        ({"G01": 1.0}, "'G01' is no field, and no satellite with a table"),
        ({"G33": {"b_nom_m": 1}}, "ism: 'G33' is neither a satellite nor a constellation .nearest: G"),
        ({"G": {"b_nom": 1}}, "ism: G: the field 'b_nom' is unknown .nearest: b_nom_m"),
        ({"b_nom_m": {"G": -0.5}}, "ism: b_nom_m: G: -0.5 cannot be used; .*nearest: 0"),
        ({"sigma_ure_m": -1}, "ism: sigma_ure_m: -1 cannot be used; .*nearest: 0"),
        ({"sigma_ura_m": 1e12}, "ism: sigma_ura_m: .*nearest: 1e.09"),
        ({"p_const": {"GPS": 1e-8}}, "ism: p_const: 'GPS' is neither a satellite nor a constellation .nearest: G"),
        ({"p_const": {}}, "ism: p_const: there is no value in it"),
        ({"p_sat": True}, "ism: p_sat: a finite number is needed, not True"),
        ({"p_sat": "1e-5"}, "ism: p_sat: a finite number is needed, not '1e-5'"),
        ({"p_sat": 1e-5, "name": 3}, "ism: name: a word is needed, not 3"),
    ],
)
def test_what_a_table_cannot_say(given, words):
    with pytest.raises(pl_mc.InputError, match=words):
        as_ism(given)


def test_what_is_missing_is_told():
    ism = Ism(p_sat={"G01": 1e-5, "G02": 1e-5}, p_const={"G": 1e-8})
    with pytest.raises(
        pl_mc.InputError, match=r"ism: p_sat: there is no value for G03 or for its constellation G .nea"
    ):
        ism.values("p_sat", ["G01", "G03"], "GG")
    with pytest.raises(pl_mc.InputError, match=r"ism: p_const: there is no value for constellation E .valid: G"):
        ism.values("p_const", ["E01"], "E")
    with pytest.raises(pl_mc.InputError, match=r"b_nom_m: it is needed here, and the ISM has none .it has p_sat, p_c"):
        ism.values("b_nom_m", ["G01"], "G")
