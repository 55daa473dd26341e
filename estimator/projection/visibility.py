"""Determine which points of a cloud each view sees, and where they project.

Three sources, in this order of preference:

1. A sparse point is visible in the views that observed it.
2. A dense point is visible in the views of its visibility list (COLMAP's `fused.ply.vis`).
3. Otherwise, a depth buffer of the cloud itself decides: a point is visible if it is close to the nearest point of its
   cell (`project_unoccluded`).

`DepthImages` returns the nearest depths around an object, for the test whether something occludes its sides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from estimator.projection.cameras import PINHOLES, project
from estimator.records.scene import Camera, DenseCloud, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray, evenly_spaced

#: Weight of a rotation by one radian in the distance between two views, relative to a translation by the extent of all
#: cameras.
ROTATION_WEIGHT = 1.0
#: Expected number of points of a surface in a cell of the depth buffer. A point behind the surface is not occluded in
#: an empty cell; with 8 expected points, one cell in 3,000 is empty (Poisson).
EXPECTED_POINTS_PER_CELL = 8
#: Minimum and maximum number of cells along the longer image side. With fewer than 24 cells, an object covers a cell or
#: two; with more than 320, a cell is less than two pixels of a small video frame, which is finer than the spacing of
#: dense clouds.
CELLS_PER_SIDE_RANGE = (24, 320)
#: Maximum relative depth difference between a visible point and the nearest point of its cell. Surfaces at 20 degrees
#: to the line of sight change their depth by about this much within a cell.
DEPTH_TOLERANCE = 0.03
#: Cotangent of the smallest angle (20 degrees) between the line of sight and a surface whose points in one cell do not
#: occlude each other. The cells of a cloud of a few thousand points are so coarse that the near side of an object would
#: otherwise occlude its far side.
MAX_SLANT_COTANGENT = 2.75
#: Number of cells of a depth image along the image width. Empty cells are treated as empty space.
DEPTH_IMAGE_WIDTH = 160
#: Number of points that are projected at once; their coordinates fit into the cache of a processor core.
BLOCK_POINTS = 8192
#: Maximum number of points that are drawn into a depth image.
MAX_DEPTH_POINTS = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedPoints:
    """Points of a cloud that project into one view."""

    #: (k,) rows of the cloud.
    rows: IntArray
    #: (k, 2) positions in pixels.
    pixels: FloatArray
    #: (k,) depths in scene units.
    depths: FloatArray

    @classmethod
    def from_observations(cls, view: View, points: FloatArray) -> ProjectedPoints:
        """Return the points (n, 3) that the view observed, at their keypoints."""
        rows = view.point_index
        return cls(rows, view.keypoints, points[rows] @ view.rotation[2] + view.translation[2])

    def take_points(self, selection: BoolArray | IntArray) -> ProjectedPoints:
        """Return the selected points; `selection` is a mask (k,) or indices."""
        return ProjectedPoints(self.rows[selection], self.pixels[selection], self.depths[selection])


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Points of a cloud that each view of a scene is known to see."""

    #: For each view, the rows (m,) of the cloud that it sees.
    rows: tuple[IntArray, ...]
    #: (v, 3) camera centres.
    centres: FloatArray
    #: (v, 3) optical axes.
    axes: FloatArray
    #: True if points that are not listed are not visible. The lists of a dense cloud are complete; the observations
    #: of sparse points are not.
    complete: bool

    def nearest(self, view: View) -> IntArray:
        """Return the rows (m,) of the view of the scene whose camera is most similar to this one."""
        extent = max(float(np.ptp(self.centres, axis=0).max()), 1e-12)
        angles = np.arccos(np.clip(self.axes @ view.rotation[2], -1, 1))
        distances = np.linalg.norm(self.centres - view.centre, axis=1) / extent
        return self.rows[int(np.argmin(distances + ROTATION_WEIGHT * angles))]

    def of_points(self, keep: BoolArray) -> Visibility:
        """Return the visibility of a subset of the points; `keep` is a mask (n,), and rows are renumbered."""
        new_index = np.cumsum(keep) - 1
        rows = tuple(new_index[visible[keep[visible]]] for visible in self.rows)
        return Visibility(rows, self.centres, self.axes, self.complete)


