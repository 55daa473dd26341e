"""A synthetic world reconstructed in a second: true depth plus noise in place of structure from motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray
from tests.synthetic.rooms.depth_errors import BARE_KEPT, bare_samples, outlook, relative_errors
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.masks import blurred_masks, instances_of
from tests.synthetic.rooms.render import Frame, Renderer
from tests.synthetic.rooms.similarity import Similarity, random_similarity
from tests.synthetic.rooms.truth import Truth, truth_of
from tests.synthetic.rooms.world import Pinhole, Pose, World

__all__ = ["SyntheticScene", "quick_scene"]

#: Sparse and dense points taken in each frame; the sums are those of a small indoor video.
SPARSE_A_FRAME, DENSE_A_FRAME = 400, 2500
#: Share of the views that could observe a sparse point and do: matching misses as many.
OBSERVED = 0.6
#: Views of a sparse point; COLMAP drops tracks of two as unreliable.
LEAST_VIEWS = 3
#: A point is seen where it lies within this share of the depth rendered there.
SAME_DEPTH = 0.02
#: Largest misfit in pixels at which a moving object's points still pass for static ones (COLMAP's own limit).
STATIC_PIXELS = 4.0
#: The lowest part of an object without a foot that leaves no points.
FOOT_SHARE = 0.2
#: A floor mirrors what is this low above it, in metres; what is lower than the other figure is the floor or a rug.
MIRROR_HEIGHT, MIRROR_FLOOR = 0.6, 0.01


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticScene:
    """A reconstruction in the estimator's form, its masks, its truth; `ids` are the frames' object numbers."""

    scene: Scene
    instances: tuple[Instance, ...]
    truth: Truth
    ids: tuple[IntArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Surface points: where they are at their own frame (n, 3), that frame (n,), their object (n,), their pixel."""

    points: FloatArray
    frame: IntArray
    number: IntArray
    row: IntArray
    column: IntArray

    def some(self, kept: BoolArray) -> _Samples:
        """Those that are kept (n,)."""
        return _Samples(*(getattr(self, name)[kept] for name in ("points", "frame", "number", "row", "column")))


def quick_scene(
    world: World, knobs: Knobs | None = None, seed: int = 0, dense_a_frame: int = DENSE_A_FRAME
) -> SyntheticScene:
    """Sparse points with their observations and a dense cloud with its visibility, under a random similarity.

    dense_a_frame : dense points taken in each frame; with 0 there is no dense cloud.
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


def _ids_with_clutter(world: World, ids: tuple[IntArray, ...], share: float, seed: int) -> tuple[IntArray, ...]:
    """The frames' object numbers (h, w) with a share of what stands on an object counted as that object."""
    tracks = [item.track for item in world.objects]
    chosen = np.random.default_rng([seed, world.seed, 29]).random(len(tracks)) < share
    number = np.arange(len(tracks) + 1)
    for k, item in enumerate(world.objects):
        if chosen[k] and item.support in tracks:
            number[k + 1] = tracks.index(item.support) + 1
    return tuple(number[image] for image in ids)


def _sparse(
    world: World, frames: list[Frame], knobs: Knobs, to_scene: Similarity, generator: np.random.Generator
) -> tuple[FloatArray, tuple[View, ...]]:
    samples = _surface_samples(world, frames, SPARSE_A_FRAME, knobs.bare_faces, generator)
    pixels, seen = _project(world, frames, samples)  # (n, v, 2), (n, v)
    seen &= generator.random(seen.shape) < OBSERVED
    pixels = pixels + generator.normal(0, knobs.keypoint_noise, pixels.shape)
    places, static = _triangulated_places(world, samples, pixels, seen)
    noisy = _add_depth_noise(world, frames, samples, places, knobs, generator)
    if knobs.smear:
        # structure from motion drops observations that a point misses
        again, _ = _project(world, frames, replace(samples, points=noisy))
        seen &= np.linalg.norm(again - pixels, axis=2) < STATIC_PIXELS
    kept = static & (seen.sum(axis=1) >= LEAST_VIEWS)
    noisy, pixels, seen = noisy[kept], pixels[kept], seen[kept]
    views = []
    for index, pose in enumerate(world.poses):
        rows = np.flatnonzero(seen[:, index])
        views.append(_view(f"frame{index:03d}.jpg", world.camera, pose, to_scene, pixels[rows, index], rows))
    return to_scene(noisy), tuple(views)


