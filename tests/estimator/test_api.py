"""The public names: scenes and masks in memory give what files give; light commands load nothing heavy."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pycolmap
import pytest

import estimator
from estimator.records.scene import Instance, Scene
from metric_base.errors import InputError
from metric_tree.tree import Tree
from tests.synthetic import small_scene

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ["pycolmap", "cv2", "matplotlib", "sklearn", "scipy", "PIL", "pycocotools"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("scene")
    small_scene.write_small_scene(root)
    return root / "colmap"


@pytest.fixture(scope="module")
def scene(folder: Path) -> Scene:
    return estimator.read_scene(folder, "none")


def _whole(instance: Instance, scene: Scene) -> np.ndarray:
    camera = scene.views[instance.view].camera
    mask = np.zeros((camera.height, camera.width), dtype=bool)
    (x, y), (h, w) = instance.origin, instance.mask.shape
    mask[y : y + h, x : x + w] = instance.mask
    return mask


def test_every_public_name_is_there() -> None:
    assert {name for name in estimator.__all__ if not hasattr(estimator, name)} == set()
    assert set(estimator.__all__) <= set(dir(estimator))
    with pytest.raises(AttributeError, match="no attribute 'unknown'"):
        _ = estimator.unknown  # type: ignore[attr-defined]


def test_a_reconstruction_in_memory_is_the_scene_of_its_files(folder: Path, scene: Scene) -> None:
    memory = estimator.read_scene(pycolmap.Reconstruction(folder))
    assert memory.format == "memory"
    by_name = {view.name: view for view in memory.views}
    assert set(by_name) == {view.name for view in scene.views}
    for view in scene.views:
        twin = by_name[view.name]
        assert np.allclose(twin.rotation, view.rotation, atol=1e-9)
        assert np.allclose(twin.translation, view.translation)
        assert np.allclose(twin.keypoints, view.keypoints)
        assert np.allclose(memory.points[twin.point_index], scene.points[view.point_index])
        assert (twin.camera.model, twin.camera.params.tolist()) == (view.camera.model, view.camera.params.tolist())


def test_an_empty_reconstruction_is_one_line() -> None:
    with pytest.raises(InputError, match="at least one registered image, found 0"):
        estimator.read_scene(pycolmap.Reconstruction())


def test_masks_in_memory_are_the_instances_of_their_file(scene: Scene) -> None:
    from_file = estimator.read_instances(None, scene)
    masks: dict[str, list[tuple[str, np.ndarray, float]]] = {}
    for item in from_file:
        masks.setdefault(scene.views[item.view].name, []).append((item.category, _whole(item, scene), item.score))
    arrays = estimator.read_instances(masks, scene)  # type: ignore[arg-type]
    key = lambda item: (item.view, item.category, item.origin, int(item.mask.sum()))  # noqa: E731
    assert sorted(map(key, arrays)) == sorted(map(key, from_file))


@pytest.mark.parametrize("mask", [np.zeros((3, 4)), np.zeros(3, dtype=bool), np.zeros((0, 0), dtype=bool)])
def test_a_mask_of_another_form_is_one_line(scene: Scene, mask: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"masks of shape \(h, w\), bool"):
        estimator.read_instances({scene.views[0].name: [("chair", mask)]}, scene)


def test_a_scale_without_a_file(folder: Path, mini: Tree) -> None:
    scene = estimator.read_scene(pycolmap.Reconstruction(folder))
    instances = estimator.read_instances(folder / "instances.json", scene)
    result = estimator.estimate_scale(scene, instances, mini, level=0.5)
    assert result.tree == (mini.name, mini.version)
    assert len(result.objects) == len(estimator.measure_objects(scene, instances).objects)
    with pytest.raises(InputError, match="level"):
        estimator.estimate_scale(scene, instances, mini, level=1.0)
    with pytest.raises(InputError, match="method"):
        estimator.estimate_scale(scene, instances, mini, method="best")


def test_sizes_from_a_file_load_nothing_heavy(tmp_path: Path, mini: Tree) -> None:
    path = tmp_path / "objects.json"
    chair = {"category": "bar stool", "dimensions": {"length": 0.9, "width": 0.8, "height": 1.5}}
    path.write_text(json.dumps({"schema": "metric-tree/objects/1", "objects": [chair]}), encoding="utf-8")
    words = ["--objects", str(path), "--tree", str(mini.release.directory)]
    code = (
        f"import sys; from metric_cli.estimate_scale.estimate import main; main({words!r});"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stderr.strip().splitlines()[-1] == "[]"
