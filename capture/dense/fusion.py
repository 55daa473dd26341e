"""A dense cloud from the depths of several views: points that other views agree on, each once, with its visibility."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.dense.plane_filling import fill_planes
from capture.dense.plane_sweep import PinholeView, pinhole_view, swept_depth
from estimator.reconstructions.ply import visibility_bytes
from estimator.records.scene import Scene
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Most views whose depth is computed, evenly over the capture.
MOST_VIEWS = 24
#: Views that each is compared with, chosen by how many points they share and the angle between their rays.
SOURCES = 4
BEST_ANGLE_DEG, ANGLE_SPREAD_DEG = 8.0, 6.0
#: Depths of two views agree within this share; a point needs so many other views that agree.
AGREEMENT, AGREEING = 0.012, 2
#: Every so many pixels of a view gives a point.
STRIDE = 2
THREADS = 2


def make_dense_cloud(scene: Scene, pictures: Path, file: Path, progress: Callable[[int, int | None], None]) -> int:
    """Write `file` (PLY with colours) and `file.vis` (COLMAP's layout); how many points there are.

    With no point nothing is written. progress : is called with how many views are done, of how many.
    """
    count = min(MOST_VIEWS, len(scene.views))
    chosen = np.unique(np.linspace(0, len(scene.views) - 1, count).astype(int)).tolist()
    shared = _shared_points(scene)
    views = {row: pinhole_view(scene.views[row], pictures) for row in _views_and_sources(scene, chosen, shared)}

    def depth_of(row: int) -> NDArray[np.float32]:
        nearest, furthest = _depth_range(scene, row)
        swept = swept_depth(views[row], [views[k] for k in _sources(scene, row, shared)], nearest, furthest)
        return fill_planes(swept, views[row].grey)

    depths: dict[int, NDArray[np.float32]] = {}
    with ThreadPoolExecutor(THREADS) as pool:
        for done, (row, depth) in enumerate(zip(chosen, pool.map(depth_of, chosen), strict=True)):
            depths[row] = depth
            progress(done + 1, len(chosen))
    points, colours, seen = _fuse(views, depths)
    if len(points):
        _write(points, colours, seen, np.array(sorted(depths)), file)
    return len(points)


def _shared_points(scene: Scene) -> IntArray:
    """(v, v) how many sparse points two views share."""
    sees = np.zeros((len(scene.views), len(scene.points)), dtype=np.float32)
    for row, view in enumerate(scene.views):
        sees[row, view.point_index] = 1
    return np.asarray(sees @ sees.T, dtype=np.int64)


def _sources(scene: Scene, row: int, shared: IntArray) -> list[int]:
    """Views to compare with: of many points in common, `shared` (v, v), under an angle that determines depth."""
    view = scene.views[row]
    middle = np.median(scene.points[view.point_index], axis=0)
    rays = np.array([middle - other.centre for other in scene.views])
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    angle = np.degrees(np.arccos(np.clip(rays @ rays[row], -1, 1)))
    score = shared[row] * np.exp(-(((angle - BEST_ANGLE_DEG) / ANGLE_SPREAD_DEG) ** 2))
    score[row] = -1
    return [int(other) for other in np.argsort(-score, kind="stable")[:SOURCES]]


def _views_and_sources(scene: Scene, chosen: Sequence[int], shared: IntArray) -> list[int]:
    """Rows of the chosen views and of those they are compared with; shared : (v, v) points in common."""
    return sorted({*chosen, *(source for row in chosen for source in _sources(scene, row, shared))})


def _depth_range(scene: Scene, row: int) -> tuple[float, float]:
    view = scene.views[row]
    depth = (view.to_camera(scene.points[view.point_index]))[:, 2]
    near, far = np.quantile(depth[depth > 0], [0.01, 0.99])
    return 0.8 * float(near), 1.25 * float(far)


def _fuse(
    views: dict[int, PinholeView], depths: dict[int, NDArray[np.float32]]
) -> tuple[FloatArray, NDArray[np.uint8], BoolArray]:
    """Points (n, 3), colours (n, 3) and which of the views with depth see them (n, v); each surface once."""
    rows = sorted(depths)
    taken = {row: np.zeros(depths[row].shape, dtype=bool) for row in rows}
    points, colours, seen = [], [], []
    for position, row in enumerate(rows):
        ys, xs = np.nonzero(np.isfinite(depths[row]) & ~taken[row])
        kept = (ys % STRIDE == 0) & (xs % STRIDE == 0)
        ys, xs = ys[kept], xs[kept]
        world = _back_project(views[row], xs, ys, depths[row][ys, xs])
        sees = np.zeros((len(world), len(rows)), dtype=bool)
        sees[:, position] = True
        cells = {}
        for other_position, other in enumerate(rows):
            if other != row:
                sees[:, other_position], cells[other] = _agreeing(views[other], depths[other], world)
        good = sees.sum(axis=1) > AGREEING
        for other_position, other in enumerate(rows):
            if other != row:
                _mark(taken[other], cells[other][good & sees[:, other_position]])
        points.append(world[good])
        colours.append(views[row].colour[ys[good], xs[good]])
        seen.append(sees[good])
    return np.concatenate(points), np.concatenate(colours), np.concatenate(seen)


def _back_project(view: PinholeView, xs: IntArray, ys: IntArray, depth: NDArray[np.float32]) -> FloatArray:
    """(n, 3) world points of pixels at their depths."""
    rays = np.column_stack([xs, ys, np.ones(len(xs))]) @ np.linalg.inv(view.matrix).T
    return np.asarray((rays * depth[:, None].astype(np.float64) - view.translation) @ view.rotation)


def _agreeing(view: PinholeView, depth: NDArray[np.float32], world: FloatArray) -> tuple[BoolArray, IntArray]:
    """(n,) whether the view's own depth says the same of the points, and their pixels (n, 2) as x, y."""
    local = world @ view.rotation.T + view.translation
    height, width = depth.shape
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (local / local[:, 2:]) @ view.matrix.T
    ahead = (local[:, 2] > 0) & (np.abs(pixels) < 1e6).all(axis=1)
    cells = np.rint(np.where(ahead[:, None], pixels[:, :2], -1)).astype(np.int64)
    inside = ahead & (cells >= 0).all(axis=1) & (cells < (width, height)).all(axis=1)
    cells[~inside] = 0
    there = depth[cells[:, 1], cells[:, 0]]
    with np.errstate(invalid="ignore"):
        return inside & (np.abs(there / local[:, 2] - 1) < AGREEMENT), cells


def _mark(taken: BoolArray, cells: IntArray) -> None:
    """Mark in `taken` (h, w) the pixels (n, 2) that a point was made of, and their neighbours that the stride skips."""
    height, width = taken.shape
    for dy in range(-(STRIDE // 2), STRIDE // 2 + 1):
        for dx in range(-(STRIDE // 2), STRIDE // 2 + 1):
            taken[np.clip(cells[:, 1] + dy, 0, height - 1), np.clip(cells[:, 0] + dx, 0, width - 1)] = True


def _write(points: FloatArray, colours: NDArray[np.uint8], seen: BoolArray, rows: IntArray, file: Path) -> None:
    """Write points (n, 3), colours (n, 3) and the views that see them, (n, v) of the views `rows` (v,)."""
    record = [(axis, "<f4") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    vertices = np.empty(len(points), dtype=record)
    for k, axis in enumerate("xyz"):
        vertices[axis] = points[:, k]
    for k, name in enumerate(("red", "green", "blue")):
        vertices[name] = colours[:, k]
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property {'float' if kind == '<f4' else 'uchar'} {name}\n" for name, kind in record)
    file.write_bytes(header.encode() + b"end_header\n" + vertices.tobytes())
    offsets = np.concatenate([[0], np.cumsum(seen.sum(axis=1))]).astype(np.int64)
    file.with_name(f"{file.name}.vis").write_bytes(visibility_bytes(offsets, rows[np.nonzero(seen)[1]]))
