"""The methods under test, each from a scene in memory to its score."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.baselines.paper import paper_result
from estimator.baselines.sucar import box_heights, prescribed_down, sucar_result
from estimator.pipeline import measure_objects
from estimator.records.objects import Measurements, Track
from estimator.records.options import PAPER, EstimateOptions, MeasurementOptions
from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, Scene
from estimator.results.estimate import scale_of_objects
from metric_tree.tree import Tree
from tests.synthetic.rooms.scores import Score, height_error
from tests.synthetic.rooms.truth import Truth

__all__ = ["ARMS", "AUTHORS", "Case", "scores"]

#: The paper's recipe on the authors' own lists in place of our items.
AUTHORS = "paper, authors' lists"

#: Arms of the comparison by name: the estimator's method, and how objects are measured (None: not at all).
ARMS: dict[str, tuple[str, MeasurementOptions | None]] = {
    "paper": ("paper", PAPER),
    AUTHORS: ("paper", PAPER),
    "sucar": ("sucar", None),
    "height": ("height", MeasurementOptions()),
    "height, no planes": ("height", MeasurementOptions(supports=False)),
    "default": ("default", MeasurementOptions()),
    "default, no planes": ("default", MeasurementOptions(supports=False)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A scene to be judged by: its name, reconstruction, masks and truth."""

    name: str
    scene: Scene
    instances: tuple[Instance, ...]
    truth: Truth


def scores(
    case: Case, tree: Tree, arms: Sequence[str], lists: Path | None = None
) -> dict[str, tuple[Score, ScaleResult, Measurements | None]]:
    """Score, result and measurements of each arm; arms that measure alike share the measurement.

    lists : the authors' lists, for the arm AUTHORS.
    """
    by_arm: dict[str, tuple[Score, ScaleResult, Measurements | None]] = {}
    measurements: dict[MeasurementOptions, Measurements] = {}
    for arm in arms:
        method, how = ARMS[arm]
        started = time.perf_counter()
        if how is None:
            result = sucar_result(case.scene, case.instances, tree, EstimateOptions(method=method))
            heights = box_heights(case.scene, case.instances, prescribed_down(case.scene))
            true = [item.track for item in case.instances]
            taken = None
        else:
            if how not in measurements:
                measurements[how] = measure_objects(case.scene, case.instances, replace(how, stated_tracks=False))
            taken = measurements[how]
            options = EstimateOptions(method=method, paper_lists=lists if arm == AUTHORS else None)
            if method == "paper":
                result = paper_result(taken.objects, tree, options)
            else:
                result = scale_of_objects(taken.objects, tree, options)
            heights = np.array([entry.extents[2] for entry in taken.objects])
            true = [_majority(case.instances, track) for track in taken.tracks]
        score = _score(case, arm, result, time.perf_counter() - started)
        if result.scale is not None:
            score = replace(score, heights=height_error(result.scale, list(heights), true, case.truth))
        by_arm[arm] = (score, result, taken)
    return by_arm


def _majority(instances: Sequence[Instance], track: Track) -> str | None:
    """The true object that most masks of a track shows."""
    names = Counter(instances[row].track for row in track.members)
    return names.most_common(1)[0][0]


def _score(case: Case, arm: str, result: ScaleResult, seconds: float) -> Score:
    true = case.truth.metres_per_unit
    if result.scale is None:
        return Score(case.name, arm, None, None, None, None, None, seconds)
    interval = result.interval
    return Score(
        case.name,
        arm,
        abs(result.scale / true - 1),
        float(np.log(result.scale / true)),
        None,
        None if interval is None else interval.low <= true <= interval.high,
        None if interval is None else interval.high / interval.low,
        seconds,
    )
