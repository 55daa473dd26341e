"""Measure our run times and print them next to the paper's.

    OMP_NUM_THREADS=1 python -m benchmarks.estimator.times

The paper's times (section 5.1) are from an i7-6850K with a GTX 1080 Ti. Ours are measured on this machine with one
thread: the median of several runs, and the minimum, which is more reliable on a busy machine. Labels are measured in a
synthetic room with 100,000 dense points and ten masks per frame, the posterior on fifty objects of synthetic rooms.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from statistics import median

import numpy as np

import metric_tree
from benchmarks.child import ours, run_child
from benchmarks.common import ROOT, options_parser
from benchmarks.estimator.simulation import Knobs, World, simulated, world
from estimator.association.point_labels import dense_labels, sparse_labels
from estimator.pipeline import measure_objects
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import posterior
from estimator.records.objects import MeasuredObject
from estimator.records.scene import Instance
from estimator.results.estimate import scale_of_objects
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene

N_RUNS = 7
#: Number of runs of steps that take a few milliseconds. The median of fewer runs depends on other load.
N_SHORT_RUNS = 50
DENSE_POINTS = 100_000
#: Maximum number of masks per frame.
MAX_MASKS = 10
N_OBJECTS = 50
#: Numbers of simulated objects in the timing of the posterior (target: 3 ms of processor time for 50).
COUNTS = (5, 20, 50, 200)
DEMO = ROOT / "data" / "scenes" / "demo_room"
#: Imports that every query needs.
LIBRARIES = "import numpy, pyarrow.parquet"
QUERY = "import metric_tree; metric_tree.open().find('swivel chair').prior().quantile(0.5)"


def main() -> None:
    options_parser(__doc__).parse_args()
    tree = metric_tree.open()
    synthetic = quick_scene(furnished_room("sitting room", 0), dense_a_frame=DENSE_POINTS // 24 + 1)
    views = len(synthetic.scene.views)
    few = _largest_masks(synthetic)
    dense = synthetic.scene.dense
    assert dense is not None  # `dense_a_frame` is above 0
    blind = replace(synthetic.scene, dense=replace(dense, visible_offsets=None, visible_views=None))
    measurements = measure_objects(synthetic.scene, synthetic.instances)
    objects = _objects(N_OBJECTS)
    dimensions = [measure_objects(synthetic.scene, synthetic.instances).timings["dimensions"] for _ in range(N_RUNS)]
    scale_of_objects(objects, tree)  # the first call fills caches
    fifty = [scale_of_objects(objects, tree).seconds["posterior"] for _ in range(N_SHORT_RUNS)]
    scene_posterior = [scale_of_objects(measurements.objects, tree).seconds["posterior"] for _ in range(N_SHORT_RUNS)]
    classes = world(tree, baselines=False)
    processes = _in_turns(
        {
            "start to answer, demo scene": ours("estimate-scale", DEMO),
            "import numpy and pyarrow.parquet": [sys.executable, "-c", LIBRARIES],
            "import metric_tree and one query": [sys.executable, "-c", QUERY],
            "metric-tree query chair": ours("metric-tree", "query", "chair"),
        }
    )
    rows = [
        (f"labels, a frame ({len(dense.points):,} dense points, {MAX_MASKS} masks, depth test)", "200 ms",
         _a_frame(lambda: dense_labels(blind, few), views)),
        ("labels, a frame (the same with the cloud's visibility file)", "200 ms",
         _a_frame(lambda: dense_labels(synthetic.scene, few), views)),
        (f"labels, a frame ({len(synthetic.scene.points):,} sparse points)", "200 ms",
         _a_frame(lambda: sparse_labels(synthetic.scene, few), views)),
        (f"dimensions, a scene ({len(measurements.objects)} objects)", "20 ms", dimensions),
        (f"posterior, a scene ({len(measurements.objects)} objects)", "4 ms", scene_posterior),
        (f"posterior, {N_OBJECTS} objects", "4 ms", fifty),
        *((f"posterior, {count} simulated objects", "4 ms", _simulated(classes, count)) for count in COUNTS),
        *((f"{name} (new process)", "-", seconds) for name, seconds in processes.items()),
    ]  # fmt: skip
    where = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(f"{where}, load {os.getloadavg()[0]:.1f}\n\n| what | paper | here, median | here, least |\n|---|---|---|---|")
    for what, paper, taken in rows:
        print(f"| {what} | {paper} | {1000 * median(taken):.2f} ms | {1000 * min(taken):.2f} ms |")
    _, libraries, *queries = processes.values()
    ratios = [f"{median(a / b for a, b in zip(own, libraries, strict=True)):.2f}" for own in queries]
    print(f"\nover the libraries, median of the turns: a query {ratios[0]}, the command {ratios[1]}")


def _timed(
    call: Callable[[], object], runs: int = N_RUNS, clock: Callable[[], float] = time.perf_counter
) -> list[float]:
    """Return the duration in seconds of each of `runs` calls."""
    taken = []
    for _ in range(runs):
        started = clock()
        call()
        taken.append(clock() - started)
    return taken


def _a_frame(call: Callable[[], object], views: int) -> list[float]:
    return [seconds / views for seconds in _timed(call)]


def _in_turns(commands: Mapping[str, list[str]]) -> dict[str, list[float]]:
    """Return the processor seconds of commands in new interpreters with compiled bytecode.

    The commands alternate, so that other load on the machine affects all of them equally.
    """
    compiled = {"PYTHONDONTWRITEBYTECODE": ""}
    turns = [{name: run_child(words, environment=compiled) for name, words in commands.items()} for _ in range(16)]
    if wrong := [run.errors for run in turns[0].values() if run.status not in (0, 3)]:  # 3: the scale is not resolved
        raise SystemExit(wrong[0][-500:])
    return {name: [turn[name].cpu_s for turn in turns[1:]] for name in commands}  # the first run fills the disk cache


def _simulated(classes: World, count: int) -> list[float]:
    """Return the processor seconds of the posterior of `count` simulated objects."""
    _, objects = simulated(classes, Knobs(objects=count), np.random.default_rng(1))
    evidence = [ObjectEvidence(item, classes.priors[label], classes.nodes[label].pose) for label, item in objects]
    posterior(evidence)  # fills the caches
    return _timed(lambda: posterior(evidence), N_SHORT_RUNS, time.process_time)


def _largest_masks(synthetic: SyntheticScene) -> list[Instance]:
    """Return the `MAX_MASKS` largest masks of each frame."""
    by_view: dict[int, list[Instance]] = {}
    for item in sorted(synthetic.instances, key=lambda item: -int(item.mask.sum())):
        if len(by_view.setdefault(item.view, [])) < MAX_MASKS:
            by_view[item.view].append(item)
    return [item for view in sorted(by_view) for item in by_view[view]]


def _objects(count: int) -> list[MeasuredObject]:
    """Return `count` measured objects of several rooms in metres, as of one large scene."""
    measured: list[MeasuredObject] = []
    for seed in range(3):
        for kind in KINDS:
            if len(measured) >= count:
                return measured[:count]
            synthetic = quick_scene(furnished_room(kind, seed), seed=seed)
            for entry in measure_objects(synthetic.scene, synthetic.instances).objects:
                if entry.skipped is None:
                    unit = replace(
                        entry, id=str(len(measured)), extents=entry.extents * synthetic.truth.metres_per_unit
                    )
                    measured.append(unit)
    return measured[:count]


if __name__ == "__main__":
    main()
