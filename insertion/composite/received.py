"""The object's shadow on what each pixel really shows.

The map of light on the plane is right where a pixel shows the plane. Things that stand beside the object, the side of
the table and the floor behind its edge are not on the plane: their own places, from the cloud, meet the shadow maps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.composite.occlusion import mask_in_box
from insertion.placement.surface import Surface
from insertion.render.boxes import CAST_SIZES, Box
from insertion.render.renderer import ObjectRenderer
from insertion.scene.cloud import FrontPoints
from insertion.scene.rays import camera_rays
from metric_base.arrays import FloatArray

__all__ = ["received_share"]

#: A pixel shows the plane if its depth is that of the plane within this share; the cloud is no better.
SAME_DEPTH = 0.045
#: Places are looked up for one pixel in so many along each side, at least two: the cloud is coarser than that.
LEAST_STEP, PER_WIDTH = 2, 320
#: Strays of the cloud are smaller than this many of those.
SMOOTH_CELLS = 7
#: Points that a thing's depth rests on.
MIN_POINTS = 4
#: A pixel without a mask takes the depth of a point no further than this, in pixels at a width of 640.
NEAR_PX = 9.0
#: Points that have a normal of their own, and their neighbours that say it.
NORMALS, NEIGHBOURS = 2000, 16


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

    step = max(LEAST_STEP, round(view.camera.width / PER_WIDTH))
    depth = _depths(view, box, front, instances, step)  # coarse, NaN unknown
    coarse_plane = plane_depth[::step, ::step]
    with np.errstate(invalid="ignore"):
        off = median_filter(np.isfinite(depth) & ~(np.abs(depth / coarse_plane - 1) < SAME_DEPTH), SMOOTH_CELLS)
    if plane is not None:
        beside = ~np.isfinite(depth) & ~_on_plane(plane, view, box, coarse_plane, step)
    else:
        beside = np.zeros_like(off)
    if not (off.any() or beside.any()):
        return share
    received = np.ones((*off.shape, 3), np.float32)
    if off.any():
        places = _places(view, box, depth, renderer, step)
        known = off & (np.linalg.norm(places - renderer.body.corners.mean(axis=0), axis=-1) < CAST_SIZES + 1)
        normals = _normals(places, known, view, front.inside(box.x0, box.y0, box.x1, box.y1), renderer)
        received = renderer.received_light(np.dstack([places, known.astype(np.float32)]), normals)
    weight = cv2.GaussianBlur((off | beside).astype(np.float32), (0, 0), 0.7)[..., None]
    size = (share.shape[1], share.shape[0])
    weight = cv2.resize(weight, size, interpolation=cv2.INTER_LINEAR)[..., None]
    received = cv2.resize(cv2.GaussianBlur(received, (0, 0), 1.0), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(share * (1 - weight) + received * weight, dtype=np.float32)


def _depths(view: View, box: Box, front: FrontPoints, instances: Sequence[Instance], step: int) -> NDArray[np.float32]:
    """(h, w) depth of every `step`-th pixel of the box: of the nearest point on the same thing, NaN without one."""
    labels = np.zeros(box.shape, dtype=np.int32)
    for number, item in enumerate(instances, start=1):
        mask = mask_in_box(item, box)
        if mask is not None:
            labels[mask] = number
    inside = front.inside(box.x0, box.y0, box.x1, box.y1)
    pixels, depths = inside.pixels - [box.x0, box.y0], inside.depths
    at = pixels.astype(np.int64)
    own = labels[at[:, 1], at[:, 0]]
    coarse = labels[::step, ::step]
    result = np.full(coarse.shape, np.nan, dtype=np.float32)
    for number in np.unique(coarse):
        points = own == number
        if np.count_nonzero(points) < MIN_POINTS:
            continue
        reach = np.inf if number else NEAR_PX * view.camera.width / 640
        result[coarse == number] = _nearest(coarse == number, pixels[points] / step, depths[points], reach / step)
    return result


def _nearest(
    where: NDArray[np.bool_], pixels: NDArray[np.float64], depths: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """(k,) median depth of the three nearest points of each cell of `where` (h, w), NaN beyond `reach` cells."""
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(where)
    distance, nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.25, k=3)
    return np.where(distance[:, 0] <= reach, np.median(depths[nearest], axis=1), np.nan)


def _on_plane(plane: Surface, view: View, box: Box, depth: NDArray[np.float32], step: int) -> NDArray[np.bool_]:
    """(h, w) whether the plane was seen where the pixels' rays meet it, at depths (h, w)."""
    flat = _scene_places(view, camera_rays(view.camera)[box.slices][::step, ::step], depth) @ plane.plane.basis[:2].T
    return plane.holds(flat.reshape(-1, 2)).reshape(depth.shape)


def _places(
    view: View, box: Box, depth: NDArray[np.float32], renderer: ObjectRenderer, step: int
) -> NDArray[np.float32]:
    """(h, w, 3) places in the object's local frame at depths (h, w), far away where these are not known."""
    body = renderer.body
    scene = _scene_places(view, camera_rays(view.camera)[box.slices][::step, ::step], np.nan_to_num(depth, nan=1e6))
    return np.asarray((scene - body.position) / body.unit, dtype=np.float32)


def _scene_places(view: View, rays: NDArray[np.float32], depth: NDArray[np.floating]) -> FloatArray:
    """(..., 3) places in the scene on rays (..., 2) at depths (...)."""
    local = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1) * depth[..., None]
    return np.asarray((local - view.translation) @ view.rotation)


def _normals(
    places: NDArray[np.float32], known: NDArray[np.bool_], view: View, front: FrontPoints, renderer: ObjectRenderer
) -> NDArray[np.float32]:
    """(h, w, 3) normals towards the camera, 0 where places (h, w, 3) are not `known` (h, w).

    That of the nearest point of the view, which is across its neighbours' spread.
    """
    from scipy.spatial import cKDTree

    normals = np.zeros_like(places)
    if not known.any() or len(front.rows) < NEIGHBOURS:
        return normals
    body = renderer.body
    at = front.pixels.astype(np.int64)
    scene = _scene_places(view, camera_rays(view.camera)[at[:, 1], at[:, 0]], front.depths)
    points = (scene - body.position) / body.unit
    low, high = places[known].min(axis=0), places[known].max(axis=0)
    points = points[((points > low - 0.1) & (points < high + 0.1)).all(axis=1)]
    if len(points) < NEIGHBOURS:
        return normals
    some = points[:: max(1, len(points) // NORMALS)]
    near = points[cKDTree(points).query(some, k=NEIGHBOURS)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    across = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))[1][:, :, 0]
    eye = (view.centre - body.position) / body.unit
    across *= np.where(((eye - some) * across).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    normals[known] = across[cKDTree(some).query(places[known])[1]]
    return normals
