"""COLMAP models against pycolmap's own reading: every camera model, binary and text, three files and five."""

from __future__ import annotations

import struct
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pycolmap
import pytest

from estimator.projection.cameras import CAMERA_MODELS, project
from estimator.reconstructions.colmap import colmap_folder, read_colmap, scene_of_reconstruction
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene
from metric_base.errors import InputError
from tests.estimator.projection.test_cameras import mild_params
from tests.synthetic.small_scene import small_model


def assert_same_scene(scene: Scene, reconstruction: pycolmap.Reconstruction) -> None:
    """Every number of the scene is pycolmap's."""
    assert sorted(view.name for view in scene.views) == sorted(image.name for image in reconstruction.images.values())
    assert len(scene.points) == len(reconstruction.points3D)
    for view in scene.views:
        image = reconstruction.find_image_with_name(view.name)
        pose = image.cam_from_world()
        np.testing.assert_allclose(view.rotation, pose.rotation.matrix(), atol=1e-12)
        np.testing.assert_allclose(view.translation, pose.translation, atol=1e-12)
        np.testing.assert_allclose(view.centre, image.projection_center(), atol=1e-9)
        assert view.camera.model == image.camera.model_name
        assert (view.camera.width, view.camera.height) == (image.camera.width, image.camera.height)
        np.testing.assert_array_equal(view.camera.params, image.camera.params)
        seen = [point for point in image.points2D if point.has_point3D()]
        np.testing.assert_array_equal(view.keypoints, [point.xy for point in seen])
        expected = [reconstruction.points3D[point.point3D_id].xyz for point in seen]
        np.testing.assert_array_equal(scene.points[view.point_index], expected)


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_every_camera_model(model: str, tmp_path: Path) -> None:
    reconstruction = small_model(model, mild_params(model, 320, 240).tolist())
    (tmp_path / "bin").mkdir()
    (tmp_path / "txt").mkdir()
    reconstruction.write_binary(str(tmp_path / "bin"))
    reconstruction.write_text(str(tmp_path / "txt"))
    for form in ("bin", "txt"):
        scene = read_scene(tmp_path / form)
        assert_same_scene(scene, reconstruction)
        for view in scene.views:
            pixels = project(view.camera, scene.points[view.point_index] @ view.rotation.T + view.translation)
            np.testing.assert_allclose(pixels, view.keypoints, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_random_models_with_gaps_in_the_ids(seed: int, tmp_path: Path) -> None:
    reconstruction = small_model(seed=seed)
    for point in sorted(reconstruction.points3D)[::3]:
        reconstruction.delete_point3D(point)
    reconstruction.write_binary(str(tmp_path))
    assert_same_scene(read_colmap(tmp_path), reconstruction)


def test_far_apart_ids_are_found_by_search(tmp_path: Path) -> None:
    reconstruction = small_model()
    point = reconstruction.points3D[min(reconstruction.points3D)]
    reconstruction.add_point3D_with_id(2**40, pycolmap.Point3D(xyz=point.xyz, track=pycolmap.Track()))
    reconstruction.write_binary(str(tmp_path))
    assert_same_scene(read_colmap(tmp_path), reconstruction)


@pytest.mark.parametrize("place", ["", "sparse", "sparse/0", "0"])
@pytest.mark.parametrize("files", [3, 5])
def test_found_in_the_usual_places(place: str, files: int, tmp_path: Path) -> None:
    folder = tmp_path / place
    folder.mkdir(parents=True, exist_ok=True)
    small_model().write_binary(str(folder))
    if files == 3:
        (folder / "rigs.bin").unlink()
        (folder / "frames.bin").unlink()
    scene = read_scene(tmp_path)
    assert scene.path == tmp_path
    assert scene.model_path == folder == colmap_folder(tmp_path)
    assert len(scene.views) == 8


def test_binary_is_taken_before_text(tmp_path: Path) -> None:
    small_model().write_binary(str(tmp_path))
    small_model(seed=1).write_text(str(tmp_path))
    assert read_scene(tmp_path).format == "colmap-binary"


def test_an_image_without_keypoints_in_text(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 10 10 9 5 5\n", encoding="utf-8")
    images = "7 1 0 0 0 0 0 0 1 a b.png\n\n8 1 0 0 0 0 0 1 1 c.png\n1.5 2.5 3 4 4 -1\n"
    (tmp_path / "images.txt").write_text(f"# header\n{images}", encoding="utf-8")
    (tmp_path / "points3D.txt").write_text("3 0.5 0.25 2 1 2 3 0.1 8 0\n", encoding="utf-8")
    first, second = read_scene(tmp_path).views
    assert (first.name, len(first.keypoints)) == ("a b.png", 0)
    assert second.keypoints.tolist() == [[1.5, 2.5]]
    assert second.point_index.tolist() == [0]


def test_no_sparse_points_is_bad_without_a_dense_cloud(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 10 10 9 5 5\n", encoding="utf-8")
    (tmp_path / "images.txt").write_text("7 1 0 0 0 0 0 0 1 a.png\n\n", encoding="utf-8")
    (tmp_path / "points3D.txt").write_text("# none\n", encoding="utf-8")
    with pytest.raises(InputError, match="at least one sparse or dense point"):
        read_scene(tmp_path)
    (tmp_path / "dense.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
        encoding="ascii",
    )
    assert read_scene(tmp_path).dense is not None


def test_a_point_count_is_not_believed_before_the_bytes_are_there(tmp_path: Path) -> None:
    small_model().write_binary(str(tmp_path))
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 2**61))
    with pytest.raises(InputError, match=r"points3D\.bin: number of points: expected at most 0"):
        read_scene(tmp_path)


@pytest.mark.parametrize(("length", "is_valid"), [(1.009, True), (1.011, False)])
def test_a_quaternion_has_a_length_of_one_to_a_hundredth(length: float, is_valid: bool, tmp_path: Path) -> None:
    small_model().write_text(str(tmp_path))
    lines = (tmp_path / "images.txt").read_text(encoding="utf-8").splitlines()
    row = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    words = lines[row].split(" ")
    words[1:5] = [repr(length * float(word)) for word in words[1:5]]
    lines[row] = " ".join(words)
    (tmp_path / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if is_valid:
        assert len(read_colmap(tmp_path).views) == len(small_model().images)
    else:
        with pytest.raises(InputError, match="a quaternion of length 1"):
            read_colmap(tmp_path)


CAMERA = struct.pack("<IiQQ4d", 1, 1, 640, 480, 500.0, 500.0, 320.0, 240.0)
IMAGE = struct.pack("<I7dI", 1, 1, 0, 0, 0, 0, 0, 0, 1) + b"a.png\0" + struct.pack("<Q", 0)
POINT = struct.pack("<Q3d3BdQ", 1, 0.0, 0.0, 5.0, 9, 9, 9, 0.5, 0)


@pytest.mark.parametrize(
    ("cameras", "points", "message"),
    [
        ([CAMERA], [POINT], None),
        ([CAMERA, CAMERA], [POINT], "camera id: expected each one once, found 1 twice"),
        ([CAMERA[:4] + b"\x63" + CAMERA[5:]], [POINT], "camera 1 model: expected 0 to 16, found 99"),
        ([CAMERA], [POINT[:-8] + struct.pack("<Q", 5)], "a track that ends 40 bytes beyond it"),
        ([CAMERA], [POINT, POINT], "point id: expected each one once"),
    ],
)
def test_records_of_a_binary_model(
    cameras: list[bytes], points: list[bytes], message: str | None, tmp_path: Path
) -> None:
    for name, records in (("cameras", cameras), ("images", [IMAGE]), ("points3D", points)):
        (tmp_path / f"{name}.bin").write_bytes(struct.pack("<Q", len(records)) + b"".join(records))
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert read_colmap(tmp_path).points.tolist() == [[0, 0, 5]]


@pytest.mark.parametrize(("x", "is_valid"), [(0.9e12, True), (-1.1e12, False), (np.nan, False)])
def test_points_of_a_reconstruction_in_memory_are_finite(x: float, is_valid: bool) -> None:
    model = SimpleNamespace(
        reg_image_ids=lambda: [1],
        points3D={1: SimpleNamespace(xyz=[x, 0.0, 5.0])},
        cameras={},
        images={1: SimpleNamespace(cam_from_world=pycolmap.Rigid3d, points2D=[], name="a", camera_id=1)},
    )
    with pytest.raises(KeyError if is_valid else InputError, match="1" if is_valid else "points: expected finite"):
        scene_of_reconstruction(model)  # a valid point is followed by the search for the camera


@pytest.mark.parametrize(("number", "is_read"), [(2**53, True), (2**53 + 2, False), (1.5, False), (-(2**53), True)])
def test_ids_of_points_are_integers_that_doubles_represent(number: float, is_read: bool, tmp_path: Path) -> None:
    """MAX_EXACT of 2^53."""
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 640 480 500 320 240\n")
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 0 1 a.jpg\n10 20 {number}\n")
    (tmp_path / "points3D.txt").write_text(f"{number} 0 0 5 90 90 90 0.5 1 0\n")
    with nullcontext() if is_read else pytest.raises(InputError, match="expected whole numbers"):
        assert len(read_colmap(tmp_path).points) == 1
