"""Furnished rooms of `traced_room`, and their rendering by Blender's Cycles."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.blender.run import run_blender
from insertion.colour import linear_to_srgb, luminance
from models3d.gltf.document import GltfWriter
from tests.synthetic.rooms.materials import look_of
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import World

__all__ = ["FOCAL", "ROOMS", "SIZE", "TO_JOB", "VIEWS", "TracedRoom", "traced_images"]

#: Script for Blender that renders the rooms.
SCRIPT = Path(__file__).with_name("traced_script.py")
#: Width and height of the images, and focal length, in pixels.
SIZE = (192, 144)
FOCAL = 150.0
#: Number of samples per pixel.
SAMPLES = 16
#: Number of views of a room.
VIEWS = 6
#: Mean luminance of the images: the target of automatic exposure (middle grey).
MEAN_LUMINANCE = 0.18
#: Side of a texture tile in metres.
TILE_M = 1.5

#: Linear RGB colours of lamps.
LAMPS = {"white": (1.0, 1.0, 1.0), "warm": (1.0, 0.8, 0.55), "cool": (0.8, 0.9, 1.0)}
#: Transform from the synthetic world (z up) to the frame of the job (y up), as in `write_glb`.
TO_JOB = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class TracedRoom:
    """A synthetic room with lamps and an inserted object.

    lamps : kind and linear colour of each lamp; their positions follow from the seed.
    category, size, colour : category of the object, its size in metres and its linear colour.
    pattern : pattern of the textures.
    """

    kind: str
    seed: int
    lamps: tuple[tuple[str, tuple[float, float, float]], ...]
    category: str
    size: tuple[float, float, float]
    colour: tuple[float, float, float]
    pattern: str


def _rooms() -> dict[str, list[TracedRoom]]:
    """Read the rooms of `traced_rooms.csv` by set. Lamps are stated as `COLOUR KIND`, separated by semicolons."""
    rooms: dict[str, list[TracedRoom]] = {}
    with Path(__file__).with_name("traced_rooms.csv").open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            names = [lamp.split(" ", 1) for lamp in row["lamps"].split("; ")]
            lamps = tuple((kind, LAMPS[colour]) for colour, kind in names)
            size, colour = (_three(row[name]) for name in ("size_m", "colour"))
            room = TracedRoom(row["kind"], int(row["seed"]), lamps, row["category"], size, colour, row["pattern"])
            rooms.setdefault(row["set"], []).append(room)
    return rooms


def _three(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split())
    return x, y, z


ROOMS = _rooms()


def traced_images(
    world: World, room: TracedRoom, rows: Sequence[int], out: Path, item: dict[str, Any] | None = None
) -> list[NDArray[np.uint8]]:
    """Return the images of some views, without the object or with `item`. Traced views are cached in `out`."""
    traced = out / ("bare" if item is None else "with")
    traced.mkdir(exist_ok=True)
    missing = [k for k in rows if not (traced / f"{k:06d}.npy").is_file()]
    if missing:
        objects = [*_room_files(world, room, out), *([] if item is None else [item])]
        run_blender(_job(world, room, missing, objects, traced), out, script=SCRIPT)
    return [_developed(traced / f"{k:06d}.npy", out) for k in rows]


def _room_files(world: World, room: TracedRoom, folder: Path) -> list[dict[str, Any]]:
    """Write a GLB file for each material of each object, with a texture of two of its colours."""
    rows = []
    for index, mesh in enumerate([world.surfaces, *(item.mesh for item in world.objects)]):
        for name in sorted(set(mesh.material)):
            file = folder / f"room_{index}_{name}.glb"
            chosen = np.array([material == name for material in mesh.material])
            look = look_of(name, index, world.seed, 1.0)
            _write_part(mesh, mesh.faces[chosen], _texture(look, room.pattern, index), file)
            rows.append({"file": str(file.resolve()), "matrix": np.eye(4).tolist()})
    return rows


def _texture(look: NDArray[np.float64], pattern: str, seed: int) -> NDArray[np.uint8]:
    """Return an sRGB tile (64, 64, 4) of the two colours of a look."""
    y, x = np.mgrid[:64, :64]
    grain = np.random.default_rng(seed).uniform(0, 1, (16, 16)).repeat(4, 0).repeat(4, 1)
    blend = {
        "plain": np.zeros((64, 64)), "grain": 0.6 * grain, "stripes": 1.0 * ((x // 8) % 2), "checks":
        0.9 * ((x // 16 + y // 16) % 2),
    }[pattern]  # fmt: skip
    colour = (1 - blend)[..., None] * look[:3] + blend[..., None] * look[3:6]
    return np.dstack([np.rint(255 * colour), np.full((64, 64), 255)]).astype(np.uint8)


def _write_part(mesh: Mesh, faces: NDArray[np.int64], texture: NDArray[np.uint8], file: Path) -> None:
    """Write faces of a mesh (z up) as a GLB file (y up), with the texture projected along each face's main axis."""
    corners = mesh.vertices[faces]  # (m, 3, 3)
    across = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).argmax(axis=1)
    axes = np.array([[1, 2], [0, 2], [0, 1]])[across]  # (m, 2)
    uv = np.take_along_axis(corners, axes[:, None, :].repeat(3, axis=1), axis=2) / TILE_M
    document = GltfWriter("traced room")
    surface = {"baseColorTexture": {"index": document.add_texture(texture)}, "metallicFactor": 0.0}
    document.add("materials", {"pbrMetallicRoughness": surface | {"roughnessFactor": 0.9}, "doubleSided": True})
    attributes = {
        "POSITION": document.add_accessor(corners.reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1], bounds=True),
        "TEXCOORD_0": document.add_accessor(uv.reshape(-1, 2)),
    }
    document.add("meshes", {"primitives": [{"attributes": attributes, "material": 0}]})
    file.write_bytes(document.to_bytes([document.add("nodes", {"mesh": 0})]))


