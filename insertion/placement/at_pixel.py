"""A place by a point in a picture, or by a plane with coordinates."""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import SupportPlane
from estimator.records.scene import View
from insertion.placement.free_space import NEAR_POINTS, Space
from insertion.placement.placement import NoPlace
from insertion.request import Place
from insertion.scene.camera_rays import ray_through
from insertion.scene.point_cloud import Cloud, front_points
from insertion.scene.supports import Surface, cell_centres
from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

#: The cloud around the point that was clicked, in pixels at a width of 640.
NEAR_PX = 14.0
#: Points within this share of their depth of a plane are on it: the noise of a cloud.
SAME_HEIGHT = 0.012
#: An object stands on a plane if the points around it are at the plane's height within so many times that.
FLUSH_HEIGHTS = 1.5
#: A small level patch: its points rise and fall by no more than this share of their distance from the camera.
LEVEL_SHARE = 0.008
#: A bare surface is made of what is around the click: within so many pixels at a width of 640, wider each time, of so
#: many points at one height, which are this share of all points there that are not above it.
AROUND_PX, LEAST_LEVEL, LEAST_SHARE = (14.0, 28.0, 56.0, 112.0), 6, 0.3
#: Whoever looks along a surface (by this cosine with up) sees no place on it; a made surface is no nearer, and no
#: farther, than its points by this factor; and nothing is nearer at the click by this share of the depth.
GRAZING, BARE_DEPTHS, BARE_NEARER = 0.03, 1.5, 0.9
#: The ground goes on from what was seen of it by so much of its distance from the camera.
GROUND_GOES_ON = 0.5
#: Sides of the cells of a made surface along its extent.
BARE_CELLS = 12


def place_at_point(space: Space, view: View, x: float, y: float) -> Place:
    """Where the ray through a pixel meets what is level there. Raises NoPlace with the reason where nothing is."""
    if not (0 <= x <= view.camera.width and 0 <= y <= view.camera.height):
        size = f"{view.camera.width} x {view.camera.height}"
        raise NoPlace(f"--at: expected a pixel of {view.name} ({size}); found x={x:g}, y={y:g}")
    ray = ray_through(view, x, y)
    points, _ = _near(space.cloud, view, x, y)
    numbers = range(len(space.supports.surfaces))
    hits = [hit for number in numbers if (hit := _hit(space, number, view, ray)) is not None]
    if len(points) >= NEAR_POINTS:
        # what the pixel shows decides between planes, and against all of them
        crossed, hits = hits, [hit for hit in hits if _flush(space, hit[1], points, hit[0])]
        if crossed and not hits:
            return _bare_level(space, view, x, y, ray)
        shares = {hit: _share_on(space, hit[1], points, hit[0]) for hit in hits}
        # of two planes at nearly one height, the one that more of the points are on
        most = max(shares.values(), default=0.0)
        hits = [hit for hit in hits if shares[hit] > max(0.5, most - 0.1)]
        if not hits:
            return _level_patch(space, view, x, y, ray)
    if not hits:
        return _bare_level(space, view, x, y, ray)
    depth, plane = min(hits)
    return _place(space, plane, view.centre + ray * depth, view.centre)


def place_on_plane(space: Space, plane: int, at: FloatArray, camera: FloatArray) -> Place:
    """A place on a plane, `at` (2,) scene units from the middle of what was seen of it, along its own axes."""
    planes = space.supports.surfaces
    if not planes:
        raise NoPlace("--plane: no support plane was reconstructed")
    if not 0 <= plane < len(planes):
        raise NoPlace(f"--plane: expected 0 to {len(planes) - 1} (lowest first); found {plane}")
    chosen = planes[plane]
    position = plane_point(chosen, at)
    if not chosen.holds((chosen.plane.basis[:2] @ position)[None])[0]:
        raise NoPlace(f"--xy: expected a point on plane {plane}; found one beside what was seen of it")
    return _place(space, plane, position, camera)


def plane_point(surface: Surface, at: FloatArray) -> FloatArray:
    """(3,) point of a plane, `at` (2,) scene units from the middle of what was seen of it, along its own axes."""
    return np.asarray(np.append(_middle(surface) + at, surface.plane.height) @ surface.plane.basis)


def level_point(place: Place, view: View, x: float, y: float) -> FloatArray:
    """(3,) where the ray through a pixel is level with a place. Raises NoPlace where it never is."""
    up, ray = place.basis[2], ray_through(view, x, y)
    toward = float(ray @ up)
    depth = float((place.position - view.centre) @ up) / toward if abs(toward) > GRAZING else -1.0
    if depth <= 0:
        raise NoPlace(f"--path: expected pixels of {view.name} that show the surface; found x={x:g}, y={y:g}")
    return np.asarray(view.centre + depth * ray)


