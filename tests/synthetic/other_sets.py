"""Small data sets in the formats of COCO, ADE20K (three formats) and Open Images (three formats)."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np


def picture_of(file: Path, size: tuple[int, int]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.full((*size, 3), 128, dtype=np.uint8))


def coco(folder: Path) -> list[str]:
    picture_of(folder / "val2017" / "000000000139.jpg", (100, 200))
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


def ade20k(folder: Path) -> list[str]:
    stem = folder / "images" / "ADE" / "training" / "home" / "office" / "ADE_train_00000001"
    picture_of(stem.with_suffix(".jpg"), (100, 200))
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
    seg[10:50, 10:35, 2] = 100  # the right half of the chair is occluded
    cv2.imwrite(str(stem.with_name(f"{stem.name}_seg.png")), seg)
    return ["--ade20k", str(folder)]


def ade20k_of_2017(folder: Path) -> list[str]:
    stem = folder / "images" / "validation" / "o" / "office" / "ADE_val_00000007"
    picture_of(stem.with_suffix(".jpg"), (100, 200))
    lines = [
        '001 # 0 # 0 # wall # wall # ""',
        '002 # 0 # 1 # swivel chair # caf\xe9 chair # "brown, leather"',
        '001 # 1 # 0 # seat # seat # ""',  # a part, with a separate number
        '003 # 0 # 0 # chair # chair # ""',  # hidden: no third value
    ]
    stem.with_name(f"{stem.name}_atr.txt").write_bytes("\n".join(lines).encode("latin-1") + b"\n")
    seg = np.zeros((100, 200, 3), dtype=np.uint8)  # BGR: the second of the blue values that occur is instance 2
    seg[60:, :, 0] = 40
    seg[10:50, 10:60] = (90, 0, 100)
    cv2.imwrite(str(stem.with_name(f"{stem.name}_seg.png")), seg)
    return ["--ade20k", str(folder)]


def ade20k_challenge(folder: Path) -> list[str]:
    root = folder / "ADEChallengeData2016"
    picture_of(root / "images" / "training" / "ADE_train_00000001.jpg", (100, 200))
    coded = np.zeros((100, 200, 3), dtype=np.uint8)  # BGR: red the class, green the instance
    coded[10:50, 10:35] = (0, 7, 47)  # a swivel chair
    coded[10:50, 35:60] = (0, 9, 8)  # a chair that touches it
    coded[60:90, 10:60] = (0, 3, 4)  # a person
    for name, picture in (("annotations_instance", coded), ("annotations", coded[:, :, 2])):
        (root / name / "training").mkdir(parents=True)
        cv2.imwrite(str(root / name / "training" / "ADE_train_00000001.png"), picture)
    return ["--ade20k", str(folder)]


def open_images(folder: Path, masks: str = "train-annotations-object-segmentation.csv") -> list[str]:
    picture_of(folder / "train" / "00a1b2c3d4e5f607.jpg", (100, 200))
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
    mask = np.zeros((50, 100), dtype=np.uint8)  # half the size of the image, as in the original data
    mask[5:25, 5:30] = 255
    for name in ("00a1b2c3d4e5f607_m01mzpv_aa.png", "00a1b2c3d4e5f607_m0k4j_bb.png"):
        (folder / "masks").mkdir(exist_ok=True)
        cv2.imwrite(str(folder / "masks" / name), mask)
    return ["--open-images", str(folder)]


def open_images_v7(folder: Path) -> list[str]:
    words = open_images(folder)
    text = (folder / "class-descriptions-boxable.csv").read_text()
    (folder / "class-descriptions-boxable.csv").unlink()
    (folder / "oidv7-class-descriptions-boxable.csv").write_text(f"LabelName,DisplayName\n{text}")
    return words


def open_images_of_fiftyone(folder: Path) -> list[str]:
    words = open_images(folder, "segmentations.csv")
    (folder / "metadata").mkdir()
    (folder / "class-descriptions-boxable.csv").rename(folder / "metadata" / "classes.csv")
    return words
