"""Measurement: from a scene and its masks to objects with sizes in scene units (paper sections 4.1 and 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Literal

import numpy as np

from estimator.association import Track, incremental_tracks, shared_tracks
from estimator.dimensions import Dimensions, dimensions
from estimator.labels import PointLabels, dense_labels, point_votes, sparse_labels
from estimator.objects import Box, MeasuredObject
from estimator.planes import SupportPlane, level_basis, refined_up, support_planes
from estimator.scene import BoolArray, FloatArray, Instance, IntArray, Scene
from estimator.standing import stands
from estimator.support import Foot, foot_on
from estimator.truncation import Outline, Surroundings, outline, shown_sides, truncated_sides
from estimator.upright import Up, camera_up

__all__ = ["PAPER", "MeasurementOptions", "Measurements", "measured"]

# An object with fewer points has no shape: eight corners and as many again for outliers.
MIN_OBJECT_POINTS = 16
# The dense cloud is taken for an object from here on; below, whichever cloud holds more.
MIN_DENSE_POINTS = 100


@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """How to measure. `PAPER` holds the paper's choices; the extent rule is the same for all.

    supports : objects reach down to the plane they stand on; standing : whether a category stands on the floor (True), hangs
    (False), or may do either (None).
    """

    association: Literal["shared", "incremental"] = "shared"
    outliers: Literal["neighbours", "forest"] = "neighbours"
    robust_footprint: bool = True
    supports: bool = True
    planes_for_up: bool = True
    dense: bool = True
    standing: Callable[[str], bool | None] = stands


PAPER = MeasurementOptions("incremental", "forest", robust_footprint=False, supports=False, planes_for_up=False)


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Everything the geometry found. `objects[i]` belongs to `tracks[i]`; `timings` in seconds by stage."""

    objects: tuple[MeasuredObject, ...]
    up: Up
    planes: tuple[SupportPlane, ...]
    tracks: tuple[Track, ...]
    timings: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def measured(
    scene: Scene, instances: Sequence[Instance], options: MeasurementOptions | None = None
) -> Measurements:
    """The objects of a scene in scene units, largest certainty first to none: labels, tracks, up, planes, dimensions."""
    options = options or MeasurementOptions()
    timings: dict[str, float] = {}
    with _timed(timings, "labels"):
        clouds = [sparse_labels(scene, instances)]
        if options.dense and scene.dense is not None:
            clouds.append(dense_labels(scene, instances))
    with _timed(timings, "association"):
        if options.association == "shared":
            tracks = shared_tracks(instances, clouds)
        else:
            tracks = incremental_tracks(instances, clouds[-1])
    with _timed(timings, "up"):
        up = camera_up(scene.views)
        surface = clouds[-1].points
        if options.planes_for_up:
            up = refined_up(up, surface)
        planes = support_planes(up.vector, surface) if options.supports else ()
    with _timed(timings, "votes"):
        members = [track.members for track in tracks]
        rows = [point_votes(cloud, instances, members) for cloud in clouds]
    basis = level_basis(up.vector)
    with _timed(timings, "dimensions"):
        shapes = [
            _shape(clouds, [votes.rows[number] for votes in rows], basis, options) for number in range(len(tracks))
        ]
    with _timed(timings, "truncation"):
        views = scene.views
        outlines = [outline(i, views[i.view].camera.width, views[i.view].camera.height) for i in instances]
        around = Surroundings(scene, clouds[-1], up.vector)
        sides = [
            _truncated_sides(track, shape, instances, outlines, around)
            for track, shape in zip(tracks, shapes, strict=True)
        ]
    objects = tuple(
        _object(str(number + 1), track, shape, cut, instances, planes, up, options)
        for number, (track, shape, cut) in enumerate(zip(tracks, shapes, sides, strict=True))
    )
    return Measurements(objects, up, planes, tracks, timings, _warnings(up, planes, options))


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """The cloud an object was measured in ("sparse" or "dense"), its points, their rows, and its box if there is one."""

    cloud: Literal["sparse", "dense"]
    points: FloatArray
    rows: IntArray
    box: Dimensions | None


