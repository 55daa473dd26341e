"""Measure processor time and memory of `estimate-scale` on large scenes.

    python -m benchmarks.estimator.large_scene [--times 1 2 4] [--masks 750 12000]

A synthetic room has `VIEWS` views and about `POINTS` dense points. For each number N of `--times`, the views, masks
and points are repeated N times with offsets of about a millimetre, and the command runs on the files in a separate
process. The time is linear in the size if it grows by the factor N.

With `--masks`, `demo_room` has the given numbers of rectangular masks instead, at random places, of random categories
of its file and with sides of 8 to 60 pixels: most are objects of their own, with few points.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.child import ours, run_child
from benchmarks.common import ROOT, options_parser, print_rows
from estimator.records.scene import DenseCloud, View
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.world import World

VIEWS = 125
POINTS = 500_000
#: Maximum number of views of a dense point, as in a fusion of neighbouring views.
MAX_VIEWS_PER_POINT = 12
#: Maximum number of observed sparse points per view, as with SIFT on a video frame.
MAX_OBSERVATIONS = 3000


def repeated(synthetic: SyntheticScene, times: int) -> SyntheticScene:
    """Return the scene with its views, masks and points repeated `times` times."""
    scene, generator = synthetic.scene, np.random.default_rng(0)
    assert scene.dense is not None
    unit = 0.001 / synthetic.truth.metres_per_unit
    views: list[View] = []
    for copy in range(times):
        views += [
            replace(
                view,
                name=f"{copy}-{view.name}",
                # without an offset, a repeated view would be dropped as a duplicate
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
    """Return `times` copies of the cloud, offset by about `unit`, each visible in the views of its copy."""
    assert dense.visible_offsets is not None
    assert dense.visible_views is not None
    visible_views = np.concatenate([dense.visible_views + copy * views for copy in range(times)])
    ends = np.concatenate([dense.visible_offsets[1:] + copy * dense.visible_offsets[-1] for copy in range(times)])
    points = np.tile(dense.points, (times, 1)) + generator.normal(0, unit, (times * len(dense.points), 3))
    return DenseCloud(points, np.concatenate([[0], ends]), visible_views)


def _subsample_observations(view: View) -> View:
    """Return the view with at most `MAX_OBSERVATIONS` observations, evenly selected."""
    step = -(-len(view.point_index) // MAX_OBSERVATIONS)
    return replace(view, keypoints=view.keypoints[::step], point_index=view.point_index[::step])


def _limit_views(dense: DenseCloud) -> DenseCloud:
    """Return the cloud with at most `MAX_VIEWS_PER_POINT` views of each point."""
    assert dense.visible_offsets is not None
    assert dense.visible_views is not None
    counts = np.diff(dense.visible_offsets)
    position = np.arange(len(dense.visible_views)) - np.repeat(dense.visible_offsets[:-1], counts)
    keep = position < MAX_VIEWS_PER_POINT
    offsets = np.concatenate([[0], np.cumsum(np.minimum(counts, MAX_VIEWS_PER_POINT))])
    return replace(dense, visible_offsets=offsets, visible_views=dense.visible_views[keep])


def main() -> None:
    """Print the table, each row as soon as it is computed."""
    parser = options_parser(__doc__)
    parser.add_argument("--times", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--masks", type=int, nargs="+")
    options = parser.parse_args()
    if options.masks:
        print_rows(("masks", "objects", "processor s", "peak MiB", "exit"), map(_random_masks, options.masks))
        return
    world = furnished_room("sitting room", 7, Knobs(views=VIEWS))
    synthetic = quick_scene(world, Knobs(views=VIEWS), 7, dense_a_frame=POINTS // VIEWS)
    assert synthetic.scene.dense is not None
    views = tuple(_subsample_observations(view) for view in synthetic.scene.views)
    synthetic = replace(
        synthetic, scene=replace(synthetic.scene, views=views, dense=_limit_views(synthetic.scene.dense))
    )
    columns = ("views", "dense points", "masks", "processor s", "peak MiB", "exit", "scale over true")
    print_rows(columns, (_row(repeated(synthetic, times), world) for times in options.times))


def _random_masks(count: int) -> tuple[object, ...]:
    """Return the row of `demo_room` with `count` random masks."""
    generator = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "scene"
        shutil.copytree(ROOT / "data" / "scenes" / "demo_room", folder)
        table = json.loads((folder / "instances.json").read_bytes())
        annotations = []
        for number in range(count):
            image = table["images"][generator.integers(len(table["images"]))]
            width, height = generator.integers(8, 61, 2).tolist()
            left, top = (int(generator.integers(image[n] - side)) for n, side in (("width", width), ("height", height)))
            category = table["categories"][generator.integers(len(table["categories"]))]
            corners = [left, top, left + width, top, left + width, top + height, left, top + height]
            row = {"id": number + 1, "image_id": image["id"], "category_id": category["id"], "iscrowd": 0}
            annotations.append(row | {"segmentation": [corners], "bbox": [left, top, width, height]})
        (folder / "instances.json").write_text(json.dumps(table | {"annotations": annotations}), encoding="utf-8")
        run = run_child(ours("estimate-scale", folder, "--quiet", "--json"), limit_s=900)
    objects = len(json.loads(run.output)["objects"]) if run.output else None
    return f"{count:,}", objects, f"{run.cpu_s:.0f}", f"{run.peak_mib:.0f}", run.status


def _row(large: SyntheticScene, world: World) -> tuple[object, ...]:
    dense = large.scene.dense
    assert dense is not None
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_scene(large, world, folder)
        run = run_child(ours("estimate-scale", folder, "--quiet", "--json"))
        masks = len(json.loads((folder / "instances.json").read_bytes())["annotations"])
    scale = json.loads(run.output)["scale"]
    cost = f"{run.cpu_s:.0f}", f"{run.peak_mib:.0f}", run.status
    ratio = None if scale is None else f"{scale / large.truth.metres_per_unit:.3f}"
    return len(large.scene.views), f"{len(dense.points):,}", f"{masks:,}", *cost, ratio


if __name__ == "__main__":
    main()
