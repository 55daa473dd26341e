"""Metric scale of a reconstruction from the sizes of the objects in it.

>>> import estimator
>>> scene = estimator.read_scene("data/scenes/demo_room")
>>> instances = estimator.read_instances("data/scenes/demo_room/instances.json", scene)
>>> result = estimator.estimate_scale(scene, instances)
>>> result.status
'resolved'

A scene is in units of unknown metric size; `result.scale` is metres per unit. Nothing of it needs a file on disk:
`read_scene` also takes a `pycolmap.Reconstruction`, and `read_instances` masks as arrays.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from capture.mapping.refusals import CaptureFailure
    from capture.pipeline import Capture, capture_video
    from estimator.instances.instance_reader import read_instances
    from estimator.pipeline import estimate_scale, measure_objects
    from estimator.reconstructions.scene_reader import read_scene
    from estimator.records.objects import MeasuredObject
    from estimator.records.result import ScaleResult
    from estimator.records.scene import Camera, Instance, Scene, View
    from estimator.results.estimate import scale_of_objects
    from models3d.size_check.check import AssetCheck, check_asset

__all__ = [
    "AssetCheck",
    "Camera",
    "Capture",
    "CaptureFailure",
    "Instance",
    "MeasuredObject",
    "ScaleResult",
    "Scene",
    "View",
    "capture_video",
    "check_asset",
    "estimate_scale",
    "measure_objects",
    "read_instances",
    "read_scene",
    "scale_of_objects",
]

#: The module of each name; it is imported when the name is first used, so that light commands stay light.
_HOMES = {
    "AssetCheck": "models3d.size_check.check",
    "Camera": "estimator.records.scene",
    "Capture": "capture.pipeline",
    "CaptureFailure": "capture.mapping.failures",
    "Instance": "estimator.records.scene",
    "MeasuredObject": "estimator.records.objects",
    "ScaleResult": "estimator.records.result",
    "Scene": "estimator.records.scene",
    "View": "estimator.records.scene",
    "check_asset": "models3d.size_check.check",
    "capture_video": "capture.pipeline",
    "estimate_scale": "estimator.pipeline",
    "measure_objects": "estimator.pipeline",
    "read_instances": "estimator.reconstructions.scene_reader",
    "read_scene": "estimator.reconstructions.scene_reader",
    "scale_of_objects": "estimator.results.estimate",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'estimator' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
