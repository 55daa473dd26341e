"""Objects into footage: the public path from requests to pictures and results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.composite.compose import Composed, compose, compose_traced
from insertion.composite.match import Look, Looks
from insertion.footage.footage import Shot
from insertion.light.environment import Environment
from insertion.light.estimate import environment_at
from insertion.models.gltf import read_model
from insertion.models.model import Model
from insertion.models.size import Size, model_size
from insertion.pipeline.request import ObjectRequest
from insertion.pipeline.result import FrameReport, InsertionResult
from insertion.pipeline.stage import Stage
from insertion.placement.free_space import Space, candidates
from insertion.placement.heading import heading
from insertion.placement.locate import place_at_point, place_on_plane
from insertion.placement.on_objects import instances_named, place_on_category
from insertion.placement.place import NoPlace, Place
from insertion.render.body import Body, body_of
from insertion.render.context import gl_context
from insertion.render.layers import draw_interval
from insertion.render.renderer import ObjectRenderer
from insertion.scene.cloud import FrontPoints, front_points
from metric_base.arrays import FloatArray
from metric_base.progress import progress

if TYPE_CHECKING:
    from metric_tree.tree import Tree

__all__ = ["LayerSink", "Placed", "insert_objects", "place_objects", "resize", "single_picture", "space_for"]

#: This share of the cloud's points inside the object's box is no stray.
TAKEN_SHARE = 3e-4
Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]


class LayerSink(Protocol):
    """Takes what an insertion is made of, frame by frame."""

    def picture(self, shot: Shot, picture: Picture) -> None:
        """Take the frame without objects, (h, w, 3)."""

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


#: The light on the support is taken from the middle of the lowest tenth of the object.
GROUND = 0.1
#: Opens another renderer: from a shot to its (h, w, 4) layer of linear light.
Tracer = Callable[[Stage, Sequence[Placed], Environment], AbstractContextManager[Callable[[Shot], NDArray[np.float32]]]]


@dataclass(slots=True, eq=False)
class _Running:
    """An object during the run over the frames."""

    placed: Placed
    renderer: ObjectRenderer
    frames: list[FrameReport] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """What stays the same over the frames."""

    stage: Stage
    objects: list[_Running]
    looks: Looks
    show_interval: bool
    layers: LayerSink | None
    traced: Callable[[Shot], NDArray[np.float32]] | None


def place_objects(stage: Stage, requests: Sequence[ObjectRequest], tree: Tree | None = None) -> list[Placed]:
    """Every object at its place. Raises InputError, or NoPlace with the reason."""
    return [_place_object(stage, request, tree) for request in requests]


def insert_objects(
    stage: Stage,
    objects: Sequence[Placed],
    write: Writer,
    *,
    show_interval: bool = False,
    video: bool = False,
    layers: LayerSink | None = None,
    tracer: Tracer | None = None,
) -> list[InsertionResult]:
    """Draw the objects into every picture of the footage and hand each to `write`, one at a time.

    video : the pictures are one video, whose exposure and blur change slowly. Frames without a pose stay as they are.
    layers : takes each frame as it was, and the coverage and depth of each object in it.
    tracer : draws the objects in place of the embedded renderer.
    """
    seconds = {"light": 0.0, "render": 0.0, "encode": 0.0}
    started = time.perf_counter()
    context = gl_context()
    running = [_Running(item, _renderer(context, stage, item)) for item in objects]
    with nullcontext(None) if tracer is None else tracer(stage, objects, running[0].renderer.environment) as traced:
        run = _Run(stage, running, Looks(smooth=video), show_interval, layers, traced)
        seconds["light"] = time.perf_counter() - started
        for shot, picture in progress(stage.footage.pictures(), "inserting", len(stage.footage.shots)):
            started = time.perf_counter()
            if layers is not None:
                layers.picture(shot, picture)
            out = _draw_objects(run, shot, picture)
            rendered = time.perf_counter()
            write(shot, out)
            seconds["render"] += rendered - started
            seconds["encode"] += time.perf_counter() - rendered
    context.release()
    return [_result(stage, item, seconds) for item in running]


def resize(placed: Placed, times: float) -> Placed:
    """The same object grown about its foot."""
    size = replace(placed.size, factor=placed.size.factor * times)
    return replace(placed, size=size, body=replace(placed.body, unit=placed.body.unit * times))


def single_picture(stage: Stage, objects: Sequence[Placed], shot: Shot) -> Picture:
    """The picture (h, w, 3) of one shot with the objects. Raises LookupError if the footage has no such shot."""
    for other, picture in stage.footage.pictures():
        if other.index == shot.index:
            context = gl_context()
            running = [_Running(item, _renderer(context, stage, item)) for item in objects]
            out = _draw_objects(_Run(stage, running, Looks(smooth=False), False, None, None), shot, picture)
            context.release()
            return out
    raise LookupError(shot.name)


def space_for(stage: Stage, model: Model, size: Size) -> Space:
    """The scene as places for this model are sought in it."""
    units = size.factor / stage.scale.metres_per_unit
    radius = float(np.hypot(model.extents[0], model.extents[2])) / 2 * units
    return Space(stage.scene, stage.cloud, stage.supports, radius, float(model.extents[1]) * units)


def _place_object(stage: Stage, request: ObjectRequest, tree: Tree | None) -> Placed:
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
        return place_on_category(space, request.on, instances_named(stage.instances, request.on))
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
    environment = environment_at(item.place, height, stage.cloud, stage.stills, stage.shading())
    ground = environment_at(item.place, GROUND * height, stage.cloud, stage.stills, stage.shading())
    return ObjectRenderer(context, item.body, environment, ground)


def _draw_objects(run: _Run, shot: Shot, picture: Picture) -> Picture:
    """The picture with all objects, the farthest first."""
    view = shot.view
    if view is None:
        for item in run.objects:
            item.frames.append(FrameReport(shot.name, shot.time_s, None, 0.0))
        return picture
    front = front_points(view, run.stage.cloud, shot.row)
    look = run.looks.next(picture, front, run.stage.cloud)
    order = sorted(run.objects, key=lambda item: -float(np.linalg.norm(view.centre - item.placed.body.position)))
    picture, each = _compose(run, shot, view, picture, front, look, order)
    for item, composed in zip(order, each, strict=True):
        item.frames.append(FrameReport(shot.name, shot.time_s, composed.silhouette, composed.visible))
        if run.layers is not None:
            run.layers.layers(shot, run.objects.index(item), *composed.whole())
        if run.show_interval:
            picture = draw_interval(picture, view, item.renderer, run.stage.scale)
    return picture


def _compose(
    run: _Run, shot: Shot, view: View, picture: Picture, front: FrontPoints, look: Look, order: Sequence[_Running]
) -> tuple[Picture, list[Composed]]:
    stage, masks = run.stage, run.stage.masks(shot)
    if run.traced is not None:
        renderers = [item.renderer for item in order]
        layer = run.traced(shot)
        return compose_traced(picture, view, renderers, layer, stage.cloud, front, masks, look, shot.index * 16)
    each: list[Composed] = []
    for number, item in enumerate(order):
        plane = item.placed.place.plane
        surface = None if plane is None else stage.supports.surfaces[plane]
        seed = shot.index * 16 + number
        composed = compose(picture, view, item.renderer, stage.cloud, front, masks, surface, look, seed)
        picture = composed.picture
        each.append(composed)
    return picture, each


def _collision_warning(stage: Stage, placed: Placed) -> list[str]:
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
    warnings = [*placed.model.warnings, *placed.size.warnings, *_collision_warning(stage, placed)]
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
