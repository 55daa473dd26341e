"""Compare insertions with a path tracer: `python -m benchmarks.insertion.traced_room --set held --out DIR`.

Blender's Cycles renders furnished rooms without and with an object: fifteen rooms for tuning (sets `train` and `tune`)
and five held-out rooms (`held`). We insert the same object into the images without it, and compare its colour and
shadow with the images that contain it. Needs Blender (`METRIC_TREE_BLENDER`).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.insertion.traced_scene import FOCAL, ROOMS, SIZE, TO_JOB, VIEWS, TracedRoom, traced_images
from insertion.colour import luminance, srgb_to_linear
from insertion.exports.metric_frame import metric_transform, object_matrix
from insertion.insertion_scene import InsertionScene
from insertion.placement.at_pixel import plane_coordinates
from insertion.placement.free_space import free_positions
from insertion.placement.model_size import ModelSize
from insertion.placement.placed_object import PlacedObject, footprint
from insertion.request import ObjectRequest
from insertion.scene.camera_rays import camera_rays
from models3d.gltf.model_reader import read_model
from tests.synthetic.insertions import RecordedRoom, composite_into, place_in, prepared_scene_of, write_glb
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.world import Pinhole

#: Number of views that are traced with the object.
N_COMPARED_VIEWS = 2
#: Accepted ratios of the object's luminance and of its colour channels.
BRIGHTNESS_RANGE = (0.85, 1.15)
CHANNEL_RANGE = (0.8, 1.2)
#: Maximum angle between the shadows in degrees.
MAX_TURN_DEG = 25.0
#: Maximum difference between the fractions of light in the shadows.
MAX_DEPTH_DIFFERENCE = 0.25


def main() -> None:
    """Compare the rooms and print one line of JSON for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=ROOMS, default="tune", dest="rooms")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for index, room in enumerate(ROOMS[options.rooms]):
        record = compare(room, options.out / f"{options.rooms}{index}")
        print(json.dumps({"room": f"{options.rooms} {index}"} | record), flush=True)


def compare(room: TracedRoom, out: Path) -> dict[str, Any]:
    """Insert the object into a traced room, and compare with the views in which it is largest."""
    import cv2

    out.mkdir(parents=True, exist_ok=True)
    world = replace(
        furnished_room(room.kind, room.seed, Knobs(views=VIEWS, coverage=0.5)), camera=Pinhole(*SIZE, FOCAL)
    )
    synthetic = quick_scene(world, Knobs(depth_noise=0.004), room.seed)
    to_scene = similarity_between(
        np.array([pose.centre for pose in world.poses]), np.array([view.centre for view in synthetic.scene.views])
    )
    images = out / "images"
    images.mkdir(exist_ok=True)
    for row, image in enumerate(traced_images(world, room, range(VIEWS), out)):
        cv2.imwrite(str(images / f"frame{row:03d}.png"), image[..., ::-1])
    views = tuple(replace(view, name=f"{Path(view.name).stem}.png") for view in synthetic.scene.views)
    scene = replace(synthetic.scene, path=out, views=views)
    prepared = prepared_scene_of(RecordedRoom(world, scene, synthetic.instances, out, to_scene))
    placed = _placed(prepared, write_glb(solid(room.category, np.array(room.size)), out / "object.glb", room.colour))
    ours: list[NDArray[np.uint8]] = []
    results = composite_into(prepared, [placed], lambda _, image: ours.append(image))
    boxes = [frame.silhouette for frame in results[0].frames]
    heights = [
        0.0 if box is None else box[3] * frame.visible for box, frame in zip(boxes, results[0].frames, strict=True)
    ]
    rows = sorted(np.argsort(heights)[::-1][:N_COMPARED_VIEWS].tolist())
    truth = traced_images(world, room, rows, out, _object_in_world(placed, to_scene))
    return _compared(prepared, placed, rows, [ours[row] for row in rows], truth, out)


def _placed(prepared: InsertionScene, model: Path) -> PlacedObject:
    """Place the object at the best free position on the floor."""
    metres_per_unit = prepared.scale.metres_per_unit
    radius, height = footprint(read_model(model), ModelSize(1.0, "file"), metres_per_unit)
    position = next(free for free in free_positions(prepared.space, radius, height) if free.plane == 0)
    x, y = plane_coordinates(prepared.space, position) * prepared.scale.metres_per_unit
    return place_in(prepared, [ObjectRequest(model, plane=0, xy_m=(float(x), float(y)), facing=30.0)])[0]


def _object_in_world(placed: PlacedObject, to_scene: Similarity) -> dict[str, Any]:
    """Return the entry of the object in the tracer's job, with its pose in the synthetic world."""
    frame = metric_transform([placed])
    to_world = np.eye(4)  # from the metric frame of the insertion
    to_world[:3, :3] = to_scene.rotation.T @ frame.rotation.T
    to_world[:3, 3] = to_scene.inverse(frame.origin[None])[0]
    matrix = TO_JOB @ to_world @ object_matrix(placed, frame)
    return {"file": str(placed.request.model.resolve()), "matrix": matrix.tolist()}


