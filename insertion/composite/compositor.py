"""Composite virtual objects into the frames of a scene: render, occlude, cast shadows, join."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from insertion.composite.camera_look import Looks
from insertion.composite.compose import Composite, Joined, behind_each_other, compose, compose_traced
from insertion.composite.occlusion import hidden_share, on_support
from insertion.composite.shadow_receivers import light_share, receivers_of
from insertion.footage.footage import Shot
from insertion.insertion_scene import PreparedScene
from insertion.light.environment_estimate import environment_at
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import Placed
from insertion.render.body import Body
from insertion.render.gpu import gl_context
from insertion.render.layers import draw_interval, object_layers
from insertion.render.renderer import ObjectRenderer
from insertion.result import FrameReport, InsertionResult
from insertion.scene.frame_masks import points_beside, uprights
from insertion.scene.point_cloud import front_points
from metric_base.progress import ProgressCallback, silent, with_progress

#: An (h, w, 3) sRGB image.
Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]
#: Returns the (h, w, 4) layer of a shot in linear light, premultiplied.
Traced = Callable[[Shot], NDArray[np.float32]]
#: Starts another renderer.
Tracer = Callable[[PreparedScene, Sequence[Placed], Environment, ProgressCallback], AbstractContextManager[Traced]]
#: Height at which the light on the support is estimated, as a fraction of the height of the object.
SUPPORT_LIGHT_HEIGHT = 0.1


class LayerSink(Protocol):
    """Receives the layers of every frame."""

    def picture(self, shot: Shot, picture: Picture) -> None:
        """Receive the frame without objects, (h, w, 3)."""

    def layers(self, shot: Shot, number: int, joined: Joined) -> None:
        """Receive the layers of the object with this index."""

    def composite(self, shot: Shot, composite: Composite) -> None:
        """Receive the frame with all objects and the layers it is composited from. Not called without a pose."""


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
    """Composite objects into every frame of the footage. Frames without a pose are unchanged.

    Parameters
    ----------
    write : callable
        Receives each shot with its finished frame, in order.
    show_interval : bool
        Draw the outlines of the objects at both ends of the scale interval.
    video : bool
        The frames belong to one video, so that exposure, blur and grain change slowly.
    layers : sequence of LayerSink
        Receive the layers of every frame.
    tracer : callable, optional
        Renderer of the objects in place of the embedded one.

    Returns
    -------
    list of InsertionResult
        One result per object.
    """
    seconds = {"light": 0.0, "render": 0.0, "encode": 0.0}
    started = time.perf_counter()
    with closing(_Compositor(prepared, objects, Looks(smooth=video), show_interval, layers)) as compositor:
        tracing: AbstractContextManager[Traced | None] = nullcontext(None)
        if tracer is not None:
            tracing = tracer(prepared, objects, compositor.renderers[0].environment, progress)
        with tracing as traced:
            seconds["light"] = time.perf_counter() - started
            shots = prepared.footage.shots
            for shot, picture in with_progress(prepared.footage.pictures(), "inserting", progress, len(shots)):
                started = time.perf_counter()
                for sink in layers:
                    sink.picture(shot, picture)
                out = compositor.draw(shot, picture, traced)
                rendered = time.perf_counter()
                write(shot, out)
                seconds["render"] += rendered - started
                seconds["encode"] += time.perf_counter() - rendered
    unposed = sum(shot.view is None for shot in shots)
    warnings = [f"{unposed} frame(s) have no known pose and are left as they are"] if unposed else []
    return [
        InsertionResult(
            placed.model.name,
            prepared.scale,
            placed.size_m,
            placed.place.position,
            placed.place.basis[2],
            placed.heading_deg,
            placed.place.support,
            tuple(reports),
            dict(seconds),
            (*placed.model.warnings, *placed.size.warnings, *placed.warnings, *warnings),
        )
        for placed, reports in zip(objects, compositor.reports, strict=True)
    ]


def single_pictures(prepared: PreparedScene, variants: Sequence[Sequence[Placed]], shot: Shot) -> Iterator[Picture]:
    """Yield the frame (h, w, 3) of one shot with each of several sets of objects; it is decoded once.

    Raises
    ------
    LookupError
        The footage does not contain the shot.
    """
    picture = next((image for other, image in prepared.footage.pictures() if other.index == shot.index), None)
    if picture is None:
        raise LookupError(shot.name)
    for objects in variants:
        with closing(_Compositor(prepared, objects, Looks(smooth=False))) as compositor:
            yield compositor.draw(shot, picture)


class _Compositor:
    """Draws a set of objects into one frame after another.

    Attributes
    ----------
    renderers : list of ObjectRenderer
        One per object; they share an OpenGL context, which `close` releases.
    reports : list of list of FrameReport
        Reports of the frames drawn so far, per object.
    """

    def __init__(
        self,
        prepared: PreparedScene,
        objects: Sequence[Placed],
        looks: Looks,
        show_interval: bool = False,
        sinks: Sequence[LayerSink] = (),
    ) -> None:
        self._prepared, self._objects, self._looks = prepared, objects, looks
        self._show_interval, self._sinks = show_interval, sinks
        self.reports: list[list[FrameReport]] = [[] for _ in objects]
        self._context = gl_context()
        try:
            bodies = [item.body for item in objects]
            moves = any(item.moves for item in objects)
            self.renderers = [
                _renderer(self._context, prepared, item, *_other_bodies(bodies, index), moves)
                for index, item in enumerate(objects)
            ]
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the OpenGL context."""
        self._context.release()

    def draw(self, shot: Shot, picture: Picture, trace: Traced | None = None) -> Picture:
        """Return the frame (h, w, 3) with all objects; `trace` renders them in place of the embedded renderer."""
        view = shot.view
        if view is None:
            for reports in self.reports:
                reports.append(FrameReport(shot.name, shot.time_s, None, 0.0))
            return picture
        prepared, cloud = self._prepared, self._prepared.cloud
        self._move_objects(shot.clock_s - prepared.start_s)

        # 1. Content of the frame: visible points, masks, and the look of the camera.
        moving = prepared.moving.get(shot.index, ())
        points = points_beside(front_points(view, cloud, shot.row), moving)
        look = self._looks.next(picture, points, cloud)
        masks = prepared.masks(shot)
        traced = None if trace is None else trace(shot)
        ground = prepared.supports.ground(cloud) if moving else None
        billboards = [] if ground is None else uprights(moving, view, ground.plane)

        # 2. Each object with its occluders and its shadow; objects out of the frame have no layers.
        by_index: dict[int, Joined] = {}
        for index, (item, renderer) in enumerate(zip(self._objects, self.renderers, strict=True)):
            layers = object_layers(renderer, view, whole=traced is not None)
            if layers is None:
                continue
            body, surface = renderer.body, item.surface
            support = on_support(body, cloud, points, 0.0 if surface is None else surface.plane.sigma)
            part = picture[layers.box.slices]
            occlusion = hidden_share(layers.image, layers.box, view, masks, points, support, part, billboards)
            receivers = receivers_of(layers, body, view, points, [*masks, *moving], surface, occlusion.front)
            lit = (receivers.places[..., 3] > 0).any()
            received = renderer.received_light(receivers.places, receivers.normals) if lit else None
            by_index[index] = Joined(layers, occlusion.share, light_share(layers, receivers, received))
        by_index = dict(zip(by_index, behind_each_other(list(by_index.values())), strict=True))

        # 3. The composite, with the look of the camera and grain that depends on the frame only.
        joined, seed = list(by_index.values()), shot.index * 16
        if traced is None:
            composite = compose(picture, joined, look, seed)
        else:
            composite = compose_traced(picture, traced, joined, look, seed)
        out = composite.picture
        for index, renderer in enumerate(self.renderers):
            one = by_index.get(index)
            silhouette, visible = (None, 0.0) if one is None else (one.layers.silhouette, one.visible)
            self.reports[index].append(FrameReport(shot.name, shot.time_s, silhouette, visible))
            for sink in self._sinks if one is not None else ():
                sink.layers(shot, index, by_index[index])
            if self._show_interval:
                out = draw_interval(out, view, renderer, prepared.scale)
        for sink in self._sinks:
            sink.composite(shot, composite)
        return out

    def _move_objects(self, time_s: float) -> None:
        """Move animated objects to their poses `time_s` seconds after the first frame.

        Objects that have not moved, and have no moving neighbour, keep their shadow maps.
        """
        old = [renderer.body for renderer in self.renderers]
        new = [item.body_at(time_s) if item.moves else body for item, body in zip(self._objects, old, strict=True)]
        moved = [after is not before for after, before in zip(new, old, strict=True)]
        for index, renderer in enumerate(self.renderers):
            neighbours = [k for k in range(len(new)) if k != index and moved[k]]
            affected = any(new[index].near(new[k]) or old[index].near(old[k]) for k in neighbours)
            if moved[index] or affected:
                renderer.stand(new[index], *_other_bodies(new, index))


def _renderer(
    context: Any, prepared: PreparedScene, item: Placed, others: Sequence[Body], earlier: Sequence[Body], moves: bool
) -> ObjectRenderer:
    """Return the renderer of an object in the light at its position, with the other bodies that shade it."""
    height = float(item.model.extents[1]) * item.size.factor / prepared.scale.metres_per_unit
    place = item.place
    if item.walk is not None:  # only the lamps have a position; other light is estimated at the middle of the path
        place = replace(place, position=item.walk.place(item.walk.arrival_s / 2))
    environment, support_light = (
        environment_at(place, extent, prepared.cloud, prepared.stills, prepared.shading())
        for extent in (height, SUPPORT_LIGHT_HEIGHT * height)
    )
    return ObjectRenderer(context, item.body, environment, support_light, shading=others, before=earlier, moves=moves)


def _other_bodies(bodies: Sequence[Body], index: int) -> tuple[list[Body], list[Body]]:
    """Return all bodies except the one with this index, and those before it."""
    return [*bodies[:index], *bodies[index + 1 :]], list(bodies[:index])
