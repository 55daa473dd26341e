"""Instances: masks of any size as crops at the camera's resolution, joined to the views by file name.

Pictures: where a scene's own images are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from estimator.records.scene import Camera, Instance, Scene, View
from metric_base.arrays import BoolArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted
from metric_base.input_files import is_file

#: Folders of pictures, by preference: COLMAP's and OpenSfM's, and that of a work folder of `estimate-scale`.
IMAGES = ("images", "frames")
#: How far above the model the images are looked for: `scene/dense/0/sparse` is the deepest usual place.
_LEVELS_UP = 3
#: A mask whose shape differs by more than this from its camera's was likely made on a rotated or cropped picture.
ASPECT_TOLERANCE = 0.02
#: By more than this it was: no lens correction changes a shape so much. Natural log, a tenth.
OTHER_ASPECT = 0.1


def image_folders(scene: Scene, named: Path | None = None) -> tuple[Path, ...]:
    """The folder that the user named, then `images` and `frames` beside or above the model, nearest first.

    A folder may be a link; all are resolved, so that what lies in them is told from what a name leads out to.

    Raises
    ------
    InputError
        What the user named is no folder.
    """
    if named is not None and not named.is_dir():
        raise InputError.at(named, "--images", "a folder", Unquoted("a file" if named.exists() else "nothing"))
    starts = [path.resolve() for path in (scene.path, scene.model_path) if path is not None]
    places = [
        place / name for start in starts for place in (start, *list(start.parents)[:_LEVELS_UP]) for name in IMAGES
    ]
    first = [] if named is None else [named.resolve()]
    return tuple(dict.fromkeys([*first, *(place.resolve() for place in places if place.is_dir())]))


def image_file(folders: tuple[Path, ...], view: View) -> Path | None:
    """The view's picture in the first folder that has it, or None; a name never leads out of the folder."""
    for folder in folders:
        file = folder / view.name
        if is_file(file) and file.resolve().is_relative_to(folder):
            return file
    return None


class ViewLookup:
    """The rows of a scene's views by file name, then by base name where only one view bears it."""

    def __init__(self, scene: Scene) -> None:
        names = [_fold(view.name) for view in scene.views]
        bases = [PurePosixPath(name).name for name in names]
        once = Counter(bases)
        self._by_name = {name: row for row, name in enumerate(names)}
        self._by_base = {base: row for row, base in enumerate(bases) if once[base] == 1}
        stems = [PurePosixPath(base).stem for base in bases]
        counts = Counter(stems)
        self._by_stem = {stem: row for row, stem in enumerate(stems) if counts[stem] == 1}
        self._names = [view.name for view in scene.views]

    def row(self, file_name: str) -> int | None:
        """The view of an image file, or None."""
        name = _fold(file_name)
        exact = self._by_name.get(name)
        return self._by_base.get(PurePosixPath(name).name) if exact is None else exact

    def row_of_stem(self, stem: str) -> int | None:
        """The view of a file that has the name of its image, with or without the image's own ending, or None."""
        row = self.row(stem)
        return self._by_stem.get(_fold(stem)) if row is None else row

    def name_of_stem(self, stem: str) -> str:
        """The name of that view, or the stem itself."""
        row = self.row_of_stem(stem)
        return stem if row is None else self._names[row]


def finish_instances(
    file: Path, scene: Scene, names: Sequence[str], entries: Iterable[Instance | None], warnings: Iterable[str]
) -> tuple[tuple[Instance, ...], tuple[str, ...]]:
    """The instances that are there, and warnings with one more for images that match no view.

    names : the image files that the masks speak of. InputError where none of them is a view.
    """
    rows = ViewLookup(scene)
    lost = [name for name in names if rows.row(name) is None]
    if names and len(lost) == len(names):
        expected = f"names of the model's views, such as {scene.views[0].name!r}"
        raise InputError.at(
            file, "image names", expected, Unquoted(f"{lost[0]!r} and {len(lost) - 1} others, none of them")
        )
    instances = tuple(instance for instance in entries if instance is not None)
    about_lost = (f"{file}: {len(lost)} of {len(names)} images match no view, such as {lost[0]!r}",) if lost else ()
    return instances, (*warnings, *about_lost)


def mask_crop(mask: BoolArray, camera: Camera) -> tuple[BoolArray, tuple[int, int]] | None:
    """The crop of a (h, w) mask at the camera's resolution and its upper left pixel, or None if it has no pixel.

    Each pixel of the camera takes the mask's value at its own centre; only the crop is ever resampled.

    Raises
    ------
    FieldError
        The mask is of a picture of another shape: a crop, one with bars, one that was turned.
    """
    height, width = mask.shape
    if aspect_difference((width, height), camera) > OTHER_ASPECT:
        shown = Unquoted(f"{width} x {height}: cropped, padded, squeezed or turned")
        raise FieldError("mask size", f"the shape of its picture, {camera.width} x {camera.height} pixels", shown)
    rows, columns = _source_pixels(camera.height, mask.shape[0]), _source_pixels(camera.width, mask.shape[1])
    row_hits = np.flatnonzero(np.asarray(mask.any(axis=1))[rows])
    column_hits = np.flatnonzero(np.asarray(mask.any(axis=0))[columns])
    if not len(row_hits) or not len(column_hits):
        return None
    top, left = int(row_hits[0]), int(column_hits[0])
    crop = mask[np.ix_(rows[top : row_hits[-1] + 1], columns[left : column_hits[-1] + 1])]
    return (crop, (left, top)) if crop.any() else None


def differs_in_aspect(size: tuple[int, int], camera: Camera) -> bool:
    """Whether a picture of `size` (width, height) is of another shape than the camera's."""
    return aspect_difference(size, camera) > ASPECT_TOLERANCE


def aspect_difference(size: tuple[int, int], camera: Camera) -> float:
    """How far the aspect of a picture of `size` (width, height) is from the camera's, natural log."""
    return abs(float(np.log((size[0] / size[1]) / (camera.width / camera.height))))


def _source_pixels(length: int, source_length: int) -> IntArray:
    """(n,) the source's pixel under the centre of each of n = `length` pixels."""
    return ((np.arange(length) + 0.5) * source_length / length).astype(np.int64)


def _fold(name: str) -> str:
    return name.replace("\\", "/").removeprefix("./")
