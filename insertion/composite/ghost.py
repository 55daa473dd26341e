"""The scale's interval as ghost outlines: how large the object would be at either end of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.composite.boxes import Box, window_behind
from insertion.records.result import ScaleUsed
from insertion.render.renderer import ObjectRenderer
from insertion.scene.rays import camera_rays

__all__ = ["draw_interval"]

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
