"""What a reconstruction costs, stage by stage: `python -m benchmarks.insertion.capture_cost --frames 100 50 --out DIR`.

A made video of 100 frames is reconstructed from so many of its frames. Printed: CPU seconds of each stage (all
processes; the machine may be shared), and how far the poses of all its frames are from the truth. With `--degrees 380`
the walk is a loop.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.capture.capture import CaptureOptions, reconstruct
from estimator.capture.frame_poses import FramePose, FramePoses, read_frame_poses
from estimator.capture.work_folder import STAMPS, WorkFolder
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from tests.made.rooms.kinds import KINDS
from tests.made.rooms.similarity import Similarity, similarity_between
from tests.made.rooms.world import Pose, World
from tests.made.videos import Lens, filmed, orbit, room, times_of, write_video

__all__ = ["main", "pose_errors"]

#: Frames of the video, and the arc that is walked.
LENGTH, DEGREES = 100, 110.0
#: Depth in metres at which a wrong pose is looked at in pixels.
DEPTHS = (1.5, 3.0)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", default="kitchen")
    parser.add_argument("--seed", type=int, default=1010)
    parser.add_argument("--size", default="640x480", help="WIDTHxHEIGHT")
    parser.add_argument("--frames", type=int, nargs="+", default=[0], help="frames to choose; 0: the default")
    parser.add_argument("--length", type=int, default=LENGTH, help="frames of the video (default: %(default)s)")
    parser.add_argument("--degrees", type=float, default=DEGREES, help="of the arc (default: %(default)s)")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    lens = Lens(width, height, 500.0 * width / 640)
    walk = orbit(KINDS[options.kind].radius, options.length, options.seed, options.degrees)
    world = room(options.kind, options.seed, walk)
    film = (options.kind, options.seed, options.size, options.length, f"{options.degrees:g}")
    file = options.out / f"{'-'.join(map(str, film))}.mp4"
    if not file.is_file():
        options.out.mkdir(parents=True, exist_ok=True)
        write_video(file, (frame.colour for frame in filmed(world, lens)), times_of(options.length, 20.0))
    for wanted in options.frames:
        print(json.dumps(_run(file, world, lens, wanted or None, options.out / f"work-{wanted}")))


def _run(file: Path, world: World, lens: Lens, wanted: int | None, folder: Path) -> dict[str, object]:
    """One reconstruction from nothing."""
    shutil.rmtree(folder, ignore_errors=True)
    work = WorkFolder(folder)
    with work.lock():
        reconstruct(file, work, CaptureOptions(frames=wanted))
    cpu = {stamp.stem: json.loads(stamp.read_text())["cpu_seconds"] for stamp in (folder / STAMPS).iterdir()}
    poses = read_frame_poses(folder)
    return {
        "frames": wanted,
        "chosen": sum(pose.origin == "reconstructed" for pose in poses.frames),
        "cpu_seconds": cpu | {"all": round(sum(cpu.values()), 1)},
        **pose_errors(poses, list(world.poses), lens),
    }


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
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(-0.3, 0.3, 5))
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
    from estimator.reconstructions.cameras import project

    assert poses.camera is not None
    params = np.array([lens.focal, lens.width / 2, lens.height / 2, lens.k])
    seen = project(Camera("SIMPLE_RADIAL", lens.width, lens.height, params), true)
    return np.asarray(np.linalg.norm(project(poses.camera, ours) - seen, axis=1))


if __name__ == "__main__":
    main()
