"""Thirty mistakes of a user, each as the files of one scene with one mistake (`benchmarks.estimator.mistakes`)."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.geometry.vertical import camera_up
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["MISTAKES", "RIGHT", "Base", "Case", "Mask", "masks_of"]

#: A letterbox of most detectors.
SQUARE = 640
#: Where the cameras are said to be, (latitude, longitude): exchanged, the second is no place on the earth.
MUNICH, SEOUL = (48.0, 11.0), (37.0, 127.0)
METRES_PER_DEGREE = 111_200.0
#: Error of a position, as a share of the path's extent.
POSITION_NOISE = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """One mask (h, w) of a picture, its category and, where the file states it, the object's number."""

    picture: str
    category: str
    pixels: BoolArray
    track: str | None


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """A scene whose scale is known to `tolerance`, a ratio above 1, with its right masks."""

    name: str
    scene: Scene
    masks: tuple[Mask, ...]
    metres_per_unit: float
    tolerance: float
    place: tuple[float, float]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        camera = self.scene.views[0].camera
        return camera.width, camera.height


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What is given: the scene, a COCO dataset or None, an up, a table of positions."""

    scene: Scene
    dataset: dict[str, Any] | None
    up: tuple[float, ...] | None = None
    positions: list[tuple[str, float, float, float]] = field(default_factory=list)

    def write_positions(self, file: Path) -> Path:
        """The table as `--gps` reads it."""
        with file.open("w", newline="") as stream:
            csv.writer(stream).writerows([("name", "lat", "lon", "alt"), *self.positions])
        return file


def masks_of(scene: Scene, instances: Sequence[Instance]) -> Iterator[Mask]:
    """The whole masks of a scene's instances."""
    for one in instances:
        view = scene.views[one.view]
        pixels = np.zeros((view.camera.height, view.camera.width), dtype=bool)
        (x, y), (h, w) = one.origin, one.mask.shape
        pixels[y : y + h, x : x + w] = one.mask
        yield Mask(view.name, one.category, pixels, one.track)


Segment = Callable[[BoolArray], dict[str, Any]]


def _run_lengths(pixels: BoolArray) -> dict[str, Any]:
    from pycocotools import mask as coco

    code = coco.encode(np.asfortranarray(pixels, dtype=np.uint8))
    return {"segmentation": {"size": list(pixels.shape), "counts": code["counts"].decode()}}


