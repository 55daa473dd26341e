"""Where the error of a synthetic room comes from: the truth is replaced by what was measured, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.methods import UNTRACKED, Case, object_outcomes, track_of
from benchmarks.accuracy.outcomes import Outcome
from estimator.pipeline import measure_objects
from estimator.records.measured_object import MeasuredObject
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree

__all__ = ["STAGES", "budget_outcomes"]

#: One standard deviation of the log of a true extent: none is known better than this.
TRUE_SIGMA = 0.02
_WHOLE = np.zeros(3, dtype=bool)

#: What is done to a measured object, given its true extents (3,) in scene units, in the order of the table.
STAGES: dict[str, Callable[[MeasuredObject, FloatArray], MeasuredObject]] = {
    "true sizes of the objects measured": lambda item, true: replace(
        item, extents=true, sigma=np.full(3, TRUE_SIGMA), truncated=_WHOLE, covariance=None
    ),
    "with the spread that their measurement states": lambda item, true: replace(
        item, extents=true, truncated=_WHOLE, covariance=None
    ),
    "with their flags as well": lambda item, true: replace(item, extents=true, covariance=None),
    "measured heights, true sides": lambda item, true: replace(
        item, extents=np.append(true[:2], item.extents[2]), truncated=_WHOLE, covariance=None
    ),
    "measured sides, true heights": lambda item, true: replace(
        item, extents=np.append(item.extents[:2], true[2]), truncated=_WHOLE, covariance=None
    ),
    "measured, no side flagged": lambda item, _: replace(item, truncated=_WHOLE),
    "measured, flags as they are": lambda item, _: item,
}


def budget_outcomes(case: Case, tree: Tree) -> Iterator[Outcome]:
    """The outcome of each stage on a synthetic room whose true sizes are known.

    The first has every object of the room at its true size; the last is the method `default`, wrong names included.
    """
    entries = measure_objects(case.scene, case.instances, UNTRACKED).objects
    tracks = [str(track_of(item, case.instances)) for item in entries]
    known = [
        (replace(item, category=case.categories[track]), case.sizes[track] / case.scale)
        for item, track in zip(entries, tracks, strict=True)
        if item.skipped is None and track in case.sizes
    ]
    sigma = np.full(3, TRUE_SIGMA)
    everything = [
        MeasuredObject(track, case.categories[track], size / case.scale, sigma) for track, size in case.sizes.items()
    ]
    stages = {"true sizes of all objects in the room": everything}
    stages |= {name: [change(*pair) for pair in known] for name, change in STAGES.items()}
    stages["and names as they are"] = list(entries)
    for name, objects in stages.items():
        for one in object_outcomes("budget", case.group, case.name, objects, case.scale, tree, ("default",)):
            yield replace(one, method=name)
