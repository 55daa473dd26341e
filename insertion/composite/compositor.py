"""Composite virtual objects into the frames of a scene: render, occlude, cast shadows, composite."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.colour import Image
from insertion.composite.camera_look import CameraLookTracker, lens_blur
from insertion.composite.compose import (
    Composite,
    ObjectComposite,
    composite_objects,
    composite_traced,
    occlude_mutually,
)
from insertion.composite.motion_blur import MotionBlur
from insertion.composite.occlusion import has_unconfirmed_occluder, occluded_fraction, on_support
from insertion.composite.shadow_receivers import transmitted_light
from insertion.footage.footage import Footage, Frame
from insertion.footage.image_writer import Writer
from insertion.light.light_model import LightModel
from insertion.placement.placed_object import PlacedObject
from insertion.render.body import Body
from insertion.render.gpu import gl_context
from insertion.render.layers import draw_outline, object_layers
from insertion.render.renderer import ObjectRenderer
from insertion.result import FrameReport, InsertionResult
from insertion.scene.frame_masks import FrameContent, VisibleFrame
from insertion.scene.scale import MetricScale
from metric_base.arrays import FloatArray
from metric_base.progress import ProgressCallback, silent, with_progress

#: Returns the layer (h, w, 4) of a frame in linear light, premultiplied.
Tracer = Callable[[Frame], NDArray[np.float32]]
#: Height at which the light on the support is estimated, as a fraction of the height of the object.
SUPPORT_LIGHT_HEIGHT = 0.1
#: Number of vertices of an object whose mean motion is that of the object.
MOTION_VERTICES = 200
#: Remedies for a possible occluder that does not hide the object.
REMEDY = "add masks (--instances), or a dense cloud (estimate-scale --dense auto)"
#: Colours (red, green, blue) of the outlines at the low and the high end of the scale interval.
LOW_COLOUR, HIGH_COLOUR = (255, 190, 60), (80, 220, 255)


class LayerSink(Protocol):
    """Receives the layers of every frame."""

    def plate(self, frame: Frame, image: Image) -> None:
        """Receive the frame without objects, (h, w, 3)."""

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Receive the layers of the object with this index. Not called if it is out of the frame."""

    def composite(self, frame: Frame, composite: Composite) -> None:
        """Receive the frame with all objects and its layers. Not called for a frame without a pose."""


def composite_footage(
    compositor: Compositor,
    footage: Footage,
    scale: MetricScale,
    write: Writer,
    *,
    tracing: AbstractContextManager[Tracer] | None = None,
    progress: ProgressCallback = silent,
) -> list[InsertionResult]:
    """Composite objects into every frame of the footage. Frames without a pose are unchanged.

    Parameters
    ----------
    compositor : Compositor
        Draws the objects.
    footage : Footage
        Frames to write.
    scale : MetricScale
        Scale to report.
    write : callable
        Receives each frame with its finished image, in order.
    tracing : context manager, optional
        Yields a renderer of the objects in place of the embedded one.
    progress : callable
        Receives the number of finished frames.

    Returns
    -------
    list of InsertionResult
        One result per object.
    """
    seconds = {"light": compositor.light_s, "render": 0.0, "encode": 0.0}
    renderer: AbstractContextManager[Tracer | None] = nullcontext(None) if tracing is None else tracing
    with renderer as tracer:
        for frame, image in with_progress(iter(footage), "inserting", progress, len(footage.frames)):
            started = time.perf_counter()
            for sink in compositor.sinks:
                sink.plate(frame, image)
            finished = compositor.draw(frame, image, tracer)
            rendered = time.perf_counter()
            write(frame, finished)
            seconds["render"] += rendered - started
            seconds["encode"] += time.perf_counter() - rendered
    unposed = sum(frame.view is None for frame in footage.frames)
    warnings = [f"{unposed} frame(s) have no known pose and are unchanged"] if unposed else []
    unconfirmed = [
        (f"{item.model.name}: may be hidden in {count} frame(s): points in front of it are in no mask; {REMEDY}",)
        if count
        else ()
        for item, count in zip(compositor.objects, compositor.unconfirmed, strict=True)
    ]
    return [
        InsertionResult(
            placed.model.name,
            scale,
            placed.size_m,
            placed.placement.position,
            placed.placement.basis[2],
            placed.heading_deg,
            placed.placement.support,
            tuple(reports),
            dict(seconds),
            (*placed.model.warnings, *placed.size.warnings, *placed.warnings, *warnings, *lines),
        )
        for placed, reports, lines in zip(compositor.objects, compositor.reports, unconfirmed, strict=True)
    ]


