"""The gallery's entries, as MyST Markdown: an experiment each, from its file and from what its stored run says."""

from __future__ import annotations

from pathlib import Path

from pl_mc.experiments.reading import document_of_run
from pl_mc.report.document import Document
from pl_mc.report.run_folder import read_run_folder

ROOT = Path(__file__).parents[1]
EXPERIMENTS = tuple(sorted(path.stem for path in (ROOT / "experiments").glob("*.toml")))

# Which figure says most, of runs that draw several; of others it is the first of them.
_FIGURES = {
    "compare-methods": "methods",
    "guo2022": "power",
    "guo2022-esbc": "power",
    "integrity-risk": "risk_against_bias",
    "noise-sensitivity": "noise_models",
    "observe-day": "stanford_vertical",
    "sequential-levels": "levels",
    "service-volume": "world_availability",
    "time-ramps": "time_to_alert",
    "zhao2021-dynamic": "fig9_vpl",
    "zhao2021-dynamic-card": "fig9_vpl",
    "zhao2021-static": "fig5_vpl",
    "zhao2021-static-esbc": "fig5_vpl",
}


def entries() -> str:
    """All of them, in the order of their names."""
    return "\n".join(_entry(name) for name in EXPERIMENTS)


def _entry(name: str) -> str:
    folder = f"../results/{name}"
    document: Document = document_of_run(read_run_folder(ROOT / "results" / name))
    drawn = [figure.name for figure in document.figures]
    shown = _FIGURES.get(name, drawn[0] if drawn else "")
    picture = [f"![{document.title}]({folder}/{shown}.png)", ""] if shown else []
    return "\n".join([
        f"## {name}", "", f"**{document.title}.** {_said(name)}", "", f"*{document.question}*", "",
        *picture, *(f"- {sentence}" for sentence in document.answer[:3]), "",
        f"`pl-mc run {name}` makes it again; {{download}}`the stored run <{folder}/summary.md>` has its tables.", "",
    ])  # fmt: skip


def _said(name: str) -> str:
    """What the file says of itself before its first field."""
    lines = (ROOT / "experiments" / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    first = next(place for place, line in enumerate(lines) if not line.startswith("#"))
    return " ".join(line.removeprefix("#").strip() for line in lines[:first])
