"""The edge along which furniture hides an object: `python -m benchmarks.insertion.occlusion_proof`.

In synthetic rooms the object stands where furniture hides a part of it in some frames of a walk. The model has every
second frame of the walk; masks come with all of its frames, with every fourth, or with none. What is hidden is
compared with the room in which the mesh really stands, with edges as masks and points have them and as the picture has
them. Printed: a line of JSON for each room and setting.
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

from benchmarks.insertion.hiding_places import hiding_place
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

#: Kind and seed of the room, what is hidden in it, and its size in metres.
ROOMS = (
    ("sitting room", 1003, "chair", (0.42, 0.38, 0.75)),
    ("kitchen", 1005, "stool", (0.36, 0.36, 0.62)),
    ("kitchen", 1002, "chair", (0.42, 0.38, 0.75)),
    ("bedroom", 1001, "chair", (0.42, 0.38, 0.75)),
    ("study", 1004, "stool", (0.36, 0.36, 0.62)),
)
FRAMES, ARC_DEG = 16, 60.0
#: An object of fewer pixels says little about its outline.
LEAST_PIXELS = 400
#: Noise of the cloud's depth, as a share of it, and one sigma of the masks' border in pixels.
DEPTH_NOISE, MASK_PX = 0.004, 0.7


@dataclass(frozen=True, slots=True)
class Setting:
    """What is known of the scene. masks : they come with every so manieth view of the model, 0 without any."""

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
    """A room with an object that furniture hides; whole, seen : its true outlines (h, w) in every frame.

    pictures : (h, w, 3) of the room without it.
    """

    world: World
    synthetic: SyntheticScene
    to_scene: Similarity
    body: Body
    whole: tuple[BoolArray, ...]
    seen: tuple[BoolArray, ...]
    pictures: tuple[NDArray[np.uint8], ...]

    def view(self, index: int) -> tuple[View, int | None]:
        """The view of a frame of the walk, and its row in the model."""
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
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, nargs="*", default=list(range(len(ROOMS))), help="numbers from 0")
    for number in parser.parse_args().rooms:
        for row in room_rows(*ROOMS[number]):
            print(json.dumps(row), flush=True)


def room_rows(kind: str, seed: int, what: str, size: Sequence[float]) -> list[dict[str, Any]]:
    """The figures of one room in all settings."""
    hidden = hidden_object(kind, seed, what, size)
    known = [_known(hidden, setting) for setting in SETTINGS]
    renderer = plain_renderer(hidden.body)
    ways = [(setting, guided) for setting in SETTINGS for guided in (False, True)]
    errors: list[list[FloatArray]] = [[] for _ in ways]
    wrong: list[list[float]] = [[] for _ in ways]
    shares = []
    for index, (whole, seen) in enumerate(zip(hidden.whole, hidden.seen, strict=True)):
        if whole.sum() < LEAST_PIXELS:
            continue
        shares.append(1 - float(seen.sum() / whole.sum()))
        ours_whole, *shown = frame_outlines(hidden, known, index, renderer)
        for number, ours in enumerate(shown):
            errors[number].append(_edge_errors(ours, ours_whole, seen, whole))
            wrong[number].append(float((ours != seen).sum() / whole.sum()))
    return [
        {
            "room": f"{kind} {seed}",
            "setting": setting.name,
            "edges": "picture" if guided else "masks",
            **_summary(errors[k], wrong[k], shares),
        }
        for k, (setting, guided) in enumerate(ways)
    ]


def plain_renderer(body: Body) -> ObjectRenderer:
    """A renderer under an even white light."""
    white = np.ones((HEIGHT, WIDTH, 3), np.float32)
    return ObjectRenderer(gl_context(), body, Environment(white, body.basis, white[..., 0]))


def hidden_object(kind: str, seed: int, what: str, size: Sequence[float]) -> HiddenObject:
    """The room, its model of every second frame, and the object where furniture hides it."""
    world = room(kind, seed, orbit(KINDS[kind].radius, FRAMES, seed, ARC_DEG))
    mesh = solid(what, np.array(size))
    few = replace(world, poses=world.poses[::2])
    place, front, _ = hiding_place(few, mesh)
    synthetic = quick_scene(few, Knobs(depth_noise=DEPTH_NOISE, stray=0.01, mask_error_px=MASK_PX), seed)
    true = np.array([pose.centre for pose in few.poses])
    to_scene = similarity_between(true, np.array([view.centre for view in synthetic.scene.views]))
    with tempfile.TemporaryDirectory() as folder:
        model = read_model(write_glb(mesh, Path(folder) / "model.glb"))
    up = to_scene.rotation[:, 2]
    basis = np.stack([to_scene.rotation[:, 0], to_scene.rotation[:, 1], up])
    body = body_of(model, to_scene(place[None])[0], basis, to_scene.rotation @ front, to_scene.scale)
    whole, seen = _true_outlines(standing(world, mesh, place, front))
    with Renderer(world) as bare:
        colours = [bare.frame(k).colour for k in range(len(world.poses))]
    pictures = tuple(colour for colour in colours if colour is not None)
    return HiddenObject(world, synthetic, to_scene, body, whole, seen, pictures)


def _true_outlines(world: World) -> tuple[tuple[BoolArray, ...], tuple[BoolArray, ...]]:
    frames = []
    for shown, number in ((replace(world, objects=world.objects[-1:]), 1), (world, len(world.objects))):
        with Renderer(shown) as renderer:
            frames.append([renderer.frame(k, colour=False).ids == number for k in range(len(world.poses))])
    return tuple(frames[0]), tuple(frames[1])


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What a setting knows of a scene."""

    cloud: ColouredPoints
    carrier: MaskPropagator


