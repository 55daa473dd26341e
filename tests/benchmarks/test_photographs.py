"""Measures of the study of one photograph."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator.photographs import Photograph, distance_ratios, relative_accuracy
from estimator.records.scene import Instance


@pytest.mark.parametrize(("ratio", "accuracy"), [(1.0, 1.0), (1.12, 0.8), (0.88, 0.8), (1.51, 0.0)])
def test_relative_accuracy(ratio: float, accuracy: float) -> None:
    """Errors of less than 0.5, 0.45, ..., 0.05: an error of 0.12 is below eight of them."""
    assert relative_accuracy(np.array([ratio])) == pytest.approx(accuracy)
    assert relative_accuracy(np.array([ratio, 1.0])) == pytest.approx((accuracy + 1) / 2)


def test_distances_of_masks() -> None:
    depth = np.linspace(2, 4, 30 * 40).reshape(30, 40)
    mask = np.ones((20, 20), dtype=bool)
    masks = tuple(Instance(str(x), 0, "chair", mask, (x, 10)) for x in (0, 50))
    photograph = Photograph("test", (0,), (80, 60), 70.0, depth, masks)
    assert distance_ratios(photograph, 1.2 * depth) == pytest.approx([1.2, 1.2])
    nearer = np.where(np.arange(40) < 20, 0.9 * depth, depth)
    assert distance_ratios(photograph, nearer) == pytest.approx([0.9, 1.0])
