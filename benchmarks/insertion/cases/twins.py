"""An object beside its real self: `python -m benchmarks.insertion.cases.twins --out DIR`.

DIR is that of `benchmarks.insertion.cases`, whose work folders are used. The very mesh of a thing in a made room is
written as a GLB file in metres and inserted next to the thing, as far from the camera as it; heights in the frames are
compared with the same mesh at that place under the true cameras, and with the thing itself corrected for distance.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.insertion.cases.case_list import CASES, Case, world_of
from benchmarks.insertion.cases.case_runs import (
    command,
    drawn_heights,
    fresh,
    placed_object,
    ratio_of,
    true_heights,
    whole_height,
    work_similarity,
)  # fmt: skip
from metric_base.arrays import FloatArray
from tests.made.insertions import write_glb
from tests.made.rooms.render import Renderer
from tests.made.rooms.solids import Mesh
from tests.made.rooms.world import Placed, World

__all__ = ["main", "share_words"]

#: Which case's room, and the category of the thing.
TWINS = (("sitting room", "armchair"), ("kitchen", "chair"), ("study", "office chair"))
#: Free floor between the two, in metres, and how near the rendered depth must be to that of the floor there.
GAP, SAME_DEPTH = 0.12, 0.02
#: Every so many frames of the film are looked at.
STEP = 3


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for room, category in TWINS:
        case = next(case for case in CASES if case.name == room)
        print(_row(case, category, options.out / case.folder_name), flush=True)


def _row(case: Case, category: str, folder: Path) -> str:
    """`| room, thing | scale | over the mesh there | over itself |` for the estimated scale and the true one."""
    world = world_of(case)
    thing = next(thing for thing in world.objects if thing.category == category)
    spot = _free_spot(world, thing)
    model = write_glb(_from_foot(thing.mesh), folder / "twin.glb")
    work = folder / "work"
    to_scene = work_similarity(folder, work)
    cells = [f"{case.name}, {category} ({thing.size[2]:.2f} m)"]
    for name, scale in (("twin", None), ("twin_true", 1 / to_scene.scale)):
        words: list[Any] = [work, "--model", model, "--at", spot, "--out", fresh(folder / f"{name}.mp4")]
        words += [] if scale is None else ["--scale", scale]
        code, record, _ = command("insertion.command", [*words, "--json"])
        if code:
            return f"| {' | '.join([*cells, str(record['said'])])} |"
        drawn = drawn_heights(record)
        placed = placed_object(words)
        there = to_scene.inverse(placed.place.position[None])[0]
        mesh, _ = ratio_of(drawn, true_heights(world, work, to_scene, placed, drawn))
        itself, frames = ratio_of(drawn, _itself(world, thing, there, sorted(drawn)))
        cells += [f"{record['scale']['metres_per_unit'] * to_scene.scale - 1:+.1%}" if scale is None else "true"]
        cells += [share_words(mesh), f"{share_words(itself)} ({frames})"]
    return f"| {' | '.join(cells)} |"


def share_words(value: float | None) -> str:
    """The ratio, of one less than it."""
    return "no frame shows both" if value is None else f"{1 + value:.3f}"


def _free_spot(world: World, thing: Placed) -> str:
    """For `--at`: floor beside the thing, as far from the camera as it, in the frame that shows most of it."""
    corners = thing.mesh.vertices
    foot = _foot(thing.mesh)
    radius = float(np.linalg.norm(corners[:, :2] - foot[:2], axis=1).max())
    best: tuple[float, str] | None = None
    with Renderer(world) as renderer:
        for number in range(0, len(world.poses), STEP):
            pose, frame = world.poses[number], renderer.frame(number, colour=False)
            eye = pose.centre
            away = foot[:2] - eye[:2]
            for side in (-1.0, 1.0):
                for gap in (GAP, 3 * GAP, 6 * GAP):
                    angle = side * (2 * radius + gap) / float(np.linalg.norm(away))
                    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                    place = np.append(eye[:2] + turn @ away, 0.0)
                    ring = np.radians(np.arange(0, 360, 30))
                    ground = place + radius * np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])
                    share = _seen_share(world, number, frame.depth, np.vstack([place, ground]))
                    score = share - 0.05 * gap
                    if share > 0.75 and (best is None or score > best[0]):
                        x, y = _pixels(world, number, place[None])[0][0]
                        best = score, f"frame={number},x={x:.1f},y={y:.1f}"
    if best is None:
        raise SystemExit(f"{world.kind} {world.seed}: no free floor beside the {thing.category}")
    return best[1]


def _seen_share(world: World, number: int, depth: FloatArray, points: FloatArray) -> float:
    """Share of points (n, 3) of the floor that the frame of this depth (h, w) shows."""
    pixels, depths = _pixels(world, number, points)
    at = np.floor(pixels).astype(int)
    inside = ((at >= 0) & (at < depth.shape[::-1])).all(axis=1)
    at = np.where(inside[:, None], at, 0)
    return float(np.mean(inside & (np.abs(depth[at[:, 1], at[:, 0]] / depths - 1) < SAME_DEPTH)))


def _pixels(world: World, number: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 2) pixels and (n,) depths of points (n, 3) of the world."""
    pose, camera = world.poses[number], world.camera
    local = points @ pose.rotation.T + pose.translation
    pixels = camera.focal * local[:, :2] / local[:, 2:] + [camera.width / 2, camera.height / 2]
    return pixels, local[:, 2]


def _itself(world: World, thing: Placed, there: FloatArray, wanted: list[int]) -> dict[int, float]:
    """Rows of the thing itself, nothing in front, as they would be at the depth of its twin at `there` (3,)."""
    alone = replace(world, objects=(thing,))
    middle = np.array([0.0, 0.0, thing.size[2] / 2])
    heights = {}
    with Renderer(alone) as renderer:
        for number in wanted[::STEP]:
            height = whole_height(renderer.frame(number, colour=False).ids == 1)
            depths = _pixels(world, number, np.array([_foot(thing.mesh) + middle, there + middle]))[1]
            if height is not None:
                heights[number] = height * float(depths[0] / depths[1])
    return heights


def _foot(mesh: Mesh) -> FloatArray:
    """(3,) the bottom centre of a solid."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


def _from_foot(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices - _foot(mesh), mesh.faces, mesh.material)


if __name__ == "__main__":
    main()
