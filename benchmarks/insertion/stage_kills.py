"""`estimate-scale` on a video, killed with SIGKILL in the middle of every stage: `... stage_kills --out DIR`.

An undisturbed run says what is right and how long each stage takes. A second one is killed, its whole process group at
once, in each stage after half of that stage's time, and started again each time. Printed: for each stage whether its
output was absent after the kill, what differs at the end, and what COLMAP reads of the work folder.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from estimator.capture.frame_poses import read_frame_poses
from estimator.reading import read_scene
from estimator.reconstructions.ply import read_dense_cloud
from estimator.reconstructions.pycolmap_library import pycolmap
from metric_cli.terminal import print_table

__all__ = ["main"]

ROOT = Path(__file__).resolve().parents[2]
VIDEO = ROOT / "data" / "scenes" / "demo_video"
STAGES = ("frames", "features", "matches", "mapping", "model", "poses", "dense", "instances")
#: Two runs of the mapper give the same scale up to this share.
SAME = 1e-4
COMMAND = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main(sys.argv[1:]))"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    right, killed = options.out / "right", options.out / "killed"
    _start(right, options.frames).wait()
    rows = [_kill(killed, options.frames, stage, _seconds(right, stage) / 2) for stage in STAGES]
    status = _start(killed, options.frames).wait()
    print_table(("stage", "killed in it", "stamped", "left running"), rows)
    print(f"exit {status}; differs: {_differences(right, killed) or 'nothing'}")
    print(_readable(killed))


def _start(work: Path, frames: int) -> subprocess.Popen[bytes]:
    words = [VIDEO / "video.mp4", "--instances", VIDEO / "instances.json", "--frames", frames, "--dense", "auto"]
    command = [sys.executable, "-c", COMMAND, *map(str, words), "--work", str(work), "--json"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def _seconds(work: Path, stage: str) -> float:
    return float(json.loads((work / "stamps" / f"{stage}.json").read_text())["seconds"])


def _kill(work: Path, frames: int, stage: str, after: float) -> tuple[object, ...]:
    process = _start(work, frames)
    part = work / f".metric-tree.{stage}.part"
    while process.poll() is None and not part.exists():
        time.sleep(0.002)
    time.sleep(after)
    inside = process.poll() is None and part.exists()
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.3)
    return (stage, inside, (work / "stamps" / f"{stage}.json").exists(), _running(work))


def _running(work: Path) -> int:
    """Processes whose command line names the work folder."""
    lines = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout.splitlines()
    return sum(str(work / ".") in line for line in lines)


def _differences(right: Path, killed: Path) -> list[str]:
    names = [{str(path.relative_to(work)) for path in work.rglob("*")} for work in (right, killed)]
    scales = [json.loads((work / "result.json").read_text())["scale"] for work in (right, killed)]
    differences = sorted(names[0] ^ names[1])
    if abs(scales[0] / scales[1] - 1) > SAME:
        differences.append(f"scale {scales[0]} and {scales[1]}")
    return differences


def _readable(work: Path) -> str:
    """What pycolmap and the readers make of it."""
    model = pycolmap.Reconstruction(str(work / "sparse" / "0"))
    text = work.parent / "text"
    text.mkdir()
    model.write_text(str(text))
    again = read_scene(text)
    counts = []
    for name in ("features", "matches"):
        with pycolmap.Database.open(str(work / "databases" / f"{name}.db")) as database:
            counts.append(f"{name}.db {database.num_images()} images, {database.num_verified_image_pairs()} pairs")
    cloud, _ = read_dense_cloud(work / "dense.ply", len(again.views))
    return (
        f"sparse/0: {model.num_reg_images()} images, {model.num_points3D()} points by pycolmap, {len(again.views)} and "
        f"{len(again.points)} from its text; {'; '.join(counts)}; dense.ply {len(cloud.points)} points; "
        f"{len(read_frame_poses(work).frames)} poses"
    )


if __name__ == "__main__":
    main()
