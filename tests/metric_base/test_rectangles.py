"""Countries of positions: a position near a border or on an ocean has none."""

from __future__ import annotations

import pytest

from metric_base.rectangles import RECTANGLES, place_at
from metric_base.regions import region_of


@pytest.mark.parametrize(
    ("latitude", "longitude", "place"),
    [
        (55.698, 13.195, "SE"),  # Lund
        (55.676, 12.568, None),  # Copenhagen, across the sound
        (48.85, 2.35, "FR"),  # Paris
        (49.26, 4.03, "europe"),  # Reims, near Belgium
        (48.58, 7.75, "europe"),  # Strasbourg, on the border of Germany
        (52.52, 13.40, "DE"),  # Berlin
        (37.56, -122.32, "US"),  # San Mateo
        (32.72, -117.16, None),  # San Diego, near Mexico
        (43.65, -79.38, "north-america"),  # Toronto, near the United States
        (28.61, 77.21, "IN"),  # Delhi
        (31.55, 74.34, None),  # Lahore, near India
        (41.01, 28.98, None),  # Istanbul
        (0.0, -30.0, None),  # Atlantic
        (30.0, -150.0, None),  # Pacific
        (-85.0, 0.0, None),  # Antarctica
        (90.0, 180.0, None),
    ],
)
def test_place_of_a_position(latitude: float, longitude: float, place: str | None) -> None:
    assert place_at(latitude, longitude) == place


def test_rectangles_are_valid_and_of_known_places() -> None:
    for code, rectangles in RECTANGLES.items():
        assert region_of(code) is not None
        assert all(-90 <= s < n <= 90 and -180 <= w < e <= 180 for s, w, n, e in rectangles)


def test_rectangles_of_different_countries_are_apart() -> None:
    """By 0.2 degrees; countries have two letters."""
    boxes = [(code, box) for code, of_code in RECTANGLES.items() if len(code) == 2 for box in of_code]
    for i, (code, (s, w, n, e)) in enumerate(boxes):
        for other, (s2, w2, n2, e2) in boxes[:i]:
            assert code == other or s - n2 > 0.2 or s2 - n > 0.2 or w - e2 > 0.2 or w2 - e > 0.2, (code, other)
