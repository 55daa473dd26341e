"""Images of other sets, in the real forms of COCO, ADE20K and Open Images."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO

from metric_base.errors import InputError
from metric_tree.training.ade20k import CLASSES, attribute_image
from metric_tree.training.annotations import coded_image
from metric_tree.training.classes import Classes, node_of_label
from metric_tree.training.coco import coco_images
from metric_tree.training.open_images import open_images_images
from metric_tree.tree import Tree, open_tree
from tests.metric_tree.training.conftest import export
from tests.synthetic.other_sets import (
    ade20k,
    ade20k_challenge,
    ade20k_of_2017,
    coco,
    open_images,
    open_images_of_fiftyone,
    open_images_v7,
    picture_of,
)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (coco, [("chair", 2000, 0), ("mouse", 20000, 1)]),
        (ade20k, [("chair", 25 * 40, 0)]),
        (ade20k_of_2017, [("chair", 50 * 40, 0)]),
        (open_images, [("chair", 50 * 40, 0)]),
        (open_images_v7, [("chair", 50 * 40, 0)]),
        (open_images_of_fiftyone, [("chair", 50 * 40, 0)]),
    ],
)
def test_other_sets_are_read_in_their_own_form(
    tree: Tree, tmp_path: Path, written: Callable[[Path], list[str]], expected: list[tuple[str, int, int]]
) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    assert export(tree, tmp_path / "set", "--pictures", "0", "--val-share", "0", *written(folder)) == 0
    coco = COCO(str(tmp_path / "set" / "annotations" / "instances_train.json"))
    (image,) = coco.imgs.values()
    assert Path(image["file_name"]).is_file()
    assert (image["width"], image["height"]) == (200, 100)
    found = [(coco.cats[one["category_id"]]["name"], one["area"], one["iscrowd"]) for one in coco.anns.values()]
    assert sorted(found) == sorted(expected)
    for one in coco.anns.values():
        rows, columns = np.nonzero(coco.annToMask(one))
        if not one["iscrowd"]:
            assert (columns.min(), rows.min(), rows.max()) == (10, 10, 49)


def test_the_challenge_parts_objects_that_touch(tree: Tree, tmp_path: Path) -> None:
    assert export(tree, tmp_path / "set", "--pictures", "0", "--val-share", "0", *ade20k_challenge(tmp_path)) == 0
    coco = COCO(str(tmp_path / "set" / "annotations" / "instances_train.json"))
    found = [(coco.cats[one["category_id"]]["name"], one["bbox"], one["area"]) for one in coco.anns.values()]
    assert found == [("chair", [10, 10, 25, 40], 1000), ("chair", [35, 10, 25, 40], 1000)]


def test_every_class_of_the_challenge_is_read() -> None:
    assert len(set(CLASSES)) == 100
    assert (CLASSES[7], CLASSES[46], CLASSES[99]) == ("chair", "swivel chair", "flag")  # as its list numbers them
    shipped = open_tree()
    known = [name for name in CLASSES if node_of_label(shipped, name, ("ade20k_150",)) is not None]
    assert set(CLASSES) - set(known) == {"trade name"}


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a_atr.txt", b"001 # 0 # chair", "line 1"),
        ("annotations_instance/training/a.png", "grey", "three channels"),
        ("annotations_instance/training/a.png", "class 200", "red"),
        ("annotations/training/a.png", "grey", "annotations_instance"),
        ("a.json", b"{}", "annotation"),
        ("nothing.txt", b"", "none"),
    ],
)
def test_damaged_ade20k_is_one_line(
    tree: Tree, tmp_path: Path, name: str, content: bytes | str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "ade"
    picture_of(folder / "a.jpg", (20, 20))
    cv2.imwrite(str(folder / "a_seg.png"), np.zeros((20, 20, 3), np.uint8))
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        (folder / name).write_bytes(content)
    else:
        picture = np.full((20, 20) if content == "grey" else (20, 20, 3), 200, np.uint8)
        cv2.imwrite(str(folder / name), picture)
    assert export(tree, tmp_path / "set", "--pictures", "0", "--ade20k", str(folder)) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_made_pictures_and_other_sets_go_together(tree: Tree, tmp_path: Path) -> None:
    words = []
    for written in (coco, ade20k, ade20k_of_2017, ade20k_challenge, open_images):
        folder = tmp_path / written.__name__
        folder.mkdir()
        words += written(folder)
    assert export(tree, tmp_path / "set", "--pictures", "4", "--val-share", "0", *words) == 0
    assert len(COCO(str(tmp_path / "set" / "annotations" / "instances_train.json")).imgs) == 9


def test_labels_go_to_their_class_through_the_tree(tree: Tree) -> None:
    classes = Classes(tree, [tree.node("chair.n.01"), tree.node("mouse.n.04")])
    assert classes.of_label(("swivel chair",), ()) == 1  # below
    assert classes.of_label(("mouse",), ("coco_80",)) == 2  # the device, not the animal
    assert classes.of_label(("rat",), ()) is None
    assert classes.of_label(("seat",), ()) is None  # above: may be a chair or not
    assert dict(classes.ambiguous) == {"seat": 1}
    assert classes.of_label(("no such thing", "bar stool"), ()) == 1  # a synonym
    with pytest.raises(InputError, match="below"):
        Classes(tree, [tree.node("chair.n.01"), tree.node("swivel_chair.n.01")])


@pytest.mark.parametrize("text", ["[]", "{", '{"images": [], "annotations": [{}], "categories": []}'])
def test_damaged_coco_is_one_line(tree: Tree, tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.json").write_text(text)
    assert export(tree, tmp_path / "set", "--coco", str(tmp_path / "bad.json"), str(tmp_path)) == 2
    assert "bad.json" in capsys.readouterr().err


def test_masks_of_open_images_without_a_name_or_a_file_are_skipped(tmp_path: Path) -> None:
    open_images(tmp_path)
    names = tmp_path / "class-descriptions-boxable.csv"
    names.write_text("".join(line for line in names.read_text().splitlines(keepends=True) if "/m/0k4j" not in line))
    table = tmp_path / "train-annotations-object-segmentation.csv"
    table.write_text(table.read_text() + "gone.png,00a1b2c3d4e5f607,/m/01mzpv,dd,0.05,0.3,0.1,0.5,0.9,\n")
    (image,) = open_images_images(tmp_path)
    assert [one.names for one in image.objects] == [("Chair",)]


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("class-descriptions-boxable.csv", None, "class names: expected"),
        ("class-descriptions-boxable.csv", "a,b", "class names: expected"),  # no id of Open Images
        ("class-descriptions-boxable.csv", "/m/1,a,b", "class names: expected"),
        ("train-annotations-object-segmentation.csv", None, "masks: expected"),
        (
            "train-annotations-object-segmentation.csv",
            "MaskPath,ImageID",
            "header: expected columns MaskPath, ImageID, LabelName; found no LabelName",
        ),
        ("masks/00a1b2c3d4e5f607_m01mzpv_aa.png", "no picture", "image: expected an image that OpenCV reads"),
    ],
)
def test_what_open_images_lacks_is_one_line(tmp_path: Path, file: str, content: str | None, message: str) -> None:
    open_images(tmp_path)
    if content is None:
        (tmp_path / file).unlink()
    else:
        (tmp_path / file).write_text(content)
    with pytest.raises(InputError, match=message):
        list(open_images_images(tmp_path))


def test_an_object_of_open_images_needs_a_name_a_mask_and_a_pixel(tmp_path: Path) -> None:
    open_images(tmp_path)
    (image,) = open_images_images(tmp_path)
    assert len(image.objects) == 2
    masks = sorted((tmp_path / "masks").iterdir())
    cv2.imwrite(str(masks[0]), np.zeros((50, 100), dtype=np.uint8))
    assert len(next(open_images_images(tmp_path)).objects) == 1
    masks[1].unlink()
    assert len(next(open_images_images(tmp_path)).objects) == 0


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (None, "image: expected three channels of 8 bits; found no image"),
        (np.zeros((4, 5), np.uint8), "found shape \\(4, 5\\)"),
        (np.zeros((4, 5, 4), np.uint8), "found shape \\(4, 5, 4\\)"),
        (np.zeros((4, 5, 3), np.uint16), "found shape .* uint16"),
        (np.zeros((5, 4, 3), np.uint8), "size: expected \\(4, 5\\)"),
    ],
)
def test_an_image_of_numbers_has_three_channels_and_the_size(pixels: object, message: str, tmp_path: Path) -> None:
    (path := tmp_path / "a.png").touch()
    if isinstance(pixels, np.ndarray):
        cv2.imwrite(str(path), pixels)
    with pytest.raises(InputError, match=message):
        coded_image(path, (4, 5))
    cv2.imwrite(str(path), np.full((4, 5, 3), (1, 2, 3), np.uint8))
    assert coded_image(path, (4, 5))[0, 0].tolist() == [3, 2, 1]


@pytest.mark.parametrize(
    "image", [{}, {"id": 1, "file_name": "a.jpg"}, {"file_name": "a.jpg", "width": 1, "height": 1}]
)
def test_an_image_of_coco_has_an_id_a_name_and_a_size(tmp_path: Path, image: dict[str, object]) -> None:
    (file := tmp_path / "a.json").write_text(json.dumps({"images": [image], "annotations": [], "categories": []}))
    with pytest.raises(InputError, match=r"images\[0\]: expected id, file_name, width and height"):
        list(coco_images(file, tmp_path))


def test_an_empty_line_and_a_line_of_another_form_of_ade20k(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a_seg.png"), np.full((4, 5, 3), (7, 0, 0), np.uint8))
    picture_of(tmp_path / "a.jpg", (5, 4))
    lines = '1 # 0 # 0 # chair, seat # chair # ""\n\n2 # 0 # 0 # cup # cup # ""\n1 # 1 # 0 # leg # leg # ""\n'
    (file := tmp_path / "a_atr.txt").write_text(lines)
    assert [one.names for one in attribute_image(file).objects] == [("chair", "seat")]
    for line in ("1 # 0 # 0 # chair", "x # 0 # 0 # chair # chair # "):
        file.write_text(line)
        with pytest.raises(InputError, match="line 1: expected instance # part level"):
            attribute_image(file)
