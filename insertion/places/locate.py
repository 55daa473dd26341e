"""From a request to a place: a point in a picture, a category, a plane with coordinates, or free space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.scene import Instance, Scene, View
from insertion.places.place import NoPlace, Place
from insertion.places.supports import Supports, free_cells
from insertion.places.surface import Surface, cell_centres
from insertion.scene.cloud import Cloud
from insertion.scene.rays import ray_through
from metric_base.arrays import BoolArray, FloatArray
from metric_base.statistics import robust_sigma

__all__ = ["Space", "candidates", "place_at_point", "place_on_category", "place_on_plane"]

#: The cloud around the point that was clicked, in pixels, and how many of its points say what is there.
NEAR_PX, NEAR_POINTS = 14.0, 4
#: Points within this share of their depth of a plane are on it: the noise of a cloud.
SAME_HEIGHT = 0.012
#: A small level patch: its points rise and fall by no more than this share of their distance from the camera.
LEVEL_SHARE = 0.008
#: Candidates offered, and the share of the views that must see one.
MAX_CANDIDATES, SEEN_SHARE = 8, 0.25
#: An object smaller than this in the picture is not worth a place, larger hides the scene (share of the height).
APPARENT = (0.04, 0.7)
#: A free place has nothing above it up to so many heights of the object, if there is such a place.
OPEN_HEIGHTS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The scene as places are sought in it, and the object's radius and height in scene units."""

    scene: Scene
    cloud: Cloud
    supports: Supports
    radius: float
    height: float


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
        hits = [hit for hit in hits if _share_on(space, hit[1], points, hit[0]) > 0.5]
        if not hits:
            return _level_patch(space, view, x, y, ray)
    if not hits:
        raise NoPlace(f"--at: no level surface was reconstructed at x={x:g}, y={y:g} of {view.name}; see --preview")
    depth, plane = min(hits)
    return _place(space, plane, view.centre + ray * depth, view.centre)


def place_on_plane(space: Space, plane: int, at: FloatArray, camera: FloatArray) -> Place:
    """A place on a plane, `at` (2,) scene units from the middle of what was seen of it, along its own axes."""
    planes = space.supports.surfaces
    if not 0 <= plane < len(planes):
        raise NoPlace(f"--plane: expected 0 to {len(planes) - 1} (lowest first); found {plane}")
    chosen = planes[plane]
    local = np.append(_middle(chosen) + at, chosen.plane.height)
    if not chosen.holds(local[None, :2])[0]:
        raise NoPlace(f"--xy: expected a point on plane {plane}; found one beside what was seen of it")
    return _place(space, plane, local @ chosen.plane.basis, camera)


def place_on_category(space: Space, category: str, instances: Sequence[Instance]) -> Place:
    """Free space on the top of the things of a category. Raises NoPlace where there is none."""
    named = [item for item in instances if item.category.lower() == category.lower()]
    if not named:
        names = ", ".join(sorted({item.category for item in instances})) or "no instance at all"
        raise NoPlace(f"--on: expected a category of the instances ({names}); found {category!r}")
    votes = _points_of(space, named)
    if len(votes) < NEAR_POINTS:
        raise NoPlace(f"--on: the cloud has no points on any {category}")
    options = []
    for number, surface in enumerate(space.supports.surfaces):
        plane = surface.plane
        local = votes @ plane.basis.T
        on_plane = np.abs(local[:, 2] - plane.height) < max(4 * plane.sigma, plane.cell / 2)
        if np.count_nonzero(on_plane) >= max(NEAR_POINTS, 0.1 * len(votes)):
            options.append((number, _mask_of(surface, local[on_plane, :2])))
    # the highest plane that the things share is their top
    places = [place for number, mask in reversed(options) for place in _free_places(space, number, mask)[:1]]
    if not places:
        raise NoPlace(f"--on: no free level space on any {category} for an object of this size")
    return places[0][1]


def candidates(space: Space) -> list[Place]:
    """Free places on all planes, the best first: those that most views see, on the largest plane."""
    scored = [item for plane in range(len(space.supports.surfaces)) for item in _free_places(space, plane)]
    scored.sort(key=lambda item: -item[0])
    return [place for _, place in scored[:MAX_CANDIDATES]]


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


def _basis(up: FloatArray) -> FloatArray:
    """(3, 3) axes as rows, `up` (3,) last."""
    from estimator.geometry.planes import level_basis

    return level_basis(up)


def _middle(surface: Surface) -> FloatArray:
    """(2,) centre of the solid cells of a plane."""
    centres = cell_centres(surface.origin, surface.cell, surface.solid.shape)
    return np.asarray(centres[surface.solid].mean(axis=0))


