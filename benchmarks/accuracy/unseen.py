"""Real rooms whose source the priors never saw: boxes of ScanNet against a tree that was built without any of it."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.accuracy.methods import object_outcomes
from benchmarks.accuracy.outcomes import Outcome
from estimator.records.measured_object import MeasuredObject
from metric_tree.build.steps import Options, build_release, shipped_taxonomy
from metric_tree.tree import Tree, open_tree
from tests.made.rooms.held_out import held_out_pool, pool_at
from tests.made.rooms.sizes import Sizes, drawn_sizes

__all__ = ["FAMILY", "unseen_outcomes", "unseen_tree"]

#: Sources that show the same rooms: none of them is in the tree that judges these rooms.
FAMILY = ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")
#: One fifth of the items is kept from the tree too: made rooms draw their sizes from it.
FOLD = (0, 5)
#: Rescans of a room repeat its objects.
FIRST_SCAN = "_00"
#: A room with fewer objects is no room.
LEAST_OBJECTS = 3
#: Boxes are aligned with the room, so a thing that is turned in it is too long and too wide; heights are good.
SIGMA = (0.1, 0.15, 0.05)


def unseen_tree(raw: Path, cache: Path) -> tuple[Tree, Sizes]:
    """A tree built without `FAMILY` and without one fold, and sizes drawn from that fold; both are kept in `cache`."""
    files = [
        path
        for path in sorted(raw.glob("*.jsonl"))
        if "quarantine" not in path.name and path.name.partition(".")[0] not in FAMILY and "pictures" not in path.name
    ]
    out = cache / "tree"
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        options = Options(version="0.0.0", created="2026-11-22", name="accuracy", fold_out=FOLD, heldout=False)
        build_release(files, out, options)
    tree = open_tree(out)
    pool = pool_at(cache / "sizes.json", partial(held_out_pool, files, tree, shipped_taxonomy, FOLD))
    return tree, drawn_sizes(pool)


def unseen_outcomes(file: Path, tree: Tree, rooms: int, seed: int) -> Iterator[Outcome]:
    """Rooms of a table of boxes, drawn at random, each under a random scale."""
    generator = np.random.default_rng([seed, 41])
    by_room = _rooms(file)
    names = sorted(by_room)
    for name in sorted(generator.choice(names, min(rooms, len(names)), replace=False).tolist()):
        scale = float(np.exp(generator.uniform(-3, 3)))
        objects = [
            MeasuredObject(str(row), category, _extents(sizes) / 1000 / scale, np.array(SIGMA))
            for row, (category, sizes) in enumerate(by_room[name])
        ]
        yield from object_outcomes("unseen", file.stem, name, objects, scale, tree, ("default", "height"))


def _rooms(file: Path) -> dict[str, list[tuple[str, list[float]]]]:
    """Category and length, width, height in mm of the objects of each room."""
    rooms: dict[str, list[tuple[str, list[float]]]] = defaultdict(list)
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            room = row["instance_or_n"].partition("/")[0]
            sizes = [float(row[f"{axis}_mm"] or "nan") for axis in ("length", "width", "height")]
            if room.endswith(FIRST_SCAN) and all(size > 0 for size in sizes):
                rooms[room].append((row["category"], sizes))
    return {name: things for name, things in rooms.items() if len(things) >= LEAST_OBJECTS}


def _extents(sizes: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(3,) the longer horizontal side first."""
    return np.array([max(sizes[:2]), min(sizes[:2]), sizes[2]])
