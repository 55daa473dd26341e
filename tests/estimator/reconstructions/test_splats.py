"""Gaussian splats: centres, cameras in their folder, the normalisation of nerfstudio, and splats in metres."""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from estimator.instances.view_matching import ViewLookup
from estimator.outputs.rescaled import write_rescaled
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.image_files import image_file
from estimator.reconstructions.ply import read_points
from estimator.reconstructions.scene_reader import read_scene
from estimator.reconstructions.splats import is_splat, scaled_splat
from estimator.records.scene import Scene
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from tests.synthetic.exports import APPLIED, write_export
from tests.synthetic.small_scene import small_model
from tests.synthetic.splats import GSPLY, PROPERTIES, render, write_cameras, write_compressed, write_splat, write_spz

SCALE = 0.37897
LENS = [300.0, 300.0, 160.0, 120.0]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("splats") / "model"
    folder.mkdir()
    small_model("PINHOLE", LENS).write_binary(str(folder))
    return folder


@pytest.fixture(scope="module")
def scene(model: Path) -> Scene:
    return read_scene(model)


@pytest.fixture
def centres() -> NDArray[np.float64]:
    return np.random.default_rng(1).uniform(-2, 2, (300, 3))


@pytest.mark.parametrize(("write", "tolerance"), [(write_splat, 1e-6), (write_compressed, 4e-3), (write_spz, 2e-4)])
def test_centres_of_every_form(
    write: Callable[..., Path], tolerance: float, centres: NDArray[Any], tmp_path: Path
) -> None:
    file = write(tmp_path / ("a.spz" if write is write_spz else "a.ply"), centres)
    assert is_splat(file)
    axes = (1, -1, -1) if write is write_spz else (1, 1, 1)
    np.testing.assert_allclose(read_points(file) * axes, centres, atol=tolerance)
    if write is write_spz:
        np.testing.assert_array_equal(read_points(write(file, centres, version=4)) * axes, read_points(file) * axes)


