"""How true places are in synthetic rooms: `python -m benchmarks.insertion.place_accuracy`.

For each room: the error of the heights of the support planes that are a floor or a table, the error of up, and the
distance between what a click shows and where the object is put, at pixels that look at a level surface. Clicks at
walls and at upright sides must be refused.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.records.scene import View
from insertion.places.free_space import Space
from insertion.places.locate import place_at_point
from insertion.places.place import NoPlace
from insertion.staging.stage import Stage
from metric_base.arrays import FloatArray
from tests.synthetic.insertions import RecordedRoom, stage_of, video_room
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.solids import Mesh

__all__ = ["main"]

ROOMS = (("sitting room", 1003), ("kitchen", 1005), ("bedroom", 1001), ("study", 1007), ("sitting room", 1009))
CLICKS = 60
#: A surface is level or upright within this many degrees, as its neighbours in the depth map show it.
LEVEL_DEG = 4.0
#: Half the side of the square of pixels that must be of one surface.
AROUND_PX = 6


@dataclass(slots=True)
class Clicks:
    """Distances in mm of the clicks that were placed, how many were refused, and the same at upright surfaces."""

    errors: list[float]
    refused: int = 0
    upright: int = 0
    upright_placed: int = 0


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise", type=float, default=0.004, help="of the cloud, a share of the depth")
    options = parser.parse_args()
    print(
        "| room | planes | height, mm (largest) | up, degrees | clicks, mm: median, 95 % | refused | upright, placed |"
    )
    print("|---|---|---|---|---|---|---|")
    for kind, seed in ROOMS:
        with tempfile.TemporaryDirectory() as name:
            room = video_room(kind, seed, Path(name), views=5, noise=options.noise)
            print(_row(f"{kind} {seed}", room, stage_of(room)), flush=True)


def _row(name: str, room: RecordedRoom, stage: Stage) -> str:
    up = room.to_scene.rotation @ [0.0, 0.0, 1.0]
    tilt = np.degrees(np.arccos(np.clip(stage.supports.up.vector @ up, -1, 1)))
    heights = _plane_errors(room, stage)
    clicks = _clicks(room, stage)
    median, high = (np.percentile(clicks.errors, share) for share in (50, 95))
    return (
        f"| {name} | {len(heights)} | {np.median(heights):.1f} ({max(heights):.1f}) | {tilt:.2f} "
        f"| {median:.0f}, {high:.0f} ({len(clicks.errors)} clicks) | {clicks.refused} "
        f"| {clicks.upright_placed} of {clicks.upright} |"
    )


def _plane_errors(room: RecordedRoom, stage: Stage) -> list[float]:
    """Millimetres between each plane and the nearest true level: the floor, or a face of a thing that looks up."""
    tops = np.concatenate([np.zeros(1), *(_levels(thing.mesh) for thing in room.world.objects)])
    errors = []
    for surface in stage.supports.surfaces:
        middle = surface.plane.height * surface.plane.basis[2]
        local = np.argwhere(surface.solid).mean(axis=0) * surface.cell + surface.origin
        point = room.to_scene.inverse((middle + local @ surface.plane.basis[:2])[None])[0]
        errors.append(1000 * float(np.abs(tops - point[2]).min()))
    return errors


def _levels(mesh: Mesh) -> FloatArray:
    """(n,) heights of the faces that look straight up."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = normals[:, 2] > 0.999 * np.linalg.norm(normals, axis=1)
    return np.asarray(corners[level, 0, 2])


def _clicks(room: RecordedRoom, stage: Stage) -> Clicks:
    generator = np.random.default_rng(0)
    space = Space(stage.scene, stage.cloud, stage.supports, 0.05 * room.to_scene.scale, 0.1 * room.to_scene.scale)
    clicks = Clicks([])
    with Renderer(room.world) as renderer:
        for index, view in enumerate(stage.scene.views):
            frame = renderer.frame(index)
            points = _points(frame.depth, view, room)
            for _ in range(CLICKS):
                x, y = generator.uniform(
                    2 * AROUND_PX, np.array([view.camera.width, view.camera.height]) - 2 * AROUND_PX
                )
                _click(clicks, space, room, view, points, frame.ids, (float(x), float(y)))
    return clicks


def _click(
    clicks: Clicks, space: Space, room: RecordedRoom, view: View, points: FloatArray, ids: FloatArray,
    pixel: tuple[float, float],
) -> None:  # fmt: skip
    """One click; points : (h, w, 3) of the room; ids : (h, w) of things."""
    column, row = int(pixel[0]), int(pixel[1])
    around = (slice(row - AROUND_PX, row + AROUND_PX + 1), slice(column - AROUND_PX, column + AROUND_PX + 1))
    near = points[around].reshape(-1, 3)
    if not np.isfinite(near).all() or len(np.unique(ids[around])) > 1:
        return
    centred = near - near.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    if sizes[2] > 0.02 * sizes[1]:  # not one flat surface
        return
    lean = np.degrees(np.arccos(min(abs(axes[2][2]), 1.0)))
    level, upright = lean < LEVEL_DEG, lean > 90 - LEVEL_DEG
    if not (level or upright) or (level and room.to_scene.inverse(view.centre[None])[0, 2] < points[row, column, 2]):
        return
    clicks.upright += upright
    try:
        place = place_at_point(space, view, *pixel)
    except NoPlace:
        clicks.refused += level
        return
    if upright:
        clicks.upright_placed += 1
    else:
        foot = room.to_scene.inverse(place.position[None])[0]
        clicks.errors.append(1000 * float(np.linalg.norm(foot - _true_foot(room, view, pixel, near))))


def _points(depth: FloatArray, view: View, room: RecordedRoom) -> FloatArray:
    """(h, w, 3) points of the room in metres from its exact depths (h, w)."""
    focal, centre = view.camera.params[0], view.camera.params[-2:]
    rows, columns = np.indices(depth.shape)
    rays = np.dstack([(columns + 0.5 - centre[0]) / focal, (rows + 0.5 - centre[1]) / focal, np.ones(depth.shape)])
    local = rays * (depth * room.to_scene.scale)[..., None]
    scene = (local.reshape(-1, 3) - view.translation) @ view.rotation
    return room.to_scene.inverse(scene).reshape(*depth.shape, 3)


def _true_foot(room: RecordedRoom, view: View, pixel: tuple[float, float], near: FloatArray) -> FloatArray:
    """(3,) where the ray through the pixel meets the level of the (n, 3) points around it."""
    from insertion.scene.rays import ray_through

    start = room.to_scene.inverse(view.centre[None])[0]
    along = room.to_scene.inverse((view.centre + ray_through(view, *pixel))[None])[0] - start
    return start + along * (np.median(near[:, 2]) - start[2]) / along[2]


if __name__ == "__main__":
    main()
