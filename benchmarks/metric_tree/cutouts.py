"""Mask quality and speed of the backend without weights, beside its parts and bare grabCut, on rendered pictures.

python -m benchmarks.metric_tree.cutouts --count 200            # per kind of background
python -m benchmarks.metric_tree.cutouts --model u2net.onnx     # a network as well, where its weights are at hand:
our backend,
                                                    # `auto` with it, and bare rembg as its README calls it
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from metric_tree.cutouts.backend import RGB, Auto, Foreground
from metric_tree.cutouts.network import Network
from metric_tree.cutouts.plain import Plain
from metric_tree.cutouts.quality import assessment
from tests.synthetic.product_pictures import KINDS, ProductPicture, pictured, things

__all__ = ["Score", "intersection_over_union", "scores"]

#: Seed of the pictures that are reported; the backend was shaped on pictures of seed 7.
SEED = 2026

#: Bare grabCut is slow, and every fourth thing tells its mean well enough.
BARE_EVERY = 4

_Way = Callable[[RGB], Foreground]


@dataclass(slots=True)
class Score:
    """Of one way on one kind: IoU of all it cut, of what the quality check kept, pictures refused, seconds."""

    iou: list[float] = field(default_factory=list)
    kept: list[float] = field(default_factory=list)
    refused: int = 0
    aside: int = 0
    seconds: float = 0.0
    pictures: int = 0

    def row(self) -> dict[str, float | int | None]:
        """What is printed: medians and tails of IoU, counts, pictures per second of one core."""
        return {
            "pictures": self.pictures,
            "refused": self.refused,
            "set_aside": self.aside,
            "iou_mean": _round(np.mean(self.iou)) if self.iou else None,
            "iou_median": _round(np.median(self.iou)) if self.iou else None,
            "iou_p10": _round(np.quantile(self.iou, 0.1)) if self.iou else None,
            "share_over_0.9": _round(np.mean(np.array(self.iou) > 0.9)) if self.iou else None,
            "iou_mean_kept": _round(np.mean(self.kept)) if self.kept else None,
            "per_second": _round(self.pictures / self.seconds),
        }


def intersection_over_union(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
    """Intersection over union of two masks of one shape."""
    return float(np.count_nonzero(found & true) / max(1, np.count_nonzero(found | true)))


def scores(count: int, ways: Mapping[str, _Way], seed: int = SEED) -> dict[tuple[str, str], Score]:
    """Score of each kind of background and way of cutting, over `count` rendered things."""
    found = {(kind, way): Score() for kind in KINDS for way in ways}
    for number, thing in enumerate(things(count, seed)):
        for place, kind in enumerate(KINDS):
            picture = pictured(thing, kind, np.random.default_rng((seed, number, place)))
            for way, foreground in ways.items():
                if way != "bare grabCut" or number % BARE_EVERY == 0:
                    _add(found[kind, way], picture, foreground)
    return found


def bare_grabcut(picture: RGB) -> Foreground:
    """OpenCV's grabCut as a user would call it first: a frame of 3 %, five rounds, nothing else."""
    height, width = picture.shape[:2]
    state = np.zeros((height, width), np.uint8)
    inset = (round(0.03 * width), round(0.03 * height))
    frame = (*inset, width - 2 * inset[0], height - 2 * inset[1])
    cv2.setRNGSeed(0)
    bgr = np.ascontiguousarray(picture[..., ::-1])
    cv2.grabCut(bgr, state, frame, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_RECT)
    return Foreground(np.isin(state, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8) * 255, "grabcut")


def bare_rembg(session: Any, picture: RGB) -> Foreground:
    """The library as its README calls it: a picture in, the cut-out with its alpha out, by the same network."""
    import rembg

    with np.errstate(invalid="ignore"):  # a blank picture gives 0 / 0
        cut = rembg.remove(Image.fromarray(picture), session=session)
    return Foreground(np.asarray(cut.getchannel("A"), np.uint8), "rembg")


def _add(score: Score, picture: ProductPicture, foreground: _Way) -> None:
    start = time.process_time()
    found = foreground(picture.pixels)
    score.seconds += time.process_time() - start
    score.pictures += 1
    if found.refused:
        score.refused += 1
        return
    score.iou.append(intersection_over_union(found.alpha >= 128, picture.mask))
    if assessment(picture.pixels, found.alpha).reason:
        score.aside += 1
    else:
        score.kept.append(score.iou[-1])


def _round(value: float | np.floating) -> float:
    return round(float(value), 3)


def main() -> None:
    """Print the scores as JSON, one line for a kind and a way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="things, each before every kind of background")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--model", help="a network too: a model's name or an ONNX file, its weights at hand")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    ways: dict[str, _Way] = {
        "plain": Plain().foreground,
        "plain without grabCut": Plain(refined=False).foreground,
        "bare grabCut": bare_grabcut,
    }
    if arguments.model:
        network = Network.load(arguments.model)
        ways[network.method] = network.foreground
        ways[f"auto with {network.method}"] = Auto(Plain(), network).foreground
        ways["bare rembg"] = partial(bare_rembg, network.session)
    for (kind, way), score in scores(arguments.count, ways, arguments.seed).items():
        print(json.dumps({"background": kind, "way": way, **score.row()}))


if __name__ == "__main__":
    main()
