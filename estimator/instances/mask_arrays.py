"""Masks in a file for each image, as Segment Anything's users keep them, with a JSON of labels.

`<image>.npz` or `<image>.npy` holds `masks` (n, h, w), and may hold `labels` (n,) and `scores` (n,); `<image>.json` is
the list that SAM's automatic generator returns, with run lengths. Labels that the files lack are in `labels.json`:
`{"<image>": ["chair", ...]}`, or `{"0": "chair", ...}` for labels that are numbers.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.instances.mask_decoding import decode_segmentation
from estimator.instances.view_matching import ViewLookup, finish_instances, mask_crop
from estimator.projection.cameras import MAX_PIXELS
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, Unquoted, at_field, in_file
from metric_base.input_files import read_bytes, read_json
from metric_base.parsing import json_array, json_object

LABELS = "labels.json"
MASK_SUFFIXES = (".npz", ".npy", ".json")
#: Most masks of a picture, and bytes of them all: 125 of a picture of 4 megapixels, for all are in memory at once.
MAX_MASKS, MAX_MASK_BYTES = 10_000, 1 << 29


@dataclass(frozen=True, slots=True)
class _Masks:
    """masks : n of (h, w); labels, scores : as many, or empty where the file has none."""

    masks: list[BoolArray]
    labels: list[object]
    scores: list[float]


def read_mask_files(
    scene: Scene, folder: Path, files: list[Path], labels_file: Path | None = None
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of a folder of mask files, and warnings; masks without a label are left out with a warning.

    Raises
    ------
    InputError
        A file is damaged, holds Python objects, or its labels are not as many as its masks.
    """
    stated = labels_file or folder / LABELS
    labels: dict[str, Any] = {}
    if stated.is_file():
        with in_file(stated):
            labels = json_object(read_json(stated))
    rows = ViewLookup(scene)
    instances: list[Instance | None] = []
    unnamed = 0
    for file in files:
        row = rows.row_of_stem(file.stem)
        if row is None:
            continue
        with in_file(file):
            masks = _read(file)
            names = _names(masks, labels, scene.views[row].name, file.stem)
            for number, (mask, name) in enumerate(zip(masks.masks, names, strict=True)):
                unnamed += name is None
                crop = None if name is None else mask_crop(np.asarray(mask > 0), scene.views[row].camera)
                if name is not None and crop is not None:
                    score = masks.scores[number] if masks.scores else 1.0
                    instances.append(Instance(f"{row}:{number}", row, name, *crop, score=score))
    warnings = [f"{folder}: {unnamed} masks without a label are left out"] if unnamed else []
    return finish_instances(folder, scene, [rows.name_of_stem(file.stem) for file in files], instances, warnings)


def _names(masks: _Masks, labels: dict[str, Any], image: str, stem: str) -> list[str | None]:
    """The label of each mask, or None."""
    stated: Any = masks.labels or next((labels[key] for key in (image, Path(image).name, stem) if key in labels), None)
    if isinstance(stated, dict):
        stated = [stated.get(str(number)) for number in range(len(masks.masks))]
    if stated is None:
        return [None] * len(masks.masks)
    if not isinstance(stated, list) or len(stated) != len(masks.masks):
        count = len(stated) if isinstance(stated, list) else stated
        raise FieldError("labels", f"{len(masks.masks)}, as many as masks", count)
    named = [label if isinstance(label, str) else labels.get(str(label)) for label in stated]
    return [label if isinstance(label, str) and label.strip() else None for label in named]


def _read(file: Path) -> _Masks:
    if file.suffix == ".json":
        return _sam_masks(json_array(read_json(file)))
    arrays = dict(_arrays(read_bytes(file, limit=MAX_MASK_BYTES), file.suffix))
    masks = arrays.get("masks", next(iter(arrays.values()), np.empty(0)))
    if masks.ndim == 4 and masks.shape[1] == 1:  # (n, 1, h, w), as SAM's predictor returns them
        masks = masks[:, 0]
    if masks.ndim != 3 or masks.dtype.kind not in "buif" or len(masks) > MAX_MASKS or masks[0:1].size > MAX_PIXELS:
        raise FieldError("masks", "(n, h, w) of numbers or truth values", (masks.shape, str(masks.dtype)))
    labels, scores = arrays.get("labels", np.empty(0)), arrays.get("scores", np.empty(0))
    numbers = (
        [float(min(max(score, 0.0), 1.0)) for score in scores.ravel().tolist()] if scores.dtype.kind in "fiu" else []
    )
    if numbers and len(numbers) != len(masks):
        raise FieldError("scores", f"{len(masks)}, as many as masks", len(numbers))
    return _Masks(list(masks), labels.ravel().tolist(), numbers)


def _arrays(data: bytes, suffix: str) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Names and arrays of any shape of an .npz or .npy file; nothing is unpacked that says it is too large."""
    try:
        if suffix == ".npy":
            yield "masks", np.load(io.BytesIO(data), allow_pickle=False)
            return
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_MASK_BYTES:
            raise FieldError("size", f"at most {MAX_MASK_BYTES:,} bytes unpacked", size)
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            yield from ((name, arrays[name]) for name in arrays.files)
    except FieldError:
        raise
    except Exception as error:  # noqa: BLE001 - NumPy and zipfile raise a dozen kinds for damaged data
        raise FieldError(
            "arrays", "NumPy arrays of numbers or text", Unquoted(str(error) or type(error).__name__)
        ) from None


def _sam_masks(entries: list[Any]) -> _Masks:
    masks, labels, scores = [], [], []
    for number, value in enumerate(entries):
        with at_field(f"[{number}]"):
            entry = json_object(value, "")
            runs = entry.get("segmentation")
            if not isinstance(runs, dict):
                raise FieldError("segmentation", "run lengths (output_mode='coco_rle')", Unquoted(type(runs).__name__))
            masks.append(decode_segmentation(runs, (1, 1)))
            labels.append(next((entry[key] for key in ("label", "category", "class_name") if key in entry), None))
            score = entry.get("score", entry.get("predicted_iou", 1.0))
            scores.append(float(min(max(score, 0.0), 1.0)) if isinstance(score, int | float) else 1.0)
    return _Masks(masks, labels if any(label is not None for label in labels) else [], scores)
