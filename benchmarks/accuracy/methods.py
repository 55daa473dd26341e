"""Run all methods on a scene: default, height, paper, sucar, and default and paper without truncation flags."""

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

#: The default method on the true sizes of all objects of a synthetic scene: the error due to the priors.
TRUE_SIZES = "default, true sizes"
#: Methods in the order of the tables. "all dimensions" uses every side as measured: the paper's method without its
#: confidence, ours without truncation flags.
METHODS = ("default", "height", "paper", "sucar", "default, all dimensions", "paper, all dimensions")

#: Synthetic masks contain the true object identities, which the methods must not use.
UNTRACKED = MeasurementOptions(stated_tracks=False)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A scene with its masks and its ground truth.

    scale : metres per unit.
    heights : true heights in metres by track.
    exact : objects with their true sizes, if these are known.
    """

    group: str
    name: str
    scene: Scene
    instances: tuple[Instance, ...]
    scale: float
    heights: Mapping[str, float] = field(default_factory=dict)
    exact: tuple[MeasuredObject, ...] = ()


def scene_outcomes(part: str, case: Case, tree: Tree) -> Iterator[Outcome]:
    """Yield the outcome of each method. Methods with the same measurement options share the measurement."""
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
            # the true object of most masks of a measured object
            tracks = [
                Counter(case.instances[row].track for row in entry.members).most_common(1)[0][0] for entry in objects
            ]
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
    """Yield the outcome of each method on objects that are already measured."""
    for method in methods:
        yield outcome_of(part, group, name, method, _result(method, objects, tree), scale)


def _result(method: str, objects: Sequence[MeasuredObject], tree: Tree) -> ScaleResult:
    name = method.partition(",")[0]
    if method.endswith("all dimensions"):
        confidence, truncated = np.full(3, np.nan), np.zeros(3, dtype=bool)
        objects = [replace(entry, confidence=confidence, truncated=truncated) for entry in objects]
    options = EstimateOptions(method=name, level=LEVEL)
    return paper_result(objects, tree, options) if name == "paper" else scale_of_objects(objects, tree, options)


def _height_error(
    result: ScaleResult, heights: Sequence[float], tracks: Sequence[str | None], true: Mapping[str, float]
) -> float:
    """Return the mean over objects of |scale * height / true height - 1| (paper, section 5.1) at the highest mode."""
    if not result.modes:
        return float("nan")
    scale = result.modes[0].scale
    errors = [
        abs(scale * height / true[track] - 1)
        for height, track in zip(heights, tracks, strict=True)
        if track is not None and track in true and np.isfinite(height)
    ]
    return float(np.mean(errors)) if errors else float("nan")
