"""Input files of a scene with one of 45 user mistakes (`benchmarks.estimator.mistakes`)."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.evidence.source import EvidenceSource
from estimator.geometry.vertical import camera_up
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Instance, Scene
from metric_base.arrays import BoolArray, FloatArray

__all__ = [
    "METRES_PER_DEGREE",
    "MISTAKES",
    "RIGHT",
    "Base",
    "Case",
    "Mask",
    "box_of",
    "camera_positions",
    "coco_dataset",
    "masks_of",
    "resized_masks",
]

#: Side in pixels of the square input of most detectors.
SQUARE = 640
#: Locations (latitude, longitude) of the cameras. Exchanged, Seoul's have an invalid latitude.
MUNICH = (48.0, 11.0)
SEOUL = (37.0, 127.0)
METRES_PER_DEGREE = 111_200.0
#: Standard deviation of a position, as a fraction of the path's extent.
POSITION_NOISE = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """One mask (h, w) of an image, its category and, if the file states it, the object's identity."""

    image: str
    category: str
    pixels: BoolArray
    track: str | None


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """A scene with its right masks. Its scale is known up to the factor `tolerance` (above 1)."""

    name: str
    scene: Scene
    masks: tuple[Mask, ...]
    metres_per_unit: float
    tolerance: float
    place: tuple[float, float]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images."""
        camera = self.scene.views[0].camera
        return camera.width, camera.height


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Input of one estimate: the scene, a COCO dataset or None, an up vector, a table of positions."""

    scene: Scene
    dataset: dict[str, Any] | None
    up: tuple[float, ...] | None = None
    positions: list[tuple[str, float, float, float]] = field(default_factory=list)
    columns: tuple[str, str, str] = ("lat", "lon", "alt")  #: Header of the positions.
    models: float = 0.0  #: Fraction of the measured objects that are replaced by models.
    model_ratio: float = 24.0  #: Ratio of the size of an object to that of its model, of toy cars and dolls' houses.
    sources: tuple[EvidenceSource, ...] = ()  #: Other evidence.
    evidence: tuple[ScaleEvidence, ...] = ()  #: Other evidence that is computed already.

    def write_positions(self, file: Path) -> Path:
        """Write the positions as a table for `--gps`."""
        with file.open("w", newline="") as stream:
            csv.writer(stream).writerows([("name", *self.columns), *self.positions])
        return file


def masks_of(scene: Scene, instances: Sequence[Instance]) -> Iterator[Mask]:
    """Yield the masks of a scene's instances, each as large as its image."""
    for instance in instances:
        view = scene.views[instance.view]
        pixels = np.zeros((view.camera.height, view.camera.width), dtype=bool)
        (x, y), (h, w) = instance.origin, instance.mask.shape
        pixels[y : y + h, x : x + w] = instance.mask
        yield Mask(view.name, instance.category, pixels, instance.track)


Segment = Callable[[BoolArray], dict[str, Any]]


def _run_lengths(pixels: BoolArray) -> dict[str, Any]:
    from pycocotools import mask as coco

    code = coco.encode(np.asfortranarray(pixels, dtype=np.uint8))
    return {"segmentation": {"size": list(pixels.shape), "counts": code["counts"].decode()}}


