"""ADE20K in all its published forms; the files in the folder show which form it is.

| form | beside `<name>.jpg` | reader |
|---|---|---|
| full set 2021_17_01 | `<name>.json` with polygons, `<name>_seg.png` | `polygon_picture` |
| full sets of 2016 and 2017 | `<name>_atr.txt`, `<name>_seg.png` | `attribute_picture` |
| instance challenge of 2017 | `annotations_instance/*/<name>.png` (images: `images/*/`) | `challenge_picture` |

The index of a full set (`index_ade20k.pkl`, `.mat`) repeats the files beside the images and is not read: a pickle
from elsewhere may run code. The scene parsing challenge's `annotations/` hold classes without instances: of two chairs
side by side nobody can tell one from the other, so they are refused with the place where the instances are.

ADE20K, the full sets of 2016 and 2017: beside each image `<name>_seg.png` and `<name>_atr.txt`.

A line of `_atr.txt` is `instance # part level # occluded # class names # name as typed # "attributes"`. Blue in
`_seg.png` parts the objects: instance k is the k-th of the blue values that occur, 0 (nothing annotated) not counted.
Red and green hold the class, which the line names; `_parts_N.png` hold parts and are not read.

ADE20K in the form of the Places Challenge 2017, which most of its users have (ADEChallengeData2016).

`annotations_instance/<split>/<name>.png`: red is one of 100 classes, green the number of the instance, whatever its
class; 0 is neither. The images are `images/<split>/<name>.jpg`, beside `annotations_instance`.

ADE20K, the full set 2021_17_01: beside each image a JSON with polygons and an image of classes, `*_seg.png`.

In `*_seg.png` the class of a pixel is red / 10 * 256 + green, the `name_ndx` of the JSON. Polygons run beneath what
stands in front; the class image shows what is seen. The visible mask of an object is where both agree.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, at_field, in_file
from metric_base.input_files import MAX_JSON_BYTES, read_bytes
from metric_tree.training.annotations import (
    AnnotatedObject,
    AnnotatedPicture,
    BadAnnotations,
    coded_picture,
    run_lengths,
)

_ENDING = "_atr.txt"
_COLUMNS = 6
_FOLDER = "annotations_instance"
#: The challenge's classes 1 to 100, in the order of its `instanceInfo100_train.txt` and `imgCatIds.json`.
CLASSES = (
    "bed", "windowpane", "cabinet", "person", "door", "table", "curtain", "chair", "car", "painting",
    "sofa", "shelf", "mirror", "armchair", "seat", "fence", "desk", "wardrobe", "lamp", "bathtub",
    "railing", "cushion", "box", "column", "signboard", "chest of drawers", "counter", "sink", "fireplace",
    "refrigerator", "stairs", "case", "pool table", "pillow", "screen door", "bookcase", "coffee table", "toilet",
    "flower", "book", "bench", "countertop", "stove", "palm", "kitchen island", "computer", "swivel chair", "boat",
    "arcade machine", "bus", "towel", "light", "truck", "chandelier", "awning", "streetlight", "booth",
    "television receiver", "airplane", "apparel", "pole", "bannister", "ottoman", "bottle", "van", "ship", "fountain",
    "washer", "plaything", "stool", "barrel", "basket", "bag", "minibike", "oven", "ball", "food", "step",
    "trade name", "microwave", "pot", "animal", "bicycle", "dishwasher", "screen", "sculpture", "hood", "sconce",
    "vase", "traffic light", "tray", "ashcan", "fan", "plate", "monitor", "bulletin board", "radiator", "glass",
    "clock", "flag",
)  # fmt: skip
#: How its names are read.
LISTS = ("ade20k_150",)


def attribute_files(folder: Path) -> list[Path]:
    """The annotations that have an image and its objects' image beside them."""
    paths = sorted(folder.rglob(f"*{_ENDING}"))
    return [file for file in paths if _beside(file, ".jpg").is_file() and _beside(file, "_seg.png").is_file()]


def attribute_picture(file: Path) -> AnnotatedPicture:
    """The image of an annotation.

    Raises
    ------
    BadAnnotations
        A line is of another form, or `_seg.png` is no image of three channels.
    """
    blue = coded_picture(_beside(file, "_seg.png"))[:, :, 2]
    values = np.unique(blue[blue > 0])
    lines = (
        read_bytes(file, limit=MAX_JSON_BYTES).decode("latin-1").splitlines()
    )  # names were typed by hand, and some are no UTF-8
    objects = []
    for row, line in enumerate(lines, start=1):
        if line.strip():
            with in_file(file, BadAnnotations), at_field(f"line {row}"):
                objects.append(_attribute_object(line, blue, values))
    height, width = blue.shape
    return AnnotatedPicture(_beside(file, ".jpg"), width, height, tuple(one for one in objects if one is not None))


def _attribute_object(line: str, blue: NDArray[np.int64], values: NDArray[np.int64]) -> AnnotatedObject | None:
    """The object of a line; None for a part, and for one that the image does not show.

    blue : (h, w) codes of the instances; values : (n,) codes above 0, ascending.
    """
    columns = [column.strip() for column in line.split("#")]
    try:
        if len(columns) != _COLUMNS:
            raise ValueError
        instance, part_level = int(columns[0]), int(columns[1])
    except ValueError:
        expected = "instance # part level # occluded # class names # name # attributes"
        raise FieldError("", expected, line) from None
    if part_level or not 1 <= instance <= len(values):
        return None
    names = dict.fromkeys(name.strip() for name in f"{columns[3]},{columns[4]}".split(",") if name.strip())
    return AnnotatedObject(tuple(names), *run_lengths(blue == values[instance - 1])) if names else None


