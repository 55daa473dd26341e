"""Evaluate real rooms of an unseen source: boxes of ScanNet with a tree that was built without ScanNet."""

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

#: Sources with the same rooms. The tree that evaluates these rooms is built without them.
FAMILY = ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")
#: Fold of the items (index, number of folds) that the tree is built without. Synthetic rooms draw their sizes from it.
FOLD = (0, 5)
#: Suffix of the first scan of a room; rescans contain the same objects and are skipped.
FIRST_SCAN = "_00"
#: Minimum number of objects of a room.
MIN_OBJECTS = 3
#: Standard deviations of log length, width and height. Boxes are aligned with the room, so the length and width of a
#: rotated object are too large; heights are accurate.
SIGMA = (0.1, 0.15, 0.05)


def unseen_tree(raw: Path, cache: Path) -> tuple[Tree, Sizes]:
    """Return a tree built without `FAMILY` and one fold, and sizes drawn from that fold. Both are stored in `cache`."""
    tree = tree_without(FAMILY, raw, cache / "tree")
    files = _files(raw, FAMILY)
    pool = pool_at(cache / "sizes.json", partial(held_out_pool, files, tree, shipped_taxonomy, FOLD))
    return tree, drawn_sizes(pool)


def tree_without(sources: Sequence[str], raw: Path, out: Path) -> Tree:
    """Build a tree like the release (with norms and judged ranges) without some sources and without one fold."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        options = BuildOptions(version="0.0.0", created="2026-11-22", name="accuracy", fold_out=FOLD, heldout=False)
        build_release(_files(raw, sources), out, options, curated=shipped_curated())
    return open_tree(out)


def _files(raw: Path, excluded: Sequence[str]) -> list[Path]:
    """Return the files of raw items without some sources."""
    return [
        path
        for path in sorted([*raw.glob("*.jsonl"), *raw.glob("*.jsonl.gz")])
        if "quarantine" not in path.name and path.name.partition(".")[0] not in excluded and "pictures" not in path.name
    ]


def unseen_outcomes(file: Path, tree: Tree, rooms: int, seed: int) -> Iterator[Outcome]:
    """Yield outcomes for up to `rooms` random ones of every second room of a table of boxes, each at a random scale."""
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
        for outcome in object_outcomes("unseen", file.stem, name, moved, scale, tree, ("default",)):
            yield replace(outcome, method="default, centred priors")
        # the scale that each object implies, in the groups of the part `pulls`
        for result in scale_of_objects(objects, tree).objects:
            if result.scale is not None:
                error = float(np.log(result.scale / scale))
                yield Outcome("pulls", result.category, f"{name}/{result.id}", "alone", error, refused=False)


def _offsets(entries: Sequence[tuple[str, list[float]]], tree: Tree) -> dict[str, FloatArray]:
    """Return the median log size minus the prior's mean (3,) by label, 0 on axes without a prior."""
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
    """Return category and (length, width, height) in mm of the objects of each room."""
    rooms: dict[str, list[tuple[str, list[float]]]] = defaultdict(list)
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            room = row["instance_or_n"].partition("/")[0]
            sizes = [float(row[f"{axis}_mm"] or "nan") for axis in ("length", "width", "height")]
            if room.endswith(FIRST_SCAN) and all(size > 0 for size in sizes):
                rooms[room].append((row["category"], sizes))
    return {name: entries for name, entries in rooms.items() if len(entries) >= MIN_OBJECTS}


def sorted_extents(sizes: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the sizes (3,) with the longer horizontal side first."""
    return np.array([max(sizes[:2]), min(sizes[:2]), sizes[2]])
