"""Outputs of networks, written after their code from one rendered room, are scenes with the scale of the room."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from estimator.evidence.depth_maps import MetricDepth
from estimator.instances.instance_reader import read_instances
from estimator.pipeline import estimate_scale, measure_objects
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.network_outputs import NETWORKS
from estimator.records.scene import View
from estimator.scene_formats import networks
from estimator.scene_formats.common import pinhole_camera
from estimator.scene_formats.networks import depth_cloud, focal_of_points
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from tests.support.skips import skip_without
from tests.synthetic.networks import WRITERS, RenderedViews, rendered_views, write_output
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.splats import write_splat

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def views() -> RenderedViews:
    with skip_without(NoOpenGL):
        return rendered_views(furnished_room("study", 1003), views=6, reduction=4)


def test_every_declared_network_has_a_writer() -> None:
    assert sorted(WRITERS) == sorted(one.network for one in NETWORKS)


@pytest.mark.parametrize("network", WRITERS)
def test_cameras_points_and_names(network: str, views: RenderedViews, tmp_path: Path) -> None:
    scene = read_scene(write_output(network, views, tmp_path / "scene"))
    assert scene.format == "network"
    assert [view.name for view in scene.views] == list(views.names)
    assert not scene.warnings
    height, width = views.depth.shape[1:]
    for row, view in enumerate(scene.views):
        assert (view.camera.width, view.camera.height) == (width, height)
        assert np.abs(view.camera.params - [125, 125, 80, 60]).max() < 0.1
        assert np.abs(view.rotation - views.rotation[row]).max() < 1e-5
        assert np.abs(view.centre - views.centre[row]).max() < 1e-4
    assert scene.dense is not None
    distances, _ = cKDTree(views.points.reshape(-1, 3)).query(scene.dense.points[::50])
    assert distances.max() < 0.02  # half floats of ViPE and MegaSaM
    assert scene.dense.visible_offsets is not None
    assert np.diff(scene.dense.visible_offsets).mean() > 2  # of 6 views


@pytest.mark.parametrize("network", ["VGGT", "Pi3"])
def test_the_scale_of_the_room(network: str, tmp_path: Path) -> None:
    with skip_without(NoOpenGL):
        views = rendered_views(furnished_room("study", 1003), views=8)
    scene = read_scene(write_output(network, views, tmp_path / "scene"))
    result = estimate_scale(scene, read_instances(tmp_path / "scene" / "instances.json", scene))
    assert result.status == "resolved"
    assert result.interval is not None
    assert result.interval.low < views.scale < result.interval.high


@pytest.mark.parametrize(("network", "words"), [("VGGT", "VGGT, whose units are normalised"), ("Pi3", "Pi3")])
def test_units_that_are_no_metres_are_refused(
    network: str, words: str, views: RenderedViews, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_output(network, views, tmp_path / "scene")
    assert main([str(folder), "--metric-depth", "scene", "--json"]) == 2
    *_, error = capsys.readouterr().err.strip().splitlines()
    assert error.endswith(f"found {words}")
    assert "--depth-error" in error


@pytest.mark.parametrize("factor", [0.37, 5.2])
def test_gaussians_of_depth_anything_3_have_the_units_of_its_network(
    factor: float, views: RenderedViews, tmp_path: Path
) -> None:
    """Depths and cameras are multiplied by the metric factor, the Gaussians are not; 10 % are pruned (gs.py)."""
    folder = write_output("Depth Anything 3", views, tmp_path / "scene")
    points = views.points.reshape(-1, 3)
    order = np.argsort(np.linalg.norm(points - views.centre[0], axis=1))
    near = points[np.sort(order[: len(points) * 9 // 10])]
    noisy = near + 0.01 * np.random.default_rng(0).normal(size=near.shape)
    splat = write_splat(folder / "exports" / "gs_ply" / "0000.ply", noisy / factor)
    scene = read_scene(splat)
    assert scene.file_units == pytest.approx(factor, rel=0.01)
    assert scene.dense is not None
    for row, view in enumerate(scene.views):
        assert np.abs(factor * view.centre - views.centre[row]).max() < 0.02
    assert any(f"is {factor:.2g}" in line for line in scene.warnings)
    measurements = measure_objects(scene, ())
    (evidence,) = MetricDepth(None, network_sd=0.3).observe(scene, measurements)
    assert evidence.scale == pytest.approx(factor, rel=0.01)  # of the splat, whatever the unit of the network


@pytest.mark.parametrize("network", WRITERS)
@pytest.mark.parametrize("is_inverse", [False, True])
@pytest.mark.parametrize("is_opengl", [False, True])
def test_another_convention_is_named(
    network: str, is_inverse: bool, is_opengl: bool, views: RenderedViews, tmp_path: Path
) -> None:
    poses = views.matrices(to_camera=False) @ (FLIP if is_opengl else np.eye(4))
    to_camera = WRITERS[network][1] != is_inverse
    folder = write_output(network, views, tmp_path / "scene", np.linalg.inv(poses) if to_camera else poses)
    if not (is_inverse or is_opengl):
        read_scene(folder)
        return
    with pytest.raises(InputError) as error:
        read_scene(folder)
    direction = "from world to camera" if to_camera else "from camera to world"
    axes = "right, up, back" if is_opengl else "right, down, forward"
    assert f"found {direction}, axes {axes}" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("gain", "is_refused"), [(0.3, True), (0.9, False)])
def test_the_minimum_gain_of_another_convention(
    gain: float, is_refused: bool, views: RenderedViews, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(networks, "MIN_AGREEMENT_GAIN", gain)
    folder = write_output("CUT3R", views, tmp_path / "scene", views.matrices(to_camera=False) @ FLIP)
    with pytest.raises(InputError, match="axes") if is_refused else nullcontext():
        read_scene(folder)


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


@pytest.mark.parametrize(
    ("network", "damaged", "words"),
    [
        ("VGGT", "predictions.npz", "a reconstruction"),  # the names of the arrays are at the end of the file
        ("CUT3R", "depth/000003.npy", "000003.npy"),
        ("ViPE", "depth/walk.zip", "walk.zip"),
        ("Depth Anything 3 streaming", "results_output/frame_2.npz", "frame_2.npz"),
    ],
)
def test_a_cut_file_is_one_line(network: str, damaged: str, words: str, views: RenderedViews, tmp_path: Path) -> None:
    folder = write_output(network, views, tmp_path / "scene")
    _cut(folder / damaged)
    with pytest.raises(InputError, match=words) as error:
        read_scene(folder)
    assert "\n" not in str(error.value)


def test_missing_maps_are_counted(views: RenderedViews, tmp_path: Path) -> None:
    folder = write_output("CUT3R", views, tmp_path / "scene")
    (folder / "depth" / "000002.npy").unlink()
    with pytest.raises(InputError, match="6 maps, as many as poses"):
        read_scene(folder)


def test_several_outputs_are_named(views: RenderedViews, tmp_path: Path) -> None:
    folder = write_output("MegaSaM", views, tmp_path / "scene")
    (folder / "run_sgd_cvd_hr.npz").write_bytes((folder / "walk_sgd_cvd_hr.npz").read_bytes())
    with pytest.raises(InputError, match="one output of MegaSaM, or its file, found run_sgd_cvd_hr"):
        read_scene(folder)
    assert len(read_scene(folder / "run_sgd_cvd_hr.npz").views) == 6


def test_views_without_images_are_numbered(views: RenderedViews, tmp_path: Path) -> None:
    folder = write_output("MegaSaM", views, tmp_path / "scene")
    (folder / "images" / views.names[0]).unlink()
    scene = read_scene(folder)
    assert scene.views[0].name == "000000.png"
    assert "no folder images with 6 images" in scene.warnings[0]


@pytest.mark.parametrize(("width", "is_cropped"), [(660, False), (680, True)])
def test_cropped_images_are_a_warning(width: int, is_cropped: bool, views: RenderedViews, tmp_path: Path) -> None:
    folder = write_output("VGGT", views, tmp_path / "scene")
    for file in (folder / "images").iterdir():
        cv2.imwrite(str(file), np.zeros((480, width), dtype=np.uint8))
    assert any("cropped the images to 160 x 120" in line for line in read_scene(folder).warnings) == is_cropped


def test_points_at_edges_and_of_low_confidence_are_dropped() -> None:
    camera = pinhole_camera((20, 10), (20.0, 20.0), (10.0, 5.0), {})
    view = View("a", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64))
    depth = np.full((1, 10, 20), 2.0)
    depth[0, :, 10:] *= 1.044
    confidence = np.full((1, 10, 20), 5.0)
    confidence[0, :, :4] = 1.0
    assert len(depth_cloud([view], depth).points) == 10 * 18  # two columns next to the edge
    assert len(depth_cloud([view], depth, confidence).points) == 10 * 14
    depth[0, :, 10:] *= 1.036 / 1.044
    assert len(depth_cloud([view], depth).points) == 10 * 20


def test_the_focal_length_of_points(views: RenderedViews) -> None:
    local = (views.points[0] - views.centre[0]) @ views.rotation[0].T
    assert focal_of_points(local) == pytest.approx(125)
    assert focal_of_points(-local) == pytest.approx(125)


@pytest.mark.parametrize("kind", ["VGGT", "ViPE"])
def test_colmap_exports(kind: str, views: RenderedViews, tmp_path: Path) -> None:
    """VGGT's tracks have one element; those of ViPE refer to keypoints that do not exist."""
    sparse = tmp_path / "sparse"
    sparse.mkdir()
    (sparse / "cameras.txt").write_text("1 PINHOLE 160 120 125 125 80 60\n")
    cloud, images, points = views.points, [], []
    for row, name in enumerate(views.names):
        quaternion = Rotation.from_matrix(views.rotation[row]).as_quat(scalar_first=True)
        pose = [*quaternion, *(-views.rotation[row] @ views.centre[row])]
        keypoints = []
        for line, column in ((line, column) for line in range(2, 120, 12) for column in range(2, 160, 12)):
            number, point = len(points) + 1, cloud[row, line, column]
            track = f"{row + 1} {len(keypoints)}" if kind == "VGGT" else f"{row + 1} {number} 0 0 0 0"
            keypoints += [f"{column + 0.5} {line + 0.5} {number}"] * (kind == "VGGT")
            points.append(f"{number} {' '.join(map(str, point))} 9 9 9 0.0 {track}")
        images.append(f"{row + 1} {' '.join(map(str, pose))} 1 {name}\n{' '.join(keypoints)}")
    (sparse / "images.txt").write_text("\n".join(images) + "\n")
    (sparse / "points3D.txt").write_text("\n".join(points) + "\n")
    scene = read_scene(tmp_path)
    assert len(scene.points) == len(points)
    assert scene.observed == (kind == "VGGT")
    assert all(len(view.point_index) for view in scene.views)


