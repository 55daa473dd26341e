"""A place on top of the objects of a category: on a support plane that they share, or on their own highest level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.geometry.planes import level_basis
from estimator.records.objects import SupportPlane
from estimator.records.scene import Instance
from insertion.placement.free_space import NEAR_POINTS, Space, free_places
from insertion.placement.placement import NoPlace
from insertion.request import Place
from insertion.scene.point_cloud import FrontPoints, front_points
from insertion.scene.supports import Surface, surface_of
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from metric_tree.node import Node
    from metric_tree.tree import Tree

#: A point belongs to an object if this share of the views that see both has it in the object's mask: beyond the edge of
#: a table, one view sees the floor where another sees the table.
OWN_SHARE = 0.6
#: Masks of two views show one object if they share this part of the points of the smaller one.
SAME_SHARE = 0.3
#: Most views that are asked.
MAX_VIEWS = 24
#: A plane is an object's top if it holds this share of the object's points.
TOP_SHARE = 0.1
#: The same for a level that is no plane of the scene, whose thickness is this share of the object's height.
LEVEL_SHARE, LEVEL_THICKNESS = 0.15, 0.06


def place_on_category(space: Space, category: str, instances: Sequence[Instance]) -> Place:
    """Free space on the top of an object of a category. Raises NoPlace where there is none."""
    votes = [points for points in _points_of_objects(space, instances) if len(points) >= NEAR_POINTS]
    if not votes:
        raise NoPlace(f"--on: the cloud has no points on any {category}")
    scored = [item for points in votes for item in _places_on(space, points)]
    if not scored:
        raise NoPlace(f"--on: no free level space on any {category} for an object of this size that the cameras see")
    place = max(scored, key=lambda item: item[0])[1]
    return replace(place, support=category if place.plane is None else f"{category}, {place.support}")


def _places_on(space: Space, votes: FloatArray) -> list[tuple[float, Place]]:
    """Scored free places on the highest level of one object, whose points are `votes` (n, 3)."""
    for surface in reversed(space.supports.surfaces):
        plane = surface.plane
        local = votes @ plane.basis.T
        on_plane = np.abs(local[:, 2] - plane.height) < max(4 * plane.sigma, plane.cell / 2)
        if np.count_nonzero(on_plane) < max(NEAR_POINTS, TOP_SHARE * len(votes)):
            continue
        # a floor is not the top of what stands on it
        if np.mean(local[:, 2] > plane.height + plane.cell) > 0.5:
            continue
        places = free_places(space, surface, _mask_of(surface, local[on_plane, :2]))
        if places:
            return places
    level = _own_level(space, votes)
    if level is None:
        return []
    surface, mask = level
    return [(score, replace(place, plane=None)) for score, place in free_places(space, surface, mask)]


def _own_level(space: Space, votes: FloatArray) -> tuple[Surface, BoolArray] | None:
    """The highest level of an object whose points are `votes` (n, 3), and its cells; None where it has none."""
    planes = space.supports.surfaces
    basis = planes[0].plane.basis if planes else level_basis(space.supports.up.vector)
    local = votes @ basis.T
    heights = np.sort(local[:, 2])
    low, high = np.percentile(heights, [5, 95])
    thick = LEVEL_THICKNESS * (high - low)
    # points within the thickness above each point
    count = np.searchsorted(heights, heights + thick, side="right") - np.arange(len(heights))
    rows = np.flatnonzero(count >= max(2 * NEAR_POINTS, LEVEL_SHARE * len(heights)))
    if not len(rows):
        return None
    top = heights[rows[-1]] + thick / 2
    best = rows[(heights[rows] > top - 1.5 * thick)]
    start = heights[best[count[best].argmax()]]
    on_level = (local[:, 2] >= start) & (local[:, 2] <= start + thick)
    own = local[on_level]
    cell = planes[0].plane.cell if planes else max(space.radius, 1e-9)
    origin = own[:, :2].min(axis=0) - 2 * cell
    shape = np.ceil((own[:, :2].max(axis=0) - origin) / cell).astype(int) + 2
    height, sigma = float(np.median(own[:, 2])), robust_sigma(own[:, 2])
    plane = SupportPlane(basis, height, sigma, len(own), origin, cell, np.ones(tuple(shape), dtype=bool))
    surface = surface_of(-1, plane, space.cloud, space.scene.views)
    mask = _mask_of(surface, own[:, :2])
    # the points of the object say where its top is; between them it is solid
    return replace(surface, solid=surface.solid | mask), mask


def _mask_of(surface: Surface, local: FloatArray) -> BoolArray:
    """(a, b) cells within the outline of points (n, 2) of the surface."""
    import cv2

    hull = cv2.convexHull(((local - surface.origin) / surface.cell).astype(np.float32))
    mask = np.zeros(surface.solid.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.floor(hull[:, 0, ::-1]).astype(np.int32), 1)
    return mask.astype(bool)


def _points_of_objects(space: Space, instances: Sequence[Instance]) -> list[FloatArray]:
    """For each object the (n, 3) points of the cloud that most views see in its masks."""
    views = sorted({item.view for item in instances})
    views = views[:: -(-len(views) // MAX_VIEWS)]
    seen = {view: front_points(space.scene.views[view], space.cloud, view) for view in views}
    masks = [(item.view, _rows_in(item, seen[item.view])) for item in instances if item.view in seen]
    objects: list[tuple[set[int], list[tuple[int, IntArray]]]] = []
    for view, rows in sorted(masks, key=lambda mask: -len(mask[1])):
        own = set(rows.tolist())
        shared = [len(own & points) / max(min(len(own), len(points)), 1) for points, _ in objects]
        if shared and max(shared) >= SAME_SHARE:
            points, parts = objects[int(np.argmax(shared))]
            points |= own
            parts.append((view, rows))
        else:
            objects.append((own, [(view, rows)]))
    n = len(space.cloud.points)
    return [space.cloud.points[_own_points(parts, seen, n)] for _, parts in objects]


def _rows_in(item: Instance, sight: FrontPoints) -> IntArray:
    """Rows (m,) of the points in sight that are in the mask."""
    at = np.floor(sight.pixels - item.origin).astype(np.int64)
    within = np.flatnonzero(((at >= 0) & (at < item.mask.shape[::-1])).all(axis=1))
    return np.asarray(sight.rows[within[item.mask[at[within, 1], at[within, 0]]]])


def _own_points(parts: Sequence[tuple[int, IntArray]], seen: Mapping[int, FrontPoints], count: int) -> BoolArray:
    """(count,) points in most of the masks of one object, among the views that see both.

    parts : view and rows (m,) of each mask; seen : the sight of each view.
    """
    visible, own = np.zeros(count), np.zeros(count)
    for view in {view for view, _ in parts}:
        visible[seen[view].rows] += 1
    for _, rows in parts:
        own[rows] += 1
    return np.asarray((own > 0) & (own >= OWN_SHARE * visible))


def instances_named(instances: Sequence[Instance], name: str, tree: Tree | None = None) -> list[Instance]:
    """The instances of a category: by its own name, by its last words ("table" is any "coffee table"), or by the tree.

    Names are read as everywhere, those of instances and a word with several senses as the label lists of detectors
    mean them: "sofa" is a "couch", and "furniture" is both. Without `tree` the shipped one is asked. Raises NoPlace,
    with what there is, where nothing has the name.
    """
    wanted = name.casefold().strip()
    named = [item for item in instances if item.category.casefold() == wanted]
    named = named or [item for item in instances if item.category.casefold().endswith(f" {wanted}")]
    if named:
        return named
    categories = sorted({item.category for item in instances})
    meant = _meant_by(wanted, categories, tree)
    if not meant:
        names = ", ".join(categories) or "no instance at all"
        raise NoPlace(f"--on: expected a category of the instances ({names}); found {name!r}")
    return [item for item in instances if item.category in meant]


def _meant_by(wanted: str, categories: Sequence[str], tree: Tree | None) -> set[str]:
    """The categories whose node of the tree is that of `wanted`, or below it."""
    import metric_tree
    from metric_tree.tree import DETECTORS

    if not categories:
        return set()
    tree = tree or metric_tree.open()
    nodes: dict[str, Node] = {}
    for text in (wanted, *categories):
        with suppress(metric_tree.UnknownName):
            nodes[text] = tree.find(text, DETECTORS)
    above = nodes.get(wanted)
    if above is None:
        return set()
    known = ((category, nodes[category]) for category in categories if category in nodes)
    return {one for one, node in known if node == above or above.node_id in node.hypernyms or above in _ancestors(node)}


def _ancestors(node: Node) -> list[Node]:
    """The nodes above one, nearest first."""
    return [] if node.parent is None else [node.parent, *_ancestors(node.parent)]
