"""Content of a frame besides the objects: masks of possible occluders, moving objects and visible points.

Frames without annotation take the masks of the nearest annotated view. The points of an object give its inverse depth
as a plane over its mask, 1 / z = a + b u + c v, which is exact for flat objects and accurate for others if the camera
moves little. The outline is transformed into the new frame through this depth.

Moving people and objects are not in the reconstruction. Their depth is estimated from the lowest pixels of their masks,
which stand on the ground: the object is a vertical plane (billboard) at this position that faces the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import pixels_in_view, project, view_rays
from estimator.records.objects import SupportPlane
from estimator.records.scene import Instance, Scene, View
from insertion.footage.footage import Frame
from insertion.scene.camera_rays import camera_rays, ray_through
from insertion.scene.pixel_box import PixelBox, mask_in_box, pixels_in_mask
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints, visible_points
from insertion.scene.supports import SupportSurfaces
from metric_base.arrays import BoolArray, FloatArray, grouped

#: Minimum number of points for the depth of an object.
MIN_POINTS = 6
#: Maximum relative difference of a point's inverse depth from the median; others are seen through the mask.
MAX_DEPTH_DIFFERENCE = 0.3
#: Maximum angle between the optical axes of two views, in degrees, for the propagation of masks. Beyond it, and beyond
#: `MAX_STEP`, an object shows another side.
MAX_TURN_DEG = 25.0
#: Maximum distance between two views as a fraction of the median depth.
MAX_STEP = 0.35
#: Height of the feet as a fraction of the height of a mask.
FEET_FRACTION = 0.04
#: Minimum sine of the angle between a ray and the ground: flatter rays do not determine a distance.
MIN_GROUND_SINE = 0.01


class MaskPropagator:
    """Masks of any view of a scene with some annotated views.

    Parameters
    ----------
    scene : Scene
        The reconstruction.
    by_view : mapping of int to sequence of Instance
        Masks of the annotated views, by index.
    cloud : ColouredPoints
        Points of the scene.
    """

    def __init__(self, scene: Scene, by_view: Mapping[int, Sequence[Instance]], cloud: ColouredPoints) -> None:
        self._scene, self._by_view, self._cloud = scene, by_view, cloud
        self._depth_planes: dict[int, list[FloatArray | None]] = {}
        self._median_depth = 1.0
        if len(scene.views) and len(cloud.points):
            depths = visible_points(scene.views[len(scene.views) // 2], cloud).depths
            self._median_depth = float(np.median(depths)) if len(depths) else 1.0

    def masks(self, row: int | None, view: View) -> Sequence[Instance]:
        """Return the masks of a view: its own, or those of the nearest annotated view, propagated.

        Parameters
        ----------
        row : int or None
            Index of the view in the scene, if it is a view of the reconstruction.
        """
        if row is not None and row in self._by_view:
            return self._by_view[row]
        source, min_cost = None, 1.0
        for annotated in self._by_view:
            other = self._scene.views[annotated]
            turn = np.degrees(np.arccos(np.clip(float(other.rotation[2] @ view.rotation[2]), -1, 1)))
            step = float(np.linalg.norm(other.centre - view.centre)) / self._median_depth
            cost = max(turn / MAX_TURN_DEG, step / MAX_STEP)
            if cost < min_cost:
                source, min_cost = annotated, cost
        if source is None:
            return ()
        if source not in self._depth_planes:
            annotated_view = self._scene.views[source]
            points = visible_points(annotated_view, self._cloud)
            flat = view_rays(annotated_view.camera, points.pixels)[:, :2]
            self._depth_planes[source] = [inverse_depth_plane(item, points, flat) for item in self._by_view[source]]
        propagated = [
            propagate_mask(item, self._scene.views[source], view, plane)
            for item, plane in zip(self._by_view[source], self._depth_planes[source], strict=True)
            if plane is not None
        ]
        return [item for item in propagated if item is not None]


def inverse_depth_plane(item: Instance, points: VisiblePoints, flat: FloatArray) -> FloatArray | None:
    """Fit the inverse depth of an object as a plane over normalised pixels, 1 / z = a + b u + c v.

    Parameters
    ----------
    item : Instance
        Mask of the object.
    points : VisiblePoints
        Visible points of its view.
    flat : (m, 2) ndarray of float
        Normalised pixels of the points.

    Returns
    -------
    (3,) ndarray of float, or None
        a, b and c; None if the mask contains too few points.
    """
    rows = np.flatnonzero(pixels_in_mask(item, points.pixels))
    if len(rows) < MIN_POINTS:
        return None
    inverse = 1 / points.depths[rows]
    median = np.median(inverse)
    inliers = rows[np.abs(inverse - median) < MAX_DEPTH_DIFFERENCE * median]
    if len(inliers) < MIN_POINTS:
        return np.array([median, 0.0, 0.0])
    centre = flat[inliers].mean(axis=0)
    system = np.column_stack([np.ones(len(inliers)), flat[inliers] - centre])
    # the few points of a small object do not determine a slope
    ridge = np.diag([0.0, 1.0, 1.0]) * 1e-3 * len(inliers)
    a, b, c = np.linalg.solve(system.T @ system + ridge, system.T @ (1 / points.depths[inliers]))
    return np.array([a - b * centre[0] - c * centre[1], b, c])


def propagate_mask(item: Instance, source: View, view: View, plane: FloatArray) -> Instance | None:
    """Transform a mask into another view.

    Parameters
    ----------
    item : Instance
        Mask in the view `source`.
    plane : (3,) ndarray of float
        Plane of inverse depth of the object.

    Returns
    -------
    Instance or None
        None if a part of the outline is behind the camera, or the mask is out of the image.
    """
    import cv2

    outlines, _ = cv2.findContours(item.mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    moved = []
    for outline in outlines:
        corners = np.asarray(outline[:, 0] + np.array(item.origin) + 0.5, dtype=np.float64)
        rays = view_rays(source.camera, corners)
        inverse = plane[0] + rays[:, :2] @ plane[1:]
        if (inverse <= 0).any():
            return None
        scene = (rays / inverse[:, None] - source.translation) @ source.rotation
        pixels = project(view.camera, view.to_camera(scene))
        if not np.isfinite(pixels).all():
            return None
        moved.append(pixels)
    if not moved:
        return None
    corners = np.concatenate(moved)
    size = np.array([view.camera.width, view.camera.height])
    low = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)) + 1, 0, size).astype(int)
    if (high - low < 2).any():
        return None
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    cv2.fillPoly(mask, [np.rint((outline - low - 0.5) * 16).astype(np.int32) for outline in moved], 1, shift=4)
    return replace(item, mask=mask.astype(bool), origin=(int(low[0]), int(low[1])))


@dataclass(frozen=True, slots=True, eq=False)
class Billboard:
    """A moving object in one frame, as a plane: its depth is offset / (direction . ray)."""

    item: Instance
    direction: FloatArray  #: (3,) horizontal unit normal in camera axes
    offset: float  #: distance of the plane from the camera, scene units

    def occludes(self, box: PixelBox, view: View, depth: NDArray[np.float32]) -> BoolArray:
        """Return the pixels (h, w) of a box in which the object is closer than `depth` (h, w)."""
        mask = mask_in_box(self.item, box)
        if mask is None:
            return np.zeros(box.shape, dtype=bool)
        rays = camera_rays(view.camera)[box.slices]
        along = rays[..., 0] * self.direction[0] + rays[..., 1] * self.direction[1] + self.direction[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(mask & (along > 0) & (self.offset / along < depth))


def billboards(items: Sequence[Instance], view: View, ground: SupportPlane) -> list[Billboard]:
    """Return the billboards of moving objects in a view. Objects whose feet are above the horizon are omitted."""
    result = []
    up = ground.basis[2]
    for item in items:
        rows = np.flatnonzero(item.mask.any(axis=1))
        if not len(rows):
            continue
        bottom = int(rows[-1])
        height = max(1, round(FEET_FRACTION * (bottom - int(rows[0]) + 1)))
        columns = np.nonzero(item.mask[max(bottom - height + 1, 0) : bottom + 1])[1]
        x, y = item.origin[0] + float(np.median(columns)) + 0.5, item.origin[1] + bottom + 1.0
        ray = ray_through(view, x, y)
        rise = float(ray @ up)
        if rise > -MIN_GROUND_SINE * float(np.linalg.norm(ray)):
            continue
        depth = (ground.height - float(view.centre @ up)) / rise
        if depth <= 0:
            continue
        level = ray - rise * up
        normal = view.rotation @ (level / max(float(np.linalg.norm(level)), 1e-12))
        foot = depth * (view.rotation @ ray)
        result.append(Billboard(item, normal, float(foot @ normal)))
    return result


def moving_masks(file: Path, scene: Scene, frames: Sequence[Frame]) -> Mapping[int, tuple[Instance, ...]]:
    """Read the masks of moving objects, by the index of the frame.

    Raises
    ------
    InputError
        The file cannot be read, or names no frame of the footage.
    """
    from estimator.instances.instance_reader import read_instances

    posed = [frame for frame in frames if frame.view is not None]
    views = tuple(replace(frame.view, name=frame.name) for frame in posed if frame.view is not None)
    items = read_instances(file, replace(scene, views=views))
    masks = grouped((posed[item.view].index, item) for item in items)
    return {index: tuple(items) for index, items in masks.items()}


def static_cloud(
    cloud: ColouredPoints, moving: Mapping[int, Sequence[Instance]], frames: Sequence[Frame]
) -> ColouredPoints:
    """Return the points that are not on moving objects; the positions of those are wrong.

    A point is removed if more than half of the frames that have masks, and in whose image it is, have it in a mask.
    """
    masked, shown = np.zeros(len(cloud.points), np.int64), np.zeros(len(cloud.points), np.int64)
    for frame in frames:
        if frame.view is None or not moving.get(frame.index):
            continue
        pixels = pixels_in_view(frame.view, cloud.points)[0]
        in_image = np.isfinite(pixels).all(axis=1)
        shown += in_image
        masked[in_image] += _in_masks(pixels[in_image], moving[frame.index])
    return cloud.subset(2 * masked <= shown)


def static_points(points: VisiblePoints, items: Sequence[Instance]) -> VisiblePoints:
    """Return the visible points that are in none of the masks of moving objects."""
    free = ~_in_masks(points.pixels, items)
    return points if free.all() else points.subset(free)


def _in_masks(pixels: FloatArray, items: Sequence[Instance]) -> BoolArray:
    """Return which of the pixels (n, 2) are in at least one mask."""
    inside = np.zeros(len(pixels), dtype=bool)
    for item in items:
        inside |= pixels_in_mask(item, pixels)
    return inside


@dataclass(frozen=True, slots=True, eq=False)
class VisibleFrame:
    """What a frame shows besides the inserted objects."""

    points: VisiblePoints  #: points of the cloud that are not behind moving objects
    masks: Sequence[Instance]  #: masks of static objects
    moving: Sequence[Instance]  #: masks of moving objects
    billboards: Sequence[Billboard]  #: moving objects of known depth


@dataclass(frozen=True, slots=True, eq=False)
class FrameContent:
    """Points and masks of the scene, for any frame with a pose."""

    scene: Scene
    cloud: ColouredPoints  #: static points
    supports: SupportSurfaces
    propagator: MaskPropagator
    moving: Mapping[int, tuple[Instance, ...]] = field(default_factory=dict)  #: masks by the index of the frame

    def at(self, frame: Frame) -> VisibleFrame:
        """Return the content of a frame, whose pose is known."""
        view, row = frame.view, frame.row
        assert view is not None
        moving = self.moving.get(frame.index, ())
        points = static_points(visible_points(view, self.cloud, row), moving)
        # the frames of a video may be larger than those that were reconstructed
        is_same_size = row is not None and self.scene.views[row].camera.width == view.camera.width
        masks = self.propagator.masks(row if is_same_size else None, view)
        ground = self.supports.ground(self.cloud) if moving else None
        return VisibleFrame(points, masks, moving, [] if ground is None else billboards(moving, view, ground.plane))
