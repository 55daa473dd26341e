"""Product pictures with exact masks: rendered objects before plain, gradient, shadowed and cluttered backgrounds.

The masks come from the renderer at twice the size; a pixel is foreground where half of it or more shows the object.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.shapes import CATEGORIES, solid
from tests.synthetic.rooms.solids import box
from tests.synthetic.rooms.world import Pinhole, Placed, World, pose_towards

__all__ = ["KINDS", "PicturedObject", "ProductPicture", "objects", "pictured"]

KINDS = ("plain", "gradient", "shadowed", "cluttered")

#: Side of a picture in pixels; it is rendered at twice that.
SIDE = 400

#: Categories that are not photographed as products.
_NO_PRODUCTS = frozenset({"person", "car", "truck", "bus", "stop sign"})

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class PicturedObject:
    """A rendered object: colour (s, s, 3) uint8, coverage (s, s) float 0 to 1."""

    category: str
    size_mm: tuple[float, float, float]
    colour: Image
    coverage: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class ProductPicture:
    """A picture after JPEG, and its exact mask."""

    kind: str
    category: str
    pixels: Image
    mask: NDArray[np.bool_]


def objects(count: int, seed: int, side: int = SIDE) -> Iterator[PicturedObject]:
    """Rendered objects, every category in turn, each seen as a shop shows it: from before, a little from above."""
    names = sorted(set(CATEGORIES) - _NO_PRODUCTS)
    for number in range(count):
        generator = np.random.default_rng((seed, number))
        yield _object(names[number % len(names)], generator, side)


def pictured(item: PicturedObject, kind: str, generator: np.random.Generator) -> ProductPicture:
    """An object before a background of a kind, with a camera's noise, through JPEG at a shop's quality."""
    scenery = {"plain": _plain, "gradient": _gradient, "shadowed": _shadowed, "cluttered": _cluttered}[kind]
    behind = scenery(item, generator)
    alpha = item.coverage[..., None]
    mixed = item.colour * alpha + behind * (1 - alpha) + generator.normal(0, 0.8, item.colour.shape)
    clean = np.clip(mixed, 0, 255).astype(np.uint8)
    quality = int(generator.integers(78, 96))
    _, body = cv2.imencode(".jpg", np.ascontiguousarray(clean[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality])
    pixels = np.ascontiguousarray(np.asarray(cv2.imdecode(body, cv2.IMREAD_COLOR))[..., ::-1])
    return ProductPicture(kind, item.category, pixels, item.coverage >= 0.5)


def _object(category: str, generator: np.random.Generator, side: int) -> PicturedObject:
    size = np.exp(generator.normal(0, 0.25, 3)) * [1.0, 0.7, 0.8]
    mesh = solid(category, size)
    azimuth = generator.uniform(-0.9, 0.9) - np.pi / 2
    raised = generator.uniform(0.1, 0.5)
    distance = 3.2 * float(np.linalg.norm(size))
    target = np.array([0.0, 0.0, size[2] / 2])
    eye = target + distance * np.array(
        [np.cos(azimuth) * np.cos(raised), np.sin(azimuth) * np.cos(raised), np.sin(raised)]
    )
    focal = 2 * side * generator.uniform(1.9, 2.6)
    studio = box((-50, 50), (-50, 50), (-50, 50), "white")  # bare, so that what is not the object has number 0
    world = World(
        "product",
        int(generator.integers(1 << 30)),
        (Placed("1", category, category, size, mesh),),
        studio,
        (pose_towards(eye, target),),
        Pinhole(2 * side, 2 * side, focal),
    )
    with Renderer(world, texture=float(generator.uniform(0.1, 0.8))) as renderer:
        frame = renderer.frame(0)
    assert frame.colour is not None  # asked for
    inside = frame.ids > 0
    sure = cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)  # without the clear colour
    weight = cv2.blur(sure, (5, 5))
    spread = cv2.blur(frame.colour.astype(np.float32) * sure[..., None], (5, 5)) / np.maximum(weight, 1e-6)[..., None]
    whole = np.where(sure[..., None] > 0, frame.colour, spread)
    coverage = cv2.resize(inside.astype(np.float32), (side, side), interpolation=cv2.INTER_AREA)
    colour = cv2.resize(whole * inside[..., None], (side, side), interpolation=cv2.INTER_AREA)
    colour = colour / np.maximum(coverage, 1e-6)[..., None]
    sizes = tuple(float(1000 * one) for one in size)
    return PicturedObject(category, (sizes[0], sizes[1], sizes[2]), np.clip(colour, 0, 255).astype(np.uint8), coverage)


def _plain(item: PicturedObject, generator: np.random.Generator) -> NDArray[np.float64]:
    """Two in three white, else a light or saturated paper."""
    if generator.random() < 2 / 3:
        colour = np.full(3, generator.choice([255.0, 254.0, 250.0, 245.0]))
    else:
        colour = generator.uniform(90, 245, 3)
    return np.broadcast_to(colour, item.colour.shape).astype(float)


def _gradient(item: PicturedObject, generator: np.random.Generator) -> NDArray[np.float64]:
    """Light that falls off along a line, or from a centre as a lamp's does."""
    side = item.coverage.shape[0]
    y, x = np.mgrid[:side, :side] / side - 0.5
    angle = generator.uniform(0, 2 * np.pi)
    along = x * np.cos(angle) + y * np.sin(angle) + 0.5
    radial = 1.4 * np.hypot(x - generator.uniform(-0.2, 0.2), y - generator.uniform(-0.2, 0.2))
    fall = generator.uniform(15, 60)
    light = generator.uniform(225, 255) - fall * (along if generator.random() < 0.5 else radial)
    tint = 1 - np.abs(generator.normal(0, 0.02, 3))
    return np.asarray(light[..., None] * tint)


