"""From the points and masks of each track to objects with sizes in scene units (paper section 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.association.tracks import Association, AssociationMethod, Track
from estimator.geometry.canonical_frame import SortedScene
from estimator.geometry.extents import HIDDEN_TOP_SIGMA, TOP_SIGMA, level_top
from estimator.geometry.fragments import without_fragments
from estimator.geometry.noise import depth_noise, sight_moment
from estimator.geometry.outlined import LEVEL_TOP, MIN_BOX_VIEWS, MIN_DENSE_POINTS, outline_data, outlined_object
from estimator.geometry.planes import SupportPlane, level_basis, support_planes
from estimator.geometry.standing import has_level_top, stands
from estimator.geometry.support import REACH_SHARE, Foot, Ground, foot_on, ground_of, level_below
from estimator.geometry.truncation import Outline, Sides, outline, side_evidence
from estimator.geometry.up import Up, camera_up, up_contradiction
from estimator.geometry.upright_box import Dimensions, dimensions, inliers
from estimator.geometry.vertical import refine_up
from estimator.outlines.sight_errors import point_covariances
from estimator.records.measured_object import Box, MeasuredObject
from estimator.records.scene import Instance, Scene
from estimator.visibility.depth_buffer import Surroundings
from metric_base.arrays import FloatArray, IntArray
from metric_base.progress import stopwatch

__all__ = ["PAPER", "MeasurementOptions", "Measurements", "in_world", "measure_tracks"]

# An object with fewer points has no shape: eight corners and as many again for outliers.
MIN_OBJECT_POINTS = 16
# Points this many height bins below the floor are not on an object: twice the half thickness of a level surface.
BELOW_FLOOR_BINS = 5.0
# Points that reach less than this share of the height above a level top are its own roughness: the quantile stays, and
# is in doubt by as much.
CLUTTER_SHARE = 0.1
# Root mean square by which log length, width and height of an object move when depth order replaces the observations,
# in hard synthetic rooms, seeds 1100 and 1101, moves over 0.3 counting as 0.3.
GUESSED_SIGMA = (0.08, 0.08, 0.07)
TINY = np.finfo(float).tiny


@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """How to measure. `PAPER` holds the paper's choices; the extent rule is the same for all.

    supports : objects reach down to the plane they stand on; cuboids : objects known by boxes or with few points have
    the sizes of the cuboid that their outlines frame; stated_tracks : masks that the file gives one track show one
    object, unless their views contradict it; fragments : parts of objects count as objects; level_tops : tables end
    at the peak of their heights, not with what lies on them; standing : whether a
    category stands on the floor (True), hangs (False), or may do either (None).
    """

    association: AssociationMethod = "shared"
    outliers: Literal["neighbours", "forest"] = "neighbours"
    robust_footprint: bool = True
    supports: bool = True
    planes_for_up: bool = True
    dense: bool = True
    cuboids: bool = True
    stated_tracks: bool = True
    fragments: bool = False
    level_tops: bool = True
    standing: Callable[[str], bool | None] = stands
    up: Sequence[float] | None = None


PAPER = MeasurementOptions(
    "incremental",
    "forest",
    robust_footprint=False,
    supports=False,
    planes_for_up=False,
    cuboids=False,
    stated_tracks=False,
    fragments=True,
    level_tops=False,
)


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """The result of the geometry. `objects[i]` belongs to `tracks[i]`; `timings` in seconds by stage.

    `errors` rule the masks out: they are not of these views.
    """

    objects: tuple[MeasuredObject, ...]
    up: Up
    planes: tuple[SupportPlane, ...]
    tracks: tuple[Track, ...]
    timings: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()


def measure_tracks(
    scene: Scene,
    instances: Sequence[Instance],
    association: Association,
    options: MeasurementOptions,
    given: Up | None,
    seconds: dict[str, float],
) -> Measurements:
    """One object for every track, in the frame of the scene.

    given : the vertical if it is known from outside; seconds : gets the time of each step
    """
    clouds, tracks = association.clouds, association.tracks
    with stopwatch(seconds, "up"):
        up = camera_up(scene.views)
        surface = clouds[-1].points
        if options.planes_for_up:
            up = refine_up(up, surface)
        tilted, fallen = ((), ()) if given is None else up_contradiction(given, up)
        up = given or up
        planes = support_planes(up.vector, surface) if options.supports else ()
        basis = level_basis(up.vector)
        ground = ground_of(surface, basis, planes) if options.supports else None
    with stopwatch(seconds, "noise"):
        noise = [depth_noise(scene.views, cloud) for cloud in clouds]
        covariances = point_covariances(scene.views, scene.points)
    with stopwatch(seconds, "dimensions"):
        eyes = np.array([view.centre for view in scene.views])
        seen_from = [eyes[_views_of(track, instances)] for track in tracks]
        above = [
            _above_ground(cloud, rows, ground, basis) for cloud, rows in zip(clouds, association.votes, strict=True)
        ]
        shapes = _shapes(clouds, above, noise, seen_from, basis, options)
    with stopwatch(seconds, "truncation"):
        views = scene.views
        outlines = [outline(i, views[i.view].camera.width, views[i.view].camera.height) for i in instances]
        around = Surroundings(scene, clouds[-1].points, clouds[-1].visibility, up.vector)
        sides = [_sides(track, shape, instances, outlines, around) for track, shape in zip(tracks, shapes, strict=True)]
    with stopwatch(seconds, "supports"):
        objects = tuple(
            _object(track, shape, seen, instances, ground, basis, up, options)
            for track, shape, seen in zip(tracks, shapes, sides, strict=True)
        )
        if options.cuboids:
            near = np.empty((0, 3)) if ground is None else ground.local
            data = outline_data(
                scene, instances, clouds, covariances, noise[-1], basis, up, planes, near, options.standing
            )
            objects = tuple(outlined_object(item, data) for item in objects)
        if not scene.observed:
            objects = tuple(_with_guess(item) for item in objects)
        if not options.fragments:
            objects = without_fragments(objects)
    warnings, errors = (*association.warnings, *tilted), (*association.errors, *fallen)
    return Measurements(objects, up, planes, tracks, seconds, warnings, errors)


def in_world(inner: Measurements, world: SortedScene) -> Measurements:
    """Measurements of the own frame of a sorted scene in the world, in the order of the given masks."""
    clouds = {"sparse": world.points, "dense": world.dense}
    pairs = []
    for track, item in zip(inner.tracks, inner.objects, strict=True):
        members = tuple(sorted(int(world.rows[member]) for member in track.members))
        box = None if item.box is None else world.frame.world_box(item.box)
        own = None if item.point_rows is None else np.sort(clouds[item.cloud][item.point_rows])
        pairs.append((Track(members, track.category), replace(item, members=members, box=box, point_rows=own)))
    pairs.sort(key=lambda pair: pair[0].members)
    return replace(
        inner,
        objects=tuple(replace(item, id=str(number + 1)) for number, (_, item) in enumerate(pairs)),
        tracks=tuple(track for track, _ in pairs),
        up=world.frame.world_up(inner.up),
        planes=tuple(world.frame.world_plane(plane) for plane in inner.planes),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """The cloud an object was measured in ("sparse" or "dense"), its points, their rows, and its box if any."""

    cloud: Literal["sparse", "dense"]
    points: FloatArray
    rows: IntArray
    box: Dimensions | None


def _shapes(
    clouds: Sequence[PointLabels],
    votes: Sequence[Sequence[IntArray]],
    noise: Sequence[float],
    seen_from: Sequence[FloatArray],
    basis: FloatArray,
    options: MeasurementOptions,
) -> list[_Shape]:
    """The points and box of each track; `noise` of each cloud; `seen_from`: camera centres (v, 3) of each track."""
    shapes = []
    for number, eyes in enumerate(seen_from):
        cloud, rows = _cloud_of([vote[number] for vote in votes])
        own = clouds[cloud].points.take(rows, axis=0)
        box = None
        if len(own) >= MIN_OBJECT_POINTS:
            left = inliers(own, basis, options.outliers)
            blur = _blur(eyes, left.level.mean(axis=0) @ basis, noise[cloud])
            box = dimensions(left, basis, blur, options.robust_footprint)
        shapes.append(_Shape("dense" if cloud else "sparse", own, clouds[cloud].rows[rows], box))
    return shapes


def _above_ground(
    cloud: PointLabels, votes: Sequence[IntArray], ground: Ground | None, basis: FloatArray
) -> list[IntArray]:
    """The votes (k,) without what is below the floor: mirror images in it, and matches gone wrong."""
    if ground is None or ground.floor is None:
        return list(votes)
    lowest = ground.floor - BELOW_FLOOR_BINS * ground.bin
    return [rows[cloud.points.take(rows, axis=0) @ basis[2] > lowest] for rows in votes]


def _blur(eyes: FloatArray, middle: FloatArray, share: float) -> FloatArray:
    """(3, 3) covariance of an object's noise along its lines of sight, a share of the distance."""
    distance, moment = sight_moment(eyes, middle)
    return np.asarray((share * distance) ** 2 * moment)