def _dense(
    world: World, frames: list[Frame], count: int, knobs: Knobs, to_scene: Similarity, generator: np.random.Generator
) -> DenseCloud:
    """Moving objects leave no dense points: no second view agrees with them."""
    samples = _surface_samples(world, frames, count, knobs.bare_faces, generator)
    samples = samples.some(~_is_moving(world)[samples.number])
    noisy = _add_depth_noise(world, frames, samples, samples.points, knobs, generator)
    # with real errors a view sees a point where its depth agrees, and the two views of the match always do
    _, seen = _project(world, frames, replace(samples, points=noisy) if knobs.smear else samples)
    seen[np.arange(len(seen)), samples.frame] = True
    if knobs.smear:
        seen[np.arange(len(seen)), np.minimum(samples.frame + 1, len(frames) - 1)] = True
    offsets = np.concatenate([[0], np.cumsum(seen.sum(axis=1))])
    return DenseCloud(to_scene(noisy), offsets.astype(np.int64), np.nonzero(seen)[1].astype(np.int64))


def _surface_samples(
    world: World, frames: list[Frame], count: int, bare_faces: float, generator: np.random.Generator
) -> _Samples:
    """`count` random pixels of every frame, lifted onto the surface they show, but for feet that leave no points."""
    points, numbers, at, lines, across = [], [], [], [], []
    for index, (frame, pose) in enumerate(zip(frames, world.poses, strict=True)):
        rows = generator.integers(0, world.camera.height, count)
        columns = generator.integers(0, world.camera.width, count)
        depth = frame.depth[rows, columns].astype(float)
        hit = np.isfinite(depth)
        pixels = np.column_stack([columns + 0.5, rows + 0.5])[hit]
        points.append(_lift(world.camera, pose, pixels, depth[hit]))
        numbers.append(frame.ids[rows, columns][hit])
        at.append(np.full(int(hit.sum()), index))
        lines.append(rows[hit])
        across.append(columns[hit])
    samples = _Samples(*map(np.concatenate, (points, at, numbers, lines, across)))
    samples = samples.some(~_is_bare_foot(world, samples))
    bare = bare_samples(world, samples.points, samples.number, bare_faces)
    return samples.some(~bare | (generator.random(len(bare)) < BARE_KEPT)) if bare.any() else samples


def _is_bare_foot(world: World, samples: _Samples) -> BoolArray:
    """Which samples lie on the foot of an object that shows none."""
    limit = np.full(len(world.objects) + 1, -np.inf)
    for k, item in enumerate(world.objects):
        z = item.mesh.vertices[:, 2]
        if item.no_foot:
            limit[k + 1] = z.min() + FOOT_SHARE * (z.max() - z.min())
    return np.asarray(samples.points[:, 2] < limit[samples.number])


