"""The estimate of Sucar and Hayet: heights of back-projected detection boxes and a prior of the height of each class.

E. Sucar and J.-B. Hayet, "Probabilistic global scale estimation for monoSLAM based on generic object detection", 2017,
as the paper describes its baseline. Every detection is projected back into the scene at the depth of the map points in
its box. Its height along a prescribed vertical is compared with the height of its class, h* = s h, and every frame is a
new observation. There is no association, confidence or truncation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.baselines.candidate_search import candidate_scales, estimate_on
from estimator.geometry.vertical import up_from_vector
from estimator.projection.cameras import view_rays
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ResultContext, ScaleResult, UpReport
from estimator.records.scene import Instance, Scene
from estimator.results.estimate import HEIGHT
from estimator.results.object_priors import resolve_categories, selected_evidence
from estimator.results.scale_report import build_result
from metric_base.arrays import FloatArray
from metric_base.progress import stopwatch
from metric_tree.tree import Tree

#: Minimum number of map points in a box for a depth.
MIN_POINTS = 3
#: Number of samples for the mean and the standard deviation of the heights of a class, and their seed.
N_SAMPLES = 4000
SEED = 0


def sucar_result(
    scene: Scene,
    instances: Sequence[Instance],
    tree: Tree,
    options: EstimateOptions,
    context: ResultContext | None = None,
) -> ScaleResult:
    """Estimate the scale from the box of every detection, each of which is an object of the result.

    Parameters
    ----------
    scene : Scene
    instances : sequence of Instance
    tree : Tree
        Release with the priors of the heights.
    options : EstimateOptions
        Its fields `level` and `up` are used. The default vertical is the y axis of the first camera.
    context : ResultContext, optional
        Problems, digests and durations of the scene.
    """
    context = context or ResultContext()
    matches = resolve_categories(tree, {item.category for item in instances}, HEIGHT)
    seconds = dict(context.seconds)
    with stopwatch(seconds, "posterior"):
        down = prescribed_down(scene) if options.up is None else -up_from_vector(options.up).vector
        heights = box_heights(scene, instances, down)
        boxes = [
            MeasuredObject(
                id=str(number),
                category=item.category,
                extents=np.array([np.nan, np.nan, height]),
                sigma=np.full(3, np.nan),
                score=item.score,
                views=1,
                skipped=None if np.isfinite(height) and height > 0 else "no depth in its box",
            )
            for number, (item, height) in enumerate(zip(instances, heights, strict=True), start=1)
        ]
        reasons = [box.skipped or matches[box.category].reason for box in boxes]
        used = [index for index, reason in enumerate(reasons) if reason is None]
        estimate = None
        if used:
            # The Gaussian of the heights of each class.
            samples = {
                name: match.prior.sample(N_SAMPLES, SEED)[:, 0]
                for name, match in matches.items()
                if match.prior is not None
            }
            moments = {name: (float(drawn.mean()), float(drawn.std())) for name, drawn in samples.items()}
            mean, sd = np.array([moments[boxes[index].category] for index in used]).T  # (n,) mm
            mm = np.array([boxes[index].extents[2] for index in used]) * 1000
            scales = candidate_scales(mean / mm)
            residuals = (scales * mm[:, None] - mean[:, None]) / sd[:, None]
            estimate = estimate_on(scales, -0.5 * residuals**2 - np.log(sd)[:, None], options.level)
    status, reason = ("unresolved", None) if estimate is None else (estimate.status, estimate.reason)
    x, y, z = down.tolist()
    how = "prescribed: first camera" if options.up is None else "given"
    return build_result(
        selected_evidence(boxes, matches, reasons, dict.fromkeys(used, HEIGHT)),
        estimate,
        tree,
        options,
        replace(context, up=UpReport((-x, -y, -z), how, 0.0)),
        status=status,
        reason=reason,
        seconds=seconds,
    )


def prescribed_down(scene: Scene) -> FloatArray:
    """Return the prescribed downward direction (3,): the y axis of the first camera."""
    return np.asarray(scene.views[0].rotation[1])


def box_heights(scene: Scene, instances: Sequence[Instance], down: FloatArray) -> FloatArray:
    """Return the height (n,) of the box of each detection along `down` (3,), in scene units; NaN without depth.

    The centre of the box is at the median depth of the map points observed in the box. Its height is the distance
    between the points of the vertical line through the centre that project to the upper and the lower edge.
    """
    heights = np.full(len(instances), np.nan)
    for index, item in enumerate(instances):
        view = scene.views[item.view]
        columns, rows = np.flatnonzero(item.mask.any(axis=0)), np.flatnonzero(item.mask.any(axis=1))
        if not len(columns):
            continue
        low = np.array([item.origin[0] + columns[0], item.origin[1] + rows[0]])
        high = np.array([item.origin[0] + columns[-1] + 1, item.origin[1] + rows[-1] + 1])
        inside = ((view.keypoints >= low) & (view.keypoints <= high)).all(axis=1)
        depths = (view.to_camera(scene.points[view.point_index[inside]]))[:, 2]
        depth = float(np.median(depths)) if len(depths) >= MIN_POINTS else np.nan
        if not np.isfinite(depth):
            continue
        centre_pixel = 0.5 * (low + high)
        pixels = np.array([centre_pixel, [centre_pixel[0], low[1]], [centre_pixel[0], high[1]]])
        rays = view_rays(view.camera, pixels) @ view.rotation  # (3, 3) world, unit depth
        centre = rays[0] * depth  # from the camera centre
        ends = []  # t of the point on the line centre + t down that is closest to the ray of each edge
        for ray in rays[1:]:
            across = ray - (ray @ down) * down  # component orthogonal to the line
            reach = (centre @ across) / max(float(across @ across), 1e-12)
            ends.append(float(reach * (ray @ down) - centre @ down))
        heights[index] = float(abs(ends[1] - ends[0]))
    return heights
