"""Objects by their outlines: those known by boxes alone, and those on which few points lie.

The cuboid fits outlines and points as one likelihood (`cuboid_fit`). Of many points their own box (`box`) is
better; there the cuboid has the sides that the points do not show to their end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.geometry.cuboid_fit import Cuboid, Sightings, fit_cuboid
from estimator.geometry.extents import HIDDEN_TOP_SIGMA
from estimator.geometry.mask_outlines import Outlines, Reaches, mask_reaches
from estimator.geometry.planes import BELOW_FLOOR_SHARE, floor_of
from estimator.projection.visibility import row_indices
from estimator.records.objects import Box, MeasuredObject, SupportPlane, Up
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray, FloatArray, IntArray

# The dense cloud is taken for an object from here on; below, whichever cloud holds more.
MIN_DENSE_POINTS = 100
# From this many points on, an object is measured by its points, and by its outlines where these are cut.
MANY_POINTS = 150
# Points whose own error along the footprint is a larger share of its length or width stretch it, however many they are:
# of .08, .1 and .12 in worlds of a walk and a slow pan with 150 to 500 points an object, seeds 1000 and 1001.
SMEARED_SHARE = 0.1
# Boxes bound an object only where several of them cross: two leave a wedge that is open behind it.
MIN_BOX_VIEWS = 3
# The errors of length, width and height are so many times what the fit of boxes states, beside a part of their own:
# objects are no cuboids, and edges err alike in neighbouring views. Robust spreads in hard synthetic rooms, seeds 1000
# to 1002, with boxes of `tests.synthetic.rooms.detections`.
SIGMA_TIMES, OWN_SIGMA = 2.2, (0.09, 0.13, 0.06)
# Before the fit the centre of boxes is at the middle of the points within half a size.
BOX_CENTRE_SD = 0.5
# The same for masks.
MASK_SIGMA = (0.08, 0.14, 0.06)
# The height of a support plane under an object is good to this share of the object's height, and to this share of the
# plane's own thickness.
FOOT_SHARE, PLANE_SHARE = 0.03, 0.3
# Of fewer points around an object one is a stray, and no sign that the ground is lower there.
MIN_AROUND = 20
# An object whose outlines end within this share of its height of a support plane stands on it.
CONTACT_SHARE, CONTACT_SIGMAS = 0.15, 1.5
# Borders of the masks of one object are too wide or too narrow in all views alike: what that adds to an extent.
BORDER_PX = 1.0
# Outlines less sure than this do not stand in for a side that many points do not show to its end.
MOST_SIGMA = 0.2
#: The note of an object whose height ends at its level top, whatever lies on it.
LEVEL_TOP = "ends at its level top"
# Points of one object that are looked at.
MAX_POINTS = 60


@dataclass(frozen=True, slots=True, eq=False)
class OutlineData:
    """What the fits of all objects share.

    labels : of the sparse cloud, and of the dense one if there is one; around : (k, 3) thinned points of the last of
    them in the level basis; covariances : (n, 3, 3) of the sparse points;
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
    around: FloatArray
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
    around: FloatArray,
    standing: Callable[[str], bool | None],
) -> OutlineData:
    """The data of the fits, with the outlines of all masks; as in `OutlineData`.

    Parameters
    ----------
    covariances : (n, 3, 3) of the sparse points
    basis : (3, 3)
    around : (k, 3) thinned points of the cloud in the level basis
    """
    depths = np.array([_median_depth(scene, instance, labels, row) for row, instance in enumerate(instances)])
    reaches = mask_reaches(scene, instances, depths)
    floor = floor_of(planes, labels[-1].points)
    return OutlineData(
        scene, instances, labels, reaches, covariances, noise, basis, up, planes, floor, around, standing
    )


def outlined_object(item: MeasuredObject, data: OutlineData) -> MeasuredObject:
    """The object with the sizes of the cuboid that its outlines frame, together with those of its points.

    The same where many dense points measure it, where it was skipped for another reason than few points, or where
    nothing says how far away it is.
    """
    masks = [data.instances[row] for row in item.members]
    if all(mask.from_box for mask in masks):
        return _box_object(item, data)
    whole = item.skipped is None and not np.any(item.truncated)
    smeared = _is_smeared(item, data)
    if any(mask.from_box for mask in masks) or (item.points >= MANY_POINTS and whole and not smeared):
        return item
    outlines = data.reaches.of(item.members, data.instances, data.scene, data.basis)
    points = _sightings(item, data)
    stands = data.standing(item.category)
    foot = _on_plane(data.floor, data, 0.0, None) if stands and data.floor is not None else None
    middle = _middle(points, outlines, foot)
    if middle is None:
        return replace(item, skipped="no points, and no floor under it, say how far away it is")
    if foot is not None and points is not None:
        foot = _ground_at(foot, data, middle, outlines.size_at(middle))
    filled = item.unsupported_height is not None and bool(item.notes)
    if filled:
        foot = None
    cuboid = fit_cuboid(outlines, middle, _yaw(item, data.basis), foot, points)
    if not filled and stands is not False:
        plane = _contact_plane(cuboid, data)
        if plane is not None:
            foot = _on_plane(plane, data, float(cuboid.extents[2]), cuboid.centre)
            if plane is data.floor:
                foot = _ground_at(foot, data, cuboid.centre, float(cuboid.extents[:2].max()))
            cuboid = fit_cuboid(outlines, cuboid.centre, cuboid.yaw, foot, points)
    away = float(np.median((outlines.rotation @ cuboid.centre + outlines.translation)[:, 2]))
    pixel = away / float(data.scene.views[masks[0].view].camera.params[0])
    own = item.points >= MANY_POINTS and item.skipped is None and not smeared
    return _outline_sizes(item, cuboid, data, (own, filled), outlines.cut_sides(foot is not None), pixel)


