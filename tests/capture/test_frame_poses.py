"""The file of all frames' poses: it is read as written, and errors are named."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from capture import localisation
from capture.frame_poses import FILE_NAME, FramePose, FramePoses, read_frame_poses, scaled_camera, write_frame_poses
from capture.localisation import localised_frames
from capture.sources.video import VideoFrame
from estimator.projection.cameras import project, view_rays
from estimator.records.scene import Camera, Scene, View
from metric_base.errors import InputError

CAMERA = Camera("SIMPLE_RADIAL", 640, 480, np.array([500.0, 320.0, 240.0, 0.01]))


def _poses(seed: int, n: int) -> FramePoses:
    generator = np.random.default_rng(seed)
    turns = Rotation.random(n, rng=generator).as_matrix()
    frames = [
        FramePose(
            k, k / 30, f"{k:06d}.jpg" if k % 3 == 0 else None, "localised", turns[k], generator.normal(size=3), 0.4, 99
        )
        if k % 4
        else FramePose(k, k / 30, None, "none")
        for k in range(n)
    ]
    return FramePoses(Path("/videos/room.mp4"), CAMERA, 90, tuple(frames))


@given(st.integers(0, 10_000), st.integers(1, 12))
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, seed: int, n: int) -> None:
    poses = _poses(seed, n)
    folder = tmp_path_factory.mktemp("poses")
    write_frame_poses(poses, folder / FILE_NAME)
    again = read_frame_poses(folder)
    assert (again.source, again.turned_deg, len(again.frames)) == (poses.source, 90, n)
    assert again.camera is not None
    assert (again.camera.model, again.camera.params.tolist()) == ("SIMPLE_RADIAL", CAMERA.params.tolist())
    for one, two in zip(poses.frames, again.frames, strict=True):
        assert (one.index, one.time_s, one.name, one.origin, one.check_px) == (
            two.index, two.time_s, two.name, two.origin, two.check_px,
        )  # fmt: skip
        if one.rotation is not None:
            np.testing.assert_array_equal(one.rotation, two.rotation)
            np.testing.assert_array_equal(one.centre, two.centre)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"schema": "metric-tree/frame-poses/2"}, "schema"),
        ({"frames": [{"index": 0}]}, "frames"),
        ({"frames": 3}, "frames"),
        ({"camera": {"model": "PINHOLE"}}, "frames"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: dict[str, object], word: str) -> None:
    file = tmp_path / FILE_NAME
    write_frame_poses(_poses(2, 3), file)
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(InputError, match=word) as error:
        read_frame_poses(file)
    assert str(file) in str(error.value)


def test_a_pose_agrees_with_its_origin(tmp_path: Path) -> None:
    file = tmp_path / FILE_NAME
    write_frame_poses(_poses(2, 3), file)
    document = json.loads(file.read_text())
    document["frames"][1]["origin"] = "none"
    file.write_text(json.dumps(document))
    with pytest.raises(InputError, match="origin 'none'"):
        read_frame_poses(file)


@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("SIMPLE_RADIAL", [300.0, 170.0, 110.0, 0.05]),
        ("OPENCV", [300.0, 290.0, 150.0, 130.0, 0.05, -0.01, 0.002, 0.001]),
    ],
)
def test_the_camera_of_the_source_shows_the_same_at_its_own_size(model: str, params: list[float]) -> None:
    camera = Camera(model, 320, 240, np.array(params))
    source = scaled_camera(camera, 1280, 960)
    points = np.random.default_rng(0).uniform([-1, -0.7, 2], [1, 0.7, 5], (50, 3))
    assert np.allclose(project(source, points), 4 * project(camera, points))


def test_a_reconstructed_frame_with_pixels_outside_the_lens_model_is_written(tmp_path: Path) -> None:
    """Their rays are NaN; so was the error, which JSON does not have."""
    generator = np.random.default_rng(1)
    camera = Camera("SIMPLE_RADIAL", 640, 480, np.array([300.0, 320.0, 240.0, -0.9]))
    points = np.column_stack([generator.uniform(-1, 1, (40, 2)), generator.uniform(4, 6, 40)])
    keypoints = project(camera, points)
    keypoints[::3] = [639.0, 479.0]  # beyond the largest radius that the model maps to
    view = View("000000.jpg", camera, np.eye(3), np.zeros(3), keypoints, np.arange(40))
    assert np.isnan(view_rays(camera, keypoints)).any()
    colour = np.zeros((480, 640, 3), np.uint8)
    frame = VideoFrame(0, 0.0, colour)
    scene = Scene(tmp_path, "memory", (view,), points)
    poses = tuple(localised_frames([frame], scene, {0: view.name}, 640))
    assert poses[0].check_px == pytest.approx(0.0, abs=1e-3)
    write_frame_poses(FramePoses(tmp_path / "a.mp4", camera, 0, poses), tmp_path / FILE_NAME)
    behind = replace(scene, points=points * [1, 1, -1])
    assert next(localised_frames([frame], behind, {0: view.name}, 640)).check_px is None


@pytest.mark.parametrize(
    ("origin", "rotation", "translation", "message"),
    [
        ("none", None, None, None),
        ("model", np.eye(3), np.zeros(3), None),
        ("none", np.eye(3), np.zeros(3), "do not fit the origin"),
        ("model", None, None, "do not fit the origin"),
        ("model", np.eye(3), None, "do not fit the origin"),
        ("model", np.eye(4), np.zeros(3), "do not fit the origin"),
        ("model", np.eye(3), np.zeros(4), "do not fit the origin"),
    ],
)
def test_a_pose_fits_its_origin(origin: Any, rotation: Any, translation: Any, message: str | None) -> None:
    with nullcontext() if message is None else pytest.raises(ValueError, match=message):
        pose = FramePose(1, 0.1, "a.jpg", origin, rotation, translation)
        assert (pose.centre is None) == (origin == "none")


@pytest.mark.parametrize(
    ("n_between", "calls"),
    [
        (0, [(0, False, True), (0, True, False)]),
        (199, [(0, False, True), (199, True, True), (0, True, False)]),
        (200, [(0, False, True), (200, True, False), (0, False, True), (0, True, False)]),
    ],
)
def test_at_most_200_frames_wait_for_a_reconstructed_one(
    n_between: int, calls: list[tuple[int, bool, bool]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Number of frames, and whether there is a reconstructed one before and after them."""
    found = []

    class Tracker:
        def __init__(self, *_: object) -> None:
            pass

        def anchor(self, view: View, frame: VideoFrame, grey: object) -> tuple[FramePose, object, None]:
            return FramePose(frame.index, 0.0, view.name, "reconstructed", np.eye(3), np.zeros(3)), grey, None

        def between(self, waiting: list[tuple[FramePose, object]], before: object, after: object) -> list[FramePose]:
            found.append((len(waiting), before is not None, after is not None))
            return [pose for pose, _ in waiting]

    monkeypatch.setattr(localisation, "FrameTracker", Tracker)
    empty = np.empty((0, 2))
    view = View("a.jpg", CAMERA, np.eye(3), np.zeros(3), empty, np.empty(0, dtype=np.int64))
    grey = np.zeros((4, 4, 3), dtype=np.uint8)
    n = n_between + 2 if n_between else 1
    frames = [VideoFrame(index, index / 30, grey) for index in range(n)]
    names = {0: "a.jpg", n - 1: "a.jpg"}
    poses = list(localised_frames(frames, Scene(Path(), "memory", (view,), np.empty((0, 3))), names, 640))
    assert [pose.index for pose in poses] == list(range(n))
    assert found == calls


