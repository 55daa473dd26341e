"""One synthetic image: cut-outs on a background at plausible relative sizes, with exact masks.

One scale (pixels per millimetre) holds for the whole image, set by its first object; every other object takes its
size from the tree and that scale, times a jitter that stands for its distance. What would be too small to see or would
fill the image is not placed: so a mouse is seen beside a keyboard and a car beside a person. Nearer objects are
larger, lower, and in front. Cut-outs are pasted with several borders (Dwibedi, Misra, Hebert 2017, "Cut, Paste and
Learn"), lest a detector learn the seam.

The cut-outs of a release as objects to paste: a file, a class, and a true size from the tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray
from metric_base.images import read_picture
from metric_tree.axes import AXES
from metric_tree.node import Node, NoPrior
from metric_tree.release.images import image_path
from metric_tree.training.annotations import BadAnnotations
from metric_tree.training.classes import Classes

#: Sizes drawn from the prior for an item that states none of its own.
MAX_DRAWS = 16
Picture = NDArray[np.uint8]
Labels = NDArray[np.int16]
#: Objects tried per image; COCO has seven on average.
LEAST_OBJECTS, MOST_OBJECTS = 2, 9
#: Cut-outs looked at for each object until one has a plausible size at the image's scale.
MAX_TRIES = 12
#: The first object's longest side as a share of the image's shorter one.
FIRST_SHARE = (0.15, 0.75)
#: Sides in pixels that are placed: COCO's small objects begin under 32, and beyond the image nothing is recognised.
LEAST_SIDE_PX, MOST_SIDE_SHARE = 24, 0.9
#: One sigma of the log of an object's distance: objects of one scene stand up to some 40 % nearer or farther.
DISTANCE_SD = 0.18
#: An object of which less is visible is taken out again: nobody would annotate it.
LEAST_VISIBLE_SHARE, LEAST_VISIBLE_PX = 0.2, 100
#: Blur of the border in pixels, one of them for each object; 0 is a hard edge.
BORDERS_PX = (0.0, 0.7, 1.5)
#: Range of a factor on brightness and of one on each channel: another lamp than the shop's.
BRIGHTNESS, TINT = (0.7, 1.15), (0.92, 1.08)
#: How much of a made background's colour is its hue: walls and floors are rather grey.
HUE_SHARE = 0.35
#: Opacity from which a pixel counts as the object's.
MIN_OPAQUE_ALPHA = 128
#: Longest side at which a cut-out is kept in memory; enough for MOST_SIDE_SHARE of an image of 640 pixels.
KEPT_SIDE_PX, KEPT_CUTOUTS = 640, 64


@dataclass(frozen=True, slots=True)
class Cutout:
    """An RGBA cut-out of one item.

    category : the class's id. axis : what of the image `sizes_mm` is the size of: `height` of the cut-out's tight
    box, or its `longest` side. sizes_mm : the item's own size, or draws from its node's prior.
    """

    item_id: str
    node_id: str
    category: int
    file: Path
    licence: str | None
    axis: str
    sizes_mm: tuple[float, ...]


def cutouts_of(classes: Classes, seed: int) -> list[Cutout]:
    """The cut-outs of the classes' nodes, in the order of their items and images.

    A shop photographs an upright object from the front: its image's height is the object's. What lies flat is shown
    from above and what has no pose from any side: there the longest side of the image is the longest extent.
    """
    cutouts = []
    for category, root in enumerate(classes.nodes, start=1):
        sizes = {row["item_id"]: row for row in root.items().to_pylist()}
        rows = [row for row in root.images().to_pylist() if row["cutout_path"]]
        for row in sorted(rows, key=lambda row: (row["item_id"], row["image_id"])):
            node = classes.tree.node(row["node_id"])
            axis, values = _size(sizes.get(row["item_id"], {}), node, seed)
            file = image_path(classes.tree.release.directory, row, "cutout_path")
            if values and file is not None:
                cutouts.append(Cutout(row["item_id"], row["node_id"], category, file, row["licence"], axis, values))
    return cutouts


def _size(item: dict[str, object], node: Node, seed: int) -> tuple[str, tuple[float, ...]]:
    """What the size is of, and the item's own size, else draws from the prior of its node or the first one above."""
    known = [float(str(item[f"{axis}_mm"])) for axis in AXES if item.get(f"{axis}_mm") is not None]
    if node.pose == "upright" and item.get("height_mm") is not None:
        return "height", (float(str(item["height_mm"])),)
    if len(known) > 1 and node.pose != "upright":
        return "longest", (max(known),)
    above: Node | None = node
    while above is not None:
        try:
            prior = above.prior()
        except NoPrior:
            above = above.parent
            continue
        drawn = prior.sample(MAX_DRAWS, seed)
        if node.pose == "upright" and "height" in prior.dims:
            return "height", tuple(drawn[:, prior.dims.index("height")].tolist())
        return "longest", tuple(np.max(drawn, axis=1).tolist())
    return "longest", ()


