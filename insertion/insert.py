"""Objects into footage: the public path from requests to pictures and results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.composite.compose import compose
from insertion.composite.ghost import draw_interval
from insertion.composite.match import Looks
from insertion.light.estimate import environment_at
from insertion.models.gltf import read_model
from insertion.models.model import Model
from insertion.models.size import Size, model_size
from insertion.places.heading import heading
from insertion.places.locate import Space, candidates, place_at_point, place_on_category, place_on_plane
from insertion.places.place import NoPlace, Place
from insertion.render.body import Body, body_of
from insertion.render.context import gl_context
from insertion.render.renderer import ObjectRenderer
from insertion.request import ObjectRequest
from insertion.result import FrameReport, InsertionResult
from insertion.scene.cloud import front_points
from insertion.scene.footage import Shot
from insertion.stage import Stage
from metric_base.arrays import FloatArray

if TYPE_CHECKING:
    from metric_tree.tree import Tree

__all__ = ["LayerSink", "Placed", "insert_objects", "place_objects", "space_for"]

#: This share of the cloud's points inside the object's box is no stray.
TAKEN_SHARE = 3e-4
Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]


class LayerSink(Protocol):
    """Takes what an insertion is made of, frame by frame."""

    def picture(self, shot: Shot, picture: Picture) -> None:
        """The frame without objects."""

    def layers(self, shot: Shot, number: int, alpha: NDArray[np.float32], depth: NDArray[np.float32]) -> None:
        """Visible coverage (h, w) and depth (h, w) of one object."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """An object at its place, ready to be rendered; front : (3,) horizontal unit direction of its front."""

    request: ObjectRequest
    model: Model
    size: Size
    place: Place
    front: FloatArray
    heading_deg: float
    body: Body

    @property
    def size_m(self) -> dict[str, float]:
        """Length, width and height in metres as inserted."""
        return {name: value * self.size.factor for name, value in self.model.size_m.items()}

    @property
    def turn(self) -> FloatArray:
        """(3, 3) rotation of the model's axes into the scene."""
        up = self.place.basis[2]
        return np.column_stack([np.cross(up, self.front), up, self.front])


@dataclass(slots=True, eq=False)
class _Running:
    """An object during the run over the frames."""

    placed: Placed
    renderer: ObjectRenderer
    frames: list[FrameReport] = field(default_factory=list)


def place_objects(stage: Stage, requests: Sequence[ObjectRequest], tree: Tree | None = None) -> list[Placed]:
    """Every object at its place. Raises InputFault, or NoPlace with the reason."""
    return [_placed(stage, request, tree) for request in requests]


def insert_objects(
    stage: Stage,
    objects: Sequence[Placed],
    write: Writer,
    *,
    show_interval: bool = False,
    film: bool = False,
    layers: LayerSink | None = None,
) -> list[InsertionResult]:
    """Draw the objects into every picture of the footage and hand each to `write`, one at a time.

    film : the pictures are one film, whose exposure and blur change slowly. Frames without a pose stay as they are.
    layers : takes each frame as it was, and the coverage and depth of each object in it.
    """
    seconds = {"light": 0.0, "render": 0.0, "encode": 0.0}
    started = time.perf_counter()
    context = gl_context()
    running = [_Running(item, _renderer(context, stage, item)) for item in objects]
    seconds["light"] = time.perf_counter() - started
    looks = Looks(smooth=film)
    for shot, picture in stage.footage.pictures():
        started = time.perf_counter()
        if layers is not None:
            layers.picture(shot, picture)
        out = _drawn(stage, running, shot, picture, looks, show_interval, layers)
        rendered = time.perf_counter()
        write(shot, out)
        seconds["render"] += rendered - started
        seconds["encode"] += time.perf_counter() - rendered
    context.release()
    return [_result(stage, item, seconds) for item in running]


def space_for(stage: Stage, model: Model, size: Size) -> Space:
    """The scene as places for this model are sought in it."""
    units = size.factor / stage.scale.metres_per_unit
    radius = float(np.hypot(model.extents[0], model.extents[2])) / 2 * units
    return Space(stage.scene, stage.cloud, stage.supports, radius, float(model.extents[1]) * units)


