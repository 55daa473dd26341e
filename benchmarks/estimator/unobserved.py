"""Compare scales of scenes with and without observations: `python -m benchmarks.estimator.unobserved [SCENE ...]`.

Each synthetic room, or each given scene with its `instances.json`, is estimated unchanged and from a nerfstudio export
of its points, which does not state observations. Sparse points and, if the scene has one, the dense cloud are
evaluated separately. Prints the change of the scale. Rooms have the errors of real depth; seeds 1100 and 1101 are for
development.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.common import seeds_parser, table_head
from estimator.instances.instance_reader import read_instances
from estimator.pipeline import estimate_scale
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, Scene
from tests.synthetic.exports import write_export
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import HARD, with_knobs
from tests.synthetic.rooms.quick import quick_scene

#: Maximum number of exported points of a dense cloud, as many as the splats of a room.
MAX_POINTS = 50_000
VIEWS = 16


def main() -> None:
    """Run the benchmark and print the table."""
    parser = seeds_parser(__doc__, 1102, 1104)
    parser.add_argument("scenes", nargs="*", type=Path)
    options = parser.parse_args()
    moves: dict[str, list[float]] = {}
    print(table_head(("scene", "points", "with observations", "without", "moved by")))
    for name, scene, instances in _named(options.scenes) if options.scenes else _rooms(*options.seeds):
        for points, cloud in _clouds(scene):
            observed = estimate_scale(cloud, instances)
            bare = estimate_scale(_without_observations(cloud), instances)
            moved = float(np.log(bare.scale / observed.scale)) if observed.scale and bare.scale else np.nan
            moves.setdefault(points, []).append(moved)
            print(f"| {name} | {points} | {_scale_text(observed)} | {_scale_text(bare)} | {moved:+.1%} |", flush=True)
    for points, changes in moves.items():
        sizes = np.abs(changes)
        moved_by = f"median {np.nanmedian(sizes):.1%}, largest {np.nanmax(sizes):.1%}"
        within = f"{(sizes < 0.03).sum()} of {len(sizes)} within 3 %"
        print(f"{points}: {moved_by}, {within}, {np.isnan(sizes).sum()} unresolved")


def _named(folders: list[Path]) -> Iterator[tuple[str, Scene, tuple[Instance, ...]]]:
    for folder in folders:
        scene = read_scene(folder)
        yield folder.name, scene, read_instances(None, scene)


def _rooms(first: int, end: int) -> Iterator[tuple[str, Scene, tuple[Instance, ...]]]:
    knobs = with_knobs(HARD, views=VIEWS)
    for seed in range(first, end):
        for kind in KINDS:
            synthetic = quick_scene(furnished_room(kind, seed, knobs), knobs, seed=seed)
            yield f"{kind} {seed}", synthetic.scene, synthetic.instances


def _clouds(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """Yield the scene with its sparse points only, and with its dense cloud."""
    yield "sparse", replace(scene, dense=None)
    if scene.dense is not None:
        yield "dense", scene


def _without_observations(scene: Scene) -> Scene:
    """Return the scene as read from a nerfstudio export, with at most `MAX_POINTS` points of a dense cloud."""
    if scene.dense is not None:
        step = -(-len(scene.dense.points) // MAX_POINTS)
        scene = replace(scene, points=scene.dense.points[::step], dense=None)
    with TemporaryDirectory() as folder:
        return read_scene(write_export(scene, "nerfstudio", Path(folder)))


def _scale_text(result: ScaleResult) -> str:
    if result.scale is None or result.interval is None:
        return result.status
    return f"{result.scale:.4g} ({result.interval.low:.4g} to {result.interval.high:.4g})"


if __name__ == "__main__":
    main()
