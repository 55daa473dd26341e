"""Match masks and image files to the views of a scene, by file name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from estimator.records.scene import Camera, Instance, Scene
from metric_base.arrays import BoolArray
from metric_base.errors import FieldError, InputError, Unquoted, expect, in_file

#: Instances and warnings.
Instances = tuple[tuple[Instance, ...], tuple[str, ...]]
#: Maximum number of masks of an image.
MAX_MASKS = 10_000
#: Maximum size of the crops of all masks of a scene in bytes, which are in memory: 8,000 masks of half a megapixel.
MAX_SCENE_BYTES = 1 << 32
#: Maximum log difference of the aspect ratios of a mask and its camera without a warning. A larger one suggests a
#: rotated or cropped image.
MAX_ASPECT_DIFFERENCE = 0.02
#: Maximum log difference that is accepted; undistortion does not change the aspect ratio by so much.
MAX_ACCEPTED_ASPECT_DIFFERENCE = 0.1


class ViewLookup:
    """Find the rows of the views of a scene by file name, or by base name if it is unique.

    A view whose name has no suffix (`cameras.json` of 3DGS) has the base name of its image without the suffix.
    """

    def __init__(self, scene: Scene) -> None:
        names = [_normalised(view.name) for view in scene.views]
        bases = [PurePosixPath(name).name for name in names]
        stems = [PurePosixPath(base).stem for base in bases]
        n_bases, n_stems = Counter(bases), Counter(stems)
        self._by_name = {name: row for row, name in enumerate(names)}
        self._by_base = {base: row for row, base in enumerate(bases) if n_bases[base] == 1}
        self._by_stem = {stem: row for row, stem in enumerate(stems) if n_stems[stem] == 1}

    def row(self, file_name: str) -> int | None:
        """Return the view of an image file, or None."""
        name = _normalised(file_name)
        path = PurePosixPath(name)
        candidates = (self._by_name.get(name), self._by_base.get(path.name), self._by_base.get(path.stem))
        return next((row for row in candidates if row is not None), None)

    def row_of_stem(self, stem: str) -> int | None:
        """Return the view of a file whose stem is the name of an image, with or without its suffix, or None."""
        row = self.row(stem)
        return self._by_stem.get(_normalised(stem)) if row is None else row


def read_image_files(
    source: Path, scene: Scene, files: Iterable[Path], read: Callable[[Path, int], Iterable[Instance | None]]
) -> Instances:
    """Read files that have the names of their images, and finish the instances (`finish_instances`).

    Parameters
    ----------
    source : Path
        Folder of the masks, for messages.
    scene : Scene
    files : iterable of Path
    read : callable
        Function of a file and the index of its view. It returns the instances of the file.
    """
    lookup = ViewLookup(scene)
    names: list[str] = []
    instances: list[Instance | None] = []
    for file in files:
        row = lookup.row_of_stem(file.stem)
        names.append(file.stem if row is None else scene.views[row].name)
        if row is not None:
            with in_file(file):
                instances += read(file, row)
    return finish_instances(source, scene, names, instances)


def finish_instances(
    file: Path, scene: Scene, names: Sequence[str], entries: Iterable[Instance | None], warnings: Iterable[str] = ()
) -> Instances:
    """Drop missing instances, and warn about images that match no view.

    Parameters
    ----------
    file : Path
        Source of the masks, for messages.
    scene : Scene
    names : sequence of str
        Image files to which the masks belong.
    entries : iterable of Instance or None
    warnings : iterable of str

    Raises
    ------
    InputError
        None of the images is a view, or the masks are beyond the limits.
    """
    lookup = ViewLookup(scene)
    unmatched = [name for name in names if lookup.row(name) is None]
    if names and len(unmatched) == len(names):
        expected = f"names of the model's views, such as {scene.views[0].name!r}"
        found = Unquoted(f"{unmatched[0]!r} and {len(unmatched) - 1} others, none of them")
        raise InputError.at(file, "image names", expected, found)
    with in_file(file):
        instances = tuple(instance for instance in within_limits(entries) if instance is not None)
    if not unmatched:
        return instances, tuple(warnings)
    warning = f"{file}: {len(unmatched)} of {len(names)} images match no view, such as {unmatched[0]!r}"
    return instances, (*warnings, warning)


def within_limits(entries: Iterable[Instance | None]) -> Iterator[Instance | None]:
    """Yield the entries; FieldError if an image has more than `MAX_MASKS`, or all have more than `MAX_SCENE_BYTES`."""
    by_view, n_bytes = Counter[int](), 0
    for instance in entries:
        if instance is not None:
            by_view[instance.view] += 1
            n_bytes += instance.mask.nbytes
            expect(by_view[instance.view] <= MAX_MASKS, "masks", f"at most {MAX_MASKS:,} of an image", Unquoted("more"))
            expect(n_bytes <= MAX_SCENE_BYTES, "masks", f"at most {MAX_SCENE_BYTES:,} pixels in all", Unquoted("more"))
        yield instance


def instance_of_mask(
    scene: Scene,
    row: int,
    identity: str,
    category: str,
    mask: BoolArray,
    score: float = 1.0,
    *,
    from_box: bool = False,
    track: str | None = None,
) -> Instance | None:
    """Return the instance of a mask (h, w) in the view with the index `row`; None if the mask is empty."""
    crop = mask_crop(mask, scene.views[row].camera)
    return None if crop is None else Instance(identity, row, category, *crop, score, from_box, track)


def mask_crop(
    mask: BoolArray, camera: Camera, corner: tuple[int, int] = (0, 0), size: tuple[int, int] | None = None
) -> tuple[BoolArray, tuple[int, int]] | None:
    """Return the crop of a mask (h, w) at the resolution of a camera, and its upper left pixel; None if it is empty.

    Each pixel of the camera has the value of the mask at its centre. If `size` (width, height) is given, `mask` is the
    part of a mask of this size from the pixel `corner` (x, y) on, and the remainder is empty.

    Raises
    ------
    FieldError
        The mask has another aspect ratio: its image was cropped, padded or rotated.
    """
    (left, top), (width, height) = corner, size or mask.shape[::-1]
    if aspect_difference((width, height), camera) > MAX_ACCEPTED_ASPECT_DIFFERENCE:
        found = Unquoted(f"{width} x {height}: cropped, padded, squeezed or turned")
        raise FieldError("mask size", f"the shape of its image, {camera.width} x {camera.height} pixels", found)
    # Row and column of the mask at the centre of each pixel of the camera.
    rows = ((np.arange(camera.height) + 0.5) * height / camera.height).astype(np.int64)
    columns = ((np.arange(camera.width) + 0.5) * width / camera.width).astype(np.int64)
    first_row, first_column = np.searchsorted(rows, top), np.searchsorted(columns, left)
    rows = rows[first_row : np.searchsorted(rows, top + mask.shape[0])] - top
    columns = columns[first_column : np.searchsorted(columns, left + mask.shape[1])] - left
    used_rows = np.flatnonzero(np.asarray(mask.any(axis=1))[rows])
    used_columns = np.flatnonzero(np.asarray(mask.any(axis=0))[columns])
    if not len(used_rows) or not len(used_columns):
        return None
    crop = mask[np.ix_(rows[used_rows[0] : used_rows[-1] + 1], columns[used_columns[0] : used_columns[-1] + 1])]
    origin = int(first_column + used_columns[0]), int(first_row + used_rows[0])
    return (crop, origin) if crop.any() else None


def aspect_difference(size: tuple[int, int], camera: Camera) -> float:
    """Return the absolute log difference of the aspect ratios of an image (width, height) and a camera."""
    return abs(float(np.log((size[0] / size[1]) / (camera.width / camera.height))))


def _normalised(name: str) -> str:
    """Return a file name with forward slashes and without `./`."""
    return name.replace("\\", "/").removeprefix("./")
