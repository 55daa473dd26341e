"""Compare measured sizes with true ones: `python -m benchmarks.estimator.size_errors [--seeds FIRST END]`.

Prints, for sizes by points and by outlines, for each axis and for truncated and complete sides: the number of sizes,
the median of ln(measured / true), its robust standard deviation, the median stated one, and the fraction of errors of
more than two stated deviations. The rooms are hard and cluttered; in two of three versions, 40 % of the objects have no
masks, and in the third, every fourth view has masks. Seeds from 1000 on are for development.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from benchmarks.common import print_rows, seeds_parser
from estimator.pipeline import measure_objects
from estimator.records.scene import Instance
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import CLUTTERED, HARD
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene

AXES = ("length", "width", "height")
#: Fraction of the objects without masks.
UNMASKED_FRACTION = 0.4
#: One of so many views has masks in the last version of a room.
MASKED_VIEW_STEP = 4
#: Minimum number of sizes of a row of the table.
MIN_SIZES = 8

#: Way of the measurement, axis, and whether the side is truncated.
_Key = tuple[str, int, bool]


def main() -> None:
    """Run the benchmark and print the table."""
    options = seeds_parser(__doc__, 0, 4).parse_args()
    sizes: dict[_Key, list[tuple[float, float]]] = defaultdict(list)
    for room, masks in _rooms(*options.seeds):
        for key, error, sigma in _size_errors(room, masks):
            sizes[key].append((error, sigma))
    columns = ("way", "axis", "truncated", "sizes", "bias", "robust sd", "stated sd", "beyond 2 sd")
    rows = ((key, np.array(pairs)) for key, pairs in sorted(sizes.items()) if len(pairs) >= MIN_SIZES)
    print_rows(columns, (_row(key, pairs) for key, pairs in rows))


def _row(key: _Key, pairs: FloatArray) -> tuple[object, ...]:
    error, sigma = pairs.T
    deviation = 1.4826 * np.median(np.abs(error - np.median(error)))
    figures = (np.median(error), deviation, np.median(sigma), np.mean(np.abs(error) > 2 * sigma))
    return key[0], AXES[key[1]], "yes" if key[2] else "no", len(pairs), *(f"{value:.3f}" for value in figures)


def _rooms(first: int, end: int) -> Iterator[tuple[SyntheticScene, tuple[Instance, ...]]]:
    """Yield rooms of all kinds with the masks that are used."""
    generator = np.random.default_rng(first)
    for seed in range(first, end):
        for kind in KINDS:
            cluttered = quick_scene(furnished_room(kind, seed, CLUTTERED), CLUTTERED, seed=seed)
            yield cluttered, cluttered.instances
            sparse = quick_scene(furnished_room(kind, seed, HARD), HARD, seed=seed, dense_a_frame=0)
            tracks = sorted({str(mask.track) for mask in sparse.instances})
            kept = {track for track in tracks if generator.random() >= UNMASKED_FRACTION}
            masks = tuple(mask for mask in sparse.instances if mask.track in kept)
            yield sparse, masks
            yield sparse, tuple(mask for mask in masks if mask.view % MASKED_VIEW_STEP == 0)


def _size_errors(room: SyntheticScene, masks: tuple[Instance, ...]) -> Iterator[tuple[_Key, float, float]]:
    """Yield the log error and the stated deviation of each extent of the measured objects."""
    if not masks:
        return
    for item in measure_objects(room.scene, masks).objects:
        true = room.truth.objects.get(str(masks[item.members[0]].track))
        if item.skipped is not None or true is None:
            continue
        size = np.array([*sorted(true.size[:2], reverse=True), true.size[2]])
        errors = np.log(item.extents * room.truth.metres_per_unit / size)
        way = "outlines" if "measured by its outlines" in item.notes else "points"
        for axis in range(3):
            if np.isfinite(errors[axis]) and np.isfinite(item.sigma[axis]):
                yield (way, axis, bool(item.truncated[axis])), float(errors[axis]), float(item.sigma[axis])


if __name__ == "__main__":
    main()
