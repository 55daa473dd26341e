"""Draw an object to scale next to a person, a door and a hand: front and side view, with the 5 to 95 % band."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

from explorer.charts.axis import length_text, svg
from metric_base.length_units import bar_length

WIDTH, MAX_TALL, FOOT, MARGIN, GAP = 340, 186, 40, 10, 14

#: Name, width and height in mm, and an outline in a box of 100 by 100: a person of 1.70 m, a door of 0.9 by 2.0 m (as
#: doors of homes are), a hand of 19 cm (the median of ANSUR II).
REFERENCES = json.loads(Path(__file__).with_name("references.json").read_text(encoding="utf-8"))

#: Width of the bar of a single dimension, relative to its length.
BAR_RATIO = 0.04
#: Maximum length of the scale bar in pixels.
MAX_BAR_PX = 90
#: Range of the height of a reference, relative to the longest side of the object, for which it is drawn.
MIN_REFERENCE_RATIO, MAX_REFERENCE_RATIO = 0.035, 9.0


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """Quantiles (5 %, 50 %, 95 %) of width, depth and height of an object in mm, and the names of these dimensions."""

    across: tuple[float, float, float]
    up: tuple[float, float, float]
    deep: tuple[float, float, float] | None
    names: tuple[str, str, str]


def size_comparison(name: str, box: DrawnBox) -> str:
    """Return the SVG of an object next to references of familiar size; a single known dimension is a bar."""
    is_bar = box.names[0] == box.names[1]
    if is_bar:
        box = replace(box, across=(BAR_RATIO * box.up[2],) * 3)
    longest = max(box.across[2], box.up[2], box.deep[2] if box.deep else 0)
    beside = [one for one in REFERENCES if MIN_REFERENCE_RATIO <= one[2] / longest <= MAX_REFERENCE_RATIO]
    if len(beside) == len(REFERENCES) and longest < 450:
        beside = [REFERENCES[2]]  # next to a person, a mug would be a dot
    widths = [box.across[2], *([box.deep[2]] if box.deep else []), *(one[1] for one in beside)]
    tallest = max(box.up[2], *(one[2] for one in beside), 0) if beside else box.up[2]
    scale = min((WIDTH - 2 * MARGIN - GAP * (len(widths) - 1)) / sum(widths), MAX_TALL / tallest)
    floor = tallest * scale + MARGIN
    height = floor + FOOT
    x = (WIDTH - sum(widths) * scale - GAP * (len(widths) - 1)) / 2
    body = f'<path class="floor" d="M0 {floor:.1f}H{WIDTH}"/>'
    labels: list[tuple[float, str]] = []
    for widths_mm, view in [(box.across, "front")] + ([(box.deep, "side")] if box.deep else []):
        centre = x + widths_mm[2] * scale / 2
        for kind, q in (("band", 2), ("object", 1), ("least", 0)):  # boxes of the 95 %, 50 % and 5 % quantiles
            body += (
                f'<rect class="{kind}" x="{centre - widths_mm[q] * scale / 2:.1f}" y="{floor - box.up[q] * scale:.1f}" '
                f'width="{widths_mm[q] * scale:.1f}" height="{box.up[q] * scale:.1f}"/>'
            )
        labels.append((centre, box.names[1] if is_bar else view))
        x += widths_mm[2] * scale + GAP
    for reference, wide, high, outline in beside:
        body += (
            f'<path class="reference" fill-rule="evenodd" transform="translate({x:.1f} {floor - high * scale:.1f}) '
            f'scale({wide * scale / 100:.4f} {high * scale / 100:.4f})" d="{outline}"/>'
        )
        labels.append((x + wide * scale / 2, reference))
        x += wide * scale + GAP
    # Names below the drawings, alternating between two lines if they would overlap
    last, row = -100.0, 0
    for centre, text in labels:
        row = 1 - row if centre - last < 6 * len(text) + 12 else 0
        last = centre
        text_x = min(max(centre, 16.0), WIDTH - 20.0)
        body += f'<text x="{text_x:.1f}" y="{floor + 13 + 11 * row:.1f}">{text}</text>'
    # A scale bar of a round length
    length = bar_length(1 / scale, MAX_BAR_PX)
    body += (
        f'<path class="bar" d="M{MARGIN} {height - 6:.1f}v4h{length * scale:.1f}v-4"/>'
        f'<text class="start" x="{MARGIN + length * scale + 5:.1f}" y="{height - 2:.1f}">{length_text(length)}</text>'
    )
    known = f"{box.names[1]} {length_text(box.up[1])}"
    if not is_bar:
        known = f"{box.names[0]} {length_text(box.across[1])}, {known}"
    deep = f", {box.names[2]} {length_text(box.deep[1])}" if box.deep else ""
    others = f" beside {', '.join(one[0] for one in beside)}" if beside else ""
    return svg(WIDTH, round(height, 1), f"{name} to scale{others}: {known}{deep}", body, "to-scale")
