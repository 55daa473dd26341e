"""Priors of thirteen things before and after, with the medians that were measured in the world beside them.

    python -m benchmarks.metric_tree.world_sizes ../shared/data/sizes 1.0.0 2.0.0

The world's median of an axis is the median over sets of the medians within a set (means and norms as they are stated);
sets that draw boxes along the room's axes count for heights alone, boxes of lidar for no width (mirrors, slack). The
sets are part of the fit of release 2.0.0: the table shows what the fit made of them, and is no test of it.
"""

from __future__ import annotations

import argparse
import csv
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from metric_base.terminal import print_table
from metric_tree.axes import AXES
from metric_tree.tree import Node, open_tree

#: Things, and what the sets call them.
THINGS: Mapping[str, tuple[str, ...]] = {
    "person": ("pedestrian", "man", "woman"),
    "car": ("car",),
    "chair": ("chair", "dining chair", "office chair"),
    "desk": ("desk",),
    "bed": ("bed",),
    "door": ("door", "interior door"),
    "bicycle": ("bicycle",),
    "mug": ("mug", "cup"),
    "bottle": ("bottle",),
    "traffic light": ("traffic light",),
    "stop sign": ("stop sign",),
    "mirror": ("mirror",),
    "window": ("window",),
}

#: Sets whose boxes follow the axes of a room: heights alone.
HEIGHTS = frozenset({"scannet18_boxes", "scannet_fine_boxes", "3rscan_boxes"})

#: Sets whose widths hold mirrors or slack.
LOOSE_WIDTHS = frozenset(
    {"nuscenes_mini", "waymo_motion_samples", "nuplan_samples", "view_of_delft_example", "published_class_means"}
)

#: Sets that are lists of products, a derived size, or children.
PASSED = frozenset({"us_cars_carsheet", "india_used_cars", "bicycle_geometry", "ncd_risc_height"})

#: Sets in which bleeding labels spoil small things.
LARGE_ONLY = {"3rscan_boxes": frozenset({"bottle", "cup", "mug"})}


def main() -> None:
    """Print the table, one line for each axis of each thing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=Path, help="folder of the sets, <name>/<name>.csv each")
    parser.add_argument("before", help="a release: version or folder")
    parser.add_argument("now", help="a release: version or folder")
    arguments = parser.parse_args()
    world, trees = world_medians(arguments.sizes), [open_tree(arguments.before), open_tree(arguments.now)]
    rows = []
    for thing in THINGS:
        nodes = [tree.find(thing) for tree in trees]
        for axis in AXES:
            sizes = [_quantiles(node, axis) for node in nodes]
            if any(size != "" for size in sizes):
                median, sets = world.get((thing, axis), (float("nan"), ()))
                shown = "" if np.isnan(median) else f"{median:.0f}"
                rows.append((thing, axis, *sizes, shown, ", ".join(sets)))
    heads = [f"{tree.version}, 5 / 50 / 95 % mm" for tree in trees]
    print_table(["thing", "axis", *heads, "world, median mm", "sets"], rows)


def world_medians(folder: Path) -> dict[tuple[str, str], tuple[float, tuple[str, ...]]]:
    """The world's median in mm and its sets, by thing and axis."""
    names = {name: thing for thing, own in THINGS.items() for name in own}
    sizes: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(folder.glob("*/*.csv")):
        for thing, axis, size in _sizes(path, names):
            sizes[thing, axis][path.stem].append(size)
    return {
        key: (float(np.median([np.median(values) for values in own.values()])), tuple(sorted(own)))
        for key, own in sizes.items()
    }


def _sizes(path: Path, names: Mapping[str, str]) -> Iterator[tuple[str, str, float]]:
    """Thing, axis and size in mm of the rows of a set that count."""
    name = path.stem
    with path.open(encoding="utf-8", newline="", errors="replace") as lines:
        reader = csv.DictReader(lines)
        if name in PASSED or not {"category", "statistic", "height_mm"} <= set(reader.fieldnames or ()):
            return
        for row in reader:
            category = row["category"].lower()
            if category not in names or row["statistic"] == "sd" or category in LARGE_ONLY.get(name, ()):
                continue
            for axis in AXES:
                trusted = axis == "height" or not (name in HEIGHTS or (axis == "width" and name in LOOSE_WIDTHS))
                if trusted and row[f"{axis}_mm"]:
                    yield names[category], axis, float(row[f"{axis}_mm"])


def _quantiles(node: Node, axis: str) -> str:
    if not any(axis in dims for dims in node.prior_dims):
        return ""
    prior = node.prior((axis,))
    return " / ".join(f"{float(prior.quantile(q)[0]):.0f}" for q in (0.05, 0.5, 0.95))


if __name__ == "__main__":
    main()
