"""The site builds without a warning and asks for nothing from elsewhere."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GENERATOR = ("sphinx", "myst_parser", "myst_nb", "furo")
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in GENERATOR), reason="pl_mc[docs] is not installed"
)
@pytest.mark.timeout(600)
def test_the_site_builds_strictly_and_stands_alone(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-E", "-d", str(tmp_path / "read")]
    # How notebooks are compiled is what docs/conf.py says.
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    done = subprocess.run(
        [*command, "docs", str(site)], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=580,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        # Links that a reader may follow are no matter; what a browser loads by itself is.
        loaded = re.findall(r"<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)=\"([^\"]+)\"", text)
        assert loaded
        assert not [target for target in loaded if re.match(r"(?:https?:)?//", target)], page.name
        assert "system-message" not in text
        # No name of an attribute was taken for the type of another one.
        assert not re.search(r"\(<em>\w+</em><em>,", text), page.name
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", sheet.read_text(encoding="utf-8"))
    # Building ran the notebooks, which assert what they say; each shows what it drew.
    for notebook in NOTEBOOKS:
        text = (site / "notebooks" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        drawn = re.findall(r'src="\.\./(_images/\w+\.png)"', text)
        assert drawn, notebook.name
        assert all((site / name).stat().st_size > 5_000 for name in drawn)
        assert "What was learned" in text
    # Every experiment that comes along has its place in the gallery, with its command, its run and what that drew.
    experiments = sorted(path.stem for path in (ROOT / "experiments").glob("*.toml"))
    gallery = dict(re.findall(r'<section id="([\w-]+)">\n<h2>(.*?)</section>', _text(site / "gallery.html"), re.DOTALL))
    assert sorted(gallery) == experiments
    for name, entry in gallery.items():
        assert f"pl-mc run {name} makes it again" in re.sub(r"<[^>]+>", "", entry)
        assert re.search(r'href="_downloads/\w+/summary\.md"', entry), name
        assert entry.count("<li>") >= 2, name
        assert ("<img" in entry) == any((ROOT / "results" / name).glob("*.png")), name
    assert "<math" in (site / "theory.html").read_text(encoding="utf-8")
    assert "misleading_rate" in (site / "reference" / "statistics.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_stored_without_outputs_and_install_by_one_line(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    first, *others = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert "".join(first["source"]).splitlines()[-1] == "    %pip install -q pl_mc"
    for cell in (first, *others):
        assert (cell["outputs"], cell["execution_count"], cell["metadata"]) == ([], None, {})
    assert "assert " in "".join("".join(cell["source"]) for cell in others)
    assert notebook["cells"][-1]["source"][0] == "## What was learned\n"


def test_the_notebook_on_honesty_takes_files(
    data_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A drive of twenty minutes, with a track as its truth."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    (path,) = [path for path in NOTEBOOKS if path.stem == "is-my-receiver-honest"]
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    source = "\n\n".join("".join(cell["source"]) for cell in cells[1:])
    files = ["CARD00ESP_R_20203341240_20M_01S_GC.rnx.gz", "CARD00ESP_R_20203340900_15H_GC_nav.rnx.gz"]
    given = [str(data_folder / name) for name in (*files, "CARD_own_ppk.csv.gz")]
    without, with_files = 'OBS, NAV, TRUTH = "", "", ""', f"OBS, NAV, TRUTH = {tuple(given)!r}"
    assert without in source
    exec(compile(source.replace(without, with_files), path.name, "exec"), {"__name__": "notebook"})
    assert "with the overbound: mean level" in capsys.readouterr().out


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
