"""Labels: on the canvas, near their objects, off each other while there is room."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.outputs.label_placement import place_labels

CANVAS = (1600, 1200)


def boxes(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 1, (n, 2)) * (1500, 1100)
    return np.hstack([low, low + rng.uniform(10, 100, (n, 2))]), rng.uniform([100, 40], [220, 90], (n, 2))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 9999), n=st.integers(0, 30))
def test_labels_stay_on_the_canvas(seed: int, n: int) -> None:
    objects, sizes = boxes(seed, n)
    corners = place_labels(objects, sizes, CANVAS)
    assert corners.shape == (n, 2)
    assert (corners >= 0).all()
    assert (corners + sizes <= CANVAS).all()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 9999))
def test_few_labels_do_not_overlap(seed: int) -> None:
    objects, sizes = boxes(seed, 6)
    corners = place_labels(objects, sizes, CANVAS)
    for a in range(6):
        for b in range(a):
            gap = np.maximum(corners[a] - corners[b] - sizes[b], corners[b] - corners[a] - sizes[a])
            assert gap.max() > -1, "no line of text is hidden"


def test_a_lone_label_lies_beside_its_object() -> None:
    item = np.array([[700.0, 500.0, 760.0, 540.0]])
    size = np.array([[120.0, 50.0]])
    (corner,) = place_labels(item, size, CANVAS)
    middle = corner + size[0] / 2
    assert np.linalg.norm(middle - (730, 520)) < 120
    covered = np.minimum(corner + size[0], item[0, 2:]) - np.maximum(corner, item[0, :2])
    assert covered.min() < 25, "it does not hide the whole of it"


def test_ids_of_boxes_that_pile_up_are_apart_and_inside() -> None:
    """As on the plan: small labels of boxes at one position, which may cover their boxes."""
    objects = np.tile([[90.0, 90.0, 110.0, 110.0]], (12, 1))
    sizes = np.tile([[15.0, 11.0]], (12, 1))
    corners = place_labels(objects, sizes, (200.0, 200.0), step=6.0, cover_cost=0.0)
    low, high = corners, corners + sizes
    shared = np.maximum(np.minimum(high[:, None], high) - np.maximum(low[:, None], low), 0).prod(axis=2)
    np.fill_diagonal(shared, 0)
    assert shared.max() < 0.2 * 15 * 11
    assert (low >= 0).all()
    assert (high <= 200).all()
    assert np.hypot(*(corners + sizes / 2 - 100).T).max() < 60
