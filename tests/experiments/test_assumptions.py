"""What was assumed: every field and option that decides a number is told, and what nobody typed is called a default."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from pl_mc.experiments.assuming import TOPICS, UNSAID, assumed_of
from pl_mc.experiments.field_meanings import _choices
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.source_files import experiment_files
from pl_mc.report.assumed import Condition
from pl_mc.report.run_folder import flat_fields
from pl_mc.studies.registry import KINDS
from pl_mc.studies.spec import Experiment

SMALL: dict[str, Any] = {
    "kind": "sweep", "title": "Small", "draws": 300, "geometry": {"epoch": 2},
    "faults": {"satellite": "G02", "start_m": 10, "stop_m": 40, "step_m": 15},
}  # fmt: skip


def conditions(**changes: Any) -> dict[str, Condition]:
    return {one.field: one for one in assumed_of(build_experiment(SMALL | changes, source="test")).conditions}


def test_every_field_of_every_kind_has_one_topic() -> None:
    placed = [field for fields in TOPICS.values() for field in fields]
    assert len(placed) == len(set(placed))
    fields = {field for study in KINDS.values() for field in study.model.model_fields}
    # Experiments of a kind carry no field without a topic, and no topic has one that no kind knows.
    assert fields - set(UNSAID) == set(placed)


@pytest.mark.parametrize("name", sorted(experiment_files()))
def test_every_field_of_every_shipped_experiment_is_told(name: str) -> None:
    experiment = load_experiment(name)[1]
    told = {one.field for one in assumed_of(experiment).conditions}

    def is_told(leaf: str) -> bool:
        # Lists of lists and of tables are told whole, and the name of a method by the place of its table.
        if leaf in told or leaf.removesuffix(".name") in told:
            return True
        above = [leaf.rsplit(".", k)[0] for k in range(1, leaf.count(".") + 1)]
        return any(one in told and not any(other.startswith(f"{one}.") for other in told) for one in above)

    leaves = flat_fields(experiment.model_dump(mode="json"))
    assert [leaf for leaf in leaves if leaf not in UNSAID and not is_told(leaf) and not leaf.endswith(".epoch")] == []


def changed(record: BaseModel, above: str = "") -> Iterator[tuple[str, Any]]:
    """A record with each of its numbers and words another one, one at a time."""
    for field in type(record).model_fields:
        value, path = getattr(record, field), f"{above}{field}"
        if isinstance(value, BaseModel):
            yield from ((name, record.model_copy(update={field: one})) for name, one in changed(value, f"{path}."))
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            for name, one in changed(value[0], f"{path}.0."):
                yield name, record.model_copy(update={field: (one, *value[1:])})
        elif isinstance(value, bool):
            yield path, record.model_copy(update={field: not value})
        elif isinstance(value, int | float):
            yield path, record.model_copy(update={field: value + 1})
        elif isinstance(value, str) and field != "kind":
            choices = [one for one in _choices(type(record).model_fields[field].annotation) if one != value]
            other = "APV-I" if field == "alert" else choices[0] if choices else f"{value}x"
            yield path, record.model_copy(update={field: other})
        elif isinstance(value, tuple) and value and field != "axes":
            yield path, record.model_copy(update={field: (*value, value[0])})


@pytest.mark.parametrize("name", ["ramp", "frontier", "guo2022", "integrity-risk", "noise-sensitivity", "observe-day",
                                  "zhao2021-static", "service-volume", "stanford", "time-ramps", "igg3-tuning",
                                  "igg3-variants", "compare-methods", "zhao2021-readings"])  # fmt: skip
@pytest.mark.filterwarnings("ignore:Pydantic serializer warnings")
def test_another_number_in_any_field_is_another_text(name: str) -> None:
    experiment = load_experiment(name)[1]
    before = assumed_of(experiment).markdown(experiment.title)
    silent = []
    for field, other in changed(experiment):
        assert isinstance(other, Experiment)
        if field.split(".")[0] not in UNSAID and assumed_of(other).markdown(experiment.title) == before:
            silent.append(field)
    assert silent == []


def test_defaults_are_called_so_typed_or_not() -> None:
    found = conditions(methods=[{"name": "igg3", "k0": 2.0}, {"name": "igg3", "k1": 6.0}, "araim"])
    assert found["methods.0.k0"].sentence == (
        "`methods.0.k0` is `2`: standardised residuals where the weight begins to fall and where it reaches zero."
    )
    assert found["methods.0.k1"].said == "5 (by default)"
    # Of a second one of a name what is not said of the first.
    assert found["methods.1.k1"].said == "6"
    assert found["methods.1.k0"].said == "1.5 (by default)"
    assert "methods.1.scale" not in found
    assert found["methods.1"].meaning.endswith("; its further options are by default, as said of the first one")
    assert found["geometry.mask_deg"].sentence == "`geometry.mask_deg` is `10`, by default: elevation mask [deg]."
    assert found["draws"].said == "300"
    assert found["seed"].said == "20171121 (by default)"
    assert found["geometry.error_model.sigma0_gps_m"].said == "0.3 (by default)"
    assert found["methods.2.p_sat"].said == "1e-5 (by default)"
    assert found["methods.2.budget.p_hmi_vertical"].said == "9.8e-8 (by default)"
    assert found["methods.2.budget.exposure_h"].meaning == "how long the operation is exposed to faults [h]"


def test_a_message_takes_the_place_of_an_option_s_default(tmp_path: Path) -> None:
    ism = tmp_path / "mine.csv"
    ism.write_text("satellite,b_nom_m,p_sat,p_const\nG,0.75,1e-5,1e-4\nC,0.75,1e-5,1e-4\n")
    found = conditions(methods=[{"name": "araim", "ism": str(ism)}])
    assert found["methods.0.ism"].said == "mine.csv"
    assert not {"methods.0.p_sat", "methods.0.p_const", "methods.0.b_nom_m"} & set(found)
    by_message = {"name": "araim", "ism": str(ism)}
    found = conditions(methods=[by_message, {"name": "araim", "p_sat": 1e-4}, {"name": "araim", "b_nom_m": 0.5}])
    assert [found[f"methods.{k}.p_sat"].said for k in (1, 2)] == ["1e-4", "1e-5 (by default)"]
    assert found["methods.1.b_nom_m"].said == "0.75 (by default)"
    found = conditions(methods=[{"name": "araim", "ism": {"p_sat": 1e-4, "p_const": 0.0, "b_nom_m": 0.5}}])
    assert found["methods.0.ism.p_sat"].sentence == (
        "`methods.0.ism.p_sat` is `1e-4`: prior probability of a fault of the satellite."
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "those of LPV-200, VAL 35 m and HAL 40 m; the vertical limit decides."),
        ({"axes": ["vertical", "either"]}, "the vertical limit decides and, apart, either limit decides."),
        ({"alert": {"horizontal_m": 12}}, "those of own limits, HAL 12 m; the horizontal limit decides."),
    ],
)
def test_limits_are_told_in_metres(changes: dict[str, Any], words: str) -> None:
    lead = assumed_of(build_experiment(SMALL | changes, source="test")).lead
    assert words in lead[0]
    assert any("95 % Clopper-Pearson" in sentence for sentence in lead)
    assert any("misleading information (MI)" in sentence and "(HMI)" in sentence for sentence in lead)


def test_the_errors_of_a_receiver_are_its_own() -> None:
    lead = assumed_of(load_experiment("observe-day")[1]).lead
    assert (
        "The errors of a receiver's files are its own, whatever their law; faults are added to its pseudoranges."
        in lead
    )


def test_a_frontier_does_not_say_that_its_multipliers_are_defaults() -> None:
    lead = " ".join(assumed_of(load_experiment("frontier")[1]).lead)
    assert "Multipliers of levels that scale with one (k_vertical, k_horizontal) are found at each geometry" in lead
    assert "are of threefry2x32" in lead
    assert "and of random places are NumPy's" in lead
    assert "a hazard is: " in lead
