"""What the pixels show, as an object's shadow meets it: its support plane, another surface, or nothing that is known.

Light is taken from a surface that is known to be where the receiver is, by masks, by the cloud, or by what surrounds a
bare place; where the depth is not known, the picture stays as it is. What hides the object hides its shadow too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.render.body import Body
from insertion.render.layers import CAST_SIZES, ObjectLayers
from insertion.scene.camera_rays import camera_rays
from insertion.scene.pixel_box import PixelBox, labels_in_box
from insertion.scene.point_cloud import FrontPoints
from insertion.scene.supports import Surface
from metric_base.arrays import BoolArray, FloatArray

#: A pixel shows the plane if its depth is that of the plane within this share; the cloud is no better. What rises or
#: falls by no more than this share of the object's size (a cobbled street) has the plane's shadow, hardly moved.
SAME_DEPTH, UNEVEN = 0.045, 0.06
#: A point is on the plane within so many sigmas of it, this share of its depth and of the object's size.
PLANE_SIGMAS, PLANE_NOISE, PLANE_SHARE = 3.0, 0.012, 0.02
#: An object lies on the plane as a whole (a rug, the desk itself) if this share of its points is on the plane; of the
#: object below the foot, which may show its sides too, this share is enough.
FLAT_SHARE, SUPPORT_SHARE = 0.5, 0.15
#: Surfaces are looked up for one pixel in so many along each side, at least two: the cloud is coarser than that.
LEAST_STEP, PER_WIDTH = 2, 320
#: Strays of the cloud are smaller than this many of those.
SMOOTH_CELLS = 7
#: Points that an object's depth rests on.
MIN_POINTS = 4
#: A pixel without a mask takes the depth of a point no further than this, in pixels at a width of 640. Beyond, so many
#: nearest points say whether the plane is there or something nearer.
NEAR_PX, AROUND_POINTS = 9.0, 5
#: Points that have a normal of their own, and their neighbours that say it.
NORMALS, NEIGHBOURS = 2000, 16


@dataclass(frozen=True, slots=True, eq=False)
class Receivers:
    """Surfaces behind every `step`-th pixel of a box.

    places : (a, b, 4) in the object's local frame, the fourth 1 where a surface off the plane is known; normals :
    (a, b, 3) towards the camera; plane : (a, b) where the support plane is seen; apart : (h, w) pixels of objects that
    are not the plane; front : (h, w) pixels of what is in front of the object.
    """

    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    plane: BoolArray
    apart: BoolArray
    front: BoolArray
    step: int


def receivers_of(
    layers: ObjectLayers,
    body: Body,
    view: View,
    front: FrontPoints,
    instances: Sequence[Instance],
    plane: Surface | None,
    in_front: BoolArray,
) -> Receivers:
    """The surfaces that an object's shadow may fall on.

    plane : the support plane with its extent, if it is known; in_front : (h, w) pixels of what hides the object.
    """
    from scipy.ndimage import median_filter

    box = layers.box
    step = max(LEAST_STEP, round(view.camera.width / PER_WIDTH))
    labels = labels_in_box(instances, box)
    inside = front.inside(box.x0, box.y0, box.x1, box.y1).seen_points()
    at = tuple((inside.pixels - [box.x0, box.y0]).astype(np.int64).T[::-1])
    own = labels[at]
    if not front.dense:  # what does not hide the object keeps no light from the plane either
        with np.errstate(invalid="ignore"):
            stray = (own == 0) & (inside.depths < (1 - SAME_DEPTH) * layers.plane_depth[at])
        inside, own = inside.kept(~stray), own[~stray]
    flat = _labels_of_plane(labels, own, inside, layers, body, view, plane)
    cells = (slice(step // 2, None, step),) * 2
    coarse, plane_depth = labels[cells], layers.plane_depth[cells]
    depth = _depths(coarse, own, inside, box, view, step)
    rays = camera_rays(view.camera)[box.slices][cells]
    with np.errstate(invalid="ignore"):
        farther = np.abs(depth / plane_depth - 1)
    rise = float((view.centre - body.position) @ body.basis[2])
    same = (farther < SAME_DEPTH) | (farther * rise < UNEVEN * body.unit)
    bare = ~np.isfinite(depth) & np.isfinite(plane_depth)
    if bare.any():
        share = max(SAME_DEPTH, UNEVEN * body.unit / max(rise, 1e-9))
        bare &= _not_nearer(bare, plane_depth * (1 - share), inside, own, box, step)
        if plane is not None:
            flat_places = _scene_places(view, rays, plane_depth) @ plane.plane.basis[:2].T
            bare &= plane.holds(flat_places.reshape(-1, 2)).reshape(bare.shape)
    of_plane = np.isin(coarse, flat)
    off = median_filter(np.isfinite(depth) & ~(same & of_plane), SMOOTH_CELLS)
    on_plane = of_plane & (same | bare) & ~off
    local = (_scene_places(view, rays, np.nan_to_num(depth, nan=1e6)) - body.position) / body.unit
    reach = np.linalg.norm(local - body.corners.mean(axis=0), axis=-1) < CAST_SIZES + 1
    known = np.isfinite(depth) & ~on_plane & reach & ~in_front[cells]
    places: NDArray[np.float32] = np.asarray(np.dstack([local, known]), dtype=np.float32)
    normals = _normals(places[..., :3], known, view, inside, body)
    return Receivers(places, normals, on_plane, ~np.isin(labels, flat), in_front, step)


def light_share(
    layers: ObjectLayers, receivers: Receivers, received: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """(h, w, 3) share of the light that still reaches what each pixel shows.

    received : (a, b, 3) the share at `receivers.places`; None where there are none.
    """
    known = receivers.places[..., 3] > 0.5
    if received is None:
        received = np.ones((*known.shape, 3), np.float32)
    coarse_apart = receivers.apart[receivers.step // 2 :: receivers.step, receivers.step // 2 :: receivers.step]
    # each class of surface is smoothed within itself, so that no shadow crosses the edge of an object
    ground, beside = ~coarse_apart, coarse_apart
    shape = layers.box.shape
    on_plane = _spread(receivers.plane[..., None].astype(np.float32), ground, 0.7, shape)
    loss = np.where(known[..., None], 1 - received, 0.0).astype(np.float32)
    share = 1 - (1 - layers.plane_share) * on_plane - _spread(loss, ground, 1.0, shape)
    if coarse_apart.any():
        share = np.where(receivers.apart[..., None], 1 - _spread(loss, beside, 1.0, shape), share)
    share[receivers.front] = 1.0
    return np.asarray(np.clip(share, 0.0, 1.0), dtype=np.float32)


def _spread(values: NDArray[np.float32], among: BoolArray, sigma: float, shape: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w, c) coarse values (a, b, c) smoothed among the cells (a, b), and enlarged to a shape."""
    import cv2

    weight = among.astype(np.float32)
    stacked = np.dstack([values * weight[..., None], weight])
    stacked = cv2.GaussianBlur(stacked, (0, 0), sigma)
    stacked = cv2.resize(stacked, shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(stacked[..., :-1] / np.maximum(stacked[..., -1:], 1e-4), dtype=np.float32)


def _labels_of_plane(
    labels: NDArray[np.int32],
    own: NDArray[np.int32],
    inside: FrontPoints,
    layers: ObjectLayers,
    body: Body,
    view: View,
    plane: Surface | None,
) -> list[int]:
    """The labels (h, w) of objects that lie on the support plane as a whole, and 0; own : (m,) labels of the points."""
    at = inside.pixels.astype(np.int64)
    scene = _scene_places(view, camera_rays(view.camera)[at[:, 1], at[:, 0]], inside.depths)
    rise = np.abs((scene - body.position) @ body.basis[2])
    sigma = 0.0 if plane is None else plane.plane.sigma
    level = rise < np.maximum(
        max(PLANE_SIGMAS * sigma, PLANE_SHARE * body.unit), PLANE_NOISE * np.asarray(inside.depths)
    )
    image = layers.image
    foot = np.zeros(labels.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        foot[:-1] = (image.alpha[:-1] > 0.5) & (image.alpha[1:] <= 0.5)  # what is just below the object
    below = np.bincount(labels[np.roll(foot, 1, axis=0)], minlength=int(labels.max()) + 1)
    flat = [0]
    for number in np.unique(labels[labels > 0]):
        points = own == number
        share = float(level[points].mean()) if np.count_nonzero(points) >= MIN_POINTS else 0.0
        under = below[number] > 0.3 * max(int(below.sum()), 1)
        if share >= FLAT_SHARE or (under and share >= SUPPORT_SHARE):
            flat.append(int(number))
    return flat


def _depths(
    coarse: NDArray[np.int32], own: NDArray[np.int32], inside: FrontPoints, box: PixelBox, view: View, step: int
) -> NDArray[np.float32]:
    """(a, b) depth of each cell: of the nearest points on the same object, NaN without them; coarse : (a, b) labels."""
    result = np.full(coarse.shape, np.nan, dtype=np.float32)
    pixels = (inside.pixels - [box.x0, box.y0]) / step
    for number in np.unique(coarse):
        points = own == number
        if np.count_nonzero(points) < MIN_POINTS:
            continue
        reach = np.inf if number else NEAR_PX * view.camera.width / 640
        result[coarse == number] = _nearest(coarse == number, pixels[points], inside.depths[points], reach / step)
    return result


def _nearest(where: BoolArray, pixels: FloatArray, depths: FloatArray, reach: float) -> FloatArray:
    """(k,) median depth of the three nearest points of each cell of `where` (h, w), NaN beyond `reach` cells.

    In place of those beyond, the nearest one counts.
    """
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(where)
    distance, nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=3)
    nearest = np.where(distance <= reach, nearest, nearest[:, :1])
    return np.where(distance[:, 0] <= reach, np.median(depths[nearest], axis=1), np.nan)


def _not_nearer(
    where: BoolArray, least: NDArray[np.float32], inside: FrontPoints, own: NDArray[np.int32], box: PixelBox, step: int
) -> BoolArray:
    """(a, b) whether the points around the cells `where` (a, b) are not mostly nearer than `least` (a, b)."""
    from scipy.spatial import cKDTree

    result = np.ones(where.shape, dtype=bool)
    some = own == 0
    if np.count_nonzero(some) < AROUND_POINTS:
        return result
    pixels = (inside.pixels[some] - [box.x0, box.y0]) / step
    at = pixels.astype(np.int64).clip(0, np.array(where.shape[::-1]) - 1)
    nearer = inside.depths[some] < least[at[:, 1], at[:, 0]]
    rows, columns = np.nonzero(where)
    nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=AROUND_POINTS)[1]
    result[rows, columns] = nearer[nearest].mean(axis=1) <= 0.5
    return result


def _scene_places(view: View, rays: NDArray[np.float32], depth: NDArray[np.floating]) -> FloatArray:
    """(..., 3) places in the scene on rays (..., 2) at depths (...)."""
    local = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1) * depth[..., None]
    return np.asarray((local - view.translation) @ view.rotation)


def _normals(
    places: NDArray[np.float32], known: BoolArray, view: View, front: FrontPoints, body: Body
) -> NDArray[np.float32]:
    """(h, w, 3) normals towards the camera, 0 where places (h, w, 3) are not `known` (h, w).

    That of the nearest point of the view, which is across its neighbours' spread.
    """
    from scipy.spatial import cKDTree

    normals = np.zeros_like(places)
    if not known.any() or len(front.rows) < NEIGHBOURS:
        return normals
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
