"""Self-contradiction: how far a reconstruction disagrees with its own observations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from estimator.projection.cameras import project
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray

__all__ = ["Consistency", "consistency", "contradictions"]

# Observations of a view that are looked at; a thousand give a median to a few per cent.
MAX_OBSERVATIONS = 1000
# Reprojection errors as shares of the longer image side. Structure from motion drops observations off by more than 4
# pixels, 0.4 % of an image of a thousand; the median of a good model is a tenth of that. Pixels rounded to whole ones,
# or poses of another run, stay under the first bound.
DOUBTFUL_ERROR, WRONG_ERROR = 0.004, 0.02
# Shares of the observations that miss by more than the second bound above. None in a model that a bundle adjustment
# wrote; two parts at different scales, or shifted against each other, miss in all observations across the joint.
DOUBTFUL_MISSES, WRONG_MISSES = 0.02, 0.1
# Points behind the cameras that observed them: none in a model that a bundle adjustment wrote.
DOUBTFUL_BEHIND, WRONG_BEHIND = 0.02, 0.2
# The depths of the middle nine tenths of a view's points span this factor at most, or the nearest are at the lens.
DOUBTFUL_DEPTHS = 300.0

# Fewer views without a point in common with the others are strays.
MIN_GROUP = 2


@dataclass(frozen=True, slots=True)
class Consistency:
    """How well the observations of a scene agree with its cameras and points; NaN where it has no observations.

    reprojection_px : median distance of a keypoint from the projection of its point, in pixels; reprojection_share :
    the same over the longer side of its image; misses : share of the observations for which that is over 0.02;
    behind : share of the observed points behind their camera; depth_ratio : median over the views of the 95 % quantile
    of depth over the 5 % one; groups : of views that are joined by no point, whose scales nothing ties together.
    """

    reprojection_px: float
    reprojection_share: float
    misses: float
    behind: float
    depth_ratio: float
    groups: int


def consistency(scene: Scene) -> Consistency:
    """The agreement of a scene's observations with its own geometry.

    Equation: e = |K(R X + t) - x| over the observations x of points X, lens distortion included.
    """
    errors, shares, behind, ratios = [np.empty(0)], [np.empty(0)], [np.empty(0)], []
    for view in scene.views:
        step = max(1, -(-len(view.point_index) // MAX_OBSERVATIONS))
        points = scene.points[view.point_index[::step]]
        if not len(points):
            continue
        error, depth = _errors_and_depths(view, points, view.keypoints[::step])
        errors.append(error)
        shares.append(error / max(view.camera.width, view.camera.height))
        behind.append((depth <= 0).astype(float))
        ahead = depth[depth > 0]
        if len(ahead):
            ratios.append(float(np.quantile(ahead, 0.95) / np.quantile(ahead, 0.05)))
    every = np.concatenate(shares)
    return Consistency(
        _median(np.concatenate(errors)),
        _median(every),
        float(np.mean(every > WRONG_ERROR)) if len(every) else np.nan,
        float(np.mean(np.concatenate(behind))) if len(behind) > 1 else np.nan,
        float(np.median(ratios)) if ratios else np.nan,
        _groups(scene),
    )


def contradictions(measures: Consistency) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the measures say against a reconstruction: sentences of doubt, and sentences that rule it out."""
    doubts: list[str] = []
    errors: list[str] = []
    if measures.reprojection_share > DOUBTFUL_ERROR:
        sentence = f"the points miss their own observations by {measures.reprojection_px:.1f} pixels (median)"
        (errors if measures.reprojection_share > WRONG_ERROR else doubts).append(sentence)
    elif measures.misses > DOUBTFUL_MISSES:
        sentence = (
            f"{measures.misses:.0%} of the observations are more than {WRONG_ERROR:.0%} of the image off their points"
        )
        (errors if measures.misses > WRONG_MISSES else doubts).append(f"{sentence}: parts of the model do not fit")
    if measures.behind > DOUBTFUL_BEHIND:
        sentence = f"{measures.behind:.0%} of the observed points are behind their camera"
        (errors if measures.behind > WRONG_BEHIND else doubts).append(sentence)
    if measures.depth_ratio > DOUBTFUL_DEPTHS:
        doubts.append(f"the depths in a view span a factor {measures.depth_ratio:.0f}")
    if measures.groups > 1:
        doubts.append(f"the views fall into {measures.groups} groups that share no point: each may have its own scale")
    return tuple(doubts), tuple(errors)


def _errors_and_depths(view: View, points: FloatArray, keypoints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k,) reprojection errors in pixels of the points ahead, (n,) depths, of points (n, 3) with keypoints (n, 2)."""
    points_camera = points @ view.rotation.T + view.translation
    error = np.linalg.norm(project(view.camera, points_camera) - keypoints, axis=1)
    return error[np.isfinite(error)], points_camera[:, 2]


def _groups(scene: Scene) -> int:
    """Groups of `MIN_GROUP` views or more that are joined by the points they observe."""
    count, rows = len(scene.views), [view.point_index for view in scene.views]
    seen = np.repeat(np.arange(count), [len(part) for part in rows])
    points = count + np.concatenate([*rows, np.empty(0, dtype=np.int64)]).astype(np.int64)
    size = count + len(scene.points)
    graph = csr_array((np.ones(len(seen), dtype=bool), (seen, points)), shape=(size, size))
    _, group = connected_components(graph, directed=False)
    return int(np.sum(np.bincount(group[:count], minlength=1) >= MIN_GROUP))


def _median(values: FloatArray) -> float:
    """The median of values (n,), NaN of none."""
    return float(np.median(values)) if len(values) else np.nan
