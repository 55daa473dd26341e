"""Placement at a pixel of a frame, or at coordinates on a support plane."""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import SupportPlane
from estimator.records.scene import View
from insertion.placement.free_space import MIN_POINTS
from insertion.placement.placement import Placement, PlacementError, PlacementSpace
from insertion.scene.camera_rays import ray_through
from insertion.scene.point_cloud import visible_points
from insertion.scene.supports import Surface, cell_centres
from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

#: Radius around the pixel in which points of the cloud are used, in pixels at an image width of 640.
POINT_RADIUS_PX = 14.0
#: Maximum number of these points.
MAX_NEAR_POINTS = 40
#: Maximum depth of these points over their 20th percentile: others are on a surface behind.
MAX_DEPTH_RATIO = 1.1
#: Maximum distance of a point on a plane, as a fraction of its depth: the noise of a cloud.
HEIGHT_TOLERANCE = 0.012
#: Maximum median height above a plane of the points on it, in height tolerances. A street slopes, its plane does not.
MAX_FLUSH_TOLERANCES = 1.5
#: Minimum fraction of the points around the pixel that are on the plane of the position.
MIN_ON_PLANE = 0.5
#: Maximum difference to the plane with most points of a plane that is still considered.
MAX_ON_PLANE_DIFFERENCE = 0.1
#: Maximum standard deviation of the heights of a small level surface, as a fraction of the depth.
MAX_PATCH_ROUGHNESS = 0.008
#: Minimum sine between a ray and a small level surface.
MIN_PATCH_SINE = 0.05
#: Maximum ratio, and inverse minimum ratio, of the depth of a small level surface to that of its points.
MAX_PATCH_DEPTH_RATIO = 2
#: Radii around the pixel in which points of a bare surface are searched, in pixels at an image width of 640.
BARE_RADII_PX = (14.0, 28.0, 56.0, 112.0)
#: Minimum number of points at one height on a bare surface.
MIN_LEVEL_POINTS = 6
#: Minimum number of these points, as a fraction of the points around the pixel that are not above them.
MIN_LEVEL_FRACTION = 0.3
#: Minimum sine between a ray and a bare surface: flatter rays do not determine a position.
MIN_RAY_SINE = 0.03
#: Maximum ratio of the depth of a bare surface to those of its points, and the inverse of the minimum.
MAX_BARE_DEPTH_RATIO = 1.5
#: Maximum depth of an occluder of a bare surface, as a fraction of the depth of the surface.
MAX_OCCLUDER_DEPTH = 0.9
#: Minimum number of points next to the pixel that make an occluder.
MIN_OCCLUDER_POINTS = 3
#: Maximum extrapolation of the ground beyond its observed cells, as a fraction of the depth.
MAX_GROUND_EXTRAPOLATION = 0.5
#: Number of cells of a bare surface along its longer side.
BARE_CELLS = 12
#: Remedies for a pixel without a level surface.
REMEDY = "--preview shows free positions; if the vertical is wrong, state it: --up X,Y,Z"


