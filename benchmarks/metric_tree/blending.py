"""Poisson blending (OpenCV's seamlessClone) beside the export's soft borders: what becomes of the exact mask.

    python -m benchmarks.metric_tree.blending [--count 50]

Rendered things are pasted on made backgrounds. An exact mask asks that pixels inside it look like the thing and pixels
outside like the background: told by Lab distance to either, over the mask's rim of three pixels and over its inside.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_tree.training.composition import BORDERS_PX, random_background
from tests.synthetic.product_pictures import things

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Way = Callable[[Picture, Picture, NDArray[np.float32]], Picture]

#: Pictures as the export makes them, and the side that a thing is brought to.
SIZE, SIDE = (480, 640), 240
RIM = 3


def soft(sigma: float, thing: Picture, background: Picture, coverage: NDArray[np.float32]) -> Picture:
    """The export's way: opacity blurred inwards, then mixed."""
    opacity = coverage
    if sigma:
        opacity = np.minimum(coverage, cv2.GaussianBlur(coverage, (0, 0), sigma))
    mixed = background + opacity[..., None] * (thing.astype(np.float32) - background)
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def poisson(mode: int, thing: Picture, background: Picture, coverage: NDArray[np.float32]) -> Picture:
    """OpenCV's: the thing's gradients inside the mask, the background's values around it."""
    mask = coverage >= 0.5
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    crop, own = np.ascontiguousarray(thing[window]), np.ascontiguousarray(mask[window].astype(np.uint8) * 255)
    centre = int(columns[0] + crop.shape[1] // 2), int(rows[0] + crop.shape[0] // 2)
    return np.asarray(cv2.seamlessClone(crop, background, own, centre, mode))


WAYS: dict[str, Way] = {
    **{f"soft border, {sigma:g} px": partial(soft, sigma) for sigma in BORDERS_PX},
    "seamlessClone, normal": partial(poisson, cv2.NORMAL_CLONE),
    "seamlessClone, mixed": partial(poisson, cv2.MIXED_CLONE),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    figures: dict[str, list[tuple[float, ...]]] = {name: [] for name in WAYS}
    for number, thing in enumerate(things(arguments.count, seed=11)):
        generator = np.random.default_rng(number)
        background = random_background(SIZE, generator)
        picture, coverage = _placed(thing.colour[..., ::-1], thing.coverage, generator)
        for name, way in WAYS.items():
            figures[name].append(_figures(way, picture, background, coverage))
    columns = ("ms", "second call differs", "colour moved inside", "rim like background", "most change outside")
    print(f"| {' | '.join(('way', *columns))} |\n{'|---' * (len(columns) + 1)}|")
    for name, rows in figures.items():
        ms, differs, moved, rim, outside = np.mean(rows, axis=0)
        print(f"| {name} | {ms:.1f} | {differs:.0%} | {moved:.1f} | {rim:.0%} | {outside:.0f} |")


def _placed(
    colour: Picture, coverage: NDArray[np.float32], generator: np.random.Generator
) -> tuple[Picture, NDArray[np.float32]]:
    """The thing somewhere in an empty picture."""
    small = cv2.resize(np.ascontiguousarray(colour), (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    alpha = cv2.resize(coverage, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    top, left = (int(generator.integers(2, side - SIDE - 2)) for side in SIZE)
    picture, whole = np.zeros((*SIZE, 3), np.uint8), np.zeros(SIZE, np.float32)
    picture[top : top + SIDE, left : left + SIDE], whole[top : top + SIDE, left : left + SIDE] = small, alpha
    return picture, whole


def _figures(
    way: Way, thing: Picture, background: Picture, coverage: NDArray[np.float32]
) -> tuple[float, float, float, float, float]:
    started = time.process_time()
    found = way(thing, background, coverage)
    seconds = time.process_time() - started
    mask = coverage >= 0.5
    inside = cv2.erode(mask.astype(np.uint8), np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)) > 0
    to_thing, to_background = _distance(found, thing), _distance(found, background)
    rim = mask & ~inside
    beyond = ~(coverage > 0)
    return (
        1000 * seconds,
        float(not np.array_equal(found, way(thing, background, coverage))),
        float(to_thing[inside].mean()) if inside.any() else 0.0,
        float((to_background < to_thing)[rim].mean()),
        float(np.abs(found.astype(int) - background)[beyond].max()),
    )


def _distance(one: Picture, other: Picture) -> NDArray[np.float32]:
    """(H, W) Lab distance of two pictures."""
    lab = [cv2.cvtColor(np.float32(picture) / 255, cv2.COLOR_BGR2LAB) for picture in (one, other)]
    return np.asarray(np.linalg.norm(lab[0] - lab[1], axis=2), dtype=np.float32)


if __name__ == "__main__":
    main()
