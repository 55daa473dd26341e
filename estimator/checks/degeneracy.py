"""Degenerate geometry: reconstructions in which nothing has a size, each with a name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Scene
from metric_base.arrays import FloatArray

__all__ = ["Degeneracy", "degeneracy"]

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


_WORDS = {"coincident": "all at one place", "collinear": "all on one line", "coplanar": "all in one plane"}


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
