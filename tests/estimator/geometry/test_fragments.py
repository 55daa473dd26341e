"""Fragments: parts of an object are no objects."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.geometry.measurement import without_fragments
from estimator.records.objects import Box, MeasuredObject


def _object(category: str, centre: tuple[float, float, float], side: float, views: int) -> MeasuredObject:
    box = Box(np.array(centre), np.eye(3), np.full(3, side))
    return MeasuredObject("1", category, np.full(3, side), np.full(3, 0.03), views=views, box=box)


def test_a_part_within_an_object_of_its_category_is_skipped() -> None:
    objects = [_object("chair", (0, 0, 0), 1.0, 9), _object("chair", (0.3, 0, 0), 0.3, 3)]
    whole, part = without_fragments(objects)
    assert whole.skipped is None
    assert part.skipped == "a part of another chair"


def test_the_object_that_more_views_show_stays() -> None:
    small, large = without_fragments([_object("chair", (0.3, 0, 0), 0.3, 9), _object("chair", (0, 0, 0), 1.0, 3)])
    assert small.skipped is None
    assert large.skipped is None  # it is not within the small one


def test_neighbours_and_other_categories_stay() -> None:
    objects = [
        _object("chair", (0, 0, 0), 1.0, 9),
        _object("chair", (0.9, 0, 0), 1.0, 5),
        _object("cup", (0, 0, 0.2), 0.1, 5),
    ]
    assert all(item.skipped is None for item in without_fragments(objects))


@pytest.mark.parametrize(("x", "is_part"), [(0.505, True), (0.515, False)])
def test_a_part_has_three_fifths_of_its_box_in_the_other(x: float, is_part: bool) -> None:
    """A box of side 0.2 at x, and another of side 1.1 (`CONTAINER_SCALE`) that ends at 0.55: 5 layers of sample points.

    Of the layers at x - 0.08, x - 0.04, ..., x + 0.08, four (0.8) are inside for x = 0.505, and three (0.6, which is
    not more than `MIN_CONTAINED_FRACTION`) for 0.515.
    """
    objects = [_object("chair", (0, 0, 0), 1.0, 9), _object("chair", (x, 0, 0), 0.2, 3)]
    assert (without_fragments(objects)[1].skipped is not None) == is_part
