"""Free positions on the support surfaces: an object fits, no obstacle is in its way, and cameras see it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import View
from insertion.placement.placement import Placement, PlacementSpace
from insertion.scene.supports import Surface, free_cells
from metric_base.arrays import BoolArray, FloatArray

#: Minimum number of points of the cloud that determine the depth at a position.
MIN_POINTS = 4
#: Maximum number of positions.
MAX_POSITIONS = 8
#: Minimum fraction of the views that see the object.
MIN_VIEW_FRACTION = 0.25
#: Minimum and maximum height of the object in an image, as a fraction of the height of the image: a smaller object is
#: not recognised, a larger one hides the scene.
APPARENT_HEIGHT_RANGE = (0.04, 0.7)
#: Minimum height in an image if no position has a larger one, or if the user names the object to stand on.
MIN_APPARENT_HEIGHT = 0.01
#: Height of the free space above a position, in heights of the object, if there is such a position.
FREE_HEIGHTS = 2.0
#: Maximum difference in height of two planes that are one surface, in cells of the plane.
MAX_DUPLICATE_CELLS = 0.6
#: Number of positions per surface.
POSITIONS_PER_SURFACE = 2
#: Minimum clearance of a position, as a fraction of the largest clearance on the surface.
MIN_CLEARANCE_FRACTION = 0.6
#: Maximum number of positions per surface whose visibility is tested.
MAX_TESTED = 30
#: Maximum number of points of the cloud for the visibility.
MAX_CLOUD_POINTS = 6000
#: Half the side of the square around a position in which points may occlude it, as a fraction of the image width.
OCCLUDER_REACH = 0.03
#: Maximum depth of an occluding point, as a fraction of the depth of the position.
MAX_OCCLUDER_DEPTH = 0.85
#: Maximum fraction of occluding points around a visible position.
MAX_OCCLUDING_FRACTION = 0.5


def free_positions(space: PlacementSpace, radius: float, height: float) -> list[Placement]:
    """Return free positions on all support planes, the best first: seen by most views, on the largest plane.

    Parameters
    ----------
    space : PlacementSpace
        The scene.
    radius : float
        Half the diagonal of the footprint of the object, in scene units.
    height : float
        Height of the object, in scene units.
    """
    scored: list[tuple[float, Placement]] = []
    for min_apparent in (APPARENT_HEIGHT_RANGE[0], MIN_APPARENT_HEIGHT):
        scored = scored or [
            item
            for surface in space.supports.surfaces
            for item in positions_on_surface(space, surface, radius, height, None, min_apparent)
        ]
    scored.sort(key=lambda item: -item[0])
    return [placement for _, placement in scored if not _is_on_duplicate(space, placement)][:MAX_POSITIONS]


def _is_on_duplicate(space: PlacementSpace, placement: Placement) -> bool:
    """Return True if a plane with more points covers this position at almost the same height.

    The plane of the position then is a duplicate, made of noise and clutter.
    """
    assert placement.plane is not None  # free positions are on planes
    surface = space.supports.surfaces[placement.plane]
    for other in space.supports.surfaces:
        difference = abs(other.plane.height - surface.plane.height)
        is_close = 0 < difference < MAX_DUPLICATE_CELLS * surface.plane.cell
        if not is_close or other.plane.points <= surface.plane.points:
            continue
        if other.contains((other.plane.basis[:2] @ placement.position)[None])[0]:
            return True
    return False


def positions_on_surface(
    space: PlacementSpace,
    surface: Surface,
    radius: float,
    height: float,
    mask: BoolArray | None = None,
    min_apparent: float = MIN_APPARENT_HEIGHT,
) -> list[tuple[float, Placement]]:
    """Return up to `POSITIONS_PER_SURFACE` free positions of a surface with their scores.

    The score is the fraction of the views that see the object, times the square root of the area of the surface.

    Parameters
    ----------
    radius, height : float
        Half the diagonal of the footprint, and height of the object, in scene units.
    mask : (a, b) ndarray of bool, optional
        Allowed cells of the surface.
    min_apparent : float
        Minimum height of the object in an image, as a fraction of the height of the image.
    """
    free = free_cells(surface, radius, FREE_HEIGHTS * height)  # not under a table
    if not free.any():
        free = free_cells(surface, radius, height)
    if mask is not None:
        free &= mask
    clearance = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    scored: list[tuple[float, Placement]] = []
    side = float(np.sqrt(surface.solid.sum())) * surface.cell
    for _ in range(POSITIONS_PER_SURFACE):
        if clearance.max() <= 0:
            break
        cells = np.argwhere(clearance > MIN_CLEARANCE_FRACTION * clearance.max())
        cells = cells[:: max(1, len(cells) // MAX_TESTED)]
        flat = surface.origin + (cells + 0.5) * surface.cell
        points = np.column_stack([flat, np.full(len(cells), surface.plane.height)]) @ surface.plane.basis
        fractions, cameras = _visibility(space, points, height, min_apparent)
        best = int(fractions.argmax())
        if fractions[best] >= MIN_VIEW_FRACTION:
            name = f"plane {surface.number}"
            placement = Placement(points[best], surface.plane.basis, cameras[best], name, surface.number)
            scored.append((float(fractions[best]) * side, placement))
        rows, columns = np.indices(clearance.shape)
        distance = np.hypot(rows - cells[best][0], columns - cells[best][1])
        clearance = np.where(distance > 3 * radius / surface.cell + 2, clearance, 0.0)
    return scored


def _visibility(
    space: PlacementSpace, points: FloatArray, height: float, min_apparent: float
) -> tuple[FloatArray, FloatArray]:
    """Return the fraction (k,) of the views that see an object at each point (k, 3), and the best camera (k, 3).

    The best camera has the object closest to the centre of its image.
    """
    up = space.supports.up.vector
    count = np.zeros(len(points))
    cameras = np.tile(space.views[0].centre, (len(points), 1))
    min_offset = np.full(len(points), np.inf)
    for view in space.views:
        foot, depth = pixels_in_view(view, points)
        top, _ = pixels_in_view(view, points + height * up)
        with np.errstate(invalid="ignore"):
            apparent = np.linalg.norm(top - foot, axis=1) / view.camera.height
            is_seen = np.isfinite(foot[:, 0]) & np.isfinite(top[:, 0]) & (depth > 0)
            is_seen &= (apparent > min_apparent) & (apparent < APPARENT_HEIGHT_RANGE[1])
            is_seen &= (view.centre - points) @ up > 0
            is_seen &= _is_unoccluded(space, view, points + 0.5 * height * up)
            centre = np.array([view.camera.width, view.camera.height]) / 2
            offset = np.linalg.norm((foot + top) / 2 - centre, axis=1)
        is_better = is_seen & (offset < min_offset)
        cameras[is_better], min_offset[is_better] = view.centre, offset[is_better]
        count += is_seen
    return count / len(space.views), cameras


def _is_unoccluded(space: PlacementSpace, view: View, points: FloatArray) -> BoolArray:
    """Return whether few points of the cloud are clearly in front of each point (k, 3) in a view."""
    step = max(1, len(space.cloud.points) // MAX_CLOUD_POINTS)
    pixels, depths = pixels_in_view(view, space.cloud.points[::step])
    inside = np.isfinite(pixels[:, 0])
    x, y, depths = pixels[inside, 0], pixels[inside, 1], depths[inside]
    centre, depth = pixels_in_view(view, points)
    reach = OCCLUDER_REACH * view.camera.width
    with np.errstate(invalid="ignore"):
        is_near = (np.abs(x - centre[:, :1]) < reach) & (np.abs(y - centre[:, 1:]) < reach)  # (k, n)
        is_in_front = is_near & (depths < MAX_OCCLUDER_DEPTH * depth[:, None])
    counts = is_near.sum(axis=1)
    return np.asarray((counts < MIN_POINTS) | (is_in_front.sum(axis=1) < MAX_OCCLUDING_FRACTION * counts))