def _outlines(pixels: BoolArray, matrix: FloatArray | None = None) -> dict[str, Any]:
    """Return the polygons of a mask, transformed by `matrix` (2, 3)."""
    import cv2

    rings, _ = cv2.findContours(pixels.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    moved = [
        ring[:, 0] + 0.5 if matrix is None else (ring[:, 0] + 0.5) @ matrix[:, :2].T + matrix[:, 2] for ring in rings
    ]
    return {"segmentation": [ring.ravel().tolist() for ring in moved if len(ring) >= 3]}


def box_of(pixels: BoolArray) -> FloatArray:
    """Return the bounding box (x, y, width, height) of a mask."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]], dtype=float)


def coco_dataset(base: Base, segment: Segment = _run_lengths, masks: Sequence[Mask] | None = None) -> dict[str, Any]:
    masks = base.masks if masks is None else masks
    width, height = base.size
    images = [view.name for view in base.scene.views]
    names = sorted({mask.category for mask in masks})
    annotations: list[dict[str, Any]] = []
    for mask in masks:
        if mask.pixels.any():
            row: dict[str, Any] = {"id": len(annotations) + 1, "image_id": images.index(mask.image) + 1}
            row |= {"category_id": names.index(mask.category) + 1, **segment(mask.pixels)}
            if row.get("segmentation", True):
                annotations.append(row | ({} if mask.track is None else {"track_id": mask.track}))
    return {
        "images": [
            {"id": number, "file_name": name, "width": width, "height": height} for number, name in enumerate(images, 1)
        ],
        "categories": [{"id": number, "name": name} for number, name in enumerate(names, 1)],
        "annotations": annotations,
    }


def _with_pixels(change: Callable[[BoolArray], BoolArray]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, coco_dataset(base, lambda pixels: _run_lengths(change(pixels))))


def _with_outlines(matrix: Callable[[Base], list[list[float]]]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, coco_dataset(base, lambda pixels: _outlines(pixels, np.array(matrix(base)))))


def _with_boxes(change: Callable[[FloatArray], FloatArray]) -> Callable[[Base], Case]:
    return lambda base: Case(base.scene, coco_dataset(base, lambda pixels: {"bbox": change(box_of(pixels)).tolist()}))


def _with_images(order: Callable[[list[str]], list[str]]) -> Callable[[Base], Case]:
    """Assign the masks of each annotated image to another annotated image."""

    def case(base: Base) -> Case:
        images = sorted({mask.image for mask in base.masks})
        other = dict(zip(images, order(images), strict=True))
        return Case(
            base.scene, coco_dataset(base, masks=[replace(mask, image=other[mask.image]) for mask in base.masks])
        )

    return case


def _with_names(change: Callable[[list[str]], list[str]]) -> Callable[[Base], Case]:
    def case(base: Base) -> Case:
        names = sorted({mask.category for mask in base.masks})
        other = dict(zip(names, change(names), strict=True))
        return Case(base.scene, coco_dataset(base, masks=[replace(m, category=other[m.category]) for m in base.masks]))

    return case


def _crop(rows: float, columns: float) -> Callable[[BoolArray], BoolArray]:
    """Crop the centre of an image to the given fractions of its height and width."""

    def cropped(pixels: BoolArray) -> BoolArray:
        h, w = pixels.shape
        top, left = round(h * (1 - rows) / 2), round(w * (1 - columns) / 2)
        return pixels[top : h - top, left : w - left]

    return cropped


def _letterbox(pixels: BoolArray) -> BoolArray:
    """Pad the image to a square."""
    h, w = pixels.shape
    side = max(h, w)
    square = np.zeros((side, side), dtype=bool)
    square[(side - h) // 2 : (side - h) // 2 + h, (side - w) // 2 : (side - w) // 2 + w] = pixels
    return square


def _dilated(pixels: BoolArray) -> BoolArray:
    """Return the mask dilated by a tenth of its size on each side."""
    import cv2

    radius = max(1, round(0.1 * float(np.sqrt(pixels.sum()))))
    dilated = cv2.dilate(pixels.astype(np.uint8), np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return np.asarray(dilated, dtype=bool)


def _resize_to_square(base: Base) -> list[list[float]]:
    """Return the matrix (2, 3) that resizes an image to a square without its aspect ratio."""
    width, height = base.size
    return [[SQUARE / width, 0, 0], [0, SQUARE / height, 0]]


def _letterbox_to_square(base: Base) -> list[list[float]]:
    """Return the matrix (2, 3) that resizes an image to a square with its aspect ratio and padding."""
    width, height = base.size
    factor = SQUARE / max(width, height)
    return [[factor, 0, (SQUARE - factor * width) / 2], [0, factor, (SQUARE - factor * height) / 2]]


def _shuffled_half(names: list[str]) -> list[str]:
    moved = list(names)
    rows = np.random.default_rng(1).permutation(len(names))[: max(2, len(names) // 2)]
    for row, other in zip(rows, np.roll(rows, 1), strict=True):
        moved[row] = names[other]
    return moved


def _rotated_up(degrees: float) -> Callable[[Base], Case]:
    """Rotate the true up vector about a horizontal axis."""

    def case(base: Base) -> Case:
        up = camera_up(base.scene.views).vector
        side = np.cross(up, base.scene.views[0].rotation[2])
        side /= np.linalg.norm(side)
        rotated = np.cos(np.radians(degrees)) * up + np.sin(np.radians(degrees)) * side
        return Case(base.scene, coco_dataset(base), tuple(float(v) for v in rotated))

    return case


def _half_images(base: Base) -> Case:
    """Return images and masks of half the size with the intrinsics of the full size."""
    views = tuple(
        replace(view, camera=replace(view.camera, width=view.camera.width // 2, height=view.camera.height // 2))
        for view in base.scene.views
    )
    return Case(replace(base.scene, views=views), coco_dataset(base, lambda pixels: _run_lengths(pixels[::2, ::2])))


def camera_positions(base: Base) -> FloatArray:
    """Return latitude, longitude and altitude (n, 3) of the cameras, with errors."""
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
    """Pass only positions, without masks."""

    def case(base: Base) -> Case:
        rows = zip((view.name for view in base.scene.views), change(camera_positions(base)).tolist(), strict=True)
        return Case(base.scene, None, positions=[(name, lat, lon, alt) for name, (lat, lon, alt) in rows])

    return case


def _in_units(factor: float, second_axis: float = 1.0) -> Callable[[Base], Case]:
    """Pass positions x, y, z of a local frame in another unit; horizontal axes are scaled by `second_axis` as well."""

    def case(base: Base) -> Case:
        lat, lon, alt = camera_positions(base).T
        across = METRES_PER_DEGREE * np.cos(np.radians(base.place[0]))
        metres = np.column_stack([(lon - lon[0]) * across, (lat - lat[0]) * METRES_PER_DEGREE, alt])
        values = (factor * metres * [second_axis, second_axis, 1.0]).tolist()
        names = [view.name for view in base.scene.views]
        rows = [(name, x, y, z) for name, (x, y, z) in zip(names, values, strict=True)]
        return Case(base.scene, None, positions=rows, columns=("x", "y", "z"))

    return case


def _degrees_and_minutes(positions: FloatArray) -> FloatArray:
    """Return degrees with minutes after the decimal point, 48.30 for 48 degrees and 30 minutes."""
    whole = np.floor(positions[:, :2])
    return np.column_stack([whole + (positions[:, :2] - whole) * 0.6, positions[:, 2]])


def _two_models(base: Base) -> Case:
    """Split the views into two models that share no point; the second one is twice as large."""
    views, n, half = [], len(base.scene.points), len(base.scene.views) // 2
    for number, view in enumerate(base.scene.views):
        factor, offset = (1, 0) if number < half else (2, n)
        views.append(replace(view, translation=factor * view.translation, point_index=view.point_index + offset))
    points = np.vstack([base.scene.points, 2 * base.scene.points])
    tracked = [
        replace(mask, track=None if mask.track is None else f"{mask.track}{mask.image in names}")
        for names in [{view.name for view in base.scene.views[:half]}]
        for mask in base.masks
    ]
    scene = replace(base.scene, views=tuple(views), points=points, dense=None)
    return Case(scene, coco_dataset(base, masks=tracked))


def _late_in_second_half(names: list[str]) -> list[str]:
    half = len(names) // 2
    return names[:half] + names[half + 2 :] + names[half : half + 2]


def resized_masks(factor: float) -> Callable[[BoolArray], BoolArray]:
    """Scale each mask about the centre of its box."""

    def resized(pixels: BoolArray) -> BoolArray:
        import cv2

        x, y, w, h = box_of(pixels)
        cx, cy = x + w / 2, y + h / 2
        matrix = np.array([[factor, 0, (1 - factor) * cx], [0, factor, (1 - factor) * cy]])
        size = (pixels.shape[1], pixels.shape[0])
        return np.asarray(cv2.warpAffine(pixels.astype(np.uint8), matrix, size, flags=cv2.INTER_NEAREST), dtype=bool)

    return resized


def _as_shape(is_circle: bool) -> Callable[[BoolArray], BoolArray]:
    """Replace each mask by its box, or by the ellipse in its box."""

    def shape(pixels: BoolArray) -> BoolArray:
        x, y, w, h = box_of(pixels)
        rows, columns = np.indices(pixels.shape) + 0.5
        u, v = (columns - x - w / 2) / (w / 2), (rows - y - h / 2) / (h / 2)
        return np.asarray(u**2 + v**2 <= 1 if is_circle else np.maximum(abs(u), abs(v)) <= 1)

    return shape


def _stretched(positions: FloatArray, column: int, factor: float) -> FloatArray:
    stretched = positions.copy()
    stretched[:, column] = positions[0, column] + factor * (positions[:, column] - positions[0, column])
    return stretched


RIGHT: dict[str, Callable[[Base], Case]] = {
    "run lengths": _with_pixels(lambda pixels: pixels),
    "run lengths at half resolution": _with_pixels(lambda pixels: pixels[::2, ::2]),
    "polygons": lambda base: Case(base.scene, coco_dataset(base, _outlines)),
    "boxes": _with_boxes(lambda box: box),
    "up": _rotated_up(1.0),
    "positions": _with_positions(lambda positions: positions),
    "positions in metres": _in_units(1.0),
}

MISTAKES: dict[str, Callable[[Base], Case]] = {
    "masks of the middle of the pictures": _with_pixels(_crop(0.8, 0.8)),
    "masks of pictures cropped in width": _with_pixels(_crop(1.0, 0.75)),
    "run lengths of a letterboxed square": _with_pixels(_letterbox),
    "polygons of a letterboxed square": _with_outlines(_letterbox_to_square),
    "polygons of a squeezed square": _with_outlines(_resize_to_square),
    "polygons at half resolution": _with_outlines(lambda _: [[0.5, 0, 0], [0, 0.5, 0]]),
    "polygons at 1.5 times the resolution": _with_outlines(lambda _: [[1.5, 0, 0], [0, 1.5, 0]]),
    "boxes of two corners read as x, y, w, h": _with_boxes(lambda b: np.array([b[0], b[1], b[0] + b[2], b[1] + b[3]])),
    "boxes at half resolution": _with_boxes(lambda b: b / 2),
    "boxes with their middle first": _with_boxes(lambda b: np.array([b[0] + b[2] / 2, b[1] + b[3] / 2, b[2], b[3]])),
    "x and y exchanged": _with_pixels(lambda pixels: pixels.T),
    "masks mirrored": _with_pixels(lambda pixels: pixels[:, ::-1]),
    "masks turned by 180 degrees": _with_pixels(lambda pixels: pixels[::-1, ::-1]),
    "masks turned by 270 degrees": _with_pixels(lambda pixels: np.rot90(pixels, 3)),
    "masks one picture late": _with_images(lambda names: names[1:] + names[:1]),
    "pictures in reverse order": _with_images(lambda names: names[::-1]),
    "pictures mixed up": _with_images(lambda names: list(np.random.default_rng(2).permutation(names))),
    "masks grown by a fifth": _with_pixels(_dilated),
    "masks enlarged by 1.3": _with_pixels(resized_masks(1.3)),
    "masks shrunk to 0.6": _with_pixels(resized_masks(0.6)),
    "boxes given as masks": _with_pixels(_as_shape(is_circle=False)),
    "ellipses instead of masks": _with_pixels(_as_shape(is_circle=True)),
    "masks two pictures off in the second half": _with_images(_late_in_second_half),
    "categories off by one": _with_names(lambda names: names[1:] + names[:1]),
    "categories off by three": _with_names(lambda names: names[3 % len(names) :] + names[: 3 % len(names)]),
    "all masks of a person": _with_names(lambda names: ["person"] * len(names)),
    "toys": _with_names(lambda names: [f"toy {name}" for name in names]),
    "pictures of the objects": _with_names(lambda names: [f"picture of {name}" for name in names]),
    "categories in reverse order": _with_names(lambda names: names[::-1]),
    "categories mixed up": _with_names(lambda names: list(np.random.default_rng(5).permutation(names))),
    "two models of different scale": _two_models,
    "a quarter of the objects are models": lambda base: Case(base.scene, coco_dataset(base), models=0.25),
    "most objects are models": lambda base: Case(base.scene, coco_dataset(base), models=0.75),
    "half of the categories exchanged": _with_names(_shuffled_half),
    "up turned by 60 degrees": _rotated_up(60.0),
    "pictures of another size": _half_images,
    "latitude and longitude exchanged": _with_positions(lambda positions: positions[:, [1, 0, 2]]),
    "altitudes doubled": _with_positions(lambda positions: _stretched(positions, 2, 2.0)),
    "longitudes stretched by 1.5": _with_positions(lambda positions: _stretched(positions, 1, 1.5)),
    "longitudes without their sign": _with_positions(lambda positions: positions * [1, -1, 1]),
    "degrees and minutes": _with_positions(_degrees_and_minutes),
    "positions in kilometres": _in_units(1e-3),
    "positions in millimetres": _in_units(1e3),
    "positions in feet": _in_units(3.2808),
    "positions in Web Mercator": _in_units(1.0, second_axis=1 / np.cos(np.radians(48.0))),
}  # fmt: skip
