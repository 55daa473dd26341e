"""Outlines of instance masks: contours, the largest projections in eight directions, and which parts are truncated."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.projection.cameras import view_rays
from estimator.records.scene import Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray

# Left, top, right and bottom, then the directions between them.
DIRECTIONS = np.array([[-1, 0], [0, -1], [1, 0], [0, 1], [-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(
    [[1]] * 4 + [[2]] * 4
)
# Number of directions of a box.
BOX_DIRECTIONS = 4
# Standard deviation of an edge of a detector's box: pixels, plus a fraction of its side.
EDGE_SIGMA_PX = 2.0
EDGE_SIGMA_FRACTION = 0.03
# Standard deviation of an edge of a mask: pixels, plus a fraction of its diagonal.
MASK_SIGMA_PX = 1.5
MASK_SIGMA_FRACTION = 0.03
# Distance from the border of the image in pixels below which an outline is truncated there.
BORDER_PX = 2.0
# Distance beyond the outline at which another mask is an occluder: pixels, plus a fraction of the diagonal.
OCCLUDER_DISTANCE_PX = 3.0
OCCLUDER_DISTANCE_FRACTION = 0.03
# Part of the outline in a direction that determines whether it is truncated: the outermost fraction of the extent.
OUTER_FRACTION = 0.08
# Minimum fraction of this part at the border or at an occluder, for a truncated outline.
MIN_CUT_FRACTION = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The outlines of an object in v views, at unit depth."""

    max_projections: FloatArray  #: (v, 8) largest projection of the outline on each of `DIRECTIONS`.
    sigma: FloatArray  #: (v, 8) their standard deviation.
    is_free: BoolArray  #: (v, 8) the object ends there, and not at the border of the image or at an occluder.
    rotation: FloatArray  #: (v, 3, 3) from the level basis to the cameras.
    translation: FloatArray  #: (v, 3)

    def truncated_sides(self, has_foot: bool) -> BoolArray:
        """Return the extents (3,) with an end that no view shows; with `has_foot`, the lower end is known."""
        left, top, right, bottom = (bool(self.is_free[:, k].any()) for k in range(4))
        is_cut = not (left and right)
        return np.array([is_cut, is_cut, not (top and (bottom or has_foot))])

    def size_at(self, position: FloatArray) -> float:
        """Return the median of the larger of width and height, in scene units, of an object at `position` (3,)."""
        depth = (self.rotation @ position + self.translation)[:, 2]
        return float(np.median((self.max_projections[:, :2] + self.max_projections[:, 2:4]).max(axis=1) * depth))


@dataclass(frozen=True, slots=True, eq=False)
class OutlineExtents:
    """The outlines of m masks, with the fields of `Outlines`, (m, 8) each."""

    max_projections: FloatArray
    sigma: FloatArray
    is_free: BoolArray

    def of_object(self, members: Sequence[int], views: Sequence[View], basis: FloatArray) -> Outlines:
        """Return the outlines of the object with the masks `members` in `views`; `basis` (3, 3) is the level basis."""
        rows = list(members)
        rotation = np.array([view.rotation for view in views]) @ basis.T
        translation = np.array([view.translation for view in views])
        return Outlines(self.max_projections[rows], self.sigma[rows], self.is_free[rows], rotation, translation)


def mask_contour(instance: Instance) -> FloatArray:
    """Return the pixels (k, 2) of the outer contours of a mask, through the centres of its outermost pixels."""
    contours, _ = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2))
    return np.concatenate(contours)[:, 0].astype(float) + instance.origin + 0.5


def is_at_border(pixels: FloatArray, width: int, height: int) -> BoolArray:
    """Return which of the pixels (k, 2) are at the border of an image, (k,)."""
    at_border: BoolArray = np.any((pixels < BORDER_PX) | (pixels > np.array([width, height]) - BORDER_PX), axis=1)
    return at_border


