"""Fast simulated reconstruction of a synthetic world: true depth with noise instead of structure from motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray
from tests.synthetic.rooms.depth_errors import BARE_KEPT_FRACTION, bare_samples, relative_errors, surface_samples
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.masks import blurred_masks, instances_of
from tests.synthetic.rooms.render import Frame, Renderer
from tests.synthetic.rooms.similarity import Similarity, random_similarity
from tests.synthetic.rooms.truth import Truth, truth_of
from tests.synthetic.rooms.world import Pinhole, Pose, World

__all__ = ["SyntheticScene", "quick_scene"]

#: Numbers of sparse and dense points per frame; the totals are typical of a short indoor video.
SPARSE_PER_FRAME = 400
DENSE_PER_FRAME = 2500
#: Probability that a sparse point is observed in a view in which it is visible; matching misses the others.
OBSERVED_FRACTION = 0.6
#: Minimum number of views of a sparse point; COLMAP drops tracks of two as unreliable.
MIN_VIEWS = 3
#: Maximum relative difference between the depth of a visible point and the rendered depth.
DEPTH_TOLERANCE = 0.02
#: Maximum reprojection error in pixels (COLMAP's limit); points of moving objects with a smaller error are kept.
MAX_ERROR_PX = 4.0
#: Lowest fraction of the height that has no points on an object with `no_foot`.
FOOT_FRACTION = 0.2
#: Maximum height in metres of points that a glossy floor mirrors.
MIRROR_HEIGHT_M = 0.6
#: Maximum height in metres of the floor's points, including a rug.
MIRROR_FLOOR_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticScene:
    """A reconstruction with its masks and its ground truth; `ids` are images of object numbers by frame."""

    scene: Scene
    instances: tuple[Instance, ...]
    truth: Truth
    ids: tuple[IntArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Surface points (n, 3) at the time of the frame they are sampled in, with frame, object number and pixel (n,)."""

    points: FloatArray
    frame: IntArray
    number: IntArray
    row: IntArray
    column: IntArray

    def select(self, keep: BoolArray) -> _Samples:
        """Return the samples for which `keep` (n,) is true."""
        return _Samples(*(getattr(self, name)[keep] for name in ("points", "frame", "number", "row", "column")))


def quick_scene(
    world: World, knobs: Knobs | None = None, seed: int = 0, dense_a_frame: int = DENSE_PER_FRAME
) -> SyntheticScene:
    """Return sparse points with observations and a dense cloud with visibility, under a random similarity.

    dense_a_frame : number of dense points per frame; 0: no dense cloud.
    """
    knobs = knobs or Knobs()
    generator = np.random.default_rng([seed, world.seed, 23])
    with Renderer(world) as renderer:
        frames = [renderer.frame(index, colour=False) for index in range(len(world.poses))]
    to_scene = random_similarity(generator)
    points, views = _sparse(world, frames, knobs, to_scene, generator)
    cloud = _dense(world, frames, dense_a_frame, knobs, to_scene, generator) if dense_a_frame else None
    ids = tuple(frame.ids for frame in frames)
    scene = Scene(Path(f"{world.kind}-{world.seed}"), "memory", views, points, cloud)
    instances = instances_of(world, _ids_with_clutter(world, ids, knobs.clutter, seed))
    if knobs.mask_error_px:
        size = (world.camera.width, world.camera.height)
        instances = blurred_masks(instances, size, knobs.mask_error_px, generator)
    return SyntheticScene(scene, instances, truth_of(world, to_scene), ids)


def _ids_with_clutter(world: World, ids: tuple[IntArray, ...], fraction: float, seed: int) -> tuple[IntArray, ...]:
    """Return the object numbers (h, w) with a fraction of the supported objects replaced by their supports."""
    tracks = [item.track for item in world.objects]
    chosen = np.random.default_rng([seed, world.seed, 29]).random(len(tracks)) < fraction
    number = np.arange(len(tracks) + 1)
    for k, item in enumerate(world.objects):
        if chosen[k] and item.support in tracks:
            number[k + 1] = tracks.index(item.support) + 1
    return tuple(number[image] for image in ids)


def _sparse(
    world: World, frames: list[Frame], knobs: Knobs, to_scene: Similarity, generator: np.random.Generator
) -> tuple[FloatArray, tuple[View, ...]]:
    samples = _surface_samples(world, frames, SPARSE_PER_FRAME, knobs.bare_faces, generator)
    pixels, observed = _project(world, frames, samples)  # (n, v, 2), (n, v)
    observed &= generator.random(observed.shape) < OBSERVED_FRACTION
    pixels = pixels + generator.normal(0, knobs.keypoint_noise, pixels.shape)
    positions, static = _triangulated_positions(world, samples, pixels, observed)
    noisy = _add_depth_noise(world, frames, samples, positions, knobs, generator)
    if knobs.smear:
        # structure from motion drops observations with a large reprojection error
        reprojected, _ = _project(world, frames, replace(samples, points=noisy))
        observed &= np.linalg.norm(reprojected - pixels, axis=2) < MAX_ERROR_PX
    keep = static & (observed.sum(axis=1) >= MIN_VIEWS)
    noisy, pixels, observed = noisy[keep], pixels[keep], observed[keep]
    views = []
    for index, pose in enumerate(world.poses):
        rows = np.flatnonzero(observed[:, index])
        views.append(_view(f"frame{index:03d}.jpg", world.camera, pose, to_scene, pixels[rows, index], rows))
    return to_scene(noisy), tuple(views)


