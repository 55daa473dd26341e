"""Estimate the metric scale of a scene or of measured objects: the stages in order, with their durations.

`estimate_scene` reads a scene and its masks, checks them, and measures the objects (`measure_objects`). The method
(`METHODS`) then estimates the scale from the objects and the other evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import metric_tree
from estimator import records
from estimator.baselines.paper import paper_result
from estimator.records.digests import objects_digest, scene_digests
from estimator.records.objects import MeasuredObject
from estimator.records.options import PAPER, EstimateOptions, MeasurementOptions
from estimator.records.result import (
    TAKEN_AS_METRES,
    ResultContext,
    ScaleEvidence,
    ScaleResult,
    SceneEstimate,
    UpReport,
)
from estimator.records.scene import Instance, InstanceSet, Scene, SceneProblem
from estimator.results.estimate import scale_of_objects
from metric_base.arrays import IntArray
from metric_base.errors import InputError
from metric_base.progress import stopwatch
from metric_tree.context import Where, where_of
from metric_tree.tree import Tree

if TYPE_CHECKING:
    from estimator.detectors.detector import Detector
    from estimator.evidence.source import EvidenceSource
    from estimator.records.objects import Measurements


#: Minimum fraction of the views in a group without common points with other groups. Its scale is estimated separately;
#: smaller groups hardly change the scale.
MIN_GROUP_FRACTION = 0.1


@dataclass(frozen=True, slots=True)
class Method:
    """A method that estimates the scale from measured objects."""

    measurement: MeasurementOptions
    estimate: Callable[[Sequence[MeasuredObject], Tree, EstimateOptions, ResultContext], ScaleResult]
    uses_evidence: bool  #: It uses evidence other than objects.


#: The methods that measure objects, by the name in `EstimateOptions`. `sucar`, which measures none, is in
#: `estimate_scene`.
METHODS = {
    "default": Method(MeasurementOptions(), scale_of_objects, uses_evidence=True),
    "height": Method(MeasurementOptions(), scale_of_objects, uses_evidence=True),
    "paper": Method(PAPER, paper_result, uses_evidence=False),
}


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
    """Estimate the scale of a scene, in metres per scene unit, from the sizes of its objects.

    Parameters
    ----------
    scene : Scene
        Result of `read_scene`, or constructed by the caller.
    instances : sequence of Instance
        Result of `read_instances`, or constructed by the caller.
    tree : Tree, optional
        Release with the size priors; by default the newest available.
    level : float, default 0.9
        Mass of the equal-tailed interval, between 0 and 1.
    evidence : sequence of ScaleEvidence or EvidenceSource
        Other evidence for the methods `default` and `height`. Sources (`estimator.evidence`: camera height, GPS,
        markers, metric depth, baseline of a rig) observe the scene.
    method : {"default", "height", "paper", "sucar"}
        The last three are baselines.
    up : sequence of float, optional
        Known vertical in the axes of the scene (from an inertial unit), of any length. It replaces the estimate from
        cameras and level surfaces; a contradiction between them is a warning.
    where : Where, dict or str, optional
        Region and year of the objects, such as `{"region": "europe", "year": 2011}`, one or both, for the methods
        `default` and `height`.

    Returns
    -------
    ScaleResult
        `scale` and `interval` are None if `status` is `unresolved`.

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
    if method not in records.METHODS:
        raise InputError.at("estimate_scale", "method", f"one of {', '.join(records.METHODS)}", method)
    if tree is None:
        tree = metric_tree.open()
    ready = tuple(item for item in evidence if isinstance(item, ScaleEvidence))
    sources = tuple(item for item in evidence if not isinstance(item, ScaleEvidence))
    context = None if where is None else where_of(where)
    options = EstimateOptions(method=method, level=level, evidence=ready, up=up, where=context)
    return estimate_scene(scene, tree, options, instances=InstanceSet(tuple(instances)), sources=sources).result


