"""A test world of small, far, half-hidden objects on each of which structure from motion has 1 to 30 points.

Upright solids stand on a ground with texture: boxes, cylinders, cars (body and cabin), chairs (seat, back, legs). A
camera walks past, pans with a short baseline, flies above, walks round, or walks along a lawn that falls away from its
path. Rays give exact masks with true occlusion; their border is then off by a pixel or two. Points are seen on the
visible surface and triangulated from noisy pixels, so that their errors are those of the rays and the baseline.
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
#: One sigma of a keypoint and of a mask's border, in pixels.
KEYPOINT_PX, BORDER_PX = 0.7, 1.2
#: Beside a lawn the ground falls by this share beyond y = `LAWN_Y`; the camera's own path is level.
FALL, LAWN_Y = 0.05, -5.0
#: Objects of a world, points of the ground, least pixels of a mask.
OBJECTS, GROUND_POINTS, LEAST_PIXELS = 10, 400, 60
MAX_POINTS = 30
#: A view that could observe a point does so this often; a point has two observations or more.
OBSERVED, LEAST_VIEWS = 0.6, 2


@dataclass(frozen=True, slots=True, eq=False)
class FewPointsWorld:
    """A scene in metres, its masks, and (n, 3) the true length, width and height by track number."""

    scene: Scene
    instances: tuple[Instance, ...]
    sizes: FloatArray
    path: str


def few_points_world(seed: int, path: str, points: tuple[int, int] = (1, MAX_POINTS)) -> FewPointsWorld:
    """The world of a seed along one of the `PATHS`; points : fewest and most on an object, before
    triangulation."""
    random = np.random.default_rng([seed, PATHS.index(path), 71])
    views = _path(path, random)
    objects, sizes = _objects(path, random)
    ground = _ground(path)
    maps = [depth_and_identity([*objects, ground], view) for view in views]
    places, owner = _surface_points(views, maps, len(objects), points, random)
    seen = _triangulated(views, maps, places, owner, random)
    instances = tuple(
        instance for k, (_, ids) in enumerate(maps) for instance in _masks(k, ids[: SIZE[1]], objects, random)
    )
    scene = Scene(Path(f"few-{path}-{seed}"), "memory", *seen)
    return FewPointsWorld(scene, instances, sizes, path)


def _ground(path: str) -> Shape:
    """What the camera and the objects stand on."""
    if path != "lawn":
        return Shape(None, (Solid("box", np.array([200.0, 200.0, 0.1]), np.array([0.0, 0.0, -0.05])),))
    tilt = np.arctan(FALL)
    turned = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    fallen = Solid("box", np.array([200.0, 100.0, 0.1]), turned @ [0, 50.0, -0.05] + [0, LAWN_Y, 0], turned)
    level = Solid("box", np.array([200.0, 100.0, 0.1]), np.array([0.0, LAWN_Y - 50, -0.05]))
    return Shape(None, (level, fallen))


def _ground_height(path: str, y: float) -> float:
    """The height of the ground at y, which is 0 on the path."""
    return -FALL * max(y - LAWN_Y, 0.0) if path == "lawn" else 0.0


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
    """Objects that do not touch, and their (n, 3) sizes."""
    objects: list[Shape] = []
    sizes: list[FloatArray] = []
    places: list[FloatArray] = []
    while len(objects) < OBJECTS:
        spread = (9.0, 6.0) if path == "above" else (5.0, 4.5)
        place = np.array([random.uniform(-spread[0], spread[0]), random.uniform(-spread[1], spread[1]) + 1.5])
        kind = random.choice(["box", "cylinder", "car", "chair"])
        size = {
            "car": np.array([4.3, 1.8, 1.5]),
            "chair": np.array([0.5, 0.45, 0.9]),
            "box": np.array([0.8, 0.5, 0.6]),
            "cylinder": np.array([0.5, 0.5, 0.8]),
        }[kind] * np.exp(random.normal(0, 0.15, 3))
        if kind == "cylinder":
            size[1] = size[0]
        if any(np.linalg.norm(place - other[:2]) < 0.55 * (size[0] + other[2]) for other in places):
            if random.random() < 0.02:
                places.clear()
            continue
        places.append(np.array([*place, size[0]]))
        foot = np.array([*place, _ground_height(path, float(place[1]))])
        objects.append(Shape(kind, tuple(_solids(kind, size, foot, float(random.uniform(0, 180))))))
        sizes.append(np.array([*sorted(size[:2], reverse=True), size[2]]))
    return objects, np.array(sizes)


def _solids(kind: str, size: FloatArray, place: FloatArray, turn: float) -> list[Solid]:
    parts: list[tuple[str, tuple[float, ...], tuple[float, ...]]]
    if kind == "car":  # shares of the size: extents, centre
        parts = [("box", (1, 1, 0.55), (0, 0, 0.33)), ("box", (0.55, 0.86, 0.4), (-0.06, 0, 0.8))]
        parts += [("box", (0.14, 0.9, 0.2), (x, 0, 0.1)) for x in (-0.32, 0.32)]
    elif kind == "chair":
        parts = [("box", (1, 1, 0.08), (0, 0, 0.46)), ("box", (0.1, 1, 0.5), (-0.45, 0, 0.75))]
        parts += [("box", (0.09, 0.1, 0.44), (x, y, 0.22)) for x in (-0.45, 0.45) for y in (-0.45, 0.45)]
    else:
        parts = [(kind, (1, 1, 1), (0, 0, 0.5))]
    rotation = yaw(turn)
    return [
        Solid(shape, np.array(own) * size, rotation @ (np.array(at) * size) + place, rotation)
        for shape, own, at in parts
    ]


def _surface_points(
    views: list[View],
    maps: list[tuple[FloatArray, IntArray]],
    count: int,
    ends: tuple[int, int],
    random: np.random.Generator,
) -> tuple[FloatArray, IntArray]:
    """As many points of each object that is seen as `ends` allow, and points of the ground; with the object of each."""
    points, owner = [], []
    few, most = np.log(ends[0]), np.log(ends[1] + 1)
    for number in range(count + 1):
        wanted = GROUND_POINTS if number == count else int(np.exp(random.uniform(few, most)))
        by_view = [np.argwhere(ids == number) for _, ids in maps]
        total = np.array([len(own) for own in by_view])
        if not total.sum():
            continue
        for view in random.choice(len(views), wanted, p=total / total.sum()):
            line, column = by_view[view][random.integers(total[view])]
            depth = maps[view][0][line, column]
            own = views[view]
            fx, fy, cx, cy = own.camera.params
            ray = np.array([(column + 0.5 - cx) / fx, (line + 0.5 - cy) / fy, 1.0])
            points.append(own.rotation.T @ (ray * depth - own.translation))
            owner.append(number)
    return np.array(points), np.array(owner)


def _triangulated(
    views: list[View],
    maps: list[tuple[FloatArray, IntArray]],
    points: FloatArray,
    owner: IntArray,
    random: np.random.Generator,
) -> tuple[tuple[View, ...], FloatArray]:
    """The views with their observations, and the points (n, 3) triangulated from them."""
    pixels = np.full((len(views), len(points), 2), np.nan)
    for k, (view, (depth, ids)) in enumerate(zip(views, maps, strict=True)):
        local = points @ view.rotation.T + view.translation
        fx, fy, cx, cy = view.camera.params
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.column_stack([local[:, 0] / local[:, 2] * fx + cx, local[:, 1] / local[:, 2] * fy + cy])
        inside = (local[:, 2] > 0) & (at >= 0).all(axis=1) & (at < SIZE).all(axis=1)
        rows = np.flatnonzero(inside)
        columns, lines = at[rows].astype(int).T
        rows = rows[(np.abs(depth[lines, columns] / local[rows, 2] - 1) < 0.01) & (ids[lines, columns] == owner[rows])]
        rows = rows[random.random(len(rows)) < OBSERVED]
        pixels[k, rows] = at[rows] + random.normal(0, KEYPOINT_PX, (len(rows), 2))
    seen = np.isfinite(pixels[..., 0])
    kept = np.flatnonzero(seen.sum(axis=0) >= LEAST_VIEWS)
    places = np.array([_point(views, pixels[:, row], points[row]) for row in kept]).reshape(-1, 3)
    ahead = np.array([
        all((view.rotation @ place + view.translation)[2] > 0.1 for view in views) for place in places
    ], dtype=bool)  # fmt: skip
    kept, places = kept[ahead], places[ahead]
    found = []
    for k, view in enumerate(views):
        rows = np.flatnonzero(seen[k, kept])
        found.append(replace(view, keypoints=pixels[k, kept[rows]], point_index=rows))
    return tuple(found), places


def _point(views: list[View], pixels: FloatArray, start: FloatArray) -> FloatArray:
    """(3,) the point that fits its pixels (v, 2) best, NaN where it is not observed, by Gauss and Newton."""
    place = start.copy()
    for _ in range(8):
        normal, pull = 1e-9 * np.eye(3), np.zeros(3)
        for view, at in zip(views, pixels, strict=True):
            if np.isfinite(at[0]):
                local = view.rotation @ place + view.translation
                fx, fy, cx, cy = view.camera.params
                residual = np.array([local[0] / local[2] * fx + cx, local[1] / local[2] * fy + cy]) - at
                slope = np.array([[fx, 0, -fx * local[0] / local[2]], [0, fy, -fy * local[1] / local[2]]]) / local[2]
                rows = slope @ view.rotation
                normal += rows.T @ rows
                pull += rows.T @ residual
        step = np.linalg.solve(normal, pull)
        place = place - step * min(1.0, 2.0 / max(float(np.linalg.norm(step)), 1e-12))
    return place


def _masks(view: int, ids: IntArray, objects: list[Shape], random: np.random.Generator) -> list[Instance]:
    import cv2

    found = []
    for number, item in enumerate(objects):
        lines, columns = np.nonzero(ids == number)
        if lines.size < LEAST_PIXELS:
            continue
        pad = 4
        top, left = max(lines.min() - pad, 0), max(columns.min() - pad, 0)
        whole = ids[top : lines.max() + pad + 1, left : columns.max() + pad + 1] == number
        inner = cv2.distanceTransform(whole.astype(np.uint8), cv2.DIST_L2, 5)
        outer = cv2.distanceTransform((~whole).astype(np.uint8), cv2.DIST_L2, 5)
        noise = cv2.GaussianBlur(random.normal(0, 1, whole.shape), (0, 0), 5)
        shift = BORDER_PX * (noise / max(float(noise.std()), 1e-9)) + random.normal(0, 0.5)
        mask = (inner - outer) > np.where(whole, 0, -1) + shift * 0.7
        if mask.sum() < LEAST_PIXELS // 2:
            continue
        found.append(
            Instance(f"{view}-{number}", view, str(item.category), mask, (int(left), int(top)), track=str(number))
        )
    return found