def _known(hidden: HiddenObject, setting: Setting) -> Known:
    scene = hidden.synthetic.scene
    dense = scene.dense if setting.dense else None
    points = scene.points if dense is None else np.concatenate([scene.points, dense.points])
    known = scene_visibility(replace(scene, dense=None)) if dense is None else None
    cloud = ColouredPoints(points, np.zeros((len(points), 3), np.float32), dense is not None, visibility=known)
    by_view = {
        row: [item for item in hidden.synthetic.instances if item.view == row]
        for row in (range(0, len(scene.views), setting.masks) if setting.masks else ())
    }
    return Known(cloud, MaskPropagator(scene, by_view, cloud))


def frame_outlines(
    hidden: HiddenObject, known: Sequence[Known], index: int, renderer: ObjectRenderer
) -> list[BoolArray]:
    """Our outline of the object in a frame, (h, w), then what we show of it, by what is known: twice each.

    The second of each two has edges that follow the picture.
    """
    view, row = hidden.view(index)
    outlines = [np.zeros((view.camera.height, view.camera.width), bool) for _ in range(2 * len(known) + 1)]
    box = object_box(view, hidden.body)
    if box is None:
        return outlines
    layer = object_layer(renderer, view, box)
    outlines[0][box.slices] = layer.alpha > 0.5
    for number, each in enumerate(known):
        front = visible_points(view, each.cloud, row)
        masks, support = each.carrier.masks(row, view), on_support(hidden.body, each.cloud, front)
        for guided, picture in enumerate((None, hidden.pictures[index][box.slices])):
            share = occluded_fraction(layer, box, view, masks, front, support, picture)[0]
            outlines[1 + 2 * number + guided][box.slices] = layer.alpha * (1 - share) > 0.5
    return outlines


def _edge_errors(ours: BoolArray, ours_whole: BoolArray, true: BoolArray, true_whole: BoolArray) -> FloatArray:
    """(n,) pixels from each pixel of a hiding edge, ours and the true one, to the nearest of the other's outline.

    ours, true : (h, w) what is seen of the object; the others : its outline without what hides it. A hiding edge is the
    border of what is seen against what is hidden; where the other has no edge there, its outline is what is nearest.
    """
    from scipy.ndimage import distance_transform_edt

    errors = []
    for seen, whole, other in ((true, true_whole, ours), (ours, ours_whole, true)):
        edge = _border(seen) & _grown(whole & ~seen) & ~_grown(~whole)
        border = _border(other)
        if edge.any():
            far = float(np.hypot(*seen.shape))
            distance = distance_transform_edt(~border) if border.any() else np.full(seen.shape, far)
            errors.append(np.asarray(distance)[edge])
    return np.concatenate(errors) if errors else np.zeros(0)


def _border(mask: BoolArray) -> BoolArray:
    """(h, w) pixels of a mask (h, w) with a neighbour outside it."""
    return np.asarray(mask & _grown(~mask))


def _grown(mask: BoolArray) -> BoolArray:
    import cv2

    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _summary(errors: Sequence[FloatArray], wrong: Sequence[float], hidden: Sequence[float]) -> dict[str, Any]:
    pixels = np.concatenate([np.zeros(0), *errors])
    return {
        "frames": len(wrong),
        "hidden": round(float(np.mean(hidden)), 2),
        "edge_px": round(float(pixels.mean()), 2),
        "edge_p90_px": round(float(np.quantile(pixels, 0.9)), 2),
        "worst_frame_px": round(max(float(each.mean()) for each in errors if len(each) > 30), 2),
        "wrong": round(float(np.mean(wrong)), 4),
    }


if __name__ == "__main__":
    main()
