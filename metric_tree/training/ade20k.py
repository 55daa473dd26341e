"""ADE20K in its published forms, which are recognised by the files in the folder.

| form | files next to `<name>.jpg` | reader |
|---|---|---|
| full set 2021_17_01 | `<name>.json` with polygons, `<name>_seg.png` | `polygon_image` |
| full sets of 2016 and 2017 | `<name>_atr.txt`, `<name>_seg.png` | `attribute_image` |
| instance challenge of 2017 | `annotations_instance/*/<name>.png` (images: `images/*/`) | `challenge_image` |

The index of a full set (`index_ade20k.pkl`, `.mat`) repeats these files and is not read, because a pickle may run code.
The `annotations/` of the scene parsing challenge contain classes without instances, so that adjacent chairs cannot be
separated: they are rejected with a hint to the instances.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, at_field, damage_as_field_error, in_file
from metric_base.input_files import MAX_JSON_BYTES, read_bytes
from metric_tree.training.annotations import AnnotatedImage, AnnotatedObject, BadAnnotations, coded_image, run_lengths

#: Label lists of the names.
LISTS = ("ade20k_150",)

#: Columns of a line of `_atr.txt`.
_COLUMNS = ("instance", "part level", "occluded", "class names", "name", "attributes")
#: Classes 1 to 100 of the challenge, in the order of `instanceInfo100_train.txt` and `imgCatIds.json`.
CLASSES = tuple(Path(__file__).with_name("ade20k_classes.txt").read_text(encoding="utf-8").splitlines())


def ade20k_images(folder: Path) -> Iterator[AnnotatedImage]:
    """Yield the images of a folder in the order of their paths, without the parts of objects.

    Raises
    ------
    BadAnnotations
        There is no annotated image, or an annotation is invalid.
    """
    polygons = [file for file in sorted(folder.rglob("*.json")) if file.with_suffix(".jpg").is_file()]
    attributes = [file for file in sorted(folder.rglob("*_atr.txt")) if _has_images(file)]
    instances = sorted(file for file in folder.rglob("*.png") if file.parent.parent.name == "annotations_instance")
    if polygons:
        yield from map(polygon_image, polygons)
    elif attributes:
        yield from map(attribute_image, attributes)
    elif instances:
        yield from map(challenge_image, instances)
    elif any(folder.rglob("annotations/*/*.png")):
        expected = "annotations_instance beside annotations, which hold no instances (annotations_instance.tar)"
        raise BadAnnotations.at(folder, "ADE20K", expected, "annotations alone")
    else:
        expected = "pictures with .json or _atr.txt of the same name beside them, or annotations_instance"
        raise BadAnnotations.at(folder, "ADE20K", expected, "none")


def polygon_image(file: Path) -> AnnotatedImage:
    """Read the image of a JSON file of the full set 2021_17_01.

    The class of a pixel of `*_seg.png` is red / 10 * 256 + green, the `name_ndx` of the JSON. Polygons include occluded
    parts, the class map does not. The visible mask of an object is the intersection of the two.

    Raises
    ------
    BadAnnotations
        The JSON is invalid, or `*_seg.png` has another size.
    """
    objects = []
    expected = "annotation with imsize and objects of name, name_ndx, parts and polygon"
    damage = damage_as_field_error(expected, (LookupError, TypeError, ValueError, RecursionError), field="annotation")
    with in_file(file, BadAnnotations), damage:
        # Latin-1 as in the reader of the set: some names, which were typed by hand, are not UTF-8
        annotation = json.loads(read_bytes(file, limit=MAX_JSON_BYTES).decode("latin-1"))["annotation"]
        height, width = int(annotation["imsize"][0]), int(annotation["imsize"][1])
        class_map = None
        if (path := file.with_name(f"{file.stem}_seg.png")).is_file():
            coded = coded_image(path, (height, width))
            class_map = coded[:, :, 0] // 10 * 256 + coded[:, :, 1]
        for entry in annotation["object"]:
            if int(entry["parts"]["part_level"]) != 0:
                continue
            mask = polygon_mask(entry["polygon"], (height, width))
            if class_map is not None:
                mask &= class_map == int(entry["name_ndx"])
            if mask.any():
                names = [*(name.strip() for name in entry["name"].split(",")), entry.get("raw_name")]
                objects.append(AnnotatedObject(tuple(dict.fromkeys(filter(None, names))), *run_lengths(mask)))
    return AnnotatedImage(file.with_suffix(".jpg"), width, height, tuple(objects))


def polygon_mask(polygon: dict[str, list[float]], size: tuple[int, int]) -> BoolArray:
    """Draw a polygon with the corners `x` and `y` in pixels as a mask (h, w) of the given (height, width)."""
    corners = np.column_stack([np.array(polygon["x"], dtype=float), np.array(polygon["y"], dtype=float)])
    canvas = np.zeros(size, dtype=np.uint8)
    if len(corners):
        cv2.fillPoly(canvas, [np.rint(np.clip(corners, -1e4, 1e5)).astype(np.int32)], (1,))
    return canvas.astype(bool)


def attribute_image(file: Path) -> AnnotatedImage:
    """Read the image of `<name>_atr.txt`, of the full sets of 2016 and 2017.

    A line is `instance # part level # occluded # class names # name as typed # "attributes"`. Blue in `_seg.png`
    separates the objects: instance k is the k-th of the occurring blue values above 0. Red and green contain the class,
    which the line names; `_parts_N.png` contain parts and are not read.

    Raises
    ------
    BadAnnotations
        A line is of another form, or `_seg.png` is not an image with three channels.
    """
    blue = coded_image(_beside(file, "_seg.png"))[:, :, 2]
    values = np.unique(blue[blue > 0])
    objects = []
    text = read_bytes(file, limit=MAX_JSON_BYTES).decode("latin-1")  # some names are not UTF-8
    for row, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        columns = [column.strip() for column in line.split("#")]
        with in_file(file, BadAnnotations), at_field(f"line {row}"):
            try:
                if len(columns) != len(_COLUMNS):
                    raise ValueError
                instance, part_level = int(columns[0]), int(columns[1])
            except ValueError:
                raise FieldError("", " # ".join(_COLUMNS), line) from None
        names = dict.fromkeys(name.strip() for name in f"{columns[3]},{columns[4]}".split(",") if name.strip())
        if names and not part_level and 1 <= instance <= len(values):
            objects.append(AnnotatedObject(tuple(names), *run_lengths(blue == values[instance - 1])))
    height, width = blue.shape
    return AnnotatedImage(_beside(file, ".jpg"), width, height, tuple(objects))


def challenge_image(file: Path) -> AnnotatedImage:
    """Read the image of an instance map of the Places Challenge 2017, the most used form (ADEChallengeData2016).

    In `annotations_instance/<split>/<name>.png`, red is one of 100 classes, green the number of the instance among all
    classes, and 0 neither. The image is `images/<split>/<name>.jpg`, next to `annotations_instance`.

    Raises
    ------
    BadAnnotations
        The image does not have three channels, or a class is not one of the hundred.
    """
    coded = coded_image(file)
    classes, instances = coded[:, :, 0], coded[:, :, 1]
    objects = []
    for instance in np.unique(instances[instances > 0]):
        mask = instances == instance
        number = int(np.bincount(classes[mask]).argmax())
        if not 1 <= number <= len(CLASSES):
            raise BadAnnotations.at(file, "red", f"a class from 1 to {len(CLASSES)}", number)
        objects.append(AnnotatedObject((CLASSES[number - 1],), *run_lengths(mask)))
    height, width = instances.shape
    image = file.parent.parent.parent / "images" / file.parent.name / f"{file.stem}.jpg"
    return AnnotatedImage(image, width, height, tuple(objects))


def _has_images(file: Path) -> bool:
    return _beside(file, ".jpg").is_file() and _beside(file, "_seg.png").is_file()


def _beside(file: Path, ending: str) -> Path:
    """Return the file of the same image as `<name>_atr.txt` with another ending."""
    return file.with_name(file.name.removesuffix("_atr.txt") + ending)
