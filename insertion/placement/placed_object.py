"""Objects in the scene: from requests to models with size, position, orientation and motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.records.scene import View
from insertion.footage.footage import Frame
from insertion.placement.at_pixel import level_point, placement_at_pixel, placement_on_plane, plane_point
from insertion.placement.free_space import free_positions
from insertion.placement.model_size import ModelSize, model_size
from insertion.placement.on_category import instances_named, placement_on_category
from insertion.placement.path import PathMotion, path_motion
from insertion.placement.placement import Placement, PlacementError, PlacementSpace, heading, turn_about
from insertion.render.body import Body, body_of, colliding
from insertion.request import ObjectRequest
from insertion.scene.supports import Surface
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from models3d.animation_playback import Playback, select_playback
from models3d.gltf.model_reader import read_model
from models3d.model import Model

if TYPE_CHECKING:
    from metric_tree.tree import Tree

#: Maximum fraction of the points of the cloud inside an object without a warning: stray points.
MAX_COLLIDING_FRACTION = 3e-4
#: Height above the foot that is not tested for collisions, as a fraction of the height of the object: the support.
FOOT_FRACTION = 0.1
#: Distance from the bounding box that is not tested for collisions, as a fraction of the largest extent.
COLLISION_MARGIN = 0.05
#: Number of positions on a path that are tested against the extent of the surface.
PATH_SAMPLES = 21


@dataclass(frozen=True, slots=True, eq=False)
class PlacedObject:
    """An object at its position, ready to be rendered. Model, front and body are those of the first frame."""

    request: ObjectRequest
    model: Model
    size: ModelSize
    placement: Placement
    front: FloatArray  #: (3,) horizontal unit direction of the front
    heading_deg: float  #: angle of the front, from the direction to the camera or from the path
    body: Body
    metres_per_unit: float
    surface: Surface | None = None  #: extent of the support, if it is known
    warnings: tuple[str, ...] = ()
    playback: Playback | None = None  #: animation of the model
    path: PathMotion | None = None

    @property
    def moves(self) -> bool:
        """Whether the object changes with time."""
        return self.path is not None or (self.playback is not None and self.playback.animation is not None)

    @property
    def height(self) -> float:
        """Height in scene units."""
        return float(self.model.extents[1]) * self.size.factor / self.metres_per_unit

    @property
    def size_m(self) -> dict[str, float]:
        """Length, width and height in metres."""
        return {name: value * self.size.factor for name, value in self.model.size_m.items()}

    @property
    def turn(self) -> FloatArray:
        """(3, 3) rotation from the axes of the model to the scene."""
        up = self.placement.basis[2]
        return np.column_stack([np.cross(up, self.front), up, self.front])

    def body_at(self, time_s: float) -> Body:
        """Return the body `time_s` seconds after the first frame; `body` itself if the object does not move."""
        if not self.moves or self.playback is None:
            return self.body
        model, bounds = self.playback.posed(time_s), self.playback.bounds
        position, front = self.placement.position, self.front
        if self.path is not None:
            # the animation begins with the path and ends on arrival
            model = self.playback.posed(min(max(time_s, self.path.start_s), self.path.arrival_s) - self.path.start_s)
            position = self.path.position(time_s)
            front = turn_about(self.path.front(time_s), self.placement.basis[2], self.heading_deg)
        unit = self.body.unit / float((bounds[1] - bounds[0]).max())
        return body_of(model, position, self.placement.basis, front, unit, bounds)


def place_objects(
    requests: Sequence[ObjectRequest], space: PlacementSpace, frames: Sequence[Frame], tree: Tree | None = None
) -> list[PlacedObject]:
    """Place objects in a scene, one after another.

    Objects in free space avoid the earlier ones. If an object collides with an earlier one, it has a warning.

    Parameters
    ----------
    requests : sequence of ObjectRequest
        The objects.
    space : PlacementSpace
        The scene.
    frames : sequence of Frame
        Frames of the complete footage, for positions in a frame and for the duration of a path.
    tree : Tree, optional
        Release for sizes by the prior and for categories.

    Raises
    ------
    InputError
        A model cannot be read, or a request is invalid.
    PlacementError
        There is no position for an object.
    """
    placed: list[PlacedObject] = []
    for number, request in enumerate(requests, start=1):
        try:
            placed.append(_place_object(request, space, frames, tree, placed))
        except PlacementError as error:
            if len(requests) == 1:
                raise
            raise PlacementError(f"object {number} ({request.model.name}): {error}") from None
    return placed


def footprint(
    model: Model, size: ModelSize, metres_per_unit: float, extents: FloatArray | None = None
) -> tuple[float, float]:
    """Return half the diagonal of the footprint of a model and its height, in scene units.

    Parameters
    ----------
    extents : (3,) ndarray of float, optional
        Extents of all poses of an animation, in metres of the file; those of the model by default.
    """
    units = size.factor / metres_per_unit
    x, y, z = model.extents if extents is None else extents
    return float(np.hypot(x, z)) / 2 * units, float(y) * units


def _place_object(
    request: ObjectRequest,
    space: PlacementSpace,
    frames: Sequence[Frame],
    tree: Tree | None,
    earlier: Sequence[PlacedObject],
) -> PlacedObject:
    """Return the first option of an object that collides with no earlier one, else the best option with a warning."""
    playback = select_playback(read_model(request.model), request.clip, request.at_time_s)
    size = model_size(playback.model, request.size, tree, request.category)
    extents = playback.bounds_over_time[1] - playback.bounds_over_time[0]
    radius, height = footprint(playback.model, size, space.metres_per_unit, extents)
    if request.at is not None:
        view = _view_of(frames, request.at.frame)
        placements = [placement_at_pixel(space, view, request.at.x, request.at.y, radius)]
    elif request.on is not None:
        named = instances_named(space.instances, request.on, tree)
        placements = [placement_on_category(space, request.on, named, radius, height)]
    elif request.plane is not None:
        offset = np.array(request.xy_m) / space.metres_per_unit
        placements = [placement_on_plane(space, request.plane, offset, space.views[0].centre)]
    else:
        placements = free_positions(space, radius, height)
        if not placements:
            how = "specify --at frame=...,x=...,y=... or a smaller --size"
            raise PlacementError(f"--at auto: no free level space of this size that the camera sees long enough; {how}")
    options = [_stand(request, playback, size, placement, space, frames) for placement in placements]
    for option in options:
        if not any(colliding(option.body, other.body) for other in earlier):
            return option
    best, name = options[0], playback.model.name
    others = [other.model.name for other in earlier if colliding(best.body, other.body)]
    return replace(best, warnings=tuple(f"{name}: intersects {other}" for other in others))


def _stand(
    request: ObjectRequest,
    playback: Playback,
    size: ModelSize,
    placement: Placement,
    space: PlacementSpace,
    frames: Sequence[Frame],
) -> PlacedObject:
    """Return an object at a placement, with its orientation or path."""
    surface = placement.surface if placement.plane is None else space.supports.surfaces[placement.plane]
    path = _path_of(request, placement, space, frames) if request.path else None
    if path is None:
        front, angle = heading(placement, request.facing, space.cloud)
    else:
        if request.facing == "wall":
            raise InputError("--facing: expected degrees from the direction of --path; found wall")
        angle = 0.0 if isinstance(request.facing, str) else float(request.facing)
        front = turn_about(path.front(0.0), placement.basis[2], angle)
    # metres divided by the scale, and nothing else
    units_per_metre = size.factor / space.metres_per_unit
    model, bounds = playback.model, playback.bounds
    body = body_of(model, placement.position, placement.basis, front, units_per_metre, bounds)

    warnings = []
    local = (space.cloud.points - body.position) @ body.basis.T / body.unit
    corners = body.corners @ body.basis.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    low[2] += FOOT_FRACTION * (high[2] - low[2])
    is_inside = np.all((local > low + COLLISION_MARGIN) & (local < high - COLLISION_MARGIN), axis=1)
    if np.mean(is_inside) > MAX_COLLIDING_FRACTION:
        warnings.append(f"{model.name}: intersects points of the scene")
    if path is not None and surface is not None and placement.plane is not None:
        times = [k / (PATH_SAMPLES - 1) * path.arrival_s for k in range(PATH_SAMPLES)]
        positions = np.array([path.position(time_s) for time_s in times])
        outside = np.count_nonzero(~surface.contains(positions @ placement.basis[:2].T))
        if outside:
            where = f"outside the observed part of {placement.support}"
            warnings.append(f"--path: {outside} of {PATH_SAMPLES} sample points are {where}")
    return PlacedObject(
        request,
        model,
        size,
        placement,
        front,
        angle,
        body,
        space.metres_per_unit,
        surface,
        tuple(warnings),
        playback,
        path,
    )


def _path_of(
    request: ObjectRequest, placement: Placement, space: PlacementSpace, frames: Sequence[Frame]
) -> PathMotion:
    """Return the path from the position of an object through the requested corners, at the height of the position."""
    if request.at is not None:
        view = _view_of(frames, request.at.frame)
        corners = [level_point(placement, view, x, y) for x, y in request.path]
    elif request.plane is not None:
        surface = space.supports.surfaces[request.plane]
        corners = [plane_point(surface, np.array(xy) / space.metres_per_unit) for xy in request.path]
    else:
        raise InputError("--path: expected --at frame=...,x=...,y=... or --plane with it; found neither")
    duration_s = frames[-1].clock_s - frames[0].clock_s
    ends = np.array([placement.position, *corners])
    return path_motion(ends, space.metres_per_unit, request.speed_m_s, duration_s, request.path_start_s)


def _view_of(frames: Sequence[Frame], name: str) -> View:
    """Return the view of a frame by its name, its name without suffix, or its index."""
    chosen = next((frame for frame in frames if name in (frame.name, frame.name.rsplit(".", 1)[0])), None)
    if chosen is None and name.isdecimal() and int(name) < len(frames):
        chosen = frames[int(name)]
    if chosen is None:
        last = len(frames) - 1
        raise PlacementError(f"--at frame: expected the name of a frame or an index from 0 to {last}; found {name!r}")
    if chosen.view is None:
        raise PlacementError(f"--at frame: expected a frame with a known pose; {chosen.name} has none")
    return chosen.view
