"""Evaluate the scale of one photograph with the depth map of a network, by objects, by the network, and by both.

    python -m benchmarks.estimator.photographs [--seeds 0 1 2 3] [--sources rooms office] [--exact] [--write]

Depth maps are simulated: the true depth of rendered rooms, or the dense depth of `tum_office`, at half the resolution,
blurred, with a smooth relative error, an offset and a scale error of all pixels of the map. Masks of rooms have borders
with errors of 2 pixels. The scale of the network alone has the interval of its stated standard deviation. Each
photograph is also evaluated with `N_OBJECTS` of its masks, drawn at random.

Distances of objects from the camera have the multi-threshold relative accuracy of Sultana 2026 (Object-wise metric
distance estimation from a single RGB image, University of Victoria): the mean over objects, and over thresholds t of .5
to .95 in steps of .05 as in VSI-Bench, of whether the relative error is below 1 - t. It is 0 for a photograph without a
scale.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.special import erfinv

import metric_tree
from benchmarks.common import ROOT, SHARED, options_parser, row_text, table_head, write_between
from estimator.evidence.depth_maps import MetricDepth
from estimator.instances.instance_reader import read_instances
from estimator.outputs.ground_truth import read_truth
from estimator.pipeline import estimate_scene
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.network_outputs import OTHER_NETWORK_SD
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleResult
from estimator.records.scene import Instance, InstanceSet, Scene
from estimator.results.estimate import scale_of_objects
from estimator.scene_formats.photograph import read_photograph
from metric_base.arrays import FloatArray
from metric_tree.tree import Tree
from tests.synthetic.networks import rendered_views
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.masks import blurred_masks

PAGE = ROOT / "docs" / "evidence" / "absolute-scale.md"
LEVEL = 0.9
#: Number of photographs of each room.
N_VIEWS = 1
#: Standard deviations of the errors of a map: blur in pixels, smooth relative error, offset relative to the median
#: depth, and ln scale.
BLUR_PX, SMOOTH_ERROR, OFFSET_ERROR, SCALE_SD = 1.5, 0.03, 0.03, OTHER_NETWORK_SD
#: Length in pixels of the smooth error, and standard deviation of the borders of masks in pixels.
SMOOTH_PX, MASK_ERROR_PX = 40.0, 2.0
#: Numbers of masks of a photograph that are also evaluated alone.
N_OBJECTS = (1, 2, 4)
#: Upper ends of the groups by the number of masks.
GROUPS = ((1, "1"), (2, "2"), (5, "3 to 5"), (999, "6 and more"))
#: Thresholds of the relative accuracy of distances.
THRESHOLDS = np.arange(0.5, 0.96, 0.05)
METHODS = ("objects", "network", "both")


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """A photograph with its depth in metres (h, w) at half the resolution, and its masks."""

    source: str
    seed: tuple[int, ...]  #: Of its simulated errors and of the choice of masks.
    size: tuple[int, int]
    focal_px: float
    depth_m: FloatArray
    instances: tuple[Instance, ...]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Error of ln scale and interval of a method on a photograph; None for a refusal."""

    source: str
    group: str
    method: str
    error: float | None
    low: float = 0.0  #: Ends of ln scale minus the truth.
    high: float = 0.0
    accuracy: float = 0.0  #: Multi-threshold relative accuracy of the distances of objects.


def room_photographs(seeds: Sequence[int]) -> Iterator[Photograph]:
    """Yield the photographs of rendered rooms."""
    for seed in seeds:
        for number, kind in enumerate(KINDS):
            views = rendered_views(furnished_room(kind, seed), scale=1.0, views=N_VIEWS)
            size = (2 * views.depth.shape[2], 2 * views.depth.shape[1])
            masks = blurred_masks(views.instances, size, MASK_ERROR_PX, np.random.default_rng([seed, 41]))
            for row, depth in enumerate(views.depth):
                own = tuple(replace(one, view=0) for one in masks if one.view == row)
                yield Photograph(
                    "rendered rooms", (seed, number, row), size, 2 * float(views.intrinsics[row, 0, 0]), depth, own
                )