@pytest.mark.parametrize(
    ("times", "origin"),
    [
        ((0.0, 0.4, 0.95), "interpolated"),
        ((0.0, 0.4, 1.05), "none"),  # MAX_GAP_S
        ((0.0, None, 0.9), "none"),
        ((None, 0.4, 0.9), "none"),
        ((0.0, 0.4, None), "none"),
    ],
)
def test_poses_are_interpolated_over_a_second(times: tuple[float | None, ...], origin: str) -> None:
    turn = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    ends = [
        FramePose(0, times[0], "a", "reconstructed", np.eye(3), np.zeros(3)),
        FramePose(9, times[2], "b", "localised", turn, -turn @ [1.0, 0, 0]),
    ]
    view = View("a", CAMERA, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    tracker = localisation.FrameTracker(Scene(Path(), "memory", (view,), np.empty((0, 3))), 640)
    pose = FramePose(4, times[1], None, "none")
    found = tracker.interpolated(pose, ends, None)
    assert found.origin == origin
    if found.rotation is not None:
        assert found.centre == pytest.approx(np.array([0.4 / 0.95, 0, 0]))
        assert Rotation.from_matrix(found.rotation).magnitude() == pytest.approx(np.radians(30) * 0.4 / 0.95)
    assert tracker.interpolated(pose, ends[:1], None).origin == "none"
    assert tracker.interpolated(pose, ends[1:], None).origin == "none"
    assert tracker.interpolated(ends[0], ends, None) is ends[0]
