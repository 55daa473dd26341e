"""Measure objects by the cuboid that fits their outlines: objects with boxes instead of masks, or with few points.

The cuboid fits outlines and points with a common likelihood (`cuboid_fit`). For objects with many points, the box of
the points (`box`) is better; there, the cuboid supplies only the truncated sides.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.geometry.cuboid_fit import Cuboid, CuboidProblem, PointRays, fit_cuboids
from estimator.geometry.extents import HIDDEN_TOP_SIGMA
from estimator.geometry.mask_outlines import OutlineExtents, Outlines, outline_extents
from estimator.geometry.planes import MAX_BELOW_FLOOR_FRACTION
from estimator.geometry.point_noise import point_covariances
from estimator.geometry.scene_geometry import SceneGeometry
from estimator.geometry.truncation import MIN_VISIBLE_SINE
from estimator.projection.visibility import row_indices
from estimator.records.objects import BY_OUTLINES, Box, MeasuredObject, SupportPlane
from estimator.records.scene import Instance, Scene, camera_centres
from metric_base.arrays import BoolArray, FloatArray, IntArray, evenly_spaced

# Minimum number of points of an object in the dense cloud; with fewer, the cloud with more points is used.
MIN_DENSE_POINTS = 100
# Minimum number of points of an object that is measured by them, and by its outlines only at truncated sides.
MIN_SUFFICIENT_POINTS = 150
# Factor of the standard deviations by the outlines of an object with fewer points than `MIN_SUFFICIENT_POINTS`. In real
# scenes, an object in front that has no mask shortens the outlines, and few points cannot contradict them: root mean
# square errors of length, width and height are 2.0, 1.4 and 1.4 times the deviations without this factor.
FEW_POINTS_SIGMA_FACTOR = 2.0
# Maximum error of the points along the footprint, relative to its sides; a larger one stretches the object, whatever
# the number of points. Of 0.08, 0.1 and 0.12, the best in scenes of a walk and a slow pan with 150 to 500 points per
# object (seeds 1000 and 1001).
MAX_SMEAR_FRACTION = 0.1
# Minimum number of views with boxes of an object: two boxes leave a wedge that is open behind it.
MIN_BOX_VIEWS = 3
# Factor of the standard deviation of the fit to boxes, because objects are no cuboids and the edges in adjacent views
# have common errors. With the next constant, from robust deviations in hard synthetic rooms, seeds 1000 to 1002, with
# boxes of `tests.synthetic.rooms.detections`.
FIT_SIGMA_FACTOR = 2.2
# Standard deviation of log length, width and height that is added to it.
BOX_SIGMA = (0.09, 0.13, 0.06)
# Standard deviation of log length, width and height that is added to the fit to masks.
MASK_SIGMA = (0.08, 0.14, 0.06)
# Minimum root mean square residual that is assumed for a fit to boxes.
MIN_BOX_MISFIT = 0.5
# Standard deviation of the centre of an object with boxes before the fit, relative to its size: the median of points,
# most of which are background.
BOX_CENTRE_SD = 0.5
# Standard deviation of the height of a support plane below an object, relative to the height of the object, and
# relative to the standard deviation of the points of the plane.
FOOT_SIGMA_FRACTION = 0.03
PLANE_SIGMA_FRACTION = 0.3
# Minimum number of points around an object for a ground lower than the floor; fewer may be outliers.
MIN_GROUND_POINTS = 20
# Maximum distance between the lower end of a cuboid and the plane that it is on, relative to its height.
MAX_CONTACT_FRACTION = 0.15
# The same in standard deviations of the height, up to half of the height.
MAX_CONTACT_SIGMAS = 1.5
# Common error in pixels of the borders of all masks of an object, which are too wide or too narrow.
BORDER_PX = 1.0
# Maximum standard deviation of the log extent of a cuboid that replaces a truncated side of an object with many points.
MAX_SIGMA = 0.2
#: Note of an object whose height ends at its level top, without the objects on it.
LEVEL_TOP = "ends at its level top"
# Maximum number of points of an object in a fit.
MAX_FIT_POINTS = 60


@dataclass(frozen=True, slots=True, eq=False)
class OutlineData:
    """Data that the fits of all objects of a scene share."""

    scene: Scene
    instances: Sequence[Instance]
    clouds: Sequence[PointLabels]  #: Sparse points and, if used, the dense cloud.
    geometry: SceneGeometry
    extents: OutlineExtents  #: Outlines of all instances.
    covariances: FloatArray  #: (n, 3, 3) of the sparse points.
    standing: Callable[[str], bool | None]  #: Whether a category stands on the floor (`category_rules`).

    @classmethod
    def of_scene(
        cls,
        scene: Scene,
        instances: Sequence[Instance],
        contours: Sequence[FloatArray],
        clouds: Sequence[PointLabels],
        geometry: SceneGeometry,
        standing: Callable[[str], bool | None],
    ) -> OutlineData:
        """Compute the outlines of all masks, whose contours (k, 2) are given, and the errors of the sparse points."""
        depths = []
        for row, instance in enumerate(instances):
            rows = [row_indices(cloud.membership, row) for cloud in clouds]
            view = scene.views[instance.view]
            points = np.concatenate([cloud.points[own] for cloud, own in zip(clouds, rows, strict=True)])
            depth = points @ view.rotation[2] + view.translation[2]
            depths.append(float(np.median(depth)) if len(points) else np.nan)
        extents = outline_extents(scene, instances, contours, np.array(depths))
        covariances = point_covariances(scene.views, scene.points)
        return cls(scene, instances, clouds, geometry, extents, covariances, standing)

    def outlines_of(self, item: MeasuredObject) -> Outlines:
        """Return the outlines of an object."""
        views = [self.scene.views[self.instances[row].view] for row in item.members]
        return self.extents.of_object(item.members, views, self.geometry.basis)


#: Measurement of an object that yields the cuboids to fit, receives them, and returns the object.
Steps = Generator[CuboidProblem, Cuboid, MeasuredObject]


def measured_by_outlines(objects: Sequence[MeasuredObject], data: OutlineData) -> tuple[MeasuredObject, ...]:
    """Measure objects by the cuboids that fit their outlines and points, which are fitted for all objects at once.

    Returns
    -------
    tuple of MeasuredObject
        An object is unchanged if it has enough points and is complete, or if it has both masks and boxes. It is skipped
        if neither points nor the floor determine its distance.
    """
    result = list(objects)
    cuboids: dict[int, Cuboid | None] = dict.fromkeys(range(len(objects)))
    steps = [_steps(item, data) for item in objects]
    while cuboids:
        problems: dict[int, CuboidProblem] = {}
        for row, cuboid in cuboids.items():
            try:
                problems[row] = next(steps[row]) if cuboid is None else steps[row].send(cuboid)
            except StopIteration as end:
                result[row] = end.value
        cuboids = dict(zip(problems, fit_cuboids(list(problems.values())), strict=True))
    return tuple(result)


def _steps(item: MeasuredObject, data: OutlineData) -> Steps:
    """Measure an object in steps, with one cuboid after the other."""
    masks = [data.instances[row] for row in item.members]
    if all(mask.from_box for mask in masks):
        return (yield from _box_steps(item, data))
    basis, floor = data.geometry.basis, data.geometry.floor
    # Sparse points with a short baseline stretch the footprint.
    is_smeared = False
    if item.box is not None and item.cloud == "sparse" and item.point_rows is not None:
        horizontal = item.box.axes[:2]
        variance = np.einsum("ai,nij,aj->na", horizontal, data.covariances[item.point_rows], horizontal)
        error = np.sqrt(np.median(variance, axis=0))
        is_smeared = bool((error > MAX_SMEAR_FRACTION * item.extents[:2]).any())
    has_points = item.points >= MIN_SUFFICIENT_POINTS and item.skipped is None and not is_smeared
    if any(mask.from_box for mask in masks) or (has_points and not np.any(item.truncated)):
        return item

    # First fit: on the floor, if the category stands on it.
    outlines = data.outlines_of(item)
    points = _point_rays(item, data)
    stands = data.standing(item.category)
    foot = _foot_on_plane(floor, data, 0.0, None) if stands and floor is not None else None
    centre = _approximate_centre(points, outlines, foot)
    if centre is None:
        return replace(item, skipped="its distance is unknown: it has no points, and no floor is below it")
    if foot is not None and points is not None:
        foot = _foot_on_ground(foot, data, centre, outlines.size_at(centre))
    is_extended = item.unsupported_height is not None and bool(item.notes)
    if is_extended:
        foot = None
    cuboid = yield CuboidProblem(outlines, centre, _yaw(item, basis), foot, points)

    # Second fit: on the plane at which the first cuboid ends.
    if not is_extended and stands is not False and data.geometry.planes:
        height = float(cuboid.extents[2])
        bottom = float(cuboid.centre[2]) - height / 2
        sigma = float(np.sqrt(cuboid.covariance[2, 2])) * height
        tolerance = max(MAX_CONTACT_FRACTION * height, min(MAX_CONTACT_SIGMAS * sigma, height / 2))
        plane = min(data.geometry.planes, key=lambda plane: abs(plane.height - bottom))
        if abs(plane.height - bottom) < tolerance:
            foot = _foot_on_plane(plane, data, height, cuboid.centre)
            if plane is floor:
                foot = _foot_on_ground(foot, data, cuboid.centre, float(cuboid.extents[:2].max()))
            cuboid = yield CuboidProblem(outlines, cuboid.centre, cuboid.yaw, foot, points)

    depth = float(np.median((outlines.rotation @ cuboid.centre + outlines.translation)[:, 2]))
    pixel_size = depth / float(data.scene.views[masks[0].view].camera.params[0])
    is_cut = outlines.truncated_sides(foot is not None)
    return combine_sizes(item, cuboid, basis, (has_points, is_extended), is_cut, pixel_size)


def _box_steps(item: MeasuredObject, data: OutlineData) -> Steps:
    """Measure an object with boxes only; most of its points are background and determine just its position."""
    if item.skipped is not None or item.box is None:
        return item
    basis = data.geometry.basis
    cloud = data.clouds[0 if item.cloud == "sparse" else -1].points
    centre = np.median(cloud[item.point_rows] @ basis.T, axis=0)
    foot = None
    if item.unsupported_height is not None:
        bottom = float(item.box.centre @ basis[2]) - float(item.extents[2]) / 2
        foot = (bottom, FOOT_SIGMA_FRACTION * float(item.extents[2]))
    centre_sd = BOX_CENTRE_SD * float(np.sqrt(item.extents[0] * item.extents[2]))
    outlines = data.outlines_of(item)
    cuboid = yield CuboidProblem(outlines, centre, _yaw(item, basis), foot, centre_sd=centre_sd)
    # The covariance of a cuboid contains its misfit from 1 on.
    deviations = np.sqrt(np.diag(cuboid.covariance))
    sigma = FIT_SIGMA_FACTOR * deviations * max(cuboid.misfit, MIN_BOX_MISFIT) / max(cuboid.misfit, 1.0)
    box = _box_of(cuboid, basis)
    # Boxes show neither end of a side along all lines of sight.
    sight = outlines.rotation @ cuboid.centre + outlines.translation
    sides = outlines.rotation @ basis @ box.axes[:2].T  # (v, 3, 2)
    cosines = np.abs(np.einsum("vi,via->va", sight, sides)) / np.linalg.norm(sight, axis=1)[:, None]
    truncated = outlines.truncated_sides(foot is not None)
    truncated[:2] |= (cosines > np.sqrt(1 - MIN_VISIBLE_SINE**2)).all(axis=0)
    return replace(
        item,
        extents=cuboid.extents,
        sigma=np.hypot(sigma, BOX_SIGMA),
        truncated=truncated,
        unsupported_height=None,
        box=box,
    )


def combine_sizes(
    item: MeasuredObject,
    cuboid: Cuboid,
    basis: FloatArray,
    by_points: tuple[bool, bool],
    is_cut: BoolArray,
    pixel_size: float,
) -> MeasuredObject:
    """Combine the size of an object by its points with the cuboid of its outlines.

    Parameters
    ----------
    item : MeasuredObject
        The object by its points.
    cuboid : Cuboid
    basis : (3, 3) ndarray of float
        Level basis.
    by_points : tuple of bool
        Whether its complete sides are measured by its points, and whether its height is, because it reaches down to a
        plane.
    is_cut : (3,) ndarray of bool
        Sides of which no outline shows both ends.
    pixel_size : float
        Size of a pixel at the object, in scene units.
    """
    border = BORDER_PX * pixel_size / cuboid.extents
    # The outlines of an object with a level top include the objects on it.
    clutter = np.array([0.0, 0.0, item.sigma[2] if item.sigma[2] >= HIDDEN_TOP_SIGMA else 0.0])
    factor = FEW_POINTS_SIGMA_FACTOR if item.points < MIN_SUFFICIENT_POINTS else 1.0
    covariance = factor**2 * (cuboid.covariance + np.diag(np.square(MASK_SIGMA) + border**2)) + np.diag(clutter**2)
    keep = np.array([False, False, by_points[1] or LEVEL_TOP in item.notes])
    if by_points[0]:
        is_uncertain = np.sqrt(np.diag(covariance)) > MAX_SIGMA
        is_smaller = cuboid.extents < item.extents
        keep = ~np.asarray(item.truncated, dtype=bool) | is_cut | is_uncertain | is_smaller
    if keep.all():
        return item
    box = _box_of(cuboid, basis)
    extents, truncated = cuboid.extents.copy(), is_cut
    if keep.any() and item.box is not None:
        extents = np.where(keep, item.extents, extents)
        truncated = np.where(keep, item.truncated, is_cut)
        covariance[keep] = covariance[:, keep] = 0
        covariance[keep, keep] = item.sigma[keep] ** 2
        if keep[:2].any():
            box = item.box
        else:  # the centre of the outlines, at the height of the points
            box = replace(box, centre=box.centre + (item.box.centre - box.centre) @ basis[2] * basis[2])
    order = [0, 1, 2] if extents[0] >= extents[1] else [1, 0, 2]
    extents, covariance = extents[order], covariance[np.ix_(order, order)]
    return replace(
        item,
        extents=extents,
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        truncated=truncated[order],
        unsupported_height=item.unsupported_height if keep[2] else None,
        box=replace(box, extents=extents, axes=box.axes[order]),
        skipped=None,
        notes=(*item.notes, BY_OUTLINES),
    )


def _box_of(cuboid: Cuboid, basis: FloatArray) -> Box:
    """Return the box of a cuboid in the scene; `basis` (3, 3) is the level basis."""
    c, s = np.cos(cuboid.yaw), np.sin(cuboid.yaw)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ basis
    return Box(cuboid.centre @ basis, axes, cuboid.extents)


def _yaw(item: MeasuredObject, basis: FloatArray) -> float:
    """Return the yaw of the box of an object in the level basis (3, 3), 0 without a box."""
    if item.box is None:
        return 0.0
    length_axis = item.box.axes[0] @ basis.T
    return float(np.arctan2(length_axis[1], length_axis[0]))


def _point_rays(item: MeasuredObject, data: OutlineData) -> PointRays | None:
    """Return the points of an object, each on the ray of the first view that has it in its mask; None without any."""
    if item.point_rows is None or not len(item.point_rows):
        return None
    is_sparse = item.cloud == "sparse"
    cloud = data.clouds[0 if is_sparse else -1]
    rows: IntArray = evenly_spaced(item.point_rows, MAX_FIT_POINTS)
    eyes = np.full((len(rows), 3), np.nan)
    for member in item.members:
        own = row_indices(cloud.membership, member)  # sorted
        is_member = np.searchsorted(own, rows, side="right") > np.searchsorted(own, rows)
        is_new = is_member & np.isnan(eyes[:, 0])
        eyes[is_new] = data.scene.views[data.instances[member].view].centre
    offsets = cloud.points[rows] - eyes
    depths = np.linalg.norm(offsets, axis=1)
    rays = offsets / depths[:, None]
    if is_sparse:
        variance = np.einsum("ni,nij,nj->n", rays, data.covariances[rows], rays)
    else:
        variance = (data.geometry.noise[-1] * depths) ** 2
    basis = data.geometry.basis
    return PointRays(eyes @ basis.T, rays @ basis.T, depths, np.maximum(np.sqrt(variance), 1e-3 * depths))


def _approximate_centre(
    points: PointRays | None, outlines: Outlines, foot: tuple[float, float] | None
) -> FloatArray | None:
    """Return an approximate centre (3,): the median of the points, or of the lower ends of the outlines on the foot."""
    if points is not None:
        return np.asarray(np.median(points.eyes + points.depths[:, None] * points.rays, axis=0))
    if foot is None:
        return None
    positions = []
    views = zip(outlines.max_projections, outlines.rotation, outlines.translation, strict=True)
    for projections, rotation, translation in views:
        eye = -rotation.T @ translation
        lowest = rotation.T @ np.array([(projections[2] - projections[0]) / 2, projections[3], 1.0])
        drop = foot[0] - eye[2]
        if drop * lowest[2] > 0:
            positions.append(eye + lowest * (drop / lowest[2]))
    return np.median(positions, axis=0) if positions else None


def _foot_on_plane(
    plane: SupportPlane, data: OutlineData, height: float, position: FloatArray | None
) -> tuple[float, float]:
    """Return the height of a plane below an object, and its standard deviation.

    The plane tilts with the distance of `position` (3,) from its known cells. Without a position, the standard
    deviation is relative to the height of the cameras, and otherwise to the `height` of the object.
    """
    sigma = np.hypot(PLANE_SIGMA_FRACTION * plane.sigma, FOOT_SIGMA_FRACTION * height)
    if position is None:
        eyes = camera_centres(data.scene.views) @ data.geometry.basis.T
        camera_height = abs(float(np.median(eyes[:, 2])) - plane.height)
        return plane.height, float(max(sigma, FOOT_SIGMA_FRACTION * camera_height))
    cells = np.argwhere(plane.cells) * plane.cell + plane.origin + plane.cell / 2
    distance = float(np.linalg.norm(cells - position[:2], axis=1).min()) if len(cells) else 0.0
    tilt = np.radians(data.geometry.up.sigma_deg)
    return plane.height, float(np.hypot(sigma, tilt * max(distance - plane.cell, 0.0)))


def _foot_on_ground(
    foot: tuple[float, float], data: OutlineData, position: FloatArray, size: float
) -> tuple[float, float]:
    """Return the foot on the floor, or on lower ground if the points around `position` (3,) show some.

    A path and the street next to it are not one plane. `size` is the size of the object in scene units.
    """
    cloud, floor = data.geometry.support_cloud, data.geometry.floor
    if cloud is None or floor is None:
        return foot
    near = cloud.points[(np.abs(cloud.points[:, :2] - position[:2]) < size).all(axis=1), 2]
    if len(near) < MIN_GROUND_POINTS:
        return foot
    lowest = float(np.quantile(near, MAX_BELOW_FLOOR_FRACTION))
    drop = foot[0] - lowest
    # The points of a floor scatter by the side of a cell.
    return (lowest, float(np.hypot(foot[1], drop / 2))) if drop > floor.cell else foot
