"""Compute the light that an object's shadow leaves on the surfaces of a frame.

The surface at each pixel is the support plane, another surface of known depth, or unknown. Masks, points, and the
surroundings of a bare place determine it. Unknown surfaces have no shadow, and neither has an occluder of the object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.render.body import Body
from insertion.render.layers import CAST_SIZES, ObjectLayers
from insertion.scene.camera_rays import camera_rays, scene_positions
from insertion.scene.pixel_box import labels_in_box
from insertion.scene.point_cloud import VisiblePoints
from insertion.scene.supports import Surface
from metric_base.arrays import BoolArray, FloatArray

#: Maximum relative difference in depth between a pixel of the support plane and the plane: the accuracy of the cloud.
PLANE_DEPTH_TOLERANCE = 0.045
#: Maximum height of the unevenness of the support plane, as a fraction of the size of the object. On a cobbled street
#: the shadow is that of the plane, moved little.
MAX_UNEVENNESS = 0.06
#: Maximum distance of a point on the plane: in standard deviations of the plane, as a fraction of the depth of the
#: point, and as a fraction of the size of the object.
PLANE_SIGMAS, PLANE_NOISE, PLANE_FRACTION = 3.0, 0.012, 0.02
#: Minimum fraction of the points of an instance on the plane, if it lies on the plane (a rug, the desk itself).
MIN_FLAT_FRACTION = 0.5
#: The same for the instance below the foot of the object, whose sides may be visible too.
MIN_SUPPORT_FRACTION = 0.15
#: Minimum fraction of the pixels below the foot that belong to this instance.
MIN_FOOT_FRACTION = 0.3
#: Minimum distance between pixels at which surfaces are computed: the cloud is coarser.
MIN_STEP_PX = 2
#: Maximum number of these pixels along the width of an image.
MAX_CELLS_PER_WIDTH = 320
#: Side of the median filter that removes stray points, in cells.
MEDIAN_CELLS = 7
#: Minimum number of points for the depth of an instance.
MIN_POINTS = 4
#: Maximum distance of a point that determines the depth of a pixel without a mask, in pixels at an image width of 640.
MAX_POINT_PX = 9.0
#: Number of nearest points that decide whether an occluder is in front of a bare pixel of the plane.
N_BARE_POINTS = 5
#: Maximum number of points with a normal, and number of neighbours for a normal.
MAX_NORMALS, NEIGHBOURS = 2000, 16

#: Returns the fraction (a, b, 3) of the light that reaches positions (a, b, 4), whose fourth value is 1 if the position
#: is known, on surfaces with normals (a, b, 3), in the local frame of the object.
IrradianceFraction = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]


def transmitted_light(
    layers: ObjectLayers,
    irradiance_fraction: IrradianceFraction,
    body: Body,
    view: View,
    points: VisiblePoints,
    instances: Sequence[Instance],
    surface: Surface | None,
    occluders: BoolArray,
) -> NDArray[np.float32]:
    """Compute the fraction of the light that reaches the surface at each pixel past an object.

    Parameters
    ----------
    layers : ObjectLayers
        The object over a box of the image, with the light on its support plane.
    irradiance_fraction : callable
        Computes the light on other surfaces (see `ObjectRenderer.irradiance_fraction`); called if there are any.
    body : Body
        The object.
    view : View
        Camera and pose.
    points : VisiblePoints
        Visible points of the scene.
    instances : sequence of Instance
        Masks of the frame.
    surface : Surface or None
        The support with its extent, if it is known.
    occluders : (h, w) ndarray of bool
        Pixels of occluders of the object.

    Returns
    -------
    (h, w, 3) ndarray of float32
        0 to 1; 1 without a shadow.
    """
    from scipy.ndimage import median_filter

    # 1. Labels of the instances, and points with their labels.
    box = layers.box
    step = max(MIN_STEP_PX, round(view.camera.width / MAX_CELLS_PER_WIDTH))
    cells = (slice(step // 2, None, step),) * 2
    labels = labels_in_box(instances, box)
    inside = points.inside(box.x0, box.y0, box.x1, box.y1).observed_points()
    columns, rows = (inside.pixels - [box.x0, box.y0]).astype(np.int64).T
    point_labels = labels[rows, columns]
    if not points.dense:  # points that do not occlude the object do not remove light from the plane either
        with np.errstate(invalid="ignore"):
            is_closer = inside.depths < (1 - PLANE_DEPTH_TOLERANCE) * layers.plane_depth[rows, columns]
        is_stray = (point_labels == 0) & is_closer
        inside, point_labels = inside.subset(~is_stray), point_labels[~is_stray]
    pixels = (inside.pixels - [box.x0, box.y0]) / step
    flat_labels = _labels_on_plane(labels, point_labels, inside, layers, body, view, surface)

    # 2. Depth of each cell, that of the nearest points of the same instance.
    coarse, plane_depth = labels[cells], layers.plane_depth[cells]
    depth = _cell_depths(coarse, point_labels, pixels, inside.depths, MAX_POINT_PX * view.camera.width / 640 / step)

    # 3. Cells of the support plane: their depth is that of the plane, or they are bare and nothing is in front.
    rays = camera_rays(view.camera)[box.slices][cells]
    with np.errstate(invalid="ignore"):
        difference = np.abs(depth / plane_depth - 1)
    camera_height = float((view.centre - body.position) @ body.basis[2])
    is_level = (difference < PLANE_DEPTH_TOLERANCE) | (difference * camera_height < MAX_UNEVENNESS * body.unit)
    is_bare = ~np.isfinite(depth) & np.isfinite(plane_depth)
    if is_bare.any():
        tolerance = max(PLANE_DEPTH_TOLERANCE, MAX_UNEVENNESS * body.unit / max(camera_height, 1e-9))
        has_no_label = point_labels == 0
        is_bare &= is_not_closer(
            is_bare, plane_depth * (1 - tolerance), pixels[has_no_label], inside.depths[has_no_label]
        )
        if surface is not None:
            flat = scene_positions(view, rays, plane_depth) @ surface.plane.basis[:2].T
            is_bare &= surface.contains(flat.reshape(-1, 2)).reshape(is_bare.shape)
    has_flat_label = np.isin(coarse, flat_labels)
    is_off = median_filter(np.isfinite(depth) & ~(is_level & has_flat_label), MEDIAN_CELLS)
    on_plane = has_flat_label & (is_level | is_bare) & ~is_off

    # 4. Light on the other surfaces of known depth near the object.
    local = (scene_positions(view, rays, np.nan_to_num(depth, nan=1e6)) - body.position) / body.unit
    is_near = np.linalg.norm(local - body.corners.mean(axis=0), axis=-1) < CAST_SIZES + 1
    is_known = np.isfinite(depth) & ~on_plane & is_near & ~occluders[cells]
    positions: NDArray[np.float32] = np.asarray(np.dstack([local, is_known]), dtype=np.float32)
    received = np.ones((*is_known.shape, 3), np.float32)
    if is_known.any():
        normals = surface_normals(positions[..., :3], is_known, view, inside, body)
        received = irradiance_fraction(positions, normals)

    # 5. Enlarge within the support plane and within other instances, so that no shadow crosses an edge.
    is_apart = ~np.isin(labels, flat_labels)
    coarse_apart = is_apart[cells]
    plane_fraction = enlarge_within(on_plane[..., None].astype(np.float32), ~coarse_apart, 0.7, box.shape)
    loss = np.where(is_known[..., None], 1 - received, 0.0).astype(np.float32)
    light = 1 - (1 - layers.catcher_light) * plane_fraction - enlarge_within(loss, ~coarse_apart, 1.0, box.shape)
    if coarse_apart.any():
        light = np.where(is_apart[..., None], 1 - enlarge_within(loss, coarse_apart, 1.0, box.shape), light)
    light[occluders] = 1.0
    return np.asarray(np.clip(light, 0.0, 1.0), dtype=np.float32)


def enlarge_within(
    values: NDArray[np.float32], among: BoolArray, sigma: float, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Smooth coarse values among selected cells and enlarge them.

    Parameters
    ----------
    values : (a, b, c) ndarray of float32
        Coarse values.
    among : (a, b) ndarray of bool
        Cells that contribute.
    sigma : float
        Standard deviation of the smoothing, in cells.
    shape : tuple of int
        Rows and columns of the result.

    Returns
    -------
    (h, w, c) ndarray of float32
    """
    import cv2

    weight = among.astype(np.float32)
    stacked = np.dstack([values * weight[..., None], weight])
    stacked = cv2.GaussianBlur(stacked, (0, 0), sigma)
    stacked = cv2.resize(stacked, shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(stacked[..., :-1] / np.maximum(stacked[..., -1:], 1e-4), dtype=np.float32)


def _labels_on_plane(
    labels: NDArray[np.int32],
    point_labels: NDArray[np.int32],
    inside: VisiblePoints,
    layers: ObjectLayers,
    body: Body,
    view: View,
    surface: Surface | None,
) -> list[int]:
    """Return 0 and the labels of the instances that lie on the support plane.

    Parameters
    ----------
    labels : (h, w) ndarray of int32
        Labels of the pixels of the box.
    point_labels : (m,) ndarray of int32
        Labels of the points `inside`.
    """
    columns, rows = inside.pixels.astype(np.int64).T
    positions = scene_positions(view, camera_rays(view.camera)[rows, columns], inside.depths)
    height = np.abs((positions - body.position) @ body.basis[2])
    sigma = 0.0 if surface is None else surface.plane.sigma
    tolerance = max(PLANE_SIGMAS * sigma, PLANE_FRACTION * body.unit)
    on_plane = height < np.maximum(tolerance, PLANE_NOISE * np.asarray(inside.depths))
    alpha = layers.image.alpha
    foot = np.zeros(labels.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        foot[:-1] = (alpha[:-1] > 0.5) & (alpha[1:] <= 0.5)
    below = np.bincount(labels[np.roll(foot, 1, axis=0)], minlength=int(labels.max()) + 1)
    flat = [0]
    for label in np.unique(labels[labels > 0]):
        has_label = point_labels == label
        fraction = float(on_plane[has_label].mean()) if np.count_nonzero(has_label) >= MIN_POINTS else 0.0
        is_below = below[label] > MIN_FOOT_FRACTION * max(int(below.sum()), 1)
        if fraction >= MIN_FLAT_FRACTION or (is_below and fraction >= MIN_SUPPORT_FRACTION):
            flat.append(int(label))
    return flat


def _cell_depths(
    labels: NDArray[np.int32], point_labels: NDArray[np.int32], pixels: FloatArray, depths: FloatArray, reach: float
) -> NDArray[np.float32]:
    """Return the depth of each cell (a, b), that of the nearest points of the same instance; NaN without them.

    Parameters
    ----------
    labels, point_labels : (a, b) and (m,) ndarray of int32
        Labels of the cells and of the points.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points in units of cells, and their depths.
    reach : float
        Maximum distance of a point from a cell without an instance, in cells.
    """
    result = np.full(labels.shape, np.nan, dtype=np.float32)
    for label in np.unique(labels):
        has_label = point_labels == label
        if np.count_nonzero(has_label) < MIN_POINTS:
            continue
        wanted = labels == label
        max_distance = np.inf if label else reach
        result[wanted] = depth_of_nearest(wanted, pixels[has_label], depths[has_label], max_distance)
    return result


def depth_of_nearest(cells: BoolArray, pixels: FloatArray, depths: FloatArray, reach: float) -> FloatArray:
    """Return the median depth (k,) of the three nearest points of each selected cell, NaN beyond `reach` cells.

    The nearest point replaces those beyond the reach.

    Parameters
    ----------
    cells : (h, w) ndarray of bool
        k selected cells.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points in units of cells, and their depths.
    """
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(cells)
    distance, nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=3)
    nearest = np.where(distance <= reach, nearest, nearest[:, :1])
    return np.where(distance[:, 0] <= reach, np.median(depths[nearest], axis=1), np.nan)


def is_not_closer(
    cells: BoolArray, min_depth: NDArray[np.float32], pixels: FloatArray, depths: FloatArray
) -> BoolArray:
    """Return the cells (a, b) whose nearest points are mostly not closer than a depth; True for other cells.

    Parameters
    ----------
    cells : (a, b) ndarray of bool
        Selected cells.
    min_depth : (a, b) ndarray of float32
        Minimum depth of a point that is not closer.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points without a mask, in units of cells, and their depths.
    """
    from scipy.spatial import cKDTree

    result = np.ones(cells.shape, dtype=bool)
    if len(pixels) < N_BARE_POINTS:
        return result
    point_columns, point_rows = pixels.astype(np.int64).clip(0, np.array(cells.shape[::-1]) - 1).T
    is_closer = depths < min_depth[point_rows, point_columns]
    rows, columns = np.nonzero(cells)
    nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=N_BARE_POINTS)[1]
    result[rows, columns] = is_closer[nearest].mean(axis=1) <= 0.5
    return result


