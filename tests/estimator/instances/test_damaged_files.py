"""Fields of files of instances that are refused, and the same fields that are read."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.instances.instance_reader import instances_of_masks, read_instance_files
from estimator.instances.view_matching import within_limits
from estimator.instances.yolo import yolo_names
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError
from tests.synthetic.small_scene import write_small_scene


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("damaged")
    write_small_scene(folder / "whole")
    return read_scene(folder / "whole" / "colmap")


def _coco(scene: Scene, file: Path, **changes: Any) -> Path:
    """A file of one annotation of a chair in the first view; `changes` are fields of it or whole parts."""
    annotation = {"id": 1, "image_id": 1, "category_id": 7, "bbox": [10, 10, 50, 40]}
    annotation |= {name: value for name, value in changes.items() if name not in ("images", "categories")}
    document = {
        "images": changes.get("images", [{"id": 1, "file_name": scene.views[0].name}]),
        "annotations": [annotation],
        "categories": changes.get("categories", [{"id": 7, "name": "chair"}]),
    }
    file.write_text(json.dumps(document))
    return file


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, None),
        ({"score": 0}, None),
        ({"score": 1}, None),
        ({"score": None}, None),
        ({"score": -0.01}, "score: expected a number from 0 to 1"),
        ({"score": 1.01}, "score: expected a number from 0 to 1"),
        ({"score": True}, "score: expected a number from 0 to 1"),
        ({"score": "0.5"}, "score: expected a number from 0 to 1"),
        ({"image_id": True}, "image_id: expected a number"),
        ({"image_id": None}, "image_id: expected a number"),
        ({"image_id": 1.0}, "image_id: expected a number"),
        ({"image_id": 2}, "image_id: expected an image of"),
        ({"category_id": 8}, "category_id: expected a category of"),
        ({"category_id": [7]}, "category_id: expected a number"),
        ({"categories": [{"id": "x", "name": "chair"}], "category_id": "x"}, None),
        ({"categories": [{"id": 7, "name": "chair"}] * 2}, "each id once, found 7 twice"),
        ({"bbox": [10, 10, 0, 40]}, "bbox"),
        ({"bbox": [10, 10, 50]}, "bbox"),
        ({"bbox": None}, "bbox"),
    ],
)
def test_an_annotation_of_coco(changes: dict[str, Any], message: str | None, scene: Scene, tmp_path: Path) -> None:
    file = _coco(scene, tmp_path / "instances.json", **changes)
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        (instance,), _ = read_instance_files(scene, file)
        assert instance.category == "chair"
        assert instance.mask.sum() == 2000
        assert instance.score == (changes["score"] if changes.get("score") is not None else 1.0)


@pytest.mark.parametrize("changes", [{"iscrowd": 1}, {"bbox": [5000, 5000, 10, 10]}])
def test_a_crowd_and_a_box_outside_the_image_are_no_objects(
    changes: dict[str, Any], scene: Scene, tmp_path: Path
) -> None:
    assert read_instance_files(scene, _coco(scene, tmp_path / "instances.json", **changes))[0] == ()


@pytest.mark.parametrize(("n_other", "is_read"), [(1, True), (0, False)])
def test_one_image_of_a_file_is_a_view(n_other: int, is_read: bool, scene: Scene, tmp_path: Path) -> None:
    images = [{"id": 1, "file_name": "elsewhere.jpg"}]
    images += [{"id": 2, "file_name": scene.views[0].name}] * n_other
    file = _coco(scene, tmp_path / "instances.json", images=images)
    with nullcontext() if is_read else pytest.raises(InputError, match=r"'elsewhere.jpg' and 0 others, none of them"):
        instances, warnings = read_instance_files(scene, file)
        assert instances == ()
        assert "1 of 2 images match no view, such as 'elsewhere.jpg'" in warnings[-1]


def _panoptic(scene: Scene, folder: Path, colours: Any = None, segment: Any = None, **changes: Any) -> Path:
    camera = scene.views[0].camera
    whole = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    whole[10:50, 10:60, 0] = 5
    (folder / "a").mkdir()
    (folder / "a" / "0.png").write_bytes(cv2.imencode(".png", whole if colours is None else colours)[1].tobytes())
    own = {"id": 5 << 16, "category_id": 7} | (segment or {})
    annotation = {"image_id": 1, "file_name": "0.png", "segments_info": [own]} | changes
    document = {
        "images": [{"id": 1, "file_name": scene.views[0].name}],
        "annotations": [annotation],
        "categories": [{"id": 7, "name": "chair"}, {"id": 8, "name": "wall", "isthing": 0}],
    }
    (folder / "a.json").write_text(json.dumps(document))
    return folder / "a.json"


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({}, 1),
        ({"segment": {"category_id": 8}}, 0),
        ({"segment": {"iscrowd": 1}}, 0),
        ({"segment": {"id": 6 << 16}}, 0),  # a segment without pixels
        ({"segment": {"score": 0.4}}, 1),
        ({"segment": {"category_id": 9}}, "category_id: expected a category of the file"),
        ({"segment": {"category_id": None}}, "category_id: expected a category of the file"),
        ({"image_id": 2, "file_name": ""}, "image_id: expected an image of the file"),
        ({"file_name": 3}, "file_name: expected the name of a PNG"),
        ({"file_name": "../a/0.png"}, "file_name: expected the name of a PNG"),
        ({"file_name": "1.png"}, "no such file"),
        ({"colours": np.zeros((4, 4), dtype=np.uint8)}, "channels: expected 3"),
    ],
)
def test_an_image_of_panoptic_segments(changes: dict[str, Any], found: int | str, scene: Scene, tmp_path: Path) -> None:
    file = _panoptic(scene, tmp_path, **changes)
    with nullcontext() if isinstance(found, int) else pytest.raises(InputError, match=found):
        instances, _ = read_instance_files(scene, file)
        assert len(instances) == found
        assert all(instance.score == changes.get("segment", {}).get("score", 1.0) for instance in instances)


def _values(scene: Scene, folder: Path, values: Any, names: dict[str, str], stem: str | None = None) -> Path:
    (folder / "categories.json").write_text(json.dumps(names))
    name = Path(scene.views[0].name).stem if stem is None else stem
    (folder / f"{name}.png").write_bytes(cv2.imencode(".png", values)[1].tobytes())
    return folder


@pytest.mark.parametrize(
    ("key", "is_valid"),
    [("3", True), ("65535", True), ("65536", False), ("0000000003", True), ("00000000003", False), ("-3", False),
     ("٣", False), ("x", False), ("3.0", False)],
)  # fmt: skip
def test_a_pixel_value_is_0_to_65535(key: str, is_valid: bool, scene: Scene, tmp_path: Path) -> None:
    camera = scene.views[0].camera
    values = np.zeros((camera.height, camera.width), dtype=np.uint8)
    with nullcontext() if is_valid else pytest.raises(InputError, match="a pixel value from 0 to 65535"):
        assert read_instance_files(scene, _values(scene, tmp_path, values, {key: "chair"}))[0] == ()


@pytest.mark.parametrize(("small", "n_parts"), [(36, 2), (25, 1)])
def test_a_part_of_a_category_has_two_percent_of_the_largest(
    small: int, n_parts: int, scene: Scene, tmp_path: Path
) -> None:
    """MIN_PART_FRACTION of 1,600 pixels."""
    camera = scene.views[0].camera
    values = np.zeros((camera.height, camera.width), dtype=np.uint8)
    values[:40, :40] = 3
    side = round(small**0.5)
    values[60 : 60 + side, 60 : 60 + side] = 3
    instances, warnings = read_instance_files(scene, _values(scene, tmp_path, values, {"3": "chair"}))
    assert len(instances) == n_parts
    assert "read as categories" in warnings[0]


def test_values_with_one_name_are_objects(scene: Scene, tmp_path: Path) -> None:
    camera = scene.views[0].camera
    values = np.zeros((camera.height, camera.width), dtype=np.uint8)
    values[:40, :40], values[:40, 60:64] = 3, 4
    instances, warnings = read_instance_files(scene, _values(scene, tmp_path, values, {"3": "chair", "4": "chair"}))
    assert [int(instance.mask.sum()) for instance in instances] == [1600, 160]
    assert "read as objects" in warnings[0]


@pytest.mark.parametrize(
    ("values", "stem", "message"),
    [
        (np.zeros((4, 4, 3), dtype=np.uint8), None, "channels: expected 1"),
        (np.zeros((4, 4), dtype=np.uint8), "elsewhere", "'elsewhere.png' and 0 others, none of them"),
    ],
)
def test_an_image_of_values_is_grey_and_of_a_view(
    values: Any, stem: str | None, message: str, scene: Scene, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        read_instance_files(scene, _values(scene, tmp_path, values, {"3": "chair"}, stem))
    for file in tmp_path.glob("*.png"):
        file.unlink()
    with pytest.raises(InputError, match="at least one <image>"):
        read_instance_files(scene, tmp_path)
    (tmp_path / "categories.json").write_text("{}")
    with pytest.raises(InputError, match="document: expected at least one value"):
        read_instance_files(scene, tmp_path)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"points": [[1, 2], [3]]}, "points: expected 2 x 2 finite numbers below"),
        ({"points": 3}, "points"),
        ({"points": [["a", "b"]] * 3}, "points: expected 3 x 2 finite numbers below"),
        ({"shape_type": "mask", "points": [[10, 10], [20, 20]], "mask": "???"}, "mask: expected a PNG in base64"),
        ({"shape_type": "mask", "points": [[10, 10], [20, 20]], "mask": "AAAA"}, "mask: expected a PNG in base64"),
        ({"shape_type": "mask", "points": [[10, 10], [20, 20]]}, "mask: expected a PNG in base64"),
        ({"label": ""}, "label"),
    ],
)
def test_a_shape_of_labelme(shape: dict[str, Any], message: str, scene: Scene, tmp_path: Path) -> None:
    whole = {"label": "a", "points": [[10, 10], [30, 10], [30, 40]]}
    document = {"shapes": [whole, whole | shape], "imagePath": scene.views[0].name}
    (tmp_path / "a.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        read_instance_files(scene, tmp_path / "a.json")


def test_other_files_of_a_folder_of_labelme_are_ignored(scene: Scene, tmp_path: Path) -> None:
    outside = {"label": "a", "points": [[-30, -10], [-10, -10], [-10, -40]]}
    shape = {"label": "a", "points": [[10, 10], [30, 10], [30, 40]]}
    (tmp_path / "a.json").write_text(json.dumps({"shapes": [shape, outside], "imagePath": scene.views[0].name}))
    (tmp_path / "b.json").write_text("{}")
    assert len(read_instance_files(scene, tmp_path)[0]) == 1


SQUARE = np.pad(np.ones((40, 50), dtype=bool), ((10, 0), (10, 0)))


@pytest.mark.parametrize(
    ("mask", "score", "message"),
    [
        (None, 0.0, None),
        (None, 1.0, None),
        (None, -0.01, "scores from 0 to 1"),
        (None, 1.01, "scores from 0 to 1"),
        (SQUARE.astype(np.uint8), 1.0, r"masks of shape \(h, w\), bool"),
        (SQUARE[None], 1.0, r"masks of shape \(h, w\), bool"),
        (np.zeros((0, 5), dtype=bool), 1.0, r"masks of shape \(h, w\), bool"),
    ],
)
def test_masks_in_memory(mask: Any, score: float, message: str | None, scene: Scene) -> None:
    camera = scene.views[0].camera
    whole = np.zeros((camera.height, camera.width), dtype=bool)
    whole[10:50, 10:60] = True
    entries = [("chair", np.zeros_like(whole)), ("lamp", whole if mask is None else mask, score)]
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        (instance,), warnings = instances_of_masks({scene.views[0].name: entries, "elsewhere": entries}, scene)
        assert (instance.id, instance.category, instance.score) == ("2", "lamp", score)
        assert "1 of 2 images match no view" in warnings[0]


@pytest.mark.parametrize("text", ["nc: 2\n", "names:\n", "names: []\n"])
def test_a_file_of_yolo_names_a_class(text: str, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(text)
    with pytest.raises(InputError, match="names: expected a list or a mapping of class names"):
        yolo_names(tmp_path / "data.yaml")


def test_results_of_sam_are_run_lengths(scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / f"{Path(scene.views[0].name).stem}.json"
    file.write_text(json.dumps([{"segmentation": [[1, 2, 3, 4, 5, 6]], "label": "a"}]))
    with pytest.raises(InputError, match="run lengths"):
        read_instance_files(scene, tmp_path)


@pytest.mark.parametrize(("n_first", "n_second", "is_valid"), [(10_000, 10_000, True), (10_001, 0, False)])
def test_an_image_has_at_most_10000_masks(n_first: int, n_second: int, is_valid: bool) -> None:
    pixel = np.ones((1, 1), dtype=bool)
    masks = [Instance("1", 0, "a", pixel, (0, 0))] * n_first + [Instance("1", 1, "a", pixel, (0, 0))] * n_second
    with nullcontext() if is_valid else pytest.raises(FieldError, match="at most 10,000 of an image"):
        assert len(list(within_limits([None, *masks]))) == n_first + n_second + 1


@pytest.mark.parametrize(("n_bytes", "is_valid"), [(1 << 31, True), ((1 << 31) + 1, False)])
def test_masks_of_a_scene_have_at_most_4_gibibytes(n_bytes: int, is_valid: bool) -> None:
    masks: Any = [SimpleNamespace(view=row, mask=SimpleNamespace(nbytes=n_bytes)) for row in (0, 1)]
    with nullcontext() if is_valid else pytest.raises(FieldError, match="pixels in all"):
        assert len(list(within_limits(masks))) == 2
