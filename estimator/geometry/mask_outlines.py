"""Outlines of an object in its views, as a fit takes them: how far each mask or box reaches in a few directions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.projection.cameras import view_rays
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray, FloatArray, IntArray

# Left, top, right, bottom, then between them.
DIRECTIONS = np.array([[-1, 0], [0, -1], [1, 0], [0, 1], [-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(
    [[1]] * 4 + [[2]] * 4
)
BOX_DIRECTIONS = 4
# A detector's edge is good to so many pixels and to this share of its box's side; a mask's border to less.
EDGE_PX, EDGE_SHARE = 2.0, 0.03
MASK_PX, MASK_SHARE = 1.5, 0.03
# Edges nearer to the border of the picture are cut there.
BORDER_PX = 2.0
# How far beyond the outline another mask is looked for that may hide a part, in pixels and as a share of the diagonal.
BESIDE_PX, BESIDE_SHARE = 3.0, 0.03
# The part of the outline towards a direction that decides whether it is cut: its outermost twelfth, a quarter of it.
OUTER_SHARE, CUT_SHARE = 0.08, 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The outlines of one object in v views, at unit depth.

    reach : (v, 8) furthest that the outline goes towards each of the `DIRECTIONS`; sigma : (v, 8) one standard
    deviation of it; free : (v, 8) whether it ends there, rather than at the border of the picture or behind another
    object; rotation : (v, 3, 3) and translation : (v, 3) from the level basis to the cameras.
    """

    reach: FloatArray
    sigma: FloatArray
    free: BoolArray
    rotation: FloatArray
    translation: FloatArray

    def cut_sides(self, standing: bool) -> BoolArray:
        """(3,) whether no view shows both ends of length and width, of height; standing : its foot is known."""
        left, top, right, bottom = (bool(self.free[:, k].any()) for k in range(4))
        across = not (left and right)
        return np.array([across, across, not (top and (bottom or standing))])

    def size_at(self, place: FloatArray) -> float:
        """How wide or tall an object at `place` (3,) of the level basis looks, whichever is more, scene units."""
        depth = (self.rotation @ place + self.translation)[:, 2]
        return float(np.median((self.reach[:, :2] + self.reach[:, 2:4]).max(axis=1) * depth))


@dataclass(frozen=True, slots=True, eq=False)
class Reaches:
    """How far each of m masks reaches: `reach`, `sigma` and `free`, (m, 8) as in `Outlines`."""

    reach: FloatArray
    sigma: FloatArray
    free: BoolArray

    def of(self, members: Sequence[int], instances: Sequence[Instance], scene: Scene, basis: FloatArray) -> Outlines:
        """The outlines of the object that the masks `members` show; `basis` (3, 3) has up as its last row."""
        rows = list(members)
        views = [scene.views[instances[row].view] for row in rows]
        rotation = np.array([view.rotation for view in views]) @ basis.T
        translation = np.array([view.translation for view in views])
        return Outlines(self.reach[rows], self.sigma[rows], self.free[rows], rotation, translation)


def mask_reaches(scene: Scene, instances: Sequence[Instance], depths: FloatArray) -> Reaches:
    """The reaches of all masks; depths : (m,) median depth of the points of each, NaN without points.

    Of two masks that touch, the nearer hides the other: by the depths of their points, else the one that goes lower.
    """
    by_view: dict[int, list[int]] = defaultdict(list)
    for row, instance in enumerate(instances):
        by_view[instance.view].append(row)
    shape = (len(instances), len(DIRECTIONS))
    reach, sigma, free = np.zeros(shape), np.ones(shape), np.zeros(shape, dtype=bool)
    for rows in by_view.values():
        for row in rows:
            others = [other for other in rows if other != row and _is_nearer(instances, depths, other, row)]
            reach[row], sigma[row], free[row] = _reaches(scene, instances[row], [instances[k] for k in others])
    return Reaches(reach, sigma, free)


def _is_nearer(instances: Sequence[Instance], depths: FloatArray, one: int, other: int) -> bool:
    """Whether mask `one` is before the other, by their depths (m,), else by which goes lower."""
    if np.isfinite(depths[one]) and np.isfinite(depths[other]):
        return bool(depths[one] < depths[other])
    bottoms = [instances[row].origin[1] + instances[row].mask.shape[0] for row in (one, other)]
    return bool(bottoms[0] > bottoms[1])


def _reaches(scene: Scene, instance: Instance, nearer: Sequence[Instance]) -> tuple[FloatArray, FloatArray, BoolArray]:
    """(8,) reach, sigma, free of one mask; nearer : masks of its view that may hide it."""
    camera = scene.views[instance.view].camera
    focal = float(camera.params[0])  # the first parameter of every camera model is a focal length in pixels
    (height, width), origin = instance.mask.shape, np.array(instance.origin, dtype=float)
    if instance.from_box:
        middles = np.array([[0, height / 2], [width / 2, 0], [width, height / 2], [width / 2, height]]) + origin
        pixels, count = middles, BOX_DIRECTIONS
        sides = np.array([width, height] * 4, dtype=float)
        sigma = (EDGE_PX + EDGE_SHARE * sides) / focal
    else:
        contours, _ = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if not contours:
            return np.zeros(8), np.ones(8), np.zeros(8, dtype=bool)
        # the contour runs through the outermost pixels, whose far side is half a pixel on
        pixels, count = np.concatenate(contours)[:, 0].astype(float) + origin + 0.5, len(DIRECTIONS)
        sigma = np.full(8, (MASK_PX + MASK_SHARE * float(np.hypot(width, height))) / focal)
    along = pixels @ DIRECTIONS.T  # (n, 8)
    furthest = along.max(axis=0)
    half = 0.0 if instance.from_box else 0.5 / focal
    outer = along >= furthest - OUTER_SHARE * (furthest - along.min(axis=0))
    far = np.array([camera.width, camera.height]) - BORDER_PX
    at_border = np.any((pixels < BORDER_PX) | (pixels > far), axis=1)
    stopped = np.repeat(at_border[:, None], 8, axis=1)
    if not instance.from_box:
        step = BESIDE_PX + BESIDE_SHARE * float(np.hypot(width, height))
        beside = np.floor(pixels[:, None] + step * DIRECTIONS).astype(np.int64)  # (n, 8, 2)
        low, high = beside.min(axis=(0, 1)), beside.max(axis=(0, 1))
        for other in nearer:
            if np.all(low < np.add(other.origin, other.mask.shape[::-1])) and np.all(high >= other.origin):
                stopped |= _within(other, beside)
    else:
        outer = np.eye(BOX_DIRECTIONS, 8, dtype=bool)
    free: BoolArray = (stopped & outer).sum(axis=0) <= CUT_SHARE * outer.sum(axis=0)
    free[count:] = False
    reach = (view_rays(camera, pixels)[:, :2] @ DIRECTIONS.T).max(axis=0) + half
    return reach, sigma, free


def _within(other: Instance, pixels: IntArray) -> BoolArray:
    """(n, 8) whether whole pixels (n, 8, 2) lie in another mask of the same picture."""
    at = pixels - np.array(other.origin)
    inside: BoolArray = np.all((at >= 0) & (at < other.mask.shape[::-1]), axis=2)
    columns, lines = at[inside].T
    inside[inside] = other.mask[lines, columns]
    return inside
