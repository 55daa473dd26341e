"""Standard deviations of a model: frames that share only distant points have steps of no certain length."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.mapping.covariance import standard_deviations
from capture.mapping.incremental import finish
from capture.mapping.refusals import MAX_STEP_STD
from estimator.reconstructions.pycolmap_library import pycolmap

N_FRAMES, FIRST_DISTANT = 16, 12


def _walk(noise_px: float, distant: bool, origin: float = 0.0) -> Any:
    """A walk sideways past points at 2 to 6 m; the last frames see points at 150 to 400 m alone if `distant`."""
    generator = np.random.default_rng(0)
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=[500, 320, 240, 0.0], camera_id=1)
    model.add_camera_with_trivial_rig(lens)
    centres = np.column_stack([0.3 * np.arange(N_FRAMES), 0.05 * np.sin(np.arange(N_FRAMES)), np.zeros(N_FRAMES)])
    turns = [
        pycolmap.Rotation3d(np.array([0.0, np.sin(a / 2), 0.0, np.cos(a / 2)])) for a in 0.03 * np.arange(N_FRAMES)
    ]
    close = np.column_stack(
        [generator.uniform(-3, 8, 900), generator.uniform(-2, 2, 900), generator.uniform(2, 6, 900)]
    )
    far = generator.uniform([-150, -90, 150], [100, 90, 400], (900, 3))
    points = np.concatenate([close, far])
    observed: list[list[tuple[int, int]]] = [[] for _ in points]
    for k in range(N_FRAMES):
        rotation = turns[k].matrix()
        local = (points - centres[k]) @ rotation.T
        pixels = np.asarray(lens.img_from_cam(local)) + generator.normal(0, noise_px, (len(points), 2))
        inside = (local[:, 2] > 0.5) & (pixels > 0).all(axis=1) & (pixels < (640, 480)).all(axis=1)
        if distant and k >= FIRST_DISTANT:
            inside[: len(close)] = False
        rows = np.flatnonzero(inside)
        image = pycolmap.Image(name=f"{k:02d}.jpg", keypoints=pixels[rows], camera_id=1, image_id=k + 1)
        pose = pycolmap.Rigid3d(turns[k], -rotation @ centres[k])
        model.add_image_with_trivial_frame(image, pose)
        for place, row in enumerate(rows):
            observed[row].append((k + 1, place))
    for point, elements in zip(points, observed, strict=True):
        if len(elements) > 1:
            track = pycolmap.Track([pycolmap.TrackElement(*element) for element in elements])
            model.add_point3D(point, track, np.zeros(3, dtype=np.uint8))
    pycolmap.bundle_adjustment(model, pycolmap.BundleAdjustmentOptions(print_summary=False))
    model.update_point_3d_errors()
    if origin:
        model.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(), np.array([origin, 0.0, 0.0])))
    return model


def test_steps_before_distant_points_are_undetermined() -> None:
    _, steps = standard_deviations(_walk(0.5, distant=True))
    assert max(std for name, std in steps.items() if name < f"{FIRST_DISTANT - 1:02d}") < 0.3 * MAX_STEP_STD
    assert min(std for name, std in steps.items() if name >= f"{FIRST_DISTANT:02d}") > MAX_STEP_STD
    _, steps = standard_deviations(_walk(0.5, distant=False))
    assert max(steps.values()) < 0.3 * MAX_STEP_STD


def test_the_standard_deviation_of_steps_does_not_depend_on_the_origin() -> None:
    """It would if the tangent space of COLMAP's rotations were another one."""
    _, here = standard_deviations(_walk(0.5, distant=True))
    _, there = standard_deviations(_walk(0.5, distant=True, origin=10.0))
    assert {name: there[name] for name in here} == pytest.approx(here, rel=0.05, abs=1e-3)


def test_frames_of_undetermined_steps_are_removed(tmp_path: Path) -> None:
    output = tmp_path / "models"
    (output / "0").mkdir(parents=True)
    _walk(0.5, distant=True).write_binary(str(output / "0"))
    with pycolmap.Database.open(tmp_path / "empty.db"):
        pass
    shutil.copyfile(tmp_path / "empty.db", output / "0.db")
    request = {"output": str(output), "images": str(output), "fixed": False, "free": False}
    figures = finish(request)["model"]
    assert list(figures["undetermined"]) == [f"{k:02d}.jpg" for k in range(FIRST_DISTANT, N_FRAMES)]
    assert list(figures["names"]) == [f"{k:02d}.jpg" for k in range(FIRST_DISTANT)]
    assert figures["step_deviation"] < MAX_STEP_STD
