"""What a view in three dimensions shows of an estimate: points, cameras, boxes with sizes, support planes, up.

The frame is glTF's: y is up, lengths are in metres where a scale is known, else in scene units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.outputs.size_labels import dimension_labels
from estimator.records.objects import Box, MeasuredObject, SupportPlane, corners
from estimator.records.result import ObjectReport, ScaleResult, SceneEstimate
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray, IntArray

#: Red, green and blue, 0 to 255, by verdict, and of what is no object.
COLOURS: Mapping[str, tuple[int, int, int]] = {
    "used": (11, 126, 110),
    "outlier": (200, 70, 20),
    "skipped": (130, 130, 140),
    "point": (95, 105, 110),
    "camera": (42, 110, 180),
    "plane": (180, 150, 60),
    "up": (120, 60, 170),
}

#: Points that are shown at most: a file of a megabyte, which a telephone turns without a jerk.
MOST_POINTS = 60_000

#: A camera's pyramid is as deep as this part of the scene's size.
CAMERA_SHARE = 0.04

#: The arrow of up is as long as this part of the scene's size.
UP_SHARE = 0.25

#: Share of the points at either end of an axis that do not count for the scene's size: stray points are far away.
STRAY = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class BoxView:
    """A box: corners (8, 3) in the order of `box_edges.corners`, name and sizes; `said` is what a click on it says."""

    id: str
    verdict: str
    corners: FloatArray
    title: str
    sizes: str
    said: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """What is shown. Lines are pairs of ends (n, 2, 3); planes are quadrilaterals (4, 3), in turn around.

    points : (n, 3); point_colours : (n, 3) 0 to 255; unit : `m`, or `units` where no scale is known; headline : the
    result in a line.
    """

    points: FloatArray
    point_colours: IntArray
    cameras: FloatArray
    boxes: tuple[BoxView, ...]
    planes: tuple[FloatArray, ...]
    up: FloatArray
    unit: str
    headline: str

    def bounds(self) -> FloatArray:
        """(2, 3) lowest and highest corner of what is shown, without stray points."""
        parts = [box.corners for box in self.boxes] + [self.cameras.reshape(-1, 3)]
        if len(self.points):
            parts.append(np.quantile(self.points, [STRAY, 1 - STRAY], axis=0))
        everything = np.concatenate(parts) if parts else np.zeros((0, 3))
        if not len(everything):
            return np.array([[-1.0] * 3, [1.0] * 3])
        return np.stack([everything.min(axis=0), everything.max(axis=0)])


def scene_view(estimate: SceneEstimate) -> SceneView:
    """What is shown of an estimate; one that measured no object has points and cameras alone."""
    result, scene, measured = estimate.result, estimate.scene, estimate.measurements
    scale = result.best_scale or 1.0
    turn = _upright(result) * scale
    reports = {report.id: report for report in result.objects}
    objects = [item for item in measured.objects if item.box is not None] if measured else []
    cloud = scene.dense.points if scene.dense is not None else scene.points
    rows, verdicts = _shown_points(scene, objects, reports, len(cloud))
    points = cloud[rows] @ turn.T
    size = _size(points, [view.centre @ turn.T for view in scene.views])
    planes = tuple(_quadrilateral(plane) @ turn.T for plane in measured.planes) if measured else ()
    low = np.quantile(points, STRAY, axis=0) if len(points) else np.zeros(3)
    return SceneView(
        points=points,
        point_colours=np.array([COLOURS[name] for name in verdicts], dtype=np.int64).reshape(-1, 3),
        cameras=np.concatenate([_pyramid(view, size * CAMERA_SHARE / scale) for view in scene.views]) @ turn.T,
        boxes=tuple(_box(item, item.box, reports[item.id], result, turn) for item in objects if item.box is not None),
        planes=planes,
        up=np.stack([low, low + np.array([0, size * UP_SHARE, 0])])[None],
        unit="m" if result.best_scale else "units",
        headline=_headline(result),
    )


def box_on_ray(view: SceneView, origin: FloatArray, direction: FloatArray) -> BoxView | None:
    """The box that a ray meets first; None if it meets none.

    origin, direction : (3,) in the frame of the view; of boxes that hold one another the inner one is met where the ray
    enters both from outside at the same place only.
    """
    nearest: tuple[float, BoxView] | None = None
    for box in view.boxes:
        centre, axes = box.corners.mean(axis=0), box.corners[[1, 2, 4]] - box.corners[0]  # rows: whole edges
        halves = np.linalg.norm(axes, axis=1) / 2
        units = axes / np.maximum(2 * halves, 1e-12)[:, None]
        start, along = units @ (origin - centre), units @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-halves - start) / along, (halves - start) / along])
        enter, leave = np.nanmax(ends.min(axis=0)), np.nanmin(ends.max(axis=0))
        if enter <= leave and leave > 0 and (nearest is None or enter < nearest[0]):
            nearest = float(enter), box
    return None if nearest is None else nearest[1]


def _upright(result: ScaleResult) -> FloatArray:
    """(3, 3) rotation that takes the scene's up to +y; of a scene without one the cameras' -y."""
    up = np.array(result.up.vector if result.up is not None else (0.0, -1.0, 0.0))
    up = up / np.linalg.norm(up)
    seed = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 0, 1.0])
    right = seed - (seed @ up) * up
    right /= np.linalg.norm(right)
    return np.stack([right, up, np.cross(right, up)])


def _size(points: FloatArray, centres: list[FloatArray]) -> float:
    """The diagonal of the scene without its stray points, of points (n, 3) and of the cameras' centres, each (3,)."""
    parts = [np.quantile(points, [STRAY, 1 - STRAY], axis=0)] if len(points) else []
    places = np.concatenate([*parts, np.array(centres).reshape(-1, 3)])
    return float(np.linalg.norm(np.ptp(places, axis=0))) or 1.0 if len(places) else 1.0


