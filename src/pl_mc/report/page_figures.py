"""Static figures of a page: embedded as they are, or smaller where heavy, each with a text in its place."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

# What stands below a figure, by how its file is called; the text in its place adds the words drawn in it.
_CAPTIONS = (
    (r"rates|ramp_rates", "Protection levels and rates of events against the bias, or fault by fault."),
    (r"ramp_satellites", "The same ramp on every satellite in view."),
    (r"fig6_vpl_against_bias", "Vertical protection level of one draw of noise against the bias."),
    (r"map_(\w+)", "Rate of the event {0} by epoch and faulted satellite, over all biases."),
    (r"stanford", "Vertical error against vertical protection level, number of scenarios in each cell."),
    (r"fig\d_satellites", "Satellites in view over the epochs."),
    (r"fig\d_errors_ls", "East, north and up errors of least squares over the epochs."),
    (r"fig\d_errors_robust", "East, north and up errors of the robust estimate over the epochs."),
    (r"fig\d_vpl", "Vertical protection levels over the epochs."),
    (r"fig\d_residuals", "Pseudorange errors over the epochs."),
    (r"fig\d_[tf]", "A test's statistic and its threshold over the epochs."),
    (r"flight", "The flight: track, height and speed."),
    (r"epochs", "Position errors and protection levels over the epochs."),
    (r"detection", "Detection rates by test and bias, with 95 % intervals."),
    (r"power", "Detection rate of each test against the bias."),
    (r"power_satellites", "Detection rate by satellite and bias."),
    (r"risk_against_bias", "Probability of misleading information and missed detection against the bias."),
    (r"worst_case", "The worst fault of every satellite, beside the worst of a grid of biases."),
    (r"grid_steps", "How much of the worst case a grid of biases misses, by its step."),
    (r"worst_sky", "Where the satellites with the worst faults stand in the sky."),
    (r"calibration", "The multiplier that keeps a target, and its price in alarms."),
    (r"noise_models", "Rates of events under each model of the noise, beside Gaussian noise."),
    (r"exposures", "How often an event happens at least once in an exposure, by the correlation of its errors."),
    (r"world_availability", "Share of the day with service, by method."),
    (r"world_operations", "The same for every operation."),
    (r"world_levels", "Vertical protection levels not exceeded in 99 % of the scenarios."),
    (r"world_satellites", "Satellites in view."),
    (r"world_day", "Share of the Earth's area without service over the day."),
    (r"time_to_alert", "Error at the alarm, and its delay after the hazard begins, by the rate of the ramp."),
    (r"late_alerts", "How often the alarm comes later than 6, 10 and 30 s after the hazard begins."),
    (r"methods", "Rates of events by method and bias, and availability."),
    (r"tuning", "Mean level and fault-free alarms of default and tuned limits, each with the multiplier it needs."),
    (r"tests", "Detection rates of the tests at one false-alarm rate."),
    (r"sky", "Ways of the satellites over one site."),
    (r"variants_(\w+)", "Every variant at the {0} geometry: rates against the bias."),
)  # fmt: skip

_TEXT = re.compile(r"<text\b[^>]*>(.*?)</text>", re.DOTALL)
_TAG = re.compile(r"<[^>]+>")
_NUMBER = re.compile(r"[\s\d.,:%+\-−–eE^{}$×]*")
_MOST_WORDS = 40


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


def page_figures(folder: Path, names: Sequence[str], *, title: str, most_bytes: int) -> list[PageFigure]:
    """The figures, all of them together within ``most_bytes`` characters of data.

    Where they are heavier, pictures get fewer colours, then half the size; what still finds no room is named alone.
    """
    pictures = {name: _lightest(folder, name) for name in names}
    for shrink in (_fewer_colours, _smaller):
        if sum(len(_address(picture)) for picture in pictures.values()) <= most_bytes:
            break
        pictures = {name: shrink(folder / f"{name}.png", picture) for name, picture in pictures.items()}
    made, left = [], most_bytes
    for name in names:
        text = _address(pictures[name])
        if len(text) > left:
            text = ""
        left -= len(text)
        caption = caption_of(name)
        files = tuple(f"{name}.{end}" for end in ("png", "svg") if (folder / f"{name}.{end}").is_file())
        made.append(PageFigure(caption, _alt(folder, name, caption, title), files, text, _size(folder, name)))
    return made


def caption_of(name: str) -> str:
    """What a figure of that file name shows."""
    for pattern, caption in _CAPTIONS:
        match = re.fullmatch(pattern, name)
        if match:
            return caption.format(*match.groups())
    return f"{name.replace('_', ' ').capitalize()}."


def _address(picture: tuple[bytes, str]) -> str:
    data, kind = picture
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _lightest(folder: Path, name: str) -> tuple[bytes, str]:
    found = [
        (path.read_bytes(), kind)
        for end, kind in (("png", "image/png"), ("svg", "image/svg+xml"))
        if (path := folder / f"{name}.{end}").is_file()
    ]
    return min(found, key=lambda one: len(one[0]))


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
    return min(picture, (out.getvalue(), "image/png"), key=lambda one: len(one[0]))


def _size(folder: Path, name: str) -> tuple[int, int] | None:
    """Size on the screen of a picture of 150 dots an inch."""
    path = folder / f"{name}.png"
    if not path.is_file():
        return None
    with Image.open(path) as image:
        return round(image.width * 96 / 150), round(image.height * 96 / 150)


def _alt(folder: Path, name: str, caption: str, title: str) -> str:
    """The caption, and the words that are drawn: headings, axes and names of curves."""
    path = folder / f"{name}.svg"
    words: list[str] = []
    if path.is_file():
        found = _TEXT.findall(path.read_text(encoding="utf-8"))
        words = [html.unescape(" ".join(_TAG.sub("", one).split())) for one in found]
    drawn = [one for one in dict.fromkeys(words) if one != title and not _NUMBER.fullmatch(one)]
    if not drawn:
        return f"{caption} {title}."
    more = f"; and {len(drawn) - _MOST_WORDS} more" if len(drawn) > _MOST_WORDS else ""
    return f"{caption} Drawn in it: {'; '.join(drawn[:_MOST_WORDS])}{more}."
