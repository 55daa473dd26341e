"""Scenes of solids with exact sizes and cameras, for tests and benchmarks of the geometry.

An object has one or several solids (box, cylinder, ellipsoid), in metres with z up. Depth and identity of each pixel
are computed by ray casting, so that masks have exact occlusion and a cloud contains only visible surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
from metric_base.arrays import FloatArray, IntArray

__all__ = [
    "Shape",
    "ShapeScene",
    "Solid",
    "box",
    "cylinder",
    "depth_and_identity",
    "ellipsoid",
    "floor",
    "orbit",
    "sampled_box",
    "sampled_cylinder",
    "synthetic_scene",
    "view_at",
    "yaw",
]


@dataclass(frozen=True)
class Solid:
    """A solid (box, cylinder or ellipsoid) of size (3,), with the pose world = rotation @ local + centre."""

    kind: str
    size: FloatArray
    centre: FloatArray
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Shape:
    """An object of several solids. Objects with the category None have no masks."""

    category: str | None
    solids: tuple[Solid, ...]


@dataclass(frozen=True)
class ShapeScene:
    """A synthetic scene. `owner` (n,) contains the index in `objects` of the object of each dense point."""

    scene: Scene
    instances: tuple[Instance, ...]
    objects: tuple[Shape, ...]
    owner: IntArray


def yaw(degrees: float) -> FloatArray:
    """Return the rotation (3, 3) about the z axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _upright(kind: str, category: str | None, size: tuple[float, ...], foot: tuple[float, ...], turn: float) -> Shape:
    extents = np.asarray(size, dtype=float)
    centre = np.add(foot, [0, 0, extents[2] / 2])
    return Shape(category, (Solid(kind, extents, centre, yaw(turn)),))


def box(category: str | None, size: tuple[float, ...], foot: tuple[float, ...], turn: float = 0.0) -> Shape:
    return _upright("box", category, size, foot, turn)


def cylinder(category: str | None, size: tuple[float, ...], foot: tuple[float, ...], turn: float = 0.0) -> Shape:
    return _upright("cylinder", category, size, foot, turn)


def ellipsoid(category: str | None, size: tuple[float, ...], foot: tuple[float, ...], turn: float = 0.0) -> Shape:
    return _upright("ellipsoid", category, size, foot, turn)


def floor(side: float = 20.0) -> Shape:
    return box(None, (side, side, 0.1), (0, 0, -0.1))


