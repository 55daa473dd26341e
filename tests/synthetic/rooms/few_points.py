"""Worlds of small, distant and partly occluded objects with 1 to 30 points of structure from motion each.

Upright solids are on a textured ground: boxes, cylinders, cars (body and cabin) and chairs (seat, back, legs). The
camera walks past, pans with a short baseline, flies above, walks around, or walks next to a lawn that slopes down from
its path. Masks are computed by ray casting, with exact occlusion, and their borders are then changed by a pixel or two.
Points are sampled on visible surfaces and triangulated from noisy pixels, so that they have realistic errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.records.scene import Instance, Scene, View
from metric_base.arrays import FloatArray, IntArray
from tests.synthetic.shapes import Shape, Solid, depth_and_identity, view_at, yaw

__all__ = ["MAX_POINTS", "PATHS", "FewPointsWorld", "few_points_world"]

PATHS = ("walk", "pan", "above", "round", "lawn")
SIZE, FOCAL = (640, 480), 520.0
#: Standard deviations of a keypoint and of a mask's border in pixels.
KEYPOINT_PX = 0.7
BORDER_PX = 1.2
#: Slope of the lawn beyond y = `LAWN_Y`; the camera's path is level.
LAWN_SLOPE = 0.05
LAWN_Y = -5.0
N_OBJECTS = 10
N_GROUND_POINTS = 400
#: Minimum number of pixels of a mask.
MIN_PIXELS = 60
#: Maximum number of points of an object.
MAX_POINTS = 30
#: Probability that a point is observed in a view in which it is visible.
OBSERVED_FRACTION = 0.6
#: Minimum number of observations of a point.
MIN_VIEWS = 2


@dataclass(frozen=True, slots=True, eq=False)
class FewPointsWorld:
    """A scene in metres, its masks, and the true length, width and height (n, 3) by track number."""

    scene: Scene
    instances: tuple[Instance, ...]
    sizes: FloatArray
    path: str


def few_points_world(seed: int, path: str, points: tuple[int, int] = (1, MAX_POINTS)) -> FewPointsWorld:
    """Return the world of a seed with one of the `PATHS`.

    points : minimum and maximum number of points of an object before triangulation.
    """
    random = np.random.default_rng([seed, PATHS.index(path), 71])
    views = _path(path, random)
    objects, sizes = _objects(path, random)
    ground = _ground(path)
    maps = [depth_and_identity([*objects, ground], view) for view in views]
    sampled, owner = _surface_points(views, maps, len(objects), points, random)
    reconstruction = _triangulated(views, maps, sampled, owner, random)
    instances = tuple(
        instance for k, (_, ids) in enumerate(maps) for instance in _masks(k, ids[: SIZE[1]], objects, random)
    )
    scene = Scene(Path(f"few-{path}-{seed}"), "memory", *reconstruction)
    return FewPointsWorld(scene, instances, sizes, path)


def _ground(path: str) -> Shape:
    """Return the ground: a level plane, or a level path and a sloping lawn."""
    if path != "lawn":
        return Shape(None, (Solid("box", np.array([200.0, 200.0, 0.1]), np.array([0.0, 0.0, -0.05])),))
    tilt = np.arctan(LAWN_SLOPE)
    rotation = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    lawn = Solid("box", np.array([200.0, 100.0, 0.1]), rotation @ [0, 50.0, -0.05] + [0, LAWN_Y, 0], rotation)
    level = Solid("box", np.array([200.0, 100.0, 0.1]), np.array([0.0, LAWN_Y - 50, -0.05]))
    return Shape(None, (level, lawn))


def _ground_height(path: str, y: float) -> float:
    """Return the height of the ground at y; 0 on the path."""
    return -LAWN_SLOPE * max(y - LAWN_Y, 0.0) if path == "lawn" else 0.0


def _path(path: str, random: np.random.Generator) -> list[View]:
    count = int(random.integers(6, 12))
    steps = np.linspace(0, 1, count)
    if path in ("walk", "lawn"):
        eyes = [np.array([-4 + 8 * t, -12 + 5 * t, 1.6 + 0.03 * random.normal()]) for t in steps]
        targets = [np.array([0.0, 3.0, 0.8])] * count
    elif path == "pan":
        eyes = [np.array([-0.5 + 1.0 * t, -9.0, 1.5 + 0.02 * random.normal()]) for t in steps]
        targets = [np.array([-2 + 4 * t, 2.0, 0.6]) for t in steps]
    elif path == "above":
        eyes = [np.array([-10 + 20 * t, -8 + 4 * t, 24.0]) for t in steps]
        targets = [np.array([-3 + 6 * t, 1.0, 0.0]) for t in steps]
    else:
        angles = np.radians(-150 + 120 * steps)
        eyes = [np.array([9 * np.cos(a), 9 * np.sin(a), 1.8]) for a in angles]
        targets = [np.array([0.0, 0.0, 0.5])] * count
    return [
        view_at(eye, to, f"{k:03d}.png", SIZE, FOCAL, float(random.normal(0, 1)))
        for k, (eye, to) in enumerate(zip(eyes, targets, strict=True))
    ]


def _objects(path: str, random: np.random.Generator) -> tuple[list[Shape], FloatArray]:
    """Return objects that do not touch, and their sizes (n, 3)."""
    objects: list[Shape] = []
    sizes: list[FloatArray] = []
    positions: list[FloatArray] = []
    while len(objects) < N_OBJECTS:
        half = (9.0, 6.0) if path == "above" else (5.0, 4.5)
        position = np.array([random.uniform(-half[0], half[0]), random.uniform(-half[1], half[1]) + 1.5])
        kind = random.choice(["box", "cylinder", "car", "chair"])
        size = {
            "car": np.array([4.3, 1.8, 1.5]),
            "chair": np.array([0.5, 0.45, 0.9]),
            "box": np.array([0.8, 0.5, 0.6]),
            "cylinder": np.array([0.5, 0.5, 0.8]),
        }[kind] * np.exp(random.normal(0, 0.15, 3))
        if kind == "cylinder":
            size[1] = size[0]
        if any(np.linalg.norm(position - other[:2]) < 0.55 * (size[0] + other[2]) for other in positions):
            if random.random() < 0.02:
                positions.clear()
            continue
        positions.append(np.array([*position, size[0]]))
        foot = np.array([*position, _ground_height(path, float(position[1]))])
        objects.append(Shape(kind, tuple(_solids(kind, size, foot, float(random.uniform(0, 180))))))
        sizes.append(np.array([*sorted(size[:2], reverse=True), size[2]]))
    return objects, np.array(sizes)


def _solids(kind: str, size: FloatArray, position: FloatArray, turn: float) -> list[Solid]:
    parts: list[tuple[str, tuple[float, ...], tuple[float, ...]]]
    if kind == "car":  # extents and centre relative to the size
        parts = [("box", (1, 1, 0.55), (0, 0, 0.33)), ("box", (0.55, 0.86, 0.4), (-0.06, 0, 0.8))]
        parts += [("box", (0.14, 0.9, 0.2), (x, 0, 0.1)) for x in (-0.32, 0.32)]
    elif kind == "chair":
        parts = [("box", (1, 1, 0.08), (0, 0, 0.46)), ("box", (0.1, 1, 0.5), (-0.45, 0, 0.75))]
        parts += [("box", (0.09, 0.1, 0.44), (x, y, 0.22)) for x in (-0.45, 0.45) for y in (-0.45, 0.45)]
    else:
        parts = [(kind, (1, 1, 1), (0, 0, 0.5))]
    rotation = yaw(turn)
    return [
        Solid(shape, np.array(extents) * size, rotation @ (np.array(centre) * size) + position, rotation)
        for shape, extents, centre in parts
    ]


def _surface_points(
    views: list[View],
    maps: list[tuple[FloatArray, IntArray]],
    count: int,
    ends: tuple[int, int],
    random: np.random.Generator,
) -> tuple[FloatArray, IntArray]:
    """Return points (n, 3) on the visible objects and on the ground, and the index of the object (n,) of each.

    ends : minimum and maximum number of points of an object.
    """
    points, owner = [], []
    low, high = np.log(ends[0]), np.log(ends[1] + 1)
    for index in range(count + 1):
        n_points = N_GROUND_POINTS if index == count else int(np.exp(random.uniform(low, high)))
        by_view = [np.argwhere(ids == index) for _, ids in maps]
        total = np.array([len(pixels) for pixels in by_view])
        if not total.sum():
            continue
        for row in random.choice(len(views), n_points, p=total / total.sum()):
            line, column = by_view[row][random.integers(total[row])]
            depth = maps[row][0][line, column]
            view = views[row]
            fx, fy, cx, cy = view.camera.params
            ray = np.array([(column + 0.5 - cx) / fx, (line + 0.5 - cy) / fy, 1.0])
            points.append(view.rotation.T @ (ray * depth - view.translation))
            owner.append(index)
    return np.array(points), np.array(owner)


def _triangulated(
    views: list[View],
    maps: list[tuple[FloatArray, IntArray]],
    points: FloatArray,
    owner: IntArray,
    random: np.random.Generator,
) -> tuple[tuple[View, ...], FloatArray]:
    """Return the views with noisy observations, and the points (n, 3) that are triangulated from them."""
    pixels = np.full((len(views), len(points), 2), np.nan)
    for k, (view, (depth, ids)) in enumerate(zip(views, maps, strict=True)):
        local = points @ view.rotation.T + view.translation
        fx, fy, cx, cy = view.camera.params
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = np.column_stack([local[:, 0] / local[:, 2] * fx + cx, local[:, 1] / local[:, 2] * fy + cy])
        inside = (local[:, 2] > 0) & (exact >= 0).all(axis=1) & (exact < SIZE).all(axis=1)
        rows = np.flatnonzero(inside)
        columns, lines = exact[rows].astype(int).T
        rows = rows[(np.abs(depth[lines, columns] / local[rows, 2] - 1) < 0.01) & (ids[lines, columns] == owner[rows])]
        rows = rows[random.random(len(rows)) < OBSERVED_FRACTION]
        pixels[k, rows] = exact[rows] + random.normal(0, KEYPOINT_PX, (len(rows), 2))
    is_observed = np.isfinite(pixels[..., 0])
    kept = np.flatnonzero(is_observed.sum(axis=0) >= MIN_VIEWS)
    positions = np.array([_triangulate(views, pixels[:, row], points[row]) for row in kept]).reshape(-1, 3)
    in_front = np.array([
        all((view.rotation @ position + view.translation)[2] > 0.1 for view in views) for position in positions
    ], dtype=bool)  # fmt: skip
    kept, positions = kept[in_front], positions[in_front]
    observing = []
    for k, view in enumerate(views):
        rows = np.flatnonzero(is_observed[k, kept])
        observing.append(replace(view, keypoints=pixels[k, kept[rows]], point_index=rows))
    return tuple(observing), positions


def _triangulate(views: list[View], pixels: FloatArray, start: FloatArray) -> FloatArray:
    """Return the point (3,) with the least squares error at its pixels (v, 2), NaN if not observed (Gauss-Newton)."""
    position = start.copy()
    for _ in range(8):
        normal, gradient = 1e-9 * np.eye(3), np.zeros(3)
        for view, pixel in zip(views, pixels, strict=True):
            if np.isfinite(pixel[0]):
                local = view.rotation @ position + view.translation
                fx, fy, cx, cy = view.camera.params
                residual = np.array([local[0] / local[2] * fx + cx, local[1] / local[2] * fy + cy]) - pixel
                slope = np.array([[fx, 0, -fx * local[0] / local[2]], [0, fy, -fy * local[1] / local[2]]]) / local[2]
                rows = slope @ view.rotation
                normal += rows.T @ rows
                gradient += rows.T @ residual
        step = np.linalg.solve(normal, gradient)
        position = position - step * min(1.0, 2.0 / max(float(np.linalg.norm(step)), 1e-12))
    return position


def _masks(view: int, ids: IntArray, objects: list[Shape], random: np.random.Generator) -> list[Instance]:
    import cv2

    instances = []
    for index, item in enumerate(objects):
        lines, columns = np.nonzero(ids == index)
        if lines.size < MIN_PIXELS:
            continue
        pad = 4
        top, left = max(lines.min() - pad, 0), max(columns.min() - pad, 0)
        exact = ids[top : lines.max() + pad + 1, left : columns.max() + pad + 1] == index
        inner = cv2.distanceTransform(exact.astype(np.uint8), cv2.DIST_L2, 5)
        outer = cv2.distanceTransform((~exact).astype(np.uint8), cv2.DIST_L2, 5)
        noise = cv2.GaussianBlur(random.normal(0, 1, exact.shape), (0, 0), 5)
        shift = BORDER_PX * (noise / max(float(noise.std()), 1e-9)) + random.normal(0, 0.5)
        mask = (inner - outer) > np.where(exact, 0, -1) + shift * 0.7
        if mask.sum() < MIN_PIXELS // 2:
            continue
        instances.append(
            Instance(f"{view}-{index}", view, str(item.category), mask, (int(left), int(top)), track=str(index))
        )
    return instances
