"""Starts of the camera in `capture.mapping.incremental`, on synthetic matches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.mapping import incremental, mapper
from capture.mapping.camera_models import ModelScore
from capture.mapping.camera_prior import Lens
from capture.mapping.incremental import compare_global, finish, mapping, n_consistent
from capture.mapping.refusals import MAX_DISAGREEMENT, MIN_WHOLE_RATIO
from estimator.reconstructions.pycolmap_library import pycolmap
from tests.synthetic.wrong_pieces import move_frames

N_FRAMES = 8


def made(database: Path, distortion: float = 0.0) -> Any:
    """Write a database of exact matches of `N_FRAMES` frames, and return their model."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=N_FRAMES, num_cameras_per_rig=1, num_frames_per_rig=1)
    options.num_points3D, options.camera_model_id = 150, pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [600.0, 512.0, 384.0, distortion]
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(database) as opened:
        return pycolmap.synthesize_dataset(options, opened)


@pytest.mark.parametrize(("distortion", "n"), [(0.27, N_FRAMES), (0.29, 0)])
def test_model_whose_lens_bends_the_image_by_a_fifth_needs_another_start(
    tmp_path: Path, distortion: float, n: int
) -> None:
    """The corners of 1024 x 768 pixels move by 0.192 and 0.206 of the width."""
    file = tmp_path / "matches.db"
    assert n_consistent(made(file, distortion), file) == n


@pytest.mark.parametrize(("linked", "starts"), [(int(N_FRAMES / MIN_WHOLE_RATIO), 1), (N_FRAMES + 3, 2)])
def test_next_start_is_tried_if_less_than_80_percent_of_the_linked_frames_agree(
    tmp_path: Path, linked: int, starts: int
) -> None:
    """Eight frames are 80 % of ten linked ones, and 73 % of eleven."""
    file, output = tmp_path / "matches.db", tmp_path / "models"
    made(file)
    output.mkdir()
    camera = {"model": "SIMPLE_RADIAL", "params": None, "held": False, "if_stated": None}
    request = {"database": str(file), "images": str(tmp_path), "output": str(output), "cameras": [camera] * 2}
    result = mapping(request | {"fixed": True, "free": False, "linked": linked}, lambda _: None)
    assert len(result["model"]["names"]) == N_FRAMES
    assert len(list(output.glob("[01].db"))) == starts


@pytest.mark.parametrize(("shift", "agrees"), [(0.01, True), (0.05, False)])
def test_global_mapper_contradicts_a_model_with_a_frame_at_a_wrong_place(
    tmp_path: Path, shift: float, agrees: bool
) -> None:
    """One of eight frames is moved by a part of the path's extent; the root mean square distance is 0.35 of it."""
    file, folder, output = tmp_path / "matches.db", tmp_path / "model", tmp_path / "global"
    model = made(file)
    move_frames(model, {min(image.name for image in model.images.values())}, np.eye(3), shift, 1.0)
    for path in (folder, output):
        path.mkdir()
    model.write_binary(str(folder))
    request = {"database": str(file), "images": str(tmp_path), "output": str(output), "folder": str(folder)}
    assert (compare_global(request)["disagreement"] < MAX_DISAGREEMENT) == agrees


@pytest.mark.parametrize(
    ("changes", "models", "helds"),
    [
        ({}, ["A", "A", "A", "SIMPLE_RADIAL", "F", "F"], [False, True, True, False, True, True]),
        (
            {"wide_px": 300.0},
            ["F", "A", "A", "A", "SIMPLE_RADIAL", "F", "F"],
            [True, False, True, True, False, True, True],
        ),
        ({"fixed": True}, ["A"], [False]),
        ({"free": False}, ["A"], [False]),
    ],
)
def test_the_cameras_that_are_tried_in_turn(changes: dict[str, Any], models: list[str], helds: list[bool]) -> None:
    lens = replace(Lens("OPENCV", 500.0, False, 640, 480, free=True), **changes)
    cameras = mapper.candidate_cameras(lens)
    names = {"A": "OPENCV", "F": "OPENCV_FISHEYE"}
    assert [camera["model"] for camera in cameras] == [names.get(name, name) for name in models]
    assert [camera["held"] for camera in cameras] == helds
    focals = [camera["params"] and camera["params"][0] for camera in cameras]
    if len(cameras) > 1:
        assert focals[-4:] == pytest.approx([0.85 * 640, 0.4 * 640, 0.48 * 640, 0.34 * 640])
        assert [camera["if_stated"] for camera in cameras][-4:] == [False] * 4