@contextmanager
def _timed(timings: dict[str, float], stage: str) -> Iterator[None]:
    start = perf_counter()
    yield
    timings[stage] = perf_counter() - start


def _shape(
    clouds: Sequence[PointLabels], rows: Sequence[IntArray], basis: FloatArray, options: MeasurementOptions
) -> _Shape:
    """The dense points of an object where there are enough, else the more of the two."""
    best = len(rows) - 1
    if best == 1 and len(rows[1]) < MIN_DENSE_POINTS and len(rows[0]) > len(rows[1]):
        best = 0
    points = clouds[best].points[rows[best]]
    name: Literal["sparse", "dense"] = "dense" if best == 1 else "sparse"
    box = None
    if len(points) >= MIN_OBJECT_POINTS:
        box = dimensions(points, basis, options.outliers, options.robust_footprint)
    return _Shape(name, points, rows[best], box)


def _truncated_sides(
    track: Track, shape: _Shape, instances: Sequence[Instance], outlines: Sequence[Outline], around: Surroundings
) -> BoolArray:
    """(3, 2) sides that no two views show; none without a box."""
    if shape.box is None:
        return np.zeros((3, 2), dtype=bool)
    box = shape.box
    masks = [instances[row] for row in track.members]
    borders = [outlines[row] for row in track.members]
    points = shape.points[box.rows]
    return truncated_sides(shown_sides(masks, borders, around, box.axes, box.low, box.high, points))


def _object(
    name: str,
    track: Track,
    shape: _Shape,
    cut: BoolArray,
    instances: Sequence[Instance],
    planes: Sequence[SupportPlane],
    up: Up,
    options: MeasurementOptions,
) -> MeasuredObject:
    """One object as the posterior takes it."""
    masks = [instances[row] for row in track.members]
    record = MeasuredObject(
        id=name,
        category=track.category,
        extents=np.full(3, np.nan),
        sigma=np.full(3, np.nan),
        score=float(np.mean([mask.score for mask in masks])),
        points=len(shape.points),
        views=len(masks),
        vertical_known=up.method != "none",
        point_rows=shape.rows,
        cloud=shape.cloud,
        members=track.members,
    )
    if shape.box is None:
        return replace(record, skipped=f"{len(shape.points)} points, {MIN_OBJECT_POINTS} needed")
    box = shape.box
    foot = _foot(box, track.category, bool(cut[2, 0]), planes, options)
    low = np.array([*box.low[:2], foot.bottom])
    sigma = box.sigma.copy()
    sigma[2] = np.hypot(sigma[2], foot.sigma)
    truncated = cut.any(axis=1)
    truncated[2] = cut[2, 1] or (cut[2, 0] and foot.plane is None) or foot.short
    return replace(
        record,
        extents=box.high - low,
        sigma=sigma,
        confidence=box.eta,
        truncated=truncated,
        unsupported_height=float(box.extents[2]) if foot.plane is not None else None,
        box=Box((low + box.high) / 2 @ box.axes, box.axes, box.high - low),
        notes=("reaches down to the plane below it",) if foot.filled else (),
    )


def _foot(
    box: Dimensions, category: str, cut: bool, planes: Sequence[SupportPlane], options: MeasurementOptions
) -> Foot:
    if not options.supports:
        return Foot(float(box.low[2]))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * box.extents[:2] + box.low[:2]
    basis = planes[0].basis if planes else box.axes
    # corners along length and width, to the world, to the horizontal axes of the planes
    footprint = corners @ box.axes[:2] @ basis[:2].T
    return foot_on(planes, footprint, box.low, box.high, options.standing(category), cut)


def _warnings(up: Up, planes: Sequence[SupportPlane], options: MeasurementOptions) -> tuple[str, ...]:
    found = []
    if up.method == "none":
        found.append("up is unknown: the cameras neither turn nor agree on it")
    elif up.method == "mean-camera-up":
        found.append("up is the mean camera up: the cameras hardly turn and no level surface was found")
    if options.supports and not planes:
        found.append("no support plane was found: heights are those of the points alone")
    return tuple(found)
