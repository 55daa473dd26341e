"""Insertion into a synthetic video: distortion, rotation, variable times and sound."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from capture.frame_poses import FILE_NAME, FramePose, FramePoses, write_frame_poses
from capture.sources.video import Video
from estimator.records.scene import Camera
from metric_cli.insert_object.insert import main
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import similarity_between
from tests.synthetic.rooms.world import Pinhole
from tests.synthetic.videos import Lens, recorded, room, times_of, write_video

FRAMES, TURNED = 7, 90
LENS = Lens(320, 240, 250.0, k=-0.08)


def _add_sound(file: Path) -> None:
    import av

    silent = file.with_name("silent.mp4")
    file.rename(silent)
    with av.open(str(silent)) as source, av.open(str(file), "w") as target:
        video = source.streams.video[0]
        copied = target.add_stream_from_template(video)
        copied.set_display_rotation(-TURNED)
        sound = target.add_stream("aac", rate=8000, layout="mono")
        for packet in source.demux(video):
            if packet.dts is not None:
                packet.stream = copied
                target.mux(packet)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = 8000, 0, Fraction(1, 8000)
        target.mux(sound.encode(frame))
        target.mux(sound.encode())


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("work")
    world = replace(room("kitchen", 1002, frames=FRAMES), camera=Pinhole(LENS.width, LENS.height, LENS.focal))
    synthetic = quick_scene(world, Knobs(depth_noise=0.002, stray=0.0), 3)
    frames = list(recorded(world, LENS))
    times = times_of(FRAMES, variable=True, seed=4)
    write_video(folder / "video.mp4", [frame.colour for frame in frames], times, turned_deg=TURNED)
    _add_sound(folder / "video.mp4")
    stored = Camera("SIMPLE_RADIAL", LENS.width, LENS.height, np.array(LENS.params[1]))
    poses = [
        FramePose(
            k, float(times[k]), f"{k:06d}.png" if k % 2 == 0 else None, "reconstructed", v.rotation, v.translation
        )
        for k, v in enumerate(synthetic.scene.views)
    ]
    # one frame has no pose, as after a blur that nothing survives
    poses[3] = FramePose(3, float(times[3]), None, "none")
    write_frame_poses(FramePoses(folder / "video.mp4", stored, TURNED, tuple(poses)), folder / FILE_NAME)
    named = tuple(replace(v, name=f"{k:06d}.png", camera=stored) for k, v in enumerate(synthetic.scene.views))
    write_scene(replace(synthetic, scene=replace(synthetic.scene, views=named)), world, folder)
    _write_stills(folder / "frames", [frames[k].colour for k in range(0, FRAMES, 2)])
    true = np.array([pose.centre for pose in world.poses])
    scale = similarity_between(true, np.array([v.centre for v in synthetic.scene.views])).scale
    (folder / "result.json").write_text(
        f'{{"schema": "metric-tree/scale/1", "status": "resolved", "scale": {1 / scale}, '
        f'"interval": {{"level": 0.9, "low": {0.9 / scale}, "high": {1.15 / scale}}}}}'
    )
    write_glb(solid("chair", np.array([0.4, 0.4, 0.8])), folder / "chair.glb")
    return folder


def _write_stills(folder: Path, pictures: list[np.ndarray]) -> None:
    import cv2

    folder.mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{2 * k:06d}.png"), picture[..., ::-1])


@pytest.mark.slow
def test_a_video_keeps_its_times_sound_and_rotation(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    import av

    out = tmp_path / "out.mp4"
    assert main([str(work), "--model", str(work / "chair.glb"), "--out", str(out), "--show-interval", "--json"]) == 0
    captured = capsys.readouterr()
    record = json.loads(captured.out)
    assert record["scale"]["source"] == "result"
    assert record["scale"]["low"] < record["scale"]["metres_per_unit"] < record["scale"]["high"]
    assert "1 frame(s) have no known pose" in captured.err
    source, result = Video(work / "video.mp4"), Video(out)
    assert (result.width, result.height, result.turned_deg) == (source.width, source.height, TURNED)
    before, after = list(source.frames()), list(result.frames())
    assert [f.time_s for f in after] == pytest.approx([f.time_s for f in before], abs=1e-4)
    with av.open(str(out)) as container:
        assert len(container.streams.audio) == 1
    changed = [np.abs(a.colour.astype(int) - b.colour).max(axis=-1) for a, b in zip(after, before, strict=True)]
    frames = record["frames"]
    seen = [frame["silhouette"] is not None for frame in frames]
    # The place is chosen where the camera looks, which depends on the tree's release.
    assert sum(seen) >= len(seen) // 3
    assert not seen[3]
    clear = [k for k, frame in enumerate(frames) if seen[k] and frame["visible"] > 0.5]
    assert clear
    # A frame without a pose carries the codec's noise alone.
    noise = float(changed[3].mean())
    assert min(_mean_in_box(changed[k], frames[k]["silhouette"]) for k in clear) > 3 * noise


def _mean_in_box(values: np.ndarray, box: dict[str, float]) -> float:
    x, y, width, height = (int(box[name]) for name in ("x", "y", "width", "height"))
    return float(values[max(y, 0) : y + height, max(x, 0) : x + width].mean())
