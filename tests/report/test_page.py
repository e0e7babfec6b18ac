"""``report.html`` as text: complete in itself, small, with the numbers of the tables and nothing that breaks "
"out."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image, ImageDraw
from stored_runs import CAPTION, counts, store_run

from pl_mc.experiments.assuming import assumed_of
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.reading import document_of_files, remake_page
from pl_mc.input_errors import InputError
from pl_mc.report.charts import charts_of
from pl_mc.report.document import Document, FigureEntry, TableEntry
from pl_mc.report.page import MOST_BYTES, _inline, page_figures, page_of_run, write_page
from pl_mc.report.run_folder import RunFolder, flat_fields, read_run_folder
from pl_mc.studies import sweep
from pl_mc.studies.registry import KINDS, study_of
from pl_mc.studies.spec import Experiment

pytestmark = pytest.mark.drawn

RESULTS = Path(__file__).parents[2] / "results"
STORED = sorted(path.parent for path in RESULTS.glob("*/manifest.json"))
OUTSIDE = re.compile(r"""(?:src|href)\s*=\s*["'](?!data:|#)([^"']*)|url\(|@import|fetch\(|XMLHttpRequest""")


def page_of(run: RunFolder) -> str:
    return page_of_run(run, shown_as=run.folder)


def document_of(run: RunFolder) -> Document:
    assert run.document is not None
    return run.document


def experiment_of(run: RunFolder) -> Experiment:
    return build_experiment(run.experiment, source="manifest.json")


def charts_in(run: RunFolder) -> list[dict[str, Any]]:
    document = document_of(run)
    return charts_of(document.tables, run.tables, val_m=document.val_m)


def test_a_page_has_its_parts_and_refers_to_nothing_outside(small_run: Path) -> None:
    run = read_run_folder(small_run)
    write_page(run, assumed=assumed_of(experiment_of(run)))
    text = (small_run / "report.html").read_text()
    for part in ("What was asked", "The answer", "Charts", "Figures", "Tables", "What was assumed", "How to redo it"):
        assert f"<h2>{part}</h2>" in text
    # Links to the files beside it are the only ones; nothing is loaded.
    outside = {match[1] for match in OUTSIDE.finditer(text)}
    assert outside <= {"rates.csv", "rates.png", "rates.svg"}
    assert "http" not in re.sub(r'http-equiv|"http://www.w3.org/2000/svg"', "", text)
    assert "noise draws for each fault" in text
    assert '<td>methods.1.k0</td><td class="wide">1.5 (by default)</td>' in text
    assert "The alert limits are those of LPV-200, VAL 35 m and HAL 40 m; the vertical limit decides." in text
    assert f"pl-mc run {small_run.as_posix()}/manifest.json" in text
    # What users write is text, never part of the page.
    assert "<b>for</b>" not in text
    assert "A ramp &lt;b&gt;for&lt;/b&gt; tests &amp; more" in text


def test_headings_say_what_columns_mean_and_methods_have_short_names(tmp_path: Path) -> None:
    long = "w_test(alpha=0.00085966165196832,exclusions=0,final=local)"
    rates = counts({"ls": (0, 9, 400, 400), long: (0, 0, 0, 0)}, methods=("ls", long))
    run = read_run_folder(store_run(tmp_path / "long", rates, with_figure=False))
    text = page_of_run(run, shown_as=run.folder)
    assert '<th scope="col" class="number" title="draws with the event missed, hazard and no alarm">missed</th>' in text
    assert "<td>w_test(...)</td>" in text
    assert "alpha=0.00085966165196832, exclusions=0, final=local" in text
    assert '"curves":["least squares (VPL)","w_test(...)"]' in text
    # Curves are called what the literature calls them.
    assert '{"label":"misleading information (MI)","rate":true}' in text
    assert '{"label":"hazardously misleading information (HMI)","rate":true}' in text


def test_powers_of_ten_have_one_form_in_texts_too() -> None:
    said = "Target 9.8e-08, at 1.27e+06 m [1e-07, 2e-10] for w_test(p_fa=1e-05) of 3e-05x; `1e-09`."
    assert _inline(said) == (
        "Target 9.8e-8, at 1.27e6 m [1e-7, 2e-10] for w_test(p_fa=1e-05) of 3e-05x; <code>1e-9</code>."
    )


def test_figures_whose_shades_have_a_meaning_are_not_turned_round(tmp_path: Path) -> None:
    lines, areas = Image.new("RGB", (600, 400), "white"), Image.new("RGB", (600, 400), "#1f77b4")
    ImageDraw.Draw(lines).line((0, 0, 600, 400), fill="#d55e00", width=3)
    lines.save(tmp_path / "lines.png")
    areas.save(tmp_path / "areas.png")
    lines.save(tmp_path / "named.png")
    words = {"lines": "Drawn in it: bias [m].", "areas": "Drawn in it: latitude.", "named": "Drawn in it: white: none."}
    entries = [FigureEntry(name, "Rates.", f"Rates. {said}") for name, said in words.items()]
    figures = page_figures(tmp_path, entries, most_bytes=1_000_000)
    assert [figure.as_it_is for figure in figures] == [False, True, True]


def test_the_answer_gives_the_numbers_of_the_table(small_run: Path) -> None:
    run = read_run_folder(small_run)
    alarms, misleading, missed = document_of(run).answer
    # What is read back from files says the same.
    assert KINDS["sweep"].answer(run.tables, experiment_of(run)) == document_of(run).answer
    assert "least squares (VPL) most often at G07:+55m, all (> 99.1 %)" in alarms
    assert (
        "IGG-III (VPL_R) never, under any of 4 faults, with at least 400 draws of noise each (below 0.918 %)" in alarms
    )
    for sentence in (misleading, missed):
        assert "least squares (VPL) and IGG-III (VPL_R) never" in sentence
    assert "35 m" in missed


def test_zero_alarms_are_never_called_zero_risk(small_run: Path) -> None:
    """The bound of a zero is that of its draws: 1 - 0.025^(1/400)."""
    table = read_run_folder(small_run).tables["rates"]
    zero = table[table.alarms == 0]
    assert len(zero)
    np.testing.assert_allclose(zero.alarm_high, 1 - 0.025 ** (1 / 400), rtol=1e-12)


def test_charts_hold_the_counts_of_the_table(small_run: Path) -> None:
    run = read_run_folder(small_run)
    (chart,) = charts_in(run)
    assert chart["title"] == "Rates of events against the bias"
    assert chart["curves"] == ["least squares (VPL)", "IGG-III (VPL_R)"]
    assert chart["menus"] == []
    assert chart["quantities"][0] == {"label": "alarm", "rate": True}
    drawn = {(row[0], row[1]): row[3:7] for row in chart["rows"]}
    for curve, (_, group) in enumerate(run.tables["rates"].groupby("method", sort=False)):
        for row in group.itertuples():
            rate, low, high, count = drawn[curve, row.bias_m]
            assert count == row.alarms
            np.testing.assert_allclose([rate, low, high], [row.alarm_rate, row.alarm_low, row.alarm_high], rtol=1e-3)


def test_columns_that_tell_rows_apart_become_menus(small_run: Path) -> None:
    run = read_run_folder(small_run)
    rates = run.tables["rates"]
    both = pd.concat([rates.assign(satellite="G07"), rates.assign(satellite="G08")])
    (entry,) = document_of(run).tables
    assert entry.chart is not None
    told = TableEntry("both", replace(entry.chart, menus=("satellite",)))
    (chart,) = charts_of([told], {"both": both}, val_m=35.0)
    assert [(menu["label"], menu["values"]) for menu in chart["menus"]] == [("satellite", ["G07", "G08"])]
    # Where all rows are of one satellite there is nothing to choose.
    (chart,) = charts_of([told], {"both": both[both.satellite == "G08"]}, val_m=35.0)
    assert chart["menus"] == []
    # Rows that nothing tells apart cannot be drawn as curves.
    assert charts_of([entry], {"rates": pd.concat([rates, rates])}, val_m=35.0) == []


def test_what_is_not_said_to_be_drawn_is_not(small_run: Path) -> None:
    run = read_run_folder(small_run)
    assert charts_of([TableEntry("rates")], run.tables, val_m=35.0) == []
    (entry,) = document_of(run).tables
    # A table that is gone has no chart; one that lacks a column is refused by name.
    assert charts_of([entry], {}, val_m=35.0) == []
    with pytest.raises(InputError, match=r"rates: its chart needs columns that are not there: alarm_low\."):
        charts_of([entry], {"rates": run.tables["rates"].drop(columns="alarm_low")}, val_m=35.0)
    few = run.tables["rates"][run.tables["rates"].bias_m < 30]
    assert charts_of([entry], {"rates": few}, val_m=35.0) == []


def test_data_of_a_chart_cannot_close_its_element(tmp_path: Path) -> None:
    table = counts({"ls": (1, 2, 3, 4), "igg3": (0, 0, 0, 0)})
    table["method"] = table.method.replace("igg3", "</script><script>alert(1)</script>")
    folder = store_run(tmp_path / "run", table, with_figure=False)
    text = page_of(read_run_folder(folder))
    assert "<script>alert" not in text
    data = re.search(r'id="chart-data">(.*?)</script>', text, re.DOTALL)
    assert data
    assert json.loads(data[1])[0]["curves"][1] == "</script><script>alert(1)</script>"


def test_heavy_figures_are_made_lighter_or_named(tmp_path: Path) -> None:
    grey = np.add.outer(np.arange(300), np.arange(400)) * 0.3 + np.random.default_rng(1).normal(0, 4, (300, 400))
    colours = np.stack([grey, 255 - grey, np.full_like(grey, 90)], axis=-1).clip(0, 255).astype(np.uint8)
    Image.fromarray(colours).save(tmp_path / "rates.png")
    entries = [FigureEntry("rates", "c.", "c. Drawn in it: x."), FigureEntry("gone", "Taken out.", "Taken out.")]
    (full,) = page_figures(tmp_path, entries, most_bytes=10**6)
    assert full.data.startswith("data:image/png;base64,")
    assert full.size == (256, 192)
    lengths = [len(full.data)]
    for _ in range(2):
        # First fewer colours, then half the size.
        lighter = page_figures(tmp_path, entries, most_bytes=lengths[-1] - 1)[0]
        lengths.append(len(lighter.data))
        assert lighter.size == full.size
    assert lengths[0] > lengths[1] > lengths[2] > 0
    none = page_figures(tmp_path, entries, most_bytes=100)[0]
    assert none.data == ""
    assert none.files == ("rates.png",)
    assert none.alt == full.alt


def test_the_text_in_place_of_a_figure_says_what_is_drawn(small_run: Path) -> None:
    (figure,) = page_figures(small_run, document_of(read_run_folder(small_run)).figures, most_bytes=10**6)
    for drawn in (CAPTION, "P(alarm)", "G07:+25m", "IGG-III (VPL_R)"):
        assert drawn in figure.alt
    # Numbers along an axis say nothing, nor do the marks that powers of ten are set with.
    assert "10^" not in figure.alt
    assert figure.caption == CAPTION


@pytest.mark.parametrize("folder", STORED, ids=lambda folder: folder.name)
def test_every_stored_result_has_three_sentences_with_numbers(folder: Path) -> None:
    run = read_run_folder(folder)
    experiment = experiment_of(run)
    # Where a table is too large to be kept, the answer that the run stored is.
    answer = run.document.answer if run.document else study_of(experiment).answer(run.tables, experiment)
    # Three by each limit that decides, where several do.
    assert len(answer) == 3 * max(len(experiment.judged_axes()), 1)
    for sentence in answer:
        assert re.search(r"\d", sentence)
        assert "nan" not in sentence
        assert sentence.endswith(".")
    document = run.document or document_of_files(run, experiment)
    assert {entry.name for entry in document.figures} == set(run.figures)
    assert all(entry.caption.endswith(".") for entry in document.figures)


@pytest.mark.parametrize("name", ["igg3-variants", "guo2022-esbc"])
def test_the_largest_results_stay_below_the_limit(name: str) -> None:
    """The one with the heaviest figures and the one with the longest tables."""
    folder = RESULTS / name
    if not folder.is_dir():
        pytest.skip("the stored results are not here")
    run = read_run_folder(folder)
    if run.document is None:
        run = replace(run, document=document_of_files(run, experiment_of(run)))
    text = page_of(run)
    assert len(text.encode()) < MOST_BYTES
    assert "too large for this page" not in text
    assert text.count("<img ") == len(run.figures)


def test_every_kind_asks_a_question_of_its_own() -> None:
    questions = [study.question for study in KINDS.values() if isinstance(study.question, str)]
    questions += sweep.QUESTIONS.values()
    assert len(questions) == len(KINDS) - 1 + 3
    assert all(question.endswith("?") for question in questions)
    assert len(set(questions)) == len(questions)


def test_noise_models_are_told_beside_the_gaussian_one(tmp_path: Path) -> None:
    """Of the models but the Gaussian one the sentence names the one with the most alarms; charts get a menu."""
    parts = [
        counts({"ls": alarms, "igg3": (0, 0, 0, 0)}).assign(noise=noise)
        for noise, alarms in (("gaussian", (0, 1, 2, 0)), ("student_t", (0, 9, 40, 0)), ("multipath", (3, 0, 0, 0)))
    ]
    folder = store_run(tmp_path / "run", pd.concat(parts, ignore_index=True), with_figure=False, menus=("noise",))
    run = read_run_folder(folder)
    alarms, *others = KINDS["noise"].answer(run.tables, experiment_of(run))
    assert "least squares (VPL) 0.5 %" in alarms
    assert "at G07:+40m with gaussian, 10 %" in alarms
    assert "at G07:+40m with student_t, the most" in alarms
    assert "IGG-III (VPL_R) 0 (< 0.918 %) with gaussian, 0 (< 0.918 %) with any other model" in alarms
    assert len(others) == 2
    (chart,) = charts_in(run)
    assert chart["menus"][0]["values"] == ["gaussian", "student_t", "multipath"]


def test_leaves_of_an_experiment_have_paths() -> None:
    content = {"a": {"b": 1, "c": [1, 2]}, "d": [{"e": 3}, {"f": []}], "g": None}
    assert flat_fields(content) == {"a.b": 1, "a.c": [1, 2], "d.0.e": 3, "d.1.f": [], "g": None}


def test_what_is_no_run_is_refused(tmp_path: Path, small_run: Path) -> None:
    with pytest.raises(InputError, match="no such results folder"):
        remake_page(tmp_path / "nothing")
    with pytest.raises(InputError, match="holds no finished run"):
        remake_page(tmp_path)
    (tmp_path / "manifest.json").write_text("[]")
    with pytest.raises(InputError, match="no manifest"):
        remake_page(tmp_path)
    assert not (tmp_path / "report.html").exists()
    # An experiment that this version does not know still has a page.
    made = store_run(tmp_path / "old", counts({"ls": (0, 0, 0, 1), "igg3": (0, 0, 0, 0)}), with_figure=False)
    manifest = json.loads((made / "manifest.json").read_text())
    manifest["experiment"]["forgotten_field"] = 3
    (made / "manifest.json").write_text(json.dumps(manifest))
    assert remake_page(made).page == "report.html"
    assert "forgotten_field" in (made / "report.html").read_text()
    # Without what it said itself there is nobody to ask.
    (made / "report.json").unlink()
    with pytest.raises(InputError, match=r"holds no report\.json, and its experiment is not one .*forgotten"):
        remake_page(made)
