"""From what the user has to a result: objects of a file, or a scene with its instances; with the time of each step.

The one place that conducts the rooms: reading, checks, association, geometry, evidence, posterior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import metric_tree
from estimator.records import METHODS
from estimator.records.digests import cloud_digest, masks_digest, model_digest, objects_digest, options_digest
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleEvidence, ScaleResult, SceneEstimate, UpReport
from estimator.records.scene import Instance, Scene, SceneProblem
from estimator.results.estimate import scale_of_objects
from metric_base.errors import InputError
from metric_base.progress import stopwatch
from metric_tree.context import Where, where_of
from metric_tree.tree import Tree

if TYPE_CHECKING:
    from estimator.detectors.detector import Detector
    from estimator.evidence.source import EvidenceSource
    from estimator.records.objects import Measurements, Up
    from estimator.records.options import MeasurementOptions


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
    return _estimate(_SceneMasks(scene, tuple(instances)), tree, options, sources).result


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
    source : a scene, or where it is; instances, categories, dense : as `estimator.reconstructions.scene_reader` takes
    them
    tree, options : as `scale_of_objects`
    paper_lists : the authors' lists, for the second arm of `paper`
    sources : evidence that looks at the scene
    images, detector : the folder of the pictures and what finds the instances in them, in place of `instances`
    """
    from estimator.instances.instance_reader import default_instances, read_instances_and_warnings
    from estimator.reconstructions.scene_reader import read_scene

    seconds: dict[str, float] = {}
    with stopwatch(seconds, "reading"):
        scene = source if isinstance(source, Scene) else read_scene(source, dense)
        if images is not None and detector is not None:
            from estimator.detectors.detect import detect_instances

            masks, warnings = detect_instances(scene, images, detector)
        elif instances is None and (options.evidence or sources) and default_instances(scene) is None:
            masks, warnings = (), ("no instances, so the scale is that of the other evidence alone",)
        else:
            masks, warnings = read_instances_and_warnings(scene, instances, categories)
    beside = bool(masks) and instances is None and detector is None
    return _estimate(_SceneMasks(scene, masks, warnings, seconds, beside), tree, options, sources, paper_lists)


def measure_objects(
    scene: Scene, instances: Sequence[Instance], options: MeasurementOptions | None = None
) -> Measurements:
    """The objects of a scene in scene units, one for every track, by labels, tracks, up, planes and dimensions.

    A copy of the scene in another frame or order gives the same, but for rounding (`canonical_frame`). ValueError for
    a scene without views.

    Examples
    --------
    >>> from estimator import measure_objects, read_instances, read_scene
    >>> scene = read_scene("data/scenes/demo_room")
    >>> objects = measure_objects(scene, read_instances("data/scenes/demo_room/instances.json", scene)).objects
    >>> next(object.extents.shape for object in objects if object.category == "couch")  # length, width, height
    (3,)
    """
    from estimator.association.tracks import associate
    from estimator.geometry.canonical_frame import sorted_scene
    from estimator.geometry.measurement import in_world, measure_tracks
    from estimator.geometry.vertical import up_from_vector
    from estimator.records.options import MeasurementOptions

    options = options or MeasurementOptions()
    seconds: dict[str, float] = {}
    with stopwatch(seconds, "order"):
        # Algorithm 1 goes through the frames as they were taken
        world = sorted_scene(scene, instances, keep_views=options.association == "incremental")
    given = None if options.up is None else up_from_vector(world.frame.basis @ np.asarray(options.up))
    ours = world.scene, world.instances
    association = associate(*ours, options.association, options.dense, options.stated_tracks, seconds)
    measured = in_world(measure_tracks(*ours, association, options, given, seconds), world)
    doubled = (_ambiguity_of(len(instances)),) if instances and not world.instances else ()
    notes = _up_warnings(measured.up, options.supports and not measured.planes)
    return replace(measured, problems=(*measured.problems, *map(SceneProblem, (*doubled, *notes))))


def _ambiguity_of(masks: int) -> str:
    same = f"the {masks} masks lie in pairs on the same pixels under two categories of equal score"
    return f"{same}: nothing says which is right, and none is taken"


def _up_warnings(up: Up, no_planes: bool) -> list[str]:
    lines = {
        "none": "up is unknown: the cameras neither turn nor agree on it",
        "mean-camera-up": "up is the mean camera up: the cameras hardly turn and no level surface is visible",
    }
    warnings = [lines[up.method]] if up.method in lines else []
    return [*warnings, "no support plane was found: heights are those of the points alone"] if no_planes else warnings


@dataclass(frozen=True, slots=True, eq=False)
class _SceneMasks:
    """A scene, its masks, warnings and times of reading; beside : the masks are those that lie with the scene."""

    scene: Scene
    instances: tuple[Instance, ...]
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    beside: bool = False


def _estimate(
    masks: _SceneMasks,
    tree: Tree,
    options: EstimateOptions,
    sources: Sequence[EvidenceSource] = (),
    paper_lists: Path | None = None,
) -> SceneEstimate:
    """The estimate and what it is of."""
    from estimator.reconstructions.model_checks import check_reconstruction

    scene, instances = masks.scene, masks.instances
    problems = check_reconstruction(scene)
    errors = tuple(problem.message for problem in problems if problem.is_fatal)
    doubts = (problem.message for problem in problems if not problem.is_fatal)
    warnings, seconds = (*scene.warnings, *masks.warnings, *doubts), dict(masks.seconds)
    measurements = None
    if options.method == "sucar":
        from estimator.baselines.sucar import sucar_result

        result = sucar_result(scene, instances, tree, options, warnings, seconds)
    else:
        from estimator.records.options import PAPER, MeasurementOptions

        choices = PAPER if options.method == "paper" else MeasurementOptions()
        # of a scene that is ruled out nothing is used: its zeros and infinities are no news
        with np.errstate(all="ignore" if errors else "warn"):
            measurements = measure_objects(scene, instances, replace(choices, up=options.up))
        seconds |= measurements.timings
        up = _up_report(measurements.up)
        warnings = (*warnings, *(problem.message for problem in measurements.problems if not problem.is_fatal))
        errors = (*errors, *(problem.message for problem in measurements.problems if problem.is_fatal))
        if options.method == "paper":
            from estimator.baselines.paper import paper_result

            result = paper_result(measurements.objects, tree, options, paper_lists, up, warnings, seconds)
        else:
            observed = [row for source in sources for row in source.observe(scene, measurements)]
            options = replace(options, evidence=(*options.evidence, *observed))
            result = scale_of_objects(measurements.objects, tree, options, up, warnings, seconds)
    of = {
        "model": model_digest(scene),
        "cloud": cloud_digest(scene),
        "masks": masks_digest(scene, instances),
        "masks_from": "scene" if masks.beside else None,
    }
    return SceneEstimate(_result_of(_reject(result, errors), options, of), scene, instances, measurements)


def _result_of(result: ScaleResult, options: EstimateOptions, of: Mapping[str, str | None]) -> ScaleResult:
    """The result with the digests of what it is of, and of what was asked for."""
    rows = [(row.kind, row.id, row.scale, row.sd_log) for row in result.evidence]
    up = None if options.up is None else [float(value) for value in options.up]
    asked = (result.method, options.level, options.trust_known_length, str(options.where), up, rows, result.tree)
    return replace(result, of={**of, "options": options_digest(asked)})


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
