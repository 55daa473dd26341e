"""Read label images as OpenSfM stores them: `instances/<image>.png` and `instances/categories.json`.

`categories.json` maps pixel values to names, `{"1": "chair", "2": "chair", "3": "table"}`. 0 is the background unless
it has a name; other values without a name are background, too. The map also determines the meaning of the values:

- If a name has several values, **values are objects**: each value is one instance of an image.
- If every name has one value, **values are categories**: two chairs of an image have the same value, and each connected
  part is an instance. An object that is divided by an occluder has two instances, which the association merges; a
  mask of two chairs could not be divided.

The meaning is stated in the warnings.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.instances.mask_decoding import checked_image_size
from estimator.instances.view_matching import MAX_MASKS, Instances, ViewLookup, finish_instances, mask_crop
from estimator.records.scene import Instance, Scene
from metric_base.errors import (
    FieldError,
    InputError,
    Unquoted,
    at_field,
    damage_as_field_error,
    expect,
    in_file,
)
from metric_base.input_files import folder_entries, read_bytes, read_json
from metric_base.parsing import json_name, json_object

CATEGORIES = "categories.json"
#: Minimum area of a connected part relative to the largest one of its value; smaller parts are noise.
MIN_PART_FRACTION = 0.02
#: Maximum number of pixels of an image that are compared with the values in it: 350 categories in 12 megapixels.
MAX_COMPARED = 1 << 32
#: Maximum number of digits of a pixel value; Python itself accepts at most 4,300.
MAX_DIGITS = 10


def read_label_images(scene: Scene, folder: Path) -> Instances:
    """Read the instances of all images `<image>.png` of a folder.

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str

    Raises
    ------
    InputError
        `categories.json` or an image is damaged, there is no image, or none is a view.
    """
    names: dict[int, str] = {}
    with in_file(folder / CATEGORIES):
        for key, name in json_object(read_json(folder / CATEGORIES)).items():
            if not (key.isascii() and key.isdecimal() and len(key) <= MAX_DIGITS and int(key) < 1 << 16):
                raise FieldError("value", "a pixel value from 0 to 65535", key)
            names[int(key)] = json_name(name, f"value {key}")
        expect(names, "document", "at least one value", 0)
    are_objects = len(set(names.values())) < len(names)
    files = [file for file in folder_entries(folder) if file.suffix == ".png"]
    if not files:
        raise InputError.at(folder, "images", "at least one <image>.png", 0)
    lookup = ViewLookup(scene)
    instances: list[Instance] = []
    images = []
    for file in files:
        # OpenSfM appends `.png` to the complete name of the image.
        images.append(file.stem if lookup.row(file.stem) is not None else file.name)
        row = lookup.row(images[-1])
        if row is not None:
            with in_file(file):
                instances += _instances(scene, row, file, names, are_objects)
    meaning = "objects (a name has several values)" if are_objects else "categories (each name has one value)"
    return finish_instances(folder, scene, images, instances, [f"{folder}: pixel values are read as {meaning}"])


def _instances(scene: Scene, row: int, file: Path, names: dict[int, str], are_objects: bool) -> list[Instance]:
    """Return the instances of an image."""
    import cv2
    from scipy.ndimage import find_objects

    values = read_png(file)
    if values.ndim != 2:
        raise InputError.at(file, "channels", "1, the value of the instance", values.shape[2])
    values = values.astype(np.uint16)
    camera = scene.views[row].camera
    instances = []
    regions = [  # of each value; of a category all pixels, because its parts are numbered in their order
        (value, box if are_objects else (slice(None), slice(None)))
        for value, box in enumerate(find_objects(values.astype(np.int32) + 1))
        if box is not None and value in names
    ]
    n_compared = sum(values[box].size for _, box in regions)
    expect(n_compared <= MAX_COMPARED, "values", f"at most {MAX_COMPARED:,} pixels to compare", Unquoted("noise"))
    for value, box in regions:
        mask = values[box] == value
        labels, parts, boxes = mask, [1], np.array([(box[1].start, box[0].start, *mask.shape[::-1])])
        if not are_objects:
            # The connected parts of a category are its objects, the largest first, without noise.
            _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
            areas, boxes = stats[1:, cv2.CC_STAT_AREA], stats[1:, :4]
            large = np.flatnonzero(areas >= MIN_PART_FRACTION * areas.max()).tolist()
            expect(
                len(large) <= MAX_MASKS, "parts", f"at most {MAX_MASKS:,} of a category", Unquoted(f"{len(large):,}")
            )
            parts = [part + 1 for part in sorted(large, key=areas.__getitem__, reverse=True)]
        for number, part in enumerate(parts):
            left, top, width, height = boxes[part - 1].tolist()
            whole = labels if are_objects else labels[top : top + height, left : left + width]
            crop = mask_crop(whole == part, camera, (left, top), values.shape[::-1])
            if crop is not None:
                identity = f"{file.stem}:{value}" if are_objects else f"{file.stem}:{value}.{number}"
                instances.append(Instance(identity, row, names[value], *crop))
    return instances


def read_png(file: Path) -> NDArray[Any]:
    """Read a PNG file as values (h, w) or colours (h, w, 3 or 4) in the order RGB; palettes give their indices.

    Raises
    ------
    InputError
        The file is damaged, or the image is too large.
    """
    from PIL.PngImagePlugin import PngImageFile

    # The class is used instead of `Image.open`, whose limit of pixels is lower than ours.
    damage = damage_as_field_error("a PNG that can be decoded", found=lambda error: f"damaged data: {error}")
    with in_file(file), damage, PngImageFile(io.BytesIO(read_bytes(file))) as image:
        with at_field("size"):
            checked_image_size(image.size)
        return np.asarray(image.convert("L") if image.mode == "1" else image)