def view_at(
    eye: FloatArray,
    target: FloatArray,
    name: str,
    size: tuple[int, int] = (640, 480),
    focal: float = 520.0,
    roll: float = 0.0,
) -> View:
    """Return a pinhole view from `eye` towards `target`, with z up and `roll` in degrees about the line of sight."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = yaw(roll) @ np.stack([right, np.cross(ahead, right), ahead])
    camera = Camera("PINHOLE", *size, np.array([focal, focal, size[0] / 2, size[1] / 2]))
    return View(name, camera, rotation, -rotation @ eye, np.empty((0, 2)), np.empty(0, dtype=np.int64))


def orbit(
    count: int,
    radius: float,
    height: float,
    arc: float = 360.0,
    target: tuple[float, ...] = (0, 0, 0.4),
    **camera: float,
) -> list[View]:
    """Return views on an arc around the target. The centre of the arc is on the -y side."""
    angles = np.radians(-90 + np.linspace(-arc / 2, arc / 2, count, endpoint=arc < 360))
    centre = np.asarray(target, dtype=float)
    eyes = [np.array([centre[0] + radius * np.cos(a), centre[1] + radius * np.sin(a), height]) for a in angles]
    return [view_at(eye, centre, f"{k:03d}.png", **camera) for k, eye in enumerate(eyes)]  # type: ignore[arg-type]


def sampled_box(size: FloatArray, count: int, random: np.random.Generator) -> FloatArray:
    """Return points (count, 3) with a uniform distribution on the surface of a box around the origin."""
    areas = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis = random.choice(3, count, p=areas / areas.sum())
    points = random.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), axis] = random.choice([-0.5, 0.5], count)
    return points * size


def sampled_cylinder(size: FloatArray, count: int, random: np.random.Generator) -> FloatArray:
    """Return points (count, 3) with a uniform distribution on the surface of an upright cylinder around the origin."""
    radius, height = size[0] / 2, size[2]
    wall, cap = 2 * np.pi * radius * height, np.pi * radius**2
    on_cap = random.random(count) < 2 * cap / (wall + 2 * cap)
    angle, distance = random.uniform(0, 2 * np.pi, count), np.where(on_cap, np.sqrt(random.random(count)), 1.0)
    z = np.where(on_cap, random.choice([-0.5, 0.5], count), random.uniform(-0.5, 0.5, count))
    return np.column_stack([radius * distance * np.cos(angle), radius * distance * np.sin(angle), height * z])


def synthetic_scene(
    objects: list[Shape],
    views: list[View],
    dense: int = 20_000,
    noise: float = 0.002,
    sparse: int = 800,
    seed: int = 0,
) -> ShapeScene:
    """Return the scene of the cameras: exact masks, a dense cloud from all depth maps, and observed sparse points.

    dense, sparse : number of dense and of sparse points.
    noise : standard deviation of a dense point along its ray, relative to its depth.
    """
    random = np.random.default_rng(seed)
    maps = [depth_and_identity(objects, view) for view in views]
    points, owner = _cloud(views, maps, dense, noise, random)
    chosen = random.choice(len(points), size=min(sparse, len(points)), replace=False)
    observations = [_observations(view, depth, points[chosen]) for view, (depth, _) in zip(views, maps, strict=True)]
    observed = tuple(
        View(v.name, v.camera, v.rotation, v.translation, pixels + random.normal(0, 0.3, pixels.shape), rows)
        for v, (rows, pixels) in zip(views, observations, strict=True)
    )
    instances = tuple(instance for k, (_, identity) in enumerate(maps) for instance in _instances(objects, k, identity))
    scene = Scene(Path("made"), "memory", observed, points[chosen], DenseCloud(points))
    return ShapeScene(scene, instances, tuple(objects), owner)


def _instances(objects: list[Shape], view: int, identity: IntArray) -> list[Instance]:
    instances = []
    for index, item in enumerate(objects):
        rows, columns = np.nonzero(identity == index)
        if item.category is None or rows.size < 20:
            continue
        y, x = rows.min(), columns.min()
        crop = identity[y : rows.max() + 1, x : columns.max() + 1] == index
        instances.append(Instance(f"{view}-{index}", view, item.category, crop, (int(x), int(y)), track=str(index)))
    return instances


def _rays(view: View, pixels: FloatArray) -> FloatArray:
    """Return the ray directions (n, 3) of pixels (n, 2) in the world, with a depth of 1."""
    fx, fy, cx, cy = view.camera.params
    local = np.column_stack([(pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy, np.ones(len(pixels))])
    return np.asarray(local @ view.rotation)


def depth_and_identity(objects: list[Shape], view: View) -> tuple[FloatArray, IntArray]:
    """Return the depth (h, w) and the index of the object (h, w) at every pixel; infinite and -1 without an object."""
    width, height = view.camera.width, view.camera.height
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = _rays(view, np.column_stack([x.ravel(), y.ravel()])).reshape(height, width, 3)
    depth, identity = np.full((height, width), np.inf), np.full((height, width), -1)
    for index, item in enumerate(objects):
        for solid in item.solids:
            window = _window(solid, view)
            hit = _depths(solid, view.centre, rays[window].reshape(-1, 3)).reshape(depth[window].shape)
            closer = hit < depth[window]
            depth[window][closer], identity[window][closer] = hit[closer], index
    return depth, identity


def _window(solid: Solid, view: View) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels that can show a solid: all, unless it is in front of the camera."""
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(8, 3) * solid.size
    local = (corners @ solid.rotation.T + solid.centre) @ view.rotation.T + view.translation
    if local[:, 2].min() < 1e-3:
        return slice(None), slice(None)
    fx, fy, cx, cy = view.camera.params
    pixels = local[:, :2] / local[:, 2:] * [fx, fy] + [cx, cy]
    (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
    return slice(max(top - 1, 0), max(bottom + 1, 0)), slice(max(left - 1, 0), max(right + 1, 0))


def _depths(solid: Solid, eye: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the depth (n,) of the first intersection of rays (n, 3) with a solid; infinite without intersection."""
    half = solid.size / 2
    start = (solid.rotation.T @ (eye - solid.centre)) / half
    ray = np.ascontiguousarray(((rays @ solid.rotation) / half).T)  # (3, n): NumPy is slow along a short axis
    with np.errstate(divide="ignore", invalid="ignore"):
        if solid.kind == "box":
            near, far = _slab(start, ray)
        elif solid.kind == "ellipsoid":
            near, far = _ball(start, ray)
        else:
            side, cap = _ball(start[:2], ray[:2]), _slab(start[2:], ray[2:])
            near, far = np.maximum(side[0], cap[0]), np.minimum(side[1], cap[1])
    return np.where((near <= far) & (near > 1e-6), near, np.inf)


def _slab(start: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where rays (d, n) from `start` (d,) enter and leave the cube [-1, 1]^d, (n,) each."""
    near, far = np.full(ray.shape[1], -np.inf), np.full(ray.shape[1], np.inf)
    for position, along in zip(start, ray, strict=True):
        low, high = (-1 - position) / along, (1 - position) / along
        near, far = np.maximum(near, np.minimum(low, high)), np.minimum(far, np.maximum(low, high))
    return near, far


def _ball(start: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where rays (d, n) from `start` (d,) enter and leave the unit ball, (n,) each."""
    a, b, c = np.asarray(sum(along**2 for along in ray)), start @ ray, start @ start - 1
    root = np.sqrt(b**2 - a * c)
    root = np.where(np.isnan(root), -np.inf, root)
    return (-b - root) / a, (-b + root) / a


def _cloud(
    views: list[View], maps: list[tuple[FloatArray, IntArray]], count: int, noise: float, random: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    points, owner = [], []
    for view, (depth, identity) in zip(views, maps, strict=True):
        lines, columns = np.nonzero(np.isfinite(depth))
        take = random.choice(lines.size, size=min(count // len(views), lines.size), replace=False)
        lines, columns = lines[take], columns[take]
        z = depth[lines, columns] * (1 + random.normal(0, noise, take.size))
        points.append(view.centre + z[:, None] * _rays(view, np.column_stack([columns + 0.5, lines + 0.5])))
        owner.append(identity[lines, columns])
    return np.concatenate(points), np.concatenate(owner)


def _observations(view: View, depth: FloatArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return indices and pixels of the points that are visible in the view (within 2 % of its exact depth)."""
    local = points @ view.rotation.T + view.translation
    fx, fy, cx, cy = view.camera.params
    z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
    pixels = np.column_stack([local[:, 0] / z * fx + cx, local[:, 1] / z * fy + cy])
    inside = ((pixels >= 0) & (pixels < [view.camera.width, view.camera.height])).all(axis=1)
    rows = np.flatnonzero(inside)
    columns, lines = pixels[rows].astype(int).T
    rows = rows[np.abs(depth[lines, columns] / local[rows, 2] - 1) < 0.02]
    return rows, pixels[rows]