def _views_of(track: Track, instances: Sequence[Instance]) -> list[int]:
    return sorted({instances[row].view for row in track.members})


def _cloud_of(rows: Sequence[IntArray]) -> tuple[int, IntArray]:
    """The cloud to measure an object in and its rows (k,): the dense one where it has enough, else the larger."""
    best = len(rows) - 1
    if best == 1 and len(rows[1]) < MIN_DENSE_POINTS and len(rows[0]) > len(rows[1]):
        best = 0
    return best, rows[best]


def _sides(
    track: Track, shape: _Shape, instances: Sequence[Instance], outlines: Sequence[Outline], around: Surroundings
) -> Sides | None:
    """How the masks show the sides of an object; None without a box."""
    if shape.box is None:
        return None
    box = shape.box
    masks = [instances[row] for row in track.members]
    borders = [outlines[row] for row in track.members]
    return side_evidence(masks, borders, around, (box.axes, box.low, box.high), shape.points[box.rows])


def _object(
    track: Track,
    shape: _Shape,
    sides: Sides | None,
    instances: Sequence[Instance],
    ground: Ground | None,
    basis: FloatArray,
    up: Up,
    options: MeasurementOptions,
) -> MeasuredObject:
    """One object as the posterior takes it; basis : (3, 3) rows two horizontal axes and up."""
    masks = [instances[row] for row in track.members]
    record = MeasuredObject(
        id="",
        category=track.category,
        extents=np.full(3, np.nan),
        sigma=np.full(3, np.nan),
        score=_score(masks, track.category),
        points=len(shape.points),
        views=len(masks),
        vertical_known=up.method != "none",
        point_rows=shape.rows,
        cloud=shape.cloud,
        members=track.members,
    )
    box = shape.box
    boxes = all(mask.from_box for mask in masks)
    if boxes and len(masks) < MIN_BOX_VIEWS:
        return replace(record, skipped=f"boxes in {len(masks)} views, {MIN_BOX_VIEWS} needed")
    if box is None or sides is None:
        return replace(record, skipped=f"{len(shape.points)} points, {MIN_OBJECT_POINTS} needed")
    foot = _foot(box, sides, ground, basis, options.standing(track.category))
    low, high = np.array([*box.low[:2], foot.bottom]), box.high
    edge_sigma = box.edge_sigma.copy()
    notes = ["reaches down to the surface below it"] if foot.filled else []
    if options.level_tops and has_level_top(track.category):
        top = level_top(shape.points[box.rows] @ basis[2], float(low[2]), float(high[2]))
        above = HIDDEN_TOP_SIGMA if top is None else float(high[2] - top) / max(float(high[2] - low[2]), TINY)
        if top is not None and above > max(float(edge_sigma[1, 2]), CLUTTER_SHARE):
            high = np.array([*high[:2], top])
            edge_sigma[1, 2] = TOP_SIGMA
            notes.append(LEVEL_TOP)
        else:
            edge_sigma[1, 2] = max(float(edge_sigma[1, 2]), above)
    # along a vertical that is off, the outermost points of an end are off by that tilt over half a side
    leaning = np.radians(up.sigma_deg) * float(box.extents[:2].mean()) / 2 / max(float(high[2] - low[2]), TINY)
    edge_sigma[:, 2] = np.hypot(edge_sigma[:, 2], leaning)
    if foot.standing:
        edge_sigma[0, 2] = foot.sigma
    cut = sides.truncated
    foot_cut = foot.short or (cut[2, 0] and not foot.standing)
    truncated = np.array([cut[0].any(), cut[1].any(), cut[2, 1] or foot_cut])
    return replace(
        record,
        extents=high - low,
        sigma=np.linalg.norm(edge_sigma, axis=0),
        confidence=box.eta,
        beyond=sides.beyond,
        truncated=truncated,
        unsupported_height=float(box.extents[2]) if foot.standing else None,
        box=Box((low + high) / 2 @ box.axes, box.axes, high - low),
        notes=tuple(notes),
    )


