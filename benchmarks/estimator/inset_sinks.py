"""Sinks set into counters of synthetic rooms: `python -m benchmarks.estimator.inset_sinks`.

Prints the error of their measured sizes, how often the masks alone say that the height is truncated, and how far the
scale by the sink alone, and by all objects, is off with the height as measured and as the estimate takes it. No
constant was set on these rooms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.common import seeds_parser, table_head
from estimator.pipeline import measure_objects
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import FloatArray
from metric_tree.tree import open_tree
from tests.synthetic.rooms import shapes
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import HARD, with_knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.sizes import typical_sizes
from tests.synthetic.rooms.solids import Mesh, box, stretch_to
from tests.synthetic.rooms.world import Placed, World

KINDS = ("kitchen", "toilet")
#: Length, width, height in metres; the sink is in the middle of the counter, its rim level with the top.
COUNTER, SINK = np.array([1.4, 0.6, 0.9]), np.array([0.58, 0.44, 0.19])
VIEWS = 16


def main() -> None:
    """The command."""
    options = seeds_parser(__doc__, 0, 12).parse_args()
    shapes.CATEGORIES["cabinet"] = _counter
    tree, knobs = open_tree(), with_knobs(HARD, views=VIEWS)
    rows: dict[str, list[FloatArray]] = {"dense": [], "sparse": []}
    for kind, seed in ((kind, seed) for kind in KINDS for seed in range(*options.seeds)):
        world = _with_sink(furnished_room(kind, seed, knobs, _sizes))
        if world is None:
            continue
        room = quick_scene(world, knobs, seed=seed)
        for points, scene in (("dense", room.scene), ("sparse", replace(room.scene, dense=None))):
            objects = measure_objects(scene, room.instances).objects
            true = room.truth.metres_per_unit
            for place, sink in enumerate(objects):
                if sink.category != "sink" or sink.skipped is not None or sink.truncated.all():
                    continue
                # an object that reaches down to what it stands on keeps its height
                whole = replace(sink, unsupported_height=float(sink.extents[2]))
                others = [*objects[:place], *objects[place + 1 :]]
                answers = [[item, *rest] for rest in ([], others) for item in (whole, sink)]
                scales = [scale_of_objects(items, tree).modes[0].scale for items in answers]
                errors = (
                    np.log(sink.extents * true / SINK),
                    [sink.truncated[2]],
                    np.abs(np.log(np.array(scales) / true)),
                )
                rows[points].append(np.concatenate(errors))
    columns = ("points", "sinks", "length, width, height", "said to be truncated", "sink alone", "all objects")
    print(table_head(columns))
    for points, values in rows.items():
        length, width, height = np.median(values, axis=0)[:3]
        said, *errors = np.mean(values, axis=0)[3:]
        alone, together = (f"{errors[n]:.1%} to {errors[n + 1]:.1%}" for n in (0, 2))
        sizes = f"{length:+.2f}, {width:+.2f}, {height:+.2f}"
        print(f"| {points} | {len(values)} | {sizes} | {said:.0%} | {alone} | {together} |")


def _sizes(category: str, generator: np.random.Generator) -> FloatArray:
    return 1000 * COUNTER if category == "cabinet" else typical_sizes(category, generator)


def _counter() -> list[Mesh]:
    """A cabinet with a hole for the sink, in a unit cube."""
    (x, y, _), low = (COUNTER - SINK) / 2 / COUNTER, 1 - SINK[2] / COUNTER[2] - 0.01
    rim = [((0, x), (0, 1)), ((1 - x, 1), (0, 1)), ((x, 1 - x), (0, y)), ((x, 1 - x), (1 - y, 1))]
    return [box((0, 1), (0, 1), (0, low), "wood"), *(box(along, across, (low, 1), "wood") for along, across in rim)]


def _with_sink(world: World) -> World | None:
    """The world with a sink in its first cabinet, which has nothing on it then; None without one."""
    host = next((item for item in world.objects if item.category == "cabinet" and not item.tilt_deg), None)
    if host is None:
        return None
    local = shapes.solid("cabinet", COUNTER).vertices
    to_world = np.linalg.lstsq(_with_one(local), host.mesh.vertices, rcond=None)[0]  # (4, 3)
    sink = stretch_to(shapes.solid("sink", SINK), SINK)
    middle = (local.max(axis=0) + local.min(axis=0)) / 2 - (sink.vertices.max(axis=0) + sink.vertices.min(axis=0)) / 2
    middle[2] = local[:, 2].max() - sink.vertices[:, 2].max()
    mesh = replace(sink, vertices=_with_one(sink.vertices + middle) @ to_world)
    kept = [replace(item, label="counter") if item is host else item for item in world.objects]
    kept = [item for item in kept if item.support != host.track]
    return replace(world, objects=(*kept, Placed("sink-1", "sink", "sink", SINK, mesh, support=host.track)))


def _with_one(points: FloatArray) -> FloatArray:
    """(n, 4) homogeneous coordinates of points (n, 3)."""
    return np.column_stack([points, np.ones(len(points))])


if __name__ == "__main__":
    main()
