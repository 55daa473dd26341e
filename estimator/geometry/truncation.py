"""Truncation: which sides of an object no view shows to their end, so that a dimension can only be short.

The paper's eta does not see it: an object cut by the image border is dense at the cut. A view shows a side when the
mask's outline on that side touches neither the image border nor something nearer, or when the view faces the side
itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.projection.cameras import project
from estimator.projection.visibility import DEPTH_IMAGE_WIDTH, DepthImages
from estimator.records.scene import Instance, View
from metric_base.arrays import BoolArray, FloatArray

# Points of a mask's outline, and of the object, that are looked at.
OUTLINE_POINTS, OWN_POINTS = 128, 400
# The outermost part of the outline towards a side, as a share of the mask's extent that way.
OUTER_SHARE = 0.12
# Mask borders are good to about two pixels.
BORDER_PX = 2.0
# ... and to this share of the mask's diagonal, which is what networks at a quarter of the resolution leave.
BORDER_SHARE = 0.02
# Outline points at the border or behind something that make a side cut: a quarter; a corner that touches is not a cut
# side.
CUT_SHARE = 0.25
# A direction is seen as such when the line of sight is at least 17 degrees off it; a face when it is as much off
# grazing.
SEEN_SINE = 0.3
# How far a mask goes beyond the points is told apart from other axes only when it is seen nearly across.
TOLD_SINE = 0.7
# A side that faces away from the camera is still outlined by the top, if what lies next to it is the top: half of the
# points in the outer eighth lie in the upper quarter. A round object's wall is at all heights there.
END_BAND, TOP_BAND, TOP_SHARE = 0.125, 0.25, 0.5
# What hides an object lies nearer than it by at least this share of its diagonal, and above its foot: the table in
# front is no cover.
NEARER_SHARE = 0.1
ABOVE_FOOT_SHARE = 0.1
# A point is triangulated from two views, so a side is complete when two views show it.
VIEWS_NEEDED = 2
# A mask that goes further than the object's points by this share of the box's length, past the border's own error, has
# a part that was not reconstructed: twice the spread of the extent rule.
SHORT_SHARE = 0.06


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Outline of one mask: pixels (k, 2), which touch the image border (k,), and how well it is known, in pixels."""

    pixels: FloatArray
    at_border: BoolArray
    tolerance: float = BORDER_PX


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """How v masks of an object show its sides (low and high end of length, width, height).

    shown : (v, 3, 2) whether the view shows the side to its end; excess : (v, 3, 2) how far the mask goes beyond the
    points there, as a share of the box's length along that axis, NaN where the view cannot tell.
    """

    shown: BoolArray
    excess: FloatArray

    @property
    def beyond(self) -> FloatArray:
        """(3, 2) median excess over the views; NaN where fewer than two tell."""
        is_known = np.isfinite(self.excess).sum(axis=0) >= VIEWS_NEEDED
        filled = np.where(is_known, self.excess, 0.0)
        return np.where(is_known, np.nanmedian(filled, axis=0), np.nan)

    @property
    def truncated(self) -> BoolArray:
        """(3, 2) sides that too few views show, or where the masks go further than the points."""
        unseen = self.shown.sum(axis=0) < min(VIEWS_NEEDED, len(self.shown))
        short: BoolArray = np.nan_to_num(self.beyond) > SHORT_SHARE
        return np.asarray(unseen | short)


