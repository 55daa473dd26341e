"""Where the error of a synthetic room comes from: the truth is replaced by what was measured, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.methods import UNTRACKED, Case, object_outcomes, track_of
from benchmarks.accuracy.outcomes import Outcome
from estimator.geometry.measurement import measure_objects
from estimator.records.measured_object import MeasuredObject
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree

__all__ = ["STAGES", "budget_outcomes"]

#: One standard deviation of the log of a true extent: none is known better than this.
TRUE_SIGMA = 0.02
_WHOLE = np.zeros(3, dtype=bool)

#: What is done to a measured thing, given its true extents (3,) in scene units, in the order of the table.
STAGES: dict[str, Callable[[MeasuredObject, FloatArray], MeasuredObject]] = {
    "true sizes of the things measured": lambda thing, true: replace(
        thing, extents=true, sigma=np.full(3, TRUE_SIGMA), truncated=_WHOLE
    ),
    "with the spread that their measurement states": lambda thing, true: replace(thing, extents=true, truncated=_WHOLE),
    "with their flags as well": lambda thing, true: replace(thing, extents=true),
    "measured heights, true sides": lambda thing, true: replace(
        thing, extents=np.append(true[:2], thing.extents[2]), truncated=_WHOLE
    ),
    "measured sides, true heights": lambda thing, true: replace(
        thing, extents=np.append(thing.extents[:2], true[2]), truncated=_WHOLE
    ),
    "measured, no side flagged": lambda thing, _: replace(thing, truncated=_WHOLE),
    "measured, flags as they are": lambda thing, _: thing,
}


def budget_outcomes(case: Case, tree: Tree) -> Iterator[Outcome]:
    """The outcome of each stage on a synthetic room whose true sizes are known.

    The first has every thing of the room at its true size; the last is the method `default`, wrong names included.
    """
    things = measure_objects(case.scene, case.instances, UNTRACKED).objects
    tracks = [str(track_of(thing, case.instances)) for thing in things]
    known = [
        (replace(thing, category=case.categories[track]), case.sizes[track] / case.scale)
        for thing, track in zip(things, tracks, strict=True)
        if thing.skipped is None and track in case.sizes
    ]
    sigma = np.full(3, TRUE_SIGMA)
    everything = [
        MeasuredObject(track, case.categories[track], size / case.scale, sigma) for track, size in case.sizes.items()
    ]
    stages = {"true sizes of all things in the room": everything}
    stages |= {name: [change(*pair) for pair in known] for name, change in STAGES.items()}
    stages["and names as they are"] = list(things)
    for name, objects in stages.items():
        for one in object_outcomes("budget", case.group, case.name, objects, case.scale, tree, ("default",)):
            yield replace(one, method=name)
