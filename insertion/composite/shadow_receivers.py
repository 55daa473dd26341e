"""Compute the light that an object's shadow leaves on the surfaces of a frame.

The shadow falls on a continuous proxy of the scene, as on a shadow catcher: the support plane plus a smooth offset that
the points determine. Few points do not make a hole, because the plane is the proxy unless most of the nearest points
contradict it. Only masks separate surfaces: an occluder of the object, or a thing next to it, has its own proxy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.render.body import Body
from insertion.render.layers import CAST_SIZES, ObjectLayers
from insertion.scene.camera_rays import camera_rays, scene_positions, surface_normals
from insertion.scene.pixel_box import labels_in_box
from insertion.scene.point_cloud import VisiblePoints
from insertion.scene.supports import Surface
from metric_base.arrays import BoolArray, FloatArray

#: Maximum relative difference in depth between the proxy and the support plane up to which the proxy counts as the
#: plane: the accuracy of the cloud. The shadow of the plane fades to zero at twice this difference.
PLANE_DEPTH_TOLERANCE = 0.045
#: The same as a height, relative to the size of the object. On a cobbled or slightly sloping street the shadow of
#: the plane is used, because it is displaced only slightly.
MAX_UNEVENNESS = 0.12
#: Maximum distance of a point on the plane: in standard deviations of the plane, as a fraction of the depth of the
#: point, and as a fraction of the size of the object.
PLANE_SIGMAS, PLANE_NOISE, PLANE_FRACTION = 3.0, 0.012, 0.02
#: Minimum fraction of the points of an instance near the plane for an instance that lies on it (a rug, the desk
#: itself).
MIN_FLAT_FRACTION = 0.5
#: Minimum fraction of the pixels below the foot of the object that belong to the instance it stands on.
MIN_FOOT_FRACTION = 0.3
#: Minimum distance between pixels at which the proxy is computed: the cloud is coarser.
MIN_STEP_PX = 2
#: Maximum number of these pixels along the width of an image.
MAX_CELLS_PER_WIDTH = 320
#: Number of nearest points whose median is the offset of the proxy; a minority of them are ignored as outliers.
N_PROXY_POINTS = 9
#: Maximum distance of these points, in pixels at an image width of 640; if no point is closer, the proxy is the plane.
MAX_POINT_PX = 28.0
#: Standard deviation of the smoothing of the proxy, in cells.
PROXY_SIGMA = 1.5
#: Minimum number of points for the depth of an instance.
MIN_POINTS = 4

#: Returns the fraction (a, b, 3) of the light that reaches positions (a, b, 4) on surfaces with normals (a, b, 3), in
#: the local frame of the object. The fourth value of a position is 1 if the position is known.
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
    # 1. Labels of the instances, and points with their labels. A sparse point that is in front of the object and
    #    in no mask is ignored: it neither occludes the object nor cuts its shadow.
    box = layers.box
    step = max(MIN_STEP_PX, round(view.camera.width / MAX_CELLS_PER_WIDTH))
    cells = (slice(step // 2, None, step),) * 2
    labels = labels_in_box(instances, box)
    inside = points.subset(points.in_box(box)).observed_points()
    columns, rows = (inside.pixels - [box.x0, box.y0]).astype(np.int64).T
    if not points.dense:
        front = float(view.to_camera(body.position + body.unit * body.corners)[:, 2].min())
        kept = (labels[rows, columns] > 0) | (inside.depths > front)
        inside, rows, columns = inside.subset(kept), rows[kept], columns[kept]
    point_labels = labels[rows, columns]
    flat_labels = _labels_on_plane(labels, point_labels, inside, layers, body, view, surface, occluders)

    # 2. The proxy: the inverse depth of the plane, which is affine in the pixels, plus an offset for each label.
    rays = camera_rays(view.camera)[box.slices]
    plane = plane_inverse_depth(rays, view, body)
    offsets = 1 / inside.depths - plane[rows, columns]
    pixels = (inside.pixels - [box.x0, box.y0]) / step
    rays, coarse, inverse = rays[cells], labels[cells], plane[cells]
    reach = MAX_POINT_PX * view.camera.width / 640 / step
    for label in np.unique(coarse):
        is_flat, has_label = label in flat_labels, point_labels == label
        offset = proxy_offset(coarse == label, pixels[has_label], offsets[has_label], reach if is_flat else None)
        inverse = np.where(coarse == label, inverse + offset, inverse)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(inverse > 0, 1 / inverse, np.nan).astype(np.float32)
        difference = np.abs(depth * plane[cells] - 1)
    camera_height = float((view.centre - body.position) @ body.basis[2])
    tolerance = max(PLANE_DEPTH_TOLERANCE, MAX_UNEVENNESS * body.unit / max(camera_height, 1e-9))
    has_flat_label = np.isin(coarse, flat_labels)
    on_plane = np.where(has_flat_label, np.clip(2 - np.nan_to_num(difference, nan=9.0) / tolerance, 0, 1), 0.0)

    # 3. Light on the parts of the proxy that are not the plane, near the object.
    local = (scene_positions(view, rays, np.nan_to_num(depth, nan=1e6)) - body.position) / body.unit
    is_near = np.linalg.norm(local - body.corners.mean(axis=0), axis=-1) < CAST_SIZES + 1
    is_known = np.isfinite(depth) & (on_plane < 1) & is_near & ~occluders[cells]
    positions: NDArray[np.float32] = np.asarray(np.dstack([local, is_known]), dtype=np.float32)
    received = np.ones((*is_known.shape, 3), np.float32)
    if is_known.any():
        normals = surface_normals(depth, rays) @ view.rotation.astype(np.float32)
        received = irradiance_fraction(positions, normals)

    # 4. Enlarge within the support and within other instances, so that no shadow crosses an edge.
    is_apart = ~np.isin(labels, flat_labels)
    coarse_apart = is_apart[cells]
    plane_fraction = enlarge_within(on_plane[..., None].astype(np.float32), ~coarse_apart, 0.7, box.shape)
    loss = np.where(is_known[..., None], (1 - received) * (1 - on_plane[..., None]), 0.0).astype(np.float32)
    light = 1 - (1 - layers.catcher_light) * plane_fraction - enlarge_within(loss, ~coarse_apart, 1.0, box.shape)
    if coarse_apart.any():
        light = np.where(is_apart[..., None], 1 - enlarge_within(loss, coarse_apart, 1.0, box.shape), light)
    light[occluders] = 1.0
    return np.asarray(np.clip(light, 0.0, 1.0), dtype=np.float32)


def plane_inverse_depth(rays: NDArray[np.float32], view: View, body: Body) -> FloatArray:
    """Return the inverse depth (h, w) of the support plane on rays (h, w, 2); negative above the horizon.

    With the normal n in the camera and the height h of the camera, 1 / z = -n . (x, y, 1) / h.
    """
    normal = view.rotation @ body.basis[2]
    height = float((view.centre - body.position) @ body.basis[2])
    return np.asarray(-(rays @ normal[:2] + normal[2]) / (height if abs(height) > 1e-12 else 1e-12), dtype=np.float64)


def proxy_offset(cells: BoolArray, pixels: FloatArray, offsets: FloatArray, reach: float | None) -> FloatArray:
    """Return the smooth offset (a, b) of the proxy from the plane in inverse depth.

    Parameters
    ----------
    cells : (a, b) ndarray of bool
        Cells of one instance, or those without an instance.
    pixels, offsets : (m, 2) and (m,) ndarray of float
        Points in units of cells, and their offsets.
    reach : float or None
        Maximum distance of a point in cells; if fewer points are within reach, the missing ones have the offset 0,
        so that the proxy is the plane unless most points contradict it. None for an instance off the plane: its points
        determine it at any distance, and the offset is NaN if there are fewer than `MIN_POINTS`.
    """
    from scipy.spatial import cKDTree

    smooth = np.zeros(cells.shape)
    if len(pixels) < MIN_POINTS:
        return smooth if reach is not None else np.full(cells.shape, np.nan)
    rows, columns = np.nonzero(cells)
    count = N_PROXY_POINTS if reach is not None else min(N_PROXY_POINTS, len(pixels))
    _, nearest = cKDTree(pixels).query(
        np.column_stack([columns, rows]) + 0.5, k=[*range(1, count + 1)], distance_upper_bound=reach or np.inf
    )
    values = np.append(offsets, 0.0)[nearest]  # the index of a missing point is the number of points
    smooth[rows, columns] = np.median(values, axis=1)
    enlarged = enlarge_within(smooth[..., None].astype(np.float32), cells, PROXY_SIGMA, cells.shape)
    return np.asarray(enlarged[..., 0], dtype=np.float64)


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
    occluders: BoolArray,
) -> list[int]:
    """Return 0 and the labels of the instances that lie on the support plane, or that the object stands on.

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
    alpha = layers.image.coverage
    foot = np.zeros(labels.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        foot[:-1] = (alpha[:-1] > 0.5) & (alpha[1:] <= 0.5)
    below = np.bincount(labels[np.roll(foot, 1, axis=0) & ~occluders], minlength=int(labels.max()) + 1)
    flat = [0]
    for label in np.unique(labels[labels > 0]):
        has_label = point_labels == label
        fraction = float(on_plane[has_label].mean()) if np.count_nonzero(has_label) >= MIN_POINTS else 0.0
        is_below = below[label] > MIN_FOOT_FRACTION * max(int(below.sum()), 1)
        if fraction >= MIN_FLAT_FRACTION or is_below:
            flat.append(int(label))
    return flat