def _outlines(pixels: BoolArray, matrix: FloatArray | None = None) -> dict[str, Any]:
    """Polygons, moved by `matrix` (2, 3)."""
    import cv2

    rings, _ = cv2.findContours(pixels.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    moved = [
        ring[:, 0] + 0.5 if matrix is None else (ring[:, 0] + 0.5) @ matrix[:, :2].T + matrix[:, 2] for ring in rings
    ]
    return {"segmentation": [ring.ravel().tolist() for ring in moved if len(ring) >= 3]}


def _box(pixels: BoolArray) -> FloatArray:
    """x, y, width, height."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]], dtype=float)


def _dataset(base: Base, segment: Segment = _run_lengths, masks: Sequence[Mask] | None = None) -> dict[str, Any]:
    masks = base.masks if masks is None else masks
    width, height = base.size
    pictures = [view.name for view in base.scene.views]
    names = sorted({mask.category for mask in masks})
    annotations: list[dict[str, Any]] = []
    for mask in masks:
        if mask.pixels.any():
            row: dict[str, Any] = {"id": len(annotations) + 1, "image_id": pictures.index(mask.picture) + 1}
            row |= {"category_id": names.index(mask.category) + 1, **segment(mask.pixels)}
            if row.get("segmentation", True):
                annotations.append(row | ({} if mask.track is None else {"track_id": mask.track}))
    return {
        "images": [
            {"id": number, "file_name": name, "width": width, "height": height}
            for number, name in enumerate(pictures, 1)
        ],
        "categories": [{"id": number, "name": name} for number, name in enumerate(names, 1)],
        "annotations": annotations,
    }


def _with_pixels(change: Callable[[BoolArray], BoolArray]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, _dataset(base, lambda pixels: _run_lengths(change(pixels))))


def _with_outlines(matrix: Callable[[Base], list[list[float]]]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, _dataset(base, lambda pixels: _outlines(pixels, np.array(matrix(base)))))


def _with_boxes(change: Callable[[FloatArray], FloatArray]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, _dataset(base, lambda pixels: {"bbox": change(_box(pixels)).tolist()}))


def _with_pictures(order: Callable[[list[str]], list[str]]) -> Callable[[Base], Case]:
    """Each annotated picture's masks said of another annotated one."""

    def case(base: Base) -> Case:
        pictures = sorted({mask.picture for mask in base.masks})
        other = dict(zip(pictures, order(pictures), strict=True))
        return Case(
            base.scene, _dataset(base, masks=[replace(mask, picture=other[mask.picture]) for mask in base.masks])
        )

    return case


def _with_names(change: Callable[[list[str]], list[str]]) -> Callable[[Base], Case]:
    def case(base: Base) -> Case:
        names = sorted({mask.category for mask in base.masks})
        other = dict(zip(names, change(names), strict=True))
        return Case(base.scene, _dataset(base, masks=[replace(m, category=other[m.category]) for m in base.masks]))

    return case


def _crop(rows: float, columns: float) -> Callable[[BoolArray], BoolArray]:
    """The middle of a picture, as a share of its height and its width."""

    def cropped(pixels: BoolArray) -> BoolArray:
        h, w = pixels.shape
        top, left = round(h * (1 - rows) / 2), round(w * (1 - columns) / 2)
        return pixels[top : h - top, left : w - left]

    return cropped


def _letterbox(pixels: BoolArray) -> BoolArray:
    """The picture between bars that make it a square."""
    h, w = pixels.shape
    side = max(h, w)
    square = np.zeros((side, side), dtype=bool)
    square[(side - h) // 2 : (side - h) // 2 + h, (side - w) // 2 : (side - w) // 2 + w] = pixels
    return square


def _grown(pixels: BoolArray) -> BoolArray:
    """A mask wider by a fifth of its size."""
    import cv2

    reach = max(1, round(0.1 * float(np.sqrt(pixels.sum()))))
    wider = cv2.dilate(pixels.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    return np.asarray(wider, dtype=bool)


def _squeezed(base: Base) -> list[list[float]]:
    width, height = base.size
    return [[SQUARE / width, 0, 0], [0, SQUARE / height, 0]]


def _boxed(base: Base) -> list[list[float]]:
    width, height = base.size
    factor = SQUARE / max(width, height)
    return [[factor, 0, (SQUARE - factor * width) / 2], [0, factor, (SQUARE - factor * height) / 2]]


def _shuffled_half(names: list[str]) -> list[str]:
    moved = list(names)
    rows = np.random.default_rng(1).permutation(len(names))[: max(2, len(names) // 2)]
    for row, other in zip(rows, np.roll(rows, 1), strict=True):
        moved[row] = names[other]
    return moved


def _turned_up(degrees: float) -> Callable[[Base], Case]:
    def case(base: Base) -> Case:
        up = camera_up(base.scene.views).vector
        side = np.cross(up, base.scene.views[0].rotation[2])
        side /= np.linalg.norm(side)
        turned = np.cos(np.radians(degrees)) * up + np.sin(np.radians(degrees)) * side
        return Case(base.scene, _dataset(base), tuple(float(v) for v in turned))

    return case


def _half_pictures(base: Base) -> Case:
    """Pictures and masks of half the size, under the intrinsics of the whole one."""
    views = tuple(
        replace(view, camera=replace(view.camera, width=view.camera.width // 2, height=view.camera.height // 2))
        for view in base.scene.views
    )
    return Case(replace(base.scene, views=views), _dataset(base, lambda pixels: _run_lengths(pixels[::2, ::2])))


def _located(base: Base) -> FloatArray:
    """(n, 3) latitude, longitude, altitude of the cameras, with errors."""
    views = base.scene.views
    up = camera_up(views).vector
    east = np.cross(up, [0.31, -0.62, 0.72])
    east /= np.linalg.norm(east)
    axes = np.stack([east, np.cross(up, east), up])
    metres = base.metres_per_unit * np.array([view.centre for view in views]) @ axes.T
    metres -= metres.mean(axis=0)
    extent = float(np.sqrt((metres**2).sum() / len(metres)))
    metres += np.random.default_rng(3).normal(0, POSITION_NOISE * extent, metres.shape)
    lat, lon = base.place
    across = METRES_PER_DEGREE * np.cos(np.radians(lat))
    return np.column_stack([lat + metres[:, 1] / METRES_PER_DEGREE, lon + metres[:, 0] / across, 500 + metres[:, 2]])


def _with_positions(change: Callable[[FloatArray], FloatArray]) -> Callable[[Base], Case]:
    """Positions alone, without masks."""

    def case(base: Base) -> Case:
        rows = zip((view.name for view in base.scene.views), change(_located(base)).tolist(), strict=True)
        return Case(base.scene, None, positions=[(name, lat, lon, alt) for name, (lat, lon, alt) in rows])

    return case


def _stretched(places: FloatArray, column: int, factor: float) -> FloatArray:
    moved = places.copy()
    moved[:, column] = places[0, column] + factor * (places[:, column] - places[0, column])
    return moved


RIGHT: dict[str, Callable[[Base], Case]] = {
    "run lengths": _with_pixels(lambda pixels: pixels),
    "run lengths at half resolution": _with_pixels(lambda pixels: pixels[::2, ::2]),
    "polygons": lambda base: Case(base.scene, _dataset(base, _outlines)),
    "boxes": _with_boxes(lambda box: box),
    "up": _turned_up(1.0),
    "positions": _with_positions(lambda places: places),
}

MISTAKES: dict[str, Callable[[Base], Case]] = {
    "masks of the middle of the pictures": _with_pixels(_crop(0.8, 0.8)),
    "masks of pictures cropped in width": _with_pixels(_crop(1.0, 0.75)),
    "run lengths of a letterboxed square": _with_pixels(_letterbox),
    "polygons of a letterboxed square": _with_outlines(_boxed),
    "polygons of a squeezed square": _with_outlines(_squeezed),
    "polygons at half resolution": _with_outlines(lambda _: [[0.5, 0, 0], [0, 0.5, 0]]),
    "polygons at 1.5 times the resolution": _with_outlines(lambda _: [[1.5, 0, 0], [0, 1.5, 0]]),
    "boxes of two corners read as x, y, w, h": _with_boxes(lambda b: np.array([b[0], b[1], b[0] + b[2], b[1] + b[3]])),
    "boxes at half resolution": _with_boxes(lambda b: b / 2),
    "boxes with their middle first": _with_boxes(lambda b: np.array([b[0] + b[2] / 2, b[1] + b[3] / 2, b[2], b[3]])),
    "x and y exchanged": _with_pixels(lambda pixels: pixels.T),
    "masks mirrored": _with_pixels(lambda pixels: pixels[:, ::-1]),
    "masks turned by 180 degrees": _with_pixels(lambda pixels: pixels[::-1, ::-1]),
    "masks turned by 270 degrees": _with_pixels(lambda pixels: np.rot90(pixels, 3)),
    "masks one picture late": _with_pictures(lambda names: names[1:] + names[:1]),
    "pictures in reverse order": _with_pictures(lambda names: names[::-1]),
    "pictures mixed up": _with_pictures(lambda names: list(np.random.default_rng(2).permutation(names))),
    "masks grown by a fifth": _with_pixels(_grown),
    "categories off by one": _with_names(lambda names: names[1:] + names[:1]),
    "categories off by three": _with_names(lambda names: names[3 % len(names) :] + names[: 3 % len(names)]),
    "all masks of a person": _with_names(lambda names: ["person"] * len(names)),
    "toys": _with_names(lambda names: [f"toy {name}" for name in names]),
    "pictures of the objects": _with_names(lambda names: [f"picture of {name}" for name in names]),
    "half of the categories exchanged": _with_names(_shuffled_half),
    "up turned by 60 degrees": _turned_up(60.0),
    "pictures of another size": _half_pictures,
    "latitude and longitude exchanged": _with_positions(lambda places: places[:, [1, 0, 2]]),
    "altitudes doubled": _with_positions(lambda places: _stretched(places, 2, 2.0)),
    "longitudes stretched by 1.5": _with_positions(lambda places: _stretched(places, 1, 1.5)),
    "longitudes without their sign": _with_positions(lambda places: places * [1, -1, 1]),
}  # fmt: skip
