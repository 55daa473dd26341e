"""Rendered videos through wide and ordinary lenses: `python -m benchmarks.estimator.wide_lenses [--write]`.

Each row is one furnished room recorded through one lens. `--write` puts the table into docs/evidence/real_footage.md.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import write_between
from benchmarks.estimator.real_footage import PAGE, path_error
from estimator.capture.capture import CaptureOptions, reconstruct
from estimator.capture.mapping.failures import CaptureFailure
from estimator.capture.work_folder import WorkFolder
from estimator.reconstructions.colmap import read_colmap
from tests.synthetic.videos import Lens, orbit, recorded, room, times_of, write_video

__all__ = ["LENSES", "main", "row_of"]

FRAMES, WIDTH, HEIGHT = 24, 640, 360
#: By name: the lens. The fisheye lenses are an ideal one and two with the bends of action cameras.
LENSES = {
    "fisheye 0.45, bent outwards": Lens(WIDTH, HEIGHT, 0.45 * WIDTH, fisheye=(0.05, 0.03, -0.02, 0.005)),
    "fisheye 0.50, ideal": Lens(WIDTH, HEIGHT, 0.5 * WIDTH, fisheye=(0.0, 0.0, 0.0, 0.0)),
    "fisheye 0.60, bent inwards": Lens(WIDTH, HEIGHT, 0.6 * WIDTH, fisheye=(-0.04, -0.01, 0.0, 0.0)),
    "radial 0.40": Lens(WIDTH, HEIGHT, 0.4 * WIDTH, k=-0.02),
    "radial 0.78": Lens(WIDTH, HEIGHT, 0.78 * WIDTH, k=-0.08),
}
ROOMS = (("sitting room", 7), ("bedroom", 3))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", nargs="+", default=list(LENSES), metavar="NAME")
    parser.add_argument("--write", action="store_true", help=f"write the table of {PAGE}")
    options = parser.parse_args()
    head = "| lens | room | camera model | placed | focal length, error | path | residual, px | s |"
    lines = [head, "|---" * (head.count("|") - 1) + "|"]
    for name in options.lenses:
        for kind, seed in ROOMS:
            lines.append(f"| {name} | {kind} | " + " | ".join(row_of(LENSES[name], kind, seed)) + " |")
            print(lines[-1], flush=True)
    if options.write:
        write_between(PAGE, "wide", "\n".join(lines))


def row_of(lens: Lens, kind: str, seed: int) -> list[str]:
    """Cells of one video: camera model, frames placed, errors of focal length and path, residual, processor seconds."""
    world = room(kind, seed, orbit(2.2, FRAMES, seed, degrees=60.0))
    with tempfile.TemporaryDirectory() as folder:
        video, work = Path(folder) / "video.mp4", WorkFolder(Path(folder) / "work")
        frames = list(recorded(world, lens, seed=seed))
        write_video(video, [frame.colour for frame in frames], times_of(len(frames), rate=10.0))
        cpu = sum(os.times()[:4])
        with work.lock():
            try:
                reconstruct(video, work, CaptureOptions(frames=FRAMES))
            except CaptureFailure as refusal:
                return [f"`{refusal.failure.code}`", "", "", "", "", f"{sum(os.times()[:4]) - cpu:.0f}"]
        seconds = sum(os.times()[:4]) - cpu
        scene = read_colmap(work.path / "sparse" / "0")
        report = json.loads((work.path / "reconstruction.json").read_text(encoding="utf-8"))["model"]
    camera = scene.views[0].camera
    focal = camera.params[:2].mean() if camera.model.startswith(("OPENCV", "THIN")) else camera.params[0]
    true = np.array(
        [
            -frames[int(view.name[:6])].pose.rotation.T @ frames[int(view.name[:6])].pose.translation
            for view in scene.views
        ]
    )
    path = path_error(np.array([view.centre for view in scene.views]), true)
    placed, error = f"{len(scene.views)} of {FRAMES}", f"{100 * (focal / lens.focal - 1):+.1f} %"
    return [camera.model, placed, error, f"{100 * path:.1f} %", f"{report['error_px']:.2f}", f"{seconds:.0f}"]


if __name__ == "__main__":
    main()