@pytest.mark.parametrize(("lowest", "n_kept"), [(0.0, 160), (-100.0, 120)])
def test_a_fifth_of_the_pixels_has_a_low_confidence(lowest: float, n_kept: int) -> None:
    """LOW_CONFIDENCE_FRACTION, and never pixels without confidence: half of the values are negative."""
    camera = pinhole_camera((20, 10), (20.0, 20.0), (10.0, 5.0), {})
    view = View("a", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64))
    confidence = np.arange(1.0, 201.0).reshape(1, 10, 20)
    confidence[confidence <= 80] += lowest
    assert len(depth_cloud([view], np.full((1, 10, 20), 2.0), confidence).points) == n_kept


@pytest.mark.parametrize(
    ("log_ratio", "agreement", "n_views"), [(0.028, 1.0, 2), (0.032, 1.0, 1), (0.095, 1.0, 1), (0.105, 0.0, 1)]
)
def test_depths_of_two_maps_agree(log_ratio: float, agreement: float, n_views: int) -> None:
    """DEPTH_TOLERANCE of 0.03 for a point that both views see, AGREEMENT_TOLERANCE of 0.1 for the convention."""
    camera = pinhole_camera((20, 10), (20.0, 20.0), (10.0, 5.0), {})
    views = [View(name, camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64)) for name in "ab"]
    depth = np.full((2, 10, 20), 2.0)
    depth[1] *= np.exp(log_ratio)
    assert networks.depth_agreement(views, depth) == agreement
    assert networks.depth_agreement(views[:1], depth[:1]) == 0
    cloud = depth_cloud(views, depth)
    assert cloud.visible_offsets is not None
    assert set(np.diff(cloud.visible_offsets).tolist()) == {n_views}