def scene_visibility(scene: Scene, step: int = 1) -> Visibility | None:
    """Return the visibility of the sparse points, followed by every `step`-th dense point.

    Returns None if it is unknown: the dense cloud has no lists, or, without a dense cloud, a view has no observations.
    """
    sparse = tuple(np.unique(view.point_index) for view in scene.views)
    rows: tuple[IntArray, ...] = sparse
    if scene.dense is not None:
        listed = points_by_view(scene.dense, len(scene.views), step)
        if listed is None:
            return None
        rows = tuple(
            np.unique(np.concatenate([observed, dense + len(scene.points)]))
            for observed, dense in zip(sparse, listed, strict=True)
        )
    elif not rows or not all(map(len, rows)):
        return None
    centres, axes = ([view.centre for view in scene.views], [view.rotation[2] for view in scene.views])
    return Visibility(rows, np.array(centres), np.array(axes), scene.dense is not None)


def points_by_view(cloud: DenseCloud, n_views: int, step: int = 1) -> list[IntArray] | None:
    """Return, for each view, the rows (k,) of every `step`-th point that it sees; None if the cloud has no lists."""
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return None
    point_indices: IntArray = np.arange(len(cloud.points), dtype=np.int32)
    rows = np.repeat(point_indices, np.diff(cloud.visible_offsets))
    views = cloud.visible_views
    if step > 1:
        keep = rows % step == 0
        rows, views = rows[keep] // step, views[keep]
    if n_views <= 2**16:  # NumPy sorts 16-bit integers by radix, which is faster
        views = views.astype(np.uint16)
    order = np.argsort(views, kind="stable")
    ends = np.searchsorted(views[order], np.arange(n_views + 1))
    return [rows[order[start:end]] for start, end in pairwise(ends)]


def project_to_view(view: View, points: FloatArray) -> ProjectedPoints:
    """Return the points (n, 3) that project into the image, without an occlusion test."""
    starts = range(0, max(len(points), 1), BLOCK_POINTS)
    blocks = [_project_block(view, points[start : start + BLOCK_POINTS], start) for start in starts]
    pixels = np.concatenate([block.pixels.T for block in blocks], axis=1).T
    return ProjectedPoints(
        np.concatenate([block.rows for block in blocks]), pixels, np.concatenate([block.depths for block in blocks])
    )


def _project_block(view: View, points: FloatArray, first: int) -> ProjectedPoints:
    """Return the points (n, 3) that project into the image; their rows start at `first`."""
    # (3, n); einsum, because the threads of BLAS would wait for one another in a product with three rows
    local = np.einsum("ij,jn->in", view.rotation, points.T) + view.translation[:, None]
    # Points outside the frustum are dropped before the projection. Lenses with distortion have no simple frustum.
    camera = view.camera
    if camera.model in PINHOLES:
        *focal, centre_x, centre_y = camera.params
        # Tangents of the wider half of the image, with a margin for rounding.
        x_tangent = (1 + 1e-9) * max(abs(centre_x), abs(camera.width - centre_x)) / focal[0]
        y_tangent = (1 + 1e-9) * max(abs(centre_y), abs(camera.height - centre_y)) / focal[-1]
        in_frustum = (np.abs(local[0]) <= x_tangent * local[2]) & (np.abs(local[1]) <= y_tangent * local[2])
    else:
        in_frustum = local[2] > 0
    rows = np.flatnonzero(in_frustum)
    local = local.take(rows, axis=1)
    pixels = project(camera, local.T)
    x, y = pixels.T
    # Pixels behind the camera and beyond the field of view are NaN, and NaN is not inside.
    inside = np.flatnonzero((x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height))
    return ProjectedPoints(first + rows[inside], pixels.T.take(inside, axis=1).T, local[2].take(inside))


def indicator_matrix(rows: Sequence[IntArray], count: int) -> csr_array:
    """Return the sparse matrix (r, count) with ones in the listed columns (k,) of each of the r rows."""
    lengths = np.fromiter((len(columns) for columns in rows), dtype=np.int64, count=len(rows))
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    indices = np.concatenate([*rows, np.empty(0, dtype=np.int32)]).astype(np.int32, copy=False)
    if indptr[-1] < 2**31:
        indptr = indptr.astype(np.int32)
    return csr_array((np.ones(indices.size, dtype=np.float32), indices, indptr), shape=(len(rows), count))


def row_indices(matrix: csr_array, row: int) -> IntArray:
    """Return the columns (k,) that are set in one row of an `indicator_matrix`."""
    return np.asarray(matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]])


