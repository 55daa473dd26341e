"""Find the truncated sides of an object: sides whose end no view shows, so that an extent may be too small.

The confidence eta of the paper does not detect truncation, because an object has many points even at the border of the
image. A view shows a side completely if it faces the side, or if the outline of the mask on that side is neither at the
border of the image nor at an occluder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from estimator.geometry.mask_outlines import BORDER_PX, is_at_border
from estimator.projection.cameras import project
from estimator.projection.visibility import DEPTH_IMAGE_WIDTH, DepthImages
from estimator.records.scene import Instance
from metric_base.arrays import BoolArray, FloatArray, evenly_spaced

# Maximum number of points of an outline.
MAX_OUTLINE_POINTS = 128
# Maximum number of points of an object that are compared with the outlines.
MAX_OBJECT_POINTS = 400
# Outermost part of the outline towards a side, relative to the extent of the mask in that direction.
OUTER_FRACTION = 0.12
# Error of an outline relative to the diagonal of the mask, at least `BORDER_PX`: networks compute masks at a quarter of
# the resolution.
BORDER_FRACTION = 0.02
# Minimum fraction of the outermost part that is at the border of the image or at an occluder, for a truncated side. If
# only a corner touches them, the side is not truncated.
MIN_CUT_FRACTION = 0.25
# Minimum sine of the angle between an axis and the line of sight (17 degrees) at which the outline shows the ends of
# the axis. If a side faces away from the camera by more than this angle, only the top can outline it.
MIN_VISIBLE_SINE = 0.3
# Minimum sine of the same angle at which the excess of the mask over the points is measured. At smaller angles, the
# other axes contribute to the excess.
MIN_EXCESS_SINE = 0.7
# The top outlines a side that faces away from the camera if at least `MIN_TOP_FRACTION` of the points in the outer
# `END_BAND` next to the side are in the upper `TOP_BAND` of the height. The points on the wall of a round object are at
# all heights, so that its sides have no such outline.
END_BAND = 0.125
TOP_BAND = 0.25
MIN_TOP_FRACTION = 0.5
# Minimum horizontal extent, relative to the height, of an extent that the top outlines. In a narrower box, the points
# in the upper band may be on a front whose lower part is occluded. Of 18 extents in rooms (seeds 1000 to 1003) at whose
# ends no mask is compared with the points, seven are below this value and eleven above it; five of the seven and one of
# the eleven are 26 to 75 % too small.
MIN_TOP_ASPECT = 0.5
# Minimum distance of an occluder in front of the object, relative to its diagonal.
MIN_OCCLUDER_DISTANCE = 0.1
# Minimum height of an occluder above the foot of the object, relative to the height of the object; it excludes the
# floor in front.
MIN_OCCLUDER_HEIGHT = 0.1
# Minimum number of views that show a side: a point is triangulated from two views.
MIN_COMPLETE_VIEWS = 2
# Minimum median excess of the masks over the points at a side of which a part was not reconstructed, relative to the
# extent and after subtraction of the error of the outline. It is twice the standard deviation of the extent rule.
MIN_EXCESS_FRACTION = 0.06


@dataclass(frozen=True, slots=True, eq=False)
class MaskOutline:
    """The outline of one mask."""

    pixels: FloatArray  #: (k, 2)
    is_at_border: BoolArray  #: (k,) at the border of the image.
    tolerance: float = BORDER_PX  #: Error in pixels.


@dataclass(frozen=True, slots=True, eq=False)
class SideVisibility:
    """Visibility of the sides of an object (low and high end of length, width and height) in v masks."""

    is_shown: BoolArray  #: (v, 3, 2) the view shows the side to its end.
    excess: FloatArray  #: (v, 3, 2) excess of the mask over the points, relative to the extent; NaN if unknown.
    #: (3,) extents that are truncated unless enough views compare masks and points at one end.
    needs_excess: BoolArray = field(default_factory=lambda: np.zeros(3, dtype=bool))

    @property
    def median_excess(self) -> FloatArray:
        """(3, 2) median excess over the views; NaN if fewer than `MIN_COMPLETE_VIEWS`, and not all, have a value."""
        is_known = np.isfinite(self.excess).sum(axis=0) >= min(MIN_COMPLETE_VIEWS, len(self.excess))
        filled = np.where(is_known, self.excess, 0.0)
        return np.where(is_known, np.nanmedian(filled, axis=0), np.nan)

    @property
    def truncated(self) -> BoolArray:
        """(3, 2) sides that too few views show, or where the masks exceed the points.

        An extent is also truncated if no single view shows both of its ends.
        An extent with `needs_excess` is truncated on both sides if the masks cannot be compared with the points at
        either end, because the views look along the axis or the end is occluded. For example, only the front of a
        washing machine between cupboards has points, so that its measured depth is too small.
        """
        n_views = min(MIN_COMPLETE_VIEWS, len(self.is_shown))
        is_short: BoolArray = np.nan_to_num(self.median_excess) > MIN_EXCESS_FRACTION
        is_compared = (np.isfinite(self.excess).sum(axis=0) >= n_views).any(axis=1) | ~self.needs_excess  # (3,)
        truncated = (self.is_shown.sum(axis=0) < n_views) | is_short | ~is_compared[:, None]
        truncated[:, 0] |= ~truncated.any(axis=1) & ~self.is_shown.all(axis=2).any(axis=0)
        return np.asarray(truncated)


def mask_outline(instance: Instance, contour: FloatArray, width: int, height: int) -> MaskOutline:
    """Return the outline of a mask with contour (k, 2), from `mask_contour`, in an image of the given size."""
    if not len(contour):
        return MaskOutline(np.empty((0, 2)), np.empty(0, dtype=bool))
    pixels = contour[:: max(1, len(contour) // MAX_OUTLINE_POINTS)]
    tolerance = max(BORDER_PX, BORDER_FRACTION * float(np.hypot(*instance.mask.shape)))
    return MaskOutline(pixels, is_at_border(pixels, width, height), tolerance)


def side_visibility(
    masks: Sequence[Instance],
    outlines: Sequence[MaskOutline],
    images: DepthImages,
    box: tuple[FloatArray, FloatArray, FloatArray],
    points: FloatArray,
) -> SideVisibility:
    """Determine which masks show the low and the high end of length, width and height.

    Parameters
    ----------
    masks : sequence of Instance
        Masks of the object.
    outlines : sequence of MaskOutline
    images : DepthImages
        Depth images of the scene, for occluders.
    box : tuple of (3, 3), (3,) and (3,) ndarray of float
        Axes, low and high ends of the box, as in `UprightBox`.
    points : (n, 3) ndarray of float
        Points of the object.
    """
    axes, low, high = box
    centre = (low + high) / 2 @ axes
    normals = np.stack([-axes, axes], axis=1)  # (3, 2, 3) outward
    sampled = evenly_spaced(points, MAX_OBJECT_POINTS)
    # (3, 2) whether most points next to a vertical side are on the top; True for top and bottom.
    position = ((points @ axes.T) - low) / np.maximum(high - low, np.finfo(float).tiny)
    is_top = position[:, 2] > 1 - TOP_BAND
    ends_on_top = np.ones((3, 2), dtype=bool)
    for axis in (0, 1):
        for end, is_end in enumerate((position[:, axis] < END_BAND, position[:, axis] > 1 - END_BAND)):
            n_top = int(np.count_nonzero(is_top & is_end))
            ends_on_top[axis, end] = n_top >= MIN_TOP_FRACTION * int(np.count_nonzero(is_end))
    is_shown = np.zeros((len(masks), 3, 2), dtype=bool)
    excess = np.full((len(masks), 3, 2), np.nan)
    for row, (mask, outline) in enumerate(zip(masks, outlines, strict=True)):
        if outline.pixels.size == 0:
            continue
        view = images.scene.views[mask.view]
        line_of_sight = (centre - view.centre) / np.linalg.norm(centre - view.centre)
        facing = -normals @ line_of_sight
        sine = np.sqrt(np.maximum(1 - facing**2, 0))
        is_cut, view_excess = _cut_and_excess(mask, outline, images, box, sampled)
        is_outlined = ~is_cut & ((facing > -MIN_VISIBLE_SINE) | ends_on_top)
        is_shown[row] = np.where(sine >= MIN_VISIBLE_SINE, is_outlined, facing > MIN_VISIBLE_SINE)
        if not mask.from_box:
            excess[row] = np.where((sine >= MIN_EXCESS_SINE) & ~is_cut, view_excess, np.nan)
    # The excess of filled boxes is unknown. A wide top outlines an extent that ends on it.
    is_outlined_by_top = ends_on_top.any(axis=1) & (high - low >= MIN_TOP_ASPECT * (high[2] - low[2]))
    needs_excess = ~is_outlined_by_top & (not all(mask.from_box for mask in masks))
    return SideVisibility(is_shown, excess, needs_excess)


def _cut_and_excess(
    mask: Instance,
    outline: MaskOutline,
    images: DepthImages,
    box: tuple[FloatArray, FloatArray, FloatArray],
    points: FloatArray,
) -> tuple[BoolArray, FloatArray]:
    """Return whether the outline towards each side is truncated (3, 2), and its excess over the points (n, 3) there.

    The outline is truncated by the border of the image or by an occluder. The excess is relative to the extent.
    """
    axes, low, high = box
    centre, size = (low + high) / 2, high - low
    view = images.scene.views[mask.view]
    side_centres = np.stack([centre + (end - 0.5) * np.diag(size) for end in (0, 1)], axis=1).reshape(6, 3)
    world = np.vstack([np.vstack([centre, side_centres]) @ axes, points])
    pixels = project(view.camera, view.to_camera(world))
    directions = pixels[1:7] - pixels[0]
    length = np.linalg.norm(directions, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = np.nan_to_num(directions / length[:, None])
    # Projection (6, k) of each outline pixel on the direction towards each side.
    along = directions @ outline.pixels.T
    furthest = along.max(axis=1)
    is_outer = along >= (furthest - OUTER_FRACTION * (furthest - along.min(axis=1)))[:, None]
    is_occluded = np.zeros(is_outer.shape, dtype=bool)
    if not mask.from_box:
        # The outline is occluded if just outside of it is something closer than just inside.
        side, pixel = np.nonzero(is_outer)
        step = 1.5 * view.camera.width / DEPTH_IMAGE_WIDTH * directions[side]
        edge = outline.pixels[pixel]
        depth, height = images.depths_and_heights(mask.view, np.vstack([edge + step, edge - step]))
        outside, inside = np.split(depth, 2)
        is_closer = outside < inside - MIN_OCCLUDER_DISTANCE * float(np.linalg.norm(size))
        is_above_foot = height[: len(edge)] > low[2] + MIN_OCCLUDER_HEIGHT * size[2]
        is_occluded[side, pixel] = is_closer & np.isfinite(inside) & is_above_foot
    fraction = ((is_occluded | outline.is_at_border) & is_outer).sum(axis=1) / is_outer.sum(axis=1)
    # A side whose centre is behind the camera has no direction: the object surrounds the view and is truncated there.
    is_cut = (fraction > MIN_CUT_FRACTION) | ~(length > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Points outside of the box were trimmed: they do not show the end of a side. Rounding must not decide this.
        position, rounding = points @ axes.T, 1e-6 * size
        is_trimmed = np.stack([position < low - rounding, position > high + rounding], axis=2).reshape(-1, 6)
        beyond = furthest - np.where(is_trimmed, -np.inf, pixels[7:] @ directions.T).max(axis=0)
        excess = np.maximum(np.abs(beyond) - outline.tolerance, 0) * np.sign(beyond) / (2 * length)
    return is_cut.reshape(3, 2), excess.reshape(3, 2)
