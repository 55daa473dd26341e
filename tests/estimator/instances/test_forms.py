"""Masks in every form are the masks that COCO's file gives."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools import mask as coco

from estimator.instances.instance_reader import read_instance_files
from estimator.instances.mask_decoding import box_mask, decode_segmentation
from estimator.instances.yolo import yolo_names
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError
from tests.synthetic.small_scene import write_small_scene

Masks = list[tuple[Instance, np.ndarray[Any, np.dtype[np.bool_]]]]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("forms")
    write_small_scene(folder / "whole")
    return read_scene(folder / "whole" / "colmap")


def _whole(scene: Scene, instance: Instance) -> np.ndarray[Any, np.dtype[np.bool_]]:
    camera = scene.views[instance.view].camera
    mask = np.zeros((camera.height, camera.width), dtype=bool)
    x, y = instance.origin
    mask[y : y + instance.mask.shape[0], x : x + instance.mask.shape[1]] = instance.mask
    return mask


def _truth(scene: Scene) -> Masks:
    instances, _ = read_instance_files(scene, scene.path / "instances.json")
    return [(instance, _whole(scene, instance)) for instance in instances]


def _name(scene: Scene, instance: Instance) -> str:
    return Path(scene.views[instance.view].name).stem


def _write_panoptic(scene: Scene, truth: Masks, folder: Path) -> Path:
    names = sorted({instance.category for instance, _ in truth})
    categories = [{"id": number, "name": name, "isthing": 1} for number, name in enumerate(names, start=7)]
    categories.append({"id": 90, "name": "wall", "isthing": 0})
    images, annotations = [], []
    (folder / "panoptic").mkdir()
    for row, view in enumerate(scene.views):
        colours = np.zeros((view.camera.height, view.camera.width, 3), dtype=np.uint8)
        segments = [{"id": 70_000, "category_id": 90}]
        colours[-5:] = (1, 17, 112)  # 70,000 = 112 + 17 * 256 + 1 * 65,536
        for number, (instance, mask) in enumerate(truth, start=300):
            if instance.view == row:
                colours[mask] = (number // 65536, number // 256 % 256, number % 256)
                segments.append({"id": number, "category_id": 7 + names.index(instance.category)})
        name = f"{Path(view.name).stem}.png"
        (folder / "panoptic" / name).write_bytes(cv2.imencode(".png", colours)[1].tobytes())
        images.append({"id": row, "file_name": view.name})
        annotations.append({"image_id": row, "file_name": name, "segments_info": segments})
    document = {"images": images, "annotations": annotations, "categories": categories}
    (folder / "panoptic.json").write_text(json.dumps(document))
    return folder / "panoptic.json"


def _corners(mask: np.ndarray[Any, np.dtype[np.bool_]]) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _write_yolo(scene: Scene, truth: Masks, folder: Path, boxes: bool) -> Path:
    (folder / "labels").mkdir()
    names = sorted({instance.category for instance, _ in truth})
    (folder / "data.yaml").write_text(
        f"train: images\nnc: {len(names)}\nnames:\n" + "".join(f"  {n}: {name}\n" for n, name in enumerate(names))
    )
    for instance, mask in truth:
        camera = scene.views[instance.view].camera
        x0, y0, x1, y1 = _corners(mask)
        size = np.array([camera.width, camera.height])
        if boxes:
            middle, sides = np.array([x0 + x1, y0 + y1]) / 2 / size, np.array([x1 - x0, y1 - y0]) / size
            numbers = [*middle, *sides, instance.score]
        else:
            numbers = [*(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) / size).ravel(), instance.score]
        with (folder / "labels" / f"{_name(scene, instance)}.txt").open("a") as file:
            file.write(" ".join([str(names.index(instance.category)), *map(repr, map(float, numbers))]) + "\n")
    return folder


def _write_labelme(scene: Scene, truth: Masks, folder: Path, kind: str) -> Path:
    for row, view in enumerate(scene.views):
        shapes = []
        for instance, mask in truth:
            x0, y0, x1, y1 = _corners(mask)
            shape: dict[str, Any] = {"label": instance.category, "shape_type": kind, "group_id": None}
            if kind == "polygon":
                shape["points"] = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
            elif kind == "rectangle":
                shape["points"] = [[x1, y0], [x0, y1]]
            else:
                crop = cv2.imencode(".png", mask[y0:y1, x0:x1].astype(np.uint8) * 255)[1].tobytes()
                shape |= {"points": [[x0, y0], [x1, y1]], "mask": base64.b64encode(crop).decode()}
            if instance.view == row:
                shapes.append(shape)
        shapes.append({"label": "corner", "shape_type": "point", "points": [[3, 3]]})
        document = {"version": "5.4", "shapes": shapes, "imagePath": f"../images/{view.name}", "imageData": None}
        document |= {"imageWidth": view.camera.width, "imageHeight": view.camera.height}
        (folder / f"{Path(view.name).stem}.json").write_text(json.dumps(document))
    return folder


def _write_arrays(scene: Scene, truth: Masks, folder: Path, own_labels: bool) -> Path:
    labels = {}
    for row, view in enumerate(scene.views):
        chosen = [(instance, mask) for instance, mask in truth if instance.view == row]
        names = [instance.category for instance, _ in chosen]
        arrays: dict[str, Any] = {
            "masks": np.array([mask for _, mask in chosen])[:, None],
            "scores": [i.score for i, _ in chosen],
        }
        np.savez_compressed(
            folder / f"{Path(view.name).stem}.npz", **arrays, **({"labels": names} if own_labels else {})
        )
        labels[view.name] = names
    if not own_labels:
        (folder / "labels.json").write_text(json.dumps(labels))
    return folder


def _write_sam(scene: Scene, truth: Masks, folder: Path) -> Path:
    for row, view in enumerate(scene.views):
        entries = []
        for instance, mask in truth:
            if instance.view == row:
                runs = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
                segmentation = {"size": runs["size"], "counts": runs["counts"].decode()}
                entries.append(
                    {"segmentation": segmentation, "predicted_iou": instance.score, "label": instance.category}
                )
        (folder / f"{Path(view.name).stem}.json").write_text(json.dumps(entries))
    return folder


def _write_results(scene: Scene, truth: Masks, folder: Path) -> Path:
    entries = []
    for instance, mask in truth:
        runs = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
        entry = {"file_name": scene.views[instance.view].name, "category": instance.category, "score": instance.score}
        entries.append(entry | {"segmentation": {"size": runs["size"], "counts": runs["counts"].decode()}})
    (folder / "masks.json").write_text(json.dumps(entries))
    return folder / "masks.json"


WRITERS: dict[str, Callable[[Scene, Masks, Path], Path]] = {
    "panoptic": _write_panoptic,
    "yolo polygons": lambda *rest: _write_yolo(*rest, boxes=False),
    "yolo boxes": lambda *rest: _write_yolo(*rest, boxes=True),
    "labelme polygons": lambda *rest: _write_labelme(*rest, kind="polygon"),
    "labelme rectangles": lambda *rest: _write_labelme(*rest, kind="rectangle"),
    "labelme masks": lambda *rest: _write_labelme(*rest, kind="mask"),
    "npz": lambda *rest: _write_arrays(*rest, own_labels=True),
    "npz with labels.json": lambda *rest: _write_arrays(*rest, own_labels=False),
    "sam": _write_sam,
    "results with names": _write_results,
}


@pytest.mark.parametrize("form", WRITERS)
def test_every_form_gives_the_same_masks(form: str, scene: Scene, tmp_path: Path) -> None:
    truth = _truth(scene)
    instances, warnings = read_instance_files(scene, WRITERS[form](scene, truth, tmp_path))
    read = {(item.view, item.category, _whole(scene, item).tobytes()) for item in instances}
    assert read == {(item.view, item.category, mask.tobytes()) for item, mask in truth}
    assert warnings == ()
    assert all(item.from_box == (form in {"yolo boxes", "labelme rectangles"}) for item in instances)
    if form not in {"panoptic", "labelme polygons", "labelme rectangles", "labelme masks"}:
        assert {item.score for item in instances} == {0.9}


def test_coco_ids_without_names_are_cocos_own(scene: Scene, tmp_path: Path) -> None:
    entry = {"file_name": scene.views[0].name, "category_id": 62, "bbox": [10, 10, 50, 50], "score": 0.8}
    (tmp_path / "results.json").write_text(json.dumps([entry]))
    (instance,), warnings = read_instance_files(scene, tmp_path / "results.json")
    assert instance.category == "chair"
    assert "read as those of COCO" in warnings[0]


@pytest.mark.parametrize(
    "text",
    [
        "names: [chair, 'coffee table']\n",
        "nc: 2\nnames:\n- chair\n- coffee table # low\nval: x\n",
        "names: {0: chair, 1: coffee table}\n",
        'path: ..\n\nnames:\n  0: chair\n  1: "coffee table"\n\nkpt_shape: [3]\n',
    ],
)
def test_names_of_a_yaml_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(text)
    assert yolo_names(tmp_path / "data.yaml") == {0: "chair", 1: "coffee table"}


def test_errors_are_one_line(scene: Scene, tmp_path: Path) -> None:
    stem = Path(scene.views[0].name).stem
    (tmp_path / f"{stem}.npz").write_bytes(b"PK\x03\x04 damaged")
    with pytest.raises(InputError, match="NumPy arrays"):
        read_instance_files(scene, tmp_path)
    np.savez(tmp_path / f"{stem}.npz", masks=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="NumPy arrays"):
        read_instance_files(scene, tmp_path)
    (tmp_path / "yolo").mkdir()
    (tmp_path / "yolo" / f"{stem}.txt").write_text("7 .5 .5 .2 .2\n")
    with pytest.raises(InputError, match=r"data\.yaml or"):
        read_instance_files(scene, tmp_path / "yolo")
    (tmp_path / "yolo" / "classes.txt").write_text("chair\n")
    with pytest.raises(InputError, match="line 1 class: expected 0 to 0"):
        read_instance_files(scene, tmp_path / "yolo")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="YOLO text, labelme"):
        read_instance_files(scene, tmp_path / "empty")


def test_pieces_of_one_group_are_one_object(scene: Scene, tmp_path: Path) -> None:
    view = replace(scene.views[0])
    shapes = [
        {
            "label": "sofa",
            "group_id": 1,
            "points": [[x, 10], [x + 20, 10], [x + 20, 40], [x, 40]],
            "shape_type": "polygon",
        }
        for x in (10, 60)
    ]
    document = {
        "shapes": shapes,
        "imagePath": view.name,
        "imageWidth": view.camera.width,
        "imageHeight": view.camera.height,
    }
    (tmp_path / "a.json").write_text(json.dumps(document))
    (instance,), _ = read_instance_files(scene, tmp_path)
    assert instance.mask.sum() == 2 * 20 * 30


@pytest.mark.parametrize(("size", "is_read"), [(1 << 29, True), ((1 << 29) + 1, False)])
def test_masks_have_at_most_512_mebibytes_unpacked(size: int, is_read: bool, scene: Scene, tmp_path: Path) -> None:
    """The size is that of the directory of the archive, which is checked before it is unpacked."""
    file = tmp_path / f"{Path(scene.views[0].name).stem}.npz"
    np.savez_compressed(file, masks=np.ones((1, 4, 4)))
    data = bytearray(file.read_bytes())
    entry = data.index(b"PK\x01\x02")  # of the directory
    data[entry + 24 : entry + 28] = size.to_bytes(4, "little")
    file.write_bytes(data)
    with nullcontext() if is_read else pytest.raises(InputError, match="at most 536,870,912 bytes unpacked"):
        read_instance_files(scene, tmp_path)


@pytest.mark.parametrize(("x", "is_valid"), [(0.99e9, True), (1.01e9, False)])
def test_corners_are_at_most_a_billion_pixels_away(x: float, is_valid: bool, scene: Scene, tmp_path: Path) -> None:
    view = scene.views[0]
    shape = {"label": "a", "shape_type": "polygon", "points": [[0, 0], [x, 0], [x, 20], [0, 20]]}
    document = {"shapes": [shape], "imagePath": view.name, "imageWidth": view.camera.width}
    (tmp_path / "a.json").write_text(json.dumps(document | {"imageHeight": view.camera.height}))
    with nullcontext() if is_valid else pytest.raises(InputError, match="points"):
        assert len(read_instance_files(scene, tmp_path)[0]) == 1


def _labelme(scene: Scene, folder: Path, *shapes: dict[str, Any], **others: Any) -> tuple[tuple[Instance, ...], Any]:
    view = scene.views[0]
    document = {"shapes": [{"label": "a"} | shape for shape in shapes], "imagePath": view.name}
    document |= {"imageWidth": view.camera.width, "imageHeight": view.camera.height} | others
    (folder / f"{Path(view.name).stem}.json").write_text(json.dumps(document))
    return read_instance_files(scene, folder)


CORNERS: list[list[float]] = [[10, 10], [30, 10], [30, 40]]


@pytest.mark.parametrize(
    ("kind", "points", "area"),
    [
        ("polygon", CORNERS, 300),
        ("rectangle", [[30, 40], [10, 10]], 600),
        ("circle", [[30, 30], [30, 40]], np.pi * 100),
        ("polygon", CORNERS[:2], None),
        ("rectangle", CORNERS, None),
        ("circle", CORNERS, None),
        ("mask", CORNERS, None),
        ("star", CORNERS, None),
    ],
)
def test_a_shape_of_labelme_has_its_number_of_points(
    kind: str, points: list[list[float]], area: float | None, scene: Scene, tmp_path: Path
) -> None:
    with nullcontext() if area is not None else pytest.raises(InputError, match="shape_type: expected a polygon"):
        (instance,), _ = _labelme(scene, tmp_path, {"shape_type": kind, "points": points})
        assert instance.mask.sum() == pytest.approx(area, rel=0.1)
        assert instance.from_box == (kind == "rectangle")


@pytest.mark.parametrize("kind", ["point", "points", "line", "linestrip"])
def test_a_shape_without_an_area_is_omitted(kind: str, scene: Scene, tmp_path: Path) -> None:
    polygon = {"shape_type": "polygon", "points": CORNERS}
    assert len(_labelme(scene, tmp_path, polygon, {"shape_type": kind, "points": CORNERS})[0]) == 1


def test_a_box_and_an_outline_of_one_group_are_no_box(scene: Scene, tmp_path: Path) -> None:
    box = {"shape_type": "rectangle", "points": CORNERS[::2], "group_id": 1}
    outline = {"shape_type": "polygon", "points": CORNERS, "group_id": 1}
    for first, second, is_box in ((box, box, True), (box, outline, False), (outline, box, False)):
        (instance,), _ = _labelme(scene, tmp_path, first, second)
        assert instance.from_box == is_box


def test_the_size_of_an_image_is_stated_whole_or_that_of_its_camera(scene: Scene, tmp_path: Path) -> None:
    shape = {"shape_type": "polygon", "points": CORNERS}
    assert len(_labelme(scene, tmp_path, shape, imageWidth=None, imageHeight=None)[0]) == 1
    with pytest.raises(InputError, match="imageWidth and imageHeight"):
        _labelme(scene, tmp_path, shape, imageWidth=None)


def test_an_image_of_another_name_has_the_masks_of_its_file(scene: Scene, tmp_path: Path) -> None:
    shape = {"shape_type": "polygon", "points": CORNERS}
    assert len(_labelme(scene, tmp_path, shape, imagePath="other.png")[0]) == 1
    (tmp_path / "other.json").write_bytes((tmp_path / f"{Path(scene.views[0].name).stem}.json").read_bytes())
    instances, warnings = read_instance_files(scene, tmp_path)
    assert len(instances) == 1
    assert any("match no view" in warning for warning in warnings)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 .5 .5 .2 .2", None),
        ("0 .5 .5 .2 .2 1", None),
        ("0 .5 .5 .2 .2 1.01", "score: expected a number from 0 to 1"),
        ("0 .5 .5 .2 .2 -.01", "score: expected a number from 0 to 1"),
        ("0 .1 .1 .5 .1 .5 .5", None),
        ("0 .1 .1 .5 .1 .5 .5 .9", None),
        ("0 .5 .5 .2", "class x y w h"),
        ("0 .5 .5 .2 1.01e9", "class x y w h"),
        ("1 .5 .5 .2 .2", "class: expected 0 to 0"),
        ("0 .5 .5 .2 x", "expected numbers"),
    ],
)
def test_a_line_of_yolo_is_a_box_or_an_outline_with_or_without_a_score(
    line: str, message: str | None, scene: Scene, tmp_path: Path
) -> None:
    (tmp_path / "classes.txt").write_text("chair\n")
    (tmp_path / f"{Path(scene.views[0].name).stem}.txt").write_text(f"{line}\n\n")
    (tmp_path / "other.txt").write_text("9 of another image\n")
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        (instance,), _ = read_instance_files(scene, tmp_path)
        assert instance.from_box == (len(line.split()) < 7)
        assert instance.score == (0.9 if line.endswith(".9") else 1.0)


@pytest.mark.parametrize(
    ("labels", "categories"),
    [
        (["chair", "table"], ["chair", "table"]),
        ({"0": "chair", "1": "table"}, ["chair", "table"]),
        ({"1": "table"}, ["table"]),
        (["chair", " "], ["chair"]),
        (["chair"], "labels: expected 2, as many as masks, found 1"),
        ("chair", "labels: expected 2, as many as masks"),
        (None, []),
    ],
)
def test_labels_of_masks_are_a_list_or_numbered(
    labels: object, categories: list[str] | str, scene: Scene, tmp_path: Path
) -> None:
    view = scene.views[0]
    shape = (2, view.camera.height, view.camera.width)
    np.save(tmp_path / f"{Path(view.name).stem}.npy", np.ones(shape, dtype=bool))
    np.save(tmp_path / "other.npy", np.ones(shape, dtype=bool))
    (tmp_path / "labels.json").write_text(json.dumps({} if labels is None else {view.name: labels}))
    if isinstance(categories, str):
        with pytest.raises(InputError, match=categories):
            read_instance_files(scene, tmp_path)
    else:
        instances, warnings = read_instance_files(scene, tmp_path)
        assert [instance.category for instance in instances] == categories
        without = f"{2 - len(categories)} masks without a label"
        assert any(without in warning for warning in warnings) == (len(categories) < 2)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"scores": [0.5]}, "scores: expected 2, as many as masks, found 1"),
        ({"masks": np.ones((2, 2, 9, 9))}, r"masks: expected \(n, h, w\)"),
        ({"masks": np.array([[["a"]]])}, r"masks: expected \(n, h, w\)"),
    ],
)
def test_arrays_of_masks_have_their_shapes(arrays: dict[str, Any], message: str, scene: Scene, tmp_path: Path) -> None:
    view = scene.views[0]
    masks = {"masks": np.ones((2, view.camera.height, view.camera.width), dtype=bool), "labels": ["a", "b"]}
    np.savez(tmp_path / f"{Path(view.name).stem}.npz", **(masks | arrays))
    with pytest.raises(InputError, match=message):
        read_instance_files(scene, tmp_path)


@pytest.mark.parametrize(
    ("segment", "annotation", "found"),
    [
        ({}, {}, [1.0]),
        ({"score": 0.5}, {}, [0.5]),
        ({"score": 2}, {}, [1.0]),
        ({"score": "high"}, {}, [1.0]),
        ({"category_id": 9}, {}, []),
        ({"iscrowd": 1}, {}, []),
        ({"id": 2}, {}, []),
        ({"category_id": 8}, {}, "category_id: expected a category of the file"),
        ({"category_id": [7]}, {}, "category_id: expected a category of the file"),
        ({}, {"file_name": "../a.png"}, "file_name: expected the name of a PNG"),
        ({}, {"file_name": 3}, "file_name: expected the name of a PNG"),
        ({}, {"file_name": "b.png"}, r"file_name: expected masks/b\.png in its folder"),
        ({}, {"file_name": "grey.png"}, "channels: expected 3"),
        ({}, {"image_id": 5, "file_name": None}, "image_id: expected an image of the file"),
    ],
)
def test_segments_of_a_panoptic_file(
    segment: dict[str, Any], annotation: dict[str, Any], found: list[float] | str, scene: Scene, tmp_path: Path
) -> None:
    """Segment 1 is a chair; category 9 is no thing, and no pixel has the number 2."""
    view = scene.views[0]
    colours = np.zeros((view.camera.height, view.camera.width, 3), dtype=np.uint8)
    colours[10:40, 10:30, 2] = 1  # red, in OpenCV's order
    cv2.imwrite(str(tmp_path / "a.png"), colours)
    cv2.imwrite(str(tmp_path / "grey.png"), colours[..., 2])
    segments = [{"id": 1, "category_id": 7} | segment]
    document = {
        "images": [{"id": 1, "file_name": view.name}],
        "categories": [{"id": 7, "name": "chair"}, {"id": 9, "name": "wall", "isthing": 0}],
        "annotations": [{"image_id": 1, "file_name": "a.png", "segments_info": segments} | annotation],
    }
    (tmp_path / "masks.json").write_text(json.dumps(document))
    with nullcontext() if isinstance(found, list) else pytest.raises(InputError, match=found):
        instances, _ = read_instance_files(scene, tmp_path / "masks.json")
        assert [instance.score for instance in instances] == found
        assert all(instance.mask.sum() == 600 for instance in instances)


@pytest.mark.parametrize(
    ("size", "counts", "message"),
    [
        ([2, 3], [1, 5], None),
        ([2, 3], "15", None),
        ([0, 3], [1, 5], "size: expected two whole numbers"),
        ([2, 3.0], [1, 5], "size: expected two whole numbers"),
        ([2, True], [1, 5], "size: expected two whole numbers"),
        ([2, 3, 1], [1, 5], "size: expected two whole numbers"),
        ([2, 3], [1, 4], "runs that add up to 2 x 3 pixels"),
        ([2, 3], [-1, 7], "runs that add up"),
        ([2, 3], [1.5, 4.5], "whole numbers or COCO's compressed text"),
        ([2, 3], [3e8, 6], "whole numbers or COCO's compressed text"),
        ([2, 3], [[1, 5]], "whole numbers or COCO's compressed text"),
        ([2, 3], "", "COCO's compressed run lengths"),
        ([2, 3], "1/", "COCO's compressed run lengths"),
        ([2, 3], "1p", "COCO's compressed run lengths"),
        ([2, 3], "1Q", "COCO's compressed run lengths"),
        ([2, 3], "1PPPPP1", "runs that add up"),
        ([2, 3], "1PPPPPP1", "numbers of at most 6 characters"),
    ],
)
def test_run_lengths_fill_an_image(size: object, counts: object, message: str | None) -> None:
    """Characters from `0` to `o` have six bits; from `P` on, the number continues."""
    with nullcontext() if message is None else pytest.raises(FieldError, match=message):
        assert decode_segmentation({"size": size, "counts": counts}, (1, 1)).sum() == 5


@pytest.mark.parametrize(
    "box", [[1, 2, 0, 3], [1, 2, 3, -1], [1, 2, 3], [1, 2, 3, "4"], [1, 2, 3, True], [1, 2, 3, float("nan")], None]
)
def test_a_box_has_four_numbers_and_an_area(box: object) -> None:
    assert box_mask([1, 2, 3, 2], (9, 9)).sum() == 6
    with pytest.raises(FieldError, match="x, y and a positive width and height"):
        box_mask(box, (9, 9))
