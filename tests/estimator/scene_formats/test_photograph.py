"""One photograph with the depth map or the points of a network is a scene whose hidden sides are truncated."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from estimator.pipeline import estimate_scale, measure_objects
from estimator.scene_formats.depth_files import read_depth
from estimator.scene_formats.photograph import read_photograph
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from tests.support.skips import skip_without
from tests.synthetic.exports import write_points
from tests.synthetic.networks import RenderedViews, exr_bytes, rendered_views
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.render import NoOpenGL

SCALE = 0.4
#: The view with most of the furniture.
ROW = 2


@pytest.fixture(scope="module")
def views() -> RenderedViews:
    with skip_without(NoOpenGL):
        return rendered_views(furnished_room("study", 1003), scale=SCALE, views=6)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    cv2.imwrite(str(tmp_path / "photo.png"), np.zeros((480, 640), dtype=np.uint8))
    return tmp_path / "photo.png"


def points_of(views: RenderedViews) -> NDArray[Any]:
    """Return the points (h, w, 3) of the photograph in the frame of its camera."""
    return np.asarray((views.points[ROW] - views.centre[ROW]) @ views.rotation[ROW].T)


def test_the_scale_of_a_photograph(views: RenderedViews, photo: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "depth.npy", views.depth[ROW])
    scene = read_photograph(photo, tmp_path / "depth.npy", focal_px=500)
    masks = [replace(one, view=0) for one in views.instances if one.view == ROW]
    result = estimate_scale(scene, masks)
    assert result.status == "resolved"
    assert result.interval is not None
    assert result.interval.low < SCALE < result.interval.high
    measured = [one for one in measure_objects(scene, masks).objects if one.skipped is None]
    assert len(measured) > 5
    for one in measured:
        assert one.truncated[:2].all()
        assert (one.sigma >= 0.05).all()
    assert not all(one.truncated[2] for one in measured)


FORMS = (
    "depth.npz",
    "moge/depth.exr",
    "points.npz",
    "points.npy",
    "moge/points.exr",
    "points.ply",
    "opengl.ply",
    "moge/mesh.glb",
)


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_the_file(form: str, views: RenderedViews, photo: Path, tmp_path: Path) -> None:
    """Focal lengths are in the file, in MoGe's fov.json, in the points, or stated."""
    file, points, depth = tmp_path / form, points_of(views), views.depth[ROW]
    file.parent.mkdir(exist_ok=True)
    if form == "depth.npz":
        np.savez(file, depth=depth, intrinsics=views.intrinsics[ROW])
    elif form == "moge/depth.exr":
        file.write_bytes(exr_bytes({"Y": depth}, np.float32))
    elif form == "moge/points.exr":
        file.write_bytes(exr_bytes(dict(zip("RGB", np.moveaxis(points, 2, 0), strict=True)), np.float32))
    elif form == "points.npz":
        np.savez(file, points=points, mask=np.ones(depth.shape))
    elif form == "points.npy":
        np.save(file, points)
    elif form == "moge/mesh.glb":  # moge/scripts/infer.py: a mesh with the axes right, up, back
        corners = points[::4, ::4].reshape(-1, 3) * [1, -1, -1]
        faces = np.arange(len(corners) // 3 * 3).reshape(-1, 3)
        trimesh.Trimesh(corners, faces, process=False).export(str(file))
    else:
        write_points(file, points[::4, ::4].reshape(-1, 3) * ([1, -1, -1] if form == "opengl.ply" else 1))
    (tmp_path / "moge" / "fov.json").parent.mkdir(exist_ok=True)
    (tmp_path / "moge" / "fov.json").write_text(json.dumps({"fov_x": float(np.degrees(2 * np.arctan(320 / 500)))}))
    focal = 500.0 if form.endswith(".ply") else None
    is_depth = "depth" in form
    scene = read_photograph(photo, file if is_depth else None, None if is_depth else file, focal)
    (view,) = scene.views
    assert (view.camera.width, view.camera.height) == (640, 480)
    assert view.camera.params == pytest.approx([500, 500, 320, 240], rel=1e-3)
    assert scene.dense is not None
    middle = scene.dense.points[len(scene.dense.points) // 2]
    assert np.linalg.norm(points.reshape(-1, 3) - middle, axis=1).min() < 0.02
    assert (scene.dense.points[:, 2] > 0).all()


def test_the_focal_length_of_exif(views: RenderedViews, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 27
    Image.new("L", (640, 480)).save(tmp_path / "photo.jpg", exif=exif)
    np.save(tmp_path / "depth.npy", views.depth[ROW])
    scene = read_photograph(tmp_path / "photo.jpg", tmp_path / "depth.npy")
    assert scene.views[0].camera.focal_px == pytest.approx(27 / 43.2666 * 800)


@pytest.mark.parametrize(
    ("shape", "focal", "words"),
    [((240, 320), None, "focal length"), ((240, 240), 500, "aspect ratio"), ((2, 240, 320), 500, "one map")],
)
def test_what_is_missing_is_one_line(
    shape: tuple[int, ...], focal: float | None, words: str, photo: Path, tmp_path: Path
) -> None:
    np.save(tmp_path / "depth.npy", np.ones(shape))
    with pytest.raises(InputError, match=words) as error:
        read_photograph(photo, tmp_path / "depth.npy", focal_px=focal)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("width", "is_read"), [(334, True), (338, False)])
def test_the_aspect_ratio_of_a_map(width: int, is_read: bool, photo: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "depth.npy", np.ones((240, width)))
    with nullcontext() if is_read else pytest.raises(InputError, match="aspect"):
        read_photograph(photo, tmp_path / "depth.npy", focal_px=500)


def test_the_command(views: RenderedViews, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "depth.npy", views.depth[ROW])
    number = next(one["id"] for one in views.dataset["images"] if one["file_name"] == views.names[ROW])
    masks = [one for one in views.dataset["annotations"] if one["image_id"] == number]
    images = [{"id": number, "file_name": "photo.png", "width": 640, "height": 480}]
    (tmp_path / "masks.json").write_text(json.dumps(views.dataset | {"images": images, "annotations": masks}))
    words = [str(photo), "--depth-map", str(tmp_path / "depth.npy"), "--instances", str(tmp_path / "masks.json")]
    assert main([*words, "--focal", "500", "--json", "--write-scaled", str(tmp_path / "metres.npy")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["interval"]["low"] < SCALE < record["interval"]["high"]
    assert read_depth(tmp_path / "metres.npy") == pytest.approx(views.depth[ROW] * record["scale"], rel=1e-4)
    assert main([*words, "--points", str(tmp_path / "depth.npy")]) == 2
    assert main([str(tmp_path), *words[1:]]) == 2
    assert main([str(photo)]) == 2
    lines = capsys.readouterr().err.splitlines()
    for text in ("found both", "a photograph as SCENE", "one image: add"):
        assert any(text in line for line in lines)
