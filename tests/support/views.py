"""A view in three dimensions, made by hand: two boxes, one before the other, and one that is nowhere near."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.records.objects import Box, corners
from estimator.views.scene_view import COLOURS, BoxView, SceneView

__all__ = ["hand_view"]


def hand_view() -> SceneView:
    """Boxes of 1 m: `a` at the origin, `b` 3 m behind it along -z, `c` 5 m to the right, an outlier with a reason."""
    boxes = []
    for name, place, verdict in (("a", (0, 0, 0), "used"), ("b", (0, 0, -3), "used"), ("c", (5, 0, 0), "outlier")):
        box = Box(np.array(place, dtype=float), np.eye(3), np.ones(3))
        said: dict[str, Any] = {"id": name, "category": "chair", "node": "chair.n.01", "tier": "measured"}
        said |= {"verdict": verdict, "reason": "too small by half" if verdict == "outlier" else None, "weight": 0.9}
        said["sizes"] = ["h 1.00"]
        boxes.append(BoxView(name, verdict, corners(box), f"chair {name}", "1.00 x 1.00 x 1.00 m", said))
    points = np.random.default_rng(1).uniform(-3, 3, (200, 3))
    return SceneView(
        points=points,
        point_colours=np.tile(np.array(COLOURS["point"]), (200, 1)),
        cameras=np.array([[[0, 1, 4], [side, 1.8, 3]] for side in (-1, 0, 1)], dtype=float),
        boxes=tuple(boxes),
        planes=(np.array([[-3, -0.5, -4], [6, -0.5, -4], [6, -0.5, 3], [-3, -0.5, 3]], dtype=float),),
        up=np.array([[[-3, -0.5, 3], [-3, 0.5, 3]]], dtype=float),
        unit="m",
        headline="resolved: 0.5 metres per unit",
    )
