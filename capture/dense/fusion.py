"""Fuse the depth maps of several views into a dense cloud of the points that other views confirm."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.dense.plane_filling import fill_planes
from capture.dense.plane_sweep import PinholeView, pinhole_view, swept_depth
from estimator.reconstructions.ply import visibility_bytes
from estimator.records.scene import Scene
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Maximum number of views with a depth map, evenly spaced over the capture.
MAX_VIEWS = 24
#: Number of views that each is compared with, chosen by the number of common points and the angle between the rays.
N_SOURCES = 4
BEST_ANGLE_DEG, ANGLE_SPREAD_DEG = 8.0, 6.0
#: Maximum relative difference of depths that agree, and minimum number of other views that agree on a point.
MAX_DIFFERENCE, MIN_AGREEING = 0.012, 2
#: Step in pixels between the points of a view.
STRIDE = 2
#: Quantiles of the depths of sparse points that bound the sweep, and their margins.
DEPTH_QUANTILES, DEPTH_MARGINS = (0.01, 0.99), (0.8, 1.25)
N_THREADS = 2


def make_dense_cloud(scene: Scene, images: Path, file: Path, progress: Callable[[int, int | None], None]) -> int:
    """Write a dense cloud with colours and its visibility, and return the number of points.

    Parameters
    ----------
    scene : Scene
    images : Path
        Folder of the images.
    file : Path
        PLY file; `<file>.vis` has COLMAP's layout. Without points nothing is written.
    progress : callable
        Called with the number of views done and their total.
    """
    count = min(MAX_VIEWS, len(scene.views))
    chosen = np.unique(np.linspace(0, len(scene.views) - 1, count).astype(int)).tolist()
    sees = np.zeros((len(scene.views), len(scene.points)), dtype=np.float32)
    for row, view in enumerate(scene.views):
        sees[row, view.point_index] = 1
    common = np.asarray(sees @ sees.T, dtype=np.int64)
    sources = {row: _sources(scene, row, common) for row in chosen}
    needed = sorted({*chosen, *(other for others in sources.values() for other in others)})
    views = {row: pinhole_view(scene.views[row], images) for row in needed}

    def depth_of(row: int) -> NDArray[np.float32]:
        view = scene.views[row]
        depth = (view.to_camera(scene.points[view.point_index]))[:, 2]
        near, far = np.quantile(depth[depth > 0], DEPTH_QUANTILES)
        nearest, furthest = DEPTH_MARGINS[0] * float(near), DEPTH_MARGINS[1] * float(far)
        return fill_planes(
            swept_depth(views[row], [views[k] for k in sources[row]], nearest, furthest), views[row].grey
        )

    depths: dict[int, NDArray[np.float32]] = {}
    with ThreadPoolExecutor(N_THREADS) as pool:
        for done, (row, depth) in enumerate(zip(chosen, pool.map(depth_of, chosen), strict=True)):
            depths[row] = depth
            progress(done + 1, len(chosen))
    points, colours, seen = fuse_views(views, depths)
    if len(points):
        record = [(axis, "<f4") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
        vertices = np.empty(len(points), dtype=record)
        for column, values in zip(vertices.dtype.names or (), (*points.T, *colours.T), strict=True):
            vertices[column] = values
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        header += "".join(f"property {'float' if kind == '<f4' else 'uchar'} {name}\n" for name, kind in record)
        file.write_bytes(header.encode() + b"end_header\n" + vertices.tobytes())
        offsets = np.concatenate([[0], np.cumsum(seen.sum(axis=1))]).astype(np.int64)
        visible = np.array(sorted(depths))[np.nonzero(seen)[1]]
        file.with_name(f"{file.name}.vis").write_bytes(visibility_bytes(offsets, visible))
    return len(points)


def _sources(scene: Scene, row: int, common: IntArray) -> list[int]:
    """Return the views to compare with a view: many common points (v, v), and an angle that determines depth."""
    view = scene.views[row]
    centre = np.median(scene.points[view.point_index], axis=0)
    rays = np.array([centre - other.centre for other in scene.views])
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    angle = np.degrees(np.arccos(np.clip(rays @ rays[row], -1, 1)))
    score = common[row] * np.exp(-(((angle - BEST_ANGLE_DEG) / ANGLE_SPREAD_DEG) ** 2))
    score[row] = -1
    return [int(other) for other in np.argsort(-score, kind="stable")[:N_SOURCES]]


def fuse_views(
    views: dict[int, PinholeView], depths: dict[int, NDArray[np.float32]]
) -> tuple[FloatArray, NDArray[np.uint8], BoolArray]:
    """Return points (n, 3), colours (n, 3) and which of the views with depth see them (n, v); each surface once."""
    rows = sorted(depths)
    taken: dict[int, BoolArray] = {row: np.zeros(depths[row].shape, dtype=bool) for row in rows}
    points, colours, seen = [], [], []
    for position, row in enumerate(rows):
        view = views[row]
        ys, xs = np.nonzero(np.isfinite(depths[row]) & ~taken[row])
        keep = (ys % STRIDE == 0) & (xs % STRIDE == 0)
        ys, xs = ys[keep], xs[keep]
        rays = np.column_stack([xs, ys, np.ones(len(xs))]) @ np.linalg.inv(view.matrix).T
        world = (rays * depths[row][ys, xs][:, None].astype(np.float64) - view.translation) @ view.rotation
        sees = np.zeros((len(world), len(rows)), dtype=bool)
        sees[:, position] = True
        cells = {}
        for other_position, other in enumerate(rows):
            if other != row:
                sees[:, other_position], cells[other] = _agreeing(views[other], depths[other], world)
        good = sees.sum(axis=1) > MIN_AGREEING
        for other_position, other in enumerate(rows):
            if other != row:  # mark the pixels of the points, and their neighbours that the stride skips
                x, y = cells[other][good & sees[:, other_position]].T
                marked = np.zeros(taken[other].shape, np.uint8)
                marked[y, x] = 1
                taken[other] |= cv2.dilate(marked, np.ones((2 * (STRIDE // 2) + 1,) * 2, np.uint8)) > 0
        points.append(world[good])
        colours.append(view.colour[ys[good], xs[good]])
        seen.append(sees[good])
    return np.concatenate(points), np.concatenate(colours), np.concatenate(seen)


def _agreeing(view: PinholeView, depth: NDArray[np.float32], world: FloatArray) -> tuple[BoolArray, IntArray]:
    """Return whether the depth of a view agrees with points (n, 3), as (n,), and their pixels (n, 2) as x, y."""
    local = world @ view.rotation.T + view.translation
    height, width = depth.shape
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (local / local[:, 2:]) @ view.matrix.T
    ahead = (local[:, 2] > 0) & (np.abs(pixels) < 1e6).all(axis=1)
    cells = np.rint(np.where(ahead[:, None], pixels[:, :2], -1)).astype(np.int64)
    inside = ahead & (cells >= 0).all(axis=1) & (cells < (width, height)).all(axis=1)
    cells[~inside] = 0
    measured = depth[cells[:, 1], cells[:, 0]]
    with np.errstate(invalid="ignore"):
        return inside & (np.abs(measured / local[:, 2] - 1) < MAX_DIFFERENCE), cells
