"""Synthetic images: cut-outs pasted on a background at plausible relative sizes, with exact masks.

The whole image has one scale (pixels per millimetre), which the first object determines. The size in pixels of every
other object is its size according to the tree times this scale and a random factor for its distance. Objects that
would be too small to recognise or would fill the image are not placed, so that a mouse appears next to a keyboard and a
car next to a person. Closer objects are larger, lower, and in front. The borders of the cut-outs are blurred by
different radii, so that a detector does not learn the seam (Dwibedi, Misra and Hebert 2017, "Cut, Paste and Learn").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.images import read_image
from metric_tree.axes import AXES
from metric_tree.node import Node
from metric_tree.release.images import image_path
from metric_tree.training.annotations import BadAnnotations
from metric_tree.training.classes import Classes

Image: TypeAlias = NDArray[np.uint8]

#: Number of sizes that are drawn from the prior for an item without a size.
MAX_DRAWS = 16
#: Range of the number of objects per image; COCO has seven on average.
MIN_OBJECTS, MAX_OBJECTS = 2, 9
#: Maximum number of cut-outs that are tried for an object until one has a plausible size at the scale of the image.
MAX_TRIES = 12
#: Range of the longest side of the first object, as a fraction of the shorter side of the image.
FIRST_FRACTION = (0.15, 0.75)
#: Minimum longest side of an object in pixels; the small objects of COCO are shorter than 32.
MIN_SIDE_PX = 24
#: Maximum longest side of an object, as a fraction of the longer side of the image.
MAX_SIDE_FRACTION = 0.9
#: Standard deviation of the logarithm of the distance of an object: two sigma are 43 %.
DISTANCE_SD = 0.18
#: Minimum visible fraction of an object and minimum visible area in pixels; annotators omit objects with less.
MIN_VISIBLE_FRACTION, MIN_VISIBLE_PX = 0.2, 100
#: Blur of the border in pixels, one of them for each object; 0 is a hard edge.
BORDERS_PX = (0.0, 0.7, 1.5)
#: Ranges of the factors on brightness and on each channel, for other lamps than in a shop.
BRIGHTNESS, TINT = (0.7, 1.15), (0.92, 1.08)
#: Weight of the hue of a synthetic background, 0 to 1; walls and floors are mostly grey.
HUE_FRACTION = 0.35
#: Minimum opacity of a pixel of the object.
MIN_OPAQUE_ALPHA = 128
#: Longest side of a cut-out in memory in pixels, sufficient for an image of 640 pixels.
CACHED_SIDE_PX = 640
#: Maximum number of cut-outs in memory.
MAX_CACHED_CUTOUTS = 64


@dataclass(frozen=True, slots=True)
class Cutout:
    """An RGBA cut-out of an item, and true sizes."""

    item_id: str
    node_id: str
    category: int  #: Class id.
    file: Path
    licence: str | None
    axis: str  #: Side of the tight box with the size `sizes_mm`: `height` or `longest`.
    sizes_mm: tuple[float, ...]  #: Size of the item, or draws from the prior of its node.


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A cut-out at its size and position, with the part of it that is visible."""

    cutout: Cutout
    size_mm: float
    pixels: Image  #: (h, w, 4) BGRA.
    x: int  #: Column of the upper left corner, which may be outside the image.
    y: int  #: Row of the upper left corner.
    border: float  #: Blur of the border in pixels.

    @property
    def area(self) -> int:
        """Number of opaque pixels."""
        return int((self.pixels[:, :, 3] >= MIN_OPAQUE_ALPHA).sum())

    def window(self, size: tuple[int, int]) -> tuple[Image, tuple[slice, slice]]:
        """Return the pixels inside an image of the given (height, width), and their rows and columns."""
        h, w = self.pixels.shape[:2]
        top, left = max(-self.y, 0), max(-self.x, 0)
        bottom, right = max(min(h, size[0] - self.y), top), max(min(w, size[1] - self.x), left)
        position = slice(self.y + top, self.y + bottom), slice(self.x + left, self.x + right)
        return self.pixels[top:bottom, left:right], position


@dataclass(frozen=True, slots=True, eq=False)
class Composition:
    """A synthetic image."""

    image: Image  #: (H, W, 3) BGR.
    layers: list[Layer]  #: Objects, the farthest first.
    labels: NDArray[np.int16]  #: (H, W) index of the visible layer, or -1.
    px_per_mm: float


