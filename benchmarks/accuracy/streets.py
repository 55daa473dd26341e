"""Evaluate streets of unseen sources: boxes of nuScenes, Waymo, nuPlan and ApolloScape with detector labels."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterator
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

#: Sources with street objects measured on site. The tree that evaluates these streets is built without them.
MEASURED = (
    "nuscenes_mini", "waymo_motion_samples", "apolloscape_car_models", "published_class_means", "nuplan_samples",
    "interaction_ep0", "sind_tianjin", "ind_aachen_08", "ngsim_i80", "view_of_delft_example",
)  # fmt: skip
#: Detector labels of the categories of the data sets; other categories are skipped.
LABELS = {"pedestrian": "person", "bus": "bus", "truck": "truck", "bicycle": "bicycle", "motorcycle": "motorcycle",
          "traffic cone": "traffic cone"}  # fmt: skip
CARS = frozenset({"vehicle", "car", "SUV", "2x", "3x", "sedan", "hatchback", "coupe", "MPV"})
#: Maximum length and height of a car in mm; larger vehicles are skipped.
MAX_CAR_LENGTH_MM = 5600.0
MAX_CAR_HEIGHT_MM = 2100.0
#: Number of scenes drawn from a data set that does not group objects by drive.
N_DRAWN_SCENES = 60
#: Minimum number of objects per scene, and the end (exclusive) of the number in a drawn scene.
OBJECTS = (3, 11)
#: Standard deviation of the log extents, both stated and simulated.
NOISE = 0.05
#: Region and year of the streets in the syntax of `--where`, by a part of the group's name.
WHERE = {"Boston": "US, 2018", "Singapore": "SG, 2018", "waymo": "US, 2020", "apolloscape": "CN, 2018"}

StreetObject = tuple[str, FloatArray]


def streets_outcomes(tables: Path, tree: Tree, seed: int) -> Iterator[Outcome]:
    """Yield the outcomes of `default` and `height` on every scene at a random scale.

    `default` is also evaluated with the region and year of the scene.
    """
    generator = np.random.default_rng([seed, 47])
    for index, (group, members) in enumerate(_scenes(tables, generator)):
        scale = float(np.exp(generator.uniform(-3, 3)))
        objects = [
            MeasuredObject(
                str(row), label, sizes / 1000 / scale * np.exp(generator.normal(0, NOISE, 3)), np.full(3, NOISE)
            )
            for row, (label, sizes) in enumerate(members)
        ]
        yield from object_outcomes("streets", group, str(index), objects, scale, tree, ("default", "height"))
        for where in (where_of(text) for word, text in WHERE.items() if word in group):
            local = scale_of_objects(objects, tree, EstimateOptions(level=LEVEL, where=where))
            yield outcome_of("streets", group, str(index), "default, with --where", local, scale)


def _scenes(tables: Path, generator: np.random.Generator) -> Iterator[tuple[str, list[StreetObject]]]:
    """Yield the group's name and the objects of a scene: of a drive if the set has drives, or drawn from one city."""
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
    pools |= {f"{name}, cars": [item for item in pool if item[0] == "car"] for name, pool in pools.items()}
    pools["apolloscape_car_models"] = [
        item for _, item in _objects_of(tables, "apolloscape_car_models") if item[0] == "car"
    ]
    for name, pool in pools.items():
        for _ in range(N_DRAWN_SCENES):
            rows = generator.choice(len(pool), int(generator.integers(*OBJECTS)), replace=False)
            yield name, [pool[row] for row in rows]


def _objects_of(tables: Path, name: str) -> Iterator[tuple[dict[str, str], StreetObject]]:
    """Yield the rows of a table that have a label and all three sizes (length, width, height in mm)."""
    with (tables / name / f"{name}.csv").open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            a, b, height = (float(row[f"{axis}_mm"] or "nan") for axis in ("length", "width", "height"))
            sizes = np.array([max(a, b), min(a, b), height])
            is_car = row["category"] in CARS and sizes[0] < MAX_CAR_LENGTH_MM and height < MAX_CAR_HEIGHT_MM
            label = "car" if is_car else LABELS.get(row["category"])
            if label is not None and np.all(sizes > 0):
                yield row, (label, sizes)