def office_photographs() -> Iterator[Photograph]:
    """Yield the images of `tum_office`, with the depths of its dense reconstruction."""
    folder = SHARED / "scenes" / "tum_office"
    scene, metres = read_scene(folder, "none"), read_truth(folder).scale or 1.0
    instances = read_instances(None, scene)
    for row, view in enumerate(scene.views):
        with np.load(folder / "depth" / f"{Path(view.name).stem}.npz") as maps:
            depth = maps["raw"].astype(np.float64)[1::2, 1::2] * metres
        own = tuple(replace(one, view=0) for one in instances if one.view == row)
        size = (view.camera.width, view.camera.height)
        yield Photograph("tum_office", (row,), size, view.camera.focal_px, np.where(depth > 0, depth, np.nan), own)


def network_depth(depth_m: FloatArray, generator: np.random.Generator) -> tuple[FloatArray, float]:
    """Return a map (h, w) with the errors of a network, and the true metres per unit of the map."""
    is_known = np.isfinite(depth_m)
    filled = np.log(np.where(is_known, depth_m, np.nanmedian(depth_m)))
    smooth = gaussian_filter(generator.normal(size=depth_m.shape), SMOOTH_PX)
    smooth *= SMOOTH_ERROR / max(float(smooth.std()), 1e-12)
    values = np.exp(gaussian_filter(filled, BLUR_PX) + smooth)
    values += OFFSET_ERROR * generator.normal() * np.median(values)
    factor = math.exp(SCALE_SD * generator.normal())
    return np.where(is_known & (values > 0), values * factor, np.nan), 1 / factor


def estimates(photographs: Iterator[Photograph], tree: Tree, is_exact: bool = False) -> Iterator[Estimate]:
    """Yield the estimates of each method on each photograph, perhaps with depths without simulated errors."""
    with tempfile.TemporaryDirectory() as name:
        image, file = Path(name) / "photo.png", Path(name) / "depth.npy"
        for photograph in photographs:
            generator = np.random.default_rng([7, *photograph.seed])
            values, truth = network_depth(photograph.depth_m, generator)
            values, truth = (photograph.depth_m, 1.0) if is_exact else (values, truth)
            cv2.imwrite(str(image), np.zeros(photograph.size[::-1], dtype=np.uint8))
            np.save(file, values)
            scene = read_photograph(image, file, focal_px=photograph.focal_px)
            for count in (*N_OBJECTS, len(photograph.instances)):
                if 0 < count <= len(photograph.instances):
                    chosen = generator.permutation(len(photograph.instances))[:count]
                    masks = tuple(photograph.instances[index] for index in sorted(chosen.tolist()))
                    yield from _estimates(replace(photograph, instances=masks), scene, values, truth, tree)


def _estimates(
    photograph: Photograph, scene: Scene, values: FloatArray, truth: float, tree: Tree
) -> Iterator[Estimate]:
    """Yield the estimates by objects, by the network with its map `values` (h, w), and by both."""
    options = EstimateOptions(level=LEVEL)
    estimate = estimate_scene(scene, tree, options, instances=InstanceSet(photograph.instances))
    assert estimate.measurements is not None
    evidence = MetricDepth(None, network_sd=SCALE_SD).observe(scene, estimate.measurements)
    both = scale_of_objects(estimate.measurements.objects, tree, replace(options, evidence=evidence))
    group = next(label for most, label in GROUPS if len(photograph.instances) <= most)
    half, error = math.sqrt(2) * erfinv(LEVEL) * SCALE_SD, -math.log(truth)
    ratios = distance_ratios(photograph, values)
    yield _estimate(photograph, group, "objects", estimate.result, truth, ratios)
    yield Estimate(photograph.source, group, "network", error, error - half, error + half, relative_accuracy(ratios))
    yield _estimate(photograph, group, "both", both, truth, ratios)


