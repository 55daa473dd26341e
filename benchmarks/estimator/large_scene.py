"""Processor time and memory of `estimate-scale` on large scenes.

    python -m benchmarks.estimator.large_scene [--times 1 2 4]

A synthetic room is recorded by `VIEWS` cameras and has about `POINTS` dense points; each of `--times` repeats its
views, its masks and its points (all a millimetre apart) so often: time is linear if it grows as often. Each runs in
a process of its own, from files.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.child import ours, run_child
from benchmarks.common import options_parser, print_rows
from estimator.records.scene import DenseCloud, View
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.world import World

VIEWS, POINTS = 125, 500_000
#: Most views of a dense point, and most observations of sparse points in a view.
SEEN, OBSERVATIONS = 12, 3000


def repeated(synthetic: SyntheticScene, times: int) -> SyntheticScene:
    """The scene with its views, masks and points so many times."""
    scene, generator = synthetic.scene, np.random.default_rng(0)
    assert scene.dense is not None
    unit = 0.001 / synthetic.truth.metres_per_unit
    views: list[View] = []
    for copy in range(times):
        views += [
            replace(
                view,
                name=f"{copy}-{view.name}",
                # a view that is listed twice counts once
                translation=view.translation + generator.normal(0, unit, 3),
                point_index=view.point_index + copy * len(scene.points),
            )
            for view in scene.views
        ]
    dense = _repeated_cloud(scene.dense, times, len(scene.views), unit, generator)
    points = np.tile(scene.points, (times, 1)) + generator.normal(0, unit, (times * len(scene.points), 3))
    return replace(
        synthetic, scene=replace(scene, views=tuple(views), points=points, dense=dense), ids=(*synthetic.ids,) * times
    )


def _repeated_cloud(
    dense: DenseCloud, times: int, views: int, unit: float, generator: np.random.Generator
) -> DenseCloud:
    """The cloud so many times, each copy seen by the views of its own, and `unit` apart."""
    assert dense.visible_offsets is not None
    assert dense.visible_views is not None
    seen = np.concatenate([dense.visible_views + copy * views for copy in range(times)])
    ends = np.concatenate([dense.visible_offsets[1:] + copy * dense.visible_offsets[-1] for copy in range(times)])
    points = np.tile(dense.points, (times, 1)) + generator.normal(0, unit, (times * len(dense.points), 3))
    return DenseCloud(points, np.concatenate([[0], ends]), seen)


def _with_fewer(view: View, most: int) -> View:
    """The view with at most so many observations, evenly taken: SIFT on a video frame gives as many."""
    step = -(-len(view.point_index) // most)
    return replace(view, keypoints=view.keypoints[::step], point_index=view.point_index[::step])


def _thinned(dense: DenseCloud, most: int) -> DenseCloud:
    """The cloud with at most so many views of each point, as a fusion of neighbouring views gives."""
    assert dense.visible_offsets is not None
    assert dense.visible_views is not None
    counts = np.diff(dense.visible_offsets)
    position = np.arange(len(dense.visible_views)) - np.repeat(dense.visible_offsets[:-1], counts)
    kept = position < most
    offsets = np.concatenate([[0], np.cumsum(np.minimum(counts, most))])
    return replace(dense, visible_offsets=offsets, visible_views=dense.visible_views[kept])


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = options_parser(__doc__)
    parser.add_argument("--times", type=int, nargs="+", default=[1, 2, 4])
    given = parser.parse_args()
    world = furnished_room("sitting room", 7, Knobs(views=VIEWS))
    synthetic = quick_scene(world, Knobs(views=VIEWS), 7, dense_a_frame=POINTS // VIEWS)
    assert synthetic.scene.dense is not None
    sparse = tuple(_with_fewer(view, OBSERVATIONS) for view in synthetic.scene.views)
    synthetic = replace(
        synthetic, scene=replace(synthetic.scene, views=sparse, dense=_thinned(synthetic.scene.dense, SEEN))
    )
    columns = ("views", "dense points", "masks", "processor s", "peak MiB", "exit", "scale over true")
    print_rows(columns, (_row(repeated(synthetic, times), world) for times in given.times))


def _row(large: SyntheticScene, world: World) -> tuple[object, ...]:
    dense = large.scene.dense
    assert dense is not None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_scene(large, world, folder)
        run = run_child(ours("estimate-scale", folder, "--quiet", "--json"))
        masks = len(json.loads((folder / "instances.json").read_bytes())["annotations"])
    scale = json.loads(run.output)["scale"]
    cost = f"{run.cpu_s:.0f}", f"{run.peak_mib:.0f}", run.status
    ratio = None if scale is None else f"{scale / large.truth.metres_per_unit:.3f}"
    return len(large.scene.views), f"{len(dense.points):,}", f"{masks:,}", *cost, ratio


if __name__ == "__main__":
    main()