@pytest.mark.parametrize(("factor", "is_reported"), [(1.017, False), (1.023, True)])
def test_gaussians_in_other_units_by_two_percent_are_reported(
    factor: float, is_reported: bool, views: RenderedViews, tmp_path: Path
) -> None:
    """MIN_UNIT_DIFFERENCE, of Gaussians at the points of the depth maps."""
    folder = write_output("Depth Anything 3", views, tmp_path / "scene")
    depths = read_scene(folder).dense
    assert depths is not None
    splat = write_splat(folder / "exports" / "gs_ply" / "0000.ply", depths.points / factor)
    scene = read_scene(splat)
    assert any("1 unit of it is" in line for line in scene.warnings) == is_reported
    assert scene.file_units == pytest.approx(factor if is_reported else 1.0, abs=0.002)


def _vggt(folder: Path, **changes: np.ndarray) -> Path:
    """Write an output of VGGT of two views of a wall, with changed arrays."""
    poses = np.tile(np.eye(4)[:3], (2, 1, 1))
    poses[1, 0, 3] = -0.1
    intrinsics = np.tile([[20.0, 0, 10], [0, 20, 5], [0, 0, 1]], (2, 1, 1))
    depth = np.full((2, 10, 20), 2.0)
    arrays = {"extrinsic": poses, "depth": depth, "intrinsic": intrinsics, "depth_conf": np.ones((2, 10, 20))}
    np.savez(folder / "predictions.npz", **(arrays | changes))
    return folder


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("extrinsic", np.zeros((2, 3, 3)), r"extrinsic: expected finite matrices \(n, 3, 4\) or \(n, 4, 4\)"),
        ("extrinsic", np.full((2, 3, 4), np.nan), "extrinsic: expected finite matrices"),
        ("extrinsic", np.zeros(12), "extrinsic: expected finite matrices"),
        ("extrinsic", np.tile(np.eye(4), (2, 1, 1)), None),
        ("extrinsic", np.tile(np.eye(4), (3, 1, 1)), "depth: expected 3 maps, as many as poses"),
        ("extrinsic", 2 * np.tile(np.eye(4)[:3], (2, 1, 1)), "view 0"),  # no rotation
        ("depth", np.full((2, 10, 20, 1), 2.0), None),
        ("depth", np.full((3, 10, 20), 2.0), "depth: expected 2 maps, as many as poses"),
        ("depth", np.full((2, 10, 20, 2), 2.0), "one channel"),
        ("depth_conf", np.ones((2, 10, 21)), r"depth_conf: expected \(2, 10, 20\), as the maps"),
        ("intrinsic", np.array([[20.0, 0, 10], [0, 20, 5], [0, 0, 1]]), None),
        ("intrinsic", np.tile([20.0, 20, 10, 5], (2, 1)), None),
        ("intrinsic", np.ones((2, 3)), r"view 0.*\(3, 3\) or \(4,\) numbers"),
        ("intrinsic", np.zeros((2, 3, 3)), "view 0"),
    ],
)
def test_shapes_of_the_output_of_a_network(name: str, array: np.ndarray, message: str | None, tmp_path: Path) -> None:
    folder = _vggt(tmp_path, **{name: array})
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        scene = read_scene(folder)
        assert [view.camera.focal_px for view in scene.views] == [20.0, 20.0]
        assert scene.dense is not None
        assert len(scene.dense.points) > 300


def test_the_arrays_of_a_network_identify_it(tmp_path: Path) -> None:
    folder = _vggt(tmp_path)
    found = networks.network_output(folder)
    assert found is not None
    assert (found[0], found[1].network) == (folder / "predictions.npz", "VGGT")
    assert networks.network_output(folder / "predictions.npz") == found
    np.savez(folder / "predictions.npz", extrinsic=np.eye(4)[None])
    assert networks.network_output(folder) is None