def _shadowed(item: PicturedObject, generator: np.random.Generator) -> NDArray[np.float64]:
    """White paper, the object's shadow laid down to one side, and a dark contact beneath it."""
    side = item.coverage.shape[0]
    rows = np.flatnonzero((item.coverage >= 0.5).any(axis=1))
    foot = float(rows[-1]) if len(rows) else side * 0.8
    lean, flat = generator.uniform(-0.9, 0.9), generator.uniform(0.15, 0.35)
    warp = np.array([[1, -lean * flat, lean * flat * foot], [0, flat, foot * (1 - flat)]])
    cast = cv2.warpAffine(item.coverage, warp, (side, side))
    soft = cv2.GaussianBlur(cast, (0, 0), generator.uniform(4, 12))
    below = cv2.warpAffine(item.coverage, np.array([[1.0, 0, 0], [0, 0.06, foot * 0.94 + 3]]), (side, side))
    contact = cv2.GaussianBlur(below, (0, 0), 3)
    dark = 1 - generator.uniform(0.15, 0.4) * soft - 0.2 * contact
    return np.asarray(_plain_white(generator) * np.clip(dark, 0.2, 1)[..., None] * np.ones(3))


def _plain_white(generator: np.random.Generator) -> float:
    return float(generator.choice([255.0, 252.0, 246.0]))


def _cluttered(item: PicturedObject, generator: np.random.Generator) -> NDArray[np.float64]:
    """A textured wall and floor, and patches of other objects."""
    side = item.coverage.shape[0]
    scene = np.empty((side, side, 3))
    horizon = int(side * generator.uniform(0.4, 0.75))
    scene[:horizon], scene[horizon:] = generator.uniform(90, 230, 3), generator.uniform(60, 190, 3)
    for grain, strength in ((2, 10), (9, 18), (35, 25)):
        coarse = generator.normal(0, strength, (side // grain + 2, side // grain + 2)).astype(np.float32)
        scene += cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)[..., None]
    canvas = np.ascontiguousarray(scene, dtype=np.float32)
    for _ in range(int(generator.integers(8, 20))):
        centre, reach = generator.uniform(0, side, 2), generator.uniform(15, 90)
        corners = (centre + reach * generator.normal(0, 0.7, (int(generator.integers(3, 7)), 2))).astype(np.int32)
        cv2.fillConvexPoly(canvas, cv2.convexHull(corners), tuple(float(c) for c in generator.uniform(20, 240, 3)))
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), generator.uniform(0.5, 2.5)), dtype=float)
