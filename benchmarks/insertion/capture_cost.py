"""What a reconstruction costs, stage by stage: `python -m benchmarks.insertion.capture_cost --frames 100 50 --out DIR`.

A synthetic video of 100 frames is reconstructed from so many of its frames. Printed: CPU seconds of each stage (all
processes; the machine may be shared), and how far the poses of all its frames are from the truth. With `--degrees 380`
the walk is a loop. `--alone` also prints what pycolmap takes for the same frames with the options of the first rung:
features, matches each with each, incremental mapping.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from benchmarks.child import run_child
from benchmarks.insertion.pose_errors import pose_errors
from estimator.capture.capture import CaptureOptions, reconstruct
from estimator.capture.frame_poses import read_frame_poses
from estimator.capture.work_folder import STAMPS, WorkFolder
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.world import World
from tests.synthetic.videos import Lens, orbit, recorded, room, times_of, write_video

__all__ = ["main"]

#: Frames of the video, and the arc that is walked.
LENGTH, DEGREES = 100, 110.0


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
    parser.add_argument("--alone", action="store_true", help="what pycolmap alone takes, too")
    parser.add_argument("--frames-of", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.frames_of is not None:
        _map_alone(options.frames_of, options.out)
        return
    width, height = (int(side) for side in options.size.split("x"))
    lens = Lens(width, height, 500.0 * width / 640)
    walk = orbit(KINDS[options.kind].radius, options.length, options.seed, options.degrees)
    world = room(options.kind, options.seed, walk)
    video = (options.kind, options.seed, options.size, options.length, f"{options.degrees:g}")
    file = options.out / f"{'-'.join(map(str, video))}.mp4"
    if not file.is_file():
        options.out.mkdir(parents=True, exist_ok=True)
        write_video(file, (frame.colour for frame in recorded(world, lens)), times_of(options.length, 20.0))
    for wanted in options.frames:
        folder = options.out / f"work-{wanted}"
        print(json.dumps(_run(file, world, lens, wanted or None, folder)))
        if options.alone:
            module = ["-m", "benchmarks.insertion.capture_cost", "--frames-of", str(folder / "frames")]
            with tempfile.TemporaryDirectory() as scratch:
                child = run_child([sys.executable, *module, "--out", scratch], environment={"OMP_NUM_THREADS": "1"})
            assert child.status == 0, child.errors
            print(json.dumps({"frames": wanted or None, "pycolmap alone": round(child.cpu_s, 1)}))


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


def _map_alone(pictures: Path, folder: Path) -> None:
    """Features, matches and model of pictures by pycolmap alone."""
    from estimator.capture.mapping import colmap_worker
    from estimator.capture.mapping.failures import TYPICAL_FOCAL
    from estimator.capture.mapping.rungs import RUNGS
    from estimator.reconstructions.pycolmap_library import pycolmap

    pycolmap.logging.minloglevel = 1
    names = sorted(file.name for file in pictures.iterdir())
    database, first = str(folder / "alone.db"), RUNGS[0]
    request = {"database": database, "pictures": str(pictures), "threads": 2, "max_side": first.max_side}
    camera = {"camera_model": "SIMPLE_RADIAL", "focal_factor": TYPICAL_FOCAL}
    colmap_worker.features(request | camera | {"sift": first.sift, "cameras": [{"params": "", "names": names}]})
    matching = pycolmap.FeatureMatchingOptions(num_threads=2)
    matching.sift.max_ratio = first.ratio
    pycolmap.match_exhaustive(database, matching_options=matching)
    mapping = request | {"threads": 1, "seed": 0, "refine_focal": True, "focal_last": False, "held": False}
    options = colmap_worker.incremental_options(mapping)
    pycolmap.incremental_mapping(database, str(pictures), str(folder), options=options)


if __name__ == "__main__":
    main()
