"""The camera model that explains a wide lens, found by observations that the fit has not seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.mapping.camera_models import CameraModelChoice, ModelScore, chosen_model, focal_change, start_params
from capture.mapping.incremental import compare_camera_models
from capture.mapping.mapper import camera_model_failure
from capture.mapping.model_metrics import residual_pattern
from estimator.reconstructions.pycolmap_library import pycolmap

WIDE = [375.0, 375.0, 424.0, 240.0, 0.043, 0.041, -0.037, 0.01]


def _model(folder: Path, model: str, params: list[float], zoom: float = 1.0) -> Path:
    """Twelve cameras that walk and turn before points that fill their images, with a third of a pixel of noise.

    The focal length grows by the factor `zoom` from the first to the last frame, and the model states that of the
    middle.
    """
    generator = np.random.default_rng(0)
    reconstruction = pycolmap.Reconstruction()
    lens = pycolmap.Camera(model=model, width=848, height=480, params=params, camera_id=1)
    reconstruction.add_camera_with_trivial_rig(lens)
    points = generator.uniform([-9, -5, 2], [9, 5, 9], (500, 3))
    turns = Rotation.from_euler("yx", [[0.04 * (k - 6), 0.03 * (k % 3)] for k in range(12)])
    observed: list[list[tuple[int, int]]] = [[] for _ in points]
    for number, turn in enumerate(turns, 1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn.as_quat()), -turn.apply([0.3 * number, 0.1 * (number % 4), 0]))
        local = turn.apply(points) + pose.translation
        pixels = np.asarray(lens.img_from_cam(local)) + generator.normal(0, 0.3, (len(points), 2))
        pixels = (pixels - (424, 240)) * zoom ** ((number - 6.5) / 11) + (424, 240)
        angle = np.linalg.norm(local[:, :2], axis=1) / local[:, 2]
        inside = (local[:, 2] > 0.5) & (angle < 2) & (pixels > 0).all(axis=1) & (pixels < (848, 480)).all(axis=1)
        rows = np.flatnonzero(inside)
        image = pycolmap.Image(name=f"{number:02d}.jpg", keypoints=pixels[rows], camera_id=1, image_id=number)
        reconstruction.add_image_with_trivial_frame(image, pose)
        for place, row in enumerate(rows):
            observed[row].append((number, place))
    for point, elements in zip(points, observed, strict=True):
        if len(elements) > 1:
            track = pycolmap.Track([pycolmap.TrackElement(*element) for element in elements])
            reconstruction.add_point3D(point, track, np.zeros(3, dtype=np.uint8))
    folder.mkdir()
    reconstruction.write_binary(str(folder))
    return folder


def _fitted(folder: Path, model: str) -> Path:
    """The model again with another camera model, adjusted."""
    reconstruction = pycolmap.Reconstruction(folder)
    (camera,) = reconstruction.cameras.values()
    params = start_params(camera, model)
    camera.model = getattr(pycolmap.CameraModelId, model)
    camera.params = params
    pycolmap.bundle_adjustment(reconstruction, pycolmap.BundleAdjustmentOptions(print_summary=False))
    reconstruction.write_binary(str(folder))
    return folder


def test_a_fisheye_lens_under_a_radial_model_is_found(tmp_path: Path) -> None:
    folder = _fitted(_model(tmp_path / "wide", "OPENCV_FISHEYE", WIDE), "SIMPLE_RADIAL")
    model = pycolmap.Reconstruction(folder)
    choice = compare_camera_models(model, folder, is_free=True)
    assert choice is not None
    assert (choice.before, choice.chosen) == ("SIMPLE_RADIAL", "OPENCV_FISHEYE")
    (camera,) = model.cameras.values()
    assert camera.model.name == "OPENCV_FISHEYE"
    assert camera.params[0] == pytest.approx(375, rel=0.03)


def test_a_plain_lens_keeps_the_simple_model(tmp_path: Path) -> None:
    folder = _model(tmp_path / "plain", "SIMPLE_RADIAL", [700.0, 424.0, 240.0, -0.05])
    assert compare_camera_models(pycolmap.Reconstruction(folder), folder, is_free=True) is None


@pytest.mark.parametrize(
    ("given", "made", "params"),
    [("SIMPLE_PINHOLE", "OPENCV_FISHEYE", WIDE), ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", [600.0, 424.0, 240.0, -0.15])],
)
def test_a_camera_model_of_the_user_that_changes_the_focal_length_is_refused(
    given: str, made: str, params: list[float], tmp_path: Path
) -> None:
    folder = _fitted(_model(tmp_path / "given", made, params), given)
    model = pycolmap.Reconstruction(folder)
    choice = compare_camera_models(model, folder, is_free=False)
    assert choice is not None
    assert choice.before == given
    assert [camera.model.name for camera in model.cameras.values()] == [given]
    assert choice.scores[choice.chosen].params[0] == pytest.approx(params[0], rel=0.03)
    failure = camera_model_failure(choice)
    assert failure is not None
    assert failure.code == "wrong_camera_model"
    assert failure.message.endswith("omit --camera-model, so that it is chosen by the images")


@pytest.mark.parametrize(("focal", "is_refused"), [(664.0, True), (666.0, False), (734.0, False), (736.0, True)])
def test_the_focal_length_of_the_better_model_may_differ_by_five_percent(focal: float, is_refused: bool) -> None:
    scores = {"PINHOLE": ModelScore(0.9, 0.0, 0.0, [700.0]), "OPENCV": ModelScore(0.8, 0.2, 0.01, [focal])}
    assert (camera_model_failure(CameraModelChoice(scores, "PINHOLE", "OPENCV")) is not None) == is_refused


@pytest.mark.parametrize(("aspect", "chosen"), [(1.049, "OPENCV"), (1.051, "OPENCV_FISHEYE")])
def test_a_model_whose_pixels_are_not_square_is_not_chosen(aspect: float, chosen: str) -> None:
    """Another ratio of the focal lengths compensates for a rolling shutter."""
    scores = {
        "SIMPLE_RADIAL": ModelScore(1.2, 0.0, 0.0, []),
        "OPENCV": ModelScore(1.0, 0.3, 0.05, [], aspect),
        "OPENCV_FISHEYE": ModelScore(1.1, 0.2, 0.05, [], 1.02),
    }
    assert chosen_model(scores) == chosen


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE", "SIMPLE_RADIAL"])
def test_another_model_starts_where_the_first_one_ended(model: str) -> None:
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=848, height=480, params=[600.0, 424.0, 240.0, -0.08])
    other = pycolmap.Camera(model=model, width=848, height=480, params=start_params(lens, model))
    pixels = np.array([[424.0, 240.0], [800.0, 240.0], [424.0, 30.0], [100.0, 400.0]])
    assert np.asarray(other.img_from_cam(lens.cam_ray_from_img(pixels))) == pytest.approx(pixels, abs=0.5)


@pytest.mark.parametrize("zoom", [1.0, 1.15, 0.8])
def test_the_change_of_the_focal_length_is_that_of_a_zoom(tmp_path: Path, zoom: float) -> None:
    """Points and poses of the model are bent by the shared focal length, and are adjusted together with the frames'."""
    folder = _fitted(_model(tmp_path / "zoomed", "SIMPLE_RADIAL", [700.0, 424.0, 240.0, 0.0], zoom), "SIMPLE_RADIAL")
    change, error = focal_change(folder)
    assert change == pytest.approx(np.log(zoom), abs=0.03)
    assert error < 0.02


