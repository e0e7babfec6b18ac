"""``pl-mc check`` and ``init``: every error at once with its line, costs, and files that begin an experiment."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from pl_mc.cli.main import main
from pl_mc.experiments.assuming import assumed_of
from pl_mc.experiments.checking import check_experiment, cost_of, field_lines
from pl_mc.experiments.field_meanings import meaning
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.source_files import experiment_files
from pl_mc.experiments.template import template, template_for
from pl_mc.input_errors import InputError
from pl_mc.runtime.progress import duration_text
from pl_mc.studies.registry import KINDS

WRONG = """kind = "sweep"
title = "Wrong in many ways"
drows = 300
alert = "LPV200"
methods = [{name = "ls"}, {name = "igg3", k1 = 1.0}, {name = "ig3"}]

[geometry]
epochs = 4
site = "CUTO"
mask_deg = 95
constellations = [
  "GPSS",   # no [such] = thing
]
error_model = "residuals"

[faults]
satellite = "G07"
start_m = 10
stop_m = 40
step_m = -15
"""

FOUND = [
    ("draws", None, "field required"),
    ("drows", 3, "nearest: draws"),
    ("alert", 4, "nearest: LPV-200"),
    ("methods.1", 5, "k0 < k1"),
    ("methods.2", 5, "nearest: igg3"),
    ("geometry.site", 9, "nearest: CUT0"),
    ("geometry.mask_deg", 10, "less than 90"),
    ("geometry.constellations", 11, "nearest: GPS"),
    ("geometry.error_model", 14, "nearest: residual"),
    ("faults", 16, "the step has to lead from the start to the stop"),
]


def checked(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    capsys.readouterr()
    code = 0
    try:
        main(arguments)
    except SystemExit as stop:
        code = int(stop.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


def test_every_error_is_named_at_once_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(WRONG)
    problems = check_experiment(str(file)).problems
    assert [(one.field, one.line) for one in problems] == [(field, line) for field, line, _ in FOUND]
    for one, (_, _, words) in zip(problems, FOUND, strict=True):
        assert words in one.reason
    code, out, err = checked(["check", str(file)], capsys)
    assert (code, out) == (2, "")
    lines = err.splitlines()
    assert len(lines) == len(FOUND)
    assert lines[1].startswith("wrong.toml:3: drows: ")
    assert "Traceback" not in err
    code, out, err = checked(["check", str(file), "--json"], capsys)
    assert (code, err) == (2, "")
    assert [one["line"] for one in json.loads(out)["problems"]] == [line for _, line, _ in FOUND]


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        (("satellite = \"G07\"", "satellite = \"G99\""), "faults.satellite", "G99"),
        (("epochs = 4", "epochs = 4\nepoch = 9"), "geometry", "0 to 3"),
        (('kind = "sweep"', 'kind = "sweap"'), "kind", "nearest: sweep"),
        (('name = "igg3"', 'name = "igg3", scale = 3'), "methods.1", "scale"),
        (('{name = "igg3"}', '{name = "ls"}'), "methods.1", "asked for twice"),
        (('[geometry]', 'noise = {name = "gausian"}\n[geometry]'), "noise", "nearest: gaussian"),
    ],
)  # fmt: skip
def test_what_a_record_cannot_tell_alone_is_found_too(
    tmp_path: Path, change: tuple[str, str], field: str, words: str
) -> None:
    sound = {
        "drows": "draws", "LPV200": "LPV-200", ", k1 = 1.0": "", ', {name = "ig3"}': "", "CUTO": "CUT0",
        "95": "5", "GPSS": "GPS", "residuals": "residual", "-15": "15",
    }  # fmt: skip
    text = WRONG
    for old, new in sound.items():
        text = text.replace(old, new)
    file = tmp_path / "small.toml"
    file.write_text(text)
    assert check_experiment(str(file)).problems == ()
    assert change[0] in text
    file.write_text(text.replace(*change))
    (problem,) = check_experiment(str(file)).problems
    assert problem.field == field
    assert words in problem.reason


def test_the_cost_counts_scenarios_and_says_how_time_was_found(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = checked(["check", "ramp", "--draws", "1000"], capsys)
    assert (code, err) == (0, "")
    # 20 biases x 1,000 draws x 2 methods.
    assert "40,000 scenarios over all methods" in out
    assert "measured on two cores" in out
    assert checked(["check", "ramp", "--draws", "1000", "--quiet"], capsys) == (0, "", "")
    few, many = (cost_of(load_experiment("ramp", {"draws": draws})[1]) for draws in (1_000, 100_000_000))
    assert few.seconds is not None
    assert many.seconds is not None
    # 4e9 scenarios against 4e4: what remains is the work, not the start.
    assert many.seconds > 100 * few.seconds
    single = cost_of(load_experiment("ramp", {"draws": 100_000_000, "precision": "float32"})[1])
    assert single.seconds is not None
    assert single.seconds < many.seconds


def test_sweeps_with_methods_of_their_own_are_counted_by_them() -> None:
    # 21 faults: 20,000 draws of 23 methods at four epochs, 100,000 draws of 9 tests at one and of 7 at three; and
    # 48 epochs with 2,000 draws of the methods and 5,000 of the 7 tests.
    cost = cost_of(load_experiment("compare-methods")[1])
    epochs = 4 * 20_000 * 23 + 100_000 * 9 + 3 * 100_000 * 7
    assert cost.scenarios == 21 * (epochs + 48 * (2_000 * 23 + 5_000 * 7))


def test_a_service_volume_costs_one_draw_of_a_method_whose_levels_are_of_the_geometry() -> None:
    given = {"methods": [{"name": "igg3"}, {"name": "araim"}], "step_deg": 30.0, "duration_s": 1000.0}
    cost = cost_of(load_experiment("service-volume", given)[1])
    # 72 cells and 4 epochs of 300 s.
    assert cost.scenarios == 72 * 4 * (100 + 1)
    assert cost.seconds is not None


def test_a_noise_experiment_costs_its_exposures_and_rare_events_too() -> None:
    content = tomllib.loads(template(load_experiment("noise-sensitivity")[1]))
    cheap, dear = (
        cost_of(build_experiment(content | {"exposure": {"taus_s": [1.0], "draws": draws}}, source="t"))
        for draws in (100, 1_000_000)
    )
    assert cheap.seconds is not None
    assert dear.seconds is not None
    assert cheap.scenarios == dear.scenarios
    # 150 samples of each, by 3 methods, at some 2e6 a second.
    assert dear.seconds - cheap.seconds == pytest.approx(225, rel=1e-2)
    assert "as if all 18 rare events" in cheap.text()


@pytest.mark.parametrize(
    ("name", "change", "field", "words"),
    [
        ("time-ramps", {"sequential": [{"name": "kalmann"}]}, "sequential.0", "nearest: kalman"),
        ("time-ramps", {"satellite": "G99"}, "satellite", "not in view"),
        ("service-volume", {"error_model": "residuals"}, "error_model", "nearest: residual"),
        ("service-volume", {"operations": ["LPV-20"]}, "operations", "nearest: LPV-200"),
        ("service-volume", {"step_deg": 7.0}, "step_deg", "divides 180 deg"),
        ("service-volume", {"site": "CUTO"}, "site", "nearest: CUT0"),
        ("service-volume", {"constellations": ["GPSS"]}, "constellations", "nearest: GPS"),
        ("service-volume", {"start": "yesterday"}, "start", "as in 2017-11-21T00:00:00"),
        ("time-ramps", {"onset_s": 1e5}, "onset_s", "between the first and the last epoch"),
        ("time-ramps", {"calibration_draws": 200, "p_fa": 1e-3}, "calibration_draws", "from 10000"),
        ("stanford", {"reach_m": 20.0}, "reach_m", "alert limit of 35 m"),
        ("integrity-risk", {"geometry": {"epochs": 3}}, "geometry.epoch", "one epoch"),
        (
            "noise-sensitivity",
            {"exposure": {"taus_s": [1.0], "duration_s": 10.0, "interval_s": 3.0}},
            "exposure.interval_s",
            "whole intervals",
        ),
        ("service-volume", {"durations_s": [1e6]}, "durations_s", "288 epochs"),
        ("noise-sensitivity", {"rare": {"methods": ["ig3"]}}, "rare.methods", "nearest: igg3"),
        ("noise-sensitivity", {"faults": {"satellite": "G99", "sizes_m": [5]}}, "faults.satellite", "not in view"),
        (
            "compare-methods",
            {
                "equal": {
                    "draws": 10,
                    "faults": {"satellite": "G09", "start_m": 1.0, "stop_m": 2.0, "step_m": 1.0},
                    "methods": [{"name": "slope"}, {"name": "paritty"}],
                }
            },
            "equal.methods.1",
            "nearest: parity",
        ),
    ],
)  # fmt: skip
def test_parts_of_single_kinds_are_checked(name: str, change: dict[str, Any], field: str, words: str) -> None:
    (problem,) = check_experiment(name, change).problems
    assert problem.field == field
    assert problem.line is not None
    assert words in problem.reason


@pytest.mark.parametrize(("field", "words"), [("almanac", "almanac week.alm"), ("sp3", "week.alm")])
def test_an_almanac_of_a_simulated_series_is_hashed_and_told(tmp_path: Path, field: str, words: str) -> None:
    for name in ("zhao2021-static", "guo2022"):
        record = load_experiment(name)[1]
        assert record.input_files() == {}
        content = record.model_dump() | {"source": {"kind": "site", field: str(tmp_path / "week.alm")}}
        content = {key: value for key, value in content.items() if value is not None}
        changed = build_experiment(content, source="t")
        assert changed.input_files() == {f"source.{field}": tmp_path / "week.alm"}
        assert words in changed.source.describe()  # type: ignore[attr-defined]


def test_a_rate_is_not_in_seconds() -> None:
    assert meaning(KINDS["time-ramps"].model, "rates_m_per_s").endswith("[m/s]; 0 for the fault-free pass")
    assert "NPA" in meaning(KINDS["service"].model, "operations")


def test_a_measured_cost_is_of_this_machine() -> None:
    record = build_experiment(
        tomllib.loads(template_for("sweep")) | {"draws": 256, "methods": [{"name": "ls"}]}, source="t"
    )
    cost = cost_of(record, measure=True)
    assert cost.scenarios == 20 * 256
    assert cost.seconds is not None
    assert cost.seconds > 0
    assert "measured here" in cost.text()


def fields_within(record: BaseModel, above: str = "") -> Iterator[str]:
    """The fields of a record and of the records in it, by their path."""
    for field in type(record).model_fields:
        value = getattr(record, field)
        records = [one for one in (value if isinstance(value, tuple) else (value,)) if isinstance(one, BaseModel)]
        for k, one in enumerate(records):
            yield from fields_within(one, f"{above}{field}.{f'{k}.' if isinstance(value, tuple) else ''}")
        if not records:
            yield f"{above}{field}"


@pytest.mark.parametrize("name", sorted(experiment_files()))
def test_a_template_is_read_back_as_the_same_experiment(name: str) -> None:
    record = load_experiment(name)[1]
    text = template(record)
    assert build_experiment(tomllib.loads(text), source=name) == record
    # Every field is explained, those of the first of several like tables at least.
    lines, found = text.splitlines(), field_lines(text)
    for field in fields_within(record):
        index = next((part for part in field.split(".") if part.isdigit()), "0")
        if field in found and index == "0":
            assert lines[found[field] - 2].startswith("#"), field


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_field_of_every_kind_has_a_meaning(kind: str) -> None:
    """A field gets one by ``Field(description=...)``, by its record's docstring, or in `field_meanings`."""
    missing = [field for field in KINDS[kind].model.model_fields if not meaning(KINDS[kind].model, field)]
    assert missing == []
    for name in experiment_files():
        record = load_experiment(name)[1]
        if record.kind == kind:  # type: ignore[attr-defined]
            assert [one.field for one in assumed_of(record).conditions if not one.meaning] == []


