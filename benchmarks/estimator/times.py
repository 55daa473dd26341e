"""The paper's times and ours, side by side in one run.

`OMP_NUM_THREADS=1 python -m benchmarks.estimator.times`.

The paper's figures (section 5.1) are from an i7-6850K with a GTX 1080 Ti; ours are of this machine, on one thread,
medians of several runs, and the least, which says more where other work shares the machine. Labels: a synthetic room of
100,000 dense points and ten masks a frame. Posterior: fifty objects of synthetic rooms.
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

RUNS = 7
#: Runs of what takes a few milliseconds: the median of a few says more about the machine's other work.
SHORT_RUNS = 50
DENSE_POINTS, MASKS = 100_000, 10
OBJECTS = 50
#: Simulated objects, one side in five cut, for the posterior alone (the goal: 3 ms of a processor for 50).
COUNTS = (5, 20, 50, 200)
DEMO = ROOT / "data" / "scenes" / "demo_room"
#: What a query cannot do without.
LIBRARIES = "import numpy, pyarrow.parquet"
QUERY = "import metric_tree; metric_tree.open().find('swivel chair').prior().quantile(0.5)"


def main() -> None:
    options_parser(__doc__).parse_args()
    tree = metric_tree.open()
    synthetic = quick_scene(furnished_room("sitting room", 0), dense_a_frame=DENSE_POINTS // 24 + 1)
    views = len(synthetic.scene.views)
    few = _masks_a_frame(synthetic, MASKS)
    dense = synthetic.scene.dense
    assert dense is not None  # asked for
    blind = replace(synthetic.scene, dense=replace(dense, visible_offsets=None, visible_views=None))
    measurements = measure_objects(synthetic.scene, synthetic.instances)
    objects = _objects(OBJECTS)
    dimensions = [measure_objects(synthetic.scene, synthetic.instances).timings["dimensions"] for _ in range(RUNS)]
    scale_of_objects(objects, tree)  # the first call loads what every later one shares
    fifty = [scale_of_objects(objects, tree).seconds["posterior"] for _ in range(SHORT_RUNS)]
    scene_posterior = [scale_of_objects(measurements.objects, tree).seconds["posterior"] for _ in range(SHORT_RUNS)]
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
        (f"labels, a frame ({len(dense.points):,} dense points, {MASKS} masks, depth test)", "200 ms",
         _a_frame(lambda: dense_labels(blind, few), views)),
        ("labels, a frame (the same with the cloud's visibility file)", "200 ms",
         _a_frame(lambda: dense_labels(synthetic.scene, few), views)),
        (f"labels, a frame ({len(synthetic.scene.points):,} sparse points)", "200 ms",
         _a_frame(lambda: sparse_labels(synthetic.scene, few), views)),
        (f"dimensions, a scene ({len(measurements.objects)} objects)", "20 ms", dimensions),
        (f"posterior, a scene ({len(measurements.objects)} objects)", "4 ms", scene_posterior),
        (f"posterior, {OBJECTS} objects", "4 ms", fifty),
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


def _timed(call: Callable[[], object], runs: int = RUNS, clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Seconds of each of several calls."""
    taken = []
    for _ in range(runs):
        started = clock()
        call()
        taken.append(clock() - started)
    return taken


def _a_frame(call: Callable[[], object], views: int) -> list[float]:
    return [seconds / views for seconds in _timed(call)]


def _in_turns(commands: Mapping[str, list[str]]) -> dict[str, list[float]]:
    """Processor seconds of fresh interpreters with compiled bytecode, in turns, so that a busy machine is so to all."""
    compiled = {"PYTHONDONTWRITEBYTECODE": ""}
    turns = [{name: run_child(words, environment=compiled) for name, words in commands.items()} for _ in range(16)]
    if wrong := [run.errors for run in turns[0].values() if run.status not in (0, 3)]:  # 3: the scale is not resolved
        raise SystemExit(wrong[0][-500:])
    return {name: [turn[name].cpu_s for turn in turns[1:]] for name in commands}  # the first fills the disk's cache


def _simulated(classes: World, count: int) -> list[float]:
    """Processor seconds of the posterior, from measured objects and priors to scale, modes, interval and weights."""
    _, objects = simulated(classes, Knobs(objects=count), np.random.default_rng(1))
    evidence = [ObjectEvidence(item, classes.priors[said], classes.nodes[said].pose) for said, item in objects]
    posterior(evidence)  # fills the tables
    return _timed(lambda: posterior(evidence), SHORT_RUNS, time.process_time)


def _masks_a_frame(synthetic: SyntheticScene, most: int) -> list[Instance]:
    """The `most` largest masks of every frame."""
    largest = sorted(synthetic.instances, key=lambda item: -int(item.mask.sum()))
    kept: dict[int, list[Instance]] = {}
    for item in largest:
        if len(kept.setdefault(item.view, [])) < most:
            kept[item.view].append(item)
    return [item for view in sorted(kept) for item in kept[view]]


def _objects(count: int) -> list[MeasuredObject]:
    """Measured objects of several rooms, brought to one scale, so that they can be read as one large scene."""
    gathered: list[MeasuredObject] = []
    for seed in range(3):
        for kind in KINDS:
            if len(gathered) >= count:
                return gathered[:count]
            synthetic = quick_scene(furnished_room(kind, seed), seed=seed)
            for entry in measure_objects(synthetic.scene, synthetic.instances).objects:
                if entry.skipped is None:
                    unit = replace(
                        entry, id=str(len(gathered)), extents=entry.extents * synthetic.truth.metres_per_unit
                    )
                    gathered.append(unit)
    return gathered[:count]


if __name__ == "__main__":
    main()