def project_unoccluded(view: View, points: FloatArray, slant: float = 0.0) -> ProjectedPoints:
    """Project the points that a depth buffer of the same points does not occlude.

    Parameters
    ----------
    view : View
    points : (n, 3) ndarray of float
        Cloud, in world coordinates.
    slant : float, default 0
        Cotangent of the angle between line of sight and surface up to which one surface may fill a cell.

    Returns
    -------
    ProjectedPoints
        Points within `DEPTH_TOLERANCE` of the smallest depth of their cell, or within the depth difference of a
        surface with this slant. The cell size follows from the number of points (`EXPECTED_POINTS_PER_CELL`).
    """
    projected = project_to_view(view, points)
    return projected.take_points(np.flatnonzero(is_unoccluded(view.camera, projected, slant)))


def is_unoccluded(camera: Camera, projected: ProjectedPoints, slant: float = 0.0) -> BoolArray:
    """Return whether each projected point (k,) is not occluded by the others; see `project_unoccluded`."""
    if projected.rows.size == 0:
        return np.ones(0, dtype=bool)
    side = max(camera.width, camera.height)
    wanted = np.sqrt(camera.width * camera.height * EXPECTED_POINTS_PER_CELL / projected.rows.size)
    cell = float(np.clip(wanted, side / CELLS_PER_SIDE_RANGE[1], side / CELLS_PER_SIDE_RANGE[0]))
    cells_per_row = int(camera.width // cell) + 1
    columns, rows = (projected.pixels.T * (1 / cell)).astype(np.int64)
    cells = rows * cells_per_row + columns
    # With 32-bit floats, the loop below takes a twentieth of the time.
    depths = projected.depths.astype(np.float32)
    nearest = np.full(int(cells.max()) + 1, np.inf, dtype=np.float32)
    np.minimum.at(nearest, cells, depths)
    # The first parameter of all camera models is a focal length in pixels.
    tolerance = max(DEPTH_TOLERANCE, slant * cell / camera.focal_px)
    return np.asarray(depths <= nearest[cells] * np.float32(1 + tolerance))


def infer_observations(views: Iterable[View], points: FloatArray) -> tuple[View, ...]:
    """Return views without observations with the unoccluded points (n, 3) as their observations."""
    projections = ((view, project_unoccluded(view, points, MAX_SLANT_COTANGENT)) for view in views)
    return tuple(
        replace(view, keypoints=projected.pixels, point_index=projected.rows) for view, projected in projections
    )


@dataclass(slots=True, eq=False)
class DepthImages:
    """Coarse depth images of the cloud around an object, one per view, computed on demand."""

    scene: Scene
    #: (n, 3) cloud of the scene.
    points: FloatArray
    #: (v, n) sparse, 1 if the view sees the point.
    visibility: csr_array
    #: (3,) unit vector.
    up: FloatArray
    _images: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    def depths_and_heights(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depth and height (k,) of the nearest point at each pixel (k, 2), in scene units.

        The depth is infinite, and the height 0, where the image has no point.
        """
        if view not in self._images:
            source, visible = self.scene.views[view], row_indices(self.visibility, view)
            points = self.points[evenly_spaced(visible, MAX_DEPTH_POINTS)]
            n_rows = int(source.camera.height * DEPTH_IMAGE_WIDTH / source.camera.width) + 1
            depth, height = np.full((n_rows, DEPTH_IMAGE_WIDTH), np.inf), np.zeros((n_rows, DEPTH_IMAGE_WIDTH))
            projected = project_to_view(source, points)
            # The farthest point is written first, so that the nearest one remains.
            projected = projected.take_points(np.argsort(-projected.depths))
            cells = (projected.pixels * (DEPTH_IMAGE_WIDTH / source.camera.width)).astype(np.int64)
            depth[cells[:, 1], cells[:, 0]] = projected.depths
            height[cells[:, 1], cells[:, 0]] = points[projected.rows] @ self.up
            self._images[view] = depth, height
        depth, height = self._images[view]
        camera = self.scene.views[view].camera
        index = np.floor(pixels * (DEPTH_IMAGE_WIDTH / camera.width)).astype(np.int64)
        inside = np.all((index >= 0) & (index < depth.shape[::-1]), axis=1)
        columns, rows = np.where(inside[:, None], index, 0).T
        return np.where(inside, depth[rows, columns], np.inf), height[rows, columns]