def surface_normals(
    positions: NDArray[np.float32], is_known: BoolArray, view: View, points: VisiblePoints, body: Body
) -> NDArray[np.float32]:
    """Return unit normals (h, w, 3) towards the camera, 0 at unknown positions.

    The normal is that of the nearest visible point, across the scatter of its neighbours.

    Parameters
    ----------
    positions : (h, w, 3) ndarray of float32
        Positions in the local frame of the body.
    is_known : (h, w) ndarray of bool
        Known positions.
    """
    from scipy.spatial import cKDTree

    normals = np.zeros_like(positions)
    if not is_known.any() or len(points.rows) < NEIGHBOURS:
        return normals
    columns, rows = points.pixels.astype(np.int64).T
    scene = scene_positions(view, camera_rays(view.camera)[rows, columns], points.depths)
    local = (scene - body.position) / body.unit
    low, high = positions[is_known].min(axis=0), positions[is_known].max(axis=0)
    local = local[((local > low - 0.1) & (local < high + 0.1)).all(axis=1)]
    if len(local) < NEIGHBOURS:
        return normals
    sample = local[:: max(1, len(local) // MAX_NORMALS)]
    near = local[cKDTree(local).query(sample, k=NEIGHBOURS)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    across = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))[1][:, :, 0]
    eye = (view.centre - body.position) / body.unit
    across *= np.where(((eye - sample) * across).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    normals[is_known] = across[cKDTree(sample).query(positions[is_known])[1]]
    return normals
