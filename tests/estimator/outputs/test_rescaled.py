"""Models written at metric scale: read back by us and by pycolmap, equal to COLMAP's own transform."""

from __future__ import annotations

import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from estimator.outputs.rescaled import TRANSFORM, write_colmap_model, write_rescaled, write_rescaled_cloud
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.result import ScaleResult
from estimator.records.scene import DenseCloud, Scene
from metric_base.errors import InputError
from tests.synthetic.exports import write_export
from tests.synthetic.small_scene import small_model, write_small_scene

SCALE = 0.37897


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rescaled") / "whole"
    write_small_scene(folder)
    return folder


def check_scaled(scene: Scene, scaled: Scene, scale: float) -> None:
    """Views are compared by name, and points by their observations, because COLMAP writes them in another order."""
    np.testing.assert_allclose(np.sort(scaled.points, axis=0), np.sort(scene.points * scale, axis=0), rtol=1e-15)
    others = {view.name: view for view in scaled.views}
    assert len(others) == len(scene.views)
    for view in scene.views:
        other = others[view.name]
        np.testing.assert_allclose(other.rotation, view.rotation, atol=1e-15)
        np.testing.assert_allclose(other.translation, view.translation * scale, rtol=1e-15)
        np.testing.assert_array_equal(other.keypoints, view.keypoints)
        np.testing.assert_allclose(scaled.points[other.point_index], scene.points[view.point_index] * scale, rtol=1e-15)


def seen_by(scene: Scene) -> list[list[str]]:
    """The names of the views that see each dense point."""
    assert scene.dense is not None
    offsets, views = scene.dense.visible_offsets, scene.dense.visible_views
    assert offsets is not None
    assert views is not None
    return [sorted(scene.views[row].name for row in views[a:b]) for a, b in itertools.pairwise(offsets.tolist())]


@pytest.mark.parametrize("form", ["colmap", "text", "opensfm"])
def test_every_form_reads_back_scaled(form: str, small: Path, tmp_path: Path) -> None:
    scene = read_scene(small / form)
    write_rescaled(scene, SCALE, tmp_path / "metric")
    scaled = read_scene(tmp_path / "metric")
    check_scaled(scene, scaled, SCALE)
    if scene.dense is not None:
        assert scaled.dense is not None
        np.testing.assert_allclose(scaled.dense.points, scene.dense.points * SCALE, rtol=1e-6)
        assert seen_by(scaled) == seen_by(scene)


def test_visibility_counts_the_views_of_the_written_model(small: Path, tmp_path: Path) -> None:
    """The cloud's own model, whose order differs from the shots', is not written with it."""
    document = json.loads((small / "opensfm" / "reconstruction.json").read_text(encoding="utf-8"))
    document[0]["shots"] = dict(reversed(document[0]["shots"].items()))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "reconstruction.json").write_text(json.dumps(document), encoding="utf-8")
    scene = read_scene(tmp_path / "in", small / "colmap" / "dense.ply")
    write_rescaled(scene, SCALE, tmp_path / "out")
    scaled = read_scene(tmp_path / "out")
    assert scene.dense is not None
    assert scaled.dense is not None
    np.testing.assert_array_equal(scaled.dense.visible_offsets, scene.dense.visible_offsets)
    assert seen_by(scaled) == seen_by(scene)


@pytest.mark.parametrize("suffix", ["bin", "txt"])
def test_colmap_reads_what_its_own_transform_gives(suffix: str, tmp_path: Path) -> None:
    """Rigs with several sensors included: every pose of the five files is scaled."""
    folder = tmp_path / "scene" / "sparse" / "0"
    folder.mkdir(parents=True)
    reconstruction = small_model()
    (reconstruction.write_binary if suffix == "bin" else reconstruction.write_text)(str(folder))
    write_rescaled(read_scene(tmp_path / "scene"), SCALE, tmp_path / "metric")
    scaled = pycolmap.Reconstruction(str(tmp_path / "metric" / "sparse" / "0"))
    reconstruction.transform(pycolmap.Sim3d(SCALE, pycolmap.Rotation3d(), np.zeros(3)))
    assert sorted(scaled.images) == sorted(reconstruction.images)
    for key, image in reconstruction.images.items():
        np.testing.assert_allclose(
            scaled.images[key].cam_from_world().matrix(), image.cam_from_world().matrix(), atol=1e-12
        )
    for key, point in reconstruction.points3D.items():
        np.testing.assert_allclose(scaled.points3D[key].xyz, point.xyz, rtol=1e-12)
        assert len(scaled.points3D[key].track.elements) == len(point.track.elements)
    for key, rig in reconstruction.rigs.items():
        for sensor, pose in rig.non_ref_sensors.items():
            np.testing.assert_allclose(scaled.rigs[key].non_ref_sensors[sensor].matrix(), pose.matrix(), atol=1e-12)


