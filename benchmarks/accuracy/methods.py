"""Every method on one scene: default, paper, sucar, height, and both without the extraction of dimensions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.accuracy.outcomes import LEVEL, Outcome, outcome_of
from estimator.baselines.paper import paper_result
from estimator.baselines.sucar import box_heights, prescribed_down, sucar_result
from estimator.pipeline import measure_objects
from estimator.records.objects import MeasuredObject
from estimator.records.options import PAPER, EstimateOptions, MeasurementOptions
from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, Scene
from estimator.results.estimate import scale_of_objects
from metric_tree.tree import Tree

__all__ = ["METHODS", "TRUE_SIZES", "Case", "object_outcomes", "scene_outcomes"]

#: The default on all objects of a synthetic scene at their true sizes: what the priors alone lose.
TRUE_SIZES = "default, true sizes"
#: In the order of the tables. "all dimensions" takes every side as measured: the paper's arm without its confidence,
#: ours without truncation flags.
METHODS = ("default", "height", "paper", "sucar", "default, all dimensions", "paper, all dimensions")

#: Synthetic masks state their true objects; no method may see them.
UNTRACKED = MeasurementOptions(stated_tracks=False)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A scene with its masks, and what is true of it.

    scale : metres per unit; heights : metres, by track; exact : objects at their true sizes, where these are known.
    """

    group: str
    name: str
    scene: Scene
    instances: tuple[Instance, ...]
    scale: float
    heights: Mapping[str, float] = field(default_factory=dict)
    exact: tuple[MeasuredObject, ...] = ()


def scene_outcomes(part: str, case: Case, tree: Tree) -> Iterator[Outcome]:
    """The outcome of each method; those that measure alike share the measurement."""
    ours = measure_objects(case.scene, case.instances, UNTRACKED).objects
    theirs = measure_objects(case.scene, case.instances, PAPER).objects
    if case.exact:
        result = _result("default", case.exact, tree)
        yield outcome_of(part, case.group, case.name, TRUE_SIZES, result, case.scale)
    for method in METHODS:
        if method == "sucar":
            result = sucar_result(case.scene, case.instances, tree, EstimateOptions(method="sucar", level=LEVEL))
            tall = box_heights(case.scene, case.instances, prescribed_down(case.scene))
            tracks = [item.track for item in case.instances]
        else:
            objects = theirs if method.startswith("paper") else ours
            result = _result(method, objects, tree)
            tall = np.array([entry.extents[2] for entry in objects])
            tracks = [_track_of(entry, case.instances) for entry in objects]
        error = _height_error(result, tall.tolist(), tracks, case.heights)
        yield outcome_of(part, case.group, case.name, method, result, case.scale, error)


def object_outcomes(
    part: str,
    group: str,
    name: str,
    objects: Sequence[MeasuredObject],
    scale: float,
    tree: Tree,
    methods: Sequence[str],
) -> Iterator[Outcome]:
    """The outcome of each method on objects that were measured elsewhere."""
    for method in methods:
        yield outcome_of(part, group, name, method, _result(method, objects, tree), scale)


def _result(method: str, objects: Sequence[MeasuredObject], tree: Tree) -> ScaleResult:
    name = method.partition(",")[0]
    if method.endswith("all dimensions"):
        nothing = np.full(3, np.nan), np.zeros(3, dtype=bool)
        objects = [replace(entry, confidence=nothing[0], truncated=nothing[1]) for entry in objects]
    options = EstimateOptions(method=name, level=LEVEL)
    return paper_result(objects, tree, options) if name == "paper" else scale_of_objects(objects, tree, options)


def _track_of(entry: MeasuredObject, instances: Sequence[Instance]) -> str | None:
    """The true object that most masks of a measured one show."""
    return Counter(instances[row].track for row in entry.members).most_common(1)[0][0]


def _height_error(
    result: ScaleResult, heights: Sequence[float], tracks: Sequence[str | None], true: Mapping[str, float]
) -> float:
    """Mean over objects of |scale * height / true height - 1| (paper section 5.1), by the highest mode."""
    if not result.modes:
        return float("nan")
    scale = result.modes[0].scale
    errors = [
        abs(scale * height / true[track] - 1)
        for height, track in zip(heights, tracks, strict=True)
        if track is not None and track in true and np.isfinite(height)
    ]
    return float(np.mean(errors)) if errors else float("nan")
