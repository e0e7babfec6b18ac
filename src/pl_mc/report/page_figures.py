"""Static figures of a page: embedded as they are, or smaller where heavy, each with a text in its place."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from pl_mc.report.document import FigureEntry

# Files of a figure by their ending, and what they are.
_KINDS = {".png": "image/png", ".svg": "image/svg+xml"}


@dataclass(frozen=True)
class PageFigure:
    """A figure of a page.

    Attributes:
        caption: what stands below it.
        alt: what stands in its place where it cannot be seen.
        files: its files beside the page.
        data: the picture as a data address; empty where there is no room for it.
        size: width and height on the screen [CSS pixels], unless unknown.
    """

    caption: str
    alt: str
    files: tuple[str, ...]
    data: str
    size: tuple[int, int] | None


def page_figures(folder: Path, entries: Sequence[FigureEntry], *, most_bytes: int) -> list[PageFigure]:
    """The figures, all of them together within ``most_bytes`` characters of data.

    Where they are heavier, pictures get fewer colours, then half the size; what still finds no room is named alone.
    """
    # What has been taken out of the folder is left out.
    entries = [entry for entry in entries if _files(folder, entry.name)]
    pictures = {entry.name: _lightest(folder, entry.name) for entry in entries}
    for shrink in (_fewer_colours, _smaller):
        if sum(len(_address(picture)) for picture in pictures.values()) <= most_bytes:
            break
        pictures = {name: shrink(folder / f"{name}.png", picture) for name, picture in pictures.items()}
    made, left = [], most_bytes
    for entry in entries:
        name = entry.name
        text = _address(pictures[name])
        if len(text) > left:
            text = ""
        left -= len(text)
        files = tuple(path.name for path in _files(folder, name))
        made.append(PageFigure(entry.caption, entry.alt, files, text, _size(folder, name)))
    return made


def _files(folder: Path, name: str) -> list[Path]:
    return [path for end in _KINDS if (path := folder / f"{name}{end}").is_file()]


def _address(picture: tuple[bytes, str]) -> str:
    data, kind = picture
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _lightest(folder: Path, name: str) -> tuple[bytes, str]:
    pictures = [(path.read_bytes(), _KINDS[path.suffix]) for path in _files(folder, name)]
    return min(pictures, key=lambda picture: len(picture[0]))


def _fewer_colours(path: Path, picture: tuple[bytes, str]) -> tuple[bytes, str]:
    return _redrawn(path, picture, scale=1)


def _smaller(path: Path, picture: tuple[bytes, str]) -> tuple[bytes, str]:
    return _redrawn(path, picture, scale=2)


def _redrawn(path: Path, picture: tuple[bytes, str], *, scale: int) -> tuple[bytes, str]:
    """The picture with 64 colours and its sides divided by ``scale``, if that is lighter."""
    if not path.is_file():
        return picture
    with Image.open(path) as image:
        plain = image.convert("RGB")
        if scale > 1:
            plain = plain.resize((plain.width // scale, plain.height // scale), Image.Resampling.LANCZOS)
        out = io.BytesIO()
        plain.quantize(64, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return min(picture, (out.getvalue(), "image/png"), key=lambda each: len(each[0]))


def _size(folder: Path, name: str) -> tuple[int, int] | None:
    """Size on the screen of a picture of 150 dots an inch."""
    path = folder / f"{name}.png"
    if not path.is_file():
        return None
    with Image.open(path) as image:
        return round(image.width * 96 / 150), round(image.height * 96 / 150)
