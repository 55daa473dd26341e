"""How far recovered poses are from the true ones: centres in millimetres, and pixels of points at a room's depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.capture.frame_poses import FramePose, FramePoses
from estimator.reconstructions.cameras import project
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from tests.made.rooms.similarity import Similarity, similarity_between
from tests.made.rooms.world import World
from tests.made.videos import Lens

__all__ = ["pose_errors"]

#: Depth in metres at which a wrong pose is looked at in pixels.
DEPTHS = (1.5, 3.0)


def pose_errors(poses: FramePoses, world: World, lens: Lens) -> dict[str, float]:
    """Figures over the frames that have a pose: the median of each frame's points, over all frames and in the worst."""
    rows = [pose for pose in poses.frames if pose.rotation is not None]
    true = np.array([world.poses[pose.index].centre for pose in rows])
    to_scene = _alignment(rows, world, true)
    centres = to_scene.inverse(np.array([pose.centre for pose in rows]))
    off = np.linalg.norm(centres - true, axis=1) * 1000
    aspect = lens.width / lens.focal * 0.31  # well inside the picture, where a lens's model is one to one
    x, y = np.meshgrid(np.linspace(-aspect, aspect, 5), np.linspace(-1, 1, 5) * 0.31 * lens.height / lens.focal)
    pixels = []
    for pose in rows:
        assert pose.rotation is not None
        assert pose.translation is not None
        truth = world.poses[pose.index]
        for depth in DEPTHS:
            local = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) * depth
            places = to_scene((local - truth.translation) @ truth.rotation)
            pixels.append(np.median(_misfit(places @ pose.rotation.T + pose.translation, local, poses, lens)))
    return {
        "posed": len(rows),
        "centre_rms_mm": round(float(np.sqrt((off**2).mean())), 2),
        "centre_worst_mm": round(float(off.max()), 2),
        "median_px": round(float(np.median(pixels)), 3),
        "worst_px": round(float(np.max(pixels)), 3),
    }


def _alignment(rows: Sequence[FramePose], world: World, true: FloatArray) -> Similarity:
    """The way from the room into the reconstruction: turned by the mean of the cameras' turns, moved by their centres.

    true : (n, 3) centres. The centres of a short arc alone determine the turn about its chord to a pixel only.
    """
    turns = [pose.rotation.T @ world.poses[pose.index].rotation for pose in rows if pose.rotation is not None]
    u, _, vt = np.linalg.svd(np.sum(turns, axis=0))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    centres = np.array([pose.centre for pose in rows])
    scale = similarity_between(true, centres).scale
    return Similarity(scale, turn, centres.mean(axis=0) - scale * turn @ true.mean(axis=0))


def _misfit(ours: FloatArray, true: FloatArray, poses: FramePoses, lens: Lens) -> FloatArray:
    """(n,) pixels between points through the recovered camera and through the true one."""
    assert poses.camera is not None
    params = np.array([lens.focal, lens.width / 2, lens.height / 2, lens.k])
    real = project(Camera("SIMPLE_RADIAL", lens.width, lens.height, params), true)
    return np.asarray(np.linalg.norm(project(poses.camera, ours) - real, axis=1))
