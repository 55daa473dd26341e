"""Estimate the scale of synthetic scenes with random mistakes, and count right, refused and wrong results.

    python -m benchmarks.estimator.random_mistakes [--seed N] [--scenes N] [--cases N] [--only WORDS] [--json FILE]

Kind and size of each mistake are drawn (a shift of 2 to 15 %, a focal length 0.6 to 1.7 times the true one), so that
the checks meet mistakes that they were not written for. Scenes, by default seeds 500 to 519, are used nowhere else.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import metric_tree
from benchmarks.common import options_parser, print_rows
from benchmarks.estimator.mistake_cases import (
    METRES_PER_DEGREE,
    MISTAKES,
    RIGHT,
    Base,
    Case,
    box_of,
    camera_positions,
    coco_dataset,
    resized_masks,
)
from benchmarks.estimator.mistakes import OUTCOMES, outcome, plain, result_of, stated, synthetic_base
from estimator.evidence.camera_height import CameraHeight
from estimator.evidence.gps import VideoGps
from estimator.evidence.source import CameraPath
from estimator.records.result import ScaleEvidence
from estimator.telemetry.records import Positions
from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.rooms.kinds import KINDS

Draw = Callable[[Base, np.random.Generator], tuple[str, Case]]

#: Detector names of another list.
OTHER_NAMES = ("dog", "bicycle", "banana", "truck", "laptop", "toilet", "elephant", "spoon", "train", "bed", "horse")
#: Lengths in metres of units that are mistaken for metres.
UNITS_M = {"km": 1e3, "cm": 0.01, "mm": 1e-3, "feet": 0.3048, "inches": 0.0254, "yards": 0.9144}
#: Scales of models.
MODEL_RATIOS = (4.0, 8.0, 12.0, 18.0, 24.0, 43.0, 87.0)
#: Time in seconds between the images of a scene, as frames of a video.
FRAME_S = 0.5


def _changed(base: Base, change: Callable[[BoolArray], BoolArray]) -> Case:
    masks = [replace(mask, pixels=change(mask.pixels)) for mask in base.masks]
    return Case(base.scene, coco_dataset(base, masks=masks))


def crop(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Use masks of a random part of the images with their aspect ratio."""
    part, left, top = draw.uniform(0.6, 0.95), draw.uniform(), draw.uniform()

    def change(pixels: BoolArray) -> BoolArray:
        h, w = pixels.shape
        y, x = round(top * (1 - part) * h), round(left * (1 - part) * w)
        return pixels[y : y + round(part * h), x : x + round(part * w)]

    return f"{part:.2f}", _changed(base, change)