@dataclass(frozen=True, slots=True, eq=False)
class Pasted:
    """An object of an image: mask (H, W) of its visible part, and the size it was drawn from."""

    cutout: Cutout
    mask: BoolArray
    size_mm: float
    visible_share: float


@dataclass(frozen=True, slots=True, eq=False)
class Composition:
    """An image (H, W, 3) BGR, its objects from far to near, and its scale."""

    picture: Picture
    objects: tuple[Pasted, ...]
    px_per_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class _Layer:
    """A cut-out at its size and place: pixels (h, w, 4) BGRA, upper left corner (x, y), which may be outside."""

    cutout: Cutout
    size_mm: float
    pixels: Picture
    x: int
    y: int
    border: float


def compose(cutouts: Sequence[Sequence[Cutout]], background: Picture, generator: np.random.Generator) -> Composition:
    """An image made of cut-outs, the same for the same generator.

    Parameters
    ----------
    cutouts : those of each class that has any; classes are drawn alike often, whatever the number of their cut-outs
    background : (H, W, 3) BGR, not changed
    """
    layers, px_per_mm = _place(cutouts, background.shape[:2], generator)
    labels, layers = _visible(layers, background.shape[:2])
    picture = background.astype(np.float32)
    for layer in layers:
        _paint(picture, layer, generator)
    objects = []
    for number, layer in enumerate(layers):
        mask = labels == number
        whole = int((layer.pixels[:, :, 3] >= MIN_OPAQUE_ALPHA).sum())
        objects.append(Pasted(layer.cutout, mask, layer.size_mm, float(mask.sum() / whole)))
    return Composition(np.clip(np.rint(picture), 0, 255).astype(np.uint8), tuple(objects), px_per_mm)


def random_background(size: tuple[int, int], generator: np.random.Generator) -> Picture:
    """(H, W, 3) of soft coloured patches with grain, where the user has no images to paste on."""
    import cv2

    height, width = size
    cells = int(generator.integers(2, 8)), int(generator.integers(2, 10))
    grey, hue = generator.uniform(20, 235, (*cells, 1)), generator.uniform(20, 235, (*cells, 3))
    coarse = (1 - HUE_SHARE) * grey + HUE_SHARE * hue
    smooth = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    grain = generator.normal(0, generator.uniform(1, 9), (height, width, 1))
    return np.asarray(np.clip(smooth + grain, 0, 255), dtype=np.uint8)


def _place(
    cutouts: Sequence[Sequence[Cutout]], size: tuple[int, int], generator: np.random.Generator
) -> tuple[list[_Layer], float]:
    """The layers from far to near and the image's pixels per millimetre."""
    height, width = size
    first, first_mm = _draw(cutouts, generator)
    pixels = _pixels(first.file)
    longest = first_mm * max(pixels.shape[:2]) / _reference(first, pixels)
    px_per_mm = float(generator.uniform(*FIRST_SHARE)) * min(size) / longest
    chosen = [(1.0, first, first_mm)]
    for _ in range(int(generator.integers(LEAST_OBJECTS, MOST_OBJECTS + 1)) - 1):
        for _ in range(MAX_TRIES):
            cutout, size_mm = _draw(cutouts, generator)
            nearness = float(np.exp(generator.normal(0, DISTANCE_SD)))
            pixels = _pixels(cutout.file)
            side = size_mm * px_per_mm * nearness * max(pixels.shape[:2]) / _reference(cutout, pixels)
            if LEAST_SIDE_PX <= side <= MOST_SIDE_SHARE * max(height, width):
                chosen.append((nearness, cutout, size_mm))
                break
    chosen.sort(key=lambda entry: entry[0])
    return [_layer(*entry, px_per_mm, size, generator) for entry in chosen], px_per_mm


def _draw(cutouts: Sequence[Sequence[Cutout]], generator: np.random.Generator) -> tuple[Cutout, float]:
    """A cut-out of a random class, and one of its sizes."""
    group = cutouts[int(generator.integers(len(cutouts)))]
    cutout = group[int(generator.integers(len(group)))]
    return cutout, cutout.sizes_mm[int(generator.integers(len(cutout.sizes_mm)))]


