"""Real rooms whose source the priors never saw: boxes of ScanNet against a tree that was built without any of it."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.accuracy.methods import object_outcomes
from benchmarks.accuracy.outcomes import Outcome
from estimator.posterior.axis_assignments import is_sorted, prior_axes
from estimator.records.objects import MeasuredObject
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import resolve_categories
from metric_base.arrays import FloatArray
from metric_tree.pipeline.build import BuildOptions, build_release, shipped_curated, shipped_taxonomy
from metric_tree.tree import Tree, open_tree
from tests.synthetic.rooms.held_out import held_out_pool, pool_at
from tests.synthetic.rooms.sizes import Sizes, drawn_sizes

__all__ = ["FAMILY", "SIGMA", "rooms_of", "sorted_extents", "tree_without", "unseen_outcomes", "unseen_tree"]

#: Sources that show the same rooms: none of them is in the tree that judges these rooms.
FAMILY = ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")
#: One fifth of the items is kept from the tree too: synthetic rooms draw their sizes from it.
FOLD = (0, 5)
#: Rescans of a room repeat its objects.
FIRST_SCAN = "_00"
#: A room with fewer objects is no room.
LEAST_OBJECTS = 3
#: Boxes are aligned with the room, so an object that is turned in it is too long and too wide; heights are good.
SIGMA = (0.1, 0.15, 0.05)


def unseen_tree(raw: Path, cache: Path) -> tuple[Tree, Sizes]:
    """A tree built without `FAMILY` and without one fold, and sizes drawn from that fold; both are kept in `cache`."""
    tree = tree_without(FAMILY, raw, cache / "tree")
    files = _files(raw, FAMILY)
    pool = pool_at(cache / "sizes.json", partial(held_out_pool, files, tree, shipped_taxonomy, FOLD))
    return tree, drawn_sizes(pool)


def tree_without(sources: Sequence[str], raw: Path, out: Path) -> Tree:
    """A tree built as the release is, norms and judged ranges with it, without some sources and without one fold."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        options = BuildOptions(version="0.0.0", created="2026-11-22", name="accuracy", fold_out=FOLD, heldout=False)
        build_release(_files(raw, sources), out, options, curated=shipped_curated())
    return open_tree(out)


def _files(raw: Path, left_out: Sequence[str]) -> list[Path]:
    """The files of raw items without those of some sources."""
    return [
        path
        for path in sorted(raw.glob("*.jsonl"))
        if "quarantine" not in path.name and path.name.partition(".")[0] not in left_out and "pictures" not in path.name
    ]


def unseen_outcomes(file: Path, tree: Tree, rooms: int, seed: int) -> Iterator[Outcome]:
    """Every second room of a table of boxes, or so many of these at random, each under a random scale."""
    generator = np.random.default_rng([seed, 41])
    by_room = rooms_of(file)
    names = sorted(by_room)
    offsets = _offsets([item for name in names[::2] for item in by_room[name]], tree)
    reported = names[1::2]
    for name in sorted(generator.choice(reported, min(rooms, len(reported)), replace=False).tolist()):
        scale = float(np.exp(generator.uniform(-3, 3)))
        objects = [
            MeasuredObject(str(row), category, sorted_extents(sizes) / 1000 / scale, np.array(SIGMA))
            for row, (category, sizes) in enumerate(by_room[name])
        ]
        yield from object_outcomes("unseen", file.stem, name, objects, scale, tree, ("default", "height"))
        moved = [
            replace(item, extents=item.extents * np.exp(-offsets.get(item.category, np.zeros(3)))) for item in objects
        ]
        for one in object_outcomes("unseen", file.stem, name, moved, scale, tree, ("default",)):
            yield replace(one, method="default, centred priors")
        yield from _pulls(name, objects, scale, tree)


def _pulls(name: str, objects: Sequence[MeasuredObject], scale: float, tree: Tree) -> Iterator[Outcome]:
    """What each object of a room states about the scale by itself, as the groups of the part `pulls`."""
    for item in scale_of_objects(objects, tree).objects:
        if item.scale is not None:
            error = float(np.log(item.scale / scale))
            yield Outcome("pulls", item.category, f"{name}/{item.id}", "alone", error, refused=False)


def _offsets(entries: Sequence[tuple[str, list[float]]], tree: Tree) -> dict[str, FloatArray]:
    """(3,) median of the log size less the prior's mean, by label, 0 on axes that the prior does not know."""
    by_label: dict[str, list[FloatArray]] = defaultdict(list)
    for label, sizes in entries:
        by_label[label].append(np.log(sorted_extents(sizes)))
    offsets = {}
    for label, meaning in resolve_categories(tree, set(by_label)).items():
        if meaning.prior is not None and not is_sorted(meaning.prior):
            axes, prior = prior_axes(meaning.prior), meaning.prior
            offsets[label] = np.zeros(3)
            offsets[label][axes] = np.median(by_label[label], axis=0)[axes] - prior.weights @ prior.means
    return offsets


def rooms_of(file: Path) -> dict[str, list[tuple[str, list[float]]]]:
    """Category and length, width, height in mm of the objects of each room."""
    rooms: dict[str, list[tuple[str, list[float]]]] = defaultdict(list)
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            room = row["instance_or_n"].partition("/")[0]
            sizes = [float(row[f"{axis}_mm"] or "nan") for axis in ("length", "width", "height")]
            if room.endswith(FIRST_SCAN) and all(size > 0 for size in sizes):
                rooms[room].append((row["category"], sizes))
    return {name: entries for name, entries in rooms.items() if len(entries) >= LEAST_OBJECTS}


def sorted_extents(sizes: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(3,) the longer horizontal side first."""
    return np.array([max(sizes[:2]), min(sizes[:2]), sizes[2]])