def _dense(
    world: World, frames: list[Frame], count: int, knobs: Knobs, to_scene: Similarity, generator: np.random.Generator
) -> DenseCloud:
    """Return the dense cloud. Moving objects have no dense points, because no second view confirms their depth."""
    samples = _surface_samples(world, frames, count, knobs.bare_faces, generator)
    samples = samples.select(~_is_moving(world)[samples.number])
    noisy = _add_depth_noise(world, frames, samples, samples.points, knobs, generator)
    # with depth errors, a point is visible in the views with a similar depth, and always in the two matched views
    _, visible = _project(world, frames, replace(samples, points=noisy) if knobs.smear else samples)
    visible[np.arange(len(visible)), samples.frame] = True
    if knobs.smear:
        visible[np.arange(len(visible)), np.minimum(samples.frame + 1, len(frames) - 1)] = True
    offsets = np.concatenate([[0], np.cumsum(visible.sum(axis=1))])
    return DenseCloud(to_scene(noisy), offsets.astype(np.int64), np.nonzero(visible)[1].astype(np.int64))


def _surface_samples(
    world: World, frames: list[Frame], count: int, bare_faces: float, generator: np.random.Generator
) -> _Samples:
    """Return the surface points of `count` random pixels per frame, without feet and most points of bare faces."""
    points, numbers, indices, lines, across = [], [], [], [], []
    for index, (frame, pose) in enumerate(zip(frames, world.poses, strict=True)):
        rows = generator.integers(0, world.camera.height, count)
        columns = generator.integers(0, world.camera.width, count)
        depth = frame.depth[rows, columns].astype(float)
        hit = np.isfinite(depth)
        pixels = np.column_stack([columns + 0.5, rows + 0.5])[hit]
        points.append(_lift(world.camera, pose, pixels, depth[hit]))
        numbers.append(frame.ids[rows, columns][hit])
        indices.append(np.full(int(hit.sum()), index))
        lines.append(rows[hit])
        across.append(columns[hit])
    samples = _Samples(*map(np.concatenate, (points, indices, numbers, lines, across)))
    foot_height = np.full(len(world.objects) + 1, -np.inf)
    for k, item in enumerate(world.objects):
        z = item.mesh.vertices[:, 2]
        if item.no_foot:
            foot_height[k + 1] = z.min() + FOOT_FRACTION * (z.max() - z.min())
    samples = samples.select(~(samples.points[:, 2] < foot_height[samples.number]))
    bare = bare_samples(world, samples.points, samples.number, bare_faces)
    return samples.select(~bare | (generator.random(len(bare)) < BARE_KEPT_FRACTION)) if bare.any() else samples


