"""Input of a scene: accepted names, and files that are found next to it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from estimator.instances.instance_reader import read_instances, read_instances_and_warnings
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from tests.synthetic.small_scene import write_small_scene


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reading") / "whole"
    write_small_scene(folder)
    return folder


def test_a_reconstruction_file_stands_for_its_folder(small: Path) -> None:
    scene = read_scene(small / "opensfm" / "reconstruction.json")
    assert scene.path == small / "opensfm"
    assert scene.format == "opensfm"


def test_paths_may_be_text(small: Path) -> None:
    assert read_scene(str(small / "text")).format == "colmap-text"


def test_no_such_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file or folder"):
        read_scene(tmp_path / "nowhere")
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(InputError, match="file: scene: expected a reconstruction"):
        read_scene(tmp_path / "file")


def test_what_is_in_a_folder_without_a_model_is_reported(tmp_path: Path) -> None:
    (tmp_path / "holiday.mp4").write_bytes(b"x")
    with pytest.raises(InputError, match=r"found holiday\.mp4$"):
        read_scene(tmp_path)


def test_missing_instances_are_one_readable_line(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small / "colmap", tmp_path / "scene")
    (tmp_path / "scene" / "instances.json").unlink()
    with pytest.raises(
        InputError, match=r"--instances FILE, or --images DIR --detector MODEL .*, found none$"
    ) as error:
        read_instances(None, read_scene(tmp_path / "scene"))
    assert len(str(error.value).removeprefix(str(tmp_path))) < 200


def test_instances_json_comes_before_pictures(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small / "opensfm", tmp_path / "scene")
    scene = read_scene(tmp_path / "scene")
    assert "read as objects" in read_instances_and_warnings(scene)[1][0]
    shutil.copyfile(small / "colmap" / "instances.json", tmp_path / "scene" / "instances.json")
    assert not read_instances_and_warnings(scene)[1]
    pictures = read_instances(tmp_path / "scene" / "instances", scene)
    assert len(pictures) == len(read_instances(None, scene)) == 16


def test_polygons_run_lengths_and_pictures_are_the_same_masks(small: Path) -> None:
    scene = read_scene(small / "opensfm")
    pictures = {(item.view, item.category): item for item in read_instances(small / "opensfm" / "instances", scene)}
    for item in read_instances(small / "colmap" / "instances.json", scene):
        other = pictures[item.view, item.category]
        assert other.origin == item.origin
        np.testing.assert_array_equal(other.mask, item.mask)


@pytest.mark.parametrize("place", ["dense.ply", "fused.ply", "dense/0/fused.ply", "merged.ply"])
def test_clouds_in_the_usual_places(place: str, small: Path, tmp_path: Path) -> None:
    shutil.copytree(small / "text", tmp_path / "scene")
    (tmp_path / "scene" / place).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(small / "colmap" / "dense.ply", tmp_path / "scene" / place)
    dense = read_scene(tmp_path / "scene").dense
    assert dense is not None
    assert dense.path == tmp_path / "scene" / place


def test_opensfms_own_cloud(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small / "opensfm", tmp_path / "scene")
    place = tmp_path / "scene" / "undistorted" / "depthmaps"
    place.mkdir(parents=True)
    shutil.copyfile(small / "colmap" / "dense.ply", place / "merged.ply")
    dense = read_scene(tmp_path / "scene").dense
    assert dense is not None
    assert dense.path == place / "merged.ply"


def test_a_workspace_model_numbers_the_visibility(small: Path, tmp_path: Path) -> None:
    """A cloud fused from a model without the first image: positions count that model's images."""
    import pycolmap

    shutil.copytree(small / "text", tmp_path / "scene")
    workspace = tmp_path / "scene" / "dense" / "0"
    (workspace / "sparse").mkdir(parents=True)
    fused = pycolmap.Reconstruction(str(small / "colmap"))
    names = sorted(image.name for image in fused.images.values())
    fused.deregister_frame(fused.find_image_with_name(names[0]).frame_id)
    fused.write_binary(str(workspace / "sparse"))
    left = [view.name for view in read_scene(workspace).views]
    assert names[0] not in left
    shutil.copyfile(small / "colmap" / "dense.ply", workspace / "fused.ply")
    lists = np.tile([1, len(left) - 1], 60).astype("<u4")
    (workspace / "fused.ply.vis").write_bytes(np.uint64(60).tobytes() + lists.tobytes())
    scene = read_scene(tmp_path / "scene")
    assert scene.dense is not None
    assert scene.dense.visible_views is not None
    assert {scene.views[row].name for row in scene.dense.visible_views} == {left[-1]}
    lists[1] = len(left)
    (workspace / "fused.ply.vis").write_bytes(np.uint64(60).tobytes() + lists.tobytes())
    with pytest.raises(InputError, match="the images of the model beside the cloud"):
        read_scene(tmp_path / "scene")


def test_reading_a_pinhole_scene_loads_nothing_heavy(small: Path) -> None:
    heavy = (
        "{'pycolmap', 'cv2', 'matplotlib', 'sklearn', 'open3d', 'pandas', 'scrapy', 'nltk', 'pycocotools', 'pyarrow'}"
    )
    code = f"import sys, estimator.reconstructions.scene_reader; print(sorted({heavy} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert found.stdout.strip() == "[]"


def test_points_far_from_everything_are_left_out(small: Path, tmp_path: Path) -> None:
    scene = read_scene(small / "colmap", "none")
    points = np.vstack([scene.points, scene.points[:5] * 1e9])
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {a}" for a in "xyz")]
    lines += ["end_header", *(" ".join(map(repr, row)) for row in points.tolist())]
    (tmp_path / "cloud.ply").write_text("\n".join(lines) + "\n")
    cloud = read_scene(small / "colmap", tmp_path / "cloud.ply")
    assert cloud.dense is not None
    np.testing.assert_array_equal(cloud.dense.points, scene.points)
    assert any("5 points without a position, or far" in line for line in cloud.warnings)
