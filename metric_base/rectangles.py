"""The country or region of a position on the earth, by the rectangles of `rectangles.txt` that lie inside it."""

from __future__ import annotations

from pathlib import Path

from metric_base.text_tables import named_texts

_TEXTS = named_texts(Path(__file__).with_name("rectangles.txt"))
#: Rectangles (south, west, north, east) in degrees inside countries, and then inside regions, by their codes.
RECTANGLES = {code: [tuple(map(float, box.split())) for box in boxes.split("; ")] for code, boxes in _TEXTS.items()}


def place_at(latitude: float, longitude: float) -> str | None:
    """Return the code of the country or region whose rectangles contain a position in degrees; None for others.

    >>> place_at(55.7, 13.2), place_at(50.0, 15.0), place_at(30.0, -40.0)
    ('SE', 'europe', None)
    """
    for code, rectangles in RECTANGLES.items():
        if any(s <= latitude <= n and w <= longitude <= e for s, w, n, e in rectangles):
            return code
    return None
