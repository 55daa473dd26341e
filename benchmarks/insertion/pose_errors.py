"""How far recovered poses are from the true ones: centres in millimetres, and pixels of points at a room's depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.capture.frame_poses import FramePose, FramePoses
from estimator.reconstructions.cameras import project
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.world import Pose
from tests.synthetic.videos import Lens

__all__ = ["pose_errors"]

#: Depth in metres at which a wrong pose is looked at in pixels.
DEPTHS = (1.5, 3.0)


def pose_errors(poses: FramePoses, truth: Sequence[Pose], lens: Lens) -> dict[str, float]:
    """Camera centres in millimetres and projections in pixels, over the frames that have a pose.

    truth : the true pose of each frame. The worlds are aligned by the centres for the millimetres; for the pixels their
    rotation is that of the cameras, since a path of a metre, true to a millimetre, leaves it open by half a pixel.
    """
    rows = [pose for pose in poses.frames if pose.rotation is not None]
    true = np.array([truth[pose.index].centre for pose in rows])
    to_scene = similarity_between(true, np.array([pose.centre for pose in rows]))
    centres = to_scene.inverse(np.array([pose.centre for pose in rows]))
    off = np.linalg.norm(centres - true, axis=1) * 1000
    to_scene = _aligned_by_rotations(rows, truth, to_scene.scale)
    # well inside the picture, where a lens's model is one to one
    sides = 0.31 * np.array([lens.width, lens.height]) / lens.focal
    x, y = np.meshgrid(*(np.linspace(-side, side, 5) for side in sides))
    pixels = []
    for pose in rows:
        assert pose.rotation is not None
        assert pose.translation is not None
        frame = truth[pose.index]
        for depth in DEPTHS:
            local = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) * depth
            places = to_scene((local - frame.translation) @ frame.rotation)
            pixels.append(np.median(_misfit(places @ pose.rotation.T + pose.translation, local, poses, lens)))
    return {
        "posed": len(rows),
        "centre_rms_mm": round(float(np.sqrt((off**2).mean())), 2),
        "centre_worst_mm": round(float(off.max()), 2),
        "median_px": round(float(np.median(pixels)), 3),
        "worst_px": round(float(np.max(pixels)), 3),
    }


def _aligned_by_rotations(rows: Sequence[FramePose], truth: Sequence[Pose], scale: float) -> Similarity:
    """The similarity from the true world whose rotation is the mean of what the cameras' own say."""
    turns = [row.rotation.T @ truth[row.index].rotation for row in rows if row.rotation is not None]
    rotation = Rotation.from_matrix(np.array(turns)).mean().as_matrix()
    true = np.array([truth[row.index].centre for row in rows]).mean(axis=0)
    return Similarity(scale, rotation, np.array([row.centre for row in rows]).mean(axis=0) - scale * rotation @ true)


def _misfit(ours: FloatArray, true: FloatArray, poses: FramePoses, lens: Lens) -> FloatArray:
    """(n,) pixels between points through the recovered camera and through the true one."""
    assert poses.camera is not None
    params = np.array([lens.focal, lens.width / 2, lens.height / 2, lens.k])
    seen = project(Camera("SIMPLE_RADIAL", lens.width, lens.height, params), true)
    return np.asarray(np.linalg.norm(project(poses.camera, ours) - seen, axis=1))
