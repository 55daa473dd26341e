"""How true the scale of a video is, from the file to the answer, and whether dense points change it.

`python -m benchmarks.insertion.video_accuracy kitchen:1010 --out DIR` records synthetic rooms, runs `estimate-scale` on
each, and prints one row of docs/evidence/videos.md for each; with `--dense` the scale from the dense points, too. The
lens may distort (`--k -0.12`), the frame rate vary (`--variable`) and the video be stored turned (`--turned 90`); with
`--pictures` a folder of upright pictures that EXIF's orientation turns is made of the video's frames.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.insertion.pose_errors import pose_errors
from estimator.capture.frame_poses import read_frame_poses
from estimator.capture.video import Video
from estimator.reading import read_scene
from tests.synthetic.rooms.similarity import similarity_between
from tests.synthetic.rooms.world import Pose
from tests.synthetic.videos import Lens, room, synthetic_video

__all__ = ["main"]

COMMAND = "import sys; from estimator.command import main; sys.exit(main(sys.argv[1:]))"
FRAMES = 60


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("videos", nargs="+", help="KIND:SEED")
    parser.add_argument("--frames", type=int, default=24, help="to reconstruct from")
    parser.add_argument("--dense", action="store_true")
    parser.add_argument("--k", type=float, default=0.0, help="SIMPLE_RADIAL distortion (default: %(default)s)")
    parser.add_argument("--variable", action="store_true", help="a frame rate that varies")
    parser.add_argument("--turned", type=int, default=0, help="degrees by which the video is stored turned")
    parser.add_argument("--pictures", action="store_true", help="a folder of pictures with EXIF orientations instead")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for video in options.videos:
        kind, seed = video.rsplit(":", 1)
        folder = (
            options.out
            / f"{kind.replace(' ', '-')}-{seed}{options.k or ''}{'v' * options.variable}{options.turned or ''}"
        )
        lens = Lens(k=options.k)
        if not (folder / "truth.json").is_file():
            world = room(kind, int(seed), frames=FRAMES)
            synthetic_video(world, lens, folder, variable=options.variable, turned_deg=options.turned)
        source = _turned_pictures(folder, options.frames) if options.pictures else folder / "video.mp4"
        print(_row(f"{kind} {seed}", source, options.frames, options.dense, lens), flush=True)


def _turned_pictures(folder: Path, count: int) -> Path:
    """A folder of frames of the video, stored turned in turn by each of EXIF's rotations, which says so of each."""
    pictures = folder / "pictures"
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir()
    frames = list(Video(folder / "video.mp4").frames())
    for number, index in enumerate(np.linspace(0, len(frames) - 1, count).astype(int)):
        orientation, quarters = ((1, 0), (6, 1), (3, 2), (8, 3))[number % 4]
        exif = Image.Exif()
        exif[0x0112] = orientation
        picture = Image.fromarray(np.ascontiguousarray(np.rot90(frames[index].colour, quarters)))
        picture.save(pictures / f"{index:06d}.jpg", exif=exif, quality=95)
    return pictures


def _row(name: str, source: Path, frames: int, dense: bool, lens: Lens) -> str:
    """The row of a video: frames placed, lens, poses of all frames in pixels, scale against the truth, seconds."""
    folder = source.parent
    work = folder / f"work-{source.stem}"
    words = [source, "--work", work, "--instances", folder / "instances.json", "--frames", frames]
    started, cpu = time.perf_counter(), _child_seconds()
    result = _estimate([*words, *(["--dense", "auto"] if dense else [])])
    seconds = f"{time.perf_counter() - started:.0f} | {_child_seconds() - cpu:.0f}"
    report = json.loads((work / "reconstruction.json").read_text())["model"]
    cells = [name, f"{report['registered']} of {frames}", f"{report['focal'] * lens.width / lens.focal - 1:+.2%}"]
    poses = read_frame_poses(work)
    if poses.camera is not None:
        off = pose_errors(poses, _true_poses(folder), lens)
        cells.append(f"k {poses.camera.params[3]:+.3f}")
        cells.append(
            f"{off['posed']} of {len(poses.frames)} posed, median {off['median_px']} px, worst {off['worst_px']} px"
        )
    true = _true_scale(folder, work)
    cells += [_against(result, true), seconds]
    if dense:
        cells.append(_against(_estimate([work, "--dense", work / "dense.ply"]), true))
    return f"| {' | '.join(cells)} |"


def _true_poses(folder: Path) -> list[Pose]:
    rows = json.loads((folder / "truth.json").read_text())["frames"]
    return [Pose(np.array(row["rotation"]), np.array(row["translation"])) for row in rows]


def _estimate(words: list[Any]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *map(str, words), "--json"], stdout=subprocess.PIPE, check=True
    )
    record: dict[str, Any] = json.loads(done.stdout)
    return record


def _child_seconds() -> float:
    return sum(os.times()[2:4])


def _true_scale(folder: Path, work: Path) -> float:
    """Metres per unit of the reconstruction, by its camera centres."""
    truth = _true_poses(folder)
    views = read_scene(work).views
    true = np.array([truth[int(Path(view.name).stem)].centre for view in views])
    return 1 / float(similarity_between(true, np.array([view.centre for view in views])).scale)


def _against(result: dict[str, Any], true: float) -> str:
    interval = result["interval"]
    return (
        f"{result['scale'] / true - 1:+.1%} | {interval['low'] / true - 1:+.0%} to {interval['high'] / true - 1:+.0%}"
    )


if __name__ == "__main__":
    main()