def test_init_writes_what_check_and_run_accept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = checked(["init", "--out", "my.toml"], capsys)
    assert code == 0
    assert "my.toml" in out
    text = (tmp_path / "my.toml").read_text()
    assert "# Time between epochs [s]. [more than 0; default: 30.0]\ninterval_s = 30.0" in text
    assert "# k1 = 5.0" in text
    assert checked(["check", "my.toml"], capsys)[0] == 0
    # A file of the user's is never overwritten.
    code, _, err = checked(["init", "stanford", "--out", "my.toml"], capsys)
    assert code == 2
    assert "a file of that name is there" in err
    assert (tmp_path / "my.toml").read_text() == text
    code, out, _ = checked(["init", "map"], capsys)
    assert code == 0
    # A kind of earlier versions, in the words of this one.
    assert {"kind": "sweep", "view": "map"}.items() <= tomllib.loads(out).items()
    code, _, err = checked(["init", "swep"], capsys)
    assert code == 2
    assert "nearest: sweep" in err
    code, _, err = checked(["init", "--out", "nowhere/my.toml"], capsys)
    assert code == 2
    assert "cannot be written" in err
    assert [path.name for path in tmp_path.iterdir()] == ["my.toml"]


def test_a_file_of_a_former_kind_is_checked_as_what_it_is_today(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "old.toml"
    file.write_text(
        'kind = "map"\ntitle = "A map"\ndraws = 10\n[geometry]\nepochs = 2\ninterval_s = 3600.0\n'
        "[faults]\nstart_m = 10\nstop_m = 40\nstep_m = 15\n"
    )
    found = check_experiment(str(file))
    assert (found.problems, found.text()) == ((), "")
    assert found.experiment is not None
    assert found.experiment.kind == "sweep"  # type: ignore[attr-defined]
    file.write_text(file.read_text().replace("step_m", "steps_m"))
    code, _, err = checked(["check", str(file)], capsys)
    assert code == 2
    assert "old.toml:10: faults.steps_m: there is no such field (nearest: step_m" in err


def test_a_file_of_ones_own_is_needed_to_observe(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(template_for("observe"))
    assert [one.field for one in check_experiment(str(file)).problems] == ["observations", "navigation"]


keys = st.text("abcdef_", min_size=1, max_size=4)
plain = st.integers(0, 9) | st.text("xy#[]= ", max_size=5) | st.lists(st.integers(0, 9), max_size=3)


@given(
    st.dictionaries(keys, plain, max_size=4),
    st.dictionaries(keys, st.dictionaries(keys, plain, max_size=3), max_size=3),
)
def test_lines_of_fields_are_where_they_are(fields: dict[str, Any], tables: dict[str, dict[str, Any]]) -> None:
    """Written line by line, some lists over several lines: each field is found on the line on which it was put."""
    lines: list[str] = []
    expected: dict[str, int] = {}

    def put(path: str, key: str, value: Any) -> None:
        expected[path] = len(lines) + 1
        text = json.dumps(value)
        lines.extend(
            [f"{key} = [ # open [", *(f"  {one}," for one in value), "]"]
            if isinstance(value, list)
            else [f"{key} = {text}"]
        )

    for key, value in fields.items():
        put(key, key, value)
    for name, table in tables.items():
        if name in fields:
            continue
        lines.append(f"[{name}]")
        expected[name] = len(lines)
        for key, value in table.items():
            put(f"{name}.{key}", key, value)
    text = "\n".join(lines)
    assert set(tomllib.loads(text)) == {path.split(".")[0] for path in expected}
    assert field_lines(text) == expected


@pytest.mark.parametrize("name", ["frontier", "igg3-tuning", "integrity-risk", "time-ramps"])
def test_single_precision_is_refused_where_it_would_do_nothing(name: str) -> None:
    with pytest.raises(InputError, match="precision: this kind computes in double precision alone"):
        load_experiment(name, {"precision": "float32"})


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.2, "1 s"), (89, "89 s"), (90, "1.5 min"), (5_000, "83 min"), (5_400, "1.5 h"), (86_400, "24.0 h"),
     (172_800, "2.0 days"), (670_000, "7.8 days"), (1e8, "1,157 days")],
)  # fmt: skip
def test_times_are_told_in_the_unit_that_people_take(seconds: float, said: str) -> None:
    assert duration_text(seconds) == said


def test_a_cost_of_days_is_told_in_days(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = checked(["check", "zhao2021-sweep", "--draws", "1000000"], capsys)
    assert code == 0
    assert re.search(r"over all methods, about \d+(\.\d)? days, about", out)
    # What a program costs that is compiled once and kept is told apart.
    assert "the first run compiles and takes about 6 s more" in out