def _layer(
    nearness: float,
    cutout: Cutout,
    size_mm: float,
    px_per_mm: float,
    size: tuple[int, int],
    generator: np.random.Generator,
) -> _Layer:
    import cv2

    height, width = size
    pixels = _pixels(cutout.file)
    factor = size_mm * px_per_mm * nearness / _reference(cutout, pixels)
    h, w = (max(round(side * factor), 1) for side in pixels.shape[:2])
    shrunk = cv2.resize(pixels, (w, h), interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR)
    if generator.random() < 0.5:
        shrunk = shrunk[:, ::-1]
    x = int(generator.uniform(-0.25 * w, width - 0.75 * w))
    foot = height * (0.55 + 0.4 * nearness / (1 + nearness)) + generator.normal(0, 0.12) * height
    y = int(np.clip(foot, 0.4 * h, height + 0.25 * h)) - h
    return _Layer(cutout, size_mm, np.ascontiguousarray(shrunk), x, y, float(generator.choice(BORDERS_PX)))


def _visible(layers: list[_Layer], size: tuple[int, int]) -> tuple[Labels, list[_Layer]]:
    """The layer that each pixel shows, -1 where none, once those that are hidden or cut off are taken out."""
    while True:
        labels = np.full(size, -1, dtype=np.int16)
        for number, layer in enumerate(layers):
            part, (rows, columns) = _window(layer, size)
            labels[rows, columns][part[:, :, 3] >= MIN_OPAQUE_ALPHA] = number
        counts = np.bincount(labels[labels >= 0], minlength=len(layers))
        whole = np.array([(layer.pixels[:, :, 3] >= MIN_OPAQUE_ALPHA).sum() for layer in layers])
        bad = (counts < LEAST_VISIBLE_PX) | (counts < LEAST_VISIBLE_SHARE * whole)
        if not bad.any():
            return labels, layers
        worst = int(np.argmin(np.where(bad, counts / np.maximum(whole, 1), np.inf)))
        layers = [layer for number, layer in enumerate(layers) if number != worst]


def _window(layer: _Layer, size: tuple[int, int]) -> tuple[Picture, tuple[slice, slice]]:
    """The part of a layer inside the image, and its place."""
    h, w = layer.pixels.shape[:2]
    top, left = max(-layer.y, 0), max(-layer.x, 0)
    bottom, right = max(min(h, size[0] - layer.y), top), max(min(w, size[1] - layer.x), left)
    place = slice(layer.y + top, layer.y + bottom), slice(layer.x + left, layer.x + right)
    return layer.pixels[top:bottom, left:right], place


def _paint(picture: NDArray[np.float32], layer: _Layer, generator: np.random.Generator) -> None:
    """Draw a layer into the image (H, W, 3) BGR, values 0 to 255, in place."""
    import cv2

    light = generator.uniform(*BRIGHTNESS) * generator.uniform(*TINT, 3)
    part, (rows, columns) = _window(layer, picture.shape[:2])
    opacity = part[:, :, 3].astype(np.float32) / 255
    if layer.border:
        # blurred inwards only: where the mask ends, nothing of the object is left to be seen
        opacity = np.minimum(opacity, cv2.GaussianBlur(opacity, (0, 0), layer.border, borderType=cv2.BORDER_REPLICATE))
    picture[rows, columns] += opacity[:, :, None] * (part[:, :, :3] * light.astype(np.float32) - picture[rows, columns])


def _reference(cutout: Cutout, pixels: Picture) -> int:
    """Pixels of the cut-out's kept image that its size is the size of."""
    return int(pixels.shape[0] if cutout.axis == "height" else max(pixels.shape[:2]))


@lru_cache(maxsize=KEPT_CUTOUTS)
def _pixels(file: Path) -> Picture:
    """(h, w, 4) BGRA of a cut-out within its tight box, at most KEPT_SIDE_PX long."""
    import cv2

    pixels = read_picture(file, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8:
        raise BadAnnotations.at(file, "cut-out", "an RGBA picture of 8 bits", "something else")
    rows, columns = (np.flatnonzero((pixels[:, :, 3] >= MIN_OPAQUE_ALPHA).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        raise BadAnnotations.at(file, "cut-out", "an opaque pixel", "none")
    tight = pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    factor = KEPT_SIDE_PX / max(tight.shape[:2])
    if factor < 1:
        size = (max(round(tight.shape[1] * factor), 1), max(round(tight.shape[0] * factor), 1))
        tight = cv2.resize(tight, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(tight)
