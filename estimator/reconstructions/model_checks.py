"""Degenerate geometry: reconstructions in which nothing has a size, each with a name.

Self-contradiction: how far a reconstruction disagrees with its own observations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from estimator.projection.cameras import project
from estimator.records.scene import Scene, SceneProblem, View
from metric_base.arrays import FloatArray

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
# Cameras whose places differ by less than this share of their distance from the points are in one place: with
# keypoints good to half a pixel and a focal length of 500, depths are then off by as much as they are long.
SAME_PLACE = 1e-3
# Points thinner than this share of their length have no thickness: a hundredth of the noise of a good cloud.
NO_THICKNESS = 1e-4
# Points further from the middle than this many median distances are strays and say nothing about the rest.
STRAY_TIMES = 10.0
# Fewer points have no shape.
MIN_POINTS = 4
#: So many points of a cloud, evenly taken, tell its shape as well as all.
ENOUGH_POINTS = 200_000
_WORDS = {"coincident": "all at one place", "collinear": "all on one line", "coplanar": "all in one plane"}


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


def check_reconstruction(scene: Scene) -> tuple[SceneProblem, ...]:
    """Check a reconstruction for degenerate geometry and, if there is none, for large reprojection errors.

    A degenerate reconstruction is a single fatal problem, whose message begins with its code.
    """
    degenerate = degeneracy(scene)
    if degenerate is not None:
        return (SceneProblem(f"{degenerate.code}: {degenerate.message}", is_fatal=True),)
    return reprojection_problems(consistency(scene))


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


def reprojection_problems(measures: Consistency) -> tuple[SceneProblem, ...]:
    """Return the contradictions between a reconstruction and its observations."""
    problems: list[SceneProblem] = []
    if measures.reprojection_share > DOUBTFUL_ERROR:
        message = f"the points miss their own observations by {measures.reprojection_px:.1f} pixels (median)"
        problems.append(SceneProblem(message, measures.reprojection_share > WRONG_ERROR))
    elif measures.misses > DOUBTFUL_MISSES:
        fraction = f"{measures.misses:.0%} of the observations are more than {WRONG_ERROR:.0%} of the image off"
        message = f"{fraction} their points: parts of the model do not fit"
        problems.append(SceneProblem(message, measures.misses > WRONG_MISSES))
    if measures.behind > DOUBTFUL_BEHIND:
        message = f"{measures.behind:.0%} of the observed points are behind their camera"
        problems.append(SceneProblem(message, measures.behind > WRONG_BEHIND))
    if measures.depth_ratio > DOUBTFUL_DEPTHS:
        problems.append(SceneProblem(f"the depths in a view span a factor {measures.depth_ratio:.0f}"))
    if measures.groups > 1:
        groups = f"{measures.groups} groups that share no point"
        problems.append(SceneProblem(f"the views fall into {groups}: each may have its own scale"))
    return tuple(problems)


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


@dataclass(frozen=True, slots=True)
class Degeneracy:
    """Why nothing in a reconstruction has a size.

    code : `no_views`, `one_view`, `no_points`, `coincident_cameras`, `coincident_points`, `collinear_points` or
    `coplanar_points`; message : the same as a sentence for people.
    """

    code: str
    message: str


def degeneracy(scene: Scene) -> Degeneracy | None:
    """The degeneracy of a scene, None where its geometry is whole.

    With singular values s1 >= s2 >= s3 of the centred points, they are coplanar where s3 < 1e-4 s1, collinear where s2
    < 1e-4 s1. The cameras coincide where their centres differ by less than 1e-3 of the median distance to the points.
    A dense cloud, where there is one, counts as points too.
    """
    if len(scene.views) < 2:
        return Degeneracy(*_views(len(scene.views)))
    clouds = [scene.points] if scene.dense is None else [scene.points, scene.dense.points]
    count = sum(map(len, clouds))
    if count < MIN_POINTS:
        return Degeneracy("no_points", f"the reconstruction has {count} points, {MIN_POINTS} needed")
    points = np.vstack([cloud[:: 1 + len(cloud) // ENOUGH_POINTS] for cloud in clouds])
    shape = _shape(points)
    if shape is not None:
        return Degeneracy(f"{shape}_points", f"the points of the reconstruction are {_WORDS[shape]}")
    centres = np.array([view.centre for view in scene.views])
    distance = float(np.median(np.linalg.norm(points - np.median(centres, axis=0), axis=1)))
    if float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()) < SAME_PLACE * distance:
        return Degeneracy("coincident_cameras", "all cameras are at one place, so that depths are unknown")
    return None


def _views(count: int) -> tuple[str, str]:
    if count:
        return "one_view", "the reconstruction has one view, two are needed"
    return "no_views", "the reconstruction has no views"


def _shape(points: FloatArray) -> str | None:
    """What the points (n, 3) are that have no volume: `coincident`, `collinear`, `coplanar`; None for all others."""
    centred = points - np.median(points, axis=0)
    reach = np.linalg.norm(centred, axis=1)
    usual = float(np.median(reach))
    if usual <= np.finfo(float).eps * float(np.abs(points).max()):
        return "coincident"
    near = centred[reach <= STRAY_TIMES * usual]
    # (3,) squared singular values, smallest first
    variances = np.linalg.eigvalsh((near - near.mean(axis=0)).T @ (near - near.mean(axis=0)) / usual**2)
    thick = np.sqrt(np.maximum(variances, 0.0)) >= NO_THICKNESS * np.sqrt(variances[2])
    return None if thick[0] else "coplanar" if thick[1] else "collinear"
