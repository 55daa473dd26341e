"""The object and its shadow as layers over a box of a picture, through the recovered lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.render.boxes import Box, window_behind
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.scene.rays import camera_rays
from insertion.scene.scale import ScaleUsed

__all__ = ["draw_interval", "object_layer", "shadow_layer"]


def object_layer(renderer: ObjectRenderer, view: View, box: Box) -> ObjectImage:
    """The object over the box: rendered with an ideal camera, then bent by the lens."""
    import cv2

    window = window_behind(view.camera, box)
    ideal = renderer.image(window, view.rotation, view.translation)
    rays = camera_rays(view.camera)[box.slices]
    # OpenCV counts from the centre of the first pixel, COLMAP from its corner
    x = rays[..., 0] * np.float32(window.fx) + np.float32(window.cx - window.x0 - 0.5)
    y = rays[..., 1] * np.float32(window.fy) + np.float32(window.cy - window.y0 - 0.5)
    stacked = np.dstack([ideal.colour, ideal.alpha])
    bent = cv2.remap(stacked, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 0))
    depth = cv2.remap(ideal.depth, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
    return ObjectImage(bent[..., :3], bent[..., 3], depth)


def shadow_layer(renderer: ObjectRenderer, view: View, box: Box) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(h, w, 3) share of the light that still reaches the support plane, and (h, w) the plane's depth, scene units.

    The share is 1 and the depth NaN where a pixel does not look at the plane.
    """
    import cv2

    body, plane = renderer.body, renderer.plane
    rays = camera_rays(view.camera)[box.slices]
    toward = (view.rotation @ body.basis.T).astype(np.float32)  # (3, 3) columns: the plane's axes in the camera
    start = body.basis @ (view.centre - body.position)
    along = [rays[..., 0] * toward[0, k] + rays[..., 1] * toward[1, k] + toward[2, k] for k in range(3)]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(along[2] < 0, -start[2] / along[2], np.nan).astype(np.float32)
    scale = len(plane.share) / (2 * plane.radius * body.unit)
    middle = len(plane.share) / 2 - 0.5
    x = np.nan_to_num((start[0] + depth * along[0]) * scale + middle, nan=-9.0, posinf=-9.0, neginf=-9.0)
    y = np.nan_to_num((start[1] + depth * along[1]) * scale + middle, nan=-9.0, posinf=-9.0, neginf=-9.0)
    share = cv2.remap(
        plane.share, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=(1, 1, 1),
    )  # fmt: skip
    return np.asarray(share, dtype=np.float32), depth


#: Colours (red, green, blue) at the low and the high end of the scale: the object is larger at the low end.
LOW, HIGH = (255, 190, 60), (80, 220, 255)


def draw_interval(
    picture: NDArray[np.uint8], view: View, renderer: ObjectRenderer, scale: ScaleUsed
) -> NDArray[np.uint8]:
    """The picture (h, w, 3) with the object's outline at both ends of the scale's interval, if it has one."""
    import cv2

    if scale.low is None or scale.high is None:
        return picture
    out = picture.copy()
    for end, colour in ((scale.low, LOW), (scale.high, HIGH)):
        # an object of m metres is m / scale units long
        mask = _outline(view, renderer, scale.metres_per_unit / end)
        lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, lines, -1, colour, max(1, round(view.camera.width / 640)), cv2.LINE_AA)
    return out


def _outline(view: View, renderer: ObjectRenderer, times: float) -> NDArray[np.uint8]:
    """(h, w) mask, 0 or 1, of the object grown `times` about its foot, in the real picture."""
    import cv2

    whole = Box(0, 0, view.camera.width, view.camera.height)
    window = window_behind(view.camera, whole)
    alpha = renderer.outline(window, view.rotation, view.translation, times)
    rays = camera_rays(view.camera)
    x = rays[..., 0] * np.float32(window.fx) + np.float32(window.cx - window.x0 - 0.5)
    y = rays[..., 1] * np.float32(window.fy) + np.float32(window.cy - window.y0 - 0.5)
    return np.asarray(cv2.remap(alpha, x, y, cv2.INTER_LINEAR) > 0.5, dtype=np.uint8)
