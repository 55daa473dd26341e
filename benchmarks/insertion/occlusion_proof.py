"""Measure the error of occlusion edges: `python -m benchmarks.insertion.occlusion_proof`.

In synthetic rooms an object is inserted where furniture occludes a part of it in some frames of a walk. The
reconstruction has every second frame of the walk, with masks of all of its frames, of every fourth, or of none. The
visible part is compared with renderings of the room that contain the object, with edges from masks and points and with
edges that are refined by the image. Prints one line of JSON for each room and setting.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.insertion.occluded_positions import occluded_position
from estimator.projection.visibility import scene_visibility
from estimator.records.scene import View
from insertion.composite.occlusion import occluded_fraction, on_support
from insertion.light.environment_map import HEIGHT, WIDTH, Environment
from insertion.render.body import Body, body_of
from insertion.render.gpu import gl_context
from insertion.render.layers import object_box, object_layer
from insertion.render.renderer import ObjectRenderer
from insertion.scene.frame_masks import MaskPropagator
from insertion.scene.point_cloud import ColouredPoints, visible_points
from metric_base.arrays import BoolArray, FloatArray
from models3d.gltf.model_reader import read_model
from tests.synthetic.insertions import standing, write_glb
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.world import World
from tests.synthetic.videos import orbit, room

#: Kind and seed of the room, category of the object, and its size in metres.
ROOMS = (
    ("sitting room", 1003, "chair", (0.42, 0.38, 0.75)),
    ("kitchen", 1005, "stool", (0.36, 0.36, 0.62)),
    ("kitchen", 1002, "chair", (0.42, 0.38, 0.75)),
    ("bedroom", 1001, "chair", (0.42, 0.38, 0.75)),
    ("study", 1004, "stool", (0.36, 0.36, 0.62)),
)
N_FRAMES = 16
ARC_DEG = 60.0
#: Minimum number of object pixels in a frame; smaller objects have almost no outline.
MIN_PIXELS = 400
#: Relative noise of the cloud's depth.
DEPTH_NOISE = 0.004
#: Standard deviation of the mask borders in pixels.
MASK_ERROR_PX = 0.7


@dataclass(frozen=True, slots=True)
class Setting:
    """Input of the insertion: dense or sparse points, and masks of every `masks`-th view (0: no masks)."""

    name: str
    dense: bool
    masks: int


SETTINGS = (
    Setting("masks, dense points", True, 1),
    Setting("masks, sparse points", False, 1),
    Setting("masks of every fourth view, sparse points", False, 4),
    Setting("dense points alone", True, 0),
    Setting("sparse points alone", False, 0),
)


@dataclass(frozen=True, slots=True, eq=False)
class HiddenObject:
    """A room with an object that furniture occludes.

    complete, visible : masks (h, w) of the object in every frame, without and with occlusion.
    images : (h, w, 3) of the room without the object.
    """

    world: World
    synthetic: SyntheticScene
    to_scene: Similarity
    body: Body
    complete: tuple[BoolArray, ...]
    visible: tuple[BoolArray, ...]
    images: tuple[NDArray[np.uint8], ...]

    def view(self, index: int) -> tuple[View, int | None]:
        """Return the view of a frame of the walk, and its index in the reconstruction (None if it is not in it)."""
        if index % 2 == 0:
            return self.synthetic.scene.views[index // 2], index // 2
        pose = self.world.poses[index]
        rotation = pose.rotation @ self.to_scene.rotation.T
        centre = self.to_scene(pose.centre[None])[0]
        camera = self.synthetic.scene.views[0].camera
        return View(
            f"{index:06d}.png", camera, rotation, -rotation @ centre, np.zeros((0, 2)), np.zeros(0, np.int64)
        ), None


def main() -> None:
    """Run the benchmark and print the rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, nargs="*", default=list(range(len(ROOMS))), help="numbers from 0")
    for index in parser.parse_args().rooms:
        for row in room_rows(*ROOMS[index]):
            print(json.dumps(row), flush=True)


def room_rows(kind: str, seed: int, category: str, size: Sequence[float]) -> list[dict[str, Any]]:
    """Return the results of a room in all settings."""
    hidden = hidden_object(kind, seed, category, size)
    inputs = [_input(hidden, setting) for setting in SETTINGS]
    white = np.ones((HEIGHT, WIDTH, 3), np.float32)
    environment = Environment(white, hidden.body.basis, white[..., 0])
    renderer = ObjectRenderer(gl_context(), hidden.body, environment)
    variants = [(setting, guided) for setting in SETTINGS for guided in (False, True)]
    errors: list[list[FloatArray]] = [[] for _ in variants]
    wrong: list[list[float]] = [[] for _ in variants]
    fractions = []
    for index, (complete, visible) in enumerate(zip(hidden.complete, hidden.visible, strict=True)):
        if complete.sum() < MIN_PIXELS:
            continue
        fractions.append(1 - float(visible.sum() / complete.sum()))
        our_complete, *outlines = frame_outlines(hidden, inputs, index, renderer)
        for k, ours in enumerate(outlines):
            errors[k].append(_edge_errors(ours, our_complete, visible, complete))
            wrong[k].append(float((ours != visible).sum() / complete.sum()))
    return [
        {
            "room": f"{kind} {seed}",
            "setting": setting.name,
            "edges": "picture" if guided else "masks",
            **_summary(errors[k], wrong[k], fractions),
        }
        for k, (setting, guided) in enumerate(variants)
    ]


