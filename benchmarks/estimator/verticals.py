"""How far up is off, and what is stated: `OMP_NUM_THREADS=1 python -m benchmarks.estimator.verticals [SCENE ...]`.

Hard synthetic rooms, half of them with every second object leaning by four degrees, each with its floor and with a
tenth of the floor's points, sparse and dense; and scenes on disk that state up. Seeds 1100 to 1103 are for development.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.common import print_rows, seeds_parser
from estimator.geometry.planes import height_bin_width, height_peaks
from estimator.geometry.vertical import camera_up, refine_up
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import View
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import HARD, with_knobs
from tests.synthetic.rooms.quick import quick_scene

#: Degrees and share of the objects that lean, and the share of a bare floor's points.
LEANING_DEG, LEANING, BARE = 4.0, 0.5, 0.1
#: Height bins about a floor that are its points.
FLOOR_BINS = 3

#: What kind of scene, its true up, its views, its points.
Case = tuple[str, FloatArray, tuple[View, ...], FloatArray]


def main() -> None:
    """The command."""
    parser = seeds_parser(__doc__, 0, 2)
    parser.add_argument("scenes", nargs="*", type=Path, help="scenes with a truth.json")
    options = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = {}
    for kind, true, views, points in (*_on_disk(options.scenes), *_rooms(*options.seeds)):
        up = refine_up(camera_up(views), points)
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
        yield f"`{folder.name}`, sparse", true / np.linalg.norm(true), scene.views, scene.points
        if scene.dense is not None:
            yield f"`{folder.name}`, dense", true / np.linalg.norm(true), scene.views, scene.dense.points


def _rooms(first: int, end: int) -> Iterator[Case]:
    generator = np.random.default_rng(first)
    for seed in range(first, end):
        for kind in KINDS:
            for name, knobs in (
                ("level", HARD),
                ("every second object leans", with_knobs(HARD, tilted=LEANING, tilt_deg=LEANING_DEG)),
            ):
                room = quick_scene(furnished_room(kind, seed, knobs), knobs, seed=seed)
                dense = room.scene.dense
                for points in (room.scene.points, *(() if dense is None else (dense.points,))):
                    yield name, room.truth.up, room.scene.views, points
                    heights = points @ room.truth.up
                    width = height_bin_width(heights)
                    levels = height_peaks(heights, width)
                    if levels:
                        bare = np.abs(heights - levels[0]) > FLOOR_BINS * width
                        kept = bare | (generator.random(len(heights)) < BARE)
                        yield f"{name}, floor bare", room.truth.up, room.scene.views, points[kept]


if __name__ == "__main__":
    main()