def outline_extents(
    scene: Scene, instances: Sequence[Instance], contours: Sequence[FloatArray], depths: FloatArray
) -> OutlineExtents:
    """Compute the outlines of all masks.

    Parameters
    ----------
    scene : Scene
    instances : sequence of Instance
        m masks.
    contours : sequence of (k, 2) ndarray of float
        Contours of the masks, from `mask_contour`.
    depths : (m,) ndarray of float
        Median depth of the points of each mask; NaN without points.

    Notes
    -----
    Of two masks that touch, the closer one is the occluder: by the depths or, if one is unknown, the mask that ends
    lower in the image.
    """
    by_view: dict[int, list[int]] = defaultdict(list)
    for row, instance in enumerate(instances):
        by_view[instance.view].append(row)
    low = np.array([instance.origin for instance in instances], dtype=float).reshape(-1, 2)
    high = low + np.array([instance.mask.shape[::-1] for instance in instances]).reshape(-1, 2)
    reach = OCCLUDER_DISTANCE_PX + OCCLUDER_DISTANCE_FRACTION * np.linalg.norm(high - low, axis=1) + 1
    shape = (len(instances), len(DIRECTIONS))
    projections, sigma, is_free = np.zeros(shape), np.ones(shape), np.zeros(shape, dtype=bool)
    for members in by_view.values():
        rows = np.array(members)
        for row in members:
            has_depths = np.isfinite(depths[rows]) & np.isfinite(depths[row])
            is_closer = np.where(has_depths, depths[rows] < depths[row], high[rows, 1] > high[row, 1])
            is_near = (low[rows] < high[row] + reach[row]) & (high[rows] > low[row] - reach[row])
            occluders = [instances[other] for other in rows[is_closer & is_near.all(axis=1)]]
            outline = _outline_extents(scene, instances[row], contours[row], occluders)
            projections[row], sigma[row], is_free[row] = outline
    return OutlineExtents(projections, sigma, is_free)


def _outline_extents(
    scene: Scene, instance: Instance, contour: FloatArray, occluders: Sequence[Instance]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the fields (8,) of `Outlines` of a mask with contour (k, 2); `occluders` are closer masks of its view."""
    camera = scene.views[instance.view].camera
    focal = camera.focal_px  # the first parameter of every camera model is a focal length in pixels
    (height, width), origin = instance.mask.shape, np.array(instance.origin, dtype=float)
    if instance.from_box:
        pixels = np.array([[0, height / 2], [width / 2, 0], [width, height / 2], [width / 2, height]]) + origin
        sigma = (EDGE_SIGMA_PX + EDGE_SIGMA_FRACTION * np.array([width, height] * 4, dtype=float)) / focal
    elif len(contour):
        pixels = contour
        sigma = np.full(8, (MASK_SIGMA_PX + MASK_SIGMA_FRACTION * float(np.hypot(width, height))) / focal)
    else:
        return np.zeros(8), np.ones(8), np.zeros(8, dtype=bool)
    along = pixels @ DIRECTIONS.T  # (k, 8)
    furthest = along.max(axis=0)
    is_outer = along >= furthest - OUTER_FRACTION * (furthest - along.min(axis=0))
    if instance.from_box:
        is_outer = np.eye(BOX_DIRECTIONS, 8, dtype=bool)
    pixel, direction = np.nonzero(is_outer)  # (p,)
    is_cut = is_at_border(pixels, camera.width, camera.height)[pixel]
    if not instance.from_box:
        step = OCCLUDER_DISTANCE_PX + OCCLUDER_DISTANCE_FRACTION * float(np.hypot(width, height))
        outside = np.floor(pixels[pixel] + step * DIRECTIONS[direction]).astype(np.int64)  # (p, 2)
        low, high = outside.min(axis=0), outside.max(axis=0)
        for other in occluders:
            if np.all(low < np.add(other.origin, other.mask.shape[::-1])) and np.all(high >= other.origin):
                index = outside - np.array(other.origin)  # of the pixel in the mask
                inside: BoolArray = np.all((index >= 0) & (index < other.mask.shape[::-1]), axis=1)
                columns, rows = index[inside].T
                inside[inside] = other.mask[rows, columns]
                is_cut |= inside
    is_free: BoolArray = np.bincount(direction[is_cut], minlength=8) <= MIN_CUT_FRACTION * is_outer.sum(axis=0)
    # The contour is half a pixel inside the border of a mask; a box has only four directions.
    half_pixel = 0.0 if instance.from_box else 0.5 / focal
    is_free[BOX_DIRECTIONS if instance.from_box else len(DIRECTIONS) :] = False
    return (view_rays(camera, pixels)[:, :2] @ DIRECTIONS.T).max(axis=0) + half_pixel, sigma, is_free
