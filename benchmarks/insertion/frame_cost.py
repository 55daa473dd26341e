"""What `insert-object` costs a frame, and its peak memory for short and long videos.

`python -m benchmarks.insertion.frame_cost --out DIR [--size 640x480 --lengths 60 240]`. A synthetic
room is recorded along a path to and fro; the work folder comes from the truth, not from a reconstruction. The command
runs once for each length; seconds a frame are the difference of the processor seconds over that of the frames. The
last line compares all that is drawn with the renderer alone, in one process, without decoding and encoding.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.child import ours, run_child
from benchmarks.common import ROOT
from capture.frame_poses import FILE_NAME, FramePose, FramePoses, write_frame_poses
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.world import Pinhole, World
from tests.synthetic.videos import Lens, recorded, room, times_of, write_video

#: Different frames of the path, all of them of the reconstruction, and frames a second.
PATH, RATE = 20, 20.0
MODEL = ROOT / "data" / "models" / "rocking_horse.glb"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="640x480", help="WIDTHxHEIGHT")
    parser.add_argument("--lengths", type=int, nargs=2, default=[60, 240], help="frames of the two videos")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    lens = Lens(width, height, 500.0 * width / 640)
    spent = []
    for length in options.lengths:
        folder = options.out / f"{options.size}-{length}"
        if not (folder / FILE_NAME).is_file():
            synthetic_work(room("sitting room", 7, frames=PATH), lens, length, folder)
        cpu, memory, record = run(folder)
        spent.append(cpu)
        drawn = [frame["silhouette"] for frame in record["frames"] if frame["silhouette"] is not None]
        rows = np.mean([box["height"] for box in drawn]) if drawn else 0
        print(f"{options.size}, {length} frames: {cpu:.1f} CPU s, peak memory {memory:.0f} MiB, ", end="")
        print(f"object in {len(drawn)} frames, {rows:.0f} rows high", flush=True)
    frames = options.lengths[1] - options.lengths[0]
    print(f"{options.size}: {(spent[1] - spent[0]) / frames:.3f} CPU s a frame", flush=True)
    alone, whole = drawing_cost(options.out / f"{options.size}-{options.lengths[0]}")
    print(f"{options.size}: renderer alone {alone:.3f}, drawing {whole:.3f} CPU s a frame: {whole / alone:.2f} times")


def synthetic_work(world: World, lens: Lens, length: int, folder: Path) -> None:
    """A work folder with a video of `length` frames, to and fro along the world's path."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    pictures = [frame.colour for frame in recorded(world, lens)]
    there = list(range(len(pictures)))
    cycle = there + there[-2:0:-1]
    order = [cycle[k % len(cycle)] for k in range(length)]
    write_video(folder / "video.mp4", (pictures[k] for k in order), times_of(length, RATE))
    seen = replace(world, camera=Pinhole(lens.width, lens.height, lens.focal))
    synthetic = quick_scene(seen, Knobs(), 3)
    views = tuple(replace(view, name=f"{k:06d}.png") for k, view in enumerate(synthetic.scene.views))
    write_scene(replace(synthetic, scene=replace(synthetic.scene, views=views, dense=None)), seen, folder)
    (folder / "frames").mkdir(exist_ok=True)
    for view, picture in zip(views, pictures, strict=True):
        cv2.imwrite(str(folder / "frames" / view.name), picture[..., ::-1])
    poses = tuple(
        FramePose(
            n, n / RATE, views[k].name if n < PATH else None, "reconstructed", views[k].rotation, views[k].translation
        )
        for n, k in enumerate(order)
    )
    write_frame_poses(FramePoses(folder / "video.mp4", views[0].camera, 0, poses), folder / FILE_NAME)
    result = {"schema": "metric-tree/scale/1", "status": "resolved", "scale": synthetic.truth.metres_per_unit}
    (folder / "result.json").write_text(json.dumps(result) + "\n", encoding="utf-8")


def run(work: Path) -> tuple[float, float, dict[str, list[dict[str, dict[str, float]]]]]:
    """CPU seconds, peak memory in MiB and the printed record of one insertion."""
    out = work.with_name(f"{work.name}-out.mp4")
    arguments = [work, "--model", MODEL, "--out", out, "--json"]
    child = run_child(ours("insert-object", *arguments))
    if child.status:
        raise SystemExit(child.errors)
    return child.cpu_s, child.peak_mib, json.loads(child.output)


def drawing_cost(work: Path) -> tuple[float, float]:
    """CPU seconds a frame of the renderer alone, and of all that is drawn, without decoding and encoding."""
    from insertion.composite import compositor as frames
    from insertion.insertion_scene import open_scene
    from insertion.placement.placed_object import place_objects
    from insertion.render.renderer import ObjectRenderer
    from insertion.request import ObjectRequest, SceneSource
    from insertion.scene.scale import read_scale

    spent = {"alone": 0.0, "whole": 0.0}

    def clocked(function: Any, name: str) -> Any:
        def run_it(*arguments: Any) -> Any:
            start = time.process_time()
            result = function(*arguments)
            spent[name] += time.process_time() - start
            return result

        return run_it

    prepared = open_scene(SceneSource(folder=work, scale=read_scale(work, None)))
    placed = place_objects([ObjectRequest(MODEL)], prepared.space, prepared.footage.frames)
    with (
        mock.patch.object(ObjectRenderer, "image", clocked(ObjectRenderer.image, "alone")),
        mock.patch.object(frames.Compositor, "draw", clocked(frames.Compositor.draw, "whole")),
    ):
        frames.composite_footage(
            placed,
            prepared.light,
            prepared.content,
            prepared.footage,
            prepared.scale,
            lambda *_: None,
            smooth_look=True,
        )
    count = len(prepared.footage.frames)
    return spent["alone"] / count, spent["whole"] / count


if __name__ == "__main__":
    main()
