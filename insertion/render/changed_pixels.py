"""Which pixels of a picture an object and its shadow change, and the window of the ideal picture behind them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from estimator.projection.cameras import project
from estimator.records.scene import Camera, View
from insertion.render.body import Body
from insertion.render.pinhole import Window, focal_lengths
from insertion.render.shadow_maps import PlaneMap
from insertion.scene.pixel_box import PixelBox
from insertion.scene.rays import camera_rays
from metric_base.arrays import FloatArray

__all__ = ["CAST_SIZES", "cast_box", "object_box", "shadow_box", "window_behind"]

#: Pixels around the projected vertices: blur and filters reach so far.
MARGIN_PX = 6
#: Light on the plane that is dimmed by less than this is not worth a pixel.
SHADOW_SHARE = 0.004
#: A shadow on other objects is drawn this far from the object, in its sizes: as far as that on its support.
CAST_SIZES = 3.0
#: The ideal picture behind a strongly curved lens is cut at this many times the picture.
WIDEST = 3.0


def object_box(view: View, body: Body) -> PixelBox | None:
    """Pixels that the object may cover; None where it is out of the picture."""
    return _box_of(view, body.position + body.unit * body.corners)


def shadow_box(view: View, body: Body, plane: PlaneMap) -> PixelBox | None:
    """Pixels that the shadow on the support plane may cover; None where it is out of the picture."""
    flat = _shadow_places(plane)
    if not len(flat) or (view.centre - body.position) @ body.basis[2] <= 0:
        return None
    return _box_of(view, body.position + body.unit * flat @ body.basis[:2])


def cast_box(view: View, body: Body, directions: FloatArray) -> PixelBox | None:
    """Pixels that the shadow on other objects may cover, above the support plane; None where it is out of the picture.

    directions : (n, 3) towards the lights that cast it.
    """
    low, high = body.corners.min(axis=0), body.corners.max(axis=0)
    ends = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 1, 3)
    fall = np.maximum(directions @ body.basis[2], 1e-6)
    length = np.clip((ends @ body.basis[2]) / fall, 0.0, CAST_SIZES)  # (8, n)
    points = np.concatenate([ends[:, 0], (ends - length[..., None] * directions).reshape(-1, 3)])
    return _box_of(view, body.position + body.unit * points)


def window_behind(camera: Camera, box: PixelBox) -> Window:
    """The part of the ideal (undistorted) picture that fills a box of the real one."""
    fx, fy, cx, cy = focal_lengths(camera)
    rays = camera_rays(camera)[box.slices]
    low, high = rays.reshape(-1, 2).min(axis=0), rays.reshape(-1, 2).max(axis=0)
    limit = WIDEST * np.array([camera.width / fx, camera.height / fy])
    low, high = np.clip(low, -limit, limit), np.clip(high, -limit, limit)
    x0, y0 = int(np.floor(fx * low[0] + cx - 1.5)), int(np.floor(fy * low[1] + cy - 1.5))
    x1, y1 = int(np.ceil(fx * high[0] + cx + 1.5)), int(np.ceil(fy * high[1] + cy + 1.5))
    return Window(fx, fy, cx, cy, x0, y0, x1 - x0, y1 - y0)


@lru_cache(maxsize=8)
def _shadow_places(plane: PlaneMap) -> FloatArray:
    """(n, 2) some of the places of a map that lie in shadow, along the plane's axes in the local frame."""
    cells = np.argwhere((1 - plane.share).max(axis=-1) > SHADOW_SHARE)  # rows, columns
    cells = cells[:: max(1, len(cells) // 4000), ::-1]
    return np.asarray(((cells + 0.5) / len(plane.share) * 2 - 1) * plane.radius)


def _box_of(view: View, points: FloatArray) -> PixelBox | None:
    """Pixels that points (n, 3) of the scene cover, with a margin; None where they are out of the picture."""
    local = points @ view.rotation.T + view.translation
    width, height = view.camera.width, view.camera.height
    ahead = local[:, 2] > 1e-6 * np.abs(local).max()
    if not ahead.any():
        return None
    pixels = project(view.camera, local)
    known = np.isfinite(pixels[:, 0])
    if not known.any():
        return None
    if not known.all():  # part of it is behind the camera or past the lens's edge
        return PixelBox(0, 0, width, height)
    low = np.clip(np.floor(pixels.min(axis=0)) - MARGIN_PX, 0, [width, height]).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + MARGIN_PX, 0, [width, height]).astype(int)
    return PixelBox(int(low[0]), int(low[1]), int(high[0]), int(high[1])) if (high > low).all() else None