def estimate_scene(
    source: Path | Scene,
    tree: Tree,
    options: EstimateOptions,
    *,
    instances: Path | InstanceSet | None = None,
    categories: Path | None = None,
    dense: Path | str | None = None,
    images: Path | None = None,
    detector: Detector | None = None,
    sources: Sequence[EvidenceSource] = (),
) -> SceneEstimate:
    """Estimate the scale of a reconstruction and of its masks.

    Parameters
    ----------
    source : Path or Scene
        Scene, or the folder of a reconstruction.
    tree : Tree
        Release with the size priors.
    options : EstimateOptions
    instances : Path or InstanceSet, optional
        Masks, or their file; by default those in the folder of the scene (`read_instances`).
    categories, dense
        As in `read_instances` and `read_scene`.
    images : Path, optional
        Folder of the images, by default `images` or `frames` in the folder of the model or above it.
    detector : Detector, optional
        Detector that finds the instances in the images, instead of `instances`.
    sources : sequence of EvidenceSource
        Evidence that is observed in the scene.

    Returns
    -------
    SceneEstimate
        The result, and the scene, instances and measurements that it is based on.

    Examples
    --------
    >>> from pathlib import Path
    >>> import metric_tree
    >>> from estimator import EstimateOptions, estimate_scene
    >>> estimate = estimate_scene(Path("data/scenes/demo_room"), metric_tree.open(), EstimateOptions())
    >>> estimate.result.status, len(estimate.measurements.objects) == len(estimate.result.objects)
    ('resolved', True)
    """
    from estimator.reconstructions.model_checks import (
        MAX_ASSUMED_HEIGHT_M,
        MAX_USUAL_HEIGHT_M,
        check_reconstruction,
        focal_problem,
        implied_position_problem,
        view_groups,
    )
    from estimator.reconstructions.scene_reader import read_scene

    seconds: dict[str, float] = {}
    with stopwatch(seconds, "reading"):
        scene = source if isinstance(source, Scene) else read_scene(source, dense)
        if isinstance(instances, InstanceSet):
            masks = instances
        else:
            has_evidence = bool(options.evidence or sources)
            masks = _scene_instances(scene, instances, categories, images, detector, has_evidence)
    warned = tuple(SceneProblem(message) for message in (*scene.warnings, *masks.warnings))
    focal = focal_problem(scene, images)
    problems = (*warned, *check_reconstruction(scene), *([] if focal is None else [focal]))
    context = ResultContext(problems=problems, digests=scene_digests(scene, masks), seconds=seconds)
    if options.method == "sucar":
        from estimator.baselines.sucar import sucar_result

        return SceneEstimate(sucar_result(scene, masks.instances, tree, options, context), scene, masks.instances, None)

    method = METHODS[options.method]
    is_invalid = any(problem.is_fatal for problem in problems)
    # An invalid scene may cause divisions by zero and infinities.
    with np.errstate(all="ignore" if is_invalid else "warn", under="ignore"):
        measurements = measure_objects(scene, masks.instances, replace(method.measurement, up=options.up))
    x, y, z = measurements.up.vector.tolist()
    context = replace(
        context,
        up=UpReport((x, y, z), measurements.up.method, measurements.up.sigma_deg),
        problems=(*problems, *measurements.problems),
        seconds=seconds | measurements.timings,
    )
    if method.uses_evidence:
        observed = [row for item in sources for row in item.observe(scene, measurements)]
        options = replace(options, evidence=(*options.evidence, *observed))
    result = method.estimate(measurements.objects, tree, options, context)
    groups = view_groups(scene)
    if len(groups) > 1 and result.scale is not None:
        contradiction = _contradiction_of_groups(scene, groups, masks, tree, options, sources)
        if contradiction is not None:
            # Without curve and scale, no output is drawn or scaled by a mixture of two scales.
            problems = (*context.problems, contradiction)
            result = method.estimate(measurements.objects, tree, options, replace(context, problems=problems))
    # Other evidence, such as GPS of an aircraft, confirms the height of the cameras, unless its unit is assumed.
    assumed = [(row.assumption or "").startswith(TAKEN_AS_METRES) for row in options.evidence if row.scale is not None]
    max_height_m = MAX_ASSUMED_HEIGHT_M if assumed and not result.objects else MAX_USUAL_HEIGHT_M
    floor = measurements.floor if all(assumed) else None
    implied = None if result.scale is None else implied_position_problem(scene, result.scale, floor, max_height_m)
    if implied is not None and implied.is_doubtful:
        result = replace(result, status="uncertain", warnings=(*result.warnings, f"uncertain: {implied.message}"))
    elif implied is not None:
        result = replace(result, warnings=(*result.warnings, implied.message))
    return SceneEstimate(result, scene, masks.instances, measurements)


