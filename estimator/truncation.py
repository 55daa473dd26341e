"""Truncation: which sides of an object no view shows to their end, so that the dimension can only be short (methods.md).

The paper's eta does not see it: an object cut by the image border is dense at the cut. A view shows a side when the mask's outline on
that side touches neither the image border nor something nearer, or when the view faces the side itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from estimator.cameras import pixels_in_view, projected
from estimator.labels import PointLabels
from estimator.scene import BoolArray, FloatArray, Instance, Scene, View

__all__ = ["Outline", "Surroundings", "outline", "shown_sides", "truncated_sides"]

# Points of a mask's outline that are looked at.
OUTLINE_POINTS = 96
# The outermost part of the outline towards a side, as a share of the mask's extent that way.
OUTER_SHARE = 0.12
# Mask borders are good to about two pixels.
BORDER_PX = 2.0
# Outline points at the border or behind something that make a side cut: a quarter; a corner that touches is not a cut side.
CUT_SHARE = 0.25
# A direction is seen as such when the line of sight is at least 17 degrees off it; a face when it is as much off grazing.
SEEN_SINE = 0.3
# A side that faces away from the camera is still outlined by the top, if what lies next to it is the top: half of the points in
# the outer eighth lie in the upper quarter. A round thing's wall is at all heights there.
END_BAND, TOP_BAND, TOP_SHARE = 0.125, 0.25, 0.5
# What hides an object lies nearer than it by at least this share of its diagonal, and above its foot: the table in front is no cover.
NEARER_SHARE = 0.1
ABOVE_FOOT_SHARE = 0.1
# Cells of the depth picture along the image's width; holes in it are read as nothing there.
DEPTH_CELLS = 160
MAX_DEPTH_POINTS = 40_000
# A point is triangulated from two views, so a side is complete when two views show it.
VIEWS_NEEDED = 2


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Outline of one mask: pixels (k, 2), and which of them touch the image border (k,)."""

    pixels: FloatArray
    at_border: BoolArray


