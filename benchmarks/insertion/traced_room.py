"""Insertion against a path tracer's truth: `python -m benchmarks.insertion.traced_room --room lamp --out DIR`.

Blender's Cycles renders a furnished room without an object and with it. We insert the same object into the pictures
without it, and compare colour, shadow and outline with those in which it really stands. Needs Blender
(`METRIC_TREE_BLENDER`); about 20 s of CPU a picture.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import View
from insertion.blender.process import run_blender
from insertion.colour.encoding import linear_to_srgb, luminance, srgb_to_linear
from insertion.exports.metric_frame import MetricFrame, metric_frame, object_matrix
from insertion.footage.footage import PictureFootage, Stills
from insertion.models.gltf import read_model
from insertion.models.size import Size
from insertion.pipeline.frames import insert_objects
from insertion.pipeline.objects import Placed
from insertion.pipeline.request import ObjectRequest
from insertion.pipeline.stage import Stage, make_stage
from insertion.placement.place import Place
from insertion.render.body import body_of
from insertion.scene.scale import ScaleUsed
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.materials import look_of
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.solids import Mesh, join
from tests.synthetic.rooms.world import Pinhole, World

SIZE, FOCAL = (240, 180), 187.5
SAMPLES = 24
#: Views of a room, and those in which the object is rendered as well.
VIEWS, JUDGED = 8, 3
#: Mean luminance of the pictures: what a camera's own exposure aims at.
EXPOSED = 0.18


@dataclass(frozen=True, slots=True)
class TracedRoom:
    """A synthetic room under square area lights: side (m), watts, place (x, y, z with z up), what it shines at.

    place : x, y on the floor in metres and the heading in degrees of the object; colours : linear, of the lights, white
    without.
    """

    kind: str
    seed: int
    place: tuple[float, float, float]
    lights: tuple[tuple[float, float, tuple[float, float, float], tuple[float, float, float]], ...]
    colours: tuple[tuple[float, float, float], ...] = ()


#: The last two, with coloured lamps, are held out: no constant was chosen with them in view.
ROOMS = {
    "lamp": TracedRoom("sitting room", 1001, (1.761, 0.986, -160.64), ((0.5, 45.0, (0.6, -0.4, 2.5), (0.5, -0.3,
        0.0)),)),
    "day": TracedRoom("kitchen", 1002, (1.41, 1.533, -150.62), ((1.3, 110.0, (-2.4, -0.5, 1.6), (1.0, 0.3, 0.4)),
        (2.0, 8.0, (0.0, 0.0, 2.5), (0.0, 0.0, 0.0)))),
    "two lamps": TracedRoom("study", 1004, (0.328, 1.593, -87.0), ((0.4, 35.0, (-1.3, 0.9, 2.5), (-1.2, 0.8, 0.0)),
        (0.4, 20.0, (1.4, -0.9, 2.5), (1.3, -0.8, 0.0)))),
    "panels": TracedRoom("study", 1012, (-0.97, 0.78, -70.0), ((0.6, 22.0, (-1.2, 0.3, 2.55), (-1.2, 0.3, 0.0)),
        (0.6, 22.0, (1.2, 0.3, 2.55), (1.2, 0.3, 0.0)))),
    "held out": TracedRoom("bedroom", 1006, (0.3, 0.6, -90.0), ((1.2, 60.0, (2.6, 0.3, 1.5), (-1.0, 0.0, 0.3)),
        (0.3, 16.0, (-1.4, 1.2, 2.3), (-1.2, 1.0, 0.0)))),
    "uplight": TracedRoom("bedroom", 1013, (-0.45, 0.3, -60.0), ((0.3, 45.0, (-2.3, -2.1, 1.7), (-2.2, -2.0, 2.6)),
        (0.2, 8.0, (2.3, 1.9, 1.1), (0.0, 0.0, 0.5)))),
    "window": TracedRoom("sitting room", 1014, (0.05, 1.2, -120.0), ((1.5, 90.0, (-2.6, 0.8, 1.5), (1.0, -0.2,
        0.6)),)),
    "floor lamp": TracedRoom("sitting room", 1021, (0.88, 1.58, -120.0), ((0.35, 18.0, (1.6, 2.1, 1.5), (1.2, 1.6,
        0.0)), (0.8, 14.0, (-0.8, -0.4, 2.55), (-0.8, -0.4, 0.0))), ((1.0, 0.85, 0.62), (1.0, 1.0, 1.0))),
    "window and lamp": TracedRoom("bedroom", 1022, (-0.62, 1.18, -60.0), ((1.4, 80.0, (2.6, -0.6, 1.5), (-1.0, 0.2,
        0.6)), (0.4, 22.0, (0.2, 0.1, 2.5), (0.2, 0.1, 0.0))), ((0.82, 0.92, 1.0), (1.0, 0.88, 0.72))),
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--room", choices=ROOMS, default="lamp")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    room = ROOMS[options.room]
    world = _world(room, VIEWS)
    made = quick_scene(world, Knobs(depth_noise=0.004), room.seed)
    to_scene = similarity_between(
        np.array([pose.centre for pose in world.poses]), np.array([view.centre for view in made.scene.views])
    )
    _bare_pictures(world, room, options.out)
    stage = _stage(made, to_scene, options.out)
    model = write_glb(solid("chair", np.array([0.42, 0.38, 0.75])), options.out / "chair.glb", (0.6, 0.25, 0.12))
    placed = _placed(stage, model, room, to_scene)
    ours: list[NDArray[np.uint8]] = []
    results = insert_objects(stage, [placed], lambda _, picture: ours.append(picture))
    order = [k for k, frame in enumerate(results[0].frames) if frame.silhouette is not None and frame.visible > 0.9]
    judged = order[:: max(1, len(order) // JUDGED)][:JUDGED]
    truth = _true_pictures(world, room, options.out, stage, placed, to_scene, judged)
    records = [_compare(stage, placed, row, ours[row], truth[number], options.out) for number, row in enumerate(judged)]
    (options.out / "records.jsonl").write_text("".join(json.dumps(record) + "\n" for record in records))


def _world(room: TracedRoom, views: int) -> World:
    world = furnished_room(room.kind, room.seed, Knobs(views=views, coverage=0.7))
    return replace(world, camera=Pinhole(*SIZE, FOCAL))


def _room_files(world: World, folder: Path) -> list[dict[str, Any]]:
    """One GLB for each material of each thing: plain colours."""
    rows = []
    for number, mesh in enumerate([world.surfaces, *(thing.mesh for thing in world.objects)]):
        for name in sorted(set(mesh.material)):
            chosen = np.array([material == name for material in mesh.material])
            part = Mesh(mesh.vertices, mesh.faces[chosen], (name,) * int(chosen.sum()))
            colour = srgb_to_linear(np.rint(255 * look_of(name, number, world.seed, 1.0)[:3]).astype(np.uint8))
            file = folder / f"room_{number}_{name}.glb"
            # `write_glb` turns z up into y up
            write_glb(join([part]), file, (float(colour[0]), float(colour[1]), float(colour[2])))
            rows.append({"file": str(file.resolve()), "matrix": np.eye(4).tolist()})
    return rows


def _job(
    world: World, room: TracedRoom, rows: Sequence[int], objects: list[dict[str, Any]], out: Path
) -> dict[str, Any]:
    return {
        "objects": objects,
        "lights": [
            {**_light(*stated), "colour": colour}
            for stated, colour in zip(room.lights, room.colours or [(1.0, 1.0, 1.0)] * len(room.lights), strict=True)
        ],
        "environment": None,
        "window": {"width": SIZE[0], "height": SIZE[1], "fx": FOCAL, "fy": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2},
        "keys": [
            {"stem": f"{row:06d}", "time_s": float(row), "matrix": _camera_matrix(world, row).tolist()} for row in rows
        ],
        "samples": SAMPLES,
        "transparent": False,
        "out": str(out.resolve()),
    }


#: From the synthetic world (z up) to the job's frame (y up), as `write_glb` turns it.
TO_JOB = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


def _light(side: float, watts: float, place: tuple[float, ...], target: tuple[float, ...]) -> dict[str, Any]:
    back = np.array(place) - np.array(target)
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0] if abs(back[2]) > 0.9 else [0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    matrix[:3, 3] = place
    return {"size": side, "power": watts, "matrix": (TO_JOB @ matrix).tolist()}


def _camera_matrix(world: World, row: int) -> NDArray[np.float64]:
    pose = world.poses[row]
    matrix = np.eye(4)
    matrix[:3, :3] = pose.rotation.T @ np.diag([1.0, -1.0, -1.0])
    matrix[:3, 3] = pose.centre
    return np.asarray(TO_JOB @ matrix)


def _bare_pictures(world: World, room: TracedRoom, out: Path) -> None:
    """The pictures without the object, kept from run to run."""
    import cv2

    images, traced = out / "images", out / "bare"
    traced.mkdir(exist_ok=True)
    images.mkdir(exist_ok=True)
    rows = [k for k in range(len(world.poses)) if not (traced / f"{k:06d}.npy").is_file()]
    if rows:
        run_blender(_job(world, room, rows, _room_files(world, out), traced), out)
    for k in range(len(world.poses)):
        cv2.imwrite(str(images / f"frame{k:03d}.png"), _developed(traced / f"{k:06d}.npy", out)[..., ::-1])


def _developed(file: Path, out: Path) -> NDArray[np.uint8]:
    """A traced picture as the camera would store it, at one exposure for the whole room."""
    bare = [luminance(np.load(other)[..., :3].astype(np.float32)).mean() for other in sorted((out / "bare").iterdir())]
    linear = np.load(file)[..., :3].astype(np.float32)
    return np.rint(linear_to_srgb(linear * EXPOSED / np.mean(bare))).astype(np.uint8)


def _stage(made: SyntheticScene, to_scene: Similarity, out: Path) -> Stage:
    views = tuple(_named(view) for view in made.scene.views)
    scene = replace(made.scene, path=out, views=views)
    stills = Stills(scene)
    scale = ScaleUsed(1 / to_scene.scale, None, None, "option")
    return make_stage(scene, stills, PictureFootage(stills), made.instances, scale)


def _placed(stage: Stage, model: Path, room: TracedRoom, to_scene: Similarity) -> Placed:
    """The object on the floor where the room says, whatever the places that are free."""
    x, y, turn = room.place
    floor = stage.supports.surfaces[0].plane
    position = to_scene(np.array([[x, y, 0.0]]))[0]
    position = position + (floor.height - position @ floor.basis[2]) * floor.basis[2]
    front = to_scene.rotation @ [np.cos(np.radians(turn)), np.sin(np.radians(turn)), 0.0]
    front = front - (front @ floor.basis[2]) * floor.basis[2]
    place = Place(position, floor.basis, stage.scene.views[0].centre, "floor", 0)
    chair, size = read_model(model), Size(1.0, "file")
    body = body_of(chair, position, floor.basis, front / np.linalg.norm(front), 1 / stage.scale.metres_per_unit)
    return Placed(ObjectRequest(model), chair, size, place, front / np.linalg.norm(front), turn, body)


def _named(view: View) -> View:
    return replace(view, name=f"{Path(view.name).stem}.png")


def _true_pictures(
    world: World, room: TracedRoom, out: Path, stage: Stage, placed: Placed, to_scene: Similarity, rows: Sequence[int]
) -> list[NDArray[np.uint8]]:
    """The pictures with the object in the room."""
    frame = metric_frame([placed], stage.scale.metres_per_unit)
    matrix = _to_world(frame, to_scene) @ object_matrix(placed, frame)
    traced = out / "with"
    traced.mkdir(exist_ok=True)
    item = {"file": str(placed.request.model.resolve()), "matrix": (TO_JOB @ matrix).tolist()}
    missing = [k for k in rows if not (traced / f"{k:06d}.npy").is_file()]
    if missing:
        run_blender(_job(world, room, missing, [*_room_files(world, out), item], traced), out)
    return [_developed(traced / f"{k:06d}.npy", out) for k in rows]


def _to_world(frame: MetricFrame, to_scene: Similarity) -> NDArray[np.float64]:
    """(4, 4) from the metric frame of the insertion to the synthetic world."""
    matrix = np.eye(4)
    matrix[:3, :3] = to_scene.rotation.T @ frame.rotation.T
    matrix[:3, 3] = to_scene.inverse(frame.origin[None])[0]
    return matrix


def _compare(
    stage: Stage, placed: Placed, row: int, ours: NDArray[np.uint8], truth: NDArray[np.uint8], out: Path
) -> dict[str, Any]:
    import cv2

    bare = stage.stills.picture(row)
    ratio = _ratio(truth, bare)
    mask = _object_mask(stage, placed, row)
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    outside = ~(cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
    dark = outside & (cv2.GaussianBlur(ratio, (0, 0), 2.0) < 0.93)
    ours_ratio = _ratio(ours, bare)
    linear_ours, linear_true = (
        luminance(srgb_to_linear(ours))[inner].mean(),
        luminance(srgb_to_linear(truth))[inner].mean(),
    )
    record = {
        "view": row,
        "object_pixels": int(inner.sum()),
        "mean_abs_srgb": round(float(np.abs(ours.astype(float) - truth)[inner].mean()), 1),
        "mean_srgb_ours": [round(float(v), 1) for v in ours[inner].mean(axis=0)],
        "mean_srgb_true": [round(float(v), 1) for v in truth[inner].mean(axis=0)],
        "luminance_ratio": round(float(linear_ours / linear_true), 3),
        "shadow_true": round(float(ratio[dark].mean()), 3) if dark.any() else None,
        "shadow_ours": round(float(ours_ratio[dark].mean()), 3) if dark.any() else None,
        "shadow_pixels": int(dark.sum()),
    }
    print(json.dumps(record))
    cv2.imwrite(str(out / f"compare_{row:03d}.png"), np.hstack([bare, ours, truth])[..., ::-1])
    return record


def _ratio(after: NDArray[np.uint8], before: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.asarray(
        (luminance(srgb_to_linear(after)) + 0.005) / (luminance(srgb_to_linear(before)) + 0.005), dtype=np.float32
    )


def _object_mask(stage: Stage, placed: Placed, row: int) -> NDArray[np.bool_]:
    """Pixels of the object that nothing hides, by our own renderer's outline."""
    from insertion.light.environment import HEIGHT, WIDTH, Environment
    from insertion.render.boxes import window_behind
    from insertion.render.context import gl_context
    from insertion.render.renderer import ObjectRenderer
    from insertion.scene.box import Box

    view = stage.scene.views[row]
    ones = np.ones((HEIGHT, WIDTH, 3), np.float32)
    renderer = ObjectRenderer(gl_context(), placed.body, Environment(ones, placed.place.basis, ones[..., 0]))
    window = window_behind(view.camera, Box(0, 0, view.camera.width, view.camera.height))
    alpha = renderer.outline(window, view.rotation, view.translation, 1.0)
    y, x = -window.y0, -window.x0
    return np.asarray(alpha[y : y + SIZE[1], x : x + SIZE[0]] > 0.99)


if __name__ == "__main__":
    main()
