"""HTML report of many models, sorted by the size of the error, with drawings to scale of the wrong ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from metric_base.escaping import visible
from metric_base.files import write_whole
from models3d.size_check.check import AssetCheck, verdict_line

#: Height of the person in a drawing, in metres.
PERSON_M = 1.75
#: Height of the tallest object in a drawing, in pixels.
HEIGHT_PX = 260
#: Distance between objects, and to the edges, in pixels.
MARGIN_PX = 24
#: Minimum width of the column of an object, for its label, in pixels.
COLUMN_PX = 96.0
#: Minimum height of a box relative to the tallest one, so that it is visible.
MIN_HEIGHT_FRACTION = 0.004
#: Maximum number of drawings of a report, so that browsers open it fast.
MAX_DRAWINGS = 200

_DRAWING_STYLE = (
    "text{font:12px sans-serif;fill:#333}.person{fill:#c8ccd0}.stated{fill:#e8b4a0;stroke:#b5533c}"
    ".true{fill:none;stroke:#2f6f4f;stroke-dasharray:5 3}.floor{stroke:#888}"
)
#: First line of the report, which identifies it as such.
HEAD = "<!doctype html><!-- metric-tree/asset-report/1 -->"
_STYLE = (
    "body{font:15px sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}li{margin:.8rem 0}svg{max-width:100%}"
)


def write_report(path: Path, checks: Sequence[AssetCheck]) -> None:
    """Write the report of these checks."""

    def severity(check: AssetCheck) -> tuple[bool, float]:
        """Wrong ones first; the log error of the size, times the probability of the verdict."""
        factor = check.true_size.factor[1] if check.true_size else 1.0
        return check.is_wrong, check.probability * abs(math.log(factor)) if factor > 0 else 0.0

    rows = []
    for index, check in enumerate(sorted(checks, key=severity, reverse=True)):
        is_drawn = index < MAX_DRAWINGS and check.verdict != "right" and max(check.extents_m) > 0
        svg = drawing(check) if is_drawn else ""
        rows.append(f"<li><b>{escape(visible(check.file))}</b>: {escape(visible(verdict_line(check)))}<br>{svg}</li>\n")
    wrong = sum(check.is_wrong for check in checks)
    text = (
        f'{HEAD}\n<html lang="en"><meta charset="utf-8"><title>Sizes of models</title><style>{_STYLE}</style>'
        f"<h1>{len(checks)} models, {wrong} of them wrong</h1><ol>{''.join(rows)}</ol></html>\n"
    )
    write_whole(path, text, "--report")


def drawing(check: AssetCheck) -> str:
    """Return an SVG drawing, seen from the front: a person, the box of the file, and the box at its true height."""
    x, y, z = check.extents_m
    width, height = (x, z) if check.up == "z" else (x, y)
    columns = [
        ("person", ("a person", f"{PERSON_M:.2f} m"), 0.5, PERSON_M),
        ("stated", ("in the file", f"{_length(height)} high"), width, height),
    ]
    if check.true_size is not None:
        low, median, high = check.true_size.height_m
        factor = check.true_size.factor[1]
        columns.append(("true", ("such objects", f"{_length(low)} to {_length(high)}"), width * factor, median))
    scale = HEIGHT_PX / max(height for _, _, _, height in columns)
    parts, left, floor = [], float(MARGIN_PX), HEIGHT_PX + 2.0 * MARGIN_PX
    for kind, label, width, height in columns:
        width_px = max(width * scale, 2.0)
        height_px = max(height * scale, MIN_HEIGHT_FRACTION * HEIGHT_PX)
        if kind == "person":
            head, centre = height_px / 14, left + width_px / 2
            body = floor - height_px + 2 * head
            parts.append(
                f'<circle class="person" cx="{centre:.1f}" cy="{floor - height_px + head:.1f}" r="{head:.1f}"/>'
            )
            parts.append(
                f'<rect class="person" x="{centre - 1.7 * head:.1f}" y="{body:.1f}" width="{3.4 * head:.1f}" '
                f'height="{floor - body:.1f}" rx="{head:.1f}"/>'
            )
        else:
            size = f'width="{width_px:.1f}" height="{height_px:.1f}"'
            parts.append(f'<rect class="{kind}" x="{left:.1f}" y="{floor - height_px:.1f}" {size}/>')
        for line, text in enumerate(label):
            parts.append(f'<text x="{left:.1f}" y="{floor + 16 + 15 * line:.1f}">{escape(text)}</text>')
        left += max(width_px, COLUMN_PX) + MARGIN_PX
    title = visible(f"{check.body}: {check.verdict}")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left:.0f}" height="{floor + 44:.0f}" role="img">'
        f"<title>{escape(title)}</title><style>{_DRAWING_STYLE}</style>"
        f'<text x="{MARGIN_PX}" y="18">{escape(title)}</text>'
        f'<line class="floor" x1="0" y1="{floor}" x2="{left:.0f}" y2="{floor}"/>{"".join(parts)}</svg>\n'
    )


def _length(metres: float) -> str:
    """Format a length: `12 mm`, `0.86 m`."""
    return f"{1000 * metres:.3g} mm" if metres < 0.1 else f"{metres:.3g} m"