@pytest.mark.parametrize("version", GSPLY)
def test_spz_files_of_gsply(version: int, tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(base64.b64decode(GSPLY[version]))
    i = np.arange(12)
    np.testing.assert_array_equal(read_points(tmp_path / "a.spz"), np.column_stack([i / 8, -i / 16, 1 + i / 32]))


@pytest.mark.parametrize("version", [2, 4])
@pytest.mark.parametrize("axes", [(1, -1, -1), (1, 1, 1)])
def test_axes_of_spz(version: int, axes: tuple[int, int, int], model: Path, scene: Scene, tmp_path: Path) -> None:
    """The cameras get the axes of the file, whether it has those of SPZ or those of the PLY file (gsply)."""
    file = write_spz(tmp_path / "a.spz", scene.points, version=version, axes=axes)
    found = read_scene(file, cameras=model)
    np.testing.assert_allclose(found.points, scene.points * axes, atol=1e-12)
    assert found.dense is not None
    np.testing.assert_allclose(found.dense.points, found.points, atol=2e-4)
    for view, other in zip(scene.views, found.views, strict=True):
        np.testing.assert_allclose(other.to_camera(found.points), view.to_camera(scene.points), atol=1e-9)


def test_faint_gaussians_are_no_points(centres: NDArray[Any], tmp_path: Path) -> None:
    opacity = np.where(np.arange(300) < 100, 0.49, 0.51)
    np.testing.assert_allclose(read_points(write_splat(tmp_path / "a.ply", centres, opacity)), centres[100:], rtol=1e-6)
    with pytest.raises(InputError, match="opacity: expected at least one Gaussian"):
        read_points(write_splat(tmp_path / "b.ply", centres, 0.1))


@pytest.mark.parametrize("end", [10, 40, 100, 1500])
def test_damaged_spz_4_is_one_line(end: int, centres: NDArray[Any], tmp_path: Path) -> None:
    file = write_spz(tmp_path / "a.spz", centres, version=4)
    file.write_bytes(file.read_bytes()[:end])
    with pytest.raises(InputError, match=r"a\.spz: content: expected a complete SPZ file") as error:
        read_points(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("fault", ["cut", "version", "count", "stream"])
def test_damaged_spz_is_one_line(fault: str, centres: NDArray[Any], tmp_path: Path) -> None:
    content = bytearray(gzip.decompress(write_spz(tmp_path / "a.spz", centres).read_bytes()))
    if fault == "version":
        content[4] = 9
    if fault == "count":
        content[8:12] = b"\xff\xff\xff\x7f"
    data = gzip.compress(content[:400] if fault == "cut" else content)
    (tmp_path / "a.spz").write_bytes(data[:200] if fault == "stream" else data)
    with pytest.raises(InputError) as error:
        read_points(tmp_path / "a.spz")
    assert str(tmp_path / "a.spz") in str(error.value)
    assert "\n" not in str(error.value)


def test_too_few_chunks(centres: NDArray[Any], tmp_path: Path) -> None:
    file = write_compressed(tmp_path / "a.ply", centres)
    file.write_bytes(file.read_bytes().replace(b"element chunk 2", b"element chunk 1"))
    with pytest.raises(InputError, match="one chunk for 256 Gaussians"):
        read_points(file)


def test_cameras_of_the_training_program(scene: Scene, tmp_path: Path) -> None:
    """The layout of Inria's output: cameras.json two folders above the splat."""
    write_cameras(scene, tmp_path / "cameras.json")
    (tmp_path / "images").mkdir()
    for view in scene.views:
        (tmp_path / "images" / view.name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / "images" / Path(view.name).name).write_bytes(b"")
    file = write_splat(tmp_path / "point_cloud" / "iteration_7" / "point_cloud.ply", scene.points)
    splat = read_scene(file)
    assert splat.format == "gaussian-splatting"
    assert splat.dense is not None
    assert splat.dense.path == file
    for view, other in zip(scene.views, splat.views, strict=True):
        assert other.name == Path(view.name).name
        np.testing.assert_allclose(other.rotation, view.rotation, atol=1e-12)
        np.testing.assert_allclose(other.centre, view.centre, atol=1e-12)


@pytest.mark.parametrize("cameras", ["colmap", "nerfstudio"])
def test_normalisation_of_nerfstudio(cameras: str, model: Path, scene: Scene, tmp_path: Path) -> None:
    """The steps of nerfstudio's data parser: turn and centre, then scale; the file refers to the original frame."""
    turn, shift, scale = Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix(), np.array([0.3, -1.2, 0.5]), 0.173
    saved = scene.points @ APPLIED[:, :3].T  # points in the frame of transforms.json
    splat = write_splat(tmp_path / "splat.ply", scale * (saved @ turn.T + shift))
    transform = np.column_stack([turn, shift]) @ np.vstack([APPLIED, [0, 0, 0, 1]])
    document = {"transform": transform.tolist(), "scale": scale}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(document), encoding="utf-8")
    folder = write_export(scene, "nerfstudio", tmp_path / "data").parent if cameras == "nerfstudio" else model
    found = read_scene(splat, cameras=folder)
    assert found.dense is not None
    np.testing.assert_allclose(found.dense.points, found.points, atol=1e-5)
    for view, other in zip(scene.views, found.views, strict=True):  # the same image of the moved points
        np.testing.assert_allclose(other.to_camera(found.points), scale * view.to_camera(scene.points), atol=1e-9)
    assert any("0.173 units of the splat" in line for line in found.warnings)
    write_rescaled(found, 2.0, tmp_path / "metric")  # the model is that of the moved cameras
    again = read_scene(tmp_path / "metric")
    np.testing.assert_allclose(again.points, 2 * found.points, atol=1e-9)


def unseen_place(scene: Scene) -> NDArray[Any]:
    """Return a distant position (3,) outside all images."""
    candidates = 1000 * np.random.default_rng(2).normal(size=(500, 3))
    seen = [np.isfinite(pixels_in_view(view, candidates)[0][:, 0]) for view in scene.views]
    return np.asarray(candidates[~np.any(seen, axis=0)][0])


@pytest.mark.parametrize("n_seen", [9, 10])
def test_cameras_of_another_frame_without_points(n_seen: int, scene: Scene, tmp_path: Path) -> None:
    """On both sides of MIN_SEEN_FRACTION."""
    write_cameras(scene, tmp_path / "cameras.json")
    points = np.tile(unseen_place(scene), (100, 1))
    points[:n_seen] = scene.points[:n_seen]
    splat = write_splat(tmp_path / "splat.ply", points)
    if n_seen / 100 >= 0.1:
        assert any("not checked that the cameras have the frame" in line for line in read_scene(splat).warnings)
    else:
        with pytest.raises(InputError, match=r"cameras in the frame of the splat.*9% of its Gaussians"):
            read_scene(splat)


@pytest.mark.parametrize("missing", [0, 1])
def test_cameras_of_another_frame(missing: int, model: Path, scene: Scene, tmp_path: Path) -> None:
    """On both sides of MIN_NEAR_FRACTION."""
    n_near = math.ceil(0.5 * len(scene.points)) - missing
    points = np.vstack([scene.points[:n_near], unseen_place(scene)])
    splat = write_splat(tmp_path / "splat.ply", points)
    if missing:
        with pytest.raises(InputError, match=r"cameras in the frame of the splat.*of their points near a Gaussian"):
            read_scene(splat, cameras=model)
    else:
        assert read_scene(splat, cameras=model).dense is not None


@pytest.mark.parametrize(("factor", "is_near"), [(0.99, True), (1.01, False)])
def test_gaussians_near_a_point(factor: float, is_near: bool, model: Path, scene: Scene, tmp_path: Path) -> None:
    """On both sides of MAX_GAUSSIAN_DISTANCE: all Gaussians are this far from their points, along one axis."""
    tails = np.quantile(scene.points, [0.02, 0.98], axis=0)
    radius = 0.01 * np.linalg.norm(np.ptp(tails, axis=0))
    splat = write_splat(tmp_path / "splat.ply", scene.points + np.array([factor * radius, 0, 0]))
    if is_near:
        assert read_scene(splat, cameras=model).dense is not None
    else:
        with pytest.raises(InputError, match="near a Gaussian"):
            read_scene(splat, cameras=model)


def test_a_normalised_splat_without_its_transform_is_refused(model: Path, scene: Scene, tmp_path: Path) -> None:
    """As nerfstudio and gsplat train: centred, and scaled so that all cameras are within 1 of the origin."""
    centres = np.array([view.centre for view in scene.views])
    middle = centres.mean(axis=0)
    splat = write_splat(tmp_path / "splat.ply", (scene.points - middle) / np.abs(centres - middle).max())
    with pytest.raises(InputError, match="cameras in the frame of the splat"):
        read_scene(splat, cameras=model)


def test_an_ascii_splat_is_refused(centres: NDArray[Any], tmp_path: Path) -> None:
    names = ("x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2")
    lines = ["ply", "format ascii 1.0", "element vertex 300", *(f"property float {name}" for name in names)]
    rows = [" ".join(map(str, [*row, 3, -4, -4, -4])) for row in centres]
    (tmp_path / "a.ply").write_text("\n".join([*lines, "end_header", *rows, ""]))
    with pytest.raises(InputError, match=r"a\.ply: format: expected binary PLY \(convert the splat\), found ASCII"):
        read_points(tmp_path / "a.ply")


def test_masks_of_cameras_without_images(scene: Scene, tmp_path: Path) -> None:
    """Inria's `cameras.json` names images without suffixes; masks and --images have them."""
    write_cameras(scene, tmp_path / "cameras.json")
    splat = read_scene(write_splat(tmp_path / "splat.ply", scene.points))
    assert all("." not in view.name for view in splat.views)
    names = [f"{view.name}.jpg" for view in splat.views]
    assert [ViewLookup(splat).row(f"photos/{name}") for name in names] == list(range(len(names)))
    assert ViewLookup(splat).row("other.jpg") is None
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / names[1]).write_bytes(b"")
    assert image_file((tmp_path / "photos",), splat.views[1]) == tmp_path / "photos" / names[1]
    assert image_file((tmp_path / "photos",), splat.views[0]) is None


