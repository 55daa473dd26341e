"""Objects by their outlines: those known by boxes alone, and those on which few points lie.

The cuboid fits outlines and points as one likelihood (`cuboid_fit`). Of many points their own box (`upright_box`) is
better; there the cuboid has the sides that the points do not show to their end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.geometry.planes import SupportPlane, floor_of
from estimator.geometry.up import Up
from estimator.outlines.cuboid_fit import BOX_BODIES, Cuboid, PointEdges, Sightings, fit_cuboid
from estimator.outlines.reaches import Outlines, Reaches, mask_reaches
from estimator.records.measured_object import Box, MeasuredObject
from estimator.records.scene import Instance, Scene
from estimator.visibility.sights import row_members
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["OutlineData", "outline_data", "outlined_object"]

# The dense cloud is taken for an object from here on; below, whichever cloud holds more.
MIN_DENSE_POINTS = 100
# Below this many points the result says that the outlines measured the object; from here on its points enter the fit
# by the edges of their box alone, and not each by its line of sight as well.
MANY_POINTS = 150
# Boxes bound an object only where several of them cross: two leave a wedge that is open behind it.
MIN_BOX_VIEWS = 3
# The errors of length, width and height are so many times what the fit of boxes states, beside a part of their own:
# objects are no cuboids, and edges err alike in neighbouring views. Robust spreads in hard synthetic rooms, seeds 1000
# to 1002, with boxes of `tests.synthetic.rooms.detections`.
SIGMA_TIMES, OWN_SIGMA = 2.2, (0.09, 0.13, 0.06)
# Before the fit the centre of boxes is at the middle of the points within half a size.
BOX_CENTRE_SD = 0.5
# Errors of the log extents are so many times what the fit states, beside a part of their own: objects are no solids,
# and edges err alike in neighbouring views. Chosen for a coverage of .85 to .9 in hard synthetic rooms, seeds 1000 and
# 1001, masks with dense points and with sparse points alone.
FIT_TIMES, SHAPE_SIGMA = 1.25, (0.03, 0.04, 0.02)
# The height of a support plane under an object is good to this share of the object's height, and to this share of the
# plane's own thickness.
FOOT_SHARE, PLANE_SHARE = 0.03, 0.3
# No foot is known better than to this share of the height.
LEAST_FOOT = 0.01
# An object whose outlines end within this share of its height of a support plane stands on it.
CONTACT_SHARE, CONTACT_SIGMAS = 0.15, 1.5
# Outlines less sure than this do not show a side that the points do not show to its end.
MOST_SIGMA = 0.2
# Points of one object that are looked at.
MAX_POINTS = 60


@dataclass(frozen=True, slots=True, eq=False)
class OutlineData:
    """What the fits of all objects share.

    labels : of the sparse cloud, and of the dense one if there is one; covariances : (n, 3, 3) of the sparse points;
    noise : of a dense point's depth as a share of it; basis : (3, 3) rows two horizontal axes and up.
    """

    scene: Scene
    instances: Sequence[Instance]
    labels: Sequence[PointLabels]
    reaches: Reaches
    covariances: FloatArray
    noise: float
    basis: FloatArray
    up: Up
    planes: Sequence[SupportPlane]
    floor: SupportPlane | None
    standing: Callable[[str], bool | None]


def outline_data(
    scene: Scene,
    instances: Sequence[Instance],
    labels: Sequence[PointLabels],
    covariances: FloatArray,
    noise: float,
    basis: FloatArray,
    up: Up,
    planes: Sequence[SupportPlane],
    standing: Callable[[str], bool | None],
) -> OutlineData:
    """The data of the fits, with the outlines of all masks; arrays as in `OutlineData`, covariances (n, 3, 3)."""
    depths = np.array([_median_depth(scene, instance, labels, row) for row, instance in enumerate(instances)])
    reaches = mask_reaches(scene, instances, depths, basis[2])
    floor = floor_of(planes, labels[-1].points)
    return OutlineData(scene, instances, labels, reaches, covariances, noise, basis, up, planes, floor, standing)


def outlined_object(item: MeasuredObject, edges: PointEdges | None, data: OutlineData) -> MeasuredObject:
    """The object with the sizes of the solid that its outlines frame, together with its points and the box of these.

    edges : the sides of the box of its points, None without one. The object is the same where it was skipped for
    another reason than few points, and skipped where nothing says how far away it is.
    """
    masks = [data.instances[row] for row in item.members]
    if all(mask.from_box for mask in masks):
        return _box_object(item, data)
    if any(mask.from_box for mask in masks):
        return item
    outlines = data.reaches.of(item.members, data.instances, data.scene, data.basis)
    points = _sightings(item, data)
    foot = _known_foot(item, edges, data)
    middle = _middle(points, outlines, foot)
    if middle is None:
        return replace(item, skipped="no points, and no floor under it, say how far away it is")
    if edges is not None and item.points >= MANY_POINTS:
        points = None  # the edges of their box say what they say
    cuboid = fit_cuboid(outlines, middle, _yaw(item, data.basis), foot, points, edges=edges)
    if item.unsupported_height is None and data.standing(item.category) is not False:
        plane = _contact_plane(cuboid, data)
        if plane is not None:
            foot = _on_plane(plane, data, float(cuboid.extents[2]), cuboid.centre)
            cuboid = fit_cuboid(outlines, cuboid.centre, cuboid.yaw, foot, points, edges=edges)
    return _with_sizes_of(item, cuboid, data, outlines.cut_sides(foot is not None))


def _known_foot(item: MeasuredObject, edges: PointEdges | None, data: OutlineData) -> tuple[float, float] | None:
    """Height and sigma of what the object stands on: by its points, else the floor where its category stands on it."""
    if item.unsupported_height is not None and item.box is not None and edges is not None:
        height = float(item.box.extents[2])
        bottom = float(item.box.centre @ data.basis[2]) - height / 2
        # the sigma of the height is that of the foot and of the top, which is the last of the edges
        below = (float(item.sigma[2]) * height) ** 2 - float(edges.sigma[-1]) ** 2
        return bottom, float(np.sqrt(max(below, (LEAST_FOOT * height) ** 2)))
    if data.standing(item.category) and data.floor is not None:
        return _on_plane(data.floor, data, 0.0, None)
    return None


def _box_object(item: MeasuredObject, data: OutlineData) -> MeasuredObject:
    """The object of boxes alone: its points, most of which are background, only say about where it is."""
    if item.skipped is not None or item.box is None:
        return item
    cloud = data.labels[0 if item.cloud == "sparse" else -1].points
    middle = np.median(cloud[item.point_rows] @ data.basis.T, axis=0)
    foot = None
    if item.unsupported_height is not None:
        bottom = float(item.box.centre @ data.basis[2]) - float(item.extents[2]) / 2
        foot = (bottom, FOOT_SHARE * float(item.extents[2]))
    outlines = data.reaches.of(item.members, data.instances, data.scene, data.basis)
    spread = BOX_CENTRE_SD * float(np.sqrt(item.extents[0] * item.extents[2]))
    cuboid = fit_cuboid(outlines, middle, _yaw(item, data.basis), foot, centre_sd=spread, bodies=BOX_BODIES)
    stated = SIGMA_TIMES * np.sqrt(np.diag(cuboid.covariance)) * max(cuboid.misfit, 0.5) / max(cuboid.misfit, 1.0)
    return replace(
        item,
        extents=cuboid.extents,
        sigma=np.hypot(stated, OWN_SIGMA),
        truncated=np.zeros(3, dtype=bool),
        unsupported_height=None,
        box=_box(cuboid, data.basis),
    )


def _with_sizes_of(item: MeasuredObject, cuboid: Cuboid, data: OutlineData, cut: BoolArray) -> MeasuredObject:
    """The object with the sizes of its cuboid; cut : (3,) extents to whose ends no outline goes.

    A side is truncated that neither the outlines nor the points show to its end.
    """
    box = _box(cuboid, data.basis)
    truncated = cut
    if item.box is not None:
        across = abs(float(item.box.axes[0] @ box.axes[0])) < np.sqrt(0.5)
        unsure = np.diag(cuboid.covariance) > MOST_SIGMA**2
        truncated = (cut | unsure) & np.asarray(item.truncated, dtype=bool)[[1, 0, 2] if across else [0, 1, 2]]
    covariance = FIT_TIMES**2 * cuboid.covariance + np.diag(np.square(SHAPE_SIGMA))
    # a truncated side is weighed by itself
    covariance = np.where(truncated | truncated[:, None], np.diag(np.diag(covariance)), covariance)
    return replace(
        item,
        extents=cuboid.extents,
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        truncated=truncated,
        box=box,
        skipped=None,
        notes=item.notes if item.points >= MANY_POINTS else (*item.notes, "measured by its outlines"),
    )


def _box(cuboid: Cuboid, basis: FloatArray) -> Box:
    """The cuboid in the scene; `basis` (3, 3) has up as its last row."""
    c, s = np.cos(cuboid.yaw), np.sin(cuboid.yaw)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ basis
    return Box(cuboid.centre @ basis, axes, cuboid.extents)


def _yaw(item: MeasuredObject, basis: FloatArray) -> float:
    """How the footprint of the points is turned in the level basis (3, 3), 0 without one."""
    if item.box is None:
        return 0.0
    along = item.box.axes[0] @ basis.T
    return float(np.arctan2(along[1], along[0]))


def _median_depth(scene: Scene, instance: Instance, labels: Sequence[PointLabels], row: int) -> float:
    """Median depth of the points of a mask, NaN without any."""
    rows = [row_members(cloud.membership, row) for cloud in labels]
    view = scene.views[instance.view]
    points = np.concatenate([cloud.points[own] for cloud, own in zip(labels, rows, strict=True)])
    return float(np.median(points @ view.rotation[2] + view.translation[2])) if len(points) else np.nan


def _sightings(item: MeasuredObject, data: OutlineData) -> Sightings | None:
    """The points of an object, each along the line of sight of a view that has it in its mask; None without any."""
    if item.point_rows is None or not len(item.point_rows):
        return None
    sparse = item.cloud == "sparse"
    labels = data.labels[0 if sparse else -1]
    own: IntArray = item.point_rows[:: max(1, -(-len(item.point_rows) // MAX_POINTS))]
    eyes = np.full((len(own), 3), np.nan)
    for member in item.members:
        seen = np.isin(own, row_members(labels.membership, member)) & np.isnan(eyes[:, 0])
        eyes[seen] = data.scene.views[data.instances[member].view].centre
    kept = np.isfinite(eyes[:, 0])
    if not kept.any():
        return None
    rows, eyes = own[kept], eyes[kept]
    away = labels.points[rows] - eyes
    depths = np.linalg.norm(away, axis=1)
    rays = away / depths[:, None]
    along = np.einsum("ni,nij,nj->n", rays, data.covariances[rows], rays) if sparse else (data.noise * depths) ** 2
    sigma = np.sqrt(along)
    return Sightings(eyes @ data.basis.T, rays @ data.basis.T, depths, np.maximum(sigma, 1e-3 * depths))


def _middle(points: Sightings | None, outlines: Outlines, foot: tuple[float, float] | None) -> FloatArray | None:
    """(3,) about where the object is: on the line of sight of its outlines, as far as its points or the floor say."""
    if points is not None:
        return np.asarray(np.median(points.eyes + points.depths[:, None] * points.rays, axis=0))
    if foot is None:
        return None
    places = []
    for reach, rotation, translation in zip(outlines.reach, outlines.rotation, outlines.translation, strict=True):
        eye = -rotation.T @ translation
        lowest = rotation.T @ np.array([(reach[2] - reach[0]) / 2, reach[3], 1.0])
        drop = foot[0] - eye[2]
        if drop * lowest[2] > 0:
            places.append(eye + lowest * (drop / lowest[2]))
    return np.median(places, axis=0) if places else None


def _contact_plane(cuboid: Cuboid, data: OutlineData) -> SupportPlane | None:
    """The support plane at which the cuboid ends, None where it ends at none."""
    height = float(cuboid.extents[2])
    bottom = float(cuboid.centre[2]) - height / 2
    spread = float(np.sqrt(cuboid.covariance[2, 2])) * height
    within = max(CONTACT_SHARE * height, min(CONTACT_SIGMAS * spread, height / 2))
    planes = list(data.planes)
    if not planes:
        return None
    nearest = min(planes, key=lambda plane: abs(plane.height - bottom))
    return nearest if abs(nearest.height - bottom) < within else None


def _on_plane(plane: SupportPlane, data: OutlineData, height: float, place: FloatArray | None) -> tuple[float, float]:
    """Height of a plane under an object at `place` (3,), and its sigma: it tilts away from where it was seen."""
    sigma = np.hypot(PLANE_SHARE * plane.sigma, FOOT_SHARE * height)
    eyes = np.array([view.centre for view in data.scene.views]) @ data.basis.T
    if place is None:
        return plane.height, float(max(sigma, FOOT_SHARE * abs(float(np.median(eyes[:, 2])) - plane.height)))
    cells = np.argwhere(plane.cells) * plane.cell + plane.origin + plane.cell / 2
    apart = float(np.linalg.norm(cells - place[:2], axis=1).min()) if len(cells) else 0.0
    return plane.height, float(np.hypot(sigma, np.radians(data.up.sigma_deg) * max(apart - plane.cell, 0.0)))