@pytest.mark.parametrize(("deviation", "n_removed"), [(0.09, 0), (0.11, 1)])
def test_frames_whose_steps_vary_by_more_than_a_tenth_are_removed(
    deviation: float, n_removed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MAX_STEP_STD, relative to the length of the step."""
    output = tmp_path / "models"
    (output / "0").mkdir(parents=True)
    model = made(output / "0.db")
    model.write_binary(str(output / "0"))
    last = max(image.name for image in model.images.values())

    def steps(model: Any) -> tuple[float, dict[str, float]]:
        return 0.01, {image.name: deviation for image in model.images.values() if image.name == last}

    monkeypatch.setattr(incremental, "standard_deviations", steps)
    request = {"output": str(output), "images": str(output), "fixed": True, "free": False}
    figures = finish(request)["model"]
    assert list(figures["undetermined"]) == [last] * n_removed
    assert len(figures["names"]) == N_FRAMES - n_removed


def test_a_mapping_without_a_model_has_no_figures(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    assert finish({"output": str(tmp_path)}) == {"model": None}


@pytest.mark.parametrize(("n_removed", "is_compared"), [(4, True), (5, False)])
def test_two_mappers_are_compared_if_they_share_half_of_the_frames(
    n_removed: int, is_compared: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MIN_SHARED_RATIO of the eight frames of the first model."""
    model, other = made(tmp_path / "a.db"), made(tmp_path / "b.db")
    for image in sorted(other.images.values(), key=lambda one: one.name)[:n_removed]:
        other.deregister_frame(image.frame_id)
    (tmp_path / "model").mkdir()
    model.write_binary(str(tmp_path / "model"))
    monkeypatch.setattr(incremental.pycolmap, "global_mapping", lambda *_, **__: {0: other})
    request = {"database": "", "images": "", "output": "", "folder": str(tmp_path / "model")}
    found = compare_global(request)["disagreement"]
    assert (found is not None) == is_compared
    monkeypatch.setattr(incremental.pycolmap, "global_mapping", lambda *_, **__: {})
    assert compare_global(request) == {"disagreement": None}


@pytest.mark.parametrize(("pattern", "is_free", "names"), [(0.059, True, None), (0.061, True, 3), (0.061, False, 4)])
def test_camera_models_are_compared_if_the_residuals_have_a_pattern(
    pattern: float, is_free: bool, names: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MIN_COMPARED_PATTERN; the model of the user is compared with the candidates."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=4)
    options.num_points3D = 20
    model = pycolmap.synthesize_dataset(options)
    model.write_binary(str(tmp_path))
    compared: list[tuple[str, ...]] = []

    def scores(_: Path, names: tuple[str, ...]) -> dict[str, ModelScore]:
        compared.append(names)
        return {name: ModelScore(1.0, 0.0, 0.0, [600.0]) for name in names}

    monkeypatch.setattr(incremental, "residual_pattern", lambda *_: pattern)
    monkeypatch.setattr(incremental, "model_scores", scores)
    monkeypatch.setattr(incremental, "CANDIDATE_MODELS", ("SIMPLE_RADIAL", "RADIAL", "OPENCV"))
    for camera in model.cameras.values():
        camera.model = pycolmap.CameraModelId.SIMPLE_RADIAL if is_free else pycolmap.CameraModelId.FOV
        camera.params = [600.0, 512.0, 384.0, 0.0] if is_free else [600.0, 600.0, 512.0, 384.0, 0.1]
    choice = incremental.compare_camera_models(model, tmp_path, is_free)
    assert (choice is not None) == (names is not None)
    assert [len(one) for one in compared] == ([] if names is None else [names])
