"""YOLO's text files: one for each image, one line for each object, in shares of the picture's sides.

`class x y w h [score]` is a box by its middle, `class x1 y1 x2 y2 x3 y3 ... [score]` a polygon. Names come from
`data.yaml` (its `names`), or from `classes.txt`, a name a line.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from estimator.instances.mask_decoding import box_mask, decode_segmentation
from estimator.instances.view_matching import ViewLookup, finish_instances, mask_crop
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import folder_entries, read_text

NAME_FILES = ("data.yaml", "data.yml", "dataset.yaml", "classes.txt", "obj.names")
#: Where the text files are, seen from the folder that was named.
LABELS = (".", "labels")
_BOX, _BOX_AND_SCORE = 5, 6


def read_yolo(
    scene: Scene, folder: Path, names_file: Path | None = None
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances of a folder of text files, and warnings.

    names_file : `data.yaml` or `classes.txt`, by default the one in the folder or above it.

    Raises
    ------
    InputError
        There are no names, or a line is no box and no polygon.
    """
    named = names_file or _names_file(folder)
    if named is None:
        raise InputError.at(
            folder, "names", f"{' or '.join(NAME_FILES)} in it or above it, or --categories", Unquoted("none")
        )
    categories = yolo_names(named)
    files = [
        file
        for place in LABELS
        if (folder / place).is_dir()
        for file in folder_entries(folder / place)
        if file.suffix == ".txt" and file.name not in NAME_FILES
    ]
    rows = ViewLookup(scene)
    instances: list[Instance | None] = []
    for file in files:
        row = rows.row_of_stem(file.stem)
        if row is not None:
            with in_file(file):
                for number, line in enumerate(read_text(file).splitlines() if file.stat().st_size else [], start=1):
                    if line.strip():
                        with at_field(f"line {number}"):
                            instances.append(_instance(scene, row, f"{row}:{number}", line, categories))
    return finish_instances(folder, scene, [rows.name_of_stem(file.stem) for file in files], instances, ())


def yolo_names(file: Path) -> dict[int, str]:
    """Names by class number, of `data.yaml` (a list or a mapping under `names`) or of a list, a name a line."""
    text = read_text(file)
    if file.suffix not in {".yaml", ".yml"}:
        return dict(enumerate(line.strip() for line in text.splitlines() if line.strip()))
    match = re.search(r"^names:[ \t]*(.*(?:\n(?:[ \t-].*|[ \t]*))*)", text, re.MULTILINE)
    body = match[1] if match else ""
    inline = re.match(r"\s*[\[{](.*?)[\]}]", body, re.DOTALL)
    parts = re.split(r",|\n", inline[1]) if inline else body.splitlines()
    names: dict[int, str] = {}
    for part in (re.sub(r"\s#.*", "", part).strip() for part in parts):
        key, colon, name = part.partition(":")
        if colon and key.strip().strip("'\"").isdecimal():
            names[int(key.strip().strip("'\"")[:9])] = name.strip().strip("'\"")
        elif part and not part.startswith("#"):
            names[len(names)] = part.removeprefix("-").strip().strip("'\"")
    if not names:
        raise InputError.at(file, "names", "a list or a mapping of class names", Unquoted("none"))
    return names


def _names_file(folder: Path) -> Path | None:
    places = (place / name for place in (folder, folder.parent, folder.parent.parent) for name in NAME_FILES)
    return next((path for path in places if path.is_file()), None)


def _instance(scene: Scene, row: int, identity: str, line: str, categories: dict[int, str]) -> Instance | None:
    try:
        numbers = np.array([float(word) for word in line.split()])
    except ValueError:
        raise FieldError("", "numbers", line) from None
    if not (np.abs(numbers) < 1e9).all() or len(numbers) < _BOX:
        raise FieldError("", "class x y w h, or class and at least three corners", line)
    category = categories.get(int(numbers[0]), "")
    if not category:
        raise FieldError("class", f"0 to {max(categories)}, as the names have it", int(numbers[0]))
    camera = scene.views[row].camera
    size = (camera.width, camera.height)
    is_box = len(numbers) in (_BOX, _BOX_AND_SCORE)
    has_score = len(numbers) % 2 == 0
    score = float(numbers[-1]) if has_score else 1.0
    if not 0 <= score <= 1:
        raise FieldError("score", "a number from 0 to 1", score)
    if is_box:
        x, y, w, h = numbers[1:5] * (*size, *size)
        mask = box_mask([x - w / 2, y - h / 2, w, h], size)
    else:
        corners = numbers[1 : len(numbers) - has_score].reshape(-1, 2) * size
        mask = decode_segmentation([corners.ravel().tolist()], size)
    crop = mask_crop(mask, camera)
    return None if crop is None else Instance(identity, row, category, *crop, score=score, from_box=is_box)
