"""What one object brings to a picture, as layers through the recovered lens; nothing of the picture is in them yet.

Which pixels of a picture an object and its shadow change, and the window of the ideal picture behind them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import Camera, View
from insertion.render.body import Body
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.render.shadow_maps import ShadowCatcher
from insertion.scene.camera_rays import Window, camera_rays, focal_lengths
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray

#: Pixels around the projected vertices: blur and filters reach so far.
MARGIN_PX = 6
#: Light on the plane that is dimmed by less than this is not worth a pixel.
MIN_SHADOW = 0.004
#: A shadow on other objects is drawn this far from the object, in its sizes: as far as that on its support.
CAST_SIZES = 3.0
#: The ideal picture behind a strongly curved lens is cut at this many times the picture.
WIDEST = 3.0


def object_box(view: View, body: Body) -> PixelBox | None:
    """Pixels that the object may cover; None where it is out of the picture."""
    return _box_of(view, body.position + body.unit * body.corners)


def shadow_box(view: View, body: Body, plane: ShadowCatcher) -> PixelBox | None:
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
def _shadow_places(plane: ShadowCatcher) -> FloatArray:
    """(n, 2) some of the places of a map that lie in shadow, along the plane's axes in the local frame."""
    cells = np.argwhere((1 - plane.share).max(axis=-1) > MIN_SHADOW)  # rows, columns
    cells = cells[:: max(1, len(cells) // 4000), ::-1]
    return np.asarray(((cells + 0.5) / len(plane.share) * 2 - 1) * plane.radius)


def _box_of(view: View, points: FloatArray) -> PixelBox | None:
    """Pixels that points (n, 3) of the scene cover, with a margin; None where they are out of the picture."""
    local = view.to_camera(points)
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


@dataclass(frozen=True, slots=True, eq=False)
class ObjectLayers:
    """The layers of one object over a box of a picture.

    image : the object itself; plane_share : (h, w, 3) of the light that still reaches its support plane; plane_depth :
    (h, w) of that plane in scene units, NaN where a pixel does not look at it.
    """

    box: PixelBox
    image: ObjectImage
    catcher_light: NDArray[np.float32]
    plane_depth: NDArray[np.float32]

    @property
    def silhouette(self) -> tuple[int, int, int, int] | None:
        """The box of the object's own pixels (x, y, width, height); None without any."""
        own = self.image.alpha > 0.5
        rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
        if not len(rows):
            return None
        x, y = self.box.x0 + int(columns[0]), self.box.y0 + int(rows[0])
        return x, y, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1


def object_layers(renderer: ObjectRenderer, view: View, full_size: bool = False) -> ObjectLayers | None:
    """The layers of an object in a view; None where neither it nor its shadow is in the picture.

    whole : over the whole picture instead of the box that they change.
    """
    own = object_box(view, renderer.body)
    dark = shadow_box(view, renderer.body, renderer.plane)
    if own is None and dark is None:
        return None
    box = dark.union(own) if dark is not None else own
    assert box is not None  # one of the two is there
    box = box.union(cast_box(view, renderer.body, renderer.shadow_directions))
    if full_size:
        box = PixelBox(0, 0, view.camera.width, view.camera.height)
    image = ObjectImage(
        np.zeros((*box.shape, 3), np.float32), np.zeros(box.shape, np.float32), np.full(box.shape, np.nan, np.float32)
    )
    if own is not None:
        part = object_layer(renderer, view, own)
        for large, small in zip(
            (image.colour, image.alpha, image.depth), (part.colour, part.alpha, part.depth), strict=True
        ):
            large[own.within(box)] = small
    return ObjectLayers(box, image, *shadow_layer(renderer, view, box))


def through_lens(ideal: NDArray[np.float32], view: View, box: PixelBox, nearest: bool = False) -> NDArray[np.float32]:
    """A layer (h, w) or (h, w, c) of the ideal window behind a box, bent by the lens; 0 beyond it.

    nearest : take the nearest pixel, and NaN beyond the window, as a depth needs it.
    """
    import cv2

    window = window_behind(view.camera, box)
    rays = camera_rays(view.camera)[box.slices]
    # OpenCV counts from the centre of the first pixel, COLMAP from its corner
    x = rays[..., 0] * np.float32(window.fx) + np.float32(window.cx - window.x0 - 0.5)
    y = rays[..., 1] * np.float32(window.fy) + np.float32(window.cy - window.y0 - 0.5)
    how, beyond = (cv2.INTER_NEAREST, np.nan) if nearest else (cv2.INTER_LINEAR, 0.0)
    bent = cv2.remap(ideal, x, y, how, borderMode=cv2.BORDER_CONSTANT, borderValue=(beyond,) * 4)
    return np.asarray(bent, dtype=np.float32)


def object_layer(renderer: ObjectRenderer, view: View, box: PixelBox) -> ObjectImage:
    """The object over the box: rendered with an ideal camera, then bent by the lens."""
    ideal = renderer.image(window_behind(view.camera, box), view.rotation, view.translation)
    bent = through_lens(np.dstack([ideal.colour, ideal.alpha]), view, box)
    return ObjectImage(bent[..., :3], bent[..., 3], through_lens(ideal.depth, view, box, nearest=True))


def shadow_layer(
    renderer: ObjectRenderer, view: View, box: PixelBox
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
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


def draw_outline(
    image: NDArray[np.uint8], view: View, renderer: ObjectRenderer, ratio: float, colour: tuple[int, int, int]
) -> NDArray[np.uint8]:
    """Return an image (h, w, 3) with the outline of the object scaled by `ratio` about its foot."""
    import cv2

    box = PixelBox(0, 0, view.camera.width, view.camera.height)
    alpha = renderer.outline(window_behind(view.camera, box), view.rotation, view.translation, ratio)
    mask = np.asarray(through_lens(alpha, view, box) > 0.5, dtype=np.uint8)
    lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    out = image.copy()
    cv2.drawContours(out, lines, -1, colour, max(1, round(view.camera.width / 640)), cv2.LINE_AA)
    return out