def shift(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Shift all masks by 2 to 15 % of the image."""
    width, height = base.size
    x, y = draw.choice([-1, 1], 2) * draw.uniform(0.02, 0.15, 2) * [width, height]

    def change(pixels: BoolArray) -> BoolArray:
        moved = np.roll(pixels, (round(y), round(x)), (0, 1))
        rows, columns = np.indices(pixels.shape)
        inside = (rows >= y) & (rows < height + y) & (columns >= x) & (columns < width + x)
        return np.asarray(moved & inside)

    return f"{x / width:.2f} {y / height:.2f}", _changed(base, change)


def resize(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Enlarge or shrink each mask about its centre."""
    factor = draw.uniform(0.5, 0.8) if draw.uniform() < 0.5 else draw.uniform(1.25, 1.7)
    return f"{factor:.2f}", _changed(base, resized_masks(factor))


def cut(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Keep one side of each mask."""
    part, side = draw.uniform(0.4, 0.7), draw.integers(4)

    def change(pixels: BoolArray) -> BoolArray:
        x, y, w, h = box_of(pixels)
        rows, columns = np.indices(pixels.shape)
        limits = (columns < x + part * w, columns > x + (1 - part) * w, rows < y + part * h, rows > y + (1 - part) * h)
        return np.asarray(pixels & limits[side])

    return f"{part:.2f} {('left', 'right', 'top', 'bottom')[side]}", _changed(base, change)


def images(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Assign masks to images some frames later, or exchange a block of images."""
    names = sorted({mask.image for mask in base.masks})
    if draw.uniform() < 0.5:
        steps = int(draw.integers(1, 6))
        order, words = names[steps:] + names[:steps], f"late {steps}"
    else:
        size = round(draw.uniform(0.3, 0.7) * len(names))
        first = int(draw.integers(0, len(names) - size + 1))
        order, words = names[:first] + names[first : first + size][::-1] + names[first + size :], f"block {size}"
    other = dict(zip(names, order, strict=True))
    return words, Case(base.scene, coco_dataset(base, masks=[replace(m, image=other[m.image]) for m in base.masks]))


def merge(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Merge each mask with the nearest other one in its image, for a part of the objects."""
    part = draw.uniform(0.3, 0.9)
    keys = sorted({str(mask.track) for mask in base.masks})
    chosen = {key for key in keys if draw.uniform() < part}
    merged = []
    for mask in base.masks:
        others = [other for other in base.masks if other.image == mask.image and other is not mask]
        if str(mask.track) in chosen and others:
            x, y, w, h = box_of(mask.pixels)
            boxes = np.array([box_of(other.pixels) for other in others])
            near = np.linalg.norm(boxes[:, :2] + boxes[:, 2:] / 2 - [x + w / 2, y + h / 2], axis=1).argmin()
            merged.append(replace(mask, pixels=mask.pixels | others[int(near)].pixels))
        else:
            merged.append(mask)
    return f"{part:.2f}", Case(base.scene, coco_dataset(base, masks=merged))


def labels(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Exchange, shift or replace the categories of all or of some objects."""
    names = sorted({mask.category for mask in base.masks})
    kind = draw.choice(["mixed", "shifted", "one", "other list", "objects"])
    if kind == "objects":
        keys = sorted({str(mask.track) for mask in base.masks})
        moved = {key for key in keys if draw.uniform() < 0.6}
        named = {key: str(draw.choice(names)) for key in moved}
        masks = [replace(mask, category=named.get(str(mask.track), mask.category)) for mask in base.masks]
        return kind, Case(base.scene, coco_dataset(base, masks=masks))
    steps = int(draw.integers(1, len(names)))
    order = {
        "mixed": list(draw.permutation(names)),
        "shifted": names[steps:] + names[:steps],
        "one": [str(draw.choice(names))] * len(names),
        "other list": [str(draw.choice(OTHER_NAMES)) for _ in names],
    }[str(kind)]
    other = dict(zip(names, order, strict=True))
    masks = [replace(mask, category=str(other[mask.category])) for mask in base.masks]
    return str(kind), Case(base.scene, coco_dataset(base, masks=masks))


def model(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Damage the reconstruction: focal length, principal point, size of the images, units, poses, or its shape."""
    scene, data = base.scene, coco_dataset(base)
    kind = str(draw.choice(["focal", "centre", "size", "points", "inverse", "stretched", "depth", "groups"]))
    factor = float(np.exp(draw.choice([-1, 1]) * draw.uniform(0.2, 0.55)))
    if kind == "groups":
        return "groups", MISTAKES["two models of different scale"](base)
    if kind == "points":
        return "points in mm", Case(replace(scene, points=1000 * scene.points), data)
    up = np.mean([-view.rotation[1] for view in scene.views], axis=0)
    axis = up if kind == "stretched" else np.mean([view.rotation[2] for view in scene.views], axis=0)
    axis /= np.linalg.norm(axis)
    stretch = np.eye(3) + (factor - 1) * np.outer(axis, axis) * (kind in {"stretched", "depth"})
    views = []
    for view in scene.views:
        camera, rotation, centre = view.camera, view.rotation, view.centre
        params = camera.params.copy()
        if kind in {"focal", "depth"}:
            params[: 2 if camera.model == "PINHOLE" else 1] *= factor
        if kind == "centre":
            params[-2:] = params[-2:][::-1]
        if kind == "size":
            camera = replace(camera, width=round(0.8 * camera.width), height=round(0.8 * camera.height))
        if kind == "inverse":
            rotation, centre = rotation.T, -rotation @ centre
        centre = stretch @ centre
        camera = replace(camera, params=params)
        views.append(replace(view, camera=camera, rotation=rotation, translation=-rotation @ centre))
    moved = replace(scene, views=tuple(views), points=scene.points @ stretch.T, dense=None)
    return f"{kind} {factor:.2f}", Case(moved, data)


def models(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Replace a part of the objects, or all, by models."""
    part, ratio = float(draw.choice([*draw.uniform(0.1, 0.9, 4), 1.0])), float(draw.choice(MODEL_RATIOS))
    return f"{part:.2f} 1:{ratio:.0f}", Case(base.scene, coco_dataset(base), models=part, model_ratio=ratio)


def _metres(base: Base) -> FloatArray:
    """Return the positions (n, 3) of the cameras in a local frame in metres."""
    lat, lon, alt = camera_positions(base).T
    across = METRES_PER_DEGREE * np.cos(np.radians(base.place[0]))
    return np.column_stack([(lon - lon[0]) * across, (lat - lat[0]) * METRES_PER_DEGREE, alt])


def positions(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Pass only positions, in another unit, stretched, in another order, of other images, or partly frozen."""
    table = _metres(base)
    kind = str(draw.choice([*UNITS_M, "Web Mercator", "stretched", "order", "late", "frozen", "reversed"]))
    if kind in UNITS_M:
        table = table / UNITS_M[kind]
    elif kind == "Web Mercator":
        latitude = draw.uniform(15, 65)
        y = 6_378_137.0 * np.arcsinh(np.tan(np.radians(latitude)))
        table = table / [np.cos(np.radians(latitude)), np.cos(np.radians(latitude)), 1] + [1.2e6, y, 0]
    elif kind == "stretched":
        table[:, draw.integers(3)] *= draw.uniform(1.2, 2.0)
    elif kind == "order":
        table = table[:, draw.permutation(3)] * [1, 1, -1]
    elif kind == "frozen":
        table[len(table) // 2 :] = table[len(table) // 2]
    else:
        table = np.roll(table, int(draw.integers(1, 6)), axis=0) if kind == "late" else table[::-1]
    names = [view.name for view in base.scene.views]
    rows = [(name, *row) for name, row in zip(names, table.tolist(), strict=True)]
    return kind, Case(base.scene, None, positions=rows, columns=("x", "y", "z"))


def track(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Pass only the positions of a video: reversed, doubled, halved or late times, or kilometres or millimetres."""
    times: FloatArray = FRAME_S * np.arange(len(base.scene.views), dtype=np.float64)
    path = CameraPath(times, np.array([view.centre for view in base.scene.views]))
    fine = np.arange(0, times[-1], 0.1)
    table = _metres(base)
    table = np.column_stack([np.interp(fine, times, column) for column in table.T])
    kind = str(draw.choice(["reversed", "doubled", "halved", "late", "km", "mm"]))
    if kind in UNITS_M:
        table = table / UNITS_M[kind]
    elif kind == "reversed":
        table = table[::-1]
    else:
        fine = {"doubled": 2 * fine, "halved": fine / 2, "late": fine + draw.uniform(1.0, 4.0)}[kind]
    return kind, Case(base.scene, None, sources=(VideoGps(Positions(fine, table, geodetic=False), path, "clip.mp4"),))


def contradicted(base: Base, draw: np.random.Generator) -> tuple[str, Case]:
    """Pass wrong evidence with the right masks: a known length, or the height of the cameras, in another unit."""
    factor = float(draw.choice([0.0254, 0.1, 0.3048, 2.54, 3.2808, 10.0, 100.0]))
    if draw.uniform() < 0.5:
        row = ScaleEvidence("known-length", "1", factor * base.metres_per_unit, 0.01, doubt=0.0)
        return f"length {factor:g}", Case(base.scene, coco_dataset(base), evidence=(row,))
    return f"height {factor:g}", Case(
        base.scene, coco_dataset(base), sources=(CameraHeight(1.5 * factor, 0.1 * factor),)
    )


#: Mistakes by class, with the number of cases of each in a round of 50.
CLASSES: dict[str, tuple[int, Draw]] = {
    "masks: cropped images": (3, crop),
    "masks: shifted": (3, shift),
    "masks: enlarged or shrunk": (4, resize),
    "masks: one side": (3, cut),
    "masks: other images": (4, images),
    "masks: two objects": (3, merge),
    "categories": (9, labels),
    "model": (8, model),
    "models among objects": (4, models),
    "positions": (4, positions),
    "positions of a video": (3, track),
    "wrong evidence with masks": (2, contradicted),
}


def run(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Return a row per case: scene, class, mistake and outcome."""
    tree, rows = metric_tree.open(), list[dict[str, Any]]()
    kinds = [*KINDS, "street"]
    for index in range(options.scenes):
        seed = options.seed + index
        base, draw = synthetic_base(kinds[index % len(kinds)], seed), np.random.default_rng(seed)
        right = [result_of(RIGHT[name](base), tree) for name in ("run lengths", "positions in metres")]
        usual = {line for result in right if not isinstance(result, str) for line in map(plain, stated(result))}
        rows += [_row(base, "no mistake", "", outcome(base, result, usual)) for result in right]
        kinds_of_cases = [name for name, (count, _) in CLASSES.items() for _ in range(count)]
        for number in range(options.cases):
            name = kinds_of_cases[number % len(kinds_of_cases)]
            words, case = CLASSES[name][1](base, draw)  # also of other classes: the draws are the same
            if options.only not in name:
                continue
            rows.append(_row(base, name, words, outcome(base, result_of(case, tree), usual)))
        print(base.name, dict(Counter(row["outcome"] for row in rows)), file=sys.stderr, flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


def _row(base: Base, name: str, words: str, cell: dict[str, Any]) -> dict[str, Any]:
    return {"scene": base.name, "class": name, "mistake": words} | cell


def table(rows: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    """Return the counts of the outcomes by class, and the number of wrong results that are `resolved`."""
    lines: list[tuple[object, ...]] = []
    damaged = [row for row in rows if row["class"] != "no mistake"]
    for name in ("no mistake", *CLASSES, "all mistakes"):
        part = damaged if name == "all mistakes" else [row for row in rows if row["class"] == name]
        counts = Counter(row["outcome"] for row in part)
        resolved = sum(row["outcome"].startswith("wrong") and row.get("status") == "resolved" for row in part)
        lines.append((name, len(part), *(counts[outcome] for outcome in OUTCOMES), resolved))
    return lines


def main() -> None:
    """Run the benchmark and print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("--seed", type=int, default=500, metavar="N", help="seed of the first scene")
    parser.add_argument("--scenes", type=int, default=20, metavar="N")
    parser.add_argument("--cases", type=int, default=50, metavar="N", help="cases per scene")
    parser.add_argument("--only", default="", metavar="WORDS", help="run only classes with these words in the name")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the cases to this file")
    rows = table(run(parser.parse_args()))
    print_rows(("mistake", "cases", *OUTCOMES, "wrong and resolved"), rows)


if __name__ == "__main__":
    main()
