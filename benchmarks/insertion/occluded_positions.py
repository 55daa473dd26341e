"""Find a position in a synthetic room where furniture occludes a part of an object in some frames of a path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.rooms.furnish import turn_about_z
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import World

__all__ = ["occluded_position"]

#: Distance between candidate positions in metres.
STEP_M = 0.15
#: Free space around the object in metres.
GAP_M = 0.03
#: Minimum and maximum occluded fraction of the object in a frame that is counted.
OCCLUDED_RANGE = (0.12, 0.7)
#: Pixels between the depth samples.
PIXEL_STEP = 4


def occluded_position(world: World, mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Return the position (3,) on the floor and the direction (3,) of the object's front.

    The position has the most frames in which a part of the object is occluded. Among positions with equal numbers of
    frames, the standard deviation of the occluded fraction decides.
    """
    with Renderer(world) as renderer:
        depths = [renderer.frame(k, colour=False).depth for k in range(len(world.poses))]
    surface = _visible_points(world, depths)
    samples = _samples(mesh)
    best, best_score = None, -1.0
    middle = world.poses[len(world.poses) // 2].centre
    for x in np.arange(-2.2, 2.2, STEP_M):
        for y in np.arange(-2.2, 2.2, STEP_M):
            position = np.array([x, y, 0.0])
            front = np.append((middle - position)[:2], 0.0) / np.linalg.norm((middle - position)[:2])
            rotation = turn_about_z(float(np.arctan2(front[1], front[0]) + np.pi / 2))
            if not _is_free(surface, position, rotation, mesh):
                continue
            fractions = _occluded_fractions(world, depths, samples @ rotation.T + position)
            partly = (fractions > OCCLUDED_RANGE[0]) & (fractions < OCCLUDED_RANGE[1])
            score = partly.sum() + float(np.std(fractions[partly])) if partly.any() else 0.0
            if score > best_score:
                best, best_score = (position, front), score
    if best is None:
        raise LookupError(f"{world.kind} {world.seed}: no free position for this object")
    return best


def _samples(mesh: Mesh) -> FloatArray:
    """Return points (n, 3) distributed over the faces by area."""
    generator = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    rows = generator.choice(len(corners), 400, p=area / area.sum())
    weights = generator.dirichlet(np.ones(3), len(rows))
    return np.asarray(np.einsum("nk,nkc->nc", weights, corners[rows]))


def _visible_points(world: World, depths: Sequence[np.ndarray]) -> FloatArray:
    """Return the surface points (n, 3) at every `PIXEL_STEP`-th pixel of the frames."""
    camera, points = world.camera, []
    y, x = np.mgrid[0 : camera.height : PIXEL_STEP, 0 : camera.width : PIXEL_STEP]
    rays = np.stack(
        [(x - camera.width / 2) / camera.focal, (y - camera.height / 2) / camera.focal, np.ones_like(x)], -1
    )
    for depth, pose in zip(depths, world.poses, strict=True):
        local = (rays * depth[::PIXEL_STEP, ::PIXEL_STEP, None])[np.isfinite(depth[::PIXEL_STEP, ::PIXEL_STEP])]
        points.append((local - pose.translation) @ pose.rotation)
    return np.concatenate(points)


def _is_free(surface: FloatArray, position: FloatArray, rotation: FloatArray, mesh: Mesh) -> bool:
    """Return True if the mesh's box contains no surface points at a position, and the floor below it is visible."""
    local = (surface - position) @ rotation
    size = np.ptp(mesh.vertices, axis=0)
    inside = np.all(np.abs(local[:, :2]) < size[:2] / 2 + GAP_M, axis=1)
    return not np.any(inside & (local[:, 2] > 0.03) & (local[:, 2] < size[2] + GAP_M)) and bool(np.any(inside))


def _occluded_fractions(world: World, depths: Sequence[np.ndarray], points: FloatArray) -> FloatArray:
    """Return the occluded fraction (v,) of the points (n, 3) in each frame; NaN if some are outside the image."""
    camera, fractions = world.camera, []
    for depth, pose in zip(depths, world.poses, strict=True):
        local = points @ pose.rotation.T + pose.translation
        pixels = camera.focal * local[:, :2] / local[:, 2:] + [camera.width / 2, camera.height / 2]
        inside: BoolArray = (local[:, 2] > 0.1) & np.all(
            (pixels > 2) & (pixels < [camera.width - 2, camera.height - 2]), axis=1
        )
        if not inside.all():
            fractions.append(np.nan)
            continue
        cells = pixels.astype(np.int64)
        fractions.append(float(np.mean(depth[cells[:, 1], cells[:, 0]] < local[:, 2] - 0.02)))
    return np.array(fractions)
