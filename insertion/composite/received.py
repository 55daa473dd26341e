"""The object's shadow on what each pixel really shows.

The map of light on the plane is right where a pixel shows the plane. Things that stand beside the object, the side of
the table and the floor behind its edge are not on the plane: their own places, from the cloud, meet the shadow maps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.composite.boxes import Box
from insertion.composite.masks import mask_in_box
from insertion.places.surface import Surface
from insertion.render.renderer import ObjectRenderer
from insertion.scene.cloud import FrontPoints
from insertion.scene.rays import camera_rays

__all__ = ["received_share"]

#: A pixel shows the plane if its depth is that of the plane within this share; the cloud is no better.
SAME_DEPTH = 0.045
#: Places are looked up for every second pixel: the cloud is coarser than that.
STEP = 2
#: Strays of the cloud are smaller than this many of those.
SMOOTH_CELLS = 7
#: Beyond so many sizes of the object its shadow on other things is fainter than the cloud's noise makes it.
REACH_SIZES = 1.6
#: Points that a thing's depth rests on.
MIN_POINTS = 4
#: A pixel without a mask takes the depth of a point no further than this, in pixels at a width of 640.
NEAR_PX = 9.0


def received_share(
    share: NDArray[np.float32],
    plane_depth: NDArray[np.float32],
    renderer: ObjectRenderer,
    view: View,
    box: Box,
    front: FrontPoints,
    instances: Sequence[Instance],
    plane: Surface | None,
) -> NDArray[np.float32]:
    """(h, w, 3) share of the light that still reaches what each pixel shows.

    share, plane_depth : as `shadow_layer` gives them; plane : the support plane with its extent, if it is known.
    """
    import cv2
    from scipy.ndimage import median_filter

    depth = _depths(view, box, front, instances)  # coarse, NaN unknown
    coarse_plane = plane_depth[::STEP, ::STEP]
    with np.errstate(invalid="ignore"):
        off = median_filter(np.isfinite(depth) & ~(np.abs(depth / coarse_plane - 1) < SAME_DEPTH), SMOOTH_CELLS)
    if plane is not None:
        beside = ~np.isfinite(depth) & ~_on_plane(plane, view, box, coarse_plane)
    else:
        beside = np.zeros_like(off)
    if not (off.any() or beside.any()):
        return share
    received = np.ones((*off.shape, 3), np.float32)
    if off.any():
        places, normals = _places(view, box, depth, renderer)
        middle = renderer.body.corners.mean(axis=0)
        places[..., 3] = off & (np.linalg.norm(places[..., :3] - middle, axis=-1) < REACH_SIZES)
        received = renderer.received_light(places, normals)
    weight = cv2.GaussianBlur((off | beside).astype(np.float32), (0, 0), 0.7)[..., None]
    size = (share.shape[1], share.shape[0])
    weight = cv2.resize(weight, size, interpolation=cv2.INTER_LINEAR)[..., None]
    received = cv2.resize(cv2.GaussianBlur(received, (0, 0), 2.0), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(share * (1 - weight) + received * weight, dtype=np.float32)


def _depths(view: View, box: Box, front: FrontPoints, instances: Sequence[Instance]) -> NDArray[np.float32]:
    """(h, w) depth of every STEP-th pixel of the box: of the nearest point on the same thing, NaN without one."""
    labels = np.zeros(box.shape, dtype=np.int32)
    for number, item in enumerate(instances, start=1):
        mask = mask_in_box(item, box)
        if mask is not None:
            labels[mask] = number
    inside = front.inside(box.x0, box.y0, box.x1, box.y1)
    pixels, depths = inside.pixels - [box.x0, box.y0], inside.depths
    at = pixels.astype(np.int64)
    own = labels[at[:, 1], at[:, 0]]
    coarse = labels[::STEP, ::STEP]
    result = np.full(coarse.shape, np.nan, dtype=np.float32)
    for number in np.unique(coarse):
        points = own == number
        if np.count_nonzero(points) < MIN_POINTS:
            continue
        reach = np.inf if number else NEAR_PX * view.camera.width / 640
        result[coarse == number] = _nearest(coarse == number, pixels[points], depths[points], reach)
    return result


def _nearest(
    where: NDArray[np.bool_], pixels: NDArray[np.float64], depths: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """(k,) median depth of the three nearest points of each pixel of `where` (h, w), NaN beyond `reach`."""
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(where)
    distance, nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) * STEP + 0.5, k=3)
    return np.where(distance[:, 0] <= reach, np.median(depths[nearest], axis=1), np.nan)


def _on_plane(plane: Surface, view: View, box: Box, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(h, w) whether the plane was seen where the pixels' rays meet it, at depths (h, w)."""
    rays = camera_rays(view.camera)[box.slices][::STEP, ::STEP]
    local = np.concatenate([rays, np.ones((*rays.shape[:2], 1), np.float32)], axis=-1) * depth[..., None]
    flat = ((local.reshape(-1, 3) - view.translation) @ view.rotation) @ plane.plane.basis[:2].T
    return plane.holds(flat).reshape(depth.shape)


def _places(
    view: View, box: Box, depth: NDArray[np.float32], renderer: ObjectRenderer
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(h, w, 4) places in the object's local frame and (h, w, 3) normals towards the camera."""
    import cv2

    body = renderer.body
    rays = camera_rays(view.camera)[box.slices][::STEP, ::STEP]
    known = np.isfinite(depth)
    local = np.concatenate([rays, np.ones((*rays.shape[:2], 1), np.float32)], axis=-1)
    local = local * np.where(known, depth, 0)[..., None]
    scene = (local.reshape(-1, 3) - view.translation) @ view.rotation
    places = ((scene - body.position) / body.unit).reshape(*depth.shape, 3).astype(np.float32)
    smooth = cv2.GaussianBlur(places, (0, 0), 2.0)
    across = np.gradient(smooth, axis=1)
    down = np.gradient(smooth, axis=0)
    normals = np.cross(down, across)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    eye = (view.centre - body.position) / body.unit
    turned = np.sign(((eye - places) * normals).sum(axis=-1, keepdims=True))
    return np.dstack([places, known.astype(np.float32)]), (normals * np.where(turned == 0, 1, turned)).astype(
        np.float32
    )
