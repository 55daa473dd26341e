"""Measure heights of objects with a level top and clutter on it: `python -m benchmarks.estimator.level_tops`.

In these hard synthetic rooms the masks of tables, desks and cabinets include most objects on top of them. Prints the
errors of their heights, and of all other heights, with dense and with sparse points. Seeds 1100 and 1101 are for
development.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.common import seeds_parser, table_head
from estimator.geometry.category_rules import has_level_top
from estimator.pipeline import measure_objects
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import CLUTTERED, with_knobs
from tests.synthetic.rooms.quick import quick_scene

KNOBS = with_knobs(CLUTTERED, views=12)
#: Half width of the central 90 % interval of a Gaussian, in standard deviations.
SIGMAS_90 = 1.645


def main() -> None:
    """Run the benchmark and print the table."""
    options = seeds_parser(__doc__, 1102, 1104).parse_args()
    errors: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in range(*options.seeds):
        for kind in KINDS:
            room = quick_scene(furnished_room(kind, seed, KNOBS), KNOBS, seed=seed)
            for points, scene in (("dense", room.scene), ("sparse", replace(room.scene, dense=None))):
                for item in measure_objects(scene, room.instances).objects:
                    true = room.truth.objects[room.instances[item.members[0]].track or ""]
                    if item.skipped is None and not item.truncated[2]:
                        error = float(np.log(item.extents[2] * room.truth.metres_per_unit / true.size[2]))
                        level = "level tops" if has_level_top(item.category) else "others"
                        errors.setdefault((points, level), []).append((error, float(item.sigma[2])))
    columns = ("points", "heights of", "objects", "median", "median size", "90th percentile", "inside the stated 90 %")
    print(table_head(columns))
    for (points, level), rows in sorted(errors.items()):
        error, sigma = np.array(rows).T
        size = np.abs(error)
        sizes = f"{np.median(size):.1%} | {np.quantile(size, 0.9):.1%} | {np.mean(size < SIGMAS_90 * sigma):.2f}"
        print(f"| {points} | {level} | {len(rows)} | {np.median(error):+.1%} | {sizes} |")


if __name__ == "__main__":
    main()
