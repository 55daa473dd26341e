"""Insertion against a path tracer's truth: `python -m benchmarks.insertion.traced_room --set held --out DIR`.

Blender's Cycles renders furnished rooms without an object and with it: fifteen to tune with (sets `train` and `tune`)
and five that are held out (`held`). We insert the same object into the pictures without it, and compare colour and
shadow with those in which it really stands. Needs Blender (`METRIC_TREE_BLENDER`).
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

from benchmarks.insertion.traced_scene import FOCAL, ROOMS, SIZE, TO_JOB, VIEWS, TracedRoom, traced_pictures
from insertion.colour import luminance, srgb_to_linear
from insertion.exports.metric_frame import MetricTransform, metric_transform, object_matrix
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

#: Views in which the object is rendered as well.
JUDGED = 2
#: What is asked: brightness, each channel of it, degrees between the shadows, and their difference in depth.
BRIGHTNESS, CHANNEL, TURN_DEG, DEPTH = (0.85, 1.15), (0.8, 1.2), 25.0, 0.25


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=ROOMS, default="tune", dest="rooms")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for number, room in enumerate(ROOMS[options.rooms]):
        record = judge(room, options.out / f"{options.rooms}{number}")
        print(json.dumps({"room": f"{options.rooms} {number}"} | record), flush=True)


def judge(room: TracedRoom, out: Path) -> dict[str, Any]:
    """What is compared, over the judged views together."""
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
    for row, picture in enumerate(traced_pictures(world, room, range(VIEWS), out)):
        cv2.imwrite(str(images / f"frame{row:03d}.png"), picture[..., ::-1])
    views = tuple(replace(view, name=f"{Path(view.name).stem}.png") for view in synthetic.scene.views)
    scene = replace(synthetic.scene, path=out, views=views)
    prepared = prepared_scene_of(RecordedRoom(world, scene, synthetic.instances, out, to_scene))
    placed = _placed(prepared, write_glb(solid(room.category, np.array(room.size)), out / "object.glb", room.colour))
    ours: list[NDArray[np.uint8]] = []
    results = composite_into(prepared, [placed], lambda _, picture: ours.append(picture))
    boxes = [frame.silhouette for frame in results[0].frames]
    shown = [
        0.0 if box is None else box[3] * frame.visible for box, frame in zip(boxes, results[0].frames, strict=True)
    ]
    judged = sorted(np.argsort(shown)[::-1][:JUDGED].tolist())
    truth = traced_pictures(world, room, judged, out, _object_in_world(placed, prepared, to_scene))
    return _compared(prepared, placed, judged, [ours[row] for row in judged], truth, out)


def _placed(prepared: InsertionScene, model: Path) -> PlacedObject:
    """The object at the best free place of the floor."""
    metres_per_unit = prepared.scale.metres_per_unit
    radius, height = footprint(read_model(model), ModelSize(1.0, "file"), metres_per_unit)
    place = next(one for one in free_positions(prepared.space, radius, height) if one.plane == 0)
    x, y = plane_coordinates(prepared.space, place) * prepared.scale.metres_per_unit
    return place_in(prepared, [ObjectRequest(model, plane=0, xy_m=(float(x), float(y)), facing=30.0)])[0]


def _object_in_world(placed: PlacedObject, prepared: InsertionScene, to_scene: Similarity) -> dict[str, Any]:
    """The object of a tracer's job, where it stands in the synthetic world."""
    frame = metric_transform([placed], prepared.scale.metres_per_unit)
    matrix = TO_JOB @ _to_world(frame, to_scene) @ object_matrix(placed, frame)
    return {"file": str(placed.request.model.resolve()), "matrix": matrix.tolist()}


def _to_world(frame: MetricTransform, to_scene: Similarity) -> NDArray[np.float64]:
    """(4, 4) from the metric frame of the insertion to the synthetic world."""
    matrix = np.eye(4)
    matrix[:3, :3] = to_scene.rotation.T @ frame.rotation.T
    matrix[:3, 3] = to_scene.inverse(frame.origin[None])[0]
    return matrix


def _compared(
    prepared: InsertionScene,
    placed: PlacedObject,
    rows: Sequence[int],
    ours: Sequence[NDArray[np.uint8]],
    truth: Sequence[NDArray[np.uint8]],
    out: Path,
) -> dict[str, Any]:
    """Ours over the truth: brightness, channels, light in the true shadow, the ways of the shadows over the floor."""
    import cv2

    inside: list[list[NDArray[np.float32]]] = [[], []]
    dark: list[list[NDArray[np.float32]]] = [[], []]
    ways = np.zeros((2, 3))  # sums of x, y and weight; each view sees another part of a shadow and has its true weight
    for row, one, two in zip(rows, ours, truth, strict=True):
        bare, mask = prepared.stills.image(row), _object_mask(prepared, placed, row)
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        outside = ~(cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
        ratios = [cv2.GaussianBlur(_ratio(picture, bare), (0, 0), 1.0) for picture in (one, two)]
        shaded = outside & (ratios[1] < 0.93)
        floor, near = _floor_places(prepared, placed, row)
        floors = [np.where(outside & near, np.maximum(1 - ratio - 0.04, 0.0), 0.0) for ratio in ratios]
        for k, picture in enumerate((one, two)):
            inside[k].append(srgb_to_linear(picture)[inner])
            dark[k].append(ratios[k][shaded])
            middle = (floor * floors[k][..., None]).sum(axis=(0, 1)) / max(float(floors[k].sum()), 1e-9)
            ways[k] += floors[1].sum() * np.array([*middle, 1.0])
        cv2.imwrite(str(out / f"compare_{row:03d}.png"), np.hstack([bare, one, two])[..., ::-1])
    colours = [np.concatenate(part).mean(axis=0) for part in inside]
    depths = [float(np.concatenate(part).mean()) if sum(map(len, part)) > 20 else None for part in dark]
    middles = ways[:, :2] / np.maximum(ways[:, 2:], 1e-9)
    between = np.degrees(np.arctan2(middles[0, 1], middles[0, 0]) - np.arctan2(middles[1, 1], middles[1, 0]))
    turn = float(abs((between + 180) % 360 - 180)) if np.linalg.norm(middles[1]) > 0.15 else None
    brightness = float(luminance(colours[0]) / luminance(colours[1]))
    channels = [float(v) for v in colours[0] / colours[1]]
    return {
        "brightness": round(brightness, 2),
        "channels": [round(v, 2) for v in channels],
        "shadow_turn_deg": None if turn is None else round(turn),
        "shadow": [None if v is None else round(v, 2) for v in depths],
        "good": {
            "brightness": BRIGHTNESS[0] <= brightness <= BRIGHTNESS[1],
            "channels": all(CHANNEL[0] <= v <= CHANNEL[1] for v in channels),
            "turn": turn is None or turn <= TURN_DEG,
            "depth": depths[0] is None or depths[1] is None or abs(depths[0] - depths[1]) <= DEPTH,
        },
    }


def _floor_places(
    prepared: InsertionScene, placed: PlacedObject, row: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(h, w, 2) place of each pixel on the floor about the object's foot in its heights, and whether it is near."""
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
    """Pixels of the object that nothing hides, by our own renderer's outline."""
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
