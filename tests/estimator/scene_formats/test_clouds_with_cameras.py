"""Clouds with cameras and without depth maps: the GLB of DUSt3R, and trajectories of SLAM with a PLY."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from estimator.instances.instance_reader import read_instances
from estimator.outputs.rescaled import write_rescaled, write_rescaled_cloud
from estimator.pipeline import estimate_scale
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from tests.support.skips import skip_without
from tests.synthetic.exports import write_points
from tests.synthetic.networks import RenderedViews, rendered_views, write_output
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.render import NoOpenGL

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
#: Focal length in pixels of the maps.
FOCAL = 250


@pytest.fixture(scope="module")
def views() -> RenderedViews:
    with skip_without(NoOpenGL):
        return rendered_views(furnished_room("study", 1003), views=8)


def _placed(matrix: Any, points: Any) -> Any:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def write_glb(views: RenderedViews, file: Path, *, as_points: bool = True, with_images: bool = True) -> tuple[Any, Any]:
    """Write a GLB as naver/dust3r, dust3r/demo.py and viz.py; return the poses (n, 4, 4) and points in its frame."""
    scene, poses = trimesh.Scene(), views.matrices(to_camera=False)
    points = views.points[:, ::4, ::4]
    rows = np.arange(points[..., 0].size).reshape(-1, points.shape[1], points.shape[2])
    faces = np.stack([rows[:, :-1, :-1], rows[:, :-1, 1:], rows[:, 1:, :-1]], axis=-1).reshape(-1, 3)
    cloud = trimesh.PointCloud(points.reshape(-1, 3)) if as_points else trimesh.Trimesh(points.reshape(-1, 3), faces)
    scene.add_geometry(cloud)
    height, width = views.depth.shape[1:]
    screen = 0.05
    cone = trimesh.creation.cone(screen * 0.5**0.5, FOCAL * screen / height, sections=4)
    for pose in poses:
        diagonal, small_turn = np.eye(4), np.eye(4)
        diagonal[:3, :3] = Rotation.from_euler("z", 45, degrees=True).as_matrix()
        diagonal[2, 3] = -FOCAL * screen / height  # the tip of the cone is the optical centre
        small_turn[:3, :3] = Rotation.from_euler("z", 2, degrees=True).as_matrix()
        place = pose @ OPENGL @ np.diag([width / height, 1, 1, 1]) @ diagonal
        if with_images:
            corners = _placed(place, cone.vertices[[4, 5, 1, 3]])
            image = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])
            picture = Image.new("RGB", (width, height))
            image.visual = trimesh.visual.TextureVisuals([[0, 0], [1, 0], [1, 1], [0, 1]], image=picture)
            scene.add_geometry(image)
        corners = np.concatenate([cone.vertices, 0.95 * cone.vertices, _placed(small_turn, cone.vertices)])
        edges = []
        for a, b, c in (face for face in cone.faces if 0 not in face):
            edges += [(a, b, b + 6), (a, a + 6, c), (c + 6, b, c), (a, b, b + 12), (a, a + 12, c), (c + 12, b, c)]
        scene.add_geometry(trimesh.Trimesh(_placed(place, corners), edges))
    half_turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    frame = np.linalg.inv(poses[0] @ OPENGL @ half_turn)
    scene.apply_transform(frame)
    scene.export(str(file))
    return frame @ poses, _placed(frame, points.reshape(-1, 3))


@pytest.fixture
def folder(views: RenderedViews, tmp_path: Path) -> Path:
    """A folder with images and masks."""
    write_output("MegaSaM", views, tmp_path / "scene")
    (tmp_path / "scene" / "walk_sgd_cvd_hr.npz").unlink()
    return tmp_path / "scene"


@pytest.mark.parametrize("as_points", [True, False])
def test_cameras_and_cloud_of_a_glb(as_points: bool, views: RenderedViews, folder: Path) -> None:
    poses, points = write_glb(views, folder / "scene.glb", as_points=as_points)
    scene = read_scene(folder / "scene.glb")
    assert [view.name for view in scene.views] == list(views.names)
    for view, pose in zip(scene.views, poses, strict=True):
        assert (view.camera.width, view.camera.height) == (512, 384)
        assert view.camera.params == pytest.approx([FOCAL * 1.6, FOCAL * 1.6, 256, 192], rel=1e-3)
        assert view.rotation == pytest.approx(pose[:3, :3].T, abs=1e-4)
        assert view.centre == pytest.approx(pose[:3, 3], abs=1e-3)
    assert scene.dense is not None
    assert len(scene.dense.points) > 0.99 * len(points)  # a mesh has no vertices without faces
    assert cKDTree(points).query(scene.dense.points)[0].max() < 1e-3


def _check_scale(scene: Scene, views: RenderedViews, folder: Path) -> None:
    result = estimate_scale(scene, read_instances(folder / "instances.json", scene))
    assert result.interval is not None
    assert result.interval.low < views.scale < result.interval.high
    write_rescaled_cloud(scene, result, folder / "metric.ply")
    assert json.loads((folder / "scale.json").read_text())["metres_per_unit"] == pytest.approx(result.scale, rel=1e-3)


def test_the_scale_of_a_glb(views: RenderedViews, folder: Path) -> None:
    write_glb(views, folder / "scene.glb")
    _check_scale(read_scene(folder / "scene.glb"), views, folder)


def test_a_glb_without_images_or_content_is_one_line(views: RenderedViews, folder: Path) -> None:
    write_glb(views, folder / "scene.glb", with_images=False)
    with pytest.raises(InputError, match="cameras with their images"):
        read_scene(folder / "scene.glb")
    (folder / "scene.glb").write_bytes((folder / "scene.glb").read_bytes()[:2000])
    with pytest.raises(InputError, match=r"scene\.glb") as error:
        read_scene(folder / "scene.glb")
    assert "\n" not in str(error.value)


def write_trajectory(views: RenderedViews, folder: Path) -> Path:
    """Write a trajectory as rmurai0610/MASt3R-SLAM, mast3r_slam/evaluate.py; images have the size of the maps."""
    images = folder / "keyframes" / "desk"
    images.mkdir(parents=True)
    height, width = views.depth.shape[1:]
    lines = []
    for row, pose in enumerate(views.matrices(to_camera=False)):
        time = 9.5 + 0.7 * row
        cv2.imwrite(str(images / f"{time}.png"), np.zeros((height, width), dtype=np.uint8))
        numbers = [time, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines.append(" ".join(map(str, numbers)))
    (folder / "desk.txt").write_text("\n".join(lines) + "\n")
    write_points(folder / "desk.ply", views.points[:, ::4, ::4].reshape(-1, 3))
    return folder / "desk.txt"


def test_a_trajectory_with_a_cloud(views: RenderedViews, folder: Path) -> None:
    file = write_trajectory(views, folder)
    scene = read_scene(file, focal_px=FOCAL)
    for row, view in enumerate(scene.views):
        assert view.name == f"{9.5 + 0.7 * row}.png"
        assert view.camera.params == pytest.approx([FOCAL, FOCAL, 160, 120])
        assert view.rotation == pytest.approx(views.rotation[row], abs=1e-5)
        assert view.centre == pytest.approx(views.centre[row], abs=1e-5)
    names = dict(zip(views.names, [view.name for view in scene.views], strict=True))
    record = json.loads((folder / "instances.json").read_text())
    images = [image | {"file_name": names[image["file_name"]]} for image in record["images"]]
    (folder / "instances.json").write_text(json.dumps(record | {"images": images}))
    _check_scale(scene, views, folder)
    words = [str(file), "--focal", str(FOCAL), "--instances", str(folder / "instances.json")]
    assert main([*words, "--write-scaled", str(folder / "metric"), "--quiet"]) == 0
    assert read_scene(folder / "metric").dense is not None


@pytest.mark.parametrize(
    ("missing", "words"),
    [("--focal", "--focal PX"), ("desk.ply", "desk.ply next to it"), ("keyframes/desk/9.5.png", "one with 9.5 in its")],
)
def test_a_missing_part_of_a_trajectory_is_one_line(
    missing: str, words: str, views: RenderedViews, tmp_path: Path
) -> None:
    file = write_trajectory(views, tmp_path)
    if missing != "--focal":
        (tmp_path / missing).unlink()
    with pytest.raises(InputError, match=words) as error:
        read_scene(file, focal_px=None if missing == "--focal" else FOCAL)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("line", ["1 0 0 0 0 0 0", "1 0 0 0 0 0 0 1 0", "1 0 0 0 0 0 0 x"])
def test_other_texts_are_no_trajectories(line: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(f"# time\n{line}\n")
    with pytest.raises(InputError, match="no trajectory"):
        read_scene(tmp_path / "a.txt")


def test_a_focal_length_of_a_reconstruction_with_cameras_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "cameras.txt"
    file.write_text("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE 640 480 500 500 320 240\n")
    with pytest.raises(InputError, match=r"cameras\.txt: .*expected") as error:
        read_scene(file, focal_px=500)
    assert "\n" not in str(error.value)


def test_the_scaled_model_of_a_network_has_its_cloud(views: RenderedViews, tmp_path: Path) -> None:
    scene = read_scene(write_output("VGGT", views, tmp_path / "scene"))
    write_rescaled(scene, 0.5, tmp_path / "metric")
    scaled = read_scene(tmp_path / "metric")
    assert scene.dense is not None
    assert scaled.dense is not None
    assert scaled.dense.points == pytest.approx(0.5 * scene.dense.points)
    for field in ("visible_offsets", "visible_views"):
        np.testing.assert_array_equal(getattr(scaled.dense, field), getattr(scene.dense, field))
