"""Read text files of YOLO: one file per image, one line per object, with coordinates relative to the image size.

`class x y w h [score]` is a box with the centre x, y, and `class x1 y1 x2 y2 x3 y3 ... [score]` a polygon. The names of
the classes are in `data.yaml` (its `names`), or in `classes.txt`, one per line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from estimator.instances.mask_decoding import box_mask, decode_segmentation
from estimator.instances.view_matching import Instances, instance_of_mask, read_image_files
from estimator.records.scene import Instance, Scene
from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect
from metric_base.input_files import folder_entries, read_text

NAME_FILES = ("data.yaml", "data.yml", "dataset.yaml", "classes.txt", "obj.names")
#: Folders of the text files, relative to the specified folder.
LABEL_FOLDERS = (".", "labels")
#: Number of values of a box, without and with a score.
_BOX, _BOX_AND_SCORE = 5, 6
#: Maximum absolute value of a coordinate.
_MAX_COORDINATE = 1e9


def read_yolo(scene: Scene, folder: Path, names_file: Path | None = None) -> Instances:
    """Read a folder of text files.

    Parameters
    ----------
    scene : Scene
    folder : Path
    names_file : Path, optional
        `data.yaml` or `classes.txt`; by default the one in the folder or above it.

    Returns
    -------
    instances : tuple of Instance
    warnings : tuple of str

    Raises
    ------
    InputError
        The names are missing, or a line is neither a box nor a polygon.
    """
    folders = (folder, folder.parent, folder.parent.parent)
    candidates = (above / name for above in folders for name in NAME_FILES)
    path = names_file or next((candidate for candidate in candidates if candidate.is_file()), None)
    if path is None:
        expected = f"{' or '.join(NAME_FILES)} in it or above it, or --categories"
        raise InputError.at(folder, "names", expected, Unquoted("none"))
    categories = yolo_names(path)
    files = [
        file
        for subfolder in LABEL_FOLDERS
        if (folder / subfolder).is_dir()
        for file in folder_entries(folder / subfolder)
        if file.suffix == ".txt" and file.name not in NAME_FILES
    ]

    def read(file: Path, row: int) -> Iterator[Instance | None]:
        for number, line in enumerate(read_text(file).splitlines() if file.stat().st_size else [], start=1):
            if line.strip():
                with at_field(f"line {number}"):
                    yield _instance(scene, row, f"{row}:{number}", line, categories)

    return read_image_files(folder, scene, files, read)


def yolo_names(file: Path) -> dict[int, str]:
    """Return the class names by number of `data.yaml` (a list or a mapping under `names`) or of a list with lines."""
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


def _instance(scene: Scene, row: int, identity: str, line: str, categories: dict[int, str]) -> Instance | None:
    """Return the object of a line, or None if its mask is empty."""
    try:
        numbers = np.array([float(word) for word in line.split()])
    except ValueError:
        raise FieldError("", "numbers", line) from None
    if not (np.abs(numbers) < _MAX_COORDINATE).all() or len(numbers) < _BOX:
        raise FieldError("", "class x y w h, or class and at least three corners", line)
    category = categories.get(int(numbers[0]), "")
    expect(category, "class", f"0 to {max(categories)}, according to the names", int(numbers[0]))
    camera = scene.views[row].camera
    size = (camera.width, camera.height)
    is_box = len(numbers) in (_BOX, _BOX_AND_SCORE)
    has_score = len(numbers) % 2 == 0
    score = float(numbers[-1]) if has_score else 1.0
    expect(0 <= score <= 1, "score", "a number from 0 to 1", score)
    if is_box:
        x, y, w, h = numbers[1:5] * (*size, *size)
        mask = box_mask([x - w / 2, y - h / 2, w, h], size)
    else:
        corners = numbers[1 : len(numbers) - has_score].reshape(-1, 2) * size
        mask = decode_segmentation([corners.ravel().tolist()], size)
    return instance_of_mask(scene, row, identity, category, mask, score, from_box=is_box)