def cutouts_of(classes: Classes, seed: int) -> list[Cutout]:
    """Return the cut-outs of the nodes of the classes, sorted by item and image within a class.

    Shops photograph upright objects from the front, so that the height of the cut-out is the height of the object. Flat
    objects are photographed from above and objects without a pose from any side: the longest side of the cut-out is the
    longest extent.
    """
    cutouts = []
    for category, root in enumerate(classes.nodes, start=1):
        items = {row["item_id"]: row for row in root.items().to_pylist()}
        rows = [row for row in root.images().to_pylist() if row["cutout_path"]]
        for row in sorted(rows, key=lambda row: (row["item_id"], row["image_id"])):
            axis, sizes_mm = shown_sizes(items.get(row["item_id"], {}), classes.tree.node(row["node_id"]), seed)
            file = image_path(classes.tree.release.directory, row, "cutout_path")
            if sizes_mm and file is not None:
                cutouts.append(Cutout(row["item_id"], row["node_id"], category, file, row["licence"], axis, sizes_mm))
    return cutouts


def shown_sizes(item: dict[str, Any], node: Node, seed: int) -> tuple[str, tuple[float, ...]]:
    """Return the axis of a cut-out (`Cutout.axis`) and its sizes in mm: of the item, or drawn from a prior.

    The prior is that of the node or of its nearest ancestor with one.
    """
    known = [float(item[f"{axis}_mm"]) for axis in AXES if item.get(f"{axis}_mm") is not None]
    if node.pose == "upright" and item.get("height_mm") is not None:
        return "height", (float(item["height_mm"]),)
    if len(known) > 1 and node.pose != "upright":
        return "longest", (max(known),)
    for one in (node, *node.ancestors()):
        if one.prior_dims:
            prior = one.prior()
            drawn = prior.sample(MAX_DRAWS, seed)
            if node.pose == "upright" and "height" in prior.dims:
                return "height", tuple(drawn[:, prior.dims.index("height")].tolist())
            return "longest", tuple(np.max(drawn, axis=1).tolist())
    return "longest", ()


def compose(cutouts: Sequence[Sequence[Cutout]], background: Image, generator: np.random.Generator) -> Composition:
    """Compose an image of cut-outs.

    Parameters
    ----------
    cutouts : sequence of sequences of Cutout
        Cut-outs of each class; classes have the same probability, whatever the number of their cut-outs.
    background : (H, W, 3) ndarray of uint8
        BGR image, which is not changed.
    generator : Generator
        Source of all random numbers.
    """
    size = background.shape[0], background.shape[1]
    layers, px_per_mm = place_cutouts(cutouts, size, generator)
    # Hidden and truncated objects are removed one by one, since each removal uncovers others.
    while True:
        labels = np.full(size, -1, dtype=np.int16)
        for index, layer in enumerate(layers):
            pixels, (rows, columns) = layer.window(size)
            labels[rows, columns][pixels[:, :, 3] >= MIN_OPAQUE_ALPHA] = index
        visible = np.bincount(labels[labels >= 0], minlength=len(layers))
        areas = np.array([layer.area for layer in layers])
        is_hidden = (visible < MIN_VISIBLE_PX) | (visible < MIN_VISIBLE_FRACTION * areas)
        if not is_hidden.any():
            break
        worst = int(np.argmin(np.where(is_hidden, visible / np.maximum(areas, 1), np.inf)))
        layers = [layer for index, layer in enumerate(layers) if index != worst]
    image = background.astype(np.float32)
    for layer in layers:
        light = generator.uniform(*BRIGHTNESS) * generator.uniform(*TINT, 3)
        pixels, (rows, columns) = layer.window(size)
        opacity = pixels[:, :, 3].astype(np.float32) / 255
        if layer.border:  # blurred inwards only, because there are no pixels of the object outside its mask
            blurred = cv2.GaussianBlur(opacity, (0, 0), layer.border, borderType=cv2.BORDER_REPLICATE)
            opacity = np.minimum(opacity, blurred)
        image[rows, columns] += opacity[:, :, None] * (
            pixels[:, :, :3] * light.astype(np.float32) - image[rows, columns]
        )
    return Composition(np.clip(np.rint(image), 0, 255).astype(np.uint8), layers, labels, px_per_mm)