def _contradiction_of_groups(
    scene: Scene,
    groups: Sequence[IntArray],
    masks: InstanceSet,
    tree: Tree,
    options: EstimateOptions,
    sources: Sequence[EvidenceSource],
) -> SceneProblem | None:
    """Return a fatal problem if groups of views (k,) without common points have different scales, each estimated alone.

    Small groups are ignored, because they hardly change the scale. Evidence that was not observed in the views of a
    group states nothing about its scale.
    """
    from estimator.reconstructions.model_checks import scene_of_views

    total = sum(map(len, groups))
    results: list[tuple[int, ScaleResult]] = []
    for rows in groups:
        if len(rows) < MIN_GROUP_FRACTION * total:
            continue
        new_index = {int(row): index for index, row in enumerate(rows)}
        kept = [replace(one, view=new_index[one.view]) for one in masks.instances if one.view in new_index]
        part, alone = scene_of_views(scene, rows), replace(options, evidence=())
        estimate = estimate_scene(part, tree, alone, instances=InstanceSet(tuple(kept)), sources=sources)
        results.append((len(rows), estimate.result))
    intervals = [result.interval for _, result in results]
    best = [result.scale for _, result in results]
    if all(
        interval is not None and scale is not None and interval.low <= scale <= interval.high
        for interval in intervals
        for scale in best
    ):
        return None
    scales = ", ".join(
        f"{'unknown' if result.scale is None else format(result.scale, '.4g')} ({count} views)"
        for count, result in results
    )
    message = f"the groups of views that share no point have different or unknown scales: {scales}; estimate each alone"
    return SceneProblem(message, is_fatal=True)


def estimate_objects(objects: Sequence[MeasuredObject], tree: Tree, options: EstimateOptions) -> ScaleResult:
    """Estimate the scale from objects that another program measured, by the methods `default`, `height` and `paper`."""
    context = ResultContext(digests={"objects": objects_digest(objects)})
    return METHODS[options.method].estimate(objects, tree, options, context)


def measure_objects(
    scene: Scene, instances: Sequence[Instance], options: MeasurementOptions | None = None
) -> Measurements:
    """Measure the objects of a scene in scene units, one for each track of instances.

    The result does not depend on the frame of the scene or on the order of its lists, except for rounding
    (`canonical_frame`).

    Parameters
    ----------
    scene : Scene
    instances : sequence of Instance
    options : MeasurementOptions, optional

    Raises
    ------
    ValueError
        The scene has no views.

    Examples
    --------
    >>> from estimator import measure_objects, read_instances, read_scene
    >>> scene = read_scene("data/scenes/demo_room")
    >>> objects = measure_objects(scene, read_instances("data/scenes/demo_room/instances.json", scene)).objects
    >>> next(object.extents.shape for object in objects if object.category == "couch")  # length, width, height
    (3,)
    """
    from estimator.association.tracks import associate
    from estimator.geometry.canonical_frame import normalise_scene
    from estimator.geometry.measurement import measure_tracks, to_world
    from estimator.geometry.scene_geometry import scene_geometry
    from estimator.geometry.vertical import up_from_vector

    options = options or MeasurementOptions()
    seconds: dict[str, float] = {}
    with stopwatch(seconds, "order"):
        # Algorithm 1 of the paper needs the frames in the order in which they were taken.
        inner = normalise_scene(scene, instances, keep_views=options.association == "incremental")
    given = None if options.up is None else up_from_vector(inner.frame.basis @ np.asarray(options.up))
    association = associate(inner.scene, inner.instances, options, seconds)
    geometry = scene_geometry(inner.scene, association.clouds, options, given, seconds)
    problems = [*association.problems, *geometry.problems]
    if instances and not inner.instances:
        doubled = f"the {len(instances)} masks are pairs of equal masks with two categories of equal score"
        problems.append(SceneProblem(f"{doubled}: the correct ones are unknown, and none is used"))
    if geometry.up.method == "none":
        cause = "the cameras neither turn nor agree on it, or look straight at a wall or the ground"
        problems.append(SceneProblem(f"up is unknown: {cause} (--up, an inertial unit or a level surface would help)"))
    if geometry.up.method == "mean-camera-up":
        uncertain = "up is the mean camera up: the cameras hardly turn and no level surface is visible"
        problems.append(SceneProblem(uncertain))
    if options.supports and not geometry.planes:
        problems.append(SceneProblem("no support plane was found: objects are not extended down to one"))
    objects = measure_tracks(inner.scene, inner.instances, association, geometry, options, seconds)
    return to_world(objects, association.tracks, geometry, inner, tuple(problems), seconds)


def _scene_instances(
    scene: Scene,
    file: Path | None,
    categories: Path | None,
    images: Path | None,
    detector: Detector | None,
    has_evidence: bool,
) -> InstanceSet:
    """Detect the instances of a scene in its images, or read them; parameters as in `estimate_scene`.

    A scene without masks has no instances if it has other evidence.
    """
    from estimator.instances.instance_reader import default_instances, read_instances_and_warnings

    if detector is not None:
        from estimator.detectors.detect import detect_instances

        return InstanceSet(*detect_instances(scene, images, detector))
    if file is None and has_evidence and default_instances(scene) is None:
        return InstanceSet((), ("no instances: the scale is based on the other evidence",))
    instances, warned = read_instances_and_warnings(scene, file, categories)
    return InstanceSet(instances, warned, is_default=bool(instances) and file is None)
