"""Places in a synthetic room where furniture hides a part of an object from some cameras of a path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.rooms.furnish import turn_about_z
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import World

__all__ = ["hiding_place"]

#: Distance between the places that are tried, and the free space around the object, in metres.
STEP, GAP = 0.15, 0.03
#: A frame counts if between these shares of the object are hidden.
HIDDEN = (0.12, 0.7)
#: Pixels between the depths that are looked at for free space.
PIXELS = 4


def hiding_place(world: World, mesh: Mesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place on the floor (3,), the way the front looks (3,), and the hidden share by frame (NaN where not whole).

    The place has the most frames that hide a part of the object; ties go to the one that is hidden most evenly.
    """
    with Renderer(world) as renderer:
        depths = [renderer.frame(k, colour=False).depth for k in range(len(world.poses))]
    taken = sample_lamps(world, depths)
    samples = _samples(mesh)
    best, score = None, -1.0
    middle = world.poses[len(world.poses) // 2].centre
    for x in np.arange(-2.2, 2.2, STEP):
        for y in np.arange(-2.2, 2.2, STEP):
            place = np.array([x, y, 0.0])
            front = np.append((middle - place)[:2], 0.0) / np.linalg.norm((middle - place)[:2])
            turn = turn_about_z(float(np.arctan2(front[1], front[0]) + np.pi / 2))
            if not _free(taken, place, turn, mesh):
                continue
            shares = _hidden_shares(world, depths, samples @ turn.T + place)
            part = (shares > HIDDEN[0]) & (shares < HIDDEN[1])
            mark = part.sum() + float(np.std(shares[part])) if part.any() else 0.0
            if mark > score:
                best, score = (place, front, shares), mark
    if best is None:
        raise LookupError(f"{world.kind} {world.seed}: no free place for this object")
    return best


def _samples(mesh: Mesh) -> FloatArray:
    """(n, 3) points spread over the faces."""
    generator = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    rows = generator.choice(len(corners), 400, p=area / area.sum())
    weights = generator.dirichlet(np.ones(3), len(rows))
    return np.asarray(np.einsum("nk,nkc->nc", weights, corners[rows]))


def sample_lamps(world: World, depths: Sequence[np.ndarray]) -> FloatArray:
    """(n, 3) places that the frames see."""
    camera, all_of_them = world.camera, []
    y, x = np.mgrid[0 : camera.height : PIXELS, 0 : camera.width : PIXELS]
    rays = np.stack(
        [(x - camera.width / 2) / camera.focal, (y - camera.height / 2) / camera.focal, np.ones_like(x)], -1
    )
    for depth, pose in zip(depths, world.poses, strict=True):
        there = (rays * depth[::PIXELS, ::PIXELS, None])[np.isfinite(depth[::PIXELS, ::PIXELS])]
        all_of_them.append((there - pose.translation) @ pose.rotation)
    return np.concatenate(all_of_them)


def _free(taken: FloatArray, place: FloatArray, turn: FloatArray, mesh: Mesh) -> bool:
    """Whether nothing that was seen is in the box of the mesh at a place, and the floor about it was seen."""
    local = (taken - place) @ turn
    size = np.ptp(mesh.vertices, axis=0)
    beside = np.all(np.abs(local[:, :2]) < size[:2] / 2 + GAP, axis=1)
    return not np.any(beside & (local[:, 2] > 0.03) & (local[:, 2] < size[2] + GAP)) and bool(np.any(beside))


def _hidden_shares(world: World, depths: Sequence[np.ndarray], points: FloatArray) -> FloatArray:
    """(v,) share of the points (n, 3) that each frame hides, NaN where it does not show all of them."""
    camera, shares = world.camera, []
    for depth, pose in zip(depths, world.poses, strict=True):
        local = points @ pose.rotation.T + pose.translation
        at = camera.focal * local[:, :2] / local[:, 2:] + [camera.width / 2, camera.height / 2]
        inside: BoolArray = (local[:, 2] > 0.1) & np.all(
            (at > 2) & (at < [camera.width - 2, camera.height - 2]), axis=1
        )
        if not inside.all():
            shares.append(np.nan)
            continue
        cells = at.astype(np.int64)
        shares.append(float(np.mean(depth[cells[:, 1], cells[:, 0]] < local[:, 2] - 0.02)))
    return np.array(shares)
