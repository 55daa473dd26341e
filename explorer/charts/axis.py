"""A logarithmic axis of lengths, SVG elements that all charts share, and lengths as text in a suitable unit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from metric_base.arrays import FloatArray

#: Name of each unit, its length in mm, and the minimum size in mm for which it is used.
_UNITS = (("km", 1e6, 2e6), ("m", 1e3, 1e3), ("cm", 10.0, 20.0), ("mm", 1.0, 0.0))
#: Factor that rounds halves such as 7.635 up, whose binary form is below; page.js has the same.
HALF_UP = 1 + 1e-12
#: Maximum number of decimals of a length in a table.
MAX_DECIMALS = 4
#: Maximum number of ticks of an axis; the labels of more would overlap on the screen of a phone.
MAX_TICKS = 6
#: Minimum distance of two ticks in pixels: the width of a label.
MIN_TICK_GAP_PX = 38.0


def _unit(mm: float) -> tuple[str, float]:
    return next((name, factor) for name, factor, least in _UNITS if mm >= least)


def number_text(value: float) -> str:
    """Return a number with at most three significant digits, without an exponent. Halves are rounded up."""
    value *= HALF_UP
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def length_text(mm: float, typical_mm: float | None = None) -> str:
    """Return a length in the usual unit for its size, or in that of `typical_mm` with three digits of that length.

    The cells of a table have the same `typical_mm`, and therefore the same unit and the same number of decimals.

    >>> length_text(91.4), length_text(4500), length_text(0.25)
    ('9.14 cm', '4.5 m', '0.25 mm')
    >>> length_text(1240, 914), length_text(85, 914)
    ('124.0 cm', '8.5 cm')
    """
    if typical_mm is not None:
        unit, factor = _unit(typical_mm)
        decimals = min(max(2 - math.floor(math.log10(typical_mm / factor)), 0), MAX_DECIMALS)
        return f"{mm / factor * HALF_UP:,.{decimals}f} {unit}"
    unit, factor = _unit(mm)
    return f"{number_text(mm / factor)} {unit}"


def range_text(low: float, high: float) -> str:
    """Return two lengths in the unit of the larger one.

    >>> range_text(80, 120)
    '8 to 12 cm'
    """
    unit, factor = _unit(high)
    return f"{number_text(low / factor)} to {number_text(high / factor)} {unit}"


@dataclass(frozen=True, slots=True)
class LogAxis:
    """Lengths from `low` to `high` mm, drawn from `start` to `end` pixels by their logarithm."""

    low: float
    high: float
    start: float
    end: float

    def at(self, mm: float) -> float:
        """Return the pixel of a length; a length outside the axis is at its end."""
        share = (math.log(mm) - math.log(self.low)) / (math.log(self.high) - math.log(self.low))
        return self.start + min(max(share, 0.0), 1.0) * (self.end - self.start)

    def along(self, sizes: FloatArray) -> FloatArray:
        """Return the pixels of lengths in mm (an array of any shape); a length outside the axis is beyond its end."""
        share = np.log(sizes / self.low) / math.log(self.high / self.low)
        return np.asarray(self.start + share * (self.end - self.start))

    def ticks(self) -> list[float]:
        """Return round lengths in mm at a sufficient distance: powers of ten, then other steps if there is room."""
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        kept: list[float] = []
        for steps in ((1,), (2, 5), (1.5, 3, 4, 6, 7, 8, 9)):
            for power in range(first, last + 1):
                near = [step * 10.0**power for step in steps if self.low <= step * 10.0**power <= self.high]
                for tick in near:
                    apart = min((abs(self.at(tick) - self.at(other)) for other in kept), default=MIN_TICK_GAP_PX)
                    if apart >= MIN_TICK_GAP_PX and len(kept) < MAX_TICKS:
                        kept.append(tick)
        return sorted(kept)

    def svg(self, base: float, far: float, is_vertical: bool = False) -> str:
        """Return the ticks as grid lines from `base` to `far`, with labels at `base`: below them, or left of them.

        A page redraws the group for units whose round lengths are other ones.
        """
        lines, labels = "", ""
        for tick in self.ticks():
            at, text = f"{self.at(tick):.0f}", length_text(tick)
            lines += f"M{base:g} {at}H{far:g}" if is_vertical else f"M{at} {base:g}V{far:g}"
            place = (
                f'class="end" x="{base - 4:g}" y="{self.at(tick) + 4:.0f}"'
                if is_vertical
                else f'x="{at}" y="{base + 12:g}"'
            )
            labels += f'<text {place} data-mm="{tick:.4g}">{text}</text>'
        ends = " ".join(f"{value:.5g}" for value in (self.low, self.high, self.start, self.end, base, far))
        kind = "axis vertical" if is_vertical else "axis"
        return f'<g class="{kind}" data-drawn data-axis="{ends}"><path class="grid" d="{lines}"/>{labels}</g>'


def path_data(points: Iterable[Sequence[float]]) -> str:
    """Return the data of an SVG path through points, as relative steps in tenths of a pixel."""
    tenths = [(round(10 * x), round(10 * y)) for x, y in points]
    steps = [(x - a, y - b) for (a, b), (x, y) in pairwise(tenths)]
    return f"M{tenths[0][0] / 10:g} {tenths[0][1] / 10:g}l" + " ".join(f"{x / 10:g} {y / 10:g}" for x, y in steps)


def svg(width: float, height: float, title: str, body: str, kind: str = "") -> str:
    """Return a drawing that fills its column, with a title for screen readers."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" class="drawing {kind}" '
        f'aria-label="{escape(title)}">{body}</svg>'
    )
