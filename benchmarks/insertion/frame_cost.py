"""Measure the processor time per frame and the peak memory of `insert-object` for a short and a long video.

    python -m benchmarks.insertion.frame_cost --out DIR [--size 640x480 --lengths 60 240 --objects 1]

The videos show a synthetic room along a path forwards and backwards. The work folder is written from the ground truth,
without a reconstruction. The time per frame is the difference between the processor seconds of both runs, divided by
the difference between the numbers of frames. The last line compares the complete compositing with the renderer only, in
one process, without decoding and encoding.
"""

from __future__ import annotations

import argparse
import json
import time
from contextlib import closing
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

#: Number of camera poses of the path; all of them are in the reconstruction.
N_POSES = 20
#: Frames per second.
RATE_HZ = 20.0
MODEL = ROOT / "data" / "models" / "rocking_horse.glb"


def main() -> None:
    """Run the benchmark and print the costs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="640x480", help="WIDTHxHEIGHT")
    parser.add_argument("--lengths", type=int, nargs=2, default=[60, 240], help="frames of the two videos")
    parser.add_argument("--objects", type=int, default=1, help="number of copies of the model")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    lens = Lens(width, height, 500.0 * width / 640)
    seconds = []
    for length in options.lengths:
        folder = options.out / f"{options.size}-{length}"
        if not (folder / FILE_NAME).is_file():
            synthetic_work(room("sitting room", 7, frames=N_POSES), lens, length, folder)
        cpu, memory, record = run(folder, options.objects)
        seconds.append(cpu)
        drawn = [frame["silhouette"] for frame in record["frames"] if frame["silhouette"] is not None]
        rows = np.mean([box["height"] for box in drawn]) if drawn else 0
        print(f"{options.size}, {length} frames: {cpu:.1f} CPU s, peak memory {memory:.0f} MiB, ", end="")
        print(f"object in {len(drawn)} frames, {rows:.0f} rows high", flush=True)
    frames = options.lengths[1] - options.lengths[0]
    per_frame = (seconds[1] - seconds[0]) / frames
    fixed = seconds[0] - per_frame * options.lengths[0]
    print(f"{options.size}: {per_frame:.3f} CPU s per frame and {fixed:.1f} s fixed", flush=True)
    renderer, total = compositing_cost(options.out / f"{options.size}-{options.lengths[0]}")
    ratio = f"{total / renderer:.2f} times"
    print(f"{options.size}: renderer {renderer:.3f}, compositing {total:.3f} CPU s per frame: {ratio}")


def synthetic_work(world: World, lens: Lens, length: int, folder: Path) -> None:
    """Write a work folder with a video of `length` frames, forwards and backwards along the world's path."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    images = [frame.colour for frame in recorded(world, lens)]
    forwards = list(range(len(images)))
    cycle = forwards + forwards[-2:0:-1]
    order = [cycle[k % len(cycle)] for k in range(length)]
    write_video(folder / "video.mp4", (images[k] for k in order), times_of(length, RATE_HZ))
    pinhole_world = replace(world, camera=Pinhole(lens.width, lens.height, lens.focal))
    synthetic = quick_scene(pinhole_world, Knobs(), 3)
    views = tuple(replace(view, name=f"{k:06d}.png") for k, view in enumerate(synthetic.scene.views))
    write_scene(replace(synthetic, scene=replace(synthetic.scene, views=views, dense=None)), pinhole_world, folder)
    (folder / "frames").mkdir(exist_ok=True)
    for view, image in zip(views, images, strict=True):
        cv2.imwrite(str(folder / "frames" / view.name), image[..., ::-1])
    poses = tuple(
        FramePose(
            n,
            n / RATE_HZ,
            views[k].name if n < N_POSES else None,
            "reconstructed",
            views[k].rotation,
            views[k].translation,
        )
        for n, k in enumerate(order)
    )
    write_frame_poses(FramePoses(folder / "video.mp4", views[0].camera, 0, poses), folder / FILE_NAME)
    result = {"schema": "metric-tree/scale/1", "status": "resolved", "scale": synthetic.truth.metres_per_unit}
    (folder / "result.json").write_text(json.dumps(result) + "\n", encoding="utf-8")


def run(work: Path, n_objects: int) -> tuple[float, float, dict[str, list[dict[str, dict[str, float]]]]]:
    """Insert copies of the object; return processor seconds, peak memory in MiB and the printed record."""
    out = work.with_name(f"{work.name}-out.mp4")
    arguments = [work, *["--model", MODEL] * n_objects, "--out", out, "--json"]
    child = run_child(ours("insert-object", *arguments))
    if child.status:
        raise SystemExit(child.errors)
    return child.cpu_s, child.peak_mib, json.loads(child.output)


def compositing_cost(work: Path) -> tuple[float, float]:
    """Return the processor seconds per frame of the renderer and of the complete compositing.

    Decoding and encoding are not included.
    """
    from insertion.composite import compositor as frames
    from insertion.insertion_scene import open_scene
    from insertion.placement.placed_object import place_objects
    from insertion.render.renderer import ObjectRenderer
    from insertion.request import ObjectRequest, SceneSource
    from insertion.scene.scale import read_scale

    seconds = {"renderer": 0.0, "compositing": 0.0}

    def timed(function: Any, name: str) -> Any:
        def run_timed(*arguments: Any) -> Any:
            start = time.process_time()
            result = function(*arguments)
            seconds[name] += time.process_time() - start
            return result

        return run_timed

    prepared = open_scene(SceneSource(folder=work, scale=read_scale(work, None)))
    placed = place_objects([ObjectRequest(MODEL)], prepared.space, prepared.footage.frames)
    with (
        mock.patch.object(ObjectRenderer, "image", timed(ObjectRenderer.image, "renderer")),
        mock.patch.object(frames.Compositor, "draw", timed(frames.Compositor.draw, "compositing")),
    ):
        start_s = prepared.footage.start_s
        compositor = frames.Compositor(placed, prepared.light, prepared.content, start_s, smooth_look=True)
        with closing(compositor):
            frames.composite_footage(compositor, prepared.footage, prepared.scale, lambda *_: None)
    count = len(prepared.footage.frames)
    return seconds["renderer"] / count, seconds["compositing"] / count


if __name__ == "__main__":
    main()