def outline(instance: Instance, width: int, height: int) -> Outline:
    """The outline of a mask in an image of the given size."""
    contours, _ = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return Outline(np.empty((0, 2)), np.empty(0, dtype=bool))
    pixels = np.concatenate(contours)[:, 0].astype(float) + instance.origin + 0.5
    pixels = pixels[:: max(1, len(pixels) // OUTLINE_POINTS)]
    far = np.array([width, height]) - BORDER_PX
    at_border: BoolArray = np.any((pixels < BORDER_PX) | (pixels > far), axis=1)
    tolerance = max(BORDER_PX, BORDER_SHARE * float(np.hypot(*instance.mask.shape)))
    return Outline(pixels, at_border, tolerance)


def side_evidence(
    members: Sequence[Instance],
    outlines: Sequence[Outline],
    surroundings: DepthImages,
    box: tuple[FloatArray, FloatArray, FloatArray],
    points: FloatArray,
) -> Sides:
    """How each mask shows the low and the high end of length, width and height.

    box : axes (3, 3), low (3,), high (3,) as in `Dimensions`; points : (n, 3) the object's own.
    """
    axes, low, high = box
    centre = (low + high) / 2 @ axes
    # (3, 2, 3) outward normals
    normals = np.stack([-axes, axes], axis=1)
    own = points[:: max(1, -(-len(points) // OWN_POINTS))]
    topped = _ends_on_top(points @ axes.T, low, high)
    shown = np.zeros((len(members), 3, 2), dtype=bool)
    excess = np.full((len(members), 3, 2), np.nan)
    for number, (instance, border) in enumerate(zip(members, outlines, strict=True)):
        if border.pixels.size == 0:
            continue
        view = surroundings.scene.views[instance.view]
        sight = (centre - view.centre) / np.linalg.norm(centre - view.centre)
        facing = -normals @ sight
        sine = np.sqrt(np.maximum(1 - facing**2, 0))
        cut, beyond = _cut_and_excess(view, instance, border, surroundings, box, own)
        outlined = ~cut & ((facing > -SEEN_SINE) | topped)
        shown[number] = np.where(sine >= SEEN_SINE, outlined, facing > SEEN_SINE)
        if not instance.from_box:
            excess[number] = np.where((sine >= TOLD_SINE) & ~cut, beyond, np.nan)
    return Sides(shown, excess)


def _ends_on_top(local: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """(3, 2) whether the points next to a vertical side are those of the top; True for top and bottom."""
    share = (local - low) / np.maximum(high - low, np.finfo(float).tiny)
    top = share[:, 2] > 1 - TOP_BAND
    ends = np.ones((3, 2), dtype=bool)
    for axis in (0, 1):
        for end, band in enumerate((share[:, axis] < END_BAND, share[:, axis] > 1 - END_BAND)):
            ends[axis, end] = int(np.count_nonzero(top & band)) >= TOP_SHARE * int(np.count_nonzero(band))
    return ends


def _cut_and_excess(
    view: View,
    instance: Instance,
    border: Outline,
    surroundings: DepthImages,
    box: tuple[FloatArray, FloatArray, FloatArray],
    own: FloatArray,
) -> tuple[BoolArray, FloatArray]:
    """Two (3, 2): whether the outline towards a side is cut, and how far it goes beyond the points there.

    own : (n, 3) the object's points; the second is a share of the box's length along that axis. Cut by the image border
    or by something nearer.
    """
    axes, low, high = box
    centre, size = (low + high) / 2, high - low
    middles = np.stack([centre + (end - 0.5) * np.diag(size) for end in (0, 1)], axis=1).reshape(6, 3)
    ends = _pixels(view, np.vstack([np.vstack([centre, middles]) @ axes, own]))
    towards = ends[1:7] - ends[0]
    length = np.linalg.norm(towards, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = np.nan_to_num(towards / length[:, None])
    # (6, k) how far out each outline point lies towards each side
    out = towards @ border.pixels.T
    reach = out.max(axis=1)
    outer = out >= (reach - OUTER_SHARE * (reach - out.min(axis=1)))[:, None]
    hidden = np.zeros(outer.shape, dtype=bool)
    if not instance.from_box:
        side, point = np.nonzero(outer)
        hidden[side, point] = _occluded_pixels(
            instance, border.pixels[point], towards[side], surroundings, (low[2], size)
        )
    share = ((hidden | border.at_border) & outer).sum(axis=1) / outer.sum(axis=1)
    # a middle behind the camera has no direction: the object surrounds the view and is cut there
    cut = (share > CUT_SHARE) | ~(length > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        beyond = reach - (ends[7:] @ towards.T).max(axis=0)
        excess = np.maximum(np.abs(beyond) - border.tolerance, 0) * np.sign(beyond) / (2 * length)
    return cut.reshape(3, 2), excess.reshape(3, 2)


def _occluded_pixels(
    instance: Instance,
    pixels: FloatArray,
    towards: FloatArray,
    surroundings: DepthImages,
    foot_and_size: tuple[float, FloatArray],
) -> BoolArray:
    """(k,) whether just outside each outline pixel (k, 2), towards (k, 2), lies something nearer than just inside."""
    foot, size = foot_and_size
    step = 1.5 * surroundings.scene.views[instance.view].camera.width / DEPTH_IMAGE_WIDTH * towards
    depth, height = surroundings.depths_and_heights(instance.view, np.vstack([pixels + step, pixels - step]))
    outside, inside = np.split(depth, 2)
    nearer = outside < inside - NEARER_SHARE * float(np.linalg.norm(size))
    above = height[: len(pixels)] > foot + ABOVE_FOOT_SHARE * size[2]
    return np.asarray(nearer & np.isfinite(inside) & above)


def _pixels(view: View, points: FloatArray) -> FloatArray:
    """(n, 2) pixels of world points, also outside the image; NaN behind the camera."""
    return project(view.camera, points @ view.rotation.T + view.translation)