def test_the_transform_file_is_colmaps(small: Path, tmp_path: Path) -> None:
    write_rescaled(read_scene(small / "colmap"), SCALE, tmp_path / "metric")
    words = (tmp_path / "metric" / TRANSFORM).read_text(encoding="utf-8").split()
    assert [float(word) for word in words] == [SCALE, 1, 0, 0, 0, 0, 0, 0]


def test_only_the_chosen_reconstruction_is_written(small: Path, tmp_path: Path) -> None:
    document = json.loads((small / "opensfm" / "reconstruction.json").read_text(encoding="utf-8"))
    name, shot = next(iter(document[0]["shots"].items()))
    rigs = {"rig_instances": {"r": {"rotation": [0, 0, 0], "translation": [1, 2, 4], "rig_camera_ids": {}}}}
    (tmp_path / "in").mkdir()
    several = json.dumps([document[0] | {"shots": {name: shot}}, document[0] | rigs])
    (tmp_path / "in" / "reconstruction.json").write_text(several, encoding="utf-8")
    write_rescaled(read_scene(tmp_path / "in"), 0.5, tmp_path / "out")
    (written,) = json.loads((tmp_path / "out" / "reconstruction.json").read_text(encoding="utf-8"))
    assert len(written["shots"]) == 8
    assert written["rig_instances"]["r"]["translation"] == [0.5, 1, 2]


@pytest.mark.parametrize("form", ["ascii", "binary_big_endian"])
def test_clouds_of_other_forms(form: str, small: Path, tmp_path: Path) -> None:
    lines = ["ply", f"format {form} 1.0", "element vertex 2", "property double x", "property double y"]
    header = "\n".join([*lines, "property uchar q", "property double z", "end_header", ""]).encode("ascii")
    rows = np.array([(1, 2, 7, 3), (4, 5, 8, 6)], dtype=[("x", ">f8"), ("y", ">f8"), ("q", "u1"), ("z", ">f8")])
    (tmp_path / "in").mkdir()
    for file in (small / "text").glob("*.txt"):
        (tmp_path / "in" / file.name).write_bytes(file.read_bytes())
    (tmp_path / "in" / "fused.ply").write_bytes(header + (b"1 2 7 3\n4 5 8 6\n" if form == "ascii" else rows.tobytes()))
    write_rescaled(read_scene(tmp_path / "in"), SCALE, tmp_path / "out")
    dense = read_scene(tmp_path / "out").dense
    assert dense is not None
    np.testing.assert_array_equal(dense.points, np.array([[1, 2, 3], [4, 5, 6]]) * SCALE)


