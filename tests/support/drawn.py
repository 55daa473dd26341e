"""A hand-written estimate of the small scene, for tests of figures and overlays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.instances.instance_reader import read_instances
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.objects import Box, MeasuredObject, Measurements, Up
from estimator.records.result import Curve, Interval, Mode, ObjectReport, ScaleResult, SceneEstimate, UpReport, Verdict

__all__ = ["SCALE", "drawn_estimate"]

SCALE = 0.5
_LOG_SCALE = np.linspace(np.log(0.2), np.log(1.2), 400)
#: category, verdict, implied scale, used dimensions, truncated axes
_OBJECTS: tuple[tuple[str, Verdict, float, tuple[str, ...], tuple[bool, bool, bool]], ...] = (
    ("chair", "used", 0.48, ("length", "height"), (False, True, False)),
    ("table", "outlier", 0.9, ("length", "width", "height"), (False, False, False)),
)


def bump(centre: float, width: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * ((_LOG_SCALE - np.log(centre)) / width) ** 2))


def drawn_estimate(folder: Path) -> SceneEstimate:
    """Return an estimate with two boxes in the small COLMAP scene of `folder`: a used chair and a table as outlier."""
    scene = read_scene(folder)
    instances = read_instances(None, scene)
    objects, reports = [], []
    for row, (category, verdict, scale, used, cut) in enumerate(_OBJECTS):
        extents = np.array([0.6, 0.4, 0.8]) / (row + 1)
        members = tuple(index for index, instance in enumerate(instances) if instance.category == category)
        box = Box(np.array([0.2 * row, 0.0, 0.0]), np.eye(3), extents)
        name = str(row + 1)
        sigma = np.array([0.05, np.nan, 0.1])
        objects.append(
            MeasuredObject(name, category, extents, sigma, truncated=np.array(cut), box=box, members=members, points=99)
        )
        sizes = dict(zip(("length", "width", "height"), extents.tolist(), strict=True))
        truncated = tuple(axis for axis, is_cut in zip(sizes, cut, strict=True) if is_cut)
        reports.append(
            ObjectReport(name, category, f"{category}.n.01", 99, sizes, {}, truncated, used, scale, 0.9, verdict, None)
        )
    result = ScaleResult(
        status="resolved",
        method="default",
        scale=SCALE,
        interval=Interval(0.9, 0.4, 0.6),
        modes=(Mode(SCALE, 0.95), Mode(0.9, 0.05)),
        tree=("test", "0"),
        objects=tuple(reports),
        up=UpReport((0.0, 0.0, 1.0), "by hand", 1.0),
        curve=Curve(_LOG_SCALE, bump(SCALE, 0.1), 0.0, 0.0),
        object_curves={report.id: 0.1 + bump(report.scale or 1.0, 0.2) for report in reports},
    )
    up = Up(np.array([0.0, 0.0, 1.0]), "by hand", 1.0)
    return SceneEstimate(result, scene, instances, Measurements(tuple(objects), up, (), ()))
