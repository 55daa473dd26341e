"""Read labelme files: one JSON document per image, with labelled polygons, rectangles, circles and masks."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any

import numpy as np

from estimator.instances.mask_decoding import box_mask, checked_image_size, decode_segmentation
from estimator.instances.view_matching import Instances, ViewLookup, finish_instances, instance_of_mask
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, at_field, in_file
from metric_base.images import decode_image
from metric_base.input_files import read_json
from metric_base.parsing import json_array, json_name, json_object, json_records, matrix_of

#: Number of corners of the polygon that approximates a circle.
_N_CIRCLE_CORNERS = 64
#: Maximum absolute coordinate of a point, in pixels.
_MAX_COORDINATE = 1e9


def is_labelme(document: object) -> bool:
    """Return True if a JSON document is a labelme file."""
    return isinstance(document, dict) and "shapes" in document and "imagePath" in document


def read_labelme(scene: Scene, files: list[Path], source: Path) -> Instances:
    """Read labelme files.

    Parameters
    ----------
    scene : Scene
    files : list of Path
    source : Path
        File or folder specified by the user, for messages.

    Returns
    -------
    instances : tuple of Instance
        Shapes with the same label and `group_id` in an image are one object. Shapes without an area (points, lines) are
        omitted.
    warnings : tuple of str

    Raises
    ------
    InputError
        A file is damaged, or a shape does not match its type.
    """
    lookup = ViewLookup(scene)
    instances: list[Instance | None] = []
    names: list[str] = []
    for file in files:
        with in_file(file):
            document = json_object(read_json(file))
            if not is_labelme(document):
                continue
            name = document["imagePath"] if isinstance(document["imagePath"], str) else file.stem
            row = lookup.row(name)
            row = lookup.row_of_stem(file.stem) if row is None else row
            names.append(name if row is None else scene.views[row].name)
            if row is not None:
                instances += _instances(scene, row, document)
    return finish_instances(source, scene, names, instances)


def _instances(scene: Scene, row: int, document: dict[str, Any]) -> list[Instance | None]:
    """Return the instances of a labelme document in a view."""
    camera = scene.views[row].camera
    with at_field("imageWidth and imageHeight"):
        size = (document.get("imageWidth"), document.get("imageHeight"))
        size = (camera.width, camera.height) if size == (None, None) else checked_image_size(size)
    masks: dict[tuple[str, str], tuple[BoolArray, bool]] = {}
    for index, (field, shape) in enumerate(json_records(document["shapes"], "shapes")):
        with at_field(field):
            label = json_name(shape.get("label"), "label")
            mask = _mask(shape, size)
            if mask is not None:
                group = shape.get("group_id")
                key = (label, f"shape {index}" if group is None else f"group {group}")
                is_box = shape.get("shape_type") == "rectangle"
                if key in masks:
                    other, other_is_box = masks[key]
                    mask, is_box = other | mask, other_is_box and is_box
                masks[key] = (mask, is_box)
    return [
        instance_of_mask(scene, row, f"{row}:{name}", label, mask, from_box=is_box)
        for (label, name), (mask, is_box) in masks.items()
    ]


def _mask(shape: dict[str, Any], size: tuple[int, int]) -> BoolArray | None:
    """Return the mask (h, w) of a shape, or None if it has no area."""
    kind = shape.get("shape_type", "polygon")
    pairs = json_array(shape.get("points"), "points")
    points = matrix_of(pairs, (len(pairs), 2), "points", _MAX_COORDINATE)
    if kind == "polygon" and len(points) > 2:
        return decode_segmentation([points.ravel().tolist()], size)
    if kind == "rectangle" and len(points) == 2:
        low, high = points.min(axis=0), points.max(axis=0)
        return box_mask([*low.tolist(), *(high - low).tolist()], size)
    if kind == "circle" and len(points) == 2:
        angles = np.linspace(0, 2 * np.pi, _N_CIRCLE_CORNERS, endpoint=False)
        edge = points[0] + np.hypot(*(points[1] - points[0])) * np.column_stack([np.cos(angles), np.sin(angles)])
        return decode_segmentation([edge.ravel().tolist()], size)
    if kind == "mask" and len(points) == 2:
        return _stored_mask(shape.get("mask"), points[0], size)
    if kind in ("point", "points", "line", "linestrip"):
        return None
    raise FieldError("shape_type", "a polygon, rectangle, circle or mask with its points", kind)


def _stored_mask(text: object, corner: np.ndarray[Any, Any], size: tuple[int, int]) -> BoolArray:
    """Return the mask (h, w) of a PNG in base64, whose upper left corner is at `corner` (2,)."""
    import cv2

    try:
        data = base64.b64decode(text, validate=True) if isinstance(text, str) else b""
    except (binascii.Error, ValueError):
        data = b""
    crop = decode_image(data, cv2.IMREAD_GRAYSCALE)
    if crop is None:
        raise FieldError("mask", "a PNG in base64", text)
    mask = np.zeros((size[1], size[0]), dtype=bool)
    left, top = np.clip(np.rint(corner), 0, size).astype(int)
    part = mask[top : top + crop.shape[0], left : left + crop.shape[1]]
    part[:] = crop[: part.shape[0], : part.shape[1]] > 0
    return mask
