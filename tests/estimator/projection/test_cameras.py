"""Projection against COLMAP's own, and the guard against points that a lens polynomial folds back."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.projection.cameras import CAMERA_MODELS, make_camera, pixels_in_view, project
from estimator.records.scene import Camera, View
from metric_base.errors import FieldError
from tests.support.processes import started

MILD = {
    "k": 0.01,
    "k0": 0.01,
    "k1": 0.01,
    "k2": -0.002,
    "p1": 0.001,
    "p2": -0.001,
    "omega": 0.3,
    "alpha": 0.5,
    "beta": 1.1,
}


def mild_params(model: str, width: int, height: int) -> np.ndarray:
    """Parameters of a lens of the model with a little distortion."""
    known = {"f": 0.9 * width, "fx": 0.9 * width, "fy": 0.92 * width, "cx": width / 2 + 3, "cy": height / 2 - 2}
    return np.array([known.get(name, MILD.get(name, 0.0)) for name in CAMERA_MODELS[model][1]], dtype=float)


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_numbers_and_parameters_are_colmaps(model: str) -> None:
    number, names = CAMERA_MODELS[model]
    assert int(getattr(pycolmap.CameraModelId, model)) == number
    theirs = pycolmap.Camera.create_from_model_name(1, model, 500.0, 640, 480).params_info
    assert [name.strip() for name in theirs.split(",")] == list(names)


@pytest.mark.parametrize("model", CAMERA_MODELS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), width=st.integers(64, 4000), height=st.integers(64, 4000))
def test_projects_as_colmap_does(model: str, seed: int, width: int, height: int) -> None:
    params = mild_params(model, width, height)
    camera = make_camera(model, (width, height), params)
    lens = pycolmap.Camera(model=model, width=width, height=height, params=params)
    points = np.random.default_rng(seed).uniform([-0.4, -0.4, 0.9], [0.4, 0.4, 1.1], size=(20, 3)) * 7.0
    expected = np.array([lens.img_from_cam(point) for point in points])
    np.testing.assert_allclose(project(camera, points), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_nothing_is_seen_behind_the_camera(model: str) -> None:
    camera = Camera(model, 640, 480, mild_params(model, 640, 480))
    points = np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [0.1, 0.1, 1.0]])
    assert np.isnan(project(camera, points)[:3]).all()
    assert np.isfinite(project(camera, points)[3]).all()


def test_points_far_outside_are_not_folded_into_the_picture() -> None:
    # k1 = -0.3: r (1 - 0.3 r^2) turns back at r = 1.05 and is 0 again at r = 1.83
    camera = Camera("SIMPLE_RADIAL", 640, 480, np.array([500.0, 320.0, 240.0, -0.3]))
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=camera.params)
    far = np.array([[1.82, 0.0, 1.0]])
    u, v = lens.img_from_cam(far[0])
    assert 0 < u < 640, "COLMAP alone puts it near the middle"
    assert 0 < v < 480
    assert np.isnan(project(camera, far)).all()
    edge = np.array([[0.6, 0.3, 1.0], [1.0, 0.0, 1.0]])
    assert np.isfinite(project(camera, edge)).all()


def test_pixels_in_view_are_those_inside() -> None:
    camera = Camera("PINHOLE", 100, 50, np.array([100.0, 100.0, 50.0, 25.0]))
    view = View("a", camera, np.eye(3), np.array([0.0, 0.0, 2.0]), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    pixels, depths = pixels_in_view(view, np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, -5.0]]))
    np.testing.assert_allclose(pixels[0], [50, 25])
    assert np.isnan(pixels[1:]).all()
    np.testing.assert_allclose(depths, [2, 2, -3])


def test_no_points_give_no_pixels() -> None:
    assert project(Camera("PINHOLE", 9, 9, np.array([9.0, 9, 4, 4])), np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize(
    ("model", "size", "params", "named"),
    [
        ("PINHOLE", (640, 480), [1.0, 1.0, 1.0], "4 numbers"),
        ("PINHOLE", (0, 480), [1.0] * 4, "size"),
        ("PINHOLE", (640, 480), [0.0, 1.0, 1.0, 1.0], "focal"),
        ("PINHOLE", (640, 480), [1.0, 1.0, np.inf, 1.0], "finite"),
        ("EQUIRECTANGULAR", (640, 480), [640.0, 480.0], "model"),
    ],
)
def test_impossible_cameras_are_refused(model: str, size: tuple[int, int], params: list[float], named: str) -> None:
    with pytest.raises(FieldError, match=named):
        make_camera(model, size, params)


def test_a_request_to_terminate_after_pycolmap_came_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    code = f"""
import sys, time
from pathlib import Path
from metric_base.files import whole_folder
from metric_cli.errors import exit_status

def run():
    from estimator.reconstructions.pycolmap_library import pycolmap
    with whole_folder(Path({str(tmp_path / "out")!r})):
        print(pycolmap.__version__, flush=True)
        time.sleep(600)

sys.exit(exit_status("x", run))
"""
    with started([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        _, message = process.communicate()
    assert (process.returncode, message) == (143, "x: terminated\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("size", "is_valid"),
    [
        ((100_000, 2), True),
        ((100_001, 2), False),
        ((2, 100_001), False),
        ((1 << 14, 1 << 14), True),
        ((1 << 14, (1 << 14) + 1), False),
    ],
)
def test_an_image_has_sides_of_at_most_100000_and_2_to_the_28_pixels(size: tuple[int, int], is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(FieldError, match="size"):
        assert make_camera("PINHOLE", size, [1.0, 1.0, 1.0, 1.0]).width == size[0]
