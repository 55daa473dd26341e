"""The training set: exact masks, sizes of the tree, the same bytes again, and the real formats of other sets."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO

from metric_base.faults import InputFault
from metric_tree.commands import main
from metric_tree.training.ade20k_challenge import CLASSES
from metric_tree.training.classes import Classes, _lookup
from metric_tree.training.composition import compose, random_background
from metric_tree.training.pasted import Cutout, cutouts_of
from metric_tree.tree import Tree, open_tree
from tests.made import minitree

#: Node, BGR of its cut-outs, their pixels (height, width).
CUTOUTS = {
    "swivel_chair.n.01": ((40, 40, 220), (210, 120)),
    "mt:bar_stool": ((40, 200, 40), (152, 84)),
    "mouse.n.04": ((220, 60, 40), (62, 112)),
}
EACH = 4


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """The small release with four cut-outs of each of three nodes: coloured blocks in a clear margin."""
    content = minitree.rows()
    directory = tmp_path / "release"
    for node_id in CUTOUTS:
        for number in range(EACH):
            row = dict.fromkeys(("path", "foreground_share", "source_url")) | {
                "image_id": f"{len(content['images.parquet']):064x}", "item_id": f"made:{node_id}-{number}",
                "node_id": node_id, "cutout_path": f"cutouts/{node_id}-{number}.png", "width_px": 1, "height_px": 1,
                "method": "made", "licence": "CC0-1.0",
            }  # fmt: skip
            content["images.parquet"].append(row)
    minitree.release(directory, content)
    (directory / "cutouts").mkdir()
    for node_id, (colour, (height, width)) in CUTOUTS.items():
        picture = np.zeros((height + 20, width + 20, 4), dtype=np.uint8)
        picture[10:-10, 10:-10] = (*colour, 255)
        for number in range(EACH):
            cv2.imwrite(str(directory / "cutouts" / f"{node_id}-{number}.png"), picture)
    return open_tree(directory)


def _export(tree: Tree, out: Path, *words: str) -> int:
    start = ["export", "--tree", str(tree.release.directory), "--out", str(out), "--size", "320x240"]
    return main([*start, "--categories", "chair,computer mouse", *words])


def _documents(out: Path) -> dict[str, Any]:
    return {
        split: json.loads((out / "annotations" / f"instances_{split}.json").read_text()) for split in ("train", "val")
    }


def test_pycocotools_reads_it_and_every_mask_is_exact(tree: Tree, tmp_path: Path) -> None:
    assert _export(tree, tmp_path / "set", "--pictures", "20", "--val-share", "0") == 0
    coco = COCO(str(tmp_path / "set" / "annotations" / "instances_train.json"))
    assert {category["name"] for category in coco.cats.values()} == {"chair", "mouse"}
    assert len(coco.imgs) == 20
    seen = 0
    for image in coco.imgs.values():
        picture = cv2.imread(str(tmp_path / "set" / "images" / image["file_name"])).astype(int)
        assert picture.shape == (240, 320, 3)
        found = coco.loadAnns(coco.getAnnIds(image["id"]))
        masks = np.array([coco.annToMask(one) for one in found])
        assert masks.sum(axis=0).max() == 1  # what is hidden belongs to what hides it
        for one, mask in zip(found, masks, strict=True):
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            box = [columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1]
            assert one["bbox"] == box
            assert one["area"] == mask.sum()
            # the colour inside is that of the cut-out, and of no other
            inside = cv2.erode(mask, np.ones((7, 7), np.uint8)).astype(bool)
            node_id = one["item_id"].removeprefix("made:").rpartition("-")[0]
            if inside.sum() > 50:
                mean = picture[inside].mean(axis=0)
                assert int(mean.argmax()) == int(np.argmax(CUTOUTS[node_id][0]))
                assert picture[inside].std(axis=0).max() < 6
                seen += 1
    assert seen > 30


def test_relative_sizes_are_the_trees(tree: Tree, tmp_path: Path) -> None:
    assert _export(tree, tmp_path / "set", "--pictures", "60", "--val-share", "0") == 0
    document = _documents(tmp_path / "set")["train"]
    scale = {image["id"]: image["px_per_mm"] for image in document["images"]}
    items = {row["item_id"]: row for row in tree.root.items().to_pylist()}
    ratios = []
    for one in document["annotations"]:
        item = items[one["item_id"]]
        own = item["height_mm"] if one["size_of"] == "height" else max(item["length_mm"], item["height_mm"])
        assert one["size_mm"] == pytest.approx(own, abs=0.06)
        assert one["size_of"] == ("longest" if "mouse" in one["item_id"] else "height")
        if one["visible_share"] == 1:
            side = one["bbox"][3] if one["size_of"] == "height" else one["bbox"][2]
            ratios.append(np.log(side / (own * scale[one["image_id"]])))
    assert len(ratios) > 40
    # what is left is the distance: about one, and of the spread that it is given
    assert abs(np.mean(ratios)) < 0.1
    assert np.std(ratios) < 0.25


def test_the_same_seed_gives_the_same_bytes_whatever_the_processes(tree: Tree, tmp_path: Path) -> None:
    for name, words in {"a": (), "b": ("--jobs", "2"), "c": ("--seed", "1")}.items():
        assert _export(tree, tmp_path / name, "--pictures", "6", "--val-share", "0.3", *words) == 0
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) == 8
    assert all((tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes() for file in files)
    assert any((tmp_path / "a" / file).read_bytes() != (tmp_path / "c" / file).read_bytes() for file in files)


def test_categories_that_are_none_are_told(
    tree: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "sel.csv"
    file.write_text("node,name\nmouse.n.04,mouse\nmous.n.09,mous\n")
    words = ["export", "--tree", str(tree.release.directory), "--out", str(tmp_path / "set")]
    assert main([*words, "--categories", str(file)]) == 2
    assert f"{file}:3: mous.n.09: no node has this id" in capsys.readouterr().err
    monkeypatch.setattr("metric_tree.training.selection.choose", lambda _lookup: [])
    assert main(words) == 2
    assert "select's rules chose no category; found none of " in capsys.readouterr().err


def test_items_belong_to_one_split(tree: Tree, tmp_path: Path) -> None:
    assert _export(tree, tmp_path / "set", "--pictures", "30", "--val-share", "0.3") == 0
    items = {split: {one["item_id"] for one in d["annotations"]} for split, d in _documents(tmp_path / "set").items()}
    assert items["train"]
    assert items["val"]
    assert not items["train"] & items["val"]


def test_an_item_without_a_size_draws_from_its_prior(tree: Tree) -> None:
    from metric_tree.training.pasted import _size

    axis, sizes = _size({}, tree.node("swivel_chair.n.01"), seed=0)
    low, high = tree.node("swivel_chair.n.01").prior(("height",)).interval(0.9999)[0]
    assert axis == "height"
    assert len(set(sizes)) > 10
    assert low < min(sizes) <= max(sizes) < high
    assert _size({}, tree.node("mouse.n.04"), seed=0)[0] == "longest"
    assert len(cutouts_of(Classes(tree, [tree.node("chair.n.01")]), 0)) == 2 * EACH


def test_hidden_objects_are_taken_out(tmp_path: Path) -> None:
    block = np.full((100, 100, 4), 255, dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "block.png"), block)
    cutout = Cutout("made:1", "x", 1, tmp_path / "block.png", None, "height", (100.0,))
    for seed in range(20):
        generator = np.random.default_rng(seed)
        found = compose([[cutout]], random_background((120, 160), generator), generator)
        for one in found.objects:
            assert 0.2 <= one.visible_share <= 1
            assert one.mask.sum() >= 100


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--size", "big"), "--size"),
        (("--pictures", "-1"), "--pictures"),
        (("--val-share", "1"), "--val-share"),
        (("--backgrounds", "nowhere"), "nowhere"),
        (("--categories", "chair,swivel chair"), "below"),
        (("--pictures", "0"), "expected cut-outs"),
        (("--coco", "no.json", "."), "no.json"),
    ],
)
def test_faults_are_one_line_and_leave_nothing(
    tree: Tree, tmp_path: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(tmp_path.iterdir())
    assert _export(tree, tmp_path / "set", *(("--pictures", "2") if "--pictures" not in words else ()), *words) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert set(tmp_path.iterdir()) == before


def test_a_damaged_cutout_is_named(tree: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for file in (tree.release.directory / "cutouts").iterdir():
        file.write_bytes(b"no picture")
    assert _export(tree, tmp_path / "set", "--pictures", "2") == 2
    assert "cut-out" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def _picture(file: Path, size: tuple[int, int]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.full((*size, 3), 128, dtype=np.uint8))


def _coco(folder: Path) -> list[str]:
    _picture(folder / "val2017" / "000000000139.jpg", (100, 200))
    box = {"segmentation": [[10, 10, 60, 10, 60, 50, 10, 50]], "area": 2000, "bbox": [10, 10, 50, 40]}
    crowd = {"segmentation": {"size": [100, 200], "counts": [0, 20000]}, "area": 20000, "bbox": [0, 0, 200, 100]}
    document = {
        "images": [{"id": 139, "file_name": "000000000139.jpg", "width": 200, "height": 100},
                   {"id": 140, "file_name": "not_at_hand.jpg", "width": 200, "height": 100}],
        "categories": [{"id": 62, "name": "chair"}, {"id": 74, "name": "mouse"}, {"id": 1, "name": "person"}],
        "annotations": [
            {"id": 1, "image_id": 139, "category_id": 62, "iscrowd": 0, **box},
            {"id": 2, "image_id": 139, "category_id": 74, "iscrowd": 1, **crowd},
            {"id": 3, "image_id": 139, "category_id": 1, "iscrowd": 0, **box},
            {"id": 4, "image_id": 140, "category_id": 62, "iscrowd": 0, **box},
        ],
    }  # fmt: skip
    (folder / "instances_val2017.json").write_text(json.dumps(document))
    return ["--coco", str(folder / "instances_val2017.json"), str(folder / "val2017")]


def _ade20k(folder: Path) -> list[str]:
    stem = folder / "images" / "ADE" / "training" / "home" / "office" / "ADE_train_00000001"
    _picture(stem.with_suffix(".jpg"), (100, 200))
    square = {"x": [10, 59, 59, 10], "y": [10, 10, 49, 49]}
    whole = {"hasparts": [], "ispartof": [], "part_level": 0}
    objects = [
        {"id": 0, "name": "swivel chair", "raw_name": "chair", "name_ndx": 2560, "parts": whole, "polygon": square},
        {"id": 1, "name": "seat", "raw_name": "seat", "name_ndx": 2200, "polygon": square,
         "parts": {"hasparts": [], "ispartof": 0, "part_level": 1}},
        {"id": 2, "name": "wall", "raw_name": "wall", "name_ndx": 2978, "parts": whole, "polygon": square},
    ]  # fmt: skip
    annotation = {"filename": "ADE_train_00000001.jpg", "imsize": [100, 200, 3], "object": objects, "note": "caf\xe9"}
    text = json.dumps({"annotation": annotation}, ensure_ascii=False)
    stem.with_suffix(".json").write_bytes(text.encode("latin-1"))
    seg = np.zeros((100, 200, 3), dtype=np.uint8)  # BGR: class 2560 = 100 / 10 * 256 + 0
    seg[10:50, 10:35, 2] = 100  # the chair's right half is behind something
    cv2.imwrite(str(stem.with_name(f"{stem.name}_seg.png")), seg)
    return ["--ade20k", str(folder)]


def _ade20k_of_2017(folder: Path) -> list[str]:
    stem = folder / "images" / "validation" / "o" / "office" / "ADE_val_00000007"
    _picture(stem.with_suffix(".jpg"), (100, 200))
    lines = [
        '001 # 0 # 0 # wall # wall # ""',
        '002 # 0 # 1 # swivel chair # caf\xe9 chair # "brown, leather"',
        '001 # 1 # 0 # seat # seat # ""',  # a part, numbered for itself
        '003 # 0 # 0 # chair # chair # ""',  # hidden: no third value
    ]
    stem.with_name(f"{stem.name}_atr.txt").write_bytes("\n".join(lines).encode("latin-1") + b"\n")
    seg = np.zeros((100, 200, 3), dtype=np.uint8)  # BGR: the second of the blue values that occur is instance 2
    seg[60:, :, 0] = 40
    seg[10:50, 10:60] = (90, 0, 100)
    cv2.imwrite(str(stem.with_name(f"{stem.name}_seg.png")), seg)
    return ["--ade20k", str(folder)]


def _ade20k_challenge(folder: Path) -> list[str]:
    root = folder / "ADEChallengeData2016"
    _picture(root / "images" / "training" / "ADE_train_00000001.jpg", (100, 200))
    coded = np.zeros((100, 200, 3), dtype=np.uint8)  # BGR: red the class, green the instance
    coded[10:50, 10:35] = (0, 7, 47)  # a swivel chair
    coded[10:50, 35:60] = (0, 9, 8)  # a chair that touches it
    coded[60:90, 10:60] = (0, 3, 4)  # a person
    for name, picture in (("annotations_instance", coded), ("annotations", coded[:, :, 2])):
        (root / name / "training").mkdir(parents=True)
        cv2.imwrite(str(root / name / "training" / "ADE_train_00000001.png"), picture)
    return ["--ade20k", str(folder)]


def _open_images(folder: Path, masks: str = "train-annotations-object-segmentation.csv") -> list[str]:
    _picture(folder / "train" / "00a1b2c3d4e5f607.jpg", (100, 200))
    names = [("/m/01mzpv", "Chair"), ("/m/020lf", "Computer mouse"), ("/m/0k4j", "Car")]
    with (folder / "class-descriptions-boxable.csv").open("w", newline="") as file:
        csv.writer(file).writerows(names)
    header = "MaskPath,ImageID,LabelName,BoxID,BoxXMin,BoxXMax,BoxYMin,BoxYMax,PredictedIoU,Clicks"
    rows = [
        "00a1b2c3d4e5f607_m01mzpv_aa.png,00a1b2c3d4e5f607,/m/01mzpv,aa,0.05,0.3,0.1,0.5,0.9,",
        "00a1b2c3d4e5f607_m0k4j_bb.png,00a1b2c3d4e5f607,/m/0k4j,bb,0.05,0.3,0.1,0.5,0.9,",
        "ffffffffffffffff_m01mzpv_cc.png,ffffffffffffffff,/m/01mzpv,cc,0.05,0.3,0.1,0.5,0.9,",
    ]
    (folder / masks).write_text("\n".join([header, *rows]) + "\n")
    mask = np.zeros((50, 100), dtype=np.uint8)  # half the picture's size, as happens there
    mask[5:25, 5:30] = 255
    for name in ("00a1b2c3d4e5f607_m01mzpv_aa.png", "00a1b2c3d4e5f607_m0k4j_bb.png"):
        (folder / "masks").mkdir(exist_ok=True)
        cv2.imwrite(str(folder / "masks" / name), mask)
    return ["--open-images", str(folder)]


def _open_images_v7(folder: Path) -> list[str]:
    words = _open_images(folder)
    text = (folder / "class-descriptions-boxable.csv").read_text()
    (folder / "class-descriptions-boxable.csv").unlink()
    (folder / "oidv7-class-descriptions-boxable.csv").write_text(f"LabelName,DisplayName\n{text}")
    return words


def _open_images_of_fiftyone(folder: Path) -> list[str]:
    words = _open_images(folder, "segmentations.csv")
    (folder / "metadata").mkdir()
    (folder / "class-descriptions-boxable.csv").rename(folder / "metadata" / "classes.csv")
    return words


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (_coco, [("chair", 2000, 0), ("mouse", 20000, 1)]),
        (_ade20k, [("chair", 25 * 40, 0)]),
        (_ade20k_of_2017, [("chair", 50 * 40, 0)]),
        (_open_images, [("chair", 50 * 40, 0)]),
        (_open_images_v7, [("chair", 50 * 40, 0)]),
        (_open_images_of_fiftyone, [("chair", 50 * 40, 0)]),
    ],
)
def test_other_sets_are_read_in_their_own_form(
    tree: Tree, tmp_path: Path, written: Callable[[Path], list[str]], expected: list[tuple[str, int, int]]
) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    assert _export(tree, tmp_path / "set", "--pictures", "0", "--val-share", "0", *written(folder)) == 0
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


def test_the_challenge_parts_things_that_touch(tree: Tree, tmp_path: Path) -> None:
    assert _export(tree, tmp_path / "set", "--pictures", "0", "--val-share", "0", *_ade20k_challenge(tmp_path)) == 0
    coco = COCO(str(tmp_path / "set" / "annotations" / "instances_train.json"))
    found = [(coco.cats[one["category_id"]]["name"], one["bbox"], one["area"]) for one in coco.anns.values()]
    assert found == [("chair", [10, 10, 25, 40], 1000), ("chair", [35, 10, 25, 40], 1000)]


def test_every_class_of_the_challenge_is_read() -> None:
    assert len(set(CLASSES)) == 100
    assert (CLASSES[7], CLASSES[46], CLASSES[99]) == ("chair", "swivel chair", "flag")  # as its list numbers them
    shipped = open_tree()
    known = [name for name in CLASSES if _lookup(shipped, name, ("ade20k_150", None)) is not None]
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
    _picture(folder / "a.jpg", (20, 20))
    cv2.imwrite(str(folder / "a_seg.png"), np.zeros((20, 20, 3), np.uint8))
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        (folder / name).write_bytes(content)
    else:
        picture = np.full((20, 20) if content == "grey" else (20, 20, 3), 200, np.uint8)
        cv2.imwrite(str(folder / name), picture)
    assert _export(tree, tmp_path / "set", "--pictures", "0", "--ade20k", str(folder)) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_made_pictures_and_other_sets_go_together(tree: Tree, tmp_path: Path) -> None:
    words = []
    for written in (_coco, _ade20k, _ade20k_of_2017, _ade20k_challenge, _open_images):
        folder = tmp_path / written.__name__
        folder.mkdir()
        words += written(folder)
    assert _export(tree, tmp_path / "set", "--pictures", "4", "--val-share", "0", *words) == 0
    assert len(COCO(str(tmp_path / "set" / "annotations" / "instances_train.json")).imgs) == 9


def test_labels_go_to_their_class_through_the_tree(tree: Tree) -> None:
    classes = Classes(tree, [tree.node("chair.n.01"), tree.node("mouse.n.04")])
    assert classes.of_label(("swivel chair",), ()) == 1  # below
    assert classes.of_label(("mouse",), ("coco_80",)) == 2  # the device, not the animal
    assert classes.of_label(("rat",), ()) is None
    assert classes.of_label(("seat",), ()) is None  # above: may be a chair or not
    assert dict(classes.ambiguous) == {"seat": 1}
    assert classes.of_label(("no such thing", "bar stool"), ()) == 1  # a synonym
    with pytest.raises(InputFault, match="below"):
        Classes(tree, [tree.node("chair.n.01"), tree.node("swivel_chair.n.01")])


@pytest.mark.parametrize("text", ["[]", "{", '{"images": [], "annotations": [{}], "categories": []}'])
def test_damaged_coco_is_one_line(tree: Tree, tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.json").write_text(text)
    assert _export(tree, tmp_path / "set", "--coco", str(tmp_path / "bad.json"), str(tmp_path)) == 2
    assert "bad.json" in capsys.readouterr().err
