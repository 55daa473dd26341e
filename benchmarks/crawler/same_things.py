"""Boxes of ScanNet that three sets state: which rows of a set are the same thing as a row of a better one.

    python -m benchmarks.crawler.same_things ../shared/data/sizes data/sources

writes `scannet18_boxes.superseded.txt` and `scannet_fine_boxes.superseded.txt`, which the declarations of those sets
name. A box along the room's axes under a fine name is better than one under a coarse name; a minimal box, which has a
footprint of its own, is better than both. Two rows are one thing if they are of one scan and agree in their sizes:
the fine names' are rounded to 10 mm, a minimal box agrees in height alone.
"""

from __future__ import annotations

import argparse
import csv
from collections import defaultdict
from pathlib import Path

#: Half a step of rounding at both ends, and the height of a minimal box against that of one along the axes.
SIDES_MM, HEIGHT_MM = 11.0, 15.0
AXES = ("length_mm", "width_mm", "height_mm")
#: Names of minimal boxes, and what the other sets call those things.
NAMES = {"trash bin": {"trash can", "recycling bin"}, "tv": {"television"}, "chair": {"office chair", "armchair"}}

#: What the declarations refuse anyway: cut by the scan, or a mixture.
REFUSED = {"door", "window", "curtain", "shower curtain", "counter", "otherfurniture"}

Box = tuple[str, str, tuple[float, ...]]


def boxes(path: Path) -> dict[str, list[Box]]:
    """Id, name and sides of each box with a known vertical, by scan."""
    by_scan: dict[str, list[Box]] = defaultdict(list)
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["height_mm"] and row["category"] not in REFUSED:
                sides = tuple(float(row[axis]) for axis in AXES)
                by_scan[row["instance_or_n"].split("/")[0]].append((row["instance_or_n"], row["category"], sides))
    return by_scan


def same_sides(one: Box, other: Box) -> bool:
    """Whether two boxes along the same axes are of one thing."""
    return all(abs(a - b) <= SIDES_MM for a, b in zip(one[2], other[2], strict=True))


def same_height(one: Box, other: Box) -> bool:
    """Whether a box along the axes may be the thing of a minimal box: by name and height."""
    return one[1] in {other[1], *NAMES.get(other[1], ())} and abs(one[2][2] - other[2][2]) <= HEIGHT_MM


def superseded(sizes: Path) -> dict[str, list[str]]:
    """Ids of the rows of each set that another one states better, sorted."""
    coarse, fine, minimal = (
        boxes(sizes / name / f"{name}.csv") for name in ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")
    )
    gone: dict[str, set[str]] = {"scannet18_boxes": set(), "scannet_fine_boxes": set()}
    for name, boxes_of, others, same in (
        ("scannet18_boxes", coarse, fine, same_sides),
        ("scannet18_boxes", coarse, minimal, same_height),
        ("scannet_fine_boxes", fine, minimal, same_height),
    ):
        for scan, better in others.items():
            for box in better:
                match = next((b for b in boxes_of.get(scan, []) if b[0] not in gone[name] and same(b, box)), None)
                if match is not None:
                    gone[name].add(match[0])
    return {name: sorted(ids) for name, ids in gone.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    for name, ids in superseded(arguments.sizes).items():
        (arguments.out / f"{name}.superseded.txt").write_text("".join(f"{i}\n" for i in ids), encoding="utf-8")
        print(f"{name}: {len(ids)}")


if __name__ == "__main__":
    main()
