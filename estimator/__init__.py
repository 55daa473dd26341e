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

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from estimator.instances.instance_reader import read_instances as read_instances
    from estimator.pipeline import estimate_scale as estimate_scale
    from estimator.pipeline import estimate_scene as estimate_scene
    from estimator.pipeline import measure_objects as measure_objects
    from estimator.reconstructions.scene_reader import read_scene as read_scene
    from estimator.records.objects import MeasuredObject as MeasuredObject
    from estimator.records.objects import Measurements as Measurements
    from estimator.records.options import EstimateOptions as EstimateOptions
    from estimator.records.options import MeasurementOptions as MeasurementOptions
    from estimator.records.result import ScaleEvidence as ScaleEvidence
    from estimator.records.result import ScaleResult as ScaleResult
    from estimator.records.result import SceneEstimate as SceneEstimate
    from estimator.records.scene import Camera as Camera
    from estimator.records.scene import DenseCloud as DenseCloud
    from estimator.records.scene import Instance as Instance
    from estimator.records.scene import Scene as Scene
    from estimator.records.scene import View as View
    from estimator.results.estimate import scale_of_objects as scale_of_objects

#: Module of each public name, imported on first use, so that light commands do not import SciPy.
__getattr__, __dir__, __all__ = lazy_names(
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

# Modules, their limits, and their tests in `tests/estimator`:
# - pipeline: Estimate the metric scale of a scene or of measured objects: the stages in order, with their durations.
#   Limits: MIN_GROUP_FRACTION. Tests: test_documented_forms.py, test_same_numbers.py.
