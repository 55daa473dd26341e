"""ADE20K in all its published forms; the files in the folder show which form it is.

| form | beside `<name>.jpg` | reader |
|---|---|---|
| full set 2021_17_01 | `<name>.json` with polygons, `<name>_seg.png` | `ade20k_full` |
| full sets of 2016 and 2017 | `<name>_atr.txt`, `<name>_seg.png` | `ade20k_attributes` |
| instance challenge of 2017 | `annotations_instance/*/<name>.png` (pictures: `images/*/`) | `ade20k_challenge` |

The index of a full set (`index_ade20k.pkl`, `.mat`) repeats the files beside the pictures and is not read: a pickle
from elsewhere may run code. The scene parsing challenge's `annotations/` hold classes without instances: of two chairs
side by side nobody can tell one from the other, so they are refused with the place where the instances are.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from metric_tree.training import ade20k_attributes, ade20k_challenge, ade20k_full
from metric_tree.training.annotations import AnnotatedPicture, BadAnnotations

__all__ = ["LISTS", "ade20k_pictures"]

#: How its names are read.
LISTS = ("ade20k_150",)


def ade20k_pictures(folder: Path) -> Iterator[AnnotatedPicture]:
    """The pictures of a folder, in the order of their paths; parts of objects are left out.

    Raises
    ------
    BadAnnotations
        There is no annotated picture, or an annotation is not ADE20K's.
    """
    for form in (ade20k_full, ade20k_attributes, ade20k_challenge):
        files = form.files(folder)
        if files:
            yield from (form.picture(file) for file in files)
            return
    if any(folder.rglob("annotations/*/*.png")):
        expected = "annotations_instance beside annotations, which hold no instances (annotations_instance.tar)"
        raise BadAnnotations.at(folder, "ADE20K", expected, "annotations alone")
    expected = "pictures with .json or _atr.txt of the same name beside them, or annotations_instance"
    raise BadAnnotations.at(folder, "ADE20K", expected, "none")