@dataclass(slots=True, eq=False)
class Surroundings:
    """What the views see around an object: the nearest cloud point per cell of each view, made when first asked for."""

    scene: Scene
    labels: PointLabels
    up: FloatArray
    _pictures: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    def depths_and_heights(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) depth and height along up of the nearest point at each pixel; depth is infinite where there is none."""
        if view not in self._pictures:
            self._pictures[view] = self._picture(view)
        depth, height = self._pictures[view]
        camera = self.scene.views[view].camera
        index = np.floor(pixels * (DEPTH_CELLS / camera.width)).astype(np.int64)
        inside = ((index >= 0) & (index < depth.shape[::-1])).all(axis=1)
        columns, lines = np.where(inside[:, None], index, 0).T
        return np.where(inside, depth[lines, columns], np.inf), height[lines, columns]

    def _picture(self, number: int) -> tuple[FloatArray, FloatArray]:
        view, matrix = self.scene.views[number], self.labels.visibility
        rows = matrix.indices[matrix.indptr[number] : matrix.indptr[number + 1]]
        points = self.labels.points[rows[:: max(1, -(-len(rows) // MAX_DEPTH_POINTS))]]
        lines = int(view.camera.height * DEPTH_CELLS / view.camera.width) + 1
        depth, height = np.full((lines, DEPTH_CELLS), np.inf), np.zeros((lines, DEPTH_CELLS))
        pixels, z = pixels_in_view(view, points)
        ahead = np.flatnonzero(np.isfinite(pixels).all(axis=1))
        # farthest first, so that the nearest is written last
        ahead = ahead[np.argsort(-z[ahead])]
        cells = (pixels[ahead] * (DEPTH_CELLS / view.camera.width)).astype(np.int64)
        depth[cells[:, 1], cells[:, 0]] = z[ahead]
        height[cells[:, 1], cells[:, 0]] = points[ahead] @ self.up
        return depth, height


def outline(instance: Instance, width: int, height: int) -> Outline:
    """The outline of a mask in an image of the given size."""
    contours, _ = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return Outline(np.empty((0, 2)), np.empty(0, dtype=bool))
    pixels = np.concatenate(contours)[:, 0].astype(float) + instance.origin + 0.5
    pixels = pixels[:: max(1, len(pixels) // OUTLINE_POINTS)]
    at_border = ((pixels < BORDER_PX) | (pixels > np.array([width, height]) - BORDER_PX)).any(axis=1)
    return Outline(pixels, at_border)


def truncated_sides(shown: BoolArray) -> BoolArray:
    """(3, 2) True for the sides that too few of the views (v, 3, 2) show."""
    return np.asarray(shown.sum(axis=0) < min(VIEWS_NEEDED, len(shown)))


def shown_sides(
    members: Sequence[Instance],
    outlines: Sequence[Outline],
    surroundings: Surroundings,
    axes: FloatArray,
    low: FloatArray,
    high: FloatArray,
    points: FloatArray,
) -> BoolArray:
    """(v, 3, 2) whether each mask shows the low and the high end of length, width and height.

    axes, low, high : the object's box as in `Dimensions`; points : (n, 3) the object's own.
    """
    centre = (low + high) / 2 @ axes
    half = (high - low) / 2
    # (3, 2, 3) outward normals, and the middles of the six sides
    normals = np.stack([-axes, axes], axis=1)
    middles = centre + half[:, None, None] * normals
    topped = _ends_on_top(points @ axes.T, low, high)
    shown = np.zeros((len(members), 3, 2), dtype=bool)
    for number, (instance, border) in enumerate(zip(members, outlines, strict=True)):
        if border.pixels.size == 0:
            continue
        view = surroundings.scene.views[instance.view]
        sight = (centre - view.centre) / np.linalg.norm(centre - view.centre)
        facing = -normals @ sight
        across = np.sqrt(np.maximum(1 - facing**2, 0)) >= SEEN_SINE
        cut = _cut(view, instance, border, surroundings, centre, middles, float(low[2]), 2 * half)
        outlined = ~cut & ((facing > -SEEN_SINE) | topped)
        shown[number] = np.where(across, outlined, facing > SEEN_SINE)
    return shown


def _ends_on_top(local: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """(3, 2) whether the points next to a side are those of the top; the vertical sides of the box only, True for the others."""
    share = (local - low) / np.maximum(high - low, np.finfo(float).tiny)
    top = share[:, 2] > 1 - TOP_BAND
    ends = np.ones((3, 2), dtype=bool)
    for axis in (0, 1):
        for end, band in enumerate((share[:, axis] < END_BAND, share[:, axis] > 1 - END_BAND)):
            ends[axis, end] = np.count_nonzero(top & band) >= TOP_SHARE * max(np.count_nonzero(band), 1)
    return ends


def _cut(
    view: View,
    instance: Instance,
    border: Outline,
    surroundings: Surroundings,
    centre: FloatArray,
    middles: FloatArray,
    foot: float,
    size: FloatArray,
) -> BoolArray:
    """(3, 2) whether the outline towards each side is cut by the image border or by something nearer."""
    ends = _pixels(view, np.vstack([centre, middles.reshape(-1, 3)]))
    towards = ends[1:] - ends[0]
    length = np.linalg.norm(towards, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = np.nan_to_num(towards / length)
    # (6, k) how far out each outline point lies towards each side
    out = towards @ border.pixels.T
    reach = out.max(axis=1, keepdims=True)
    outer = out >= reach - OUTER_SHARE * (reach - out.min(axis=1, keepdims=True))
    hidden = np.zeros(outer.shape, dtype=bool)
    if not instance.from_box:
        for side, points in enumerate(outer):
            hidden[side, points] = _hidden(instance, border.pixels[points], towards[side], surroundings, foot, size)
    share = ((hidden | border.at_border) & outer).sum(axis=1) / outer.sum(axis=1)
    # a middle behind the camera has no direction: the object surrounds the view and is cut there
    return np.asarray((share > CUT_SHARE) | (length[:, 0] == 0) | np.isnan(length[:, 0])).reshape(3, 2)


def _hidden(
    instance: Instance, pixels: FloatArray, towards: FloatArray, surroundings: Surroundings, foot: float, size: FloatArray
) -> BoolArray:
    """(k,) whether just outside each outline pixel lies something nearer than what is just inside, above the foot."""
    cell = surroundings.scene.views[instance.view].camera.width / DEPTH_CELLS
    outside, height = surroundings.depths_and_heights(instance.view, pixels + 1.5 * cell * towards)
    inside, _ = surroundings.depths_and_heights(instance.view, pixels - 1.5 * cell * towards)
    nearer = outside < inside - NEARER_SHARE * float(np.linalg.norm(size))
    return np.asarray(nearer & np.isfinite(inside) & (height > foot + ABOVE_FOOT_SHARE * size[2]))


def _pixels(view: View, points: FloatArray) -> FloatArray:
    """(n, 2) pixels of world points, also outside the image; NaN behind the camera."""
    return projected(view.camera, points @ view.rotation.T + view.translation)