def _with_guess(item: MeasuredObject) -> MeasuredObject:
    """The object with what it adds to its errors that depth order alone says which views see its sparse points."""
    if item.cloud != "sparse":
        return item
    added = np.square(GUESSED_SIGMA)
    joint = None if item.covariance is None else item.covariance + np.diag(added)
    return replace(item, sigma=np.sqrt(item.sigma**2 + added), covariance=joint)


def _score(masks: Sequence[Instance], category: str) -> float:
    """Mean score of an object's masks times the share of it that names its category: a changing name is doubtful."""
    scores = np.array([mask.score for mask in masks])
    agreed = np.array([mask.category == category for mask in masks])
    return float(scores.mean() * (scores @ agreed) / max(float(scores.sum()), np.finfo(float).tiny))


def _foot(box: Dimensions, sides: Sides, ground: Ground | None, basis: FloatArray, standing: bool | None) -> Foot:
    """The foot of an object on the ground, of its points without one; `basis` (3, 3) has the vertical last."""
    if ground is None:
        return Foot(float(box.low[2]))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * box.extents[:2] + box.low[:2]
    # corners along length and width, to the world, to the level basis
    level = level_below(ground, corners @ box.axes[:2] @ basis[:2].T, box.low, box.high, standing)
    reach = np.nan
    if level is not None and box.low[2] > level.height:
        gap = float(box.low[2] - level.height)
        # the masks, or the few outermost points that the extent rule cut off
        by_masks, own = sides.beyond[2, 0] * box.extents[2] / gap, (box.low[2] - box.lowest) / gap
        reach = own if own > REACH_SHARE else by_masks
    return foot_on(level, box.low, box.high, ground.bin, standing, float(reach))
