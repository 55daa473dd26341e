"""Objects at their places: from requests to bodies in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.records.scene import View
from insertion.insertion_scene import PreparedScene
from insertion.placement.at_pixel import level_point, place_at_point, place_on_plane, plane_point
from insertion.placement.free_space import Space, candidates
from insertion.placement.model_size import SizeUsed, model_size
from insertion.placement.on_category import instances_named, place_on_category
from insertion.placement.path import Walk, walk_along
from insertion.placement.placement import NoPlace, heading, turn_about
from insertion.render.body import Body, body_of, colliding
from insertion.request import ObjectRequest, Place
from insertion.scene.supports import Surface
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from models3d.animation_playback import Playback, select_playback
from models3d.gltf.model_reader import read_model
from models3d.model import Model

if TYPE_CHECKING:
    from metric_tree.tree import Tree

#: This share of the cloud's points inside the object's box is no stray.
TAKEN_SHARE = 3e-4


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """An object at its place, ready to be rendered.

    model, front, heading_deg, body : as it stands at first; front : (3,) horizontal unit direction of its front;
    surface : what it stands on, if its extent is known; act : how it moves by itself; walk : the way that it follows.
    """

    request: ObjectRequest
    model: Model
    size: SizeUsed
    place: Place
    front: FloatArray
    heading_deg: float
    body: Body
    surface: Surface | None = None
    warnings: tuple[str, ...] = ()
    act: Playback | None = None
    walk: Walk | None = None

    @property
    def moves(self) -> bool:
        """Whether the object is not the same at all times."""
        return self.walk is not None or (self.act is not None and self.act.animation is not None)

    def body_at(self, time_s: float) -> Body:
        """The object at a time from the first picture: `body` itself where it stands still."""
        if not self.moves or self.act is None:
            return self.body
        model, bounds = self.act.posed(time_s), self.act.bounds
        position, front = self.place.position, self.front
        if self.walk is not None:
            model = self.act.posed(min(time_s, self.walk.arrival_s))  # who has arrived stands
            position = self.walk.place(time_s)
            front = turn_about(self.walk.front(time_s), self.place.basis[2], self.heading_deg)
        unit = self.body.unit / float((bounds[1] - bounds[0]).max())
        return body_of(model, position, self.place.basis, front, unit, bounds)

    @property
    def size_m(self) -> dict[str, float]:
        """Length, width and height in metres as inserted."""
        return {name: value * self.size.factor for name, value in self.model.size_m.items()}

    @property
    def turn(self) -> FloatArray:
        """(3, 3) rotation of the model's axes into the scene."""
        up = self.place.basis[2]
        return np.column_stack([np.cross(up, self.front), up, self.front])


def place_objects(prepared: PreparedScene, requests: Sequence[ObjectRequest], tree: Tree | None = None) -> list[Placed]:
    """Every object at its place. Raises InputError, or NoPlace with the reason.

    An object in free space keeps clear of those before it; of another one that goes through them, it is a warning.
    """
    placed: list[Placed] = []
    for number, request in enumerate(requests, start=1):
        try:
            placed.append(_place_object(prepared, request, tree, placed))
        except NoPlace as error:
            if len(requests) == 1:
                raise
            raise NoPlace(f"object {number} ({request.model.name}): {error}") from None
    return placed


def resize(placed: Placed, times: float) -> Placed:
    """The same object grown about its foot."""
    size = replace(placed.size, factor=placed.size.factor * times)
    return replace(placed, size=size, body=replace(placed.body, unit=placed.body.unit * times))


def space_for(prepared: PreparedScene, model: Model, size: SizeUsed, extents: FloatArray | None = None) -> Space:
    """The scene as places for this model are sought in it; extents : (3,) of its reach, its own without."""
    units = size.factor / prepared.scale.metres_per_unit
    x, y, z = model.extents if extents is None else extents
    return Space(prepared.scene, prepared.cloud, prepared.supports, float(np.hypot(x, z)) / 2 * units, float(y) * units)


def _place_object(
    prepared: PreparedScene, request: ObjectRequest, tree: Tree | None, earlier: Sequence[Placed]
) -> Placed:
    act = select_playback(read_model(request.model), request.clip, request.at_time_s)
    size = model_size(act.model, request.size, tree, request.category)
    space = space_for(prepared, act.model, size, act.bounds_over_time[1] - act.bounds_over_time[0])
    options = [_standing(prepared, request, act, size, place) for place in _places(prepared, request, space, tree)]
    free = next((one for one in options if not any(colliding(one.body, other.body) for other in earlier)), None)
    if free is not None:
        return free
    chosen = options[0]
    model = act.model
    through = [other.model.name for other in earlier if colliding(chosen.body, other.body)]
    return replace(chosen, warnings=tuple(f"{model.name}: goes through {name}" for name in through))


