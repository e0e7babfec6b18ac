"""What words mean: every event, column of counts, method, option and field has a sentence, in the records' words."""

from __future__ import annotations

import dataclasses
import json

import pytest

from pl_mc.cli.main import main
from pl_mc.engine.table import COUNT_COLUMNS
from pl_mc.experiments.explaining import explain
from pl_mc.input_errors import InputError
from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.methods.registry import METHODS
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