def _mask_of(surface: Surface, local: FloatArray) -> BoolArray:
    """(a, b) cells within the outline of points of the plane."""
    import cv2

    hull = cv2.convexHull(((local - surface.origin) / surface.cell).astype(np.float32))
    mask = np.zeros(surface.solid.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.floor(hull[:, 0, ::-1]).astype(np.int32), 1)
    return mask.astype(bool)


def _points_of(space: Space, instances: Sequence[Instance]) -> FloatArray:
    """(n, 3) points of the cloud in the masks of the instances and in front."""
    from insertion.scene.cloud import points_seen

    kept = []
    for item in instances[:: max(1, len(instances) // 24)]:
        rows, pixels, _ = points_seen(space.scene, item.view, space.cloud.points)
        at = np.floor(pixels - item.origin).astype(np.int64)
        inside = ((at >= 0) & (at < item.mask.shape[::-1])).all(axis=1)
        rows, at = rows[inside], at[inside]
        kept.append(rows[item.mask[at[:, 1], at[:, 0]]])
    return space.cloud.points[np.unique(np.concatenate(kept))]


def _free_places(space: Space, number: int, mask: BoolArray | None = None) -> list[tuple[float, Place]]:
    """Up to two free places of a plane, in the cells `mask` (r, c), scored by views that see it times root area."""
    surface = space.supports.surfaces[number]
    free = free_cells(surface, space.radius, OPEN_HEIGHTS * space.height)  # not under a table
    if not free.any():
        free = free_cells(surface, space.radius, space.height)
    if mask is not None:
        free &= mask
    room = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    scored: list[tuple[float, Place]] = []
    area = float(np.sqrt(surface.solid.sum())) * surface.cell
    for _ in range(2):
        if room.max() <= 0:
            break
        cells = np.argwhere(room > 0.6 * room.max())
        cells = cells[:: max(1, len(cells) // 30)]
        flat = surface.origin + (cells + 0.5) * surface.cell
        points = np.column_stack([flat, np.full(len(cells), surface.plane.height)]) @ surface.plane.basis
        shares, cameras = _visibility(space, points)
        best = int(shares.argmax())
        if shares[best] >= SEEN_SHARE:
            scored.append((float(shares[best]) * area, _place(space, number, points[best], cameras[best])))
        rows, columns = np.indices(room.shape)
        apart = np.hypot(rows - cells[best][0], columns - cells[best][1]) > 3 * space.radius / surface.cell + 2
        room = np.where(apart, room, 0.0)
    return scored


def _visibility(space: Space, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the views in which an object at each of (k, 3) points is well seen, and (k, 3) the best such camera."""
    up = space.supports.up.vector
    good = np.zeros(len(points))
    cameras = np.tile(space.scene.views[0].centre, (len(points), 1))
    middle_best = np.full(len(points), np.inf)
    for view in space.scene.views:
        foot, depth = pixels_in_view(view, points)
        top, _ = pixels_in_view(view, points + space.height * up)
        with np.errstate(invalid="ignore"):
            apparent = np.linalg.norm(top - foot, axis=1) / view.camera.height
            seen = np.isfinite(foot[:, 0]) & np.isfinite(top[:, 0]) & (depth > 0)
            seen &= (apparent > APPARENT[0]) & (apparent < APPARENT[1]) & ((view.centre - points) @ up > 0)
            seen &= _visible_points(space, view, points + 0.5 * space.height * up)
            centre = np.array([view.camera.width, view.camera.height]) / 2
            off = np.linalg.norm((foot + top) / 2 - centre, axis=1)
        better = seen & (off < middle_best)
        cameras[better], middle_best[better] = view.centre, off[better]
        good += seen
    return good / len(space.scene.views), cameras


def _visible_points(space: Space, view: View, points: FloatArray) -> BoolArray:
    """(k,) whether little of the cloud lies clearly in front of each point in a view."""
    step = max(1, len(space.cloud.points) // 6000)
    pixels, depths = pixels_in_view(view, space.cloud.points[::step])
    inside = np.isfinite(pixels[:, 0])
    x, y, depths = pixels[inside, 0], pixels[inside, 1], depths[inside]
    at, depth = pixels_in_view(view, points)
    reach = 0.03 * view.camera.width
    with np.errstate(invalid="ignore"):
        near = (np.abs(x - at[:, :1]) < reach) & (np.abs(y - at[:, 1:]) < reach)  # (k, n), none for a point out of view
        nearer = near & (depths < 0.85 * depth[:, None])
    counts = near.sum(axis=1)
    return np.asarray((counts < NEAR_POINTS) | (nearer.sum(axis=1) < 0.5 * counts))
