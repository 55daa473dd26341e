"""How far the answer moves when one scene is written in other ways.

    python -m benchmarks.estimator.same_answer [SCENE ...] [--rooms 2]

SCENE is a folder with `truth.json` (by default the demo room and the shared `tum_office`), with masks, with sparse
points alone, and with a detector's boxes where it has any; `--rooms` adds synthetic rooms of so many kinds in the same
three forms. Each is estimated as it is and in a unit of 1e-9 and 1e9, in a world that is turned and shifted, with
views, points, observations, annotations in other orders, with all points twice, and with all annotations twice. A
cell is the largest movement of the scale over the tries, in per cent, with the widest movement of an interval end in
brackets; `!` marks another status or another number of used objects. The table is in Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.cases import scenes_on_disk, synthetic_rooms
from benchmarks.accuracy.methods import Case
from estimator import Instance, ScaleResult, Scene, estimate_scale
from metric_cli.progress import with_bar
from tests.synthetic.rooms.sizes import typical_sizes
from tests.synthetic.same_scene import annotated_twice, moved_scene, points_twice, shuffled

ROOT = Path(__file__).resolve().parents[2]
SCENES = (ROOT / "data" / "scenes", ROOT.parent / "shared" / "data" / "scenes")
TRIES = 2
#: Forms of a synthetic room: masks, sparse points, boxes.
FORMS = 3

Written = Iterator[tuple[Scene, tuple[Instance, ...], float]]


def _units(scene: Scene, instances: tuple[Instance, ...]) -> Written:
    for factor in (1e-9, 1e9):
        yield moved_scene(scene, factor, np.eye(3), np.zeros(3)), instances, factor


def _worlds(scene: Scene, instances: tuple[Instance, ...]) -> Written:
    generator = np.random.default_rng(1)
    for _ in range(TRIES):
        rotation = Rotation.random(random_state=generator).as_matrix()
        yield moved_scene(scene, 1.0, rotation, generator.normal(0, 3, 3)), instances, 1.0


def _orders(scene: Scene, instances: tuple[Instance, ...]) -> Written:
    for seed in range(TRIES):
        yield (*shuffled(scene, instances, seed), 1.0)


WAYS: dict[str, Callable[[Scene, tuple[Instance, ...]], Written]] = {
    "unit 1e-9, 1e9": _units,
    "world turned": _worlds,
    "other orders": _orders,
    "points twice": lambda scene, instances: iter([(points_twice(scene), instances, 1.0)]),
    "annotations twice": lambda scene, instances: iter([(scene, annotated_twice(instances), 1.0)]),
}


def movements(case: Case) -> list[str]:
    """A row of the table."""
    instances = tuple(case.instances)
    whole = estimate_scale(case.scene, instances)
    cells = [case.group, case.name, whole.status]
    for way in WAYS.values():
        moved = [_movement(whole, estimate_scale(*other[:2]), other[2]) for other in way(case.scene, instances)]
        scale, ends = (max(one[part] for one in moved) for part in (0, 1))
        cells.append(f"{scale:.2g} ({ends:.2g}){'' if all(one[2] for one in moved) else ' !'}")
    return cells


def _movement(whole: ScaleResult, other: ScaleResult, factor: float) -> tuple[float, float, bool]:
    """Movement of the scale and of the interval's ends in per cent, and whether status and used objects stay."""
    used = [sum(bool(one.used) for one in result.objects) for result in (whole, other)]
    same = whole.status == other.status and used[0] == used[1] and len(whole.objects) == len(other.objects)
    if whole.scale is None or other.scale is None or whole.interval is None or other.interval is None:
        modes = [result.modes[0].scale if result.modes else 1.0 for result in (whole, other)]
        return 100 * abs(modes[1] * factor / modes[0] - 1), 0.0, same
    pairs = ((whole.interval.low, other.interval.low), (whole.interval.high, other.interval.high))
    ends = max(abs(second * factor / first - 1) for first, second in pairs)
    return 100 * abs(other.scale * factor / whole.scale - 1), 100 * ends, same


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="names of folders")
    parser.add_argument("--rooms", type=int, default=2, help="kinds of synthetic rooms (default: %(default)s)")
    given = parser.parse_args()
    names = given.scenes or ["demo_room", "tum_office"]
    cases = [case for folder in SCENES if folder.is_dir() for case in scenes_on_disk(folder) if case.name in names]
    cases += islice(synthetic_rooms([7], typical_sizes), FORMS * given.rooms)
    print(f"| {' | '.join(('case', 'name', 'status', *WAYS))} |\n|{'---|' * (3 + len(WAYS))}")
    for case in with_bar(cases, "estimating"):
        print(f"| {' | '.join(movements(case))} |", flush=True)


if __name__ == "__main__":
    main()