def placement_at_pixel(space: PlacementSpace, view: View, x: float, y: float, radius: float) -> Placement:
    """Return the placement where the ray through a pixel meets a level surface.

    The points of the cloud around the pixel select the support plane. Without a suitable plane, a small level patch of
    the cloud, the height of the surrounding points, or the extrapolated ground is used.

    Parameters
    ----------
    space : PlacementSpace
        The scene.
    view : View
        Camera and pose of the frame.
    x, y : float
        Pixel.
    radius : float
        Half the diagonal of the footprint of the object, in scene units.

    Raises
    ------
    PlacementError
        The pixel is out of the image, or shows no level surface.
    """
    if not (0 <= x <= view.camera.width and 0 <= y <= view.camera.height):
        size = f"{view.camera.width} x {view.camera.height}"
        raise PlacementError(f"--at: expected a pixel of {view.name} ({size}); found x={x:g}, y={y:g}")
    ray = ray_through(view, x, y)
    hits = []  # depth and index of the planes that the ray meets
    for number, surface in enumerate(space.supports.surfaces):
        depth = _depth_on_surface(surface, view, ray)
        if depth is not None:
            hits.append((depth, number))
    points, depths = _front_points(space, view, x, y)
    if len(points) < MIN_POINTS:
        return _on_plane(space, view, ray, min(hits)) if hits else _bare_placement(space, view, x, y, ray, radius)
    fractions: dict[tuple[float, int], float] = {}  # fraction of the points that are on each plane
    for depth, number in hits:
        plane = space.supports.surfaces[number].plane
        tolerance = HEIGHT_TOLERANCE * depth
        heights = points @ plane.basis[2] - plane.height
        on_plane = np.abs(heights) < max(3 * plane.sigma, tolerance)
        if not on_plane.any() or abs(float(np.median(heights[on_plane]))) < MAX_FLUSH_TOLERANCES * tolerance:
            fractions[depth, number] = float(np.mean(on_plane))
    if hits and not fractions:
        return _bare_placement(space, view, x, y, ray, radius)
    # of two planes at almost the same height, the one with more points
    most = max(fractions.values(), default=0.0)
    accepted = [hit for hit in fractions if fractions[hit] > max(MIN_ON_PLANE, most - MAX_ON_PLANE_DIFFERENCE)]
    if not accepted:
        return _patch_placement(space, view, x, y, ray, points, depths)
    return _on_plane(space, view, ray, min(accepted))


def _on_plane(space: PlacementSpace, view: View, ray: FloatArray, hit: tuple[float, int]) -> Placement:
    """Return the placement at a depth on a ray (3,) and the index of a plane."""
    depth, number = hit
    plane = space.supports.surfaces[number].plane
    return Placement(view.centre + ray * depth, plane.basis, view.centre, f"plane {number}", number)


def placement_on_plane(space: PlacementSpace, plane: int, offset: FloatArray, camera: FloatArray) -> Placement:
    """Return a placement on a support plane.

    Parameters
    ----------
    plane : int
        Index of the plane, lowest first.
    offset : (2,) ndarray of float
        Position relative to the centre of the observed part, along the axes of the plane, in scene units.
    camera : (3,) ndarray of float
        Centre of the camera that the object may face.

    Raises
    ------
    PlacementError
        The plane does not exist, or the position is outside its observed part.
    """
    surfaces = space.supports.surfaces
    if not surfaces:
        raise PlacementError("--plane: no support plane was reconstructed")
    if not 0 <= plane < len(surfaces):
        raise PlacementError(f"--plane: expected 0 to {len(surfaces) - 1} (lowest first); found {plane}")
    surface = surfaces[plane]
    position = plane_point(surface, offset)
    if not surface.contains((surface.plane.basis[:2] @ position)[None])[0]:
        raise PlacementError(f"--xy: the point is outside the observed part of plane {plane}; {REMEDY}")
    return Placement(position, surface.plane.basis, camera, f"plane {plane}", plane)


def plane_point(surface: Surface, offset: FloatArray) -> FloatArray:
    """Return the point (3,) of a plane at `offset` (2,) from the centre of its observed part, in scene units."""
    return np.asarray(np.append(surface.centre + offset, surface.plane.height) @ surface.plane.basis)


def plane_coordinates(space: PlacementSpace, placement: Placement) -> FloatArray:
    """Return the `offset` (2,) of `placement_on_plane` for a placement on a plane."""
    assert placement.plane is not None
    return np.asarray(placement.basis[:2] @ placement.position - space.supports.surfaces[placement.plane].centre)