def _lights(room: TracedRoom, world: World) -> list[dict[str, Any]]:
    """Return the square area lights of the job. Size, power, position and target depend on the kind of each lamp."""
    generator = np.random.default_rng(room.seed)
    low, high = world.surfaces.vertices.min(axis=0) + 0.15, world.surfaces.vertices.max(axis=0) - 0.15
    rows = []
    for kind, colour in room.lamps:
        x, y = generator.uniform(0.6 * low[:2], 0.6 * high[:2])
        corner = np.where(generator.random(2) < 0.5, low[:2], high[:2]) * 0.9
        side = np.array([low[0] if generator.random() < 0.5 else high[0], y])
        strength = generator.uniform(0.8, 1.25)
        size, watts, position, target = {
            "bulb": (0.2, 40.0, (x, y, high[2] - 0.1), (x, y, 0.0)),
            "panel": (1.0, 40.0, (x, y, high[2]), (x, y, 0.0)),
            "window": (1.3, 90.0, (*side, 1.5), (0.0, y, 0.6)),
            "floor lamp": (0.3, 45.0, (*corner, 1.6), (0.0, 0.0, 0.4)),
            "uplight": (0.3, 30.0, (*-corner, 1.7), (*-0.9 * corner, 2.6)),
        }[kind]
        rows.append({**_light(size, watts * strength, position, target), "colour": colour})
    return rows


def _job(
    world: World, room: TracedRoom, rows: Sequence[int], objects: list[dict[str, Any]], out: Path
) -> dict[str, Any]:
    return {
        "objects": objects,
        "lights": _lights(room, world),
        "window": {"width": SIZE[0], "height": SIZE[1], "fx": FOCAL, "fy": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2},
        "keys": [
            {"stem": f"{row:06d}", "time_s": float(row), "matrix": _camera_matrix(world, row).tolist()} for row in rows
        ],
        "samples": SAMPLES,
        "out": str(out.resolve()),
    }


def _light(side: float, watts: float, position: tuple[float, ...], target: tuple[float, ...]) -> dict[str, Any]:
    back = np.array(position) - np.array(target)
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0] if abs(back[2]) > 0.9 else [0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    matrix[:3, 3] = position
    return {"size": side, "power": watts, "matrix": (TO_JOB @ matrix).tolist()}


def _camera_matrix(world: World, row: int) -> NDArray[np.float64]:
    pose = world.poses[row]
    matrix = np.eye(4)
    matrix[:3, :3] = pose.rotation.T @ np.diag([1.0, -1.0, -1.0])
    matrix[:3, 3] = pose.centre
    return np.asarray(TO_JOB @ matrix)


def _developed(file: Path, out: Path) -> NDArray[np.uint8]:
    """Return a traced image in sRGB, with one exposure for all views of the room."""
    bare = [luminance(np.load(other)[..., :3].astype(np.float32)).mean() for other in sorted((out / "bare").iterdir())]
    linear = np.load(file)[..., :3].astype(np.float32)
    return np.rint(linear_to_srgb(linear * MEAN_LUMINANCE / np.mean(bare))).astype(np.uint8)
