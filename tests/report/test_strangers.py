"""The page of a stranger's folder: a sentence or a page that asks for nothing from anywhere, soon, and whole."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from pl_mc.experiments.reading import remake_page
from pl_mc.input_errors import InputError
from pl_mc.report import page

pytestmark = pytest.mark.drawn

RUN = Path(__file__).parents[2] / "results" / "ramp"
BAIT = "![x](https://a.example/x.png) <img src='https://a.example/y.png'> [z](https://a.example) <https://a.example>"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "run"
    shutil.copytree(RUN, place)
    (place / "report.html").unlink()
    return place


def change(folder: Path, name: str, act: Callable[[Any], Any]) -> None:
    content = json.loads((folder / name).read_text(encoding="utf-8"))
    given = act(content)
    (folder / name).write_text(json.dumps(content if given is None else given), encoding="utf-8")


LOADING = {"img", "script", "link", "iframe", "object", "embed", "source", "video", "audio", "input", "use", "image"}


def requests_of(text: str) -> list[str]:
    """What a browser would ask for: addresses of pictures, links of styles, scripts from elsewhere."""
    found: list[str] = []

    class Tags(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            loads = {"src", "data", "poster", "srcset"} | ({"href", "xlink:href"} if tag in LOADING else set())
            found.extend(str(value) for name, value in attrs if name in loads)

    Tags().feed(text)
    styles = "".join(re.findall(r"<style>(.*?)</style>", text, re.DOTALL))
    found += re.findall(r"(?:url\(|@import)[^;]*", styles)
    return [one for one in found if not one.startswith("data:")]


def test_texts_of_strangers_ask_for_nothing(folder: Path) -> None:
    def bait(content: Any) -> Any:
        if isinstance(content, dict):
            # Names of files and columns are checked, not shown.
            kept = ("name", "form", "kind", "chart")
            return {key: value if key in kept else bait(value) for key, value in content.items()}
        if isinstance(content, list):
            return [bait(one) for one in content]
        return f"{content} {BAIT}" if isinstance(content, str) else content

    change(folder, "report.json", bait)
    change(folder, "manifest.json", lambda content: content | {field: bait(content[field]) for field in ("versions",)})
    remake_page(folder)
    text = (folder / page.PAGE).read_text(encoding="utf-8")
    assert "a.example" in text
    assert requests_of(text) == []
    # And of an older run, whose summary is read.
    (folder / "report.json").unlink()
    summary = folder / "summary.md"
    summary.write_text(
        summary.read_text(encoding="utf-8") + f"\n\n{BAIT}\n\n- {BAIT}\n\n| {BAIT} |\n|---|\n| {BAIT} |\n"
    )
    remake_page(folder)
    text = (folder / page.PAGE).read_text(encoding="utf-8")
    assert "a.example" in text
    assert requests_of(text) == []


@pytest.mark.parametrize(
    "act",
    [
        lambda m: m.pop("versions"),
        lambda m: m.update(versions={}),
        lambda m: m.update(versions=7),
        lambda m: m.update(machine="x", noise=[1], inputs=None),
        lambda m: m.update(inputs={"a": {}, "b": 7, "c": {"file": 5}}),
        lambda m: m.update(seconds="long"),
        lambda m: m.update(seconds=[]),
        lambda m: m.update(seconds=1e300),
        lambda m: m.update(notes="word"),
        lambda m: m.update(notes={"a": 1}),
        lambda m: m.update(experiment={}),
        lambda m: m["experiment"].update(title=7),
        lambda m: m["experiment"].update(draws="many"),
        lambda m: m["experiment"].update(draws=10**400),
    ],
)
def test_manifests_of_any_form_make_a_page(folder: Path, act: Callable[[Any], Any]) -> None:
    change(folder, "manifest.json", lambda content: (act(content), None)[1])
    remake_page(folder)
    assert (folder / page.PAGE).read_text(encoding="utf-8").rstrip().endswith("</html>")


def _words(folder: Path) -> None:
    text = (folder / "rates.csv").read_text(encoding="utf-8").split("\n")
    (folder / "rates.csv").write_text("\n".join([text[0], re.sub(r"\d", "x", text[1]), *text[2:]]), encoding="utf-8")


def _link(name: str) -> Callable[[Path], None]:
    def act(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder.parent / "secret").write_text("secret,1\n1,2\n", encoding="utf-8")
        (folder / name).symlink_to(folder.parent / "secret")

    return act


def _pipe(name: str) -> Callable[[Path], None]:
    def act(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return act


def _report(**fields: Any) -> Callable[[Path], None]:
    return lambda folder: change(folder, "report.json", lambda content: content | fields)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda f: (f / "manifest.json").write_bytes(b"{\xff}"), "not UTF-8"),
        (lambda f: (f / "manifest.json").write_text("[" * 5000), "nested too deeply"),
        (lambda f: change(f, "manifest.json", lambda m: m | {"name": None}), "name: a word is needed"),
        (lambda f: change(f, "manifest.json", lambda m: m | {"experiment": 7}), "no manifest of a run"),
        (_words, "rates.csv: .* a number in every row|no page can be made|rates"),
        (_link("rates.csv"), "a link out of the folder"),
        (_link("summary.md"), "a link out of the folder"),
        (_pipe("rates.csv"), "no regular file"),
        (_pipe("manifest.json"), "no regular file"),
        (_pipe("summary.md"), "no regular file"),
        (_report(more=1), "no report of a run .more: "),
        (_report(kind="../../x"), "no report of a run .kind: "),
        (_report(kind=7), "no report of a run .kind: "),
        (_report(title=None), "no report of a run .title: "),
        (_report(tables=[{"name": "../x"}]), "no report of a run .tables: '../x' is no name"),
        (_report(tables=[{"name": "a/b"}]), "tables: 'a/b' is no name"),
        (_report(tables=[{"name": "rates"}, {"name": "rates"}]), "tables: two have one name"),
        (_report(figures=[{"name": "/etc/x", "caption": "", "alt": ""}]), "figures: '/etc/x' is no name"),
        (_report(summary=[{"form": "script", "text": "x"}]), "no report of a run .summary.0"),
        (_report(val_m="tall"), "no report of a run .val_m"),
        (lambda f: (f / "report.json").write_bytes(b"\xff"), "not UTF-8"),
        (lambda f: (f / "report.json").write_text(" " * 9_000_000), "more than 8 MB"),
    ],
)
def test_folders_of_which_no_page_is_made(folder: Path, act: Callable[[Path], Any], words: str) -> None:
    act(folder)
    begin = time.perf_counter()
    with pytest.raises(InputError, match=words) as caught:
        remake_page(folder)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
    assert time.perf_counter() - begin < 10
    assert not (folder / page.PAGE).exists()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("rates.svg", b"<svg>" + b"<text" * 4_000_000),
        ("rates.svg", b"\xff\xfe<svg"),
        ("rates.svg", b"<svg onload='x()'><script>x()</script><image href='https://a.example'/></svg>"),
        ("rates.png", b"no picture"),
        ("rates.png", (RUN / "rates.png").read_bytes()[:300]),
        ("rates.png", b""),
    ],
)
def test_pictures_of_any_content(folder: Path, name: str, content: bytes) -> None:
    """What is embedded is a picture to a browser, in which nothing runs and which asks for nothing."""
    (folder / name).write_bytes(content)
    begin = time.perf_counter()
    remake_page(folder)
    text = (folder / page.PAGE).read_text(encoding="utf-8")
    assert "x()" not in text
    assert requests_of(text) == []
    assert time.perf_counter() - begin < 10


def test_a_page_that_is_not_finished_leaves_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remake_page(folder)
    before = (folder / page.PAGE).read_bytes()

    def stopped(*paths: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", stopped)
    change(folder, "report.json", lambda content: content | {"question": "Another?"})
    with pytest.raises(KeyboardInterrupt):
        remake_page(folder)
    assert (folder / page.PAGE).read_bytes() == before