def _lift(camera: Pinhole, pose: Pose, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """Return the world points (n, 3) of pixels (n, 2) at a depth (n,) along the optical axis."""
    rays = np.column_stack([(pixels - [camera.width / 2, camera.height / 2]) / camera.focal, np.ones(len(pixels))])
    return np.asarray((rays * depth[:, None] - pose.translation) @ pose.rotation)


def _project(world: World, frames: list[Frame], samples: _Samples) -> tuple[FloatArray, BoolArray]:
    """Return the pixels (n, v, 2) of all samples in all views, and whether they are visible (n, v).

    Samples on moving objects move with them.
    """
    camera = world.camera
    velocity = np.array([np.zeros(3), *(item.velocity for item in world.objects)])[samples.number]
    pixels = np.full((len(samples.points), len(frames), 2), -1.0)
    visible = np.zeros((len(samples.points), len(frames)), dtype=bool)
    for index, (frame, pose) in enumerate(zip(frames, world.poses, strict=True)):
        moved = samples.points + velocity * (index - samples.frame)[:, None]
        local = moved @ pose.rotation.T + pose.translation
        in_front = np.flatnonzero(local[:, 2] > 0.1)
        projected = camera.focal * local[in_front, :2] / local[in_front, 2:] + [camera.width / 2, camera.height / 2]
        within = np.all((projected > 0) & (projected < [camera.width, camera.height]), axis=1)
        in_front, projected = in_front[within], projected[within]
        pixels[in_front, index] = projected
        cells = projected.astype(np.int64)
        depth, number = frame.depth[cells[:, 1], cells[:, 0]], frame.ids[cells[:, 1], cells[:, 0]]
        is_close = np.abs(local[in_front, 2] / depth - 1) < DEPTH_TOLERANCE
        visible[in_front, index] = is_close & (number == samples.number[in_front])
    return pixels, visible


def _is_moving(world: World) -> BoolArray:
    """Return whether the object of each number moves (1 + objects,); number 0 is the surfaces of the world."""
    return np.array([False, *(bool(np.any(item.velocity)) for item in world.objects)])


def _triangulated_positions(
    world: World, samples: _Samples, pixels: FloatArray, observed: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Return the positions (n, 3) of the samples in a triangulation of a static world, and whether they are kept (n,).

    Points on static objects are unchanged. Points on moving objects are triangulated as if they were static, and kept
    if their reprojection errors are below MAX_ERROR_PX, as on a car that drives ahead at the speed of the camera.
    """
    positions, keep = samples.points.copy(), np.ones(len(samples.points), dtype=bool)
    for row in np.flatnonzero(_is_moving(world)[samples.number]):
        views = np.flatnonzero(observed[row])
        keep[row] = len(views) >= MIN_VIEWS
        if keep[row]:
            positions[row], error_px = _triangulate(world, views, pixels[row, views])
            keep[row] = error_px < MAX_ERROR_PX
    return positions, keep


def _triangulate(world: World, views: IntArray, pixels: FloatArray) -> tuple[FloatArray, float]:
    """Return the least-squares intersection of rays and its maximum reprojection error; inf behind a camera."""
    camera = world.camera
    poses = [world.poses[view] for view in views]
    local = np.column_stack([(pixels - [camera.width / 2, camera.height / 2]) / camera.focal, np.ones(len(pixels))])
    rays = np.array([ray @ pose.rotation for ray, pose in zip(local, poses, strict=True)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # (v, 3, 3) projections across each ray
    centres = np.array([pose.centre for pose in poses])
    point = np.linalg.lstsq(across.sum(axis=0), np.einsum("vij,vj->i", across, centres), rcond=None)[0]
    in_cameras = np.array([pose.rotation @ point + pose.translation for pose in poses])
    if np.any(in_cameras[:, 2] <= 0):
        return point, np.inf
    reprojected = camera.focal * in_cameras[:, :2] / in_cameras[:, 2:] + [camera.width / 2, camera.height / 2]
    return point, float(np.linalg.norm(reprojected - pixels, axis=1).max())


def _add_depth_noise(
    world: World,
    frames: list[Frame],
    samples: _Samples,
    points: FloatArray,
    knobs: Knobs,
    generator: np.random.Generator,
) -> FloatArray:
    """Return the points (n, 3) moved along their rays by the depth noise; stray points are at random depths."""
    centres = np.array([pose.centre for pose in world.poses])[samples.frame]
    if knobs.smear or knobs.bare_faces:
        stretch = 1 + _depth_errors(world, frames, samples, knobs, generator)
    else:
        stretch = 1 + generator.normal(0, knobs.depth_noise, len(points))
    stray = generator.random(len(points)) < knobs.stray
    stretch[stray] = generator.uniform(0.5, 1.5, int(stray.sum()))
    noisy = centres + (points - centres) * stretch[:, None]
    if knobs.gloss:
        noisy = _mirrored(noisy, samples, knobs.gloss, generator)
    return np.asarray(noisy)


def _depth_errors(
    world: World, frames: list[Frame], samples: _Samples, knobs: Knobs, generator: np.random.Generator
) -> FloatArray:
    """Return relative depth errors (n,) of the samples (`depth_errors`)."""
    bare = bare_samples(world, samples.points, samples.number, knobs.bare_faces)
    errors = np.empty(len(bare))
    for index, frame in enumerate(frames):
        in_frame = np.flatnonzero(samples.frame == index)
        rows, columns = samples.row[in_frame], samples.column[in_frame]
        surface = surface_samples(frame, world.camera, rows, columns)
        depth = frame.depth[rows, columns].astype(float)
        errors[in_frame] = relative_errors(surface, depth, bare[in_frame], knobs, generator)
    return errors


def _mirrored(points: FloatArray, samples: _Samples, fraction: float, generator: np.random.Generator) -> FloatArray:
    """Return the points (n, 3) with a fraction of the floor's points replaced by mirror images of low object points."""
    floor = np.flatnonzero((samples.number == 0) & (samples.points[:, 2] < MIRROR_FLOOR_M))
    low = np.flatnonzero((samples.number > 0) & (samples.points[:, 2] < MIRROR_HEIGHT_M))
    chosen = floor[generator.random(len(floor)) < fraction]
    if not low.size:
        return points
    mirrored = points.copy()
    mirrored[chosen] = points[generator.choice(low, len(chosen))] * [1, 1, -1]
    return mirrored


def _view(name: str, camera: Pinhole, pose: Pose, to_scene: Similarity, keypoints: FloatArray, rows: IntArray) -> View:
    """Return the view in the frame of the scene."""
    rotation = pose.rotation @ to_scene.rotation.T
    centre = to_scene(pose.centre[None])[0]
    params = np.array([camera.focal, camera.focal, camera.width / 2, camera.height / 2])
    pinhole = Camera("PINHOLE", camera.width, camera.height, params)
    return View(name, pinhole, rotation, -rotation @ centre, keypoints, rows)