def test_nothing_is_left_where_writing_fails(small: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for file in (small / "colmap").glob("*.bin"):
        (tmp_path / "in" / file.name).write_bytes(file.read_bytes())
    scene = read_scene(tmp_path / "in")
    (tmp_path / "in" / "frames.bin").write_bytes(b"\xff" * 8)
    with pytest.raises(InputError, match="rigs and frames: expected files that COLMAP reads"):
        write_rescaled(scene, SCALE, tmp_path / "metric")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_a_place_that_cannot_be_written_is_one_line(small: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(InputError, match="--write-scaled: expected a place that can be written"):
        write_rescaled(read_scene(small / "colmap"), SCALE, tmp_path / "file" / "metric")


def test_an_existing_folder_and_impossible_scales_are_refused(small: Path, tmp_path: Path) -> None:
    scene = read_scene(small / "colmap")
    with pytest.raises(InputError, match="a folder that is not there yet"):
        write_rescaled(scene, SCALE, tmp_path)
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="a positive number"):
            write_rescaled(scene, scale, tmp_path / "metric")


@pytest.mark.parametrize("name", ["a.jpg\n7 1 0 0 0 0 0 0 1 b.jpg", "a\r.jpg", "a\x85.jpg", " a.jpg"])
def test_no_name_of_a_picture_adds_a_line_to_a_model(small: Path, tmp_path: Path, name: str) -> None:
    scene = read_scene(small / "colmap", "none")
    views = (replace(scene.views[0], name=name), *scene.views[1:])
    with pytest.raises(InputError, match="line breaks"):
        write_colmap_model(replace(scene, views=views), 2.0, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_scene_of_another_program_becomes_a_colmap_model(small: Path, tmp_path: Path) -> None:
    write_export(read_scene(small / "colmap", "none"), "meshroom", tmp_path / "meshroom")
    scene = read_scene(tmp_path / "meshroom")
    write_rescaled(scene, SCALE, tmp_path / "metric")
    scaled = read_scene(tmp_path / "metric")
    assert scaled.format == "colmap-text"
    np.testing.assert_allclose(scaled.points, scene.points * SCALE, rtol=1e-12)
    for view, other in zip(scene.views, scaled.views, strict=True):
        np.testing.assert_allclose(other.rotation, view.rotation, atol=1e-12)
        np.testing.assert_allclose(other.centre, view.centre * SCALE, atol=1e-9)
        np.testing.assert_array_equal(other.point_index, view.point_index)
    pycolmap.Reconstruction(str(tmp_path / "metric"))


def test_a_scene_without_files_is_not_rescaled(small: Path, tmp_path: Path) -> None:
    scene = replace(read_scene(small / "colmap"), model_path=None)
    with pytest.raises(InputError, match="model: expected a scene that was read from files"):
        write_rescaled(scene, SCALE, tmp_path / "metric")
    assert not (tmp_path / "metric").exists()


def test_lengths_of_an_opensfm_model_are_rescaled_if_they_are_there(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small / "opensfm", tmp_path / "opensfm")
    file = tmp_path / "opensfm" / "reconstruction.json"
    (document,) = json.loads(file.read_text(encoding="utf-8"))
    next(iter(document["shots"].values()))["vertices"] = [[1, 2, 3]]
    document["rig_instances"] = {"a": {"translation": [1, 2, 4]}, "b": {"rotation": [1, 2, 4]}, "c": 3}
    document["rig_cameras"] = 3
    file.write_text(json.dumps([document]), encoding="utf-8")
    write_rescaled(read_scene(tmp_path / "opensfm"), 2.0, tmp_path / "metric")
    (scaled,) = json.loads((tmp_path / "metric" / "reconstruction.json").read_text(encoding="utf-8"))
    assert next(iter(scaled["shots"].values()))["vertices"] == [[2, 4, 6]]
    assert scaled["rig_instances"] == {"a": {"translation": [2, 4, 8]}, "b": {"rotation": [1, 2, 4]}, "c": 3}
    assert scaled["rig_cameras"] == 3


@pytest.mark.parametrize(("option", "named"), [(None, "sidecar"), ("--write-scaled", "--write-scaled")])
def test_the_error_of_a_sidecar_names_the_option(option: str | None, named: str, small: Path, tmp_path: Path) -> None:
    scene = replace(read_scene(small / "colmap"), dense=DenseCloud(np.zeros((1, 3))))
    result = ScaleResult("resolved", "default", SCALE, None, (), ("test", "0"), ())
    (tmp_path / "scale.json").symlink_to(tmp_path / "scale.json")
    with pytest.raises(InputError, match=f"^{named}: expected a place that can be written, found a loop"):
        write_rescaled_cloud(scene, result, tmp_path / "a.ply", option)
    for bare, unknown in ((replace(scene, dense=None), result), (scene, replace(result, scale=None))):
        with pytest.raises(InputError, match="cloud: expected a splat or a dense cloud to write"):
            write_rescaled_cloud(bare, unknown, tmp_path / "a.ply", option)
    assert not (tmp_path / "a.ply").exists()