def _placed(stage: Stage, request: ObjectRequest, tree: Tree | None) -> Placed:
    model = read_model(request.model)
    size = model_size(model, request.size, tree, request.category)
    place = _place(stage, request, space_for(stage, model, size))
    front, angle = heading(place, request.facing, stage.cloud)
    # metres divided by the scale, and nothing else
    body = body_of(model, place.position, place.basis, front, size.factor / stage.scale.metres_per_unit)
    return Placed(request, model, size, place, front, angle, body)


def _place(stage: Stage, request: ObjectRequest, space: Space) -> Place:
    if request.at is not None:
        return place_at_point(space, _view_of(stage, request.at.frame), request.at.x, request.at.y)
    if request.on is not None:
        return place_on_category(space, request.on, stage.instances)
    if request.plane is not None:
        at = np.array(request.xy_m) / stage.scale.metres_per_unit
        return place_on_plane(space, request.plane, at, stage.scene.views[0].centre)
    options = candidates(space)
    if not options:
        how = "state --at frame=...,x=...,y=... or a smaller --size"
        raise NoPlace(f"--at auto: no free level space of this size that the camera sees long enough; {how}")
    return options[0]


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


def _renderer(context: Any, stage: Stage, item: Placed) -> ObjectRenderer:
    height = float(item.model.extents[1]) * item.size.factor / stage.scale.metres_per_unit
    return ObjectRenderer(context, item.body, environment_at(item.place, height, stage.cloud, stage.stills))


def _drawn(
    stage: Stage,
    running: Sequence[_Running],
    shot: Shot,
    picture: Picture,
    looks: Looks,
    show_interval: bool,
    layers: LayerSink | None,
) -> Picture:
    """The picture with all objects, the farthest first."""
    view = shot.view
    if view is None:
        for item in running:
            item.frames.append(FrameReport(shot.name, shot.time_s, None, 0.0))
        return picture
    front = front_points(view, stage.cloud, shot.row)
    look = looks.next(picture, front, stage.cloud)
    masks = stage.masks(shot)
    order = sorted(running, key=lambda item: -float(np.linalg.norm(view.centre - item.placed.body.position)))
    for number, item in enumerate(order):
        number_of_plane = item.placed.place.plane
        plane = None if number_of_plane is None else stage.supports.surfaces[number_of_plane]
        seed = shot.index * 16 + number
        composed = compose(picture, view, item.renderer, stage.cloud, front, masks, plane, look, seed)
        picture = composed.picture
        item.frames.append(FrameReport(shot.name, shot.time_s, composed.silhouette, composed.visible))
        if layers is not None:
            layers.layers(shot, running.index(item), *composed.whole())
        if show_interval:
            picture = draw_interval(picture, view, item.renderer, stage.scale)
    return picture


def _taken(stage: Stage, placed: Placed) -> list[str]:
    """A warning where the cloud has things in the space of the object."""
    local = (stage.cloud.points - placed.body.position) @ placed.body.basis.T / placed.body.unit
    corners = placed.body.corners @ placed.body.basis.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    low[2] += 0.1 * (high[2] - low[2])
    share = np.mean(np.all((local > low + 0.05) & (local < high - 0.05), axis=1))
    return [f"{placed.model.name}: something else is in its place"] if share > TAKEN_SHARE else []


def _result(stage: Stage, item: _Running, seconds: dict[str, float]) -> InsertionResult:
    placed = item.placed
    unposed = sum(shot.view is None for shot in stage.footage.shots)
    warnings = [*placed.model.warnings, *placed.size.warnings, *_taken(stage, placed)]
    if unposed:
        warnings.append(f"{unposed} frame(s) have no known pose and are left as they are")
    return InsertionResult(
        placed.model.name,
        stage.scale,
        placed.size_m,
        placed.place.position,
        placed.place.basis[2],
        placed.heading_deg,
        placed.place.support,
        tuple(item.frames),
        seconds,
        tuple(warnings),
    )
