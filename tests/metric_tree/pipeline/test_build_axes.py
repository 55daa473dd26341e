"""Axes by the words of a source and the pose of a node, and axes that remain unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metric_tree.axes import Sizes, axis_assignments, sizes_from_words
from metric_tree.pipeline.ingest import range_sd, widened_sd

NAN = np.nan
words = st.dictionaries(
    st.sampled_from(["length", "width", "height", "diameter", "depth"]),
    st.one_of(st.none(), st.floats(1.0, 5000.0)),
    max_size=5,
)
poses = st.sampled_from(["upright", "flat", "any"])


@pytest.mark.parametrize(
    ("stated", "pose", "expected"),
    [
        # a television's shop width is our length, its depth our width
        ({"width": 1200, "depth": 80, "height": 700}, "upright", Sizes(1200, 80, 700, (1200, 700, 80))),
        ({"length": 500, "width": 600, "height": 900}, "upright", Sizes(600, 500, 900, (900, 600, 500))),
        # a diameter counts twice
        ({"diameter": 80, "height": 100}, "upright", Sizes(80, 80, 100, (100, 80, 80))),
        ({"diameter": 250}, "flat", Sizes(250, 250, None, (250, 250))),
        ({"diameter": 250, "height": 30}, "flat", Sizes(250, 250, 30, (250, 250, 30))),
        # a rod: which way it stands is not stated
        ({"length": 900, "diameter": 20}, "upright", Sizes(None, None, None, (900, 20, 20))),
        ({"length": 900, "diameter": 20}, "flat", Sizes(900, 20, 20, (900, 20, 20))),
        # one horizontal size may be the longer or the shorter
        ({"width": 600, "height": 900}, "upright", Sizes(None, None, 900, (900, 600))),
        ({"length": 600, "height": 900}, "upright", Sizes(600, None, 900, (900, 600))),
        # a phone lies down, whatever its maker calls height
        ({"height": 146, "width": 71, "depth": 8}, "flat", Sizes(146, 71, 8, (146, 71, 8))),
        # a shoe of length, width, height is not on its side
        ({"length": 300, "width": 100, "height": 120}, "flat", Sizes(300, 100, 120, (300, 120, 100))),
        # a record on its edge is as flat as one that lies
        ({"length": 320, "width": 11, "height": 318}, "flat", Sizes(320, 318, 11, (320, 318, 11))),
        # length next to depth that say the same are one
        (
            {"length": 900, "width": 2000, "depth": 900, "height": 800},
            "upright",
            Sizes(2000, 900, 800, (2000, 900, 800)),
        ),
        (
            {"length": 900, "width": 2000, "depth": 903, "height": 800},
            "upright",
            Sizes(2000, 903, 800, (2000, 903, 800)),
        ),
        (
            {"length": 900, "width": 2000, "depth": 2005, "height": 800},
            "upright",
            Sizes(2000, 900, 800, (2000, 900, 800)),
        ),
        # a single size of a flat object is its length only if the word states it
        ({"length": 300}, "flat", Sizes(300, None, None, (300,))),
        ({"width": 300}, "flat", Sizes(None, None, None, (300,))),
        ({"length": 300, "width": 200}, "flat", Sizes(300, 200, None, (300, 200))),
        ({"length": 300, "height": 20}, "flat", Sizes(None, None, None, (300, 20))),
        ({"width": 40, "height": 60}, "any", Sizes(None, None, None, (60, 40))),
    ],
)
def test_words_to_axes(stated, pose, expected):
    assert sizes_from_words(stated, None, pose) == expected


def test_without_words_nothing_but_extents():
    assert sizes_from_words({}, (3.0, 9.0, 5.0), "upright") == Sizes(None, None, None, (9.0, 5.0, 3.0))
    assert sizes_from_words({"length": None}, (3.0,), "flat") == Sizes(None, None, None, (3.0,))


@pytest.mark.parametrize("extents", [None, (), (1.0, 2.0, 3.0, 4.0)])
def test_no_size_or_four_are_refused(extents):
    assert sizes_from_words({}, extents, "upright") is None


def test_four_different_words_are_refused():
    assert sizes_from_words({"length": 1.0, "width": 2.0, "depth": 3.0, "height": 4.0}, None, "upright") is None


@given(stated=words, pose=poses)
def test_axes_are_in_order_and_among_the_extents(stated, pose):
    found = sizes_from_words(stated, None, pose)
    if found is None:
        return
    assert list(found.extents) == sorted(found.extents, reverse=True)
    assert 1 <= len(found.extents) <= 3
    known = [size for size in (found.length, found.width, found.height) if size is not None]
    left = list(found.extents)
    for size in known:
        left.remove(size)  # fails if an axis has a value that was not stated
    if found.length is not None and found.width is not None:
        assert found.length >= found.width
    if pose == "any":
        assert known == []


@given(
    st.lists(st.floats(1.0, 5000.0), min_size=1, max_size=3),
    poses,
)
def test_every_reading_holds_every_number_once(extents, pose):
    row = np.full((1, 3), NAN)
    row[0, : len(extents)] = sorted(extents, reverse=True)
    x, owner = axis_assignments(np.full((1, 3), NAN), row, pose)
    assert owner.tolist() == [0] * len(x)
    for reading in x:
        assert sorted(reading[~np.isnan(reading)]) == pytest.approx(sorted(extents))
        if pose != "upright":
            assert list(reading[~np.isnan(reading)]) == sorted(extents, reverse=True)
        elif not np.isnan(reading[:2]).any():
            assert reading[0] >= reading[1]


def test_readings_keep_what_the_words_tell():
    axes = np.array([[NAN, NAN, 900.0], [2000.0, 900.0, 850.0], [NAN, NAN, NAN]])
    extents = np.array([[900.0, 600.0, NAN], [2000.0, 900.0, 850.0], [3.0, 2.0, 1.0]])
    x, owner = axis_assignments(axes, extents, "upright")
    assert owner.tolist() == [0, 0, 1, 2, 2, 2]
    assert np.nan_to_num(x[:2]).tolist() == [[600, 0, 900], [0, 600, 900]]
    assert x[2].tolist() == [2000, 900, 850]
    assert sorted(x[3:, 2].tolist()) == [1, 2, 3]


def test_sizes_that_differ_by_half_a_per_cent_are_one_size() -> None:
    words = {"length": 1000.0, "width": 600.0, "height": 900.0}
    assert sizes_from_words(words | {"depth": 602.9}, None, "upright") == Sizes(1000, 602.9, 900, (1000, 900, 602.9))
    assert sizes_from_words(words | {"depth": 603.1}, None, "upright") is None  # four sizes
    rod, disc = {"length": 20.11, "diameter": 20.0}, {"length": 20.09, "diameter": 20.0}
    assert sizes_from_words(rod, None, "flat") == Sizes(20.11, 20.0, 20.0, (20.11, 20.0, 20.0))
    assert sizes_from_words(disc, None, "flat") == Sizes(20.0, 20.0, None, (20.0, 20.0))


def test_a_flat_object_stood_on_its_edge_if_its_height_is_half_as_large_again() -> None:
    lying, standing = ({"length": 300.0, "width": 100.0, "height": height} for height in (149.0, 151.0))
    assert sizes_from_words(lying, None, "flat") == Sizes(300, 100, 149, (300, 149, 100))
    assert sizes_from_words(standing, None, "flat") == Sizes(300, 151, 100, (300, 151, 100))


def test_a_stated_range_is_wider_by_at_most_70_percent() -> None:
    """Of a narrow range; the standard deviation of a wide one does not grow."""
    assert widened_sd(990, 1010) / range_sd(990, 1010) == pytest.approx(1.7)
    assert widened_sd(100, 400) < range_sd(100, 400)