def level_point(placement: Placement, view: View, x: float, y: float) -> FloatArray:
    """Return the point (3,) on the ray through a pixel at the height of a placement.

    Raises
    ------
    PlacementError
        The ray does not meet this height in front of the camera.
    """
    up, ray = placement.basis[2], ray_through(view, x, y)
    rise = float(ray @ up)
    depth = float((placement.position - view.centre) @ up) / rise if abs(rise) > MIN_RAY_SINE else -1.0
    if depth <= 0:
        raise PlacementError(f"--path: expected pixels of {view.name} that show the surface; found x={x:g}, y={y:g}")
    return np.asarray(view.centre + depth * ray)


def _depth_on_surface(surface: Surface, view: View, ray: FloatArray) -> float | None:
    """Return the depth at which a ray (3,) meets the observed part of a plane from above; None if it does not."""
    plane = surface.plane
    rise = float(ray @ plane.basis[2])
    height = plane.height - float(view.centre @ plane.basis[2])
    if abs(rise) < 1e-9 or height / rise <= 0 or height >= 0:  # nothing stands on a ceiling
        return None
    depth = height / rise
    local = (view.centre + depth * ray) @ plane.basis[:2].T
    return depth if surface.contains(local[None])[0] else None


def _front_points(space: PlacementSpace, view: View, x: float, y: float) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) and depths (n,) of the front surface around a pixel, the closest pixels first."""
    pixels, depths = pixels_in_view(view, space.cloud.points)
    with np.errstate(invalid="ignore"):
        distance = np.hypot(pixels[:, 0] - x, pixels[:, 1] - y)
    rows = np.flatnonzero(distance < POINT_RADIUS_PX * view.camera.width / 640)
    rows = rows[np.argsort(distance[rows])][:MAX_NEAR_POINTS]
    if len(rows):
        rows = rows[depths[rows] < MAX_DEPTH_RATIO * np.percentile(depths[rows], 20)]
    return space.cloud.points[rows], depths[rows]


def _patch_placement(
    space: PlacementSpace, view: View, x: float, y: float, ray: FloatArray, points: FloatArray, depths: FloatArray
) -> Placement:
    """Return the placement on a small level surface that is no support plane, such as the top of a box.

    Parameters
    ----------
    ray : (3,) ndarray of float
        Direction through the pixel.
    points, depths : (n, 3) and (n,) ndarray of float
        Points around the pixel and their depths.
    """
    up = space.supports.up.vector
    heights = points @ up
    median_depth = float(np.median(depths))
    rise = float(ray @ up)
    if robust_sigma(heights) > MAX_PATCH_ROUGHNESS * median_depth or rise > -MIN_PATCH_SINE:
        raise PlacementError(f"--at: the surface at x={x:g}, y={y:g} of {view.name} is not level; {REMEDY}")
    depth = (float(np.median(heights)) - float(view.centre @ up)) / rise
    if not 1 / MAX_PATCH_DEPTH_RATIO < depth / median_depth < MAX_PATCH_DEPTH_RATIO:
        raise _no_level_surface(view, x, y)
    return Placement(view.centre + depth * ray, space.supports.basis, view.centre, "level patch")


def _bare_placement(space: PlacementSpace, view: View, x: float, y: float, ray: FloatArray, radius: float) -> Placement:
    """Return the placement on a bare surface: at the height of the points around the pixel, or on the ground.

    Parameters
    ----------
    ray : (3,) ndarray of float
        Direction through the pixel.
    radius : float
        Half the diagonal of the footprint of the object, in scene units.
    """
    up, rise = space.supports.up.vector, float(ray @ space.supports.up.vector)
    if rise > -MIN_RAY_SINE:
        raise _no_level_surface(view, x, y)
    sight = visible_points(view, space.cloud)
    distance = np.hypot(*(sight.pixels - [x, y]).T) * 640 / view.camera.width
    eye_height = float(view.centre @ up)
    for bare_radius in BARE_RADII_PX:
        near = np.flatnonzero(distance < bare_radius)
        if len(near) < MIN_LEVEL_POINTS:
            continue
        heights, depths = space.cloud.points[sight.rows[near]] @ up, sight.depths[near]
        noise = HEIGHT_TOLERANCE * depths
        # the height that most points share, weighted by their proximity to the pixel
        is_level = np.abs(heights[:, None] - heights) < noise
        best = int((is_level @ (1 / (distance[near] + 5.0))).argmax())
        level = np.flatnonzero(is_level[best])
        is_above = heights > heights[best] + noise
        depth = (float(np.median(heights[level])) - eye_height) / rise
        next_to = near[distance[near] < BARE_RADII_PX[0] / 2]
        is_occluded = len(next_to) >= MIN_OCCLUDER_POINTS and (
            float(np.median(sight.depths[next_to])) < MAX_OCCLUDER_DEPTH * depth
        )
        in_range = depths[level].min() / MAX_BARE_DEPTH_RATIO < depth < depths[level].max() * MAX_BARE_DEPTH_RATIO
        min_count = max(MIN_LEVEL_POINTS, MIN_LEVEL_FRACTION * np.count_nonzero(~is_above))
        if len(level) >= min_count and in_range and not is_occluded:
            points = space.cloud.points[sight.rows[near[level]]]
            return _on_bare_surface(space, view.centre + depth * ray, view.centre, points, radius)

    # No common height: the ground, extrapolated, unless most of the surroundings are above it and closer.
    ground = space.supports.ground(space.cloud)
    if ground is None:
        raise _no_level_surface(view, x, y)
    around = distance < BARE_RADII_PX[-1]
    points, depths = space.cloud.points[sight.rows[around]], sight.depths[around]
    up, height = ground.plane.basis[2], ground.plane.height
    depth = (height - float(view.centre @ up)) / float(ray @ up)
    is_above = points @ up - height > np.maximum(3 * ground.plane.sigma, HEIGHT_TOLERANCE * depths)
    position = view.centre + depth * ray
    observed = cell_centres(ground.origin, ground.cell, ground.solid.shape)[ground.solid]
    gap = np.linalg.norm(observed - ground.plane.basis[:2] @ position, axis=1).min(initial=np.inf)
    is_in_front = is_above & (depths < MAX_OCCLUDER_DEPTH * depth)
    is_close = depth > 0 and gap < MAX_GROUND_EXTRAPOLATION * depth
    if not is_close or 2 * np.count_nonzero(is_in_front) > len(points):
        raise _no_level_surface(view, x, y)
    return _on_bare_surface(space, np.asarray(position), view.centre, np.empty((0, 3)), radius)


def _on_bare_surface(
    space: PlacementSpace, position: FloatArray, camera: FloatArray, points: FloatArray, radius: float
) -> Placement:
    """Return a placement on a level surface through `position` (3,) with the extent of points (n, 3).

    The surface is solid. It extends three radii of the object beyond the points.
    """
    basis = space.supports.basis
    flat = np.vstack([points, position[None]]) @ basis[:2].T
    low, high = flat.min(axis=0) - 3 * radius, flat.max(axis=0) + 3 * radius
    cell = float((high - low).max()) / BARE_CELLS
    cells = np.ones(tuple(np.ceil((high - low) / cell).astype(int)), dtype=bool)
    sigma = robust_sigma((points - position) @ basis[2]) if len(points) > 1 else 0.0
    plane = SupportPlane(basis, float(position @ basis[2]), sigma, len(points), low, cell, cells)
    surface = Surface(-1, plane, low, cell, cells, np.empty((0, 2)), np.empty(0))
    return Placement(position, basis, camera, "bare surface", None, surface)


def _no_level_surface(view: View, x: float, y: float) -> PlacementError:
    """Return the error of a pixel that shows no level surface."""
    return PlacementError(f"--at: no level surface was reconstructed at x={x:g}, y={y:g} of {view.name}; {REMEDY}")
