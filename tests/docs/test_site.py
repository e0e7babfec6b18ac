"""The site builds without a warning and asks for nothing from elsewhere."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GENERATOR = ("sphinx", "myst_parser", "furo")


@pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in GENERATOR), reason="pl_mc[docs] is not installed"
)
def test_the_site_builds_strictly_and_stands_alone(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-E", "-d", str(tmp_path / "read")]
    done = subprocess.run(
        [*command, "docs", str(site)], cwd=ROOT, capture_output=True, text=True, timeout=240, check=False
    )
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
    assert "<math" in (site / "theory.html").read_text(encoding="utf-8")
    assert "misleading_rate" in (site / "reference" / "statistics.html").read_text(encoding="utf-8")