def _shown_points(
    scene: Scene, objects: list[MeasuredObject], reports: Mapping[str, ObjectReport], count: int
) -> tuple[IntArray, list[str]]:
    """Rows (m,) of the cloud that are shown, spread evenly, and what each is of: a verdict, or `point`."""
    names = np.full(count, "point", dtype=object)
    shown = "dense" if scene.dense is not None else "sparse"
    for item in objects:
        if item.point_rows is not None and item.cloud == shown:
            names[item.point_rows] = reports[item.id].verdict
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(np.int64)) if count else np.zeros(0, int)
    return rows, names[rows].tolist()


def _pyramid(view: View, depth: float) -> FloatArray:
    """(8, 2, 3) lines of a camera: from its centre to the picture's corners, and around these."""
    camera = view.camera
    focal = float(camera.params[0])
    half = np.array([camera.width, camera.height]) / (2 * focal) * depth
    corners_camera = np.array([[x * half[0], y * half[1], depth] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    ends = (corners_camera - view.translation) @ view.rotation
    return np.array([[view.centre, end] for end in ends] + [[ends[k], ends[(k + 1) % 4]] for k in range(4)])


def _quadrilateral(plane: SupportPlane) -> FloatArray:
    """(4, 3) corners in the scene of the rectangle in which a level surface was seen."""
    seen = np.argwhere(plane.cells)
    low, high = seen.min(axis=0), seen.max(axis=0) + 1
    ends = plane.origin + np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]) * (
        plane.cell
    )
    return np.column_stack([ends, np.full(4, plane.height)]) @ plane.basis


def _box(item: MeasuredObject, box: Box, report: ObjectReport, result: ScaleResult, turn: FloatArray) -> BoxView:
    """The box of an object; turn : (3, 3) from the scene's frame to the view's."""
    labels = dimension_labels(item, report, result, {})
    marks = [">" if short else "" for short in item.truncated]
    extents = [f"{mark}{size:.2f}" for mark, size in zip(marks, item.extents * (result.best_scale or 1), strict=True)]
    said = {
        "id": report.id,
        "category": report.category,
        "node": report.node,
        "tier": report.tier,
        "verdict": report.verdict,
        "reason": report.reason,
        "used": list(report.used),
        "weight": round(report.weight, 3),
        "sizes": [label.text for label in labels],
    }
    known = [text for text, size in zip(extents, item.extents, strict=True) if np.isfinite(size)]
    sizes = " x ".join(known) + (" m" if result.best_scale else " units")
    return BoxView(report.id, report.verdict, corners(box) @ turn.T, f"{report.category} {report.id}", sizes, said)


def _headline(result: ScaleResult) -> str:
    if result.scale is None or result.interval is None:
        return "unresolved" + ("; sizes are those of the likeliest scale" if result.best_scale else "")
    low, high = result.interval.low, result.interval.high
    interval = f"{100 * result.interval.level:g} % {low:.4g} to {high:.4g}"
    return f"{result.status}: {result.scale:.4g} metres per unit, {interval}"