def test_without_cameras(centres: NDArray[Any], tmp_path: Path) -> None:
    splat = write_splat(tmp_path / "a" / "b" / "c" / "splat.ply", centres)
    with pytest.raises(InputError, match="cameras: expected its cameras in its folder or above"):
        read_scene(splat)


@pytest.mark.parametrize("write", [write_splat, write_compressed])
def test_scaled_splat_looks_the_same(write: Callable[..., Path], scene: Scene, tmp_path: Path) -> None:
    file = write(tmp_path / "a.ply", scene.points)
    scaled = tmp_path / "b.ply"
    scaled.write_bytes(scaled_splat(file.read_bytes(), SCALE))
    view = scene.views[0]
    before = render(file, view)
    assert np.ptp(before) > 0.3
    np.testing.assert_allclose(render(scaled, replace(view, translation=view.translation * SCALE)), before, atol=1e-5)
    assert np.abs(render(file, replace(view, translation=view.translation * SCALE)) - before).max() > 0.1
    if write is write_compressed:
        return
    vertices = trimesh.load(scaled).vertices
    np.testing.assert_allclose(np.sort(vertices, axis=0), np.sort(scene.points * SCALE, axis=0), rtol=1e-5)


def test_only_lengths_change(centres: NDArray[Any], tmp_path: Path) -> None:
    data = write_splat(tmp_path / "a.ply", centres).read_bytes()
    body = data.index(b"end_header\n") + 11
    rows = np.frombuffer(data, "<f4", offset=body).reshape(300, -1)
    scaled = scaled_splat(data, SCALE)
    assert scaled[:body] == data[:body]
    changed = np.frombuffer(scaled, "<f4", offset=body).reshape(300, -1)
    lengths = [PROPERTIES.index(name) for name in ("x", "y", "z", "scale_0", "scale_1", "scale_2")]
    others = [column for column in range(len(PROPERTIES)) if column not in lengths]
    np.testing.assert_array_equal(changed[:, others], rows[:, others])
    np.testing.assert_allclose(changed[:, lengths[:3]], rows[:, lengths[:3]] * SCALE, rtol=1e-6)
    np.testing.assert_allclose(changed[:, lengths[3:]], rows[:, lengths[3:]] + np.log(SCALE), rtol=1e-5)


