"""A headless Chromium, driven by its command line alone: what a page logs, what stands in it, how it looks."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageStat


def find_browser() -> str | None:
    """The program, or None."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((found for name in names if (found := shutil.which(name))), None)


@dataclass(frozen=True)
class Browser:
    """A program with a profile of its own."""

    program: str
    profile: Path

    def _run(self, page: Path, *options: str, width: int = 1100, height: int = 900) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [
                self.program, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                "--no-first-run", "--disable-background-networking", "--disable-component-update",
                f"--user-data-dir={self.profile}", f"--window-size={width},{height}", "--virtual-time-budget=2000",
                "--enable-logging=stderr", *options, page.absolute().as_uri(),
            ],
            capture_output=True, text=True, check=False, timeout=90,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        return done

    def dump(self, page: Path, *options: str, **size: int) -> tuple[str, list[str]]:
        """The document after its scripts have run, and what it wrote to the console."""
        done = self._run(page, "--dump-dom", *options, **size)
        return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE:" in line]

    def probe(self, page: Path, script: str, *options: str, **size: int) -> tuple[dict[str, Any], list[str]]:
        """What a script put at the end of the page writes into ``out``, and the console.

        The page is copied; the script sees it as a reader does who has waited for it.
        """
        copy = page.with_name("probed.html")
        write = (
            "const out = {};\n" + script + "\nconst note = document.createElement('pre'); note.id = 'probe';"
            "note.textContent = JSON.stringify(out); document.body.append(note);"
        )
        text = page.read_text(encoding="utf-8")
        copy.write_text(text.replace("</body>", f"<script>window.onload = () => {{ {write} }};</script></body>"))
        try:
            document, console = self.dump(copy, *options, **size)
        finally:
            copy.unlink()
        found = re.search(r'<pre id="probe">(.*?)</pre>', document, re.DOTALL)
        assert found, console
        return json.loads(html.unescape(found[1])), console

    def brightness(self, page: Path, picture: Path, *options: str) -> float:
        """Mean brightness of the top of the page, 0 to 255."""
        self._run(page, f"--screenshot={picture}", *options, height=600)
        with Image.open(picture) as image:
            return float(ImageStat.Stat(image.convert("L")).mean[0])

    def print_pdf(self, page: Path, file: Path) -> bytes:
        """The page as it is printed."""
        self._run(page, "--no-pdf-header-footer", f"--print-to-pdf={file}")
        return file.read_bytes()