def _estimate(
    photograph: Photograph, group: str, method: str, result: ScaleResult, truth: float, ratios: FloatArray
) -> Estimate:
    if result.scale is None or result.interval is None:
        return Estimate(photograph.source, group, method, None)
    low, high = (math.log(end / truth) for end in (result.interval.low, result.interval.high))
    accuracy = relative_accuracy(ratios * result.scale)
    return Estimate(photograph.source, group, method, math.log(result.scale / truth), low, high, accuracy)


def distance_ratios(photograph: Photograph, values: FloatArray) -> FloatArray:
    """Return the mean distance of the pixels of each mask by a map (h, w), relative to the true one in metres (k,).

    The distances of a pixel by two maps have the ratio of its depths along the axis, up to the common ray.
    """
    height, width = values.shape
    rows, columns = np.indices((height, width)) + 0.5
    focal = photograph.focal_px * width / photograph.size[0]
    rays = np.sqrt(1 + ((columns - width / 2) ** 2 + (rows - height / 2) ** 2) / focal**2)
    ratios = []
    for one in photograph.instances:
        is_shown = np.zeros(photograph.size[::-1], dtype=bool)
        left, top = one.origin
        is_shown[top : top + one.mask.shape[0], left : left + one.mask.shape[1]] = one.mask
        inside = is_shown[1::2, 1::2] & np.isfinite(values) & np.isfinite(photograph.depth_m)
        if inside.any():
            ratios.append((values * rays)[inside].mean() / (photograph.depth_m * rays)[inside].mean())
    return np.array(ratios)


def relative_accuracy(ratios: FloatArray) -> float:
    """Return the fraction of pairs of an object and a threshold t whose relative error (k,) is below 1 - t."""
    return float((np.abs(ratios - 1)[:, None] < 1 - THRESHOLDS).mean()) if len(ratios) else 0.0


def table(rows: Sequence[Estimate]) -> str:
    """Return a Markdown table with a row for each source, number of objects and method."""
    groups: dict[tuple[str, str, str], list[Estimate]] = defaultdict(list)
    for one in rows:
        groups[one.source, one.group, one.method].append(one)
    figures = ["mean abs(ln)", "coverage", "width (ln)", "accuracy of distances"]
    lines = [table_head(["photographs", "masks", "scale by", "number", "refused", *figures])]
    order = [
        (source, label, method)
        for source in dict.fromkeys(one.source for one in rows)
        for _, label in GROUPS
        for method in METHODS
    ]
    for key in order:
        given = [one for one in groups[key] if one.error is not None]
        if not groups[key]:
            continue
        cells = [f"{value:.3g}" for value in _figures(given)] if given else ["–"] * 3
        cells.append(f"{np.mean([one.accuracy for one in groups[key]]):.2f}")
        lines.append(row_text([*key, len(groups[key]), len(groups[key]) - len(given), *cells]))
    return "\n".join(lines)


def _figures(rows: Sequence[Estimate]) -> tuple[float, float, float]:
    errors = np.array([one.error for one in rows], dtype=float)
    is_inside = [one.low <= 0 <= one.high for one in rows]
    return (
        float(np.abs(errors).mean()),
        float(np.mean(is_inside)),
        float(np.median([one.high - one.low for one in rows])),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and write it to the page."""
    options = _options(argv)
    tree = metric_tree.open()
    photographs = {"rooms": lambda: room_photographs(options.seeds), "office": office_photographs}
    rows = [row for source in options.sources for row in estimates(photographs[source](), tree, options.exact)]
    text = table(rows)
    print(text)
    if options.write:
        write_between(PAGE, "photographs", text)
    return 0


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3], help="seeds of the rooms")
    parser.add_argument("--sources", nargs="+", default=["rooms", "office"], choices=["rooms", "office"])
    parser.add_argument("--exact", action="store_true", help="depths without simulated errors")
    parser.add_argument("--write", action="store_true", help=f"write the table to {PAGE.name}")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