def _compared(
    prepared: InsertionScene,
    placed: PlacedObject,
    rows: Sequence[int],
    ours: Sequence[NDArray[np.uint8]],
    truth: Sequence[NDArray[np.uint8]],
    out: Path,
) -> dict[str, Any]:
    """Compare our images with the truth: luminance, channels, light in the true shadow, directions of the shadows."""
    import cv2

    inside: list[list[NDArray[np.float32]]] = [[], []]
    dark: list[list[NDArray[np.float32]]] = [[], []]
    # sums of x, y and weight of the shadows' centres; views are weighted by the true shadow, since each shows a part
    sums = np.zeros((2, 3))
    for row, our_image, true_image in zip(rows, ours, truth, strict=True):
        bare, mask = prepared.images.image(row), _object_mask(prepared, placed, row)
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        outside = ~(cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
        ratios = [cv2.GaussianBlur(_ratio(image, bare), (0, 0), 1.0) for image in (our_image, true_image)]
        shaded = outside & (ratios[1] < 0.93)
        floor, near = _floor_positions(prepared, placed, row)
        darkness = [np.where(outside & near, np.maximum(1 - ratio - 0.04, 0.0), 0.0) for ratio in ratios]
        for k, image in enumerate((our_image, true_image)):
            inside[k].append(srgb_to_linear(image)[inner])
            dark[k].append(ratios[k][shaded])
            centre = (floor * darkness[k][..., None]).sum(axis=(0, 1)) / max(float(darkness[k].sum()), 1e-9)
            sums[k] += darkness[1].sum() * np.array([*centre, 1.0])
        cv2.imwrite(str(out / f"compare_{row:03d}.png"), np.hstack([bare, our_image, true_image])[..., ::-1])
    colours = [np.concatenate(part).mean(axis=0) for part in inside]
    depths = [float(np.concatenate(part).mean()) if sum(map(len, part)) > 20 else None for part in dark]
    centres = sums[:, :2] / np.maximum(sums[:, 2:], 1e-9)
    between = np.degrees(np.arctan2(centres[0, 1], centres[0, 0]) - np.arctan2(centres[1, 1], centres[1, 0]))
    turn = float(abs((between + 180) % 360 - 180)) if np.linalg.norm(centres[1]) > 0.15 else None
    brightness = float(luminance(colours[0]) / luminance(colours[1]))
    channels = [float(v) for v in colours[0] / colours[1]]
    return {
        "brightness": round(brightness, 2),
        "channels": [round(v, 2) for v in channels],
        "shadow_turn_deg": None if turn is None else round(turn),
        "shadow": [None if v is None else round(v, 2) for v in depths],
        "good": {
            "brightness": BRIGHTNESS_RANGE[0] <= brightness <= BRIGHTNESS_RANGE[1],
            "channels": all(CHANNEL_RANGE[0] <= v <= CHANNEL_RANGE[1] for v in channels),
            "turn": turn is None or turn <= MAX_TURN_DEG,
            "depth": depths[0] is None or depths[1] is None or abs(depths[0] - depths[1]) <= MAX_DEPTH_DIFFERENCE,
        },
    }


def _floor_positions(
    prepared: InsertionScene, placed: PlacedObject, row: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the position (h, w, 2) of each pixel on the floor, and whether it is close to the object (h, w).

    Positions are relative to the object's base, in heights of the object.
    """
    view, basis = prepared.scene.views[row], placed.placement.basis
    rays = np.dstack([camera_rays(view.camera), np.ones(SIZE[::-1])]) @ view.rotation @ basis.T
    start = basis @ (view.centre - placed.placement.position)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = start[:2] + rays[..., :2] * np.where(rays[..., 2] < 0, -start[2] / rays[..., 2], np.nan)[..., None]
    flat = np.nan_to_num(flat / (placed.size_m["height"] / prepared.scale.metres_per_unit), nan=1e6)
    return flat, np.asarray(np.linalg.norm(flat, axis=-1) < 2.5)


def _ratio(after: NDArray[np.uint8], before: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.asarray(
        (luminance(srgb_to_linear(after)) + 0.005) / (luminance(srgb_to_linear(before)) + 0.005), dtype=np.float32
    )


def _object_mask(prepared: InsertionScene, placed: PlacedObject, row: int) -> NDArray[np.bool_]:
    """Return the opaque pixels (h, w) of the object, from the outline of our renderer without occlusion."""
    from insertion.light.environment_map import HEIGHT, WIDTH, Environment
    from insertion.render.gpu import gl_context
    from insertion.render.layers import window_behind
    from insertion.render.renderer import ObjectRenderer
    from insertion.scene.pixel_box import PixelBox

    view = prepared.scene.views[row]
    ones = np.ones((HEIGHT, WIDTH, 3), np.float32)
    renderer = ObjectRenderer(gl_context(), placed.body, Environment(ones, placed.placement.basis, ones[..., 0]))
    window = window_behind(view.camera, PixelBox(0, 0, view.camera.width, view.camera.height))
    alpha = renderer.outline(window, view.rotation, view.translation, 1.0)
    y, x = -window.y0, -window.x0
    return np.asarray(alpha[y : y + SIZE[1], x : x + SIZE[0]] > 0.99)


if __name__ == "__main__":
    main()
