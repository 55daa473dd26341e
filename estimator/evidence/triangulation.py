"""A point from the pixels where several views see it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.projection.cameras import pixels_in_view, view_rays
from estimator.records.scene import View
from metric_base.arrays import FloatArray

__all__ = ["triangulate"]

#: Rays nearer to parallel than this (radians) meet anywhere.
LEAST_ANGLE = 0.01


def triangulate(views: Sequence[View], pixels: FloatArray, most_error: float) -> FloatArray | None:
    """The point (3,) nearest to the rays through `pixels` (n, 2), one a view.

    Least squares of the distances from the rays c + t d:  sum (I - d d') x = sum (I - d d') c.  The worst view is left
    out until all agree within `most_error` of the longer image side; None where two views or less are left, or where
    the rays are nearly parallel.
    """
    views, pixels = list(views), pixels.copy()
    while len(views) >= 2:
        point = _nearest(views, pixels)
        if point is None:
            return None
        errors = [_error(view, pixel, point) for view, pixel in zip(views, pixels, strict=True)]
        worst = int(np.argmax(errors))
        if errors[worst] <= most_error:
            return point
        views.pop(worst)
        pixels = np.delete(pixels, worst, axis=0)
    return None


def _nearest(views: Sequence[View], pixels: FloatArray) -> FloatArray | None:
    """(3,) point nearest to the rays of one pixel (2,) per view; None of nearly parallel rays."""
    directions = np.array(
        [view_rays(view.camera, pixel[None])[0] @ view.rotation for view, pixel in zip(views, pixels, strict=True)]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if float((directions @ directions.T).min()) > np.cos(LEAST_ANGLE):
        return None
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (n, 3, 3)
    centres = np.array([view.centre for view in views])
    return np.asarray(np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centres)))


def _error(view: View, pixel: FloatArray, point: FloatArray) -> float:
    """Distance of a pixel (2,) from that of a point (3,), as a share of the longer side; infinite behind the camera."""
    projected, depths = pixels_in_view(view, point[None])
    distance = float(np.linalg.norm(projected[0] - pixel)) / max(view.camera.width, view.camera.height)
    return distance if np.isfinite(distance) and depths[0] > 0 else np.inf