class Compositor:
    """Draws a set of objects into one frame after another.

    Parameters
    ----------
    objects : sequence of PlacedObject
        The objects.
    light : LightModel
        Light of the scene.
    content : FrameContent
        Points and masks of the scene.
    start_s : float
        Presentation time of the first frame of the footage.
    smooth_look : bool
        Smooth exposure, blur and grain over time, because the frames belong to one video.
    interval : MetricScale, optional
        Scale whose interval is drawn as outlines of the objects.
    sinks : sequence of LayerSink
        Receive the layers of every frame.
    motion : MotionBlur, optional
        Motion blur of the video, if its exposure is known; otherwise it is part of the measured blur.

    Attributes
    ----------
    objects : sequence of PlacedObject
        The objects.
    light_s : float
        Time that the light and the renderers took, in seconds.
    renderers : list of ObjectRenderer
        One per object; they share an OpenGL context, which `close` releases.
    reports : list of list of FrameReport
        Reports of the frames drawn so far, per object.
    unconfirmed : list of int
        Number of frames with a possible occluder that does not hide the object, per object.
    """

    def __init__(
        self,
        objects: Sequence[PlacedObject],
        light: LightModel,
        content: FrameContent,
        start_s: float,
        smooth_look: bool = False,
        interval: MetricScale | None = None,
        sinks: Sequence[LayerSink] = (),
        motion: MotionBlur | None = None,
    ) -> None:
        started = time.perf_counter()
        self.objects, self._content, self._start_s, self.sinks = objects, content, start_s, sinks
        self._motion = motion
        self._looks = CameraLookTracker(smooth=smooth_look)
        self._outlines: list[tuple[float, tuple[int, int, int]]] = []  # size ratio and colour
        if interval is not None and interval.low is not None and interval.high is not None:
            # an object of m metres is m / scale units long: it is larger at the low end
            self._outlines = [
                (interval.metres_per_unit / interval.low, LOW_COLOUR),
                (interval.metres_per_unit / interval.high, HIGH_COLOUR),
            ]
        self.reports: list[list[FrameReport]] = [[] for _ in objects]
        self.unconfirmed = [0 for _ in objects]
        self._context = gl_context()
        try:
            bodies = [item.body for item in objects]
            moves = any(item.moves for item in objects)
            self.renderers = [
                _renderer(self._context, light, item, *other_bodies(bodies, index), moves)
                for index, item in enumerate(objects)
            ]
        except BaseException:
            self.close()
            raise
        self.light_s = time.perf_counter() - started

    def close(self) -> None:
        """Release the OpenGL context."""
        self._context.release()

    def draw(self, frame: Frame, plate: Image, tracer: Tracer | None = None) -> Image:
        """Return a frame with all objects.

        Parameters
        ----------
        frame : Frame
            The frame.
        plate : (h, w, 3) ndarray of uint8
            Its image without objects.
        tracer : callable, optional
            Renders the objects in place of the embedded renderer.
        """
        view = frame.view
        if view is None:
            for reports in self.reports:
                reports.append(FrameReport(frame.name, frame.time_s, None, 0.0))
            return plate
        self._move_objects(frame.clock_s - self._start_s)

        # 1. Content of the frame: visible points, masks, and the look of the camera.
        cloud, visible = self._content.cloud, self._content.at(frame)
        look = self._looks.next(plate, visible.points, cloud)
        if self._motion is not None:
            look = replace(look, blur=lens_blur(look.blur))
        traced = None if tracer is None else tracer(frame)

        # 2. Each object with its occluders and its shadow; objects out of the frame have no layers.
        by_index = self._layers(frame, view, plate, visible, full_size=traced is not None)

        # 3. The composite, with the look of the camera and with grain seeded by the frame index.
        layered, seed = list(by_index.values()), frame.index * 16
        if traced is None:
            composite = composite_objects(plate, layered, look, seed)
        else:
            composite = composite_traced(plate, traced, layered, look, seed)
        for index, reports in enumerate(self.reports):
            shown = by_index.get(index)
            silhouette, fraction = None, 0.0
            if shown is not None:
                silhouette, fraction = shown.layers.silhouette, shown.visible
                for sink in self.sinks:
                    sink.layers(frame, index, shown)
            reports.append(FrameReport(frame.name, frame.time_s, silhouette, fraction))
        for sink in self.sinks:
            sink.composite(frame, composite)
        image = composite.image
        for renderer, (ratio, colour) in itertools.product(self.renderers, self._outlines):
            image = draw_outline(image, view, renderer, ratio, colour)
        return image

    def _layers(
        self, frame: Frame, view: View, plate: Image, visible: VisibleFrame, full_size: bool
    ) -> dict[int, ObjectComposite]:
        """Return the layers of the objects with occlusion and shadow, by index; none for those out of the frame."""
        by_index: dict[int, ObjectComposite] = {}
        points, masks = visible.points, [*visible.masks, *visible.moving]
        for index, (item, renderer) in enumerate(zip(self.objects, self.renderers, strict=True)):
            layers = object_layers(renderer, view, full_size)
            if layers is None:
                continue
            body, surface, box = renderer.body, item.surface, layers.box
            sigma = 0.0 if surface is None else surface.plane.sigma
            support = on_support(body, self._content.cloud, points, sigma)
            occluded, occluders = occluded_fraction(
                layers.image, box, view, visible.masks, points, support, plate[box.slices], visible.billboards
            )
            self.unconfirmed[index] += has_unconfirmed_occluder(layers, points, support, masks)
            transmitted = transmitted_light(
                layers, renderer.irradiance_fraction, body, view, points, masks, surface, occluders
            )
            by_index[index] = ObjectComposite(layers, occluded, transmitted, self._smear(frame, item))
        return dict(zip(by_index, occlude_mutually(list(by_index.values())), strict=True))

    def _smear(self, frame: Frame, item: PlacedObject) -> FloatArray:
        """Return the motion (2,) of an object in pixels during the exposure of a frame; 0 if it is not known."""
        if self._motion is None:
            return np.zeros(2)

        def positions(neighbour: Frame) -> FloatArray:
            body = item.body_at(neighbour.clock_s - self._start_s) if item.moves else item.body
            return np.asarray(body.position + body.unit * body.corners[:: max(1, len(body.corners) // MOTION_VERTICES)])

        return self._motion.smear(frame, positions)

    def _move_objects(self, time_s: float) -> None:
        """Move animated objects to their poses `time_s` seconds after the first frame.

        Objects that have not moved, and have no moving neighbour, keep their shadow maps.
        """
        old = [renderer.body for renderer in self.renderers]
        new = [item.body_at(time_s) if item.moves else body for item, body in zip(self.objects, old, strict=True)]
        moved = [after is not before for after, before in zip(new, old, strict=True)]
        for index, renderer in enumerate(self.renderers):
            neighbours = [k for k in range(len(new)) if k != index and moved[k]]
            affected = any(new[index].is_near(new[k]) or old[index].is_near(old[k]) for k in neighbours)
            if moved[index] or affected:
                renderer.set_pose(new[index], *other_bodies(new, index))


def _renderer(
    context: Any, light: LightModel, item: PlacedObject, others: Sequence[Body], earlier: Sequence[Body], moves: bool
) -> ObjectRenderer:
    """Return the renderer of an object in the light at its position, with the other bodies that shade it."""
    position = item.placement.position
    if item.path is not None:  # only lamps vary along the path; the other light is estimated at its middle
        position = item.path.position(item.path.arrival_s / 2)
    environment = light.environment(position, item.height)
    support_environment = light.environment(position, SUPPORT_LIGHT_HEIGHT * item.height)
    return ObjectRenderer(
        context, item.body, environment, support_environment, casters=others, earlier=earlier, moves=moves
    )


def other_bodies(bodies: Sequence[Body], index: int) -> tuple[list[Body], list[Body]]:
    """Return two lists: the bodies other than the one at `index`, and the bodies before it."""
    return [*bodies[:index], *bodies[index + 1 :]], list(bodies[:index])