def test_scaled_compressed_splat(centres: NDArray[Any], tmp_path: Path) -> None:
    file = write_compressed(tmp_path / "a.ply", centres)
    scaled = tmp_path / "b.ply"
    scaled.write_bytes(scaled_splat(file.read_bytes(), SCALE))
    np.testing.assert_allclose(read_points(scaled), SCALE * read_points(file), atol=1e-6)
    start = file.read_bytes().index(b"end_header\n") + 11
    before, after = (np.frombuffer(one.read_bytes(), "<f4", 24, start).reshape(2, 12) for one in (file, scaled))
    np.testing.assert_allclose(after[:, 6:], before[:, 6:] + np.log(SCALE), rtol=1e-6)
    assert file.read_bytes()[start + 96 :] == scaled.read_bytes()[start + 96 :]


def test_command_writes_the_splat_in_metres(
    model: Path, scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    splat = write_splat(tmp_path / "splat.ply", scene.points)
    length = ["--known-length", "0,0,0", "1,0,0", "37.897cm"]
    out = tmp_path / "metric.ply"
    arguments = [str(splat), "--cameras", str(model), "--json", "--write-scaled", str(out), *length]
    assert main(arguments) == 0, capsys.readouterr().err
    result = json.loads(capsys.readouterr().out)
    record = json.loads((tmp_path / "scale.json").read_text(encoding="utf-8"))
    assert record["schema"] == "metric-tree/scale-sidecar/1"
    assert record["metres_per_unit"] == result["scale"] == pytest.approx(SCALE, rel=1e-3)
    assert record["units_per_meter"] == pytest.approx(1 / SCALE, rel=1e-3)
    assert record["metersPerUnit"] == record["metres_per_unit"]
    assert (record["low"], record["high"]) == (result["interval"]["low"], result["interval"]["high"])
    assert (record["model"], record["model_in_metres"]) == ("splat.ply", "metric.ply")
    assert record["release"] == result["tree"]["version"]
    np.testing.assert_allclose(read_points(out), scene.points * result["scale"], rtol=1e-3, atol=1e-4)
    assert main([str(splat), "--cameras", str(model), "--write-scaled", str(tmp_path / "folder"), *length]) == 0
    again = json.loads((tmp_path / "folder" / "scale.json").read_text(encoding="utf-8"))
    assert again == record | {"model": "model", "model_in_metres": "folder"}


@pytest.mark.parametrize("version", [2, 4])
def test_spz_is_not_written(
    version: int, model: Path, scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    splat = write_spz(tmp_path / "splat.spz", scene.points, version=version)
    length = ["--known-length", "0,0,0", "1,0,0", "1m"]
    out = tmp_path / "metric.ply"
    assert main([str(splat), "--cameras", str(model), "--write-scaled", str(out), *length]) == 2
    assert "convert the splat to PLY" in capsys.readouterr().err
    assert not out.exists()
    assert not (tmp_path / "scale.json").exists()


@pytest.mark.parametrize(
    ("count", "bits", "field"),
    [
        (10_000_000, 12, "content"),
        (10_000_001, 12, "header"),
        (0, 12, "header"),
        (301, 24, "content"),
        (300, 25, "header"),
    ],
)
def test_the_header_of_spz(count: int, bits: int, field: str, centres: NDArray[Any], tmp_path: Path) -> None:
    """MAX_SPZ_POINTS of ten million Gaussians; the file has 300."""
    content = bytearray(gzip.decompress(write_spz(tmp_path / "a.spz", centres).read_bytes()))
    content[8:12], content[13] = count.to_bytes(4, "little"), bits
    (tmp_path / "a.spz").write_bytes(gzip.compress(content[: 16 + 3000]))
    with pytest.raises(InputError, match=f"{field}: expected"):
        read_points(tmp_path / "a.spz")
