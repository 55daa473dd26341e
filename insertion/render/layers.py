"""Layers of an object through the lens of a frame, before compositing, and the pixels that they change."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
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

#: Margin around the projected vertices in pixels: the radius of blur and filters.
MARGIN_PX = 6
#: Minimum fraction of the light that a shadow removes; smaller losses are invisible.
MIN_SHADOW = 0.004
#: Maximum length of a shadow beyond the support plane, in sizes of the object; on the plane it is `MAP_HEIGHTS`.
CAST_SIZES = 3.0
#: Maximum size of the undistorted image relative to the image, for lenses with strong distortion.
MAX_WINDOW_RATIO = 3.0
#: Coordinate of pixels without a ray: it is outside of the window, so that they are empty.
NO_RAY_PX = -9.0


def object_box(view: View, body: Body) -> PixelBox | None:
    """Return the pixels that the object may cover, None if it is outside of the image."""
    return _box_of(view, body.position + body.unit * body.corners)


def shadow_box(view: View, body: Body, plane: ShadowCatcher) -> PixelBox | None:
    """Return the pixels that the shadow on the support plane may cover, None if it is outside of the image."""
    flat = _shadow_places(plane)
    if not len(flat) or (view.centre - body.position) @ body.basis[2] <= 0:
        return None
    return _box_of(view, body.position + body.unit * flat @ body.basis[:2])


def cast_box(view: View, body: Body, directions: FloatArray) -> PixelBox | None:
    """Return the pixels above the support plane that the shadow may cover, None if it is outside of the image.

    Parameters
    ----------
    directions : (n, 3) ndarray of float
        Directions towards the lights.
    """
    low, high = body.corners.min(axis=0), body.corners.max(axis=0)
    ends = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 1, 3)
    fall = np.maximum(directions @ body.basis[2], 1e-6)
    length = np.clip((ends @ body.basis[2]) / fall, 0.0, CAST_SIZES)  # (8, n)
    points = np.concatenate([ends[:, 0], (ends - length[..., None] * directions).reshape(-1, 3)])
    return _box_of(view, body.position + body.unit * points)


def window_behind(camera: Camera, box: PixelBox) -> Window:
    """Return the part of the undistorted image that covers a box of the image."""
    fx, fy, cx, cy = focal_lengths(camera)
    rays = camera_rays(camera)[box.slices].reshape(-1, 2)
    rays = rays[np.isfinite(rays).all(axis=1)]  # corners beyond the maximum of a distortion polynomial have no ray
    low, high = (rays.min(axis=0), rays.max(axis=0)) if len(rays) else (np.zeros(2), np.zeros(2))
    limit = MAX_WINDOW_RATIO * np.array([camera.width / fx, camera.height / fy])
    low, high = np.clip(low, -limit, limit), np.clip(high, -limit, limit)
    x0, y0 = int(np.floor(fx * low[0] + cx - 1.5)), int(np.floor(fy * low[1] + cy - 1.5))
    x1, y1 = int(np.ceil(fx * high[0] + cx + 1.5)), int(np.ceil(fy * high[1] + cy + 1.5))
    return Window(fx, fy, cx, cy, x0, y0, x1 - x0, y1 - y0)


@lru_cache(maxsize=8)
def _shadow_places(plane: ShadowCatcher) -> FloatArray:
    """Return a sample (n, 2) of the positions in shadow, along the axes of the plane in the local frame."""
    cells = np.argwhere((1 - plane.share).max(axis=-1) > MIN_SHADOW)  # rows, columns
    cells = cells[:: max(1, len(cells) // 4000), ::-1]
    return np.asarray(((cells + 0.5) / len(plane.share) * 2 - 1) * plane.radius)


def _box_of(view: View, points: FloatArray) -> PixelBox | None:
    """Return the pixels of points (n, 3) of the scene with a margin, None if they are outside of the image."""
    local = view.to_camera(points)
    width, height = view.camera.width, view.camera.height
    ahead = local[:, 2] > 1e-6 * np.abs(local).max()
    if not ahead.any():
        return None
    pixels = project(view.camera, local)
    known = np.isfinite(pixels[:, 0])
    if not known.any():
        return None
    if not known.all():  # a part is behind the camera or outside of the lens model
        return PixelBox(0, 0, width, height)
    low = np.clip(np.floor(pixels.min(axis=0)) - MARGIN_PX, 0, [width, height]).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + MARGIN_PX, 0, [width, height]).astype(int)
    return PixelBox(int(low[0]), int(low[1]), int(high[0]), int(high[1])) if (high > low).all() else None


@dataclass(frozen=True, slots=True, eq=False)
class ObjectLayers:
    """Layers of an object over a box of an image.

    Attributes
    ----------
    box : PixelBox
        Pixels of the layers.
    image : ObjectImage
        The object.
    catcher_light : (h, w, 3) ndarray of float32
        Fraction of the light that reaches the support plane.
    plane_depth : (h, w) ndarray of float32
        Depth of the support plane in scene units, NaN for pixels that do not show it.
    """

    box: PixelBox
    image: ObjectImage
    catcher_light: NDArray[np.float32]
    plane_depth: NDArray[np.float32]

    @property
    def silhouette(self) -> tuple[int, int, int, int] | None:
        """Box of the pixels of the object (x, y, width, height), None without pixels."""
        is_object = self.image.coverage > 0.5
        rows, columns = np.flatnonzero(is_object.any(axis=1)), np.flatnonzero(is_object.any(axis=0))
        if not len(rows):
            return None
        x, y = self.box.x0 + int(columns[0]), self.box.y0 + int(rows[0])
        return x, y, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1


def object_layers(renderer: ObjectRenderer, view: View, full_size: bool = False) -> ObjectLayers | None:
    """Return the layers of an object in a view, None if neither the object nor its shadow is in the image.

    Parameters
    ----------
    full_size : bool, default False
        Layers of the complete image, not only of the pixels that may change.
    """
    own = object_box(view, renderer.body)
    dark = shadow_box(view, renderer.body, renderer.plane)
    if own is None and dark is None:
        return None
    box = dark.union(own) if dark is not None else own
    assert box is not None  # one of the two exists
    box = box.union(cast_box(view, renderer.body, renderer.shadow_directions))
    if full_size:
        box = PixelBox(0, 0, view.camera.width, view.camera.height)
    light, plane_depth = shadow_layer(renderer, view, box)
    image = ObjectImage(
        np.zeros((*box.shape, 3), np.float32), np.zeros(box.shape, np.float32), np.full(box.shape, np.nan, np.float32)
    )
    if own is not None:
        part = object_layer(renderer, view, own)
        if part.glass is not None and part.shift is not None:
            image = replace(image, glass=np.zeros((*box.shape, 4), np.float32))
            image = replace(image, shift=np.zeros((*box.shape, 2), np.float32))
            with np.errstate(invalid="ignore"):  # the support is behind the object; above the horizon it is far away
                middle = np.float32(view.to_camera(renderer.body.position[None])[0, 2])
                depth = np.where(np.isfinite(part.depth), part.depth, middle)  # an edge has no depth
                distance = 1 - depth / plane_depth[own.within(box)]
            part.shift[...] *= np.clip(np.nan_to_num(distance, nan=1.0), 0.0, 1.0)[..., None]
        for field in fields(image):
            if getattr(image, field.name) is not None:
                getattr(image, field.name)[own.within(box)] = getattr(part, field.name)
    return ObjectLayers(box, image, light, plane_depth)


def through_lens(ideal: NDArray[np.float32], view: View, box: PixelBox, nearest: bool = False) -> NDArray[np.float32]:
    """Return a layer (h, w) or (h, w, c) of the undistorted window with the distortion of the lens, 0 outside of it.

    Parameters
    ----------
    nearest : bool, default False
        Use the nearest pixel without interpolation, and NaN outside of the window, for depths.
    """
    import cv2

    window = window_behind(view.camera, box)
    rays = camera_rays(view.camera)[box.slices]
    # the origin of OpenCV is the centre of the first pixel, that of COLMAP its corner
    x = rays[..., 0] * np.float32(window.fx) + np.float32(window.cx - window.x0 - 0.5)
    y = rays[..., 1] * np.float32(window.fy) + np.float32(window.cy - window.y0 - 0.5)
    how, beyond = (cv2.INTER_NEAREST, np.nan) if nearest else (cv2.INTER_LINEAR, 0.0)
    x, y = np.nan_to_num(x, nan=NO_RAY_PX), np.nan_to_num(y, nan=NO_RAY_PX)
    bent = cv2.remap(ideal, x, y, how, borderMode=cv2.BORDER_CONSTANT, borderValue=(beyond,) * 4)
    return np.asarray(bent, dtype=np.float32)


def object_layer(renderer: ObjectRenderer, view: View, box: PixelBox) -> ObjectImage:
    """Render the object for a box of pixels without distortion, then apply the distortion of the lens."""
    ideal = renderer.image(window_behind(view.camera, box), view.rotation, view.translation)
    bent = through_lens(np.dstack([ideal.colour, ideal.alpha]), view, box)
    glass, shift = (None if layer is None else through_lens(layer, view, box) for layer in (ideal.glass, ideal.shift))
    return ObjectImage(bent[..., :3], bent[..., 3], through_lens(ideal.depth, view, box, nearest=True), glass, shift)


def shadow_layer(
    renderer: ObjectRenderer, view: View, box: PixelBox
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the fraction (h, w, 3) of the light that reaches the support plane, and its depth (h, w) in scene units.

    The fraction is 1 and the depth NaN for pixels that do not show the plane.
    """
    import cv2

    body, plane = renderer.body, renderer.plane
    rays = camera_rays(view.camera)[box.slices]
    toward = (view.rotation @ body.basis.T).astype(np.float32)  # (3, 3) columns: axes of the plane in the camera
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