def _beside(file: Path, ending: str) -> Path:
    return file.with_name(file.name.removesuffix(_ENDING) + ending)


def challenge_files(folder: Path) -> list[Path]:
    """The instance images of a folder."""
    return sorted(file for file in folder.rglob("*.png") if file.parent.parent.name == _FOLDER)


def challenge_picture(file: Path) -> AnnotatedPicture:
    """The image of an instance image.

    Raises
    ------
    BadAnnotations
        The image does not have three channels, or a class is not one of the hundred.
    """
    coded = coded_picture(file)
    classes, instances = coded[:, :, 0], coded[:, :, 1]
    objects = []
    for instance in np.unique(instances[instances > 0]):
        mask = instances == instance
        number = int(np.bincount(classes[mask]).argmax())
        if not 1 <= number <= len(CLASSES):
            raise BadAnnotations.at(file, "red", f"a class from 1 to {len(CLASSES)}", number)
        objects.append(AnnotatedObject((CLASSES[number - 1],), *run_lengths(mask)))
    height, width = instances.shape
    seen = file.parent.parent.parent / "images" / file.parent.name / f"{file.stem}.jpg"
    return AnnotatedPicture(seen, width, height, tuple(objects))


def polygon_files(folder: Path) -> list[Path]:
    """The annotations that have an image beside them."""
    return [file for file in sorted(folder.rglob("*.json")) if file.with_suffix(".jpg").is_file()]


def polygon_picture(file: Path) -> AnnotatedPicture:
    """The image of an annotation.

    Raises
    ------
    BadAnnotations
        The JSON is not ADE20K's, or `*_seg.png` is of another size.
    """
    try:
        # the set's own reader takes Latin-1: names were typed by hand, and some are no UTF-8
        annotation = json.loads(read_bytes(file, limit=MAX_JSON_BYTES).decode("latin-1"))["annotation"]
        height, width = int(annotation["imsize"][0]), int(annotation["imsize"][1])
        seen = _classes(file, (height, width))
        whole = [one for one in annotation["object"] if int(one["parts"]["part_level"]) == 0]
        objects = [_polygon_object(one, (height, width), seen) for one in whole]
    except (KeyError, TypeError, ValueError, IndexError, RecursionError) as error:
        if isinstance(error, BadAnnotations):
            raise
        expected = "annotation with imsize and objects of name, name_ndx, parts and polygon"
        raise BadAnnotations.at(file, "annotation", expected, repr(error)) from None
    return AnnotatedPicture(file.with_suffix(".jpg"), width, height, tuple(one for one in objects if one is not None))


def _polygon_object(
    one: dict[str, Any], size: tuple[int, int], seen: NDArray[np.int64] | None
) -> AnnotatedObject | None:
    """The object of an entry, None where nothing of it shows; seen : (h, w) class numbers; size : (height, width)."""
    mask = _draw(one["polygon"], size)
    if seen is not None:
        mask &= seen == int(one["name_ndx"])
    if not mask.any():
        return None
    names = (*(name.strip() for name in one["name"].split(",")), *((one["raw_name"],) if one.get("raw_name") else ()))
    return AnnotatedObject(tuple(dict.fromkeys(names)), *run_lengths(mask))


def _draw(polygon: dict[str, list[float]], size: tuple[int, int]) -> BoolArray:
    """(h, w) mask of a polygon in pixels; size : (height, width)."""
    import cv2

    corners = np.column_stack([np.array(polygon["x"], dtype=float), np.array(polygon["y"], dtype=float)])
    canvas = np.zeros(size, dtype=np.uint8)
    if len(corners):
        cv2.fillPoly(canvas, [np.rint(np.clip(corners, -1e4, 1e5)).astype(np.int32)], (1,))
    return canvas.astype(bool)


def _classes(file: Path, size: tuple[int, int]) -> NDArray[np.int64] | None:
    """(h, w) class numbers of the image of classes, or None if there is no such image."""
    path = file.with_name(f"{file.stem}_seg.png")
    if not path.is_file():
        return None
    coded = coded_picture(path, size)
    return np.asarray(coded[:, :, 0] // 10 * 256 + coded[:, :, 1])


def ade20k_pictures(folder: Path) -> Iterator[AnnotatedPicture]:
    """The images of a folder, in the order of their paths; parts of objects are left out.

    Raises
    ------
    BadAnnotations
        There is no annotated image, or an annotation is not ADE20K's.
    """
    for annotated_files, annotated_picture in (
        (polygon_files, polygon_picture),
        (attribute_files, attribute_picture),
        (challenge_files, challenge_picture),
    ):
        files = annotated_files(folder)
        if files:
            yield from map(annotated_picture, files)
            return
    if any(folder.rglob("annotations/*/*.png")):
        expected = "annotations_instance beside annotations, which hold no instances (annotations_instance.tar)"
        raise BadAnnotations.at(folder, "ADE20K", expected, "annotations alone")
    expected = "pictures with .json or _atr.txt of the same name beside them, or annotations_instance"
    raise BadAnnotations.at(folder, "ADE20K", expected, "none")
