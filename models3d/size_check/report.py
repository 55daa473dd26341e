"""A page about many models, the most wrong first, with drawings to scale of those in doubt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from metric_base.files import whole_file
from models3d.size_check.check import AssetCheck, verdict_line

#: Height of the person in metres, and of the drawing in pixels.
PERSON_M, HEIGHT_PX, MARGIN_PX = 1.75, 260, 24
#: A box that is drawn is at least this share of the tallest one; a smaller one is a mark with its size in words.
LEAST_SHARE = 0.004

_DRAWING_STYLE = (
    "text{font:12px sans-serif;fill:#333}.person{fill:#c8ccd0}.stated{fill:#e8b4a0;stroke:#b5533c}"
    ".true{fill:none;stroke:#2f6f4f;stroke-dasharray:5 3}.floor{stroke:#888}"
)
#: Drawings of a page: more of them than a person looks at would make it slow to open.
MAX_DRAWINGS = 200
#: First line of the page, by which it is known as ours.
HEAD = "<!doctype html><!-- metric-tree/asset-report/1 -->"
_STYLE = (
    "body{font:15px sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}li{margin:.8rem 0}svg{max-width:100%}"
)


def write_report(path: Path, checks: Sequence[AssetCheck]) -> None:
    """Write the page."""
    ranked = sorted(checks, key=_wrongness, reverse=True)
    rows = "".join(_row(check, number) for number, check in enumerate(ranked))
    wrong = sum(check.is_wrong for check in checks)
    text = (
        f'{HEAD}\n<html lang="en"><meta charset="utf-8"><title>Sizes of models</title><style>{_STYLE}</style>'
        f"<h1>{len(checks)} models, {wrong} of them wrong</h1><ol>{rows}</ol></html>\n"
    )
    with whole_file(path, "--report") as work:
        work.write_text(text, encoding="utf-8")


def _wrongness(check: AssetCheck) -> tuple[bool, float]:
    """The size of the error in the logarithm, times how sure it is."""
    factor = check.true_size.factor[1] if check.true_size else 1.0
    return check.is_wrong, check.probability * abs(math.log(factor)) if factor > 0 else 0.0


def _row(check: AssetCheck, number: int) -> str:
    picture = drawing(check) if number < MAX_DRAWINGS and check.verdict != "right" and max(check.extents_m) > 0 else ""
    return f"<li><b>{escape(check.file)}</b>: {escape(verdict_line(check))}<br>{picture}</li>\n"


def drawing(check: AssetCheck) -> str:
    """An SVG picture: the stated box, the interval of the true height, and a person of 1.75 m, seen from the front."""
    columns = _columns(check)
    tallest = max(height for _, _, _, height in columns)
    scale = HEIGHT_PX / tallest
    parts, x, floor = [], float(MARGIN_PX), HEIGHT_PX + 2.0 * MARGIN_PX
    for kind, words, width, height in columns:
        shown_width = max(width * scale, 2.0)
        shown_height = max(height * scale, LEAST_SHARE * HEIGHT_PX)
        parts.append(_shape(kind, x, floor, shown_width, shown_height))
        parts += _label(words, x, floor)
        x += max(shown_width, 96.0) + MARGIN_PX
    title = f"{check.body}: {check.verdict}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{x:.0f}" height="{floor + 44:.0f}" role="img">'
        f"<title>{escape(title)}</title><style>{_DRAWING_STYLE}</style>"
        f'<text x="{MARGIN_PX}" y="18">{escape(title)}</text>'
        f'<line class="floor" x1="0" y1="{floor}" x2="{x:.0f}" y2="{floor}"/>{"".join(parts)}</svg>\n'
    )


def _columns(check: AssetCheck) -> list[tuple[str, tuple[str, str], float, float]]:
    """Kind, label, width and height in metres of what stands side by side."""
    x, y, z = check.extents_m
    width, height = (x, z) if check.up == "z" else (x, y)
    columns = [("person", ("a person", f"{PERSON_M:.2f} m"), 0.5, PERSON_M)]
    columns.append(("stated", ("as the file says", f"{_length(height)} high"), width, height))
    if check.true_size is not None:
        low, median, high = check.true_size.height_m
        factor = check.true_size.factor[1]
        columns.append(("true", ("as such objects are", f"{_length(low)} to {_length(high)}"), width * factor, median))
    return columns


def _shape(kind: str, x: float, floor: float, width: float, height: float) -> str:
    if kind != "person":
        return f'<rect class="{kind}" x="{x:.1f}" y="{floor - height:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
    head, middle = height / 14, x + width / 2
    body = floor - height + 2 * head
    return (
        f'<circle class="person" cx="{middle:.1f}" cy="{floor - height + head:.1f}" r="{head:.1f}"/>'
        f'<rect class="person" x="{middle - 1.7 * head:.1f}" y="{body:.1f}" width="{3.4 * head:.1f}" '
        f'height="{floor - body:.1f}" rx="{head:.1f}"/>'
    )


def _label(words: Sequence[str], x: float, floor: float) -> list[str]:
    return [f'<text x="{x:.1f}" y="{floor + 16 + 15 * n:.1f}">{escape(text)}</text>' for n, text in enumerate(words)]


def _length(metres: float) -> str:
    return f"{1000 * metres:.3g} mm" if metres < 0.1 else f"{metres:.3g} m"
