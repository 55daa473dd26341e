"""Read mask files of Segment Anything: one file per image, with an optional JSON file of labels.

`<image>.npz` or `<image>.npy` contains `masks` (n, h, w), and optionally `labels` (n,) and `scores` (n,).
`<image>.json` is the list that the automatic mask generator of SAM returns, with run lengths. Labels that the files do
not contain are in `labels.json`: `{"<image>": ["chair", ...]}`, or `{"0": "chair", ...}` for labels that are numbers.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimator.instances.mask_decoding import decode_segmentation
from estimator.instances.view_matching import MAX_MASKS, Instances, instance_of_mask, read_image_files
from estimator.projection.cameras import MAX_PIXELS
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.input_files import read_bytes, read_json
from metric_base.parsing import json_object, json_records

LABELS = "labels.json"
MASK_SUFFIXES = (".npz", ".npy", ".json")
#: Maximum size of the masks of an image in bytes, because all are in memory: 125 masks of 4 megapixels.
MAX_MASK_BYTES = 1 << 29

#: n masks (h, w) of an image, and n labels and scores, which are empty if the file has none.
ImageMasks = tuple[list[BoolArray], list[object], list[float]]


def read_mask_files(scene: Scene, folder: Path, files: list[Path], labels_file: Path | None = None) -> Instances:
    """Read mask files of a folder.

    Parameters
    ----------
    scene : Scene
    folder : Path
    files : list of Path
        Mask files of the folder.
    labels_file : Path, optional
        By default `labels.json` in the folder.

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str
        Masks without a label are omitted with a warning.

    Raises
    ------
    InputError
        A file is damaged, contains Python objects, or the numbers of its labels and masks differ.
    """
    path = labels_file or folder / LABELS
    labels: dict[str, Any] = {}
    if path.is_file():
        with in_file(path):
            labels = json_object(read_json(path))
    n_unnamed = 0

    def read(file: Path, row: int) -> Iterator[Instance | None]:
        nonlocal n_unnamed
        masks, mask_labels, scores = _read(file)
        names = _names(len(masks), mask_labels, labels, scene.views[row].name, file.stem)
        for number, (mask, name) in enumerate(zip(masks, names, strict=True)):
            if name is None:
                n_unnamed += 1
                continue
            score = float(min(max(scores[number], 0.0), 1.0)) if scores else 1.0
            yield instance_of_mask(scene, row, f"{row}:{number}", name, np.asarray(mask > 0), score)

    instances, warnings = read_image_files(folder, scene, files, read)
    unnamed = (f"{folder}: {n_unnamed} masks without a label are omitted",) if n_unnamed else ()
    return instances, (*unnamed, *warnings)


def _names(count: int, mask_labels: list[object], labels: dict[str, Any], image: str, stem: str) -> list[str | None]:
    """Return the name of each of `count` masks of an image, or None.

    mask_labels : labels of the mask file, may be empty; labels : content of `labels.json`
    """
    found: Any = mask_labels or next((labels[key] for key in (image, Path(image).name, stem) if key in labels), None)
    if isinstance(found, dict):
        found = [found.get(str(number)) for number in range(count)]
    if found is None:
        return [None] * count
    if not isinstance(found, list) or len(found) != count:
        raise FieldError("labels", f"{count}, as many as masks", len(found) if isinstance(found, list) else found)
    named = [label if isinstance(label, str) else labels.get(str(label)) for label in found]
    return [label if isinstance(label, str) and label.strip() else None for label in named]


def _read(file: Path) -> ImageMasks:
    """Read a mask file."""
    if file.suffix == ".json":
        # The result of SAM's automatic mask generator.
        sam_masks, sam_labels, sam_scores = [], [], []
        for field, entry in json_records(read_json(file), ""):
            with at_field(field):
                runs = entry.get("segmentation")
                if not isinstance(runs, dict):
                    raise FieldError(
                        "segmentation", "run lengths (output_mode='coco_rle')", Unquoted(type(runs).__name__)
                    )
                sam_masks.append(decode_segmentation(runs, (1, 1)))
                sam_labels.append(
                    next((entry[key] for key in ("label", "category", "class_name") if key in entry), None)
                )
                score = entry.get("score", entry.get("predicted_iou", 1.0))
                sam_scores.append(score if isinstance(score, int | float) else 1.0)
        return sam_masks, sam_labels if any(label is not None for label in sam_labels) else [], sam_scores
    arrays = dict(_arrays(read_bytes(file, limit=MAX_MASK_BYTES), file.suffix))
    masks = arrays.get("masks", next(iter(arrays.values()), np.empty(0)))
    if masks.ndim == 4 and masks.shape[1] == 1:  # (n, 1, h, w), as SAM's predictor returns them
        masks = masks[:, 0]
    if masks.ndim != 3 or masks.dtype.kind not in "buif" or len(masks) > MAX_MASKS or masks[0:1].size > MAX_PIXELS:
        raise FieldError("masks", "(n, h, w) of numbers or truth values", (masks.shape, str(masks.dtype)))
    labels, scores = arrays.get("labels", np.empty(0)), arrays.get("scores", np.empty(0))
    numbers = scores.ravel().tolist() if scores.dtype.kind in "fiu" else []
    expect(not (numbers and len(numbers) != len(masks)), "scores", f"{len(masks)}, as many as masks", len(numbers))
    return list(masks), labels.ravel().tolist(), numbers


def _arrays(data: bytes, suffix: str) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield names and arrays, of any shape, of an .npz or .npy file; the size is checked before unpacking."""
    with damage_as_field_error("NumPy arrays of numbers or text", field="arrays"):
        if suffix == ".npy":
            yield "masks", np.load(io.BytesIO(data), allow_pickle=False)
            return
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        expect(size <= MAX_MASK_BYTES, "size", f"at most {MAX_MASK_BYTES:,} bytes unpacked", size)
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            yield from ((name, arrays[name]) for name in arrays.files)
