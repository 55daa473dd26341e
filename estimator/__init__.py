"""Estimate the metric scale of a reconstruction from the sizes of its objects.

>>> import estimator
>>> scene = estimator.read_scene("data/scenes/demo_room")
>>> instances = estimator.read_instances("data/scenes/demo_room/instances.json", scene)
>>> result = estimator.estimate_scale(scene, instances)
>>> result.status
'resolved'

A scene is in units of unknown metric size; `result.scale` is in metres per unit. No files are required: `read_scene`
also accepts a `pycolmap.Reconstruction`, and `read_instances` accepts masks as arrays. Other evidence is in
`estimator.evidence`.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from estimator.instances.instance_reader import read_instances
    from estimator.pipeline import estimate_scale, estimate_scene, measure_objects
    from estimator.reconstructions.scene_reader import read_scene
    from estimator.records.objects import MeasuredObject, Measurements
    from estimator.records.options import EstimateOptions, MeasurementOptions
    from estimator.records.result import ScaleEvidence, ScaleResult, SceneEstimate
    from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
    from estimator.results.estimate import scale_of_objects

__all__ = [
    "Camera",
    "DenseCloud",
    "EstimateOptions",
    "Instance",
    "MeasuredObject",
    "MeasurementOptions",
    "Measurements",
    "ScaleEvidence",
    "ScaleResult",
    "Scene",
    "SceneEstimate",
    "View",
    "estimate_scale",
    "estimate_scene",
    "measure_objects",
    "read_instances",
    "read_scene",
    "scale_of_objects",
]

#: Module of each public name, imported on first use, so that light commands do not import SciPy.
_public_name, __dir__ = lazy_names(
    __name__,
    {
        "instances.instance_reader": ("read_instances",),
        "pipeline": ("estimate_scale", "estimate_scene", "measure_objects"),
        "reconstructions.scene_reader": ("read_scene",),
        "records.objects": ("MeasuredObject", "Measurements"),
        "records.options": ("EstimateOptions", "MeasurementOptions"),
        "records.result": ("ScaleEvidence", "ScaleResult", "SceneEstimate"),
        "records.scene": ("Camera", "DenseCloud", "Instance", "Scene", "View"),
        "results.estimate": ("scale_of_objects",),
    },
)
_MOVED = {
    "AssetCheck": "models3d",
    "Capture": "capture",
    "CaptureFailure": "capture",
    "capture_video": "capture",
    "check_asset": "models3d",
}


def __getattr__(name: str) -> object:
    if name in _MOVED:
        message = f"estimator.{name} has moved to {_MOVED[name]}.{name}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(import_module(_MOVED[name]), name)
    return _public_name(name)
