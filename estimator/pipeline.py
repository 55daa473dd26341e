"""From what the user has to a result: objects of a file, or a scene with its instances; with the time of each step."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.records.measured_object import MeasuredObject
from estimator.records.result import ScaleResult, UpReport
from estimator.results.estimate import Options, scale_of_objects
from estimator.results.scene_estimate import SceneEstimate
from metric_tree.tree import Tree

if TYPE_CHECKING:
    from estimator.geometry.up import Up
    from estimator.instances.detector import Detector

__all__ = ["objects_result", "scene_estimate"]


def objects_result(
    objects: Sequence[MeasuredObject], tree: Tree, options: Options, paper_lists: Path | None = None
) -> ScaleResult:
    """The scale from sizes measured elsewhere, by the methods `default`, `height` and `paper`."""
    if options.method == "paper":
        from estimator.baselines.paper import paper_result

        return paper_result(objects, tree, options, paper_lists)
    return scale_of_objects(objects, tree, options)


def scene_estimate(
    path: Path,
    tree: Tree,
    options: Options,
    *,
    instances: Path | None = None,
    categories: Path | None = None,
    dense: Path | str | None = None,
    paper_lists: Path | None = None,
    images: Path | None = None,
    detector: Detector | None = None,
) -> SceneEstimate:
    """The scale of a reconstruction on disk.

    Parameters
    ----------
    path, instances, categories, dense : as `estimator.reading` takes them
    tree, options : as `scale_of_objects`
    paper_lists : the authors' lists, for the second arm of `paper`
    images, detector : the folder of the pictures and what finds the instances in them, in place of `instances`
    """
    from estimator.reading import read_instances_and_warnings, read_scene

    started = time.perf_counter()
    scene = read_scene(path, dense)
    if images is not None and detector is not None:
        from estimator.instances.detector import detect_instances

        found, warnings = detect_instances(scene, images, detector)
    else:
        found, warnings = read_instances_and_warnings(scene, instances, categories)
    heard = (*scene.warnings, *warnings)
    seconds = {"reading": time.perf_counter() - started}
    if options.method == "sucar":
        from estimator.baselines.sucar import sucar_result

        return SceneEstimate(sucar_result(scene, found, tree, options, heard, seconds), scene, found, None)
    from estimator.geometry.measurement import PAPER, MeasurementOptions, measure_objects

    measurements = measure_objects(scene, found, PAPER if options.method == "paper" else MeasurementOptions())
    seconds |= measurements.timings
    heard = (*heard, *measurements.warnings)
    up = _up_report(measurements.up)
    if options.method == "paper":
        from estimator.baselines.paper import paper_result

        result = paper_result(measurements.objects, tree, options, paper_lists, up, heard, seconds)
    else:
        result = scale_of_objects(measurements.objects, tree, options, up, heard, seconds)
    return SceneEstimate(result, scene, found, measurements)


def _up_report(up: Up) -> UpReport:
    return UpReport((float(up.vector[0]), float(up.vector[1]), float(up.vector[2])), up.method, up.sigma_deg)
