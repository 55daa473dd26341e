"""OpenSfM datasets: the conventions against the equations of OpenSfM, and datasets without tracks."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.projection.cameras import project
from estimator.reconstructions.opensfm import read_observations
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from tests.synthetic.small_scene import write_small_scene


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opensfm") / "whole"
    write_small_scene(folder)
    return folder


def dataset(
    folder: Path, camera: dict[str, Any], points: list[list[float]], rotation: list[float] | None = None
) -> Path:
    """A dataset with a single shot at the origin."""
    shot = {"rotation": rotation or [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0], "camera": "c"}
    named = {str(row): {"coordinates": point, "color": [0, 0, 0]} for row, point in enumerate(points)}
    document = [{"cameras": {"c": camera}, "shots": {"a.jpg": shot}, "points": named}]
    folder.mkdir(exist_ok=True)
    (folder / "reconstruction.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


def radial(x: np.ndarray, k: list[float]) -> np.ndarray:
    """(n, 1) factor 1 + r^2 (k1 + r^2 (k2 + ...)) of camera_distortions_functions.h, Disto2468."""
    r2 = (x**2).sum(axis=1, keepdims=True)
    return 1 + sum(value * r2 ** (power + 1) for power, value in enumerate(k))


def tangential(x: np.ndarray, p1: float, p2: float) -> np.ndarray:
    r2 = (x**2).sum(axis=1)
    u, v = x.T
    return np.column_stack([2 * p1 * u * v + p2 * (r2 + 2 * u**2), 2 * p2 * u * v + p1 * (r2 + 2 * v**2)])


def angles(points: np.ndarray) -> np.ndarray:
    """(n, 2) of the fisheye projection: the direction in the image times the angle from the axis."""
    radius = np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    return points[:, :2] / radius * np.arctan2(radius, points[:, 2:])


def expected_pixels(camera: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Projections of OpenSfM in normalised coordinates, then to pixels whose corner is (0, 0)."""
    kind = camera["projection_type"]
    x = angles(points) if kind.startswith("fisheye") else points[:, :2] / points[:, 2:]
    k = [camera.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")]
    x = x * radial(x, k) + (tangential(x, camera["p1"], camera["p2"]) if kind == "brown" else 0.0)
    focal = [camera.get("focal_x", camera.get("focal")), camera.get("focal_y", camera.get("focal"))]
    normalised = x * focal + [camera.get("c_x", 0.0), camera.get("c_y", 0.0)]
    size = np.array([camera["width"], camera["height"]])
    # denormalized_image_coordinates gives pixels whose first centre is (0, 0): s u - 0.5 + w / 2
    return normalised * size.max() - 0.5 + size / 2 + 0.5


LENSES: dict[str, dict[str, float]] = {
    "perspective": {"focal": 0.9, "k1": -0.05, "k2": 0.01},
    "fisheye": {"focal": 0.6, "k1": -0.02, "k2": 0.005},
    "simple_radial": {"focal_x": 0.8, "focal_y": 0.85, "c_x": 0.01, "c_y": -0.02, "k1": 0.03},
    "radial": {"focal_x": 0.8, "focal_y": 0.85, "c_x": 0.01, "c_y": -0.02, "k1": 0.03, "k2": -0.004},
    "brown": {
        "focal_x": 0.8, "focal_y": 0.85, "c_x": 0.01, "c_y": -0.02, "k1": 0.03, "k2": -0.01, "k3": 0.002,
        "p1": 0.003, "p2": -0.002,
    },
    "fisheye_opencv": {
        "focal_x": 0.6, "focal_y": 0.62, "c_x": 0.01, "c_y": -0.02, "k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", LENSES)
@pytest.mark.parametrize("size", [(640, 480), (480, 640)])
def test_lenses_project_as_opensfms(kind: str, size: tuple[int, int], tmp_path: Path) -> None:
    camera = LENSES[kind] | {"projection_type": kind, "width": size[0], "height": size[1]}
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0.9], [0.2, 0.2, 1.3], size=(30, 3))
    scene = read_scene(dataset(tmp_path, camera, points.tolist()))
    np.testing.assert_allclose(project(scene.views[0].camera, points), expected_pixels(camera, points), atol=1e-8)