def plane_coordinates(space: Space, place: Place) -> FloatArray:
    """(2,) what `place_on_plane` takes for a place on a plane."""
    assert place.plane is not None
    return np.asarray(place.basis[:2] @ place.position - _middle(space.supports.surfaces[place.plane]))


def _place(space: Space, plane: int, position: FloatArray, camera: FloatArray) -> Place:
    """A place on a support plane, position and camera (3,)."""
    chosen = space.supports.surfaces[plane]
    return Place(np.asarray(position), chosen.plane.basis, camera, f"plane {plane}", plane)


def _hit(space: Space, number: int, view: View, ray: FloatArray) -> tuple[float, int] | None:
    """Distance along the ray (3,) (in depths: the ray has z = 1 in the camera) to a plane where it was seen."""
    surface = space.supports.surfaces[number]
    plane = surface.plane
    toward = float(ray @ plane.basis[2])
    rise = plane.height - float(view.centre @ plane.basis[2])
    if abs(toward) < 1e-9 or rise / toward <= 0 or rise >= 0:  # from above only: nothing stands on a ceiling
        return None
    depth = rise / toward
    local = (view.centre + depth * ray) @ plane.basis[:2].T
    return (depth, number) if surface.holds(local[None])[0] else None


def _share_on(space: Space, number: int, points: FloatArray, depth: float) -> float:
    """Share of the points (n, 3) on a plane, within its roughness and the cloud's own noise at this depth."""
    plane = space.supports.surfaces[number].plane
    rise = points @ plane.basis[2] - plane.height
    return float(np.mean(np.abs(rise) < max(3 * plane.sigma, SAME_HEIGHT * depth)))


def _flush(space: Space, number: int, points: FloatArray, depth: float) -> bool:
    """Whether a plane that the points (n, 3) are on is at their height: a street slopes, and its plane does not."""
    plane = space.supports.surfaces[number].plane
    rise = points @ plane.basis[2] - plane.height
    on_plane = np.abs(rise) < max(3 * plane.sigma, SAME_HEIGHT * depth)
    return not on_plane.any() or abs(float(np.median(rise[on_plane]))) < FLUSH_HEIGHTS * SAME_HEIGHT * depth