def test_a_frame_with_few_points_does_not_change_the_focal_length(tmp_path: Path) -> None:
    """Twenty points of the last frame state a focal length of 1.5 times that of the others."""
    folder = _fitted(_model(tmp_path / "steady", "SIMPLE_RADIAL", [700.0, 424.0, 240.0, 0.0]), "SIMPLE_RADIAL")
    model = pycolmap.Reconstruction(folder)
    seen = [index for index, point in enumerate(model.images[12].points2D) if point.has_point3D()]
    for index in seen[20:]:
        model.delete_observation(12, index)
    for index in seen[:20]:
        point = model.images[12].points2D[index]
        point.xy = 1.5 * (point.xy - (424, 240)) + (424, 240)
    model.write_binary(str(folder))
    change, error = focal_change(folder)
    assert change == pytest.approx(0.0, abs=0.01)
    assert error < 0.01


def test_noise_is_no_pattern() -> None:
    generator = np.random.default_rng(0)
    pixels = generator.uniform(0, 640, (5000, 2))
    noise = generator.normal(0, 0.6, (5000, 2))
    assert residual_pattern(noise, pixels, (640, 640)) < 0.05
    bent = noise + 0.4 * (pixels / 320 - 1) ** 3
    assert residual_pattern(bent, pixels, (640, 640)) > 0.2


@pytest.mark.parametrize(("gain", "chosen"), [(0.14, "SIMPLE_RADIAL"), (0.16, "OPENCV"), (-0.2, "SIMPLE_RADIAL")])
def test_a_model_gains_three_standard_errors(gain: float, chosen: str) -> None:
    scores = {"SIMPLE_RADIAL": ModelScore(1.2, 0.0, 0.0, []), "OPENCV": ModelScore(1.0, gain, 0.05, [])}
    assert chosen_model(scores) == chosen