def _standing(prepared: PreparedScene, request: ObjectRequest, act: Playback, size: SizeUsed, place: Place) -> Placed:
    surface = place.surface if place.plane is None else prepared.supports.surfaces[place.plane]
    walk = _walk(prepared, request, place) if request.path else None
    if walk is None:
        front, angle = heading(place, request.facing, prepared.cloud)
    else:
        angle = _path_turn(request)
        front = turn_about(walk.front(0.0), place.basis[2], angle)
    # metres divided by the scale, and nothing else
    body = body_of(
        act.model, place.position, place.basis, front, size.factor / prepared.scale.metres_per_unit, act.bounds
    )
    words = [*_taken(prepared, act.model, body), *_beside(walk, place, surface)]
    return Placed(request, act.model, size, place, front, angle, body, surface, tuple(words), act, walk)


def _path_turn(request: ObjectRequest) -> float:
    """Degrees from the way's direction to the object's front. Raises InputError for a wall."""
    if request.facing == "wall":
        raise InputError("--facing: expected degrees from the way of --path; found wall")
    return 0.0 if isinstance(request.facing, str) else float(request.facing)


def _walk(prepared: PreparedScene, request: ObjectRequest, place: Place) -> Walk:
    """The way from the object's place through the points of `--path`, level with the place."""
    if request.at is not None:
        view = _view_of(prepared, request.at.frame)
        corners = [level_point(place, view, x, y) for x, y in request.path]
    elif request.plane is not None:
        surface = prepared.supports.surfaces[request.plane]
        corners = [plane_point(surface, np.array(xy) / prepared.scale.metres_per_unit) for xy in request.path]
    else:
        raise InputError("--path: expected --at frame=...,x=...,y=... or --plane with it; found neither")
    shots = prepared.footage.shots
    lasting = shots[-1].clock_s - shots[0].clock_s
    return walk_along(np.array([place.position, *corners]), prepared.scale.metres_per_unit, request.speed_m_s, lasting)


def _beside(walk: Walk | None, place: Place, surface: Surface | None) -> tuple[str, ...]:
    """A warning where a way leaves what was seen of the surface."""
    if walk is None or surface is None or place.plane is None:
        return ()
    steps = np.array([walk.place(k / 20 * walk.arrival_s) for k in range(21)])
    outside = np.count_nonzero(~surface.holds(steps @ place.basis[:2].T))
    words = f"--path: {outside} of 21 places on the way are beside what was seen of {place.support}"
    return (words,) if outside else ()


def _places(prepared: PreparedScene, request: ObjectRequest, space: Space, tree: Tree | None) -> list[Place]:
    """The places that a request allows, the best first; the one that it names, or several in free space."""
    if request.at is not None:
        return [place_at_point(space, _view_of(prepared, request.at.frame), request.at.x, request.at.y)]
    if request.on is not None:
        return [place_on_category(space, request.on, instances_named(prepared.instances, request.on, tree))]
    if request.plane is not None:
        at = np.array(request.xy_m) / prepared.scale.metres_per_unit
        return [place_on_plane(space, request.plane, at, prepared.scene.views[0].centre)]
    options = candidates(space)
    if not options:
        how = "state --at frame=...,x=...,y=... or a smaller --size"
        raise NoPlace(f"--at auto: no free level space of this size that the camera sees long enough; {how}")
    return options


def _view_of(prepared: PreparedScene, frame: str) -> View:
    """The view of a shot by its name, its name without suffix, or its number."""
    shots = prepared.footage.shots
    chosen = next((s for s in shots if frame in (s.name, s.name.rsplit(".", 1)[0])), None)
    if chosen is None and frame.isdecimal() and int(frame) < len(shots):
        chosen = shots[int(frame)]
    if chosen is None:
        raise NoPlace(f"--at frame: expected a picture's name or a number from 0 to {len(shots) - 1}; found {frame!r}")
    if chosen.view is None:
        raise NoPlace(f"--at frame: expected a picture with a known pose; {chosen.name} has none")
    return chosen.view


def _taken(prepared: PreparedScene, model: Model, body: Body) -> tuple[str, ...]:
    """A warning where the cloud has points in the space of the object."""
    local = (prepared.cloud.points - body.position) @ body.basis.T / body.unit
    corners = body.corners @ body.basis.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    low[2] += 0.1 * (high[2] - low[2])
    share = np.mean(np.all((local > low + 0.05) & (local < high - 0.05), axis=1))
    return (f"{model.name}: something else is in its place",) if share > TAKEN_SHARE else ()
