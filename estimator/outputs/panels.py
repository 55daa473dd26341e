"""The text of an overlay: a panel beside each object, and the legend below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.outputs.label_placement import label_places
from estimator.outputs.size_labels import DimensionLabel
from estimator.records.result import ObjectReport, Status
from metric_base.arrays import FloatArray
from metric_base.escaping import visible

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

__all__ = ["AXIS_COLOURS", "PLAIN", "UNTRUSTED", "with_legend", "with_panels"]

#: Colours (red, green, blue) of length, width and height where they count, and of all that do not.
AXIS_COLOURS = ((64, 224, 255), (255, 210, 64), (128, 255, 128))
UNTRUSTED, PLAIN, PANEL = (255, 90, 90), (235, 235, 235), (0, 0, 0)
PANEL_OPACITY = 0.74
FONT_PX = 15
_LINE_PX, _PAD_PX = FONT_PX + 3, 5
#: Longest name of an object that a panel shows.
MAX_HEADING = 40
_FONTS = ("DejaVuSans-Bold.ttf", "DejaVuSans.ttf")


def with_panels(
    canvas: Any, texts: Sequence[tuple[ObjectReport, tuple[DimensionLabel, ...]]], edges: Sequence[FloatArray]
) -> Any:
    """The canvas (h, w, 3) with a panel of text beside each object, none over another where there is room.

    edges : (12, k, 2) pixels of each object's box.
    """
    from PIL import Image, ImageDraw

    bold, plain = _fonts()
    sizes = np.array([_panel_size(report, labels, bold, plain) for report, labels in texts]).reshape(-1, 2)
    bounds = np.array([_visible_bounds(lines, canvas.shape) for lines in edges]).reshape(-1, 4)
    places = np.rint(label_places(bounds, sizes, (canvas.shape[1], canvas.shape[0])))
    sheet = Image.fromarray(canvas)
    shade = Image.new("RGBA", sheet.size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(shade)
    for (report, labels), size, (x, y), bound in zip(texts, sizes.tolist(), places.tolist(), bounds, strict=True):
        middle = tuple(((bound[:2] + bound[2:]) / 2).tolist())
        draw.line([(x + size[0] / 2, y + size[1] / 2), middle], fill=(*PLAIN, 170), width=1)
        draw.rectangle([x, y, x + size[0], y + size[1]], fill=(*PANEL, int(255 * PANEL_OPACITY)))
        head = UNTRUSTED if report.verdict != "used" else PLAIN
        draw.text((x + _PAD_PX, y + 2), _heading(report), font=bold, fill=(*head, 255))
        for line, label in enumerate(labels, start=1):
            colour = AXIS_COLOURS[label.axis] if label.trusted else UNTRUSTED
            draw.text((x + _PAD_PX, y + 2 + line * _LINE_PX), label.text, font=plain, fill=(*colour, 255))
    return np.asarray(Image.alpha_composite(sheet.convert("RGBA"), shade).convert("RGB"))


def with_legend(canvas: Any, level: float | None, has_truth: bool, status: Status = "resolved") -> Any:
    """The canvas (h, w, 3) with a strip below it: the letters, colours and brackets, and a status that is a warning.

    level : of the interval, None where none is stated.
    """
    from PIL import Image, ImageDraw

    _, plain = _fonts()
    truth = "   E estimate, G true size" if has_truth else ""
    brackets = "metres at the highest mode" if level is None else f"metres   [low, high] {level:.0%} interval"
    mark = [] if status == "resolved" else [(f"SCALE {status.upper()}", UNTRUSTED)]
    parts = [
        *mark,
        ("l length", AXIS_COLOURS[0]), ("w width", AXIS_COLOURS[1]), ("h height", AXIS_COLOURS[2]),
        ("red: not used for the scale", UNTRUSTED),
        (f"{brackets}   > at least (truncated){truth}", PLAIN),
    ]  # fmt: skip
    strip = Image.new("RGB", (canvas.shape[1], _LINE_PX + 2 * _PAD_PX), PANEL)
    draw, x = ImageDraw.Draw(strip), float(_PAD_PX)
    for text, colour in parts:
        draw.text((x, _PAD_PX), text, font=plain, fill=colour)
        x += plain.getlength(text) + 3 * _PAD_PX
    return np.vstack([canvas, np.asarray(strip)])


def _heading(report: ObjectReport) -> str:
    return visible(f"{report.category} {report.id}")[:MAX_HEADING] + (
        "" if report.verdict == "used" else f"  {report.verdict}"
    )


def _panel_size(
    report: ObjectReport, labels: Sequence[DimensionLabel], bold: FreeTypeFont, plain: FreeTypeFont
) -> tuple[int, int]:
    widths = [bold.getlength(_heading(report)), *(plain.getlength(label.text) for label in labels)]
    return math.ceil(max(widths)) + 2 * _PAD_PX, (1 + len(labels)) * _LINE_PX + _PAD_PX


def _visible_bounds(lines: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """(4,) left, top, right and bottom of what is seen of a box."""
    places = lines.reshape(-1, 2)
    with np.errstate(invalid="ignore"):
        seen = places[((places >= 0) & (places < (shape[1], shape[0]))).all(axis=1)]
    if not len(seen):
        return np.array([0.0, 0.0, shape[1], shape[0]])
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])


def _fonts() -> tuple[FreeTypeFont, FreeTypeFont]:
    """Bold and plain, from the fonts that matplotlib brings along: no machine lacks them."""
    import matplotlib as mpl
    from PIL import ImageFont

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    bold, plain = (ImageFont.truetype(str(folder / name), FONT_PX) for name in _FONTS)
    return bold, plain