@settings(max_examples=50, deadline=None)
@given(vector=st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_rotations_are_angle_axis(vector: list[float], tmp_path_factory: pytest.TempPathFactory) -> None:
    camera = {"projection_type": "perspective", "width": 64, "height": 48, "focal": 0.9}
    folder = dataset(tmp_path_factory.mktemp("shot"), camera, [[0.0, 0.0, 1.0]], rotation=vector)
    view = read_scene(folder).views[0]
    np.testing.assert_allclose(view.rotation, cv2.Rodrigues(np.array(vector))[0], atol=1e-9)


def test_equals_the_colmap_model_it_was_made_from(small: Path) -> None:
    colmap, opensfm = read_scene(small / "colmap"), read_scene(small / "opensfm")
    by_name = {view.name: view for view in opensfm.views}
    for view in colmap.views:
        other = by_name[view.name]
        np.testing.assert_allclose(other.rotation, view.rotation, atol=1e-9)
        np.testing.assert_allclose(other.translation, view.translation, atol=1e-9)
        order, other_order = np.argsort(view.point_index), np.argsort(other.point_index)
        np.testing.assert_allclose(other.keypoints[other_order], view.keypoints[order], atol=1e-5)
        ours, theirs = opensfm.points[other.point_index[other_order]], colmap.points[view.point_index[order]]
        np.testing.assert_allclose(ours, theirs)


def test_without_tracks_depth_decides_what_a_view_sees(small: Path, tmp_path: Path) -> None:
    (tmp_path / "reconstruction.json").write_bytes((small / "opensfm" / "reconstruction.json").read_bytes())
    whole, bare = read_scene(small / "opensfm"), read_scene(tmp_path)
    assert any("tracks.csv" in warning for warning in bare.warnings)
    for view, other in zip(whole.views, bare.views, strict=True):
        _, here, there = np.intersect1d(view.point_index, other.point_index, return_indices=True)
        # the points fill a volume, so that some that were observed are behind others
        assert len(here) > 0.7 * len(view.point_index)
        np.testing.assert_allclose(other.keypoints[there], view.keypoints[here], atol=1e-4)


def test_the_largest_of_several_is_taken_with_a_warning(small: Path, tmp_path: Path) -> None:
    document = json.loads((small / "opensfm" / "reconstruction.json").read_text(encoding="utf-8"))
    name, shot = next(iter(document[0]["shots"].items()))
    (tmp_path / "reconstruction.json").write_text(json.dumps([document[0] | {"shots": {name: shot}}, *document]))
    scene = read_scene(tmp_path)
    assert len(scene.views) == 8
    assert any("2 reconstructions of 1, 8 shots" in warning for warning in scene.warnings)


@pytest.mark.parametrize("version", [0, 1, 2])
def test_tracks_of_every_version(version: int, tmp_path: Path) -> None:
    camera = {"projection_type": "perspective", "width": 640, "height": 480, "focal": 0.9}
    folder = dataset(tmp_path, camera, [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]])
    tail = {0: "9\t9\t9", 1: "0.01\t9\t9\t9", 2: "0.01\t9\t9\t9\t-1\t-1"}[version]
    lines = [] if version == 0 else [f"OPENSFM_TRACKS_VERSION_v{version}"]
    lines += [f"a.jpg\t1\t5\t0.25\t-0.125\t{tail}", f"a.jpg\t77\t6\t0\t0\t{tail}", f"b.jpg\t0\t6\t0\t0\t{tail}"]
    (folder / "tracks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    view = read_scene(folder).views[0]
    assert view.point_index.tolist() == [1], "tracks without a point and other images are left out"
    np.testing.assert_allclose(view.keypoints, [[320 + 0.25 * 640, 240 - 0.125 * 640]])


@pytest.mark.parametrize("kind", ["spherical", "equirectangular", "dual", "fisheye62", 7])
def test_projections_that_are_not_read(kind: object, tmp_path: Path) -> None:
    camera = {"projection_type": kind, "width": 640, "height": 480, "focal": 0.9}
    with pytest.raises(InputError, match="projection_type"):
        read_scene(dataset(tmp_path, camera, [[0.0, 0.0, 1.0]]))


@pytest.mark.parametrize(
    ("width", "message"), [(640, None), (640.0, None), (640.5, "width"), ("640", "width"), (True, "width")]
)
def test_the_width_of_an_image_is_a_whole_number(width: object, message: str | None, tmp_path: Path) -> None:
    camera = {"projection_type": "perspective", "width": width, "height": 480, "focal": 0.8, "k1": 0.0, "k2": 0.0}
    folder = dataset(tmp_path / "a", camera, [[0.0, 0.0, 5.0 + row] for row in range(4)])
    with (
        nullcontext()
        if message is None
        else pytest.raises(InputError, match="width: expected a whole number of pixels")
    ):
        assert read_scene(folder).views[0].camera.width == 640


@pytest.mark.parametrize("text", ["OPENSFM_TRACKS_VERSION_v2\n", "OPENSFM_TRACKS_VERSION_v2\n\n"])
def test_tracks_have_a_line_after_their_version(text: str, tmp_path: Path) -> None:
    (tmp_path / "tracks.csv").write_text(text)
    with pytest.raises(InputError, match="observations: expected at least one line"):
        read_observations(tmp_path / "tracks.csv", ["a.jpg"], ["0"])
