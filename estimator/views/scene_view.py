"""Content of a 3-D view of an estimate: points, cameras, boxes with sizes, support planes and the vertical.

The frame is that of glTF, with y up. Lengths are in metres if a scale is known, otherwise in scene units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.geometry.planes import level_basis
from estimator.outputs.size_labels import dimension_labels
from estimator.records.objects import Box, MeasuredObject, corners
from estimator.records.result import ObjectReport, ScaleResult, SceneEstimate
from metric_base.arrays import FloatArray, IntArray

#: Red, green and blue, 0 to 255, of boxes and points by verdict, and of other elements.
COLOURS: Mapping[str, tuple[int, int, int]] = {
    "used": (11, 126, 110),
    "outlier": (200, 70, 20),
    "skipped": (130, 130, 140),
    "point": (95, 105, 110),
    "camera": (42, 110, 180),
    "plane": (180, 150, 60),
    "up": (120, 60, 170),
}

#: Maximum number of points: a file of a megabyte, which phones rotate smoothly.
MAX_POINTS = 60_000

#: Depth of the pyramid of a camera, relative to the diagonal of the scene.
CAMERA_FRACTION = 0.04

#: Length of the arrow of the vertical, relative to the diagonal of the scene.
UP_FRACTION = 0.25

#: Fraction of the points at each end of an axis that is ignored for the extent of the scene, because of outliers.
OUTLIER_FRACTION = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class BoxView:
    """The box of an object."""

    id: str
    verdict: str
    #: (8, 3) in the order of `estimator.records.objects.corners`.
    corners: FloatArray
    title: str
    sizes: str
    #: Report of the object, shown after a click on the box.
    report: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """Content of a view."""

    #: (n, 3)
    points: FloatArray
    #: (n, 3) from 0 to 255.
    point_colours: IntArray
    #: (k, 2, 3) ends of lines.
    cameras: FloatArray
    boxes: tuple[BoxView, ...]
    #: Consecutive corners (4, 3) of each plane.
    planes: tuple[FloatArray, ...]
    #: (1, 2, 3) ends of the arrow of the vertical.
    up: FloatArray
    #: `m`, or `units` if no scale is known.
    unit: str
    #: The result in one line.
    headline: str

    def bounds(self) -> FloatArray:
        """Return the lowest and the highest corner (2, 3) of the content, without outliers of the points."""
        parts = [box.corners for box in self.boxes] + [self.cameras.reshape(-1, 3)]
        if len(self.points):
            parts.append(np.quantile(self.points, [OUTLIER_FRACTION, 1 - OUTLIER_FRACTION], axis=0))
        content = np.concatenate(parts) if parts else np.zeros((0, 3))
        if not len(content):
            return np.array([[-1.0] * 3, [1.0] * 3])
        return np.stack([content.min(axis=0), content.max(axis=0)])


def scene_view(estimate: SceneEstimate) -> SceneView:
    """Return the view of an estimate; without measured objects, it contains points and cameras."""
    result, scene, measured = estimate.result, estimate.scene, estimate.measurements
    scale = result.best_scale or 1.0
    # Rotation of the scene to y up, and its scale.
    up = np.array(result.up.vector if result.up is not None else (0.0, -1.0, 0.0))
    basis = level_basis(up / np.linalg.norm(up))
    rotation = np.stack([basis[0], basis[2], -basis[1]]) * scale
    reports = {report.id: report for report in result.objects}
    objects = [item for item in measured.objects if item.box is not None] if measured else []

    # A regular sample of the cloud, coloured by the verdicts of the objects.
    cloud, cloud_name = (scene.points, "sparse") if scene.dense is None else (scene.dense.points, "dense")
    count = len(cloud)
    names = np.full(count, "point", dtype=object)
    for item in objects:
        if item.point_rows is not None and item.cloud == cloud_name:
            names[item.point_rows] = reports[item.id].verdict
    rows = np.unique(np.linspace(0, count - 1, min(count, MAX_POINTS)).astype(np.int64)) if count else np.zeros(0, int)
    points = cloud[rows] @ rotation.T
    colours = np.array([COLOURS[name] for name in names[rows].tolist()], dtype=np.int64).reshape(-1, 3)

    # The diagonal of the scene, of the points without outliers and of the cameras.
    inner = [np.quantile(points, [OUTLIER_FRACTION, 1 - OUTLIER_FRACTION], axis=0)] if count else []
    positions = np.concatenate([*inner, np.array([view.centre @ rotation.T for view in scene.views]).reshape(-1, 3)])
    diagonal = float(np.linalg.norm(np.ptp(positions, axis=0))) or 1.0 if len(positions) else 1.0

    # Lines (8, 2, 3) from each camera centre to the corners of its image plane, and around them.
    pyramids = []
    for view in scene.views:
        depth = diagonal * CAMERA_FRACTION / scale
        half = np.array([view.camera.width, view.camera.height]) / (2 * view.camera.focal_px) * depth
        plane_corners = np.array([[x * half[0], y * half[1], depth] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        ends = (plane_corners - view.translation) @ view.rotation
        pyramids.append([[view.centre, end] for end in ends] + [[ends[k], ends[(k + 1) % 4]] for k in range(4)])

    # The rectangle around the observed cells of each plane.
    planes = []
    for plane in measured.planes if measured else ():
        observed = np.argwhere(plane.cells)
        (left, bottom), (right, top) = observed.min(axis=0), observed.max(axis=0) + 1
        ends = plane.origin + np.array([[left, bottom], [right, bottom], [right, top], [left, top]]) * plane.cell
        planes.append(np.column_stack([ends, np.full(4, plane.height)]) @ plane.basis @ rotation.T)

    headline = "unresolved" + ("; sizes are those of the likeliest scale" if result.best_scale else "")
    if result.scale is not None and result.interval is not None:
        interval = f"{100 * result.interval.level:g} % {result.interval.low:.4g} to {result.interval.high:.4g}"
        headline = f"{result.status}: {result.scale:.4g} metres per unit, {interval}"
    low = np.quantile(points, OUTLIER_FRACTION, axis=0) if count else np.zeros(3)
    return SceneView(
        points=points,
        point_colours=colours,
        cameras=np.concatenate([np.array(lines) for lines in pyramids]) @ rotation.T,
        boxes=tuple(
            _box_view(item, item.box, reports[item.id], result, rotation) for item in objects if item.box is not None
        ),
        planes=tuple(planes),
        up=np.stack([low, low + np.array([0, diagonal * UP_FRACTION, 0])])[None],
        unit="m" if result.best_scale else "units",
        headline=headline,
    )


def box_on_ray(view: SceneView, origin: FloatArray, direction: FloatArray) -> BoxView | None:
    """Return the first box on a ray, or None.

    Parameters
    ----------
    view : SceneView
    origin, direction : (3,) ndarray of float
        In the frame of the view.
    """
    nearest: tuple[float, BoxView] | None = None
    for box in view.boxes:
        centre, edges = box.corners.mean(axis=0), box.corners[[1, 2, 4]] - box.corners[0]
        halves = np.linalg.norm(edges, axis=1) / 2
        axes = edges / np.maximum(2 * halves, 1e-12)[:, None]
        start, along = axes @ (origin - centre), axes @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-halves - start) / along, (halves - start) / along])
        enter, leave = np.nanmax(ends.min(axis=0)), np.nanmin(ends.max(axis=0))
        if enter <= leave and leave > 0 and (nearest is None or enter < nearest[0]):
            nearest = float(enter), box
    return None if nearest is None else nearest[1]


def _box_view(
    item: MeasuredObject, box: Box, report: ObjectReport, result: ScaleResult, rotation: FloatArray
) -> BoxView:
    """Return the box of an object; `rotation` (3, 3) rotates the frame of the scene to the frame of the view."""
    labels = dimension_labels(item, report, result, {})
    marks = [">" if is_truncated else "" for is_truncated in item.truncated]
    extents = [f"{mark}{size:.2f}" for mark, size in zip(marks, item.extents * (result.best_scale or 1), strict=True)]
    record = {name: getattr(report, name) for name in ("id", "category", "node", "tier", "verdict", "reason")}
    record |= {"used": list(report.used), "weight": round(report.weight, 3), "sizes": [label.text for label in labels]}
    known = [text for text, size in zip(extents, item.extents, strict=True) if np.isfinite(size)]
    sizes = " x ".join(known) + (" m" if result.best_scale else " units")
    title = f"{report.category} {report.id}"
    return BoxView(report.id, report.verdict, corners(box) @ rotation.T, title, sizes, record)
