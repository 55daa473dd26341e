"""Objects drawn into every frame: layers are rendered, hidden and shaded by what the frame shows, and joined."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.composite.compose import Composite, Joined, behind_each_other, compose, compose_traced
from insertion.composite.exposure_and_grain import Looks
from insertion.composite.occlusion import hidden_share, on_support
from insertion.composite.receivers import light_share, receivers_of
from insertion.footage.footage import Shot
from insertion.light.environment import Environment
from insertion.light.environment_estimate import environment_at
from insertion.pipeline.objects import Placed
from insertion.pipeline.prepared_scene import PreparedScene
from insertion.pipeline.result import FrameReport, InsertionResult
from insertion.render.body import Body
from insertion.render.context import gl_context
from insertion.render.layers import draw_interval, object_layers
from insertion.render.renderer import ObjectRenderer
from insertion.scene.cloud import FrontPoints, front_points
from insertion.scene.moving_masks import points_beside, uprights
from metric_base.progress import ProgressCallback, silent, with_progress

__all__ = ["LayerSink", "insert_objects", "single_pictures"]

Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]
#: The light on the support is taken from the middle of the lowest tenth of the object.
GROUND = 0.1
#: From a shot to its (h, w, 4) layer of linear light.
Traced = Callable[[Shot], NDArray[np.float32]]
#: Opens another renderer.
Tracer = Callable[[PreparedScene, Sequence[Placed], Environment, ProgressCallback], AbstractContextManager[Traced]]


class LayerSink(Protocol):
    """Takes what an insertion is made of, frame by frame."""

    def picture(self, shot: Shot, picture: Picture) -> None:
        """Take the frame without objects, (h, w, 3)."""

    def layers(self, shot: Shot, number: int, joined: Joined) -> None:
        """Take the layers of one object, by its number."""

    def composite(self, shot: Shot, composite: Composite) -> None:
        """Take the picture with all objects, and what it was joined from; none for a picture without a pose."""


@dataclass(slots=True, eq=False)
class _Running:
    """An object during the run over the frames."""

    placed: Placed
    renderer: ObjectRenderer
    frames: list[FrameReport] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What one picture (h, w, 3) shows: its points, the masks of what stands still and of what moves."""

    view: View
    picture: Picture
    front: FrontPoints
    masks: Sequence[Instance]
    moving: Sequence[Instance]


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """What stays the same over the frames; start_s : when objects that move begin to."""

    prepared: PreparedScene
    objects: list[_Running]
    looks: Looks
    start_s: float = 0.0
    show_interval: bool = False
    layers: Sequence[LayerSink] = ()
    traced: Traced | None = None


def insert_objects(
    prepared: PreparedScene,
    objects: Sequence[Placed],
    write: Writer,
    *,
    show_interval: bool = False,
    video: bool = False,
    layers: Sequence[LayerSink] = (),
    tracer: Tracer | None = None,
    progress: ProgressCallback = silent,
) -> list[InsertionResult]:
    """Draw the objects into every picture of the footage and hand each to `write`, one at a time.

    video : the pictures are one video, whose exposure and blur change slowly. Frames without a pose stay as they are.
    layers : each takes the frame as it was, the layers of each object in it, and what they were joined to.
    tracer : draws the objects in place of the embedded renderer.
    """
    seconds = {"light": 0.0, "render": 0.0, "encode": 0.0}
    started = time.perf_counter()
    with _renderers(prepared, objects) as running, _open_tracer(prepared, running, tracer, progress) as traced:
        run = _Run(prepared, running, Looks(smooth=video), prepared.start_s, show_interval, layers, traced)
        seconds["light"] = time.perf_counter() - started
        for shot, picture in with_progress(
            prepared.footage.pictures(), "inserting", progress, len(prepared.footage.shots)
        ):
            started = time.perf_counter()
            for sink in layers:
                sink.picture(shot, picture)
            out = _draw_objects(run, shot, picture)
            rendered = time.perf_counter()
            write(shot, out)
            seconds["render"] += rendered - started
            seconds["encode"] += time.perf_counter() - rendered
    return [_result(prepared, item, seconds) for item in running]


def single_pictures(prepared: PreparedScene, variants: Sequence[Sequence[Placed]], shot: Shot) -> Iterator[Picture]:
    """The picture (h, w, 3) of one shot with each of several sets of objects; it is decoded once.

    Raises LookupError if the footage has no such shot.
    """
    picture = next((one for other, one in prepared.footage.pictures() if other.index == shot.index), None)
    if picture is None:
        raise LookupError(shot.name)
    for objects in variants:
        with _renderers(prepared, objects) as running:
            yield _draw_objects(_Run(prepared, running, Looks(smooth=False), prepared.start_s), shot, picture)


@contextmanager
def _renderers(prepared: PreparedScene, objects: Sequence[Placed]) -> Iterator[list[_Running]]:
    """The objects with their renderers, in a context that is released at the end."""
    context = gl_context()
    try:
        bodies = [item.body for item in objects]
        moves = any(item.moves for item in objects)
        yield [
            _Running(item, _renderer(context, prepared, item, *_beside(bodies, number), moves))
            for number, item in enumerate(objects)
        ]
    finally:
        context.release()


