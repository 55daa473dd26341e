"""Instances as OpenSfM keeps them: `instances/<image>.png`, one value a pixel, named by `instances/categories.json`.

`categories.json` maps values to names, `{"1": "chair", "2": "chair", "3": "table"}`; 0 is the background unless it
is named, and values without a name are background. Which of two objects a value means is read off that map:

- a name that stands at several values means that **values are objects**: each value is one instance in a picture;
- where every name stands once, **values are categories**: two chairs of one picture share the value, so each
  connected part is one instance. (An object that another one cuts in two is then two instances, which the
  association joins again; one mask over two chairs could not be undone.)

The reading taken is stated among the warnings.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.instances.mask_decoding import checked_image_size
from estimator.instances.view_matching import ViewLookup, finish_instances, mask_crop
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import folder_entries, read_bytes, read_json
from metric_base.parsing import json_object

CATEGORIES = "categories.json"
#: A connected part smaller than this share of the largest of its value is a speck of the segmenter, not an object.
MIN_PART_SHARE = 0.02
#: Longest number that is looked at; Python itself stops at 4,300 digits.
MAX_DIGITS = 10
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHUNK = struct.Struct(">I4s")


def read_label_images(scene: Scene, folder: Path) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of every `<image>.png` of the folder, and warnings."""
    names = _names(folder / CATEGORIES)
    objects = len(set(names.values())) < len(names)
    files = [file for file in folder_entries(folder) if file.suffix == ".png"]
    if not files:
        raise InputError.at(folder, "pictures", "at least one <image>.png", 0)
    rows = ViewLookup(scene)
    instances: list[Instance | None] = []
    for file in files:
        row = _row(rows, file)
        if row is not None:
            instances += _of_picture(scene, row, file, names, objects)
    meaning = "objects (a name stands at several values)" if objects else "categories (each name stands once)"
    warnings = [f"{folder}: pixel values are read as {meaning}"]
    return finish_instances(folder, scene, [_matching_name(rows, file) for file in files], instances, warnings)


def _names(file: Path) -> dict[int, str]:
    names = {}
    with in_file(file):
        for key, name in json_object(read_json(file)).items():
            if not (key.isascii() and key.isdecimal() and len(key) <= MAX_DIGITS and int(key) < 1 << 16):
                raise FieldError("value", "a pixel value from 0 to 65535", key)
            if not isinstance(name, str) or not name.strip():
                raise FieldError(f"value {key}", "a name", name)
            names[int(key)] = name
        if not names:
            raise FieldError("document", "at least one value", 0)
    return names


def _matching_name(rows: ViewLookup, file: Path) -> str:
    """The image that the picture speaks of: OpenSfM appends `.png` to the image's whole name."""
    return file.stem if rows.row(file.stem) is not None else file.name


def _row(rows: ViewLookup, file: Path) -> int | None:
    return rows.row(_matching_name(rows, file))


def _of_picture(scene: Scene, row: int, file: Path, names: dict[int, str], objects: bool) -> list[Instance | None]:
    values = _pixel_values(file)
    camera = scene.views[row].camera
    instances: list[Instance | None] = []
    for value in np.unique(values).tolist():
        if value not in names:
            continue
        mask = values == value
        for number, part in enumerate([mask] if objects else _parts(mask)):
            crop = mask_crop(part, camera)
            if crop is not None:
                name = f"{file.stem}:{value}" if objects else f"{file.stem}:{value}.{number}"
                instances.append(Instance(name, row, names[value], crop[0], crop[1]))
    return instances


def _parts(mask: BoolArray) -> list[BoolArray]:
    """The connected parts, (h, w) each, of a mask (h, w), specks left out, largest first."""
    import cv2

    n, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    kept = [part for part in range(n - 1) if areas[part] >= MIN_PART_SHARE * areas.max()]
    return [labels == part + 1 for part in sorted(kept, key=lambda part: -areas[part])]


def _pixel_values(file: Path) -> NDArray[np.uint16]:
    """(h, w) values of a PNG of one channel, 8 or 16 bits."""
    picture = read_png(file)
    if picture.ndim != 2:
        raise InputError.at(file, "channels", "1, the value of the instance", picture.shape[2])
    values: NDArray[np.uint16] = picture.astype(np.uint16)
    return values


def read_png(file: Path) -> NDArray[Any]:
    """(h, w) or (h, w, 3 or 4) values of a PNG, colours from blue to red.

    Raises
    ------
    InputError
        It is damaged, or larger than a picture is.
    """
    import cv2

    data = read_bytes(file)
    _check_png(file, data)
    picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise InputError.at(file, "pixels", "a PNG that can be decoded", Unquoted("damaged data"))
    return np.asarray(picture)


def _check_png(file: Path, data: bytes) -> None:
    """Header, size and checksums, so that the decoder neither prints complaints nor allocates what a lie asks for."""
    place, kind = len(_SIGNATURE), b""
    if not data.startswith(_SIGNATURE):
        raise InputError.at(file, "signature", "a PNG", data[:8])
    while kind != b"IEND":
        if place + _CHUNK.size > len(data):
            raise InputError.at(file, "end", "an IEND chunk", Unquoted("the end of the file"))
        size, kind = _CHUNK.unpack_from(data, place)
        end = place + _CHUNK.size + size
        if data[end : end + 4] != zlib.crc32(data[place + 4 : end]).to_bytes(4, "big"):
            raise InputError.at(
                file, f"chunk {kind!r}", "a matching checksum", Unquoted("another, or the end of the file")
            )
        if kind == b"IHDR":
            with in_file(file), at_field("size"):
                checked_image_size(struct.unpack_from(">II", data, place + _CHUNK.size))
        place = end + 4
