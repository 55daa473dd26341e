"""Points that views look through, on each side of every threshold."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.records.scene import Camera, View
from insertion.scene.stray_points import stray_points

VIEW = View(
    "a",
    Camera("PINHOLE", 640, 480, np.array([500.0, 500.0, 320.5, 240.5])),
    np.eye(3),
    np.zeros(3),
    np.empty((0, 2)),
    np.empty(0, dtype=np.int64),
)
#: A point, three points of a surface behind it, and three at its depth, all in one cell of 7 pixels.
BACK, NEAR = np.array([1, 2, 3]), np.array([4, 5, 6])


def _is_stray(depth: float, n_back: int, n_near: int, per_surface: int = 3) -> bool:
    """Whether the point is a stray: views that observe the surface behind it, at a depth of 2, and at its depth."""
    points = np.outer([depth, 2, 2, 2, depth, depth, depth], [0.0, 0.0, 1.0])
    seen_by = [BACK[:per_surface]] * n_back + [NEAR[:per_surface]] * n_near
    return bool(stray_points(points, [VIEW] * len(seen_by), seen_by)[0])


@pytest.mark.parametrize(
    ("depth", "n_back", "n_near", "is_stray"),
    [
        (1.89, 2, 0, True),  # DEPTH_TOLERANCE of 0.05
        (1.91, 2, 0, False),
        (1.5, 2, 0, True),  # MIN_VIEWS
        (1.5, 1, 0, False),
        (1.5, 5, 3, True),  # MIN_VIEW_RATIO of 1.5
        (1.5, 4, 3, False),
    ],
)
def test_views_look_through_a_stray_point(depth: float, n_back: int, n_near: int, is_stray: bool) -> None:
    assert _is_stray(depth, n_back, n_near) == is_stray


@pytest.mark.parametrize(("per_surface", "is_stray"), [(2, False), (3, True)])
def test_three_points_determine_a_surface(per_surface: int, is_stray: bool) -> None:
    assert _is_stray(1.5, 2, 0, per_surface) == is_stray