def _open_tracer(
    prepared: PreparedScene, running: Sequence[_Running], tracer: Tracer | None, progress: ProgressCallback
) -> AbstractContextManager[Traced | None]:
    """What gives the (h, w, 4) layer of a shot; nothing where the embedded renderer draws."""
    if tracer is None:
        return nullcontext(None)
    return tracer(prepared, [item.placed for item in running], running[0].renderer.environment, progress)


def _renderer(
    context: Any, prepared: PreparedScene, item: Placed, others: Sequence[Body], before: Sequence[Body], moves: bool
) -> ObjectRenderer:
    height = float(item.model.extents[1]) * item.size.factor / prepared.scale.metres_per_unit
    place = item.place
    if item.walk is not None:  # lamps have their place; the rest of the light is that of the middle of the way
        place = replace(place, position=item.walk.place(item.walk.arrival_s / 2))
    environment = environment_at(place, height, prepared.cloud, prepared.stills, prepared.shading())
    ground = environment_at(place, GROUND * height, prepared.cloud, prepared.stills, prepared.shading())
    return ObjectRenderer(context, item.body, environment, ground, shading=others, before=before, moves=moves)


def _beside(bodies: Sequence[Body], number: int) -> tuple[list[Body], list[Body]]:
    """The bodies beside one of them, and those before it."""
    return [*bodies[:number], *bodies[number + 1 :]], list(bodies[:number])


def _move_objects(objects: Sequence[_Running], time_s: float) -> None:
    """Put every object where it is at a time from the first picture; where nothing changes, nothing is done."""
    bodies = [item.placed.body_at(time_s) if item.placed.moves else item.renderer.body for item in objects]
    moved = [body is not item.renderer.body for body, item in zip(bodies, objects, strict=True)]
    old = [item.renderer.body for item in objects]
    for number, item in enumerate(objects):
        others = [k for k in range(len(objects)) if k != number]
        beside = any(moved[k] and (bodies[number].near(bodies[k]) or old[number].near(old[k])) for k in others)
        if moved[number] or beside:
            item.renderer.stand(bodies[number], *_beside(bodies, number))


def _draw_objects(run: _Run, shot: Shot, picture: Picture) -> Picture:
    """The picture with all objects."""
    view = shot.view
    if view is None:
        for item in run.objects:
            item.frames.append(FrameReport(shot.name, shot.time_s, None, 0.0))
        return picture
    _move_objects(run.objects, shot.clock_s - run.start_s)
    moving = run.prepared.moving.get(shot.index, ())
    front = points_beside(front_points(view, run.prepared.cloud, shot.row), moving)
    look = run.looks.next(picture, front, run.prepared.cloud)
    masks = run.prepared.masks(shot)
    traced = None if run.traced is None else run.traced(shot)
    seen = _Seen(view, picture, front, masks, moving)
    drawn = [_layers_in_frame(run.prepared, item, seen, traced is not None) for item in run.objects]
    present = [number for number, one in enumerate(drawn) if one is not None]
    behind = behind_each_other([one for one in drawn if one is not None])
    joined = dict(zip(present, behind, strict=True))
    seed = shot.index * 16
    if traced is None:
        composite = compose(picture, behind, look, seed)
    else:
        composite = compose_traced(picture, traced, behind, look, seed)
    out = composite.picture
    for number, item in enumerate(run.objects):
        one = joined.get(number)
        box, visible = (None, 0.0) if one is None else (one.layers.silhouette, one.visible)
        item.frames.append(FrameReport(shot.name, shot.time_s, box, visible))
        for sink in run.layers if one is not None else ():
            sink.layers(shot, number, joined[number])
        if run.show_interval:
            out = draw_interval(out, view, item.renderer, run.prepared.scale)
    for sink in run.layers:
        sink.composite(shot, composite)
    return out


def _layers_in_frame(prepared: PreparedScene, item: _Running, seen: _Seen, whole: bool) -> Joined | None:
    """The layers of an object with what hides it and what it shades; None where it is out of the picture."""
    view, front = seen.view, seen.front
    layers = object_layers(item.renderer, view, whole)
    if layers is None:
        return None
    body, surface = item.renderer.body, item.placed.surface
    sigma = 0.0 if surface is None else surface.plane.sigma
    support = on_support(body, prepared.cloud, front, sigma)
    ground = prepared.supports.ground(prepared.cloud) if seen.moving else None
    people = [] if ground is None else uprights(seen.moving, view, ground.plane)
    part = seen.picture[layers.box.slices]
    hidden = hidden_share(layers.image, layers.box, view, seen.masks, front, support, part, people)
    receivers = receivers_of(layers, body, view, front, [*seen.masks, *seen.moving], surface, hidden.front)
    received = None
    if (receivers.places[..., 3] > 0).any():
        received = item.renderer.received_light(receivers.places, receivers.normals)
    return Joined(layers, hidden.share, light_share(layers, receivers, received))


def _result(prepared: PreparedScene, item: _Running, seconds: dict[str, float]) -> InsertionResult:
    placed = item.placed
    unposed = sum(shot.view is None for shot in prepared.footage.shots)
    warnings = [*placed.model.warnings, *placed.size.warnings, *placed.warnings]
    if unposed:
        warnings.append(f"{unposed} frame(s) have no known pose and are left as they are")
    return InsertionResult(
        placed.model.name,
        prepared.scale,
        placed.size_m,
        placed.place.position,
        placed.place.basis[2],
        placed.heading_deg,
        placed.place.support,
        tuple(item.frames),
        dict(seconds),
        tuple(warnings),
    )