def hidden_object(kind: str, seed: int, category: str, size: Sequence[float]) -> HiddenObject:
    """Return a room, the reconstruction of every second frame, and an object that furniture occludes."""
    world = room(kind, seed, orbit(KINDS[kind].radius, N_FRAMES, seed, ARC_DEG))
    mesh = solid(category, np.array(size))
    few = replace(world, poses=world.poses[::2])
    position, front = occluded_position(few, mesh)
    synthetic = quick_scene(few, Knobs(depth_noise=DEPTH_NOISE, stray=0.01, mask_error_px=MASK_ERROR_PX), seed)
    true = np.array([pose.centre for pose in few.poses])
    to_scene = similarity_between(true, np.array([view.centre for view in synthetic.scene.views]))
    with tempfile.TemporaryDirectory() as folder:
        model = read_model(write_glb(mesh, Path(folder) / "model.glb"))
    up = to_scene.rotation[:, 2]
    basis = np.stack([to_scene.rotation[:, 0], to_scene.rotation[:, 1], up])
    body = body_of(model, to_scene(position[None])[0], basis, to_scene.rotation @ front, to_scene.scale)
    # the true masks: a rendering of the object only, and a rendering of the room with the object as its last item
    inserted = standing(world, mesh, position, front)
    masks = []
    for rendered, item in ((replace(inserted, objects=inserted.objects[-1:]), 1), (inserted, len(inserted.objects))):
        with Renderer(rendered) as renderer:
            masks.append(tuple(renderer.frame(k, colour=False).ids == item for k in range(len(inserted.poses))))
    with Renderer(world) as bare:
        colours = [bare.frame(k).colour for k in range(len(world.poses))]
    images = tuple(colour for colour in colours if colour is not None)
    return HiddenObject(world, synthetic, to_scene, body, masks[0], masks[1], images)


@dataclass(frozen=True, slots=True, eq=False)
class Input:
    """Point cloud and masks of a scene in one setting."""

    cloud: ColouredPoints
    propagator: MaskPropagator


def _input(hidden: HiddenObject, setting: Setting) -> Input:
    scene = hidden.synthetic.scene
    dense = scene.dense if setting.dense else None
    points = scene.points if dense is None else np.concatenate([scene.points, dense.points])
    visibility = scene_visibility(replace(scene, dense=None)) if dense is None else None
    cloud = ColouredPoints(points, np.zeros((len(points), 3), np.float32), dense is not None, visibility=visibility)
    by_view = {
        row: [item for item in hidden.synthetic.instances if item.view == row]
        for row in (range(0, len(scene.views), setting.masks) if setting.masks else ())
    }
    return Input(cloud, MaskPropagator(scene, by_view, cloud))


def frame_outlines(
    hidden: HiddenObject, inputs: Sequence[Input], index: int, renderer: ObjectRenderer
) -> list[BoolArray]:
    """Return masks (h, w) of our object in a frame: complete, then two visible parts for each input.

    The second visible part of an input has edges that are refined by the image.
    """
    view, row = hidden.view(index)
    outlines = [np.zeros((view.camera.height, view.camera.width), bool) for _ in range(2 * len(inputs) + 1)]
    box = object_box(view, hidden.body)
    if box is None:
        return outlines
    layer = object_layer(renderer, view, box)
    outlines[0][box.slices] = layer.alpha > 0.5
    for k, scene_input in enumerate(inputs):
        front = visible_points(view, scene_input.cloud, row)
        masks, support = scene_input.propagator.masks(row, view), on_support(hidden.body, scene_input.cloud, front)
        for guided, image in enumerate((None, hidden.images[index][box.slices])):
            occluded = occluded_fraction(layer, box, view, masks, front, support, image)[0]
            outlines[1 + 2 * k + guided][box.slices] = layer.alpha * (1 - occluded) > 0.5
    return outlines


def _edge_errors(ours: BoolArray, our_complete: BoolArray, true: BoolArray, true_complete: BoolArray) -> FloatArray:
    """Return the distances (n,) in pixels between occlusion edges and the nearest border pixel of the other mask.

    An occlusion edge is the border between the visible and the occluded part. Both our and the true edges are included.

    ours, true : (h, w) visible parts of the object.
    our_complete, true_complete : (h, w) masks of the object without occlusion.
    """
    from scipy.ndimage import distance_transform_edt

    errors = []
    for visible, complete, other in ((true, true_complete, ours), (ours, our_complete, true)):
        edge = _border(visible) & _dilated(complete & ~visible) & ~_dilated(~complete)
        border = _border(other)
        if edge.any():
            diagonal = float(np.hypot(*visible.shape))
            distance = distance_transform_edt(~border) if border.any() else np.full(visible.shape, diagonal)
            errors.append(np.asarray(distance)[edge])
    return np.concatenate(errors) if errors else np.zeros(0)


def _border(mask: BoolArray) -> BoolArray:
    """Return the pixels of a mask (h, w) that have a neighbour outside it."""
    return np.asarray(mask & _dilated(~mask))


def _dilated(mask: BoolArray) -> BoolArray:
    import cv2

    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _summary(errors: Sequence[FloatArray], wrong: Sequence[float], hidden: Sequence[float]) -> dict[str, Any]:
    pixels = np.concatenate([np.zeros(0), *errors])
    return {
        "frames": len(wrong),
        "hidden": round(float(np.mean(hidden)), 2),
        "edge_px": round(float(pixels.mean()), 2),
        "edge_p90_px": round(float(np.quantile(pixels, 0.9)), 2),
        "worst_frame_px": round(max(float(frame.mean()) for frame in errors if len(frame) > 30), 2),
        "wrong": round(float(np.mean(wrong)), 4),
    }


if __name__ == "__main__":
    main()