def _lift(camera: Pinhole, pose: Pose, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """World points (n, 3) of pixels (n, 2) at a depth (n,) along the optical axis."""
    rays = np.column_stack([(pixels - [camera.width / 2, camera.height / 2]) / camera.focal, np.ones(len(pixels))])
    return np.asarray((rays * depth[:, None] - pose.translation) @ pose.rotation)


def _project(world: World, frames: list[Frame], samples: _Samples) -> tuple[FloatArray, BoolArray]:
    """Pixels (n, v, 2) of every sample in every view, moved with its object, and whether it is seen there (n, v)."""
    camera = world.camera
    velocity = np.array([np.zeros(3), *(item.velocity for item in world.objects)])[samples.number]
    pixels = np.full((len(samples.points), len(frames), 2), -1.0)
    seen = np.zeros((len(samples.points), len(frames)), dtype=bool)
    for index, (frame, pose) in enumerate(zip(frames, world.poses, strict=True)):
        moved = samples.points + velocity * (index - samples.frame)[:, None]
        local = moved @ pose.rotation.T + pose.translation
        ahead = np.flatnonzero(local[:, 2] > 0.1)
        at = camera.focal * local[ahead, :2] / local[ahead, 2:] + [camera.width / 2, camera.height / 2]
        within = np.all((at > 0) & (at < [camera.width, camera.height]), axis=1)
        ahead, at = ahead[within], at[within]
        pixels[ahead, index] = at
        cells = at.astype(np.int64)
        depth, number = frame.depth[cells[:, 1], cells[:, 0]], frame.ids[cells[:, 1], cells[:, 0]]
        near = np.abs(local[ahead, 2] / depth - 1) < SAME_DEPTH
        seen[ahead, index] = near & (number == samples.number[ahead])
    return pixels, seen


def _is_moving(world: World) -> BoolArray:
    """(1 + objects,) whether each number moves; number 0 is the bare world."""
    return np.array([False, *(bool(np.any(item.velocity)) for item in world.objects)])


def _triangulated_places(
    world: World, samples: _Samples, pixels: FloatArray, seen: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Where a static world's triangulation puts the points, (n, 3), and whether it would keep them, (n,).

    A still point is where it is. A moving one is triangulated from its own frame and its last one, as if it stood
    still; it is kept where it projects within STATIC_PIXELS of all its observations, as a car driving ahead at our
    own pace does.
    """
    places, kept = samples.points.copy(), np.ones(len(samples.points), dtype=bool)
    for row in np.flatnonzero(_is_moving(world)[samples.number]):
        views = np.flatnonzero(seen[row])
        kept[row] = len(views) >= LEAST_VIEWS
        if kept[row]:
            places[row], misfit = _triangulate(world, views, pixels[row, views])
            kept[row] = misfit < STATIC_PIXELS
    return places, kept


def _triangulate(world: World, views: IntArray, pixels: FloatArray) -> tuple[FloatArray, float]:
    """The point nearest to all rays in least squares, and its largest misfit in pixels; inf behind a camera."""
    camera = world.camera
    poses = [world.poses[view] for view in views]
    local = np.column_stack([(pixels - [camera.width / 2, camera.height / 2]) / camera.focal, np.ones(len(pixels))])
    rays = np.array([ray @ pose.rotation for ray, pose in zip(local, poses, strict=True)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # (v, 3, 3) projections across each ray
    centres = np.array([pose.centre for pose in poses])
    point = np.linalg.lstsq(across.sum(axis=0), np.einsum("vij,vj->i", across, centres), rcond=None)[0]
    seen = np.array([pose.rotation @ point + pose.translation for pose in poses])
    if np.any(seen[:, 2] <= 0):
        return point, np.inf
    again = camera.focal * seen[:, :2] / seen[:, 2:] + [camera.width / 2, camera.height / 2]
    return point, float(np.linalg.norm(again - pixels, axis=1).max())


def _add_depth_noise(
    world: World,
    frames: list[Frame],
    samples: _Samples,
    points: FloatArray,
    knobs: Knobs,
    generator: np.random.Generator,
) -> FloatArray:
    """Points (n, 3) moved along their own rays by the depth noise; a share of strays lies anywhere along the ray."""
    centres = np.array([pose.centre for pose in world.poses])[samples.frame]
    if knobs.smear or knobs.bare_faces:
        stretch = 1 + _real_errors(world, frames, samples, knobs, generator)
    else:
        stretch = 1 + generator.normal(0, knobs.depth_noise, len(points))
    stray = generator.random(len(points)) < knobs.stray
    stretch[stray] = generator.uniform(0.5, 1.5, int(stray.sum()))
    noisy = centres + (points - centres) * stretch[:, None]
    if knobs.gloss:
        noisy = _mirrored(noisy, samples, knobs.gloss, generator)
    return np.asarray(noisy)


def _real_errors(
    world: World, frames: list[Frame], samples: _Samples, knobs: Knobs, generator: np.random.Generator
) -> FloatArray:
    """(n,) relative errors with the errors of real depth."""
    bare = bare_samples(world, samples.points, samples.number, knobs.bare_faces)
    errors = np.empty(len(bare))
    for index, frame in enumerate(frames):
        own = np.flatnonzero(samples.frame == index)
        rows, columns = samples.row[own], samples.column[own]
        sight = outlook(frame, world.camera, rows, columns)
        depth = frame.depth[rows, columns].astype(float)
        errors[own] = relative_errors(sight, depth, bare[own], knobs, generator)
    return errors


def _mirrored(points: FloatArray, samples: _Samples, share: float, generator: np.random.Generator) -> FloatArray:
    """Points (n, 3) of which a share of the floor's are replaced by mirror images of low points of objects."""
    floor = np.flatnonzero((samples.number == 0) & (samples.points[:, 2] < MIRROR_FLOOR))
    low = np.flatnonzero((samples.number > 0) & (samples.points[:, 2] < MIRROR_HEIGHT))
    chosen = floor[generator.random(len(floor)) < share]
    if not low.size:
        return points
    mirrored = points.copy()
    mirrored[chosen] = points[generator.choice(low, len(chosen))] * [1, 1, -1]
    return mirrored


def _view(name: str, camera: Pinhole, pose: Pose, to_scene: Similarity, keypoints: FloatArray, rows: IntArray) -> View:
    """The view in the scene's frame: the rotation turns against the scene's, the centre goes with it."""
    rotation = pose.rotation @ to_scene.rotation.T
    centre = to_scene(pose.centre[None])[0]
    params = np.array([camera.focal, camera.focal, camera.width / 2, camera.height / 2])
    pinhole = Camera("PINHOLE", camera.width, camera.height, params)
    return View(name, pinhole, rotation, -rotation @ centre, keypoints, rows)