def place_cutouts(
    cutouts: Sequence[Sequence[Cutout]], size: tuple[int, int], generator: np.random.Generator
) -> tuple[list[Layer], float]:
    """Choose cut-outs and their positions in an image of the given (height, width).

    Returns
    -------
    layers : list of Layer
        The farthest first.
    px_per_mm : float
        Scale of the image.
    """
    height, width = size

    def draw() -> tuple[Cutout, float]:
        group = cutouts[int(generator.integers(len(cutouts)))]
        cutout = group[int(generator.integers(len(group)))]
        return cutout, cutout.sizes_mm[int(generator.integers(len(cutout.sizes_mm)))]

    # 1. The first object determines the scale; the others are plausible at this scale and their distance.
    first, first_mm = draw()
    pixels, side_px = cutout_pixels(first)
    px_per_mm = float(generator.uniform(*FIRST_FRACTION)) * min(size) / (first_mm * max(pixels.shape[:2]) / side_px)
    chosen = [(1.0, first, first_mm)]
    for _ in range(int(generator.integers(MIN_OBJECTS, MAX_OBJECTS + 1)) - 1):
        for _ in range(MAX_TRIES):
            cutout, size_mm = draw()
            nearness = float(np.exp(generator.normal(0, DISTANCE_SD)))
            pixels, side_px = cutout_pixels(cutout)
            longest_px = size_mm * px_per_mm * nearness * max(pixels.shape[:2]) / side_px
            if MIN_SIDE_PX <= longest_px <= MAX_SIDE_FRACTION * max(height, width):
                chosen.append((nearness, cutout, size_mm))
                break

    # 2. Positions, the farthest first: closer objects stand lower; up to a quarter may be outside the image.
    layers = []
    for nearness, cutout, size_mm in sorted(chosen, key=lambda entry: entry[0]):
        pixels, side_px = cutout_pixels(cutout)
        factor = size_mm * px_per_mm * nearness / side_px
        h, w = (max(round(side * factor), 1) for side in pixels.shape[:2])
        scaled = cv2.resize(pixels, (w, h), interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR)
        if generator.random() < 0.5:
            scaled = scaled[:, ::-1]
        x = int(generator.uniform(-0.25 * w, width - 0.75 * w))
        foot = height * (0.55 + 0.4 * nearness / (1 + nearness)) + generator.normal(0, 0.12) * height
        y = int(np.clip(foot, 0.4 * h, height + 0.25 * h)) - h
        layers.append(Layer(cutout, size_mm, np.ascontiguousarray(scaled), x, y, float(generator.choice(BORDERS_PX))))
    return layers, px_per_mm


def random_background(size: tuple[int, int], generator: np.random.Generator) -> Image:
    """Return a background (H, W, 3) of smooth coloured patches with grain, of the given (height, width)."""
    height, width = size
    cells = int(generator.integers(2, 8)), int(generator.integers(2, 10))
    grey, hue = generator.uniform(20, 235, (*cells, 1)), generator.uniform(20, 235, (*cells, 3))
    coarse = (1 - HUE_FRACTION) * grey + HUE_FRACTION * hue
    smooth = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    grain = generator.normal(0, generator.uniform(1, 9), (height, width, 1))
    return np.asarray(np.clip(smooth + grain, 0, 255), dtype=np.uint8)


def cutout_pixels(cutout: Cutout) -> tuple[Image, int]:
    """Return the BGRA pixels (h, w, 4) of a cut-out, and the side in pixels that its size refers to."""
    pixels = _tight_pixels(cutout.file)
    return pixels, int(pixels.shape[0] if cutout.axis == "height" else max(pixels.shape[:2]))


@lru_cache(maxsize=MAX_CACHED_CUTOUTS)
def _tight_pixels(file: Path) -> Image:
    """Read the pixels (h, w, 4) in the tight box of a cut-out; its longest side is at most `CACHED_SIDE_PX`."""
    pixels = read_image(file, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8:
        raise BadAnnotations.at(file, "cut-out", "an RGBA image of 8 bits", "something else")
    rows, columns = (np.flatnonzero((pixels[:, :, 3] >= MIN_OPAQUE_ALPHA).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        raise BadAnnotations.at(file, "cut-out", "an opaque pixel", "none")
    tight = pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    factor = CACHED_SIDE_PX / max(tight.shape[:2])
    if factor < 1:
        size = (max(round(tight.shape[1] * factor), 1), max(round(tight.shape[0] * factor), 1))
        tight = cv2.resize(tight, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(tight)
