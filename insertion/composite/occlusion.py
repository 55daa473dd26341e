"""Compute which pixels of an inserted object are occluded.

Masks have clean edges, so they take precedence over the cloud. A mask occludes the object completely if at least 97 %
of its points are closer than the object, and not at all if at most 3 % are. Otherwise, and outside masks if the cloud
is dense, the nearest points decide for each pixel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.colour import Image
from insertion.render.body import Body
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.frame_masks import Billboard
from insertion.scene.pixel_box import PixelBox, labels_in_box, mask_in_box
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints
from metric_base.arrays import BoolArray, FloatArray

#: Minimum number of points for a depth comparison.
MIN_POINTS = 4
#: Minimum fraction of closer points of a mask that occludes the object completely. Between this and the next fraction
#: the points decide for each pixel: the near leg of a table occludes an object under it, and the far leg does not.
FULL_OCCLUSION_FRACTION = 0.97
#: Maximum fraction of closer points of a mask that does not occlude the object.
NO_OCCLUSION_FRACTION = 0.03
#: Distance below a mask of the pixels that decide for it if it has too few points: they show its support.
SUPPORT_OFFSET_PX = 4
#: Number of nearest points of a mask that vote in each pixel.
N_VOTING_POINTS = 5
#: Minimum relative difference in depth between a point and the object: the noise of a sparse and of a dense cloud.
DEPTH_TOLERANCE, DENSE_TOLERANCE = 0.012, 0.036
#: Distance from the outline of the object within which points of a mask vote, in pixels at an image width of 640.
VOTING_RADIUS_PX = 12
#: Number of nearest points of a dense cloud that vote in a pixel without a mask.
N_DENSE_POINTS = 7
#: Maximum distance of their median from the pixel, in pixels at an image width of 640: plain surfaces have few points.
MAX_DENSE_DISTANCE_PX = 24.0
#: Minimum fraction of closer points in a pixel without a mask.
MIN_DENSE_FRACTION = 0.7
#: Maximum length of the mean unit vector to these points: 0.64 at the edge of an occluder, 1 far outside it.
MAX_ONE_SIDEDNESS = 0.85
#: Minimum number of points in front of an object and outside all masks for the warning about a possible occluder.
MIN_UNCONFIRMED_POINTS = 6
#: Width of the border of a mask whose points belong to it, in pixels at an image width of 640: masks are drawn small.
MASK_BORDER_PX = 8
#: Half the maximum width of a gap between occluders that is closed, in pixels at an image width of 640: masks do not
#: always meet.
GAP_PX = 5
#: Height above the support plane of points that belong to it, as a fraction of the size of the object.
SUPPORT_FRACTION = 0.05
#: The same as a fraction of the depth of the point: the noise of the cloud.
SUPPORT_NOISE = 0.012
#: Maximum of that height as a fraction of the size of the object, so that its upper part is never included.
MAX_SUPPORT_FRACTION = 0.3
#: Standard deviation of the blur of an edge, in pixels.
EDGE_PX = 0.6
#: Maximum distance between the edge of a mask and that in the image, in pixels at an image width of 640.
MATTE_PX = 4.0
#: Variance of the colours that the guided filter regards as texture.
MATTE_VARIANCE = 2e-4
#: Factor by which the edges of the guided filter are made steeper.
MATTE_CONTRAST = 2.5
#: Distance from 0 or 1 of a matte that is a residual of the filter, not an edge.
MATTE_RESIDUAL = 0.1


def occluded_fraction(
    layer: ObjectImage,
    box: PixelBox,
    view: View,
    instances: Sequence[Instance],
    points: VisiblePoints,
    is_support: BoolArray,
    image: Image | None = None,
    billboards: Sequence[Billboard] = (),
) -> tuple[NDArray[np.float32], BoolArray]:
    """Compute the occluded fraction of each pixel.

    Parameters
    ----------
    layer : ObjectImage
        The object over a box of the image.
    box : PixelBox
        The box.
    view : View
        Camera and pose.
    instances : sequence of Instance
        Masks of possible occluders.
    points : VisiblePoints
        Visible points of the scene.
    is_support : (m,) ndarray of bool
        Points on the support of the object, which do not occlude it.
    image : (h, w, 3) ndarray of uint8, optional
        The image over the box. Edges of occluders follow its edges; without it they follow the masks and points.
    billboards : sequence of Billboard
        Moving occluders, which are not in the reconstruction.

    Returns
    -------
    fraction : (h, w) ndarray of float32
        Occluded fraction, 0 to 1.
    mask : (h, w) ndarray of bool
        Pixels of the occluders.
    """
    import cv2
    from scipy.ndimage import distance_transform_edt

    occluded = np.zeros(box.shape, dtype=bool)
    if not (layer.coverage > 0).any():
        return np.zeros(box.shape, np.float32), occluded
    # 1. Points in the box, the surroundings of the object, and its depth, continued beyond its outline.
    in_box = points.in_box(box)
    inside = points.subset(in_box)
    pixels = inside.pixels - [box.x0, box.y0]
    depths = np.where(is_support[in_box], np.inf, inside.depths)
    observed = np.ones(len(depths), dtype=bool) if inside.observed is None else inside.observed
    width_factor = view.camera.width / 640
    reach = max(1, round(VOTING_RADIUS_PX * width_factor))
    silhouette = (layer.coverage > 0.5).astype(np.uint8)
    around = cv2.dilate(silhouette, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    nearest = distance_transform_edt(~np.isfinite(layer.depth), return_distances=False, return_indices=True)
    object_depth: NDArray[np.float32] = np.asarray(layer.depth[tuple(nearest)])

    # 2. Masks. One with too few points is an occluder if the pixels just below are occluded. Dense points in the
    #    border of a second mask may belong to that mask, and do not vote.
    size = 2 * round(MASK_BORDER_PX * width_factor) + 1
    columns, rows = pixels.astype(np.int64).T
    masks = [mask for item in instances if (mask := mask_in_box(item, box)) is not None and (mask & around).any()]
    bordered = [cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) for mask in masks]
    n_bordered = sum(bordered, np.zeros(box.shape, np.uint8))
    undecided = []
    tolerance = DENSE_TOLERANCE if points.dense else DEPTH_TOLERANCE
    for mask, own in zip(masks, bordered, strict=True):
        certain = observed & (n_bordered <= own)[rows, columns] if points.dense else observed
        part = occluded_by_mask(mask, around, object_depth, pixels, depths, certain, tolerance)
        if part is None:
            undecided.append(mask)
        else:
            occluded |= part
    for mask in undecided:
        if stands_on_occluder(occluded, mask):
            occluded |= mask

    # 3. Occluders without masks, and moving ones.
    if points.dense:
        free, max_distance = n_bordered[rows, columns] == 0, MAX_DENSE_DISTANCE_PX * width_factor
        unmasked = around & ~np.any([np.zeros(box.shape, dtype=bool), *masks], axis=0)
        occluded |= occluded_by_points(unmasked, object_depth, pixels[free], depths[free], max_distance)
    for billboard in billboards:
        occluded |= billboard.occludes(box, view, object_depth)
    gap = round(GAP_PX * width_factor)
    occluded = close_gaps(occluded, gap, object_depth, pixels[observed], depths[observed])

    # 4. Soft edges.
    if image is None or not (occluded & around).any():
        fraction = cv2.GaussianBlur(occluded.astype(np.float32), (0, 0), EDGE_PX)
    else:
        fraction = guided_matte(occluded, image, round(MATTE_PX * width_factor))
    return np.asarray(fraction), occluded


def on_support(body: Body, cloud: ColouredPoints, points: VisiblePoints, sigma: float = 0.0) -> BoolArray:
    """Return which visible points (m,) are on the support plane of a body, which never occludes it.

    Parameters
    ----------
    sigma : float
        Standard deviation of the points of the plane, in scene units. A dense cloud is rougher than the foot of a small
        object is high.
    """
    height = np.abs((cloud.points[points.rows] - body.position) @ body.basis[2])
    noise = np.minimum(np.maximum(3 * sigma, SUPPORT_NOISE * points.depths), MAX_SUPPORT_FRACTION * body.unit)
    return np.asarray(height < np.maximum(SUPPORT_FRACTION * body.unit, noise))


def guided_matte(mask: BoolArray, image: Image, reach: int) -> NDArray[np.float32]:
    """Move the edge of a mask to the nearest edge of the image by the guided filter (He, Sun and Tang 2013).

    In each window the matte is a linear function of the colours. An edge that the image does not show keeps its
    position.

    Parameters
    ----------
    mask : (h, w) ndarray of bool
        Pixels of the occluders.
    image : (h, w, 3) ndarray of uint8
        The image.
    reach : int
        Maximum distance of a moved edge, in pixels. Pixels further from the edge keep the value of the mask.

    Returns
    -------
    (h, w) ndarray of float32
        Matte, 0 to 1.
    """
    import cv2

    reach = max(reach, 2)
    size = (2 * reach + 1, 2 * reach + 1)

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.blur(values, size, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)

    # 1. The band around the edge, and the part of the image that its windows cover.
    matte = mask.astype(np.float32)
    level = cv2.blur(matte, size, borderType=cv2.BORDER_REPLICATE)
    band = (level > 1e-3) & (level < 1 - 1e-3)
    if not band.any():
        return matte
    rows, columns = np.flatnonzero(band.any(axis=1)), np.flatnonzero(band.any(axis=0))
    part = tuple(slice(max(int(ends[0]) - 2 * reach, 0), int(ends[-1]) + 2 * reach + 1) for ends in (rows, columns))
    rough = matte[part]

    # 2. In each window, the linear function of the colours that fits the mask best.
    guide = cv2.GaussianBlur(image[part], (0, 0), 0.5).astype(np.float32) / 255
    centre, level = mean(guide), mean(rough)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    products = {pair: mean(guide[..., pair[0]] * guide[..., pair[1]]) for pair in pairs}
    covariance = np.empty((*rough.shape, 3, 3), np.float32)
    for i, j in pairs:
        covariance[..., i, j] = covariance[..., j, i] = products[i, j] - centre[..., i] * centre[..., j]
    covariance += np.eye(3, dtype=np.float32) * MATTE_VARIANCE
    along = np.stack([mean(guide[..., k] * rough) - centre[..., k] * level for k in range(3)], axis=-1)
    slope = np.linalg.solve(covariance, along[..., None])[..., 0]
    offset = level - (slope * centre).sum(axis=-1)
    fitted = (mean(slope) * guide).sum(axis=-1) + mean(offset)

    # 3. The blurred mask where the image has no edge; the contrast restores 0 and 1 at a weak edge.
    filtered = np.clip((fitted - 0.5) * MATTE_CONTRAST + 0.5, 0.0, 1.0)
    strength = mean((slope * along).sum(axis=-1)) / np.maximum(mean(level * (1 - level)), 1e-3)
    weight = np.clip((strength - 0.3) / 0.4, 0.0, 1.0)
    blurred = cv2.GaussianBlur(rough, (0, 0), EDGE_PX)
    mixed = weight * filtered + (1 - weight) * blurred
    clean = np.clip((mixed - MATTE_RESIDUAL) / (1 - 2 * MATTE_RESIDUAL), 0.0, 1.0)
    matte[part] = np.where(band[part], clean, rough)
    return matte


def occluded_by_mask(
    mask: BoolArray,
    around: BoolArray,
    object_depth: NDArray[np.float32],
    pixels: FloatArray,
    depths: FloatArray,
    observed: BoolArray,
    tolerance: float = DEPTH_TOLERANCE,
) -> BoolArray | None:
    """Return the pixels in which the occluder with a mask is closer than the object.

    Parameters
    ----------
    mask, around : (h, w) ndarray of bool
        Pixels of the occluder, and those near the object.
    object_depth : (h, w) ndarray of float32
        Depth of the object.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points in the box and their depths.
    observed : (m,) ndarray of bool
        Points that are certainly visible, not behind the occluder.
    tolerance : float
        Minimum relative difference in depth between the object and a point that votes.

    Returns
    -------
    (h, w) ndarray of bool, or None
        None if the occluder has too few points.
    """
    columns, rows = pixels.astype(np.int64).T
    ratio = depths / object_depth[rows, columns]
    in_mask = mask[rows, columns] & (np.abs(ratio - 1) > tolerance)
    near = in_mask & around[rows, columns]
    groups = (near & observed, in_mask & observed, near, in_mask)
    voters = next((group for group in groups if np.count_nonzero(group) >= MIN_POINTS), None)
    if voters is None:
        return None
    is_closer = ratio[voters] < 1
    fraction = float(is_closer.mean())
    if fraction >= FULL_OCCLUSION_FRACTION:
        return mask
    if fraction <= NO_OCCLUSION_FRACTION:
        return np.zeros_like(mask)
    return mask & vote_of_points(mask, pixels[voters], is_closer)


def stands_on_occluder(occluded: BoolArray, mask: BoolArray) -> bool:
    """Return whether most pixels just below a mask (h, w) are occluded (h, w): a cup on a table in front."""
    below = np.zeros_like(mask)
    below[SUPPORT_OFFSET_PX:] = mask[:-SUPPORT_OFFSET_PX]
    below &= ~mask
    return bool(below.any()) and float(occluded[below].mean()) > 0.5


def vote_of_points(mask: BoolArray, pixels: FloatArray, is_closer: BoolArray) -> BoolArray:
    """Return the pixels (h, w) of a mask (h, w) in which most of the nearest points are closer than the object.

    Parameters
    ----------
    pixels : (m, 2) ndarray of float
        Points of the occluder.
    is_closer : (m,) ndarray of bool
        Points that are closer than the object.
    """
    from scipy.ndimage import median_filter
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(mask)
    count = min(N_VOTING_POINTS, (len(pixels) - 1) // 2 * 2 + 1)  # odd: no tie
    nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=[*range(1, count + 1)])[1]
    result = np.zeros_like(mask)
    result[rows, columns] = is_closer[nearest].mean(axis=1) > 0.5
    return np.asarray(median_filter(result, 5))


def close_gaps(
    occluded: BoolArray, reach: int, object_depth: NDArray[np.float32], pixels: FloatArray, depths: FloatArray
) -> BoolArray:
    """Close narrow gaps between occluded pixels in which no point behind the object is visible.

    Parameters
    ----------
    occluded : (h, w) ndarray of bool
        Pixels of the occluders.
    reach : int
        Half the maximum width of a gap, in pixels.
    object_depth : (h, w) ndarray of float32
        Depth of the object.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points in the box and their depths.
    """
    import cv2

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = cv2.morphologyEx(np.pad(occluded, reach).astype(np.uint8), cv2.MORPH_CLOSE, disc)
    gaps = (closed[reach:-reach, reach:-reach] > 0) & ~occluded
    count, labels = cv2.connectedComponents(gaps.astype(np.uint8))
    if count < 2:
        return occluded
    columns, rows = pixels.astype(np.int64).T
    is_behind = depths > object_depth[rows, columns] * (1 + DEPTH_TOLERANCE)
    is_open = np.bincount(labels[rows, columns][is_behind], minlength=count) > 0
    is_open[0] = True  # pixels that are no gap
    return np.asarray(occluded | ~is_open[labels])


def occluded_by_points(
    candidates: BoolArray,
    object_depth: NDArray[np.float32],
    pixels: FloatArray,
    depths: FloatArray,
    max_distance: float,
) -> BoolArray:
    """Return the candidate pixels (h, w) whose nearest points of the cloud are clearly closer than the object.

    Parameters
    ----------
    candidates : (h, w) ndarray of bool
        Pixels without a mask.
    object_depth : (h, w) ndarray of float32
        Depth of the object.
    pixels, depths : (m, 2) and (m,) ndarray of float
        Points in the box and their depths.
    max_distance : float
        Maximum median distance of the points, in pixels.
    """
    from scipy.ndimage import median_filter
    from scipy.spatial import cKDTree

    result = np.zeros_like(candidates)
    rows, columns = np.nonzero(candidates)
    if not len(rows) or len(pixels) < N_DENSE_POINTS:
        return result
    centres = np.column_stack([columns, rows]) + 0.5
    distance, nearest = cKDTree(pixels).query(centres, k=N_DENSE_POINTS)
    is_closer = depths[nearest] < object_depth[rows, columns, None] * (1 - DENSE_TOLERANCE)
    is_near = distance[:, N_DENSE_POINTS // 2] < max_distance
    toward = (pixels[nearest] - centres[:, None]) / np.maximum(distance, 1e-9)[..., None]
    is_beside = np.linalg.norm(toward.mean(axis=1), axis=1) > MAX_ONE_SIDEDNESS
    result[rows, columns] = (is_closer.mean(axis=1) > MIN_DENSE_FRACTION) & is_near & ~is_beside
    return np.asarray(median_filter(result, 5))


def has_unconfirmed_occluder(
    layers: ObjectLayers, points: VisiblePoints, is_support: BoolArray, masks: Sequence[Instance]
) -> bool:
    """Return whether sparse points outside all masks are in front of an object: a possible occluder, which is ignored.

    Parameters
    ----------
    layers : ObjectLayers
        The object over a box of the image.
    points : VisiblePoints
        Visible points of the scene.
    is_support : (m,) ndarray of bool
        Points on the support of the object.
    masks : sequence of Instance
        Masks of the frame, which decide about their own points.
    """
    box = layers.box
    observed = np.ones(len(points.rows), dtype=bool) if points.observed is None else points.observed
    rows = np.flatnonzero(points.in_box(box) & observed & ~is_support)
    pixels = (points.pixels[rows] - [box.x0, box.y0]).astype(np.int64)
    at = pixels[:, 1], pixels[:, 0]
    with np.errstate(invalid="ignore"):  # NaN outside of the object
        is_in_front = points.depths[rows] < layers.image.depth[at] * (1 - DENSE_TOLERANCE)
    is_free = labels_in_box(masks, box)[at] == 0
    return not points.dense and int(np.count_nonzero(is_in_front & is_free)) >= MIN_UNCONFIRMED_POINTS
