"""Small, far, half-hidden objects with 1 to 30 points each: `python -m benchmarks.estimator.few_points`.

Prints for each class of pixels, points and path the median |log error| of length, width and height, and how often the
stated 90 % holds. Worlds of `tests.synthetic.rooms.few_points`; seeds from 1000 on are for development.
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

#: What stands on the floor in these worlds; up is known from the aircraft where the camera looks down.
STANDING = {"car": True, "chair": True}
#: Standard deviations that hold the middle 90 % of a Gaussian.
NINETY = 1.645
PIXELS, POINTS = (50, 100, 200, 10_000), (0, 3, 8, 16, 10_000)


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One object: log errors and sigmas (3,), or None where it was skipped."""

    path: str
    pixels: float
    points: int
    error: FloatArray | None
    sigma: FloatArray


def main() -> None:
    """The command."""
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
    for low, high in zip((0, *PIXELS), PIXELS, strict=False):
        _print_class(_range(low, high, PIXELS, "px"), [row for row in measured if low < row.pixels <= high])
    for low, high in zip((-1, *POINTS), POINTS, strict=False):
        _print_class(_range(low + 1, high, POINTS, "points"), [row for row in measured if low < row.points <= high])


def world_rows(seed: int, path: str, points: tuple[int, int] = (1, MAX_POINTS)) -> Iterator[Row]:
    """The objects of one world; those that are truncated on a side are left out there."""
    world = few_points_world(seed, path, points)
    up = (0.0, 0.0, 1.0) if path == "above" else None
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
    inside = error < NINETY * np.array([row.sigma for row in rows])
    shown = np.isfinite(error)
    median = " ".join(f"{value:.1%}" for value in np.nanmedian(error, axis=0))
    share = " ".join(f"{value:.2f}" for value in (inside & shown).sum(axis=0) / np.maximum(shown.sum(axis=0), 1))
    print(f"| {name} | {len(rows)} | {median} | {share} |")


if __name__ == "__main__":
    main()
