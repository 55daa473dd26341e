"""Measure small, distant, partly occluded objects with 1 to 30 points: `python -m benchmarks.estimator.few_points`.

Prints the median |log error| of length, width and height and the coverage of the 90 % interval, by path and by the
numbers of pixels and points. The worlds are from `tests.synthetic.rooms.few_points`; seeds from 1000 on are for
development.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.common import seeds_parser
from estimator.pipeline import measure_objects
from estimator.records.options import MeasurementOptions
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.few_points import MAX_POINTS, PATHS, few_points_world

#: Categories that are on the floor in these worlds.
STANDING = {"car": True, "chair": True}
#: Half width of the central 90 % interval of a Gaussian, in standard deviations.
SIGMAS_90 = 1.645
#: Upper ends of the bins of the mask diagonal in pixels.
PIXEL_BINS = (50, 100, 200, 10_000)
#: Upper ends of the bins of the number of points.
POINT_BINS = (0, 3, 8, 16, 10_000)


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """Log errors (3,) (None if the object was skipped) and sigmas (3,) of an object."""

    path: str
    pixels: float
    points: int
    error: FloatArray | None
    sigma: FloatArray


def main() -> None:
    """Run the benchmark and print the table."""
    parser = seeds_parser(__doc__, 0, 5)
    parser.add_argument("--points", type=int, nargs=2, default=(1, MAX_POINTS), metavar=("FEWEST", "MOST"))
    parser.add_argument("--paths", nargs="+", choices=PATHS, default=PATHS)
    options = parser.parse_args()
    ends = tuple(options.points)
    rows = [row for seed in range(*options.seeds) for path in options.paths for row in world_rows(seed, path, ends)]
    measured = [row for row in rows if row.error is not None]
    print(f"{len(rows)} objects, {len(measured)} measured")
    print("| class | objects | error of length, width, height | inside the stated 90 % |\n|---|---|---|---|")
    _print_class("all", measured)
    for path in PATHS:
        _print_class(path, [row for row in measured if row.path == path])
    for low, high in zip((0, *PIXEL_BINS), PIXEL_BINS, strict=False):
        _print_class(_range(low, high, PIXEL_BINS, "px"), [row for row in measured if low < row.pixels <= high])
    for low, high in zip((-1, *POINT_BINS), POINT_BINS, strict=False):
        _print_class(_range(low + 1, high, POINT_BINS, "points"), [row for row in measured if low < row.points <= high])


def world_rows(seed: int, path: str, points: tuple[int, int] = (1, MAX_POINTS)) -> Iterator[Row]:
    """Yield the objects of a world. Errors of truncated axes are NaN."""
    world = few_points_world(seed, path, points)
    up = (0.0, 0.0, 1.0) if path == "above" else None  # the aircraft states up
    options = MeasurementOptions(standing=STANDING.get, up=up)
    for item in measure_objects(world.scene, world.instances, options).objects:
        masks = [world.instances[row] for row in item.members]
        pixels = float(np.median([np.hypot(*mask.mask.shape) for mask in masks]))
        error = np.log(item.extents / world.sizes[int(masks[0].track or 0)])
        error = np.where(item.truncated, np.nan, error)
        yield Row(path, pixels, item.points, None if item.skipped is not None else error, item.sigma)


def _range(low: int, high: int, ends: tuple[int, ...], unit: str) -> str:
    return f"over {ends[-2]} {unit}" if high == ends[-1] else f"{low} to {high} {unit}" if high else f"no {unit}"


def _print_class(name: str, rows: list[Row]) -> None:
    if not rows:
        return
    error = np.abs(np.array([row.error for row in rows], dtype=float))
    inside = error < SIGMAS_90 * np.array([row.sigma for row in rows])
    is_known = np.isfinite(error)
    median = " ".join(f"{value:.1%}" for value in np.nanmedian(error, axis=0))
    covered = (inside & is_known).sum(axis=0) / np.maximum(is_known.sum(axis=0), 1)
    print(f"| {name} | {len(rows)} | {median} | {' '.join(f'{value:.2f}' for value in covered)} |")


if __name__ == "__main__":
    main()
