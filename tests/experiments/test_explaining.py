"""What words mean: every event, column of counts, method, option and field has a sentence, in the records' words."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

from pl_mc.cli.main import main
from pl_mc.engine.table import COUNT_COLUMNS
from pl_mc.experiments.explaining import explain
from pl_mc.input_errors import InputError
from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.methods.registry import METHODS
from pl_mc.report.columns import column_meaning, named_columns
from pl_mc.studies.registry import KINDS


def test_events_by_their_names_their_columns_and_the_literature_s() -> None:
    for event in (*EVENTS, *EXCLUSIONS):
        for word in (event.name, event.count, f"{event.name}_rate", f"{event.name}_low", f"{event.name}_high"):
            assert any(event.meaning in sentence for sentence in explain(word)), word
    assert explain("hmi") == explain("HMI")
    assert explain("HMI")[0] in explain("missed")
    assert explain("mi")[0].startswith("event misleading: exceeded and no alarm")
    assert explain("missed_low")[0] == "column: lower end of the 95 % interval of the rate of missed."
    for column in COUNT_COLUMNS:
        assert explain(column)


def test_every_method_and_kind_with_its_options_and_fields() -> None:
    for name, method in METHODS.items():
        assert any(sentence.startswith("method: ") for sentence in explain(name)), name
        if name in ("igg3", "araim", "separated"):
            for option in dataclasses.fields(method):
                assert any(name in sentence for sentence in explain(option.name)), option.name
    for kind, study in KINDS.items():
        assert any(sentence.startswith("kind of experiment: ") for sentence in explain(kind)), kind
        for field in study.model.model_fields:
            assert any(kind in sentence for sentence in explain(field)), (kind, field)


def test_what_many_have_alike_is_said_once() -> None:
    said = explain("level_scale")
    assert len(said) == len(set(said))
    assert said[0].startswith("option of methods (ls, igg3, igg3_gated, huber")


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    main(["explain", "k0"])
    assert capsys.readouterr().out.startswith("option of methods (igg3, igg3_gated): standardised residuals")
    main(["explain", "k0", "--json"])
    assert json.loads(capsys.readouterr().out) == explain("k0")
    with pytest.raises(InputError, match=r"^explain: 'mised' is no event, .*nearest: missed"):
        explain("mised")
    with pytest.raises(SystemExit, match="2"):
        main(["explain"])
    capsys.readouterr()
    main(["explain", "false", "alarm"])
    assert capsys.readouterr().out.splitlines() == explain("false_alarm")


def test_terms_and_operations() -> None:
    assert explain("lpv-200") == ["operation: VAL 35 m, HAL 40 m."]
    assert explain("RNP 0.1") == ["operation: HAL 185 m."]
    for word in ("VAL", "hal", "level", "k_50", "bias_m", "discontinuity", "filter_bank"):
        assert explain(word)
    assert explain("k_50_low") == ["column: lower end of the 95 % interval of k_50.", *explain("k_50")]


RESULTS = Path(__file__).parents[2] / "results"
# What is no experiment: measurements of the machine and of the tests themselves.
OTHERS = ("bench", "scaling", "fuzz", "conformance", "convergence")


def test_every_column_of_every_stored_table_has_a_meaning() -> None:
    silent = {}
    for path in sorted([*RESULTS.rglob("*.csv"), *RESULTS.rglob("*.parquet")]):
        if path.relative_to(RESULTS).parts[0] in OTHERS:
            continue
        columns = pq.read_schema(path).names if path.suffix == ".parquet" else pd.read_csv(path, nrows=0).columns
        silent |= {column: path.name for column in columns if not column_meaning(column)}
        for column in columns:
            assert explain(column)[0].strip(), column
    assert silent == {}


def test_columns_whose_names_rules_make() -> None:
    assert explain("vpl_95_m") == ["column: vpl that is not exceeded in 95 % of the draws [m]."]
    assert explain("alarm_rate_50m")[0].startswith("column: share of draws with the event alarm under 50 m on one")
    assert explain("within_6_low") == [
        "column: lower end of the 95 % interval of the rate of within_6.",
        "column: share of decided_6 passes whose alarm came at most 6 s after the hazard began.",
    ]
    assert (
        explain("alert_after_onset_50_high_s")[0] == "column: upper end of the 95 % interval of alert_after_onset_50_s."
    )
    assert explain("before_up_rms_m") == ["column: root mean square of the up error [m]; of the plain method."]
    assert explain("swamped_rate")[0].startswith("column: share of the draws: both: a good satellite is thrown out")
    for word in ("within_", "alarm_rate_m", "zzz_low", "before_zzz"):
        with pytest.raises(InputError):
            explain(word)
    # Nothing is said twice, and no column is called by two names of one meaning by mistake.
    assert len(named_columns()) == len(set(named_columns()))
