"""From what the user has to a result: objects of a file, or a scene with its instances; with the time of each step."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import metric_tree
from estimator.records import METHODS
from estimator.records.digests import cloud_digest, masks_digest, model_digest, objects_digest, options_digest
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import ScaleResult, UpReport
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Instance, Scene
from estimator.results.estimate import scale_of_objects
from estimator.results.reports import EstimateOptions
from estimator.results.scene_estimate import SceneEstimate
from metric_base.errors import InputError
from metric_tree.context import Where, where_of
from metric_tree.tree import Tree

if TYPE_CHECKING:
    from estimator.detectors.detector import Detector
    from estimator.evidence.source import EvidenceSource
    from estimator.geometry.up import Up

__all__ = ["estimate_scale", "objects_result", "scene_estimate"]


def estimate_scale(
    scene: Scene,
    instances: Sequence[Instance],
    tree: Tree | None = None,
    *,
    level: float = 0.9,
    evidence: Sequence[ScaleEvidence | EvidenceSource] = (),
    method: str = "default",
    up: Sequence[float] | None = None,
    where: Where | Mapping[str, Any] | str | None = None,
) -> ScaleResult:
    """The scale of a scene, in metres per scene unit, from the sizes of the objects that its instances show.

    Parameters
    ----------
    scene, instances : as `read_scene` and `read_instances` return them, or made by hand
    tree : the release with the size priors, by default the newest available
    level : mass of the equal-tailed interval, between 0 and 1
    evidence : beside the objects, for `default` and `height`: `ScaleEvidence`, or sources that look at the scene
        (`estimator.evidence`: camera height, GPS, markers, metric depth, a rig's baseline)
    method : `default`, or a baseline: `height`, `paper`, `sucar`
    up : the vertical of the scene's axes where it is known from outside (an inertial unit), of any length; it replaces
        what the cameras and level surfaces show, and a warning says if they contradict it
    where : region and year of the objects, `{"region": "europe", "year": 2011}`, either or both, for `default` and
        `height`

    Returns
    -------
    ScaleResult; its `scale` and `interval` are None where `status` is `unresolved`.

    Raises
    ------
    InputError
        An argument is out of its range.

    Examples
    --------
    >>> import estimator
    >>> scene = estimator.read_scene("data/scenes/demo_room")
    >>> instances = estimator.read_instances(None, scene)
    >>> result = estimator.estimate_scale(scene, instances, level=0.8)
    >>> result.interval.low < result.scale < result.interval.high
    True
    """
    if not 0 < level < 1:
        raise InputError.at("estimate_scale", "level", "a number between 0 and 1", level)
    if method not in METHODS:
        raise InputError.at("estimate_scale", "method", f"one of {', '.join(METHODS)}", method)
    if tree is None:
        tree = metric_tree.open()
    ready = tuple(item for item in evidence if isinstance(item, ScaleEvidence))
    sources = tuple(item for item in evidence if not isinstance(item, ScaleEvidence))
    asked = None if where is None else where_of(where)
    options = EstimateOptions(method=method, level=level, evidence=ready, up=up, where=asked)
    return _estimate(scene, instances, tree, options, sources).result


def objects_result(
    objects: Sequence[MeasuredObject], tree: Tree, options: EstimateOptions, paper_lists: Path | None = None
) -> ScaleResult:
    """The scale from sizes measured elsewhere, by the methods `default`, `height` and `paper`."""
    if options.method == "paper":
        from estimator.baselines.paper import paper_result

        result = paper_result(objects, tree, options, paper_lists)
    else:
        result = scale_of_objects(objects, tree, options)
    return _result_of(result, options, {"objects": objects_digest(objects)})


def scene_estimate(
    source: Path | Scene,
    tree: Tree,
    options: EstimateOptions,
    *,
    instances: Path | None = None,
    categories: Path | None = None,
    dense: Path | str | None = None,
    paper_lists: Path | None = None,
    images: Path | None = None,
    detector: Detector | None = None,
    sources: Sequence[EvidenceSource] = (),
) -> SceneEstimate:
    """The scale of a reconstruction on disk.

    Parameters
    ----------
    source : a scene, or where it is; instances, categories, dense : as `estimator.reading` takes them
    tree, options : as `scale_of_objects`
    paper_lists : the authors' lists, for the second arm of `paper`
    sources : evidence that looks at the scene
    images, detector : the folder of the pictures and what finds the instances in them, in place of `instances`
    """
    from estimator.reading import default_instances, read_instances_and_warnings, read_scene

    started = time.perf_counter()
    scene = source if isinstance(source, Scene) else read_scene(source, dense)
    if images is not None and detector is not None:
        from estimator.detectors.detection import detect_instances

        masks, warnings = detect_instances(scene, images, detector)
    elif instances is None and (options.evidence or sources) and default_instances(scene) is None:
        masks, warnings = (), ("no instances, so the scale is that of the other evidence alone",)
    else:
        masks, warnings = read_instances_and_warnings(scene, instances, categories)
    seconds = {"reading": time.perf_counter() - started}
    beside = bool(masks) and instances is None and detector is None
    return _estimate(scene, masks, tree, options, sources, warnings, seconds, paper_lists, beside)


def _estimate(
    scene: Scene,
    instances: Sequence[Instance],
    tree: Tree,
    options: EstimateOptions,
    sources: Sequence[EvidenceSource] = (),
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
    paper_lists: Path | None = None,
    beside: bool = False,
) -> SceneEstimate:
    """The estimate and what it is of; beside : the masks are those that lie with the scene."""
    of = {
        "model": model_digest(scene),
        "cloud": cloud_digest(scene),
        "masks": masks_digest(scene, instances),
        "masks_from": "scene" if beside else None,
    }
    estimate = _estimate_of(scene, instances, tree, options, sources, warnings, seconds, paper_lists)
    return replace(estimate, result=_result_of(estimate.result, options, of))


def _result_of(result: ScaleResult, options: EstimateOptions, of: Mapping[str, str | None]) -> ScaleResult:
    """The result with the digests of what it is of, and of what was asked for."""
    rows = [(row.kind, row.id, row.scale, row.sd_log) for row in result.evidence]
    up = None if options.up is None else [float(value) for value in options.up]
    asked = (result.method, options.level, options.trust_known_length, str(options.where), up, rows, result.tree)
    return replace(result, of={**of, "options": options_digest(asked)})


def _estimate_of(
    scene: Scene,
    instances: Sequence[Instance],
    tree: Tree,
    options: EstimateOptions,
    sources: Sequence[EvidenceSource] = (),
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
    paper_lists: Path | None = None,
) -> SceneEstimate:
    doubts, errors = _self_contradictions(scene)
    instances, seconds = tuple(instances), dict(seconds or {})
    warnings = (*scene.warnings, *warnings, *doubts)
    if options.method == "sucar":
        from estimator.baselines.sucar import sucar_result

        result = sucar_result(scene, instances, tree, options, warnings, seconds)
        return SceneEstimate(_reject(result, errors), scene, instances, None)
    from estimator.geometry.measurement import PAPER, MeasurementOptions, measure_objects

    choices = PAPER if options.method == "paper" else MeasurementOptions()
    # of a scene that is ruled out nothing is used: its zeros and infinities are no news
    with np.errstate(all="ignore" if errors else "warn"):
        measurements = measure_objects(scene, instances, replace(choices, up=options.up))
    seconds |= measurements.timings
    warnings = (*warnings, *measurements.warnings)
    up = _up_report(measurements.up)
    if options.method == "paper":
        from estimator.baselines.paper import paper_result

        result = paper_result(measurements.objects, tree, options, paper_lists, up, warnings, seconds)
    else:
        observed = [row for source in sources for row in source.observe(scene, measurements)]
        options = replace(options, evidence=(*options.evidence, *observed))
        result = scale_of_objects(measurements.objects, tree, options, up, warnings, seconds)
    return SceneEstimate(_reject(result, (*errors, *measurements.errors)), scene, instances, measurements)


def _self_contradictions(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Doubts about the reconstruction itself, and what rules it out: degenerate, or against its own observations."""
    from estimator.checks.consistency import consistency, contradictions
    from estimator.checks.degeneracy import degeneracy

    degenerate = degeneracy(scene)
    if degenerate is not None:
        return (), (f"{degenerate.code}: {degenerate.message}",)
    return contradictions(consistency(scene))


def _reject(result: ScaleResult, errors: Sequence[str]) -> ScaleResult:
    """The result, unresolved where the reconstruction itself is invalid."""
    if not errors:
        return result
    lines = [f"unresolved: {error}" for error in errors]
    # without its curve nothing is drawn of it: the sizes of such a scene are no sizes
    return replace(
        result,
        status="unresolved",
        scale=None,
        interval=None,
        curve=None,
        would_help=(),
        warnings=(*result.warnings, *lines),
    )


def _up_report(up: Up) -> UpReport:
    return UpReport((float(up.vector[0]), float(up.vector[1]), float(up.vector[2])), up.method, up.sigma_deg)
