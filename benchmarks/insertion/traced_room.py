"""Insertion against a path tracer's truth: `python -m benchmarks.insertion.traced_room --set held --out DIR`.

Blender's Cycles renders furnished rooms without an object and with it: fifteen to tune with (sets `train` and `tune`)
and five that are held out (`held`). We insert the same object into the pictures without it, and compare colour and
shadow with those in which it really stands. Needs Blender (`METRIC_TREE_BLENDER`).
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
from insertion.exports.glb import Glb
from insertion.exports.metric_frame import MetricFrame, metric_frame, object_matrix
from insertion.footage.footage import PictureFootage, Stills
from insertion.models.gltf import read_model
from insertion.models.size import SizeUsed
from insertion.pipeline.frames import insert_objects
from insertion.pipeline.objects import Placed, place_objects, space_for
from insertion.pipeline.prepared_scene import PreparedScene, prepare_scene
from insertion.pipeline.request import ObjectRequest
from insertion.placement.free_space import candidates
from insertion.placement.locate import plane_coordinates
from insertion.scene.rays import camera_rays
from insertion.scene.scale import ScaleUsed
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.materials import look_of
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import Pinhole, World

SIZE, FOCAL = (192, 144), 150.0
SAMPLES = 16
#: Views of a room, and those in which the object is rendered as well.
VIEWS, JUDGED = 6, 2
#: Mean luminance of the pictures: what a camera's own exposure aims at.
EXPOSED = 0.18
#: Metres of a texture's tile.
TILE_M = 1.5
#: What is asked: brightness, each channel of it, degrees between the shadows, and their difference in depth.
BRIGHTNESS, CHANNEL, TURN_DEG, DEPTH = (0.85, 1.15), (0.8, 1.2), 25.0, 0.25
WHITE, WARM, COOL = (1.0, 1.0, 1.0), (1.0, 0.8, 0.55), (0.8, 0.9, 1.0)


@dataclass(frozen=True, slots=True)
class TracedRoom:
    """A synthetic room.

    lamps : kind and linear colour of each, their places by the seed; object, size, colour : the object, its metres and
    its linear colour; pattern : of the textures.
    """

    kind: str
    seed: int
    lamps: tuple[tuple[str, tuple[float, float, float]], ...]
    category: str
    size: tuple[float, float, float]
    colour: tuple[float, float, float]
    pattern: str


ROOMS = {
    "train": (
        TracedRoom("bedroom", 3301, (("bulb", WHITE),), "suitcase", (0.5, 0.3, 0.6), (0.45, 0.4, 0.35), "plain"),
        TracedRoom(
            "study", 3302, (("window", COOL), ("bulb", WARM)), "chair", (0.45, 0.45, 0.85), (0.3, 0.3, 0.32), "checks"
        ),
        TracedRoom(
            "sitting room", 3303, (("panel", WHITE), ("panel", WHITE)), "stool", (0.4, 0.4, 0.5), (0.5, 0.15, 0.1),
            "stripes",
        ),
        TracedRoom("kitchen", 3304, (("bulb", WARM),), "book", (0.35, 0.35, 0.35), (0.6, 0.6, 0.6), "grain"),
        TracedRoom("sitting room", 3305, (("floor lamp", WHITE),), "vase", (0.3, 0.3, 0.5), (0.2, 0.3, 0.5), "checks"),
        TracedRoom(
            "bedroom", 3306, (("window", WHITE), ("uplight", WARM)), "office chair", (0.6, 0.6, 0.95), (0.1, 0.1, 0.12),
            "plain",
        ),
        TracedRoom(
            "study", 3307, (("panel", COOL), ("bulb", WHITE)), "bowl", (0.5, 0.5, 0.3), (0.6, 0.55, 0.5), "grain"
        ),
        TracedRoom("kitchen", 3308, (("window", WHITE),), "stool", (0.4, 0.4, 0.5), (0.5, 0.4, 0.15), "stripes"),
        TracedRoom(
            "bedroom", 3309, (("bulb", WHITE), ("bulb", WHITE), ("floor lamp", WARM)), "chair", (0.42, 0.38, 0.75),
            (0.2, 0.4, 0.2), "stripes",
        ),
        TracedRoom("sitting room", 3310, (("panel", WARM),), "suitcase", (0.5, 0.25, 0.7), (0.5, 0.5, 0.48), "checks"),
    ),
    "tune": (
        TracedRoom(
            "sitting room", 2101, (("bulb", WHITE),), "chair", (0.42, 0.38, 0.75), (0.6, 0.25, 0.12), "plain"
        ),
        TracedRoom(
            "kitchen", 2102, (("window", COOL), ("panel", WHITE)), "book", (0.4, 0.4, 0.4), (0.5, 0.5, 0.5), "grain"
        ),
        TracedRoom(
            "study", 2103, (("floor lamp", WARM), ("panel", WHITE)), "vase", (0.3, 0.3, 0.5), (0.7, 0.7, 0.68), "plain"
        ),
        TracedRoom(
            "bedroom", 2104, (("bulb", WHITE), ("bulb", WARM)), "stool", (0.4, 0.4, 0.5), (0.12, 0.2, 0.5), "grain"
        ),
        TracedRoom(
            "sitting room", 2105, (("window", WHITE),), "suitcase", (0.5, 0.25, 0.7), (0.1, 0.35, 0.15), "grain"
        ),
    ),
    "held": (
        TracedRoom("study", 2206, (("panel", WARM),), "chair", (0.45, 0.45, 0.85), (0.6, 0.25, 0.12), "stripes"),
        TracedRoom(
            "sitting room", 2207, (("bulb", WHITE), ("window", COOL)), "book", (0.3, 0.3, 0.3), (0.5, 0.5, 0.5),
            "checks",
        ),
        TracedRoom(
            "bedroom", 2208, (("panel", WHITE), ("panel", WARM)), "bowl", (0.5, 0.5, 0.3), (0.7, 0.6, 0.5), "stripes"
        ),
        TracedRoom(
            "kitchen", 2209, (("floor lamp", WHITE), ("uplight", WARM)), "office chair", (0.6, 0.6, 0.95),
            (0.4, 0.05, 0.08), "checks",
        ),
        TracedRoom(
            "study", 2210, (("bulb", WARM), ("bulb", WARM), ("bulb", WARM)), "suitcase", (0.55, 0.3, 0.75),
            (0.15, 0.35, 0.3), "checks",
        ),
    ),
}  # fmt: skip


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=ROOMS, default="tune", dest="rooms")
    parser.add_argument("--room", type=int, help="only this one, from 0")
    parser.add_argument("--trace-only", action="store_true", help="trace the pictures without the object, no more")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for number, room in enumerate(ROOMS[options.rooms]):
        if options.room in (None, number):
            record = judge(room, options.out / f"{options.rooms}{number}", options.trace_only)
            if record:
                print(json.dumps({"room": f"{options.rooms} {number}"} | record), flush=True)


def judge(room: TracedRoom, out: Path, trace_only: bool) -> dict[str, Any]:
    """What is compared, over the judged views together; empty where the pictures are only traced."""
    out.mkdir(parents=True, exist_ok=True)
    world = replace(
        furnished_room(room.kind, room.seed, Knobs(views=VIEWS, coverage=0.5)), camera=Pinhole(*SIZE, FOCAL)
    )
    made = quick_scene(world, Knobs(depth_noise=0.004), room.seed)
    to_scene = similarity_between(
        np.array([pose.centre for pose in world.poses]), np.array([view.centre for view in made.scene.views])
    )
    _bare_pictures(world, room, out)
    if trace_only:
        return {}
    prepared = _prepared(made, to_scene, out)
    placed = _placed(prepared, write_glb(solid(room.category, np.array(room.size)), out / "object.glb", room.colour))
    ours: list[NDArray[np.uint8]] = []
    results = insert_objects(prepared, [placed], lambda _, picture: ours.append(picture))
    boxes = [frame.silhouette for frame in results[0].frames]
    shown = [
        0.0 if box is None else box[3] * frame.visible for box, frame in zip(boxes, results[0].frames, strict=True)
    ]
    judged = sorted(np.argsort(shown)[::-1][:JUDGED].tolist())
    truth = _true_pictures(world, room, out, prepared, placed, to_scene, judged)
    return _compared(prepared, placed, judged, [ours[row] for row in judged], truth, out)


def _room_files(world: World, room: TracedRoom, folder: Path) -> list[dict[str, Any]]:
    """One GLB for each material of each object, with a texture of two of its colours."""
    rows = []
    for number, mesh in enumerate([world.surfaces, *(item.mesh for item in world.objects)]):
        for name in sorted(set(mesh.material)):
            file = folder / f"room_{number}_{name}.glb"
            chosen = np.array([material == name for material in mesh.material])
            look = look_of(name, number, world.seed, 1.0)
            _write_part(mesh, mesh.faces[chosen], _texture(look, room.pattern, number), file)
            rows.append({"file": str(file.resolve()), "matrix": np.eye(4).tolist()})
    return rows


def _texture(look: NDArray[np.float64], pattern: str, number: int) -> NDArray[np.uint8]:
    """(64, 64, 4) sRGB tile of the two colours of a look."""
    y, x = np.mgrid[:64, :64]
    grain = np.random.default_rng(number).uniform(0, 1, (16, 16)).repeat(4, 0).repeat(4, 1)
    share = {
        "plain": np.zeros((64, 64)), "grain": 0.6 * grain, "stripes": 1.0 * ((x // 8) % 2), "checks":
        0.9 * ((x // 16 + y // 16) % 2),
    }[pattern]  # fmt: skip
    colour = (1 - share)[..., None] * look[:3] + share[..., None] * look[3:6]
    return np.dstack([np.rint(255 * colour), np.full((64, 64), 255)]).astype(np.uint8)


def _write_part(mesh: Mesh, faces: NDArray[np.int64], texture: NDArray[np.uint8], file: Path) -> None:
    """Faces of a mesh (z up) as a GLB file (y up), its texture laid on along the axis that each face looks along."""
    corners = mesh.vertices[faces]  # (m, 3, 3)
    across = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).argmax(axis=1)
    axes = np.array([[1, 2], [0, 2], [0, 1]])[across]  # (m, 2)
    uv = np.take_along_axis(corners, axes[:, None, :].repeat(3, axis=1), axis=2) / TILE_M
    document = Glb("traced room")
    surface = {"baseColorTexture": {"index": document.add_texture(texture)}, "metallicFactor": 0.0}
    document.add("materials", {"pbrMetallicRoughness": surface | {"roughnessFactor": 0.9}, "doubleSided": True})
    attributes = {
        "POSITION": document.add_values(corners.reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1], limits=True),
        "TEXCOORD_0": document.add_values(uv.reshape(-1, 2)),
    }
    document.add("meshes", {"primitives": [{"attributes": attributes, "material": 0}]})
    file.write_bytes(document.data([document.add("nodes", {"mesh": 0})]))


def _lights(room: TracedRoom, world: World) -> list[dict[str, Any]]:
    """Square area lights of the job: side in metres, watts, place and what they shine at, by the kind of each lamp."""
    generator = np.random.default_rng(room.seed)
    low, high = world.surfaces.vertices.min(axis=0) + 0.15, world.surfaces.vertices.max(axis=0) - 0.15
    rows = []
    for kind, colour in room.lamps:
        x, y = generator.uniform(0.6 * low[:2], 0.6 * high[:2])
        corner = np.where(generator.random(2) < 0.5, low[:2], high[:2]) * 0.9
        side = np.array([low[0] if generator.random() < 0.5 else high[0], y])
        strength = generator.uniform(0.8, 1.25)
        size, watts, place, target = {
            "bulb": (0.2, 40.0, (x, y, high[2] - 0.1), (x, y, 0.0)),
            "panel": (1.0, 40.0, (x, y, high[2]), (x, y, 0.0)),
            "window": (1.3, 90.0, (*side, 1.5), (0.0, y, 0.6)),
            "floor lamp": (0.3, 45.0, (*corner, 1.6), (0.0, 0.0, 0.4)),
            "uplight": (0.3, 30.0, (*-corner, 1.7), (*-0.9 * corner, 2.6)),
        }[kind]
        rows.append({**_light(size, watts * strength, place, target), "colour": colour})
    return rows


def _job(
    world: World, room: TracedRoom, rows: Sequence[int], objects: list[dict[str, Any]], out: Path
) -> dict[str, Any]:
    return {
        "objects": objects,
        "lights": _lights(room, world),
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
        run_blender(_job(world, room, rows, _room_files(world, room, out), traced), out)
    for k in range(len(world.poses)):
        cv2.imwrite(str(images / f"frame{k:03d}.png"), _developed(traced / f"{k:06d}.npy", out)[..., ::-1])


def _developed(file: Path, out: Path) -> NDArray[np.uint8]:
    """A traced picture as the camera would store it, at one exposure for the whole room."""
    bare = [luminance(np.load(other)[..., :3].astype(np.float32)).mean() for other in sorted((out / "bare").iterdir())]
    linear = np.load(file)[..., :3].astype(np.float32)
    return np.rint(linear_to_srgb(linear * EXPOSED / np.mean(bare))).astype(np.uint8)


def _prepared(made: SyntheticScene, to_scene: Similarity, out: Path) -> PreparedScene:
    views = tuple(_named(view) for view in made.scene.views)
    scene = replace(made.scene, path=out, views=views)
    stills = Stills(scene)
    scale = ScaleUsed(1 / to_scene.scale, None, None, "option")
    return prepare_scene(scene, stills, PictureFootage(stills), made.instances, scale)


def _placed(prepared: PreparedScene, model: Path) -> Placed:
    """The object at the best free place of the floor."""
    space = space_for(prepared, read_model(model), SizeUsed(1.0, "file"))
    place = next(one for one in candidates(space) if one.plane == 0)
    x, y = plane_coordinates(space, place) * prepared.scale.metres_per_unit
    return place_objects(prepared, [ObjectRequest(model, plane=0, xy_m=(float(x), float(y)), facing=30.0)])[0]


def _named(view: View) -> View:
    return replace(view, name=f"{Path(view.name).stem}.png")


def _true_pictures(
    world: World,
    room: TracedRoom,
    out: Path,
    prepared: PreparedScene,
    placed: Placed,
    to_scene: Similarity,
    rows: Sequence[int],
) -> list[NDArray[np.uint8]]:
    """The pictures with the object in the room."""
    frame = metric_frame([placed], prepared.scale.metres_per_unit)
    matrix = _to_world(frame, to_scene) @ object_matrix(placed, frame)
    traced = out / "with"
    traced.mkdir(exist_ok=True)
    item = {"file": str(placed.request.model.resolve()), "matrix": (TO_JOB @ matrix).tolist()}
    missing = [k for k in rows if not (traced / f"{k:06d}.npy").is_file()]
    if missing:
        run_blender(_job(world, room, missing, [*_room_files(world, room, out), item], traced), out)
    return [_developed(traced / f"{k:06d}.npy", out) for k in rows]


def _to_world(frame: MetricFrame, to_scene: Similarity) -> NDArray[np.float64]:
    """(4, 4) from the metric frame of the insertion to the synthetic world."""
    matrix = np.eye(4)
    matrix[:3, :3] = to_scene.rotation.T @ frame.rotation.T
    matrix[:3, 3] = to_scene.inverse(frame.origin[None])[0]
    return matrix


def _compared(
    prepared: PreparedScene,
    placed: Placed,
    rows: Sequence[int],
    ours: Sequence[NDArray[np.uint8]],
    truth: Sequence[NDArray[np.uint8]],
    out: Path,
) -> dict[str, Any]:
    """Ours over the truth: brightness, channels, light in the true shadow, the ways of the shadows over the floor."""
    import cv2

    inside: list[list[NDArray[np.float32]]] = [[], []]
    dark: list[list[NDArray[np.float32]]] = [[], []]
    ways = np.zeros((2, 3))  # sums of x, y and weight
    for row, one, two in zip(rows, ours, truth, strict=True):
        bare, mask = prepared.stills.picture(row), _object_mask(prepared, placed, row)
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        outside = ~(cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
        ratios = [cv2.GaussianBlur(_ratio(picture, bare), (0, 0), 1.0) for picture in (one, two)]
        shaded = outside & (ratios[1] < 0.93)
        floor, near = _floor_places(prepared, placed, row)
        for k, picture in enumerate((one, two)):
            inside[k].append(srgb_to_linear(picture)[inner])
            dark[k].append(ratios[k][shaded])
            weight = np.where(outside & near, np.maximum(1 - ratios[k] - 0.04, 0.0), 0.0)
            ways[k] += [*(floor * weight[..., None]).sum(axis=(0, 1)), weight.sum()]
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


def _floor_places(prepared: PreparedScene, placed: Placed, row: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(h, w, 2) place of each pixel on the floor about the object's foot in its heights, and whether it is near."""
    view, basis = prepared.scene.views[row], placed.place.basis
    rays = np.dstack([camera_rays(view.camera), np.ones(SIZE[::-1])]) @ view.rotation @ basis.T
    start = basis @ (view.centre - placed.place.position)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = start[:2] + rays[..., :2] * np.where(rays[..., 2] < 0, -start[2] / rays[..., 2], np.nan)[..., None]
    flat = np.nan_to_num(flat / (placed.size_m["height"] / prepared.scale.metres_per_unit), nan=1e6)
    return flat, np.asarray(np.linalg.norm(flat, axis=-1) < 2.5)


def _ratio(after: NDArray[np.uint8], before: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.asarray(
        (luminance(srgb_to_linear(after)) + 0.005) / (luminance(srgb_to_linear(before)) + 0.005), dtype=np.float32
    )


def _object_mask(prepared: PreparedScene, placed: Placed, row: int) -> NDArray[np.bool_]:
    """Pixels of the object that nothing hides, by our own renderer's outline."""
    from insertion.light.environment import HEIGHT, WIDTH, Environment
    from insertion.render.boxes import window_behind
    from insertion.render.context import gl_context
    from insertion.render.renderer import ObjectRenderer
    from insertion.scene.pixel_box import PixelBox

    view = prepared.scene.views[row]
    ones = np.ones((HEIGHT, WIDTH, 3), np.float32)
    renderer = ObjectRenderer(gl_context(), placed.body, Environment(ones, placed.place.basis, ones[..., 0]))
    window = window_behind(view.camera, PixelBox(0, 0, view.camera.width, view.camera.height))
    alpha = renderer.outline(window, view.rotation, view.translation, 1.0)
    y, x = -window.y0, -window.x0
    return np.asarray(alpha[y : y + SIZE[1], x : x + SIZE[0]] > 0.99)


if __name__ == "__main__":
    main()
