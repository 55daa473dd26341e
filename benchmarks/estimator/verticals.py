"""Measure the error of the up vector and of its stated uncertainty.

    OMP_NUM_THREADS=1 python -m benchmarks.estimator.verticals [SCENE ...]

The scenes are hard synthetic rooms, half of them with every second object tilted by four degrees, with all or a tenth
of the floor's points; captures with misleading dense clouds (`tests.synthetic.verticals`); and scenes on disk whose
`truth.json` states up. Rooms and scenes on disk have only sparse points, or dense points as well. Seeds 1100 to 1103
are for development.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.common import print_rows, seeds_parser
from estimator.geometry.planes import height_bin_width, height_peaks, voxel_downsample
from estimator.geometry.vertical import camera_up, refine_up
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import View
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import HARD, with_knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.verticals import CAPTURES, DEFECTS, misleading_capture

#: Tilt of the tilted objects in degrees.
TILT_DEG = 4.0
#: Fraction of tilted objects.
TILTED_FRACTION = 0.5
#: Fraction of the points that a bare floor keeps.
BARE_FLOOR_FRACTION = 0.1
#: Half width, in height bins, of the layer of floor points.
FLOOR_BINS = 3
#: Number of captures of each kind with misleading clouds per seed.
CAPTURES_A_SEED = 5

#: Kind of scene, true up vector, views, clouds with the densest last.
Case = tuple[str, FloatArray, tuple[View, ...], tuple[FloatArray, ...]]


def main() -> None:
    """Run the benchmark and print the table."""
    parser = seeds_parser(__doc__, 0, 2)
    parser.add_argument("scenes", nargs="*", type=Path, help="scenes with a truth.json")
    options = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = {}
    cases = (*_on_disk(options.scenes), *_rooms(*options.seeds), *_misleading(*options.seeds))
    for kind, true, views, clouds in cases:
        up = refine_up(camera_up(views), [voxel_downsample(points) for points in clouds])
        off = float(np.degrees(np.arccos(np.clip(up.vector @ true, -1, 1))))
        rows.setdefault(kind, []).append((off, up.sigma_deg))
    columns = ("scenes", "", "off by, median", "90th percentile", "stated, median", "within one", "within two")
    print_rows(columns, (_row(kind, *np.array(pairs).T) for kind, pairs in rows.items()))


def _row(kind: str, off: FloatArray, sigma: FloatArray) -> tuple[object, ...]:
    figures = np.median(off), np.quantile(off, 0.9), np.median(sigma), *(np.mean(off <= k * sigma) for k in (1, 2))
    return kind, len(off), *(f"{value:.2f}" for value in figures)


def _on_disk(folders: list[Path]) -> Iterator[Case]:
    for folder in folders:
        scene = read_scene(folder)
        true = np.array(json.loads((folder / "truth.json").read_text())["up_in_scene"])
        yield f"`{folder.name}`, sparse", true / np.linalg.norm(true), scene.views, (scene.points,)
        if scene.dense is not None:
            clouds = scene.points, scene.dense.points
            yield f"`{folder.name}`, sparse and dense", true / np.linalg.norm(true), scene.views, clouds


def _rooms(first: int, end: int) -> Iterator[Case]:
    generator = np.random.default_rng(first)
    for seed in range(first, end):
        for kind in KINDS:
            for name, knobs in (
                ("level", HARD),
                ("every second object leans", with_knobs(HARD, tilted=TILTED_FRACTION, tilt_deg=TILT_DEG)),
            ):
                room = quick_scene(furnished_room(kind, seed, knobs), knobs, seed=seed)
                dense = room.scene.dense
                clouds: tuple[FloatArray, ...] = ()
                bare: tuple[FloatArray, ...] = ()
                for points in (room.scene.points, *(() if dense is None else (dense.points,))):
                    clouds = (*clouds, points)
                    yield name, room.truth.up, room.scene.views, clouds
                    heights = points @ room.truth.up
                    width = height_bin_width(heights)
                    levels = height_peaks(heights, width)
                    if levels:
                        above = np.abs(heights - levels[0]) > FLOOR_BINS * width
                        keep = above | (generator.random(len(heights)) < BARE_FLOOR_FRACTION)
                        bare = (*bare, points[keep])
                        yield f"{name}, floor bare", room.truth.up, room.scene.views, bare


def _misleading(first: int, end: int) -> Iterator[Case]:
    for capture, defect, seed in product(CAPTURES, DEFECTS, range(CAPTURES_A_SEED * first, CAPTURES_A_SEED * end)):
        yield f"{capture}, {defect}", np.array([0, 0, 1.0]), *misleading_capture(capture, defect, seed)


if __name__ == "__main__":
    main()