def _near(cloud: Cloud, view: View, x: float, y: float) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) and depths (n,) of the front surface around a pixel, the nearest pixels first."""
    pixels, depths = pixels_in_view(view, cloud.points)
    with np.errstate(invalid="ignore"):
        distance = np.hypot(pixels[:, 0] - x, pixels[:, 1] - y)
    reach = NEAR_PX * view.camera.width / 640
    rows = np.flatnonzero(distance < reach)
    rows = rows[np.argsort(distance[rows])][:40]
    if len(rows):
        rows = rows[depths[rows] < 1.1 * np.percentile(depths[rows], 20)]
    return cloud.points[rows], depths[rows]


def _level_patch(space: Space, view: View, x: float, y: float, ray: FloatArray) -> Place:
    """A small level surface where the ray (3,) ends that is no support plane, such as the top of a box."""
    points, depths = _near(space.cloud, view, x, y)
    up = space.supports.up.vector
    heights = points @ up
    spread = robust_sigma(heights)
    toward = float(ray @ up)
    if spread > LEVEL_SHARE * float(np.median(depths)) or toward > -0.05:
        raise NoPlace(f"--at: what is at x={x:g}, y={y:g} of {view.name} is not level; see --preview for free places")
    depth = (float(np.median(heights)) - float(view.centre @ up)) / toward
    if not 0.5 < depth / float(np.median(depths)) < 2:
        raise NoPlace(f"--at: no level surface was reconstructed at x={x:g}, y={y:g} of {view.name}; see --preview")
    basis = space.supports.surfaces[0].plane.basis if space.supports.surfaces else _basis(up)
    return Place(view.centre + depth * ray, basis, view.centre, "level patch")


def _bare_level(space: Space, view: View, x: float, y: float, ray: FloatArray) -> Place:
    """A place on a bare surface that the ray (3,) meets: level, at the height of the points around it in the picture.

    Raises NoPlace where these have no height in common.
    """
    up, toward = space.supports.up.vector, float(ray @ space.supports.up.vector)
    refused = NoPlace(f"--at: no level surface was reconstructed at x={x:g}, y={y:g} of {view.name}; see --preview")
    if toward > -GRAZING:
        raise refused
    sight = front_points(view, space.cloud)
    distance = np.hypot(*(sight.pixels - [x, y]).T) * 640 / view.camera.width
    eye = float(view.centre @ up)
    for reach in AROUND_PX:
        near = np.flatnonzero(distance < reach)
        if len(near) < LEAST_LEVEL:
            continue
        heights, depths = space.cloud.points[sight.rows[near]] @ up, sight.depths[near]
        noise = SAME_HEIGHT * depths
        # the height that most points share, those next to the click first
        same = np.abs(heights[:, None] - heights) < noise
        best = int((same @ (1 / (distance[near] + 5.0))).argmax())
        level = np.flatnonzero(same[best])
        above = heights > heights[best] + noise
        depth = (float(np.median(heights[level])) - eye) / toward
        close = near[distance[near] < AROUND_PX[0] / 2]
        hidden = len(close) >= 3 and float(np.median(sight.depths[close])) < BARE_NEARER * depth
        between = depths[level].min() / BARE_DEPTHS < depth < depths[level].max() * BARE_DEPTHS
        if len(level) >= max(LEAST_LEVEL, LEAST_SHARE * np.count_nonzero(~above)) and between and not hidden:
            return _bare_place(space, view, view.centre + depth * ray, space.cloud.points[sight.rows[near[level]]])
    around = sight.rows[distance < AROUND_PX[-1]], sight.depths[distance < AROUND_PX[-1]]
    position = _on_ground(space, view, ray, space.cloud.points[around[0]], around[1])
    if position is None:
        raise refused
    return _bare_place(space, view, position, np.empty((0, 3)))


def _on_ground(space: Space, view: View, ray: FloatArray, points: FloatArray, depths: FloatArray) -> FloatArray | None:
    """(3,) where a ray (3,) meets the ground beside what was seen of it.

    points (n, 3) at depths (n,) : what the picture shows around; None where most of it is above the ground and nearer.
    """
    ground = space.supports.ground(space.cloud)
    if ground is None:
        return None
    up, height = ground.plane.basis[2], ground.plane.height
    depth = (height - float(view.centre @ up)) / float(ray @ up)
    above = points @ up - height > np.maximum(3 * ground.plane.sigma, SAME_HEIGHT * depths)
    position = view.centre + depth * ray
    seen = cell_centres(ground.origin, ground.cell, ground.solid.shape)[ground.solid]
    apart = np.linalg.norm(seen - ground.plane.basis[:2] @ position, axis=1).min(initial=np.inf)
    in_front = above & (depths < BARE_NEARER * depth)
    bare = depth > 0 and apart < GROUND_GOES_ON * depth and 2 * np.count_nonzero(in_front) <= len(points)
    return np.asarray(position) if bare else None


def _bare_place(space: Space, view: View, position: FloatArray, points: FloatArray) -> Place:
    """A place (3,) on a surface made of the points (n, 3) around it."""
    surface = _surface_at(space, position, points)
    return Place(position, surface.plane.basis, view.centre, "bare surface", None, surface)


def _surface_at(space: Space, position: FloatArray, points: FloatArray) -> Surface:
    """A level surface through a position (3,), as wide as the points (n, 3) around it and solid all over."""
    basis = space.supports.surfaces[0].plane.basis if space.supports.surfaces else _basis(space.supports.up.vector)
    flat = np.vstack([points, position[None]]) @ basis[:2].T
    low, high = flat.min(axis=0) - 3 * space.radius, flat.max(axis=0) + 3 * space.radius
    cell = float((high - low).max()) / BARE_CELLS
    cells = np.ones(tuple(np.ceil((high - low) / cell).astype(int)), dtype=bool)
    sigma = robust_sigma((points - position) @ basis[2]) if len(points) > 1 else 0.0
    plane = SupportPlane(basis, float(position @ basis[2]), sigma, len(points), low, cell, cells)
    return Surface(-1, plane, low, cell, cells, np.empty((0, 2)), np.empty(0))


def _basis(up: FloatArray) -> FloatArray:
    """(3, 3) axes as rows, `up` (3,) last."""
    from estimator.geometry.planes import level_basis

    return level_basis(up)


def _middle(surface: Surface) -> FloatArray:
    """(2,) centre of the solid cells of a plane."""
    centres = cell_centres(surface.origin, surface.cell, surface.solid.shape)
    return np.asarray(centres[surface.solid].mean(axis=0))