def _is_smeared(item: MeasuredObject, data: OutlineData) -> bool:
    """Whether its sparse points are so unsure along its footprint that they stretch it: a short baseline does that."""
    if item.box is None or item.cloud != "sparse" or item.point_rows is None:
        return False
    level = item.box.axes[:2]
    variance = np.einsum("ai,nij,aj->na", level, data.covariances[item.point_rows], level)
    return bool((np.sqrt(np.median(variance, axis=0)) > SMEARED_SHARE * item.extents[:2]).any())


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
    cuboid = fit_cuboid(outlines, middle, _yaw(item, data.basis), foot, centre_sd=spread)
    stated = SIGMA_TIMES * np.sqrt(np.diag(cuboid.covariance)) * max(cuboid.misfit, 0.5) / max(cuboid.misfit, 1.0)
    return replace(
        item,
        extents=cuboid.extents,
        sigma=np.hypot(stated, OWN_SIGMA),
        truncated=np.zeros(3, dtype=bool),
        unsupported_height=None,
        box=_box(cuboid, data.basis),
    )


def _outline_sizes(
    item: MeasuredObject, cuboid: Cuboid, data: OutlineData, by_points: tuple[bool, bool], cut: BoolArray, pixel: float
) -> MeasuredObject:
    """The object by its outlines, or its points' box with what the outlines say of the sides that it lacks.

    by_points : whether its points measure it where they show it whole, and whether it reaches down to a plane, so that
    its height is that of the box; cut : (3,) extents to whose ends no outline goes; pixel : its size at the
    object.
    """
    border = BORDER_PX * pixel / cuboid.extents
    # of what has a level top, outlines have what lies on it too
    cluttered = np.array([0.0, 0.0, item.sigma[2] if item.sigma[2] >= HIDDEN_TOP_SIGMA else 0.0])
    covariance = cuboid.covariance + np.diag(np.square(MASK_SIGMA) + border**2 + cluttered**2)
    kept = np.array([False, False, by_points[1] or LEVEL_TOP in item.notes])
    if by_points[0]:
        unsure = np.sqrt(np.diag(covariance)) > MOST_SIGMA
        kept = ~np.asarray(item.truncated, dtype=bool) | cut | unsure | (cuboid.extents < item.extents)
    if kept.all():
        return item
    box = _box(cuboid, data.basis)
    extents, truncated = cuboid.extents.copy(), cut
    if kept.any() and item.box is not None:
        extents = np.where(kept, item.extents, extents)
        truncated = np.where(kept, item.truncated, cut)
        covariance[kept] = covariance[:, kept] = 0
        covariance[kept, kept] = item.sigma[kept] ** 2
        box = item.box if kept[:2].any() else replace(box, centre=_at_z(box.centre, item.box.centre, data.basis[2]))
    order = [0, 1, 2] if extents[0] >= extents[1] else [1, 0, 2]
    extents, covariance = extents[order], covariance[np.ix_(order, order)]
    return replace(
        item,
        extents=extents,
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        truncated=truncated[order],
        unsupported_height=item.unsupported_height if kept[2] else None,
        box=replace(box, extents=extents, axes=box.axes[order]),
        skipped=None,
        notes=(*item.notes, "measured by its outlines"),
    )


def _at_z(centre: FloatArray, other: FloatArray, up: FloatArray) -> FloatArray:
    """The centre (3,) at the height of another one."""
    return np.asarray(centre + (other - centre) @ up * up)


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
    rows = [row_indices(cloud.membership, row) for cloud in labels]
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
        seen = np.isin(own, row_indices(labels.membership, member)) & np.isnan(eyes[:, 0])
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


def _ground_at(foot: tuple[float, float], data: OutlineData, place: FloatArray, size: float) -> tuple[float, float]:
    """The foot (height, sigma) on the floor, or on lower ground where the points around `place` (3,) show some.

    size : of the object, scene units. A path and the street beside it are no one plane.
    """
    near = data.around[(np.abs(data.around[:, :2] - place[:2]) < size).all(axis=1), 2]
    if len(near) < MIN_AROUND or data.floor is None:
        return foot
    lowest = float(np.quantile(near, BELOW_FLOOR_SHARE))
    drop = foot[0] - lowest
    # a floor is as thick as a cell is wide
    return (lowest, float(np.hypot(foot[1], drop / 2))) if drop > data.floor.cell else foot
