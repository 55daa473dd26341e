"""ADE20K, the full sets of 2016 and 2017: beside each picture `<name>_seg.png` and `<name>_atr.txt`.

A line of `_atr.txt` is `instance # part level # occluded # class names # name as typed # "attributes"`. Blue in
`_seg.png` parts the objects: instance k is the k-th of the blue values that occur, 0 (nothing annotated) not counted.
Red and green hold the class, which the line names; `_parts_N.png` hold parts and are not read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from metric_base.errors import FieldError, at_field, in_file
from metric_base.input_files import MAX_JSON_BYTES, read_bytes
from metric_tree.training.annotations import (
    AnnotatedObject,
    AnnotatedPicture,
    BadAnnotations,
    coded_picture,
    run_lengths,
)

__all__ = ["files", "picture"]

_ENDING = "_atr.txt"
_COLUMNS = 6


def files(folder: Path) -> list[Path]:
    """The annotations that have a picture and its objects' picture beside them."""
    paths = sorted(folder.rglob(f"*{_ENDING}"))
    return [file for file in paths if _beside(file, ".jpg").is_file() and _beside(file, "_seg.png").is_file()]


def picture(file: Path) -> AnnotatedPicture:
    """The picture of an annotation.

    Raises
    ------
    BadAnnotations
        A line is of another form, or `_seg.png` is no picture of three channels.
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
                objects.append(_object(line, blue, values))
    height, width = blue.shape
    return AnnotatedPicture(_beside(file, ".jpg"), width, height, tuple(one for one in objects if one is not None))


def _object(line: str, blue: NDArray[np.int64], values: NDArray[np.int64]) -> AnnotatedObject | None:
    """The object of a line; None for a part, and for one that the picture does not show.

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
