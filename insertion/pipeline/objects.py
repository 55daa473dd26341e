"""Objects at their places: from requests to bodies in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimator.records.scene import View
from insertion.models.gltf import read_model
from insertion.models.model import Model
from insertion.models.size import Size, model_size
from insertion.pipeline.request import ObjectRequest
from insertion.pipeline.stage import Stage
from insertion.placement.free_space import Space, candidates
from insertion.placement.heading import heading
from insertion.placement.locate import place_at_point, place_on_plane
from insertion.placement.on_objects import instances_named, place_on_category
from insertion.placement.place import NoPlace, Place
from insertion.placement.surface import Surface
from insertion.render.body import Body, body_of, colliding
from metric_base.arrays import FloatArray

if TYPE_CHECKING:
    from metric_tree.tree import Tree

__all__ = ["Placed", "place_objects", "resize", "space_for"]

#: This share of the cloud's points inside the object's box is no stray.
TAKEN_SHARE = 3e-4


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """An object at its place, ready to be rendered.

    front : (3,) horizontal unit direction of its front; surface : what it stands on, if its extent is known.
    """

    request: ObjectRequest
    model: Model
    size: Size
    place: Place
    front: FloatArray
    heading_deg: float
    body: Body
    surface: Surface | None = None
    warnings: tuple[str, ...] = ()

    @property
    def size_m(self) -> dict[str, float]:
        """Length, width and height in metres as inserted."""
        return {name: value * self.size.factor for name, value in self.model.size_m.items()}

    @property
    def turn(self) -> FloatArray:
        """(3, 3) rotation of the model's axes into the scene."""
        up = self.place.basis[2]
        return np.column_stack([np.cross(up, self.front), up, self.front])


def place_objects(stage: Stage, requests: Sequence[ObjectRequest], tree: Tree | None = None) -> list[Placed]:
    """Every object at its place. Raises InputError, or NoPlace with the reason.

    An object in free space keeps clear of those before it; of another one that goes through them, it is a warning.
    """
    placed: list[Placed] = []
    for number, request in enumerate(requests, start=1):
        try:
            placed.append(_place_object(stage, request, tree, placed))
        except NoPlace as error:
            if len(requests) == 1:
                raise
            raise NoPlace(f"object {number} ({request.model.name}): {error}") from None
    return placed


def resize(placed: Placed, times: float) -> Placed:
    """The same object grown about its foot."""
    size = replace(placed.size, factor=placed.size.factor * times)
    return replace(placed, size=size, body=replace(placed.body, unit=placed.body.unit * times))


def space_for(stage: Stage, model: Model, size: Size) -> Space:
    """The scene as places for this model are sought in it."""
    units = size.factor / stage.scale.metres_per_unit
    radius = float(np.hypot(model.extents[0], model.extents[2])) / 2 * units
    return Space(stage.scene, stage.cloud, stage.supports, radius, float(model.extents[1]) * units)


def _place_object(stage: Stage, request: ObjectRequest, tree: Tree | None, earlier: Sequence[Placed]) -> Placed:
    model = read_model(request.model)
    size = model_size(model, request.size, tree, request.category)
    space = space_for(stage, model, size)
    options = [_standing(stage, request, model, size, place) for place in _places(stage, request, space, tree)]
    free = next((one for one in options if not any(colliding(one.body, other.body) for other in earlier)), None)
    if free is not None:
        return free
    chosen = options[0]
    through = [other.model.name for other in earlier if colliding(chosen.body, other.body)]
    return replace(chosen, warnings=tuple(f"{model.name}: goes through {name}" for name in through))


def _standing(stage: Stage, request: ObjectRequest, model: Model, size: Size, place: Place) -> Placed:
    front, angle = heading(place, request.facing, stage.cloud)
    # metres divided by the scale, and nothing else
    body = body_of(model, place.position, place.basis, front, size.factor / stage.scale.metres_per_unit)
    surface = place.surface if place.plane is None else stage.supports.surfaces[place.plane]
    return Placed(request, model, size, place, front, angle, body, surface, _taken(stage, model, body))


def _places(stage: Stage, request: ObjectRequest, space: Space, tree: Tree | None) -> list[Place]:
    """The places that a request allows, the best first; the one that it names, or several in free space."""
    if request.at is not None:
        return [place_at_point(space, _view_of(stage, request.at.frame), request.at.x, request.at.y)]
    if request.on is not None:
        return [place_on_category(space, request.on, instances_named(stage.instances, request.on, tree))]
    if request.plane is not None:
        at = np.array(request.xy_m) / stage.scale.metres_per_unit
        return [place_on_plane(space, request.plane, at, stage.scene.views[0].centre)]
    options = candidates(space)
    if not options:
        how = "state --at frame=...,x=...,y=... or a smaller --size"
        raise NoPlace(f"--at auto: no free level space of this size that the camera sees long enough; {how}")
    return options


def _view_of(stage: Stage, frame: str) -> View:
    """The view of a shot by its name, its name without suffix, or its number."""
    shots = stage.footage.shots
    chosen = next((s for s in shots if frame in (s.name, s.name.rsplit(".", 1)[0])), None)
    if chosen is None and frame.isdecimal() and int(frame) < len(shots):
        chosen = shots[int(frame)]
    if chosen is None:
        raise NoPlace(f"--at frame: expected a picture's name or a number from 0 to {len(shots) - 1}; found {frame!r}")
    if chosen.view is None:
        raise NoPlace(f"--at frame: expected a picture with a known pose; {chosen.name} has none")
    return chosen.view


def _taken(stage: Stage, model: Model, body: Body) -> tuple[str, ...]:
    """A warning where the cloud has points in the space of the object."""
    local = (stage.cloud.points - body.position) @ body.basis.T / body.unit
    corners = body.corners @ body.basis.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    low[2] += 0.1 * (high[2] - low[2])
    share = np.mean(np.all((local > low + 0.05) & (local < high - 0.05), axis=1))
    return (f"{model.name}: something else is in its place",) if share > TAKEN_SHARE else ()
