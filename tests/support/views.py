"""A hand-written 3-D view: two boxes, one behind the other, and a distant outlier."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.records.objects import Box, corners
from estimator.views.scene_view import COLOURS, BoxView, SceneView

__all__ = ["hand_view"]


def hand_view() -> SceneView:
    """Return a view with boxes of 1 m: `a` at the origin, `b` 3 m behind it along -z, the outlier `c` at x = 5 m."""
    boxes = []
    for name, position, verdict in (("a", (0, 0, 0), "used"), ("b", (0, 0, -3), "used"), ("c", (5, 0, 0), "outlier")):
        box = Box(np.array(position, dtype=float), np.eye(3), np.ones(3))
        record: dict[str, Any] = {"id": name, "category": "chair", "node": "chair.n.01", "tier": "measured"}
        record |= {"verdict": verdict, "reason": "too small by half" if verdict == "outlier" else None, "weight": 0.9}
        record["sizes"] = ["h 1.00"]
        boxes.append(BoxView(name, verdict, corners(box), f"chair {name}", "1.00 x 1.00 x 1.00 m", record))
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
