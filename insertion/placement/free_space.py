"""Free space on the support surfaces: where an object fits, nothing is in its way, and cameras see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import Scene, View
from insertion.request import Place
from insertion.scene.point_cloud import Cloud
from insertion.scene.supports import Supports, Surface, free_cells
from metric_base.arrays import BoolArray, FloatArray

#: This many points of the cloud say what is somewhere.
NEAR_POINTS = 4
#: Candidates offered, and the share of the views that must see one.
MAX_CANDIDATES, SEEN_SHARE = 8, 0.25
#: An object smaller than this in the picture is not worth a place, larger hides the scene (share of the height).
APPARENT = (0.04, 0.7)
#: Where nothing is that large, or a person names the object to stand on, this is enough.
SMALLEST_APPARENT = 0.01
#: A free place has nothing above it up to so many heights of the object, if there is such a place.
OPEN_HEIGHTS = 2.0
#: Planes nearer than this share of a cell of theirs are one surface where both are.
PHANTOM_CELLS = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The scene as places are sought in it, and the object's radius and height in scene units."""

    scene: Scene
    cloud: Cloud
    supports: Supports
    radius: float
    height: float


def candidates(space: Space) -> list[Place]:
    """Free places on all planes, the best first: those that most views see, on the largest plane."""
    scored: list[tuple[float, Place]] = []
    for smallest in (APPARENT[0], SMALLEST_APPARENT):
        scored = scored or [item for one in space.supports.surfaces for item in free_places(space, one, None, smallest)]
    scored.sort(key=lambda item: -item[0])
    return [place for _, place in scored if not _on_phantom(space, place)][:MAX_CANDIDATES]


def _on_phantom(space: Space, place: Place) -> bool:
    """Whether a plane of more points is there, too, so near in height that both are one surface: noise and clutter."""
    assert place.plane is not None  # free space is on planes
    own = space.supports.surfaces[place.plane]
    for other in space.supports.surfaces:
        apart = abs(other.plane.height - own.plane.height)
        near = 0 < apart < PHANTOM_CELLS * own.plane.cell and other.plane.points > own.plane.points
        if near and other.holds((other.plane.basis[:2] @ place.position)[None])[0]:
            return True
    return False


def free_places(
    space: Space, surface: Surface, mask: BoolArray | None = None, smallest: float = SMALLEST_APPARENT
) -> list[tuple[float, Place]]:
    """Up to two free places of a surface, in the cells `mask` (r, c), scored by views that see it times root area.

    smallest : height of the object in a picture that counts as seen, as a share of the picture's.
    """
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
        shares, cameras = _visibility(space, points, smallest)
        best = int(shares.argmax())
        if shares[best] >= SEEN_SHARE:
            name = f"plane {surface.number}"
            place = Place(points[best], surface.plane.basis, cameras[best], name, surface.number)
            scored.append((float(shares[best]) * area, place))
        rows, columns = np.indices(room.shape)
        apart = np.hypot(rows - cells[best][0], columns - cells[best][1]) > 3 * space.radius / surface.cell + 2
        room = np.where(apart, room, 0.0)
    return scored


def _visibility(space: Space, points: FloatArray, smallest: float) -> tuple[FloatArray, FloatArray]:
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
            seen &= (apparent > smallest) & (apparent < APPARENT[1]) & ((view.centre - points) @ up > 0)
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
