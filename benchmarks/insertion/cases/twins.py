"""An object beside its real self: `python -m benchmarks.insertion.cases.twins --out DIR`.

DIR is that of `benchmarks.insertion.cases`, whose work folders are used. The very mesh of a thing in a synthetic room
is written as a GLB file in metres and placed next to the thing, as far from the camera as it and turned as it is; its
heights through the recovered cameras are compared with those of the same mesh at that place under the true cameras,
and with those of the thing itself, corrected for distance.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.insertion.cases.case_list import CASES, Case, world_of
from benchmarks.insertion.cases.case_runs import ratio_of, true_heights, whole_height, work_similarity
from estimator.reconstructions.cameras import pixels_in_view
from insertion.pipeline.objects import Placed as Inserted
from insertion.pipeline.objects import place_objects, resize
from insertion.pipeline.stage import Stage
from metric_base.arrays import FloatArray
from metric_cli.insert_object.insert import parser
from metric_cli.insert_object.scene_arguments import requests_of, stage_of
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import Placed, World

__all__ = ["main", "share_words"]

#: Which case's room, and the thing: of the chairs and the like, the first with free floor beside it.
TWINS = (("kitchen", "chair-3"), ("bedroom", "suitcase-1"), ("study", "office_chair-1"))
#: Free floor between the two, in metres, and how near the rendered depth must be to that of the floor there.
GAP, SAME_DEPTH = 0.12, 0.02
#: Share of the floor there that is seen, and pixels to the picture's border.
LEAST_SEEN, EDGE = 0.75, 4
#: Every so many frames of the video are looked at.
STEP = 3


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for room, track in TWINS:
        case = next(case for case in CASES if case.name == room)
        print(_row(case, track, options.out / case.folder_name), flush=True)


def _row(case: Case, track: str, folder: Path) -> str:
    """`| room, thing | scale | over the mesh there | over itself |` for the estimated scale and the true one."""
    world, work = world_of(case), folder / "work"
    thing = next(thing for thing in world.objects if thing.track == track)
    at, facing = _free_spot(world, thing)
    model = write_glb(_from_foot(thing.mesh), folder / "twin.glb")
    words = [work, "--model", model, "--at", at, f"--facing={facing:.1f}", "--out", folder / "twin.mp4"]
    options = parser().parse_args([str(word) for word in words])
    stage = stage_of(options)
    (placed,) = place_objects(stage, requests_of(options))
    to_scene = work_similarity(folder, work)
    there = to_scene.inverse(placed.place.position[None])[0]
    error = stage.scale.metres_per_unit * to_scene.scale
    cells = [f"{case.name}, {thing.category} ({thing.size[2]:.2f} m)"]
    for label, twin in ((f"{error - 1:+.1%}", placed), ("true", resize(placed, error))):
        drawn = _projected_rows(stage, twin)
        mesh, _ = ratio_of(drawn, true_heights(world, work, to_scene, placed, drawn))
        itself, frames = ratio_of(drawn, _itself(world, thing, there, sorted(drawn)))
        cells += [label, share_words(mesh), f"{share_words(itself)} ({frames})"]
    return f"| {' | '.join(cells)} |"


def _projected_rows(stage: Stage, placed: Inserted) -> dict[int, float]:
    """Rows from the highest to the lowest vertex of the object in each frame that shows all of it."""
    rows = {}
    places = placed.body.position + placed.body.unit * placed.body.corners
    for shot in stage.footage.shots:
        if shot.view is not None:
            pixels, _ = pixels_in_view(shot.view, places)
            if np.isfinite(pixels).all():
                rows[shot.index] = float(np.ptp(pixels[:, 1]))
    return rows


def share_words(value: float | None) -> str:
    """The ratio, of one less than it."""
    return "no frame shows both" if value is None else f"{1 + value:.3f}"


def _free_spot(world: World, thing: Placed) -> tuple[str, float]:
    """For `--at` and `--facing`: free floor beside the thing, as far from the camera as it, turned as it is.

    Of all such places that which most frames show with the thing, both whole.
    """
    foot = _foot(thing.mesh)
    radius = float(np.linalg.norm((thing.mesh.vertices - foot)[:, :2], axis=1).max())
    ring = np.radians(np.arange(0, 360, 30))
    round_ = np.vstack([[0, 0, 0], radius * np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])])
    whole = _whole_rows(world, thing, range(0, len(world.poses), STEP))
    best: tuple[int, str, float] | None = None
    with Renderer(world) as renderer:
        for number in whole:
            depth = renderer.frame(number, colour=False).depth.astype(np.float64)
            eye = world.poses[number].centre
            for place in _places_beside(eye, foot, radius):
                box = np.vstack([place + round_, place + round_ + [0, 0, thing.size[2]]])
                shown = sum(_inside(world, other, box) for other in whole)
                share = _seen_share(world, number, depth, place + round_)
                if _inside(world, number, box) and share > LEAST_SEEN and (best is None or shown > best[0]):
                    x, y = _pixels(world, number, place[None])[0][0]
                    toward = np.arctan2(eye[1] - place[1], eye[0] - place[0])
                    # the file's front is -y of the world
                    best = shown, f"frame={number},x={x:.1f},y={y:.1f}", float(np.degrees(-np.pi / 2 - toward))
    if best is None:
        raise SystemExit(f"{world.kind} {world.seed}: no free floor beside the {thing.category}")
    return best[1:]


def _inside(world: World, number: int, points: FloatArray) -> bool:
    """Whether a frame shows all of the points (n, 3)."""
    pixels = _pixels(world, number, points)[0]
    return bool(((pixels > EDGE) & (pixels < [world.camera.width - EDGE, world.camera.height - EDGE])).all())


def _places_beside(eye: FloatArray, foot: FloatArray, radius: float) -> Iterator[FloatArray]:
    """(3,) places on the floor to the left and right of a foot (3,), as far from the eye (3,) as it."""
    away = foot[:2] - eye[:2]
    for gap in (GAP, 3 * GAP, 6 * GAP):
        for side in (-1.0, 1.0):
            angle = side * (2 * radius + gap) / float(np.linalg.norm(away))
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            yield np.append(eye[:2] + turn @ away, 0.0)


def _whole_rows(world: World, thing: Placed, numbers: Iterable[int]) -> dict[int, int]:
    """Rows of the thing's outline, nothing in front, in each frame that shows all of it."""
    with Renderer(replace(world, objects=(thing,))) as renderer:
        masks = {number: renderer.frame(number, colour=False).ids == 1 for number in numbers}
    return {number: rows for number, mask in masks.items() if (rows := whole_height(mask)) is not None}


def _seen_share(world: World, number: int, depth: FloatArray, points: FloatArray) -> float:
    """Share of points (n, 3) of the floor that the frame of this depth (h, w) shows."""
    pixels, depths = _pixels(world, number, points)
    at = np.floor(pixels).astype(int)
    inside = np.asarray(((at >= 0) & (at < depth.shape[::-1])).all(axis=1))
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
    middle = np.array([0.0, 0.0, thing.size[2] / 2])
    places = np.array([_foot(thing.mesh) + middle, there + middle])
    heights = {}
    for number, rows in _whole_rows(world, thing, wanted).items():
        own, twin = _pixels(world, number, places)[1]
        heights[number] = rows * float(own / twin)
    return heights


def _foot(mesh: Mesh) -> FloatArray:
    """(3,) the bottom centre of a solid."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


def _from_foot(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices - _foot(mesh), mesh.faces, mesh.material)


if __name__ == "__main__":
    main()
