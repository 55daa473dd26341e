"""What the three statuses are worth: of each, the share that is off by more than 15 %, by where it was measured.

`OMP_NUM_THREADS=1 python -m benchmarks.estimator.statuses --raw RAW --cache DIR`. Boxes of ScanNet's
rooms, whole and 1, 2, 3 or 5 objects of them at random, against a tree without ScanNet (`benchmarks.accuracy.unseen`);
simulated scenes of one or two classes. The limit was chosen on the simulations and the even rooms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import metric_tree
from benchmarks.accuracy.unseen import SIGMA, rooms_of, sorted_extents, unseen_tree
from benchmarks.common import SHARED, options_parser
from benchmarks.estimator.simulation import Knobs, simulated, world
from estimator.posterior import posterior as posterior_module
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import Estimate, posterior
from estimator.records.objects import MeasuredObject
from estimator.results.object_priors import object_evidence, resolve_categories
from metric_tree.tree import Tree

BOXES = SHARED / "sizes" / "scannet18_boxes" / "scannet18_boxes.csv"
LIMITS = (0.3, 0.35, 0.4, 0.45, 0.5)
SUBSETS = (None, 1, 2, 3, 5)
#: How far labels are off: right, and two mistakes of a table of names.
SHIFTS = (0, 1, 3)
CELLS = ((1, 1), (2, 1), (2, 2), (3, 1), (3, 2), (5, 1), (5, 2), (10, 1), (10, 2))
SCENES, SHARES = 150, (None, 0.0, 0.6)

#: Where it was measured, objects taken of a room, the estimate, the true log scale.
Row = tuple[str, int | None, Estimate, float]


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--raw", type=Path, required=True, help="folder of raw items")
    parser.add_argument("--cache", type=Path, required=True, help="what is built of them")
    arguments = parser.parse_args()
    tree, _ = unseen_tree(arguments.raw, arguments.cache)
    _contradicted_table(tree)
    rows = [*_rooms(tree), *_simulations()]
    parts = {name: [row for row in rows if row[0] == name] for name in ("simulated", "even rooms", "odd rooms")}
    print("| unresolved under a mass near the mode of | " + " | ".join(parts) + " |\n|---" + "|---" * 3 + "|")
    shipped = posterior_module.MIN_PEAK_MASS
    for limit in LIMITS:
        posterior_module.MIN_PEAK_MASS = limit
        print(f"| {limit} | " + " | ".join(_share(_of(own, "unresolved")) for own in parts.values()) + " |")
    posterior_module.MIN_PEAK_MASS = shipped
    print("\n| odd rooms | status | off by more than 15 % | error, median | mean | coverage |\n|---" + "|---" * 5 + "|")
    for count in SUBSETS:
        of_count = [row for row in parts["odd rooms"] if row[1] == count]
        for name in ("resolved", "uncertain", "unresolved"):
            print(f"| {count or 'all'} objects | {name} | " + _figures(_of(of_count, name)) + " |")


def _contradicted_table(tree: Tree) -> None:
    """Odd rooms, and 3 and 5 objects of them, of which most objects are outliers: what the widened posterior says."""
    print("| labels | most are outliers | unresolved, off by over 15 % | uncertain, off | coverage | not widened |")
    print("|---|---|---|---|---|---|")
    for shift in SHIFTS:
        runs = []
        for power in (1.0, posterior_module.TEMPERING_EXPONENT):
            posterior_module.TEMPERING_EXPONENT = power
            runs.append([row for row in _rooms(tree, (None, 3, 5), shift) if row[0] == "odd rooms"])
        pairs = [pair for pair in zip(*runs, strict=True) if posterior_module.mostly_outliers(pair[0][2].weight)]
        # those that would be unresolved anyhow say nothing of this
        pairs = [(plain, wide) for plain, wide in pairs if plain[2].status != "unresolved"]
        wide = [wide for _, wide in pairs]
        label = f"of the list {shift} further" if shift else "right"
        refused, rest = _of(wide, "unresolved"), _of(wide, "uncertain")
        held = [np.mean([_holds(row) for row in own]) for own in (wide, [plain for plain, _ in pairs])]
        print(
            f"| {label} | {len(wide) / len(runs[0]):.1%} | {_share(refused)} | {_share(rest)} "
            f"| {held[0]:.2f} | {held[1]:.2f} |"
        )
    print()


def _holds(row: Row) -> bool:
    """Whether the interval holds the truth."""
    low, high = row[2].interval
    return low <= math.exp(row[3]) <= high


def _rooms(tree: Tree, subsets: Sequence[int | None] = SUBSETS, shift: int = 0) -> Iterator[Row]:
    """Rooms and so many of their objects; `shift` : each label is that which stands so far on in the list of all."""
    by_room, generator = rooms_of(BOXES), np.random.default_rng(1)
    labels = sorted({category for objects in by_room.values() for category, _ in objects})
    label = {name: labels[(number + shift) % len(labels)] for number, name in enumerate(labels)}
    by_name = resolve_categories(tree, {category for entries in by_room.values() for category, _ in entries})
    for number, (_, entries) in enumerate(sorted(by_room.items())):
        scale = float(np.exp(generator.uniform(-3, 3)))
        objects = [
            MeasuredObject(str(row), label[category], sorted_extents(sizes) / 1000 / scale, np.array(SIGMA))
            for row, (category, sizes) in enumerate(entries)
        ]
        for count in subsets:
            take = min(count or len(objects), len(objects))
            some = [objects[row] for row in generator.choice(len(objects), take, replace=False)]
            objects_used = object_evidence(some, by_name).objects
            if objects_used:
                half = "odd rooms" if number % 2 else "even rooms"
                yield half, count, posterior(objects_used), float(np.log(scale))


def _simulations() -> Iterator[Row]:
    classes = world(metric_tree.open(), baselines=False)
    for shared in SHARES:
        for count, kinds in CELLS:
            knobs = Knobs(objects=count, classes=kinds, shared=shared, cut=0.2, wrong=0.1, noise=0.06)
            for number in range(SCENES):
                scale, objects = simulated(classes, knobs, np.random.default_rng([7, number, count, kinds]))
                items = [ObjectEvidence(one, classes.priors[said], classes.nodes[said].pose) for said, one in objects]
                yield "simulated", None, posterior(items), float(np.log(scale))


def _of(rows: Sequence[Row], wanted: str) -> list[Row]:
    return [
        row
        for row in rows
        if posterior_module.status_reason(row[2].modes, row[2].interval, row[2].curve, row[2].weight)[0] == wanted
    ]


def _errors(rows: Sequence[Row]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([abs(np.expm1(np.log(one.modes[0].scale) - true)) for _, _, one, true in rows])


def _share(rows: Sequence[Row]) -> str:
    return f"{np.mean(_errors(rows) > posterior_module.PEAK_WIDTH_RATIO - 1):.0%} of {len(rows)}" if rows else "none"


def _figures(rows: Sequence[Row]) -> str:
    if not rows:
        return "none | | |"
    errors = _errors(rows)
    held = np.mean([_holds(row) for row in rows])
    return f"{_share(rows)} | {np.median(errors):.1%} | {errors.mean():.1%} | {held:.2f}"


if __name__ == "__main__":
    main()
