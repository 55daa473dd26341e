"""Sucar and Hayet's estimate: heights of back-projected detection boxes against a height prior per class.

E. Sucar and J.-B. Hayet, "Probabilistic global scale estimation for monoSLAM based on generic object detection", 2017,
as the paper describes its baseline: every detection's 2-D box is projected back into the scene at the depth of the
map points in it, its height along a prescribed vertical is compared with the class's height, h* = s h, and every frame
counts as a new observation. No association, no confidence, no truncation.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from estimator.baselines.candidate_search import candidate_scales, estimate_on
from estimator.geometry.vertical import up_from_vector
from estimator.projection.cameras import pixels_in_view, view_rays
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleResult, UpReport
from estimator.records.scene import Instance, Scene, View
from estimator.results.estimate import HEIGHT
from estimator.results.object_priors import LabelMeaning, meanings
from estimator.results.scale_report import ScaleAnswer, result_of
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: Fewer map points than this in a box give no depth.
LEAST_POINTS = 3

#: Draws that give the mean and the deviation in mm of a class's heights.
DRAWS, SEED = 4000, 0


def sucar_result(
    scene: Scene,
    instances: Sequence[Instance],
    tree: Tree,
    options: EstimateOptions,
    warnings: Sequence[str] = (),
    seconds: Mapping[str, float] | None = None,
) -> ScaleResult:
    """The scale by every detection's box; each row of the result is one detection."""
    by_name = meanings(tree, {item.category for item in instances}, HEIGHT)
    started = time.perf_counter()
    down = prescribed_down(scene) if options.up is None else -up_from_vector(options.up).vector
    heights = box_heights(scene, instances, down)
    boxes = [
        _object(number, item, height) for number, (item, height) in enumerate(zip(instances, heights, strict=True))
    ]
    answer = _answer(boxes, by_name, options)
    how = "prescribed: first camera" if options.up is None else "given"
    up = UpReport((float(-down[0]), float(-down[1]), float(-down[2])), how, 0.0)
    elapsed = {**(seconds or {}), "posterior": time.perf_counter() - started}
    return result_of(boxes, tree, by_name, answer, options, up, warnings, elapsed)


def prescribed_down(scene: Scene) -> FloatArray:
    """(3,) the vertical that the method prescribes: the y axis of the first camera."""
    return np.asarray(scene.views[0].rotation[1])


def box_heights(scene: Scene, instances: Sequence[Instance], down: FloatArray) -> FloatArray:
    """(n,) height in scene units of each detection's box along the prescribed vertical; NaN without depth.

    The box's middle column meets the vertical line through its centre, which lies at the median depth of the map
    points observed inside the box.
    """
    return np.array([_box_height(scene, item, down) for item in instances])


def _box_height(scene: Scene, item: Instance, down: FloatArray) -> float:
    """Height of the mask's box along `down` (3,), in scene units; NaN where it is not known."""
    view = scene.views[item.view]
    columns, rows = np.flatnonzero(item.mask.any(axis=0)), np.flatnonzero(item.mask.any(axis=1))
    if not len(columns):
        return np.nan
    low = np.array([item.origin[0] + columns[0], item.origin[1] + rows[0]])
    high = np.array([item.origin[0] + columns[-1] + 1, item.origin[1] + rows[-1] + 1])
    depth = _depth(scene, view, low, high)
    if not np.isfinite(depth):
        return np.nan
    middle = 0.5 * (low + high)
    pixels = np.array([middle, [middle[0], low[1]], [middle[0], high[1]]])
    rays = view_rays(view.camera, pixels) @ view.rotation  # (3, 3) world, unit depth
    centre = rays[0] * depth  # from the camera centre
    top, bottom = (_along(down, centre, ray) for ray in rays[1:])
    return float(abs(bottom - top))


def _depth(scene: Scene, view: View, low: FloatArray, high: FloatArray) -> float:
    """Median depth of the points in the box from `low` (2,) to `high` (2,), pixels."""
    if len(view.point_index):
        inside = ((view.keypoints >= low) & (view.keypoints <= high)).all(axis=1)
        depths = (scene.points[view.point_index[inside]] @ view.rotation.T + view.translation)[:, 2]
    else:
        pixels, all_depths = pixels_in_view(view, scene.points)
        with np.errstate(invalid="ignore"):
            depths = all_depths[((pixels >= low) & (pixels <= high)).all(axis=1)]
    return float(np.median(depths)) if len(depths) >= LEAST_POINTS else np.nan


def _along(down: FloatArray, centre: FloatArray, ray: FloatArray) -> float:
    """Place t on the line centre + t down nearest to a ray through the origin; all (3,)."""
    across = ray - (ray @ down) * down  # the ray seen along the line
    reach = (centre @ across) / max(float(across @ across), 1e-12)
    return float(reach * (ray @ down) - centre @ down)


def _object(number: int, item: Instance, height: float) -> MeasuredObject:
    return MeasuredObject(
        id=str(number + 1),
        category=item.category,
        extents=np.array([np.nan, np.nan, height]),
        sigma=np.full(3, np.nan),
        score=item.score,
        views=1,
        skipped=None if np.isfinite(height) and height > 0 else "no depth in its box",
    )


def _answer(
    boxes: Sequence[MeasuredObject], by_name: Mapping[str, LabelMeaning], options: EstimateOptions
) -> ScaleAnswer:
    reasons = [box.skipped or by_name[box.category].reason for box in boxes]
    places = [place for place, reason in enumerate(reasons) if reason is None]
    if not places:
        return ScaleAnswer(None, places, [], reasons)
    moments = {name: _moments(meaning.prior) for name, meaning in by_name.items() if meaning.prior is not None}
    mean, sd = np.array([moments[boxes[place].category] for place in places]).T  # (n,) mm
    mm = np.array([boxes[place].extents[2] for place in places]) * 1000
    scales = candidate_scales(mean / mm)
    off = (scales * mm[:, None] - mean[:, None]) / sd[:, None]
    log_likelihood = -0.5 * off**2 - np.log(sd)[:, None]
    return ScaleAnswer(estimate_on(scales, log_likelihood, options.level), places, [HEIGHT] * len(places), reasons)


def _moments(prior: Prior) -> tuple[float, float]:
    """Mean and standard deviation in mm of the class's heights: the Gaussian of the method."""
    heights = prior.sample(DRAWS, SEED)[:, 0]
    return float(heights.mean()), float(heights.std())
