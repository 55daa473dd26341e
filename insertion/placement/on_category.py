"""Placement on objects of a category: on a support plane that they share, or on their own highest level."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.records.objects import SupportPlane
from estimator.records.scene import Instance
from insertion.placement.free_space import MIN_POINTS, positions_on_surface
from insertion.placement.placement import Placement, PlacementError, PlacementSpace
from insertion.scene.pixel_box import pixels_in_mask
from insertion.scene.point_cloud import visible_points
from insertion.scene.supports import Surface, surface_of
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from metric_tree.node import Node
    from metric_tree.tree import Tree

#: Minimum fraction of the views of a point and an object that have the point in the mask of the object. Beyond the edge
#: of a table, one view sees the floor where another sees the table.
MIN_VIEW_VOTE_FRACTION = 0.6
#: Minimum fraction of the points of the smaller of two masks that are in both, if the masks show one object.
MIN_SHARED_POINT_FRACTION = 0.3
#: Maximum number of views.
MAX_VIEWS = 24
#: Minimum fraction of the points of an object that are on a plane, if the plane is its top.
MIN_TOP_FRACTION = 0.1
#: Maximum fraction of the points of an object that are above its top; the floor is not the top of what stands on it.
MAX_ABOVE_FRACTION = 0.5
#: Minimum fraction of the points of an object that are on a level that is no support plane.
MIN_LEVEL_FRACTION = 0.15
#: Thickness of such a level, as a fraction of the height of the object.
LEVEL_THICKNESS = 0.06


def placement_on_category(
    space: PlacementSpace, category: str, instances: Sequence[Instance], radius: float, height: float
) -> Placement:
    """Return the best free placement on top of an object of a category.

    Parameters
    ----------
    space : PlacementSpace
        The scene.
    category : str
        Name of the category, for messages.
    instances : sequence of Instance
        Masks of the objects of the category.
    radius, height : float
        Half the diagonal of the footprint, and height of the object to place, in scene units.

    Raises
    ------
    PlacementError
        There are no points on the objects, or no free position.
    """
    objects = [points for points in points_of_objects(space, instances) if len(points) >= MIN_POINTS]
    if not objects:
        raise PlacementError(f"--on: the cloud has no points on any {category}")
    scored = [item for points in objects for item in _placements_on(space, points, radius, height)]
    if not scored:
        raise PlacementError(
            f"--on: no free level space on any {category} for an object of this size that the cameras see"
        )
    placement = max(scored, key=lambda item: item[0])[1]
    support = category if placement.plane is None else f"{category}, {placement.support}"
    return replace(placement, support=support)


def _placements_on(
    space: PlacementSpace, points: FloatArray, radius: float, height: float
) -> list[tuple[float, Placement]]:
    """Return scored free placements on the highest level of an object with points (n, 3)."""
    for surface in reversed(space.supports.surfaces):
        plane = surface.plane
        local = points @ plane.basis.T
        on_plane = np.abs(local[:, 2] - plane.height) < max(4 * plane.sigma, plane.cell / 2)
        if np.count_nonzero(on_plane) < max(MIN_POINTS, MIN_TOP_FRACTION * len(points)):
            continue
        if np.mean(local[:, 2] > plane.height + plane.cell) > MAX_ABOVE_FRACTION:
            continue
        mask = outline_mask(surface, local[on_plane, :2])
        placements = positions_on_surface(space, surface, radius, height, mask)
        if placements:
            return placements
    level = highest_level(space, points, radius)
    if level is None:
        return []
    surface, mask = level
    scored = positions_on_surface(space, surface, radius, height, mask)
    return [(score, replace(placement, plane=None)) for score, placement in scored]


def highest_level(space: PlacementSpace, points: FloatArray, radius: float) -> tuple[Surface, BoolArray] | None:
    """Find the highest level of an object.

    Parameters
    ----------
    space : PlacementSpace
        The scene.
    points : (n, 3) ndarray of float
        Points of the object.
    radius : float
        Half the diagonal of the footprint to place, in scene units.

    Returns
    -------
    tuple of Surface and (a, b) ndarray of bool, or None
        The surface and its cells within the outline of the points; None if no level has enough points.
    """
    basis = space.supports.basis
    local = points @ basis.T
    heights = np.sort(local[:, 2])
    low, high = np.percentile(heights, [5, 95])
    thickness = LEVEL_THICKNESS * (high - low)
    # number of points within the thickness above each point
    count = np.searchsorted(heights, heights + thickness, side="right") - np.arange(len(heights))
    rows = np.flatnonzero(count >= max(2 * MIN_POINTS, MIN_LEVEL_FRACTION * len(heights)))
    if not len(rows):
        return None
    top = heights[rows[-1]] + thickness / 2
    best = rows[(heights[rows] > top - 1.5 * thickness)]
    start = heights[best[count[best].argmax()]]
    level_points = local[(local[:, 2] >= start) & (local[:, 2] <= start + thickness)]
    planes = space.supports.surfaces
    cell = planes[0].plane.cell if planes else max(radius, 1e-9)
    origin = level_points[:, :2].min(axis=0) - 2 * cell
    shape = np.ceil((level_points[:, :2].max(axis=0) - origin) / cell).astype(int) + 2
    height, sigma = float(np.median(level_points[:, 2])), robust_sigma(level_points[:, 2])
    cells = np.ones(tuple(shape), dtype=bool)
    plane = SupportPlane(basis, height, sigma, len(level_points), origin, cell, cells)
    surface = surface_of(-1, plane, space.cloud, space.views)
    mask = outline_mask(surface, level_points[:, :2])
    # the top is solid between the points of the object
    return replace(surface, solid=surface.solid | mask), mask


def outline_mask(surface: Surface, local: FloatArray) -> BoolArray:
    """Return the cells (a, b) of a surface within the convex hull of its points (n, 2)."""
    import cv2

    hull = cv2.convexHull(((local - surface.origin) / surface.cell).astype(np.float32))
    mask = np.zeros(surface.solid.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.floor(hull[:, 0, ::-1]).astype(np.int32), 1)
    return mask.astype(bool)


def points_of_objects(space: PlacementSpace, instances: Sequence[Instance]) -> list[FloatArray]:
    """Return the points (n, 3) of each object that most of the views see in its masks."""
    views = sorted({item.view for item in instances})
    views = views[:: -(-len(views) // MAX_VIEWS)]
    sights = {view: visible_points(space.views[view], space.cloud, view) for view in views}

    # 1. Masks that share points show one object, starting from the largest.
    masks = []
    for item in instances:
        if item.view in sights:
            sight = sights[item.view]
            masks.append((item.view, sight.rows[pixels_in_mask(item, sight.pixels)]))
    objects: list[tuple[set[int], list[tuple[int, IntArray]]]] = []
    for view, rows in sorted(masks, key=lambda mask: -len(mask[1])):
        mask_points = set(rows.tolist())
        shared = [len(mask_points & points) / max(min(len(mask_points), len(points)), 1) for points, _ in objects]
        if shared and max(shared) >= MIN_SHARED_POINT_FRACTION:
            points, parts = objects[int(np.argmax(shared))]
            points |= mask_points
            parts.append((view, rows))
        else:
            objects.append((mask_points, [(view, rows)]))

    # 2. A point belongs to the object if most of the views that see both have it in a mask.
    result = []
    for _, parts in objects:
        n_visible, n_masks = np.zeros(len(space.cloud.points)), np.zeros(len(space.cloud.points))
        for view in {view for view, _ in parts}:
            n_visible[sights[view].rows] += 1
        for _, rows in parts:
            n_masks[rows] += 1
        result.append(space.cloud.points[(n_masks > 0) & (n_masks >= MIN_VIEW_VOTE_FRACTION * n_visible)])
    return result


def instances_named(instances: Sequence[Instance], name: str, tree: Tree | None = None) -> list[Instance]:
    """Return the instances of a category.

    A category matches by its name, by its last words ("table" matches "coffee table"), or by the tree: "sofa" is a
    "couch", and "furniture" contains both. Words with several senses have those of the label lists of detectors.

    Parameters
    ----------
    instances : sequence of Instance
        Masks with categories.
    name : str
        Name of the category.
    tree : Tree, optional
        Release for the names; the shipped one by default.

    Raises
    ------
    PlacementError
        No instance matches. The message lists the categories.
    """
    wanted = name.casefold().strip()
    named = [item for item in instances if item.category.casefold() == wanted]
    named = named or [item for item in instances if item.category.casefold().endswith(f" {wanted}")]
    if named:
        return named
    categories = sorted({item.category for item in instances})
    matching = _categories_below(wanted, categories, tree)
    if not matching:
        names = ", ".join(categories) or "no instance at all"
        raise PlacementError(f"--on: expected a category of the instances ({names}); found {name!r}")
    return [item for item in instances if item.category in matching]


def _categories_below(wanted: str, categories: Sequence[str], tree: Tree | None) -> set[str]:
    """Return the categories whose node in the tree is that of `wanted`, or below it."""
    import metric_tree
    from metric_tree.tree import DETECTORS

    if not categories:
        return set()
    tree = tree or metric_tree.open()
    nodes: dict[str, Node] = {}
    for text in (wanted, *categories):
        with suppress(metric_tree.UnknownName):
            nodes[text] = tree.find(text, DETECTORS)
    target = nodes.get(wanted)
    if target is None:
        return set()
    return {
        category
        for category in categories
        if (node := nodes.get(category)) is not None
        and (target in (node, *node.ancestors()) or target.node_id in node.hypernyms)
    }
