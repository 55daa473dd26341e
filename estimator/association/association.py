"""The objects that the masks show: points in masks, masks joined to tracks, and the points that each track keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from estimator.association.mask_agreement import (
    mask_agreement,
    mask_contradictions,
    track_agreement,
    track_contradictions,
)
from estimator.association.mask_rims import rim_agreement, rim_doubts
from estimator.association.point_labels import PointLabels, dense_labels, point_votes, sparse_labels
from estimator.association.tracks import Track, incremental_tracks, shared_tracks
from estimator.records.scene import Instance, Scene
from metric_base.arrays import IntArray
from metric_base.progress import stopwatch

__all__ = ["Association", "Joining", "associate"]

#: By shared points, or by the paper's Algorithm 1.
Joining = Literal["shared", "incremental"]


@dataclass(frozen=True, slots=True, eq=False)
class Association:
    """The tracks of a scene. `clouds` are the sparse points and, if there is one, the dense cloud.

    votes : for each cloud and track, the rows (k,) of the points that the masks of the track hold; `doubts` warn about
    the masks, `errors` rule them out: they are not of these views.
    """

    clouds: tuple[PointLabels, ...]
    tracks: tuple[Track, ...]
    votes: tuple[Sequence[IntArray], ...]
    doubts: tuple[str, ...]
    errors: tuple[str, ...]


def associate(
    scene: Scene, instances: Sequence[Instance], by: Joining, dense: bool, stated: bool, seconds: dict[str, float]
) -> Association:
    """The tracks of a scene's masks.

    Parameters
    ----------
    by : how masks are joined; stated : masks that the file gives one track show one object, unless views contradict it
    dense : whether the points of the dense cloud are used
    seconds : gets the time of each step
    """
    with stopwatch(seconds, "labels"):
        clouds = [sparse_labels(scene, instances)]
        if dense and scene.dense is not None:
            clouds.append(dense_labels(scene, instances))
        doubts, errors = mask_contradictions(mask_agreement(clouds[0], instances))
    with stopwatch(seconds, "association"):
        tracks = (
            shared_tracks(instances, clouds, stated) if by == "shared" else incremental_tracks(instances, clouds[-1])
        )
        members = [track.members for track in tracks]
        if not (doubts or errors):
            doubts, errors = track_contradictions(track_agreement(clouds[0], instances, members))
        if not (doubts or errors):
            doubts = rim_doubts(rim_agreement(scene.views, clouds[0], instances, members))
    with stopwatch(seconds, "votes"):
        votes = tuple(point_votes(cloud, instances, members) for cloud in clouds)
    return Association(tuple(clouds), tracks, votes, doubts, errors)
