"""Streets whose sources the priors never saw: boxes of nuScenes, Waymo, nuPlan and ApolloScape, named as detected."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.methods import object_outcomes
from benchmarks.accuracy.outcomes import LEVEL, Outcome, outcome_of
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_tree.context import where_of
from metric_tree.tree import Tree

__all__ = ["MEASURED", "streets_outcomes"]

#: Sources of streets measured in place: none of them is in the tree that judges these streets.
MEASURED = (
    "nuscenes_mini", "waymo_motion_samples", "apolloscape_car_models", "published_class_means", "nuplan_samples",
    "interaction_ep0", "sind_tianjin", "ind_aachen_08", "ngsim_i80", "view_of_delft_example",
)  # fmt: skip
#: What a detector would call a set's categories; others are left out.
LABELS = {"pedestrian": "person", "bus": "bus", "truck": "truck", "bicycle": "bicycle", "motorcycle": "motorcycle",
          "traffic cone": "traffic cone"}  # fmt: skip
CARS = frozenset({"vehicle", "car", "SUV", "2x", "3x", "sedan", "hatchback", "coupe", "MPV"})
#: A vehicle that is longer or higher is no car, in mm.
LONGEST_CAR, HIGHEST_CAR = 5600.0, 2100.0
#: Scenes drawn of a set that does not say which objects stood together, and how many objects each has.
DRAWN, OBJECTS = 60, (3, 11)
#: Standard deviation of the log extents, stated and drawn.
NOISE = 0.05
#: What leaves a car's width out: the tables of nuScenes, Waymo and ApolloScape say that mirrors are in it or that it is
#: loose, and the width of the priors is the body's.
UNKNOWN_WIDTH = np.array([NOISE, 1.0, NOISE])
#: Where and when the streets are, as one would say it with `--where`.
WHERE = {"Boston": "US, 2018", "Singapore": "SG, 2018", "waymo": "US, 2020", "apolloscape": "CN, 2018"}

StreetObject = tuple[str, FloatArray]


def streets_outcomes(tables: Path, tree: Tree, seed: int) -> Iterator[Outcome]:
    """Every scene by `default`, also without the widths of cars and with where it is, and `height`; random scales."""
    generator = np.random.default_rng([seed, 47])
    for number, (group, members) in enumerate(_scenes(tables, generator)):
        scale = float(np.exp(generator.uniform(-3, 3)))
        objects = [
            MeasuredObject(
                str(row), label, sizes / 1000 / scale * np.exp(generator.normal(0, NOISE, 3)), np.full(3, NOISE)
            )
            for row, (label, sizes) in enumerate(members)
        ]
        yield from object_outcomes("streets", group, str(number), objects, scale, tree, ("default", "height"))
        bodies = [replace(one, sigma=UNKNOWN_WIDTH) if one.category == "car" else one for one in objects]
        bare = scale_of_objects(bodies, tree, EstimateOptions(level=LEVEL))
        yield outcome_of("streets", group, str(number), "default, no widths of cars", bare, scale)
        for place in (where_of(text) for word, text in WHERE.items() if word in group):
            there = scale_of_objects(objects, tree, EstimateOptions(level=LEVEL, where=place))
            yield outcome_of("streets", group, str(number), "default, with --where", there, scale)


def _scenes(tables: Path, generator: np.random.Generator) -> Iterator[tuple[str, list[StreetObject]]]:
    """A set's name and the objects of a scene: those of a drive where the set says so, else drawn from one city."""
    for name in ("waymo_motion_samples", "nuplan_samples"):
        drives: dict[str, list[StreetObject]] = defaultdict(list)
        for row, item in _objects_of(tables, name):
            drives[row["instance_or_n"].partition("/")[0]].append(item)
        yield from ((name, members) for _, members in sorted(drives.items()) if len(members) >= OBJECTS[0])
    nuscenes = list(_objects_of(tables, "nuscenes_mini"))
    pools = {
        f"nuscenes_mini, {city}": [item for row, item in nuscenes if row["region"] in (city, f"{city} USA")]
        for city in ("Boston", "Singapore")
    }
    pools |= {f"{name}, cars": [one for one in pool if one[0] == "car"] for name, pool in pools.items()}
    pools["apolloscape_car_models"] = [
        one for _, one in _objects_of(tables, "apolloscape_car_models") if one[0] == "car"
    ]
    for name, pool in pools.items():
        for _ in range(DRAWN):
            rows = generator.choice(len(pool), int(generator.integers(*OBJECTS)), replace=False)
            yield name, [pool[row] for row in rows]


def _objects_of(tables: Path, name: str) -> Iterator[tuple[dict[str, str], StreetObject]]:
    """The rows of a table with a label and all three sizes, length first, in mm."""
    with (tables / name / f"{name}.csv").open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            a, b, height = (float(row[f"{axis}_mm"] or "nan") for axis in ("length", "width", "height"))
            sizes = np.array([max(a, b), min(a, b), height])
            is_car = row["category"] in CARS and sizes[0] < LONGEST_CAR and height < HIGHEST_CAR
            label = "car" if is_car else LABELS.get(row["category"])
            if label is not None and np.all(sizes > 0):
                yield row, (label, sizes)
