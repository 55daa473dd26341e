"""Places that the pictures show to be empty air: no lamp hangs there."""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import pixels_in_view
from insertion.footage.footage import Stills
from insertion.scene.point_cloud import Cloud, even_rows, front_points
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["shown_empty"]

#: Stills that are asked.
MAX_STILLS = 12
#: Neighbouring points of the cloud that say how far a picture sees, no further than so many pixels at a width of 640.
POINTS, REACH_PX = 5, 30.0
#: A place is in front of what the picture shows if it is nearer than this share of its depth.
IN_FRONT = 0.9
#: A lamp is brighter than a picture can hold: a grey level within so many pixels at a width of 640.
CLIPPED, AROUND_PX = 245, 12


def shown_empty(places: FloatArray, cloud: Cloud, stills: Stills) -> BoolArray:
    """(n,) places (n, 3) that some picture looks through without being dazzled."""
    from scipy.spatial import cKDTree

    empty = np.zeros(len(places), dtype=bool)
    for row in even_rows(stills.rows, MAX_STILLS):
        view = stills.scene.views[row]
        front = front_points(view, cloud, row)
        pixels, depths = pixels_in_view(view, places)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]) & ~empty)
        if not len(inside) or len(front.rows) < POINTS:
            continue
        times = view.camera.width / 640
        distance, nearest = cKDTree(front.pixels).query(pixels[inside], k=POINTS)
        behind = np.median(front.depths[nearest], axis=1)
        through = (depths[inside] < IN_FRONT * behind) & (distance[:, -1] < REACH_PX * times)
        empty[inside] |= through & ~_dazzling(stills.picture(row), pixels[inside], AROUND_PX * times)
    return empty


def _dazzling(picture: np.ndarray, pixels: FloatArray, reach: float) -> BoolArray:
    """(n,) whether the picture is clipped near each pixel."""
    import cv2

    size = 2 * round(reach) + 1
    brightest = cv2.dilate(picture.max(axis=-1), np.ones((size, size), np.uint8))
    at = pixels.astype(np.int64)
    return np.asarray(brightest[at[:, 1], at[:, 0]] >= CLIPPED)
