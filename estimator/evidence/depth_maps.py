"""Estimate the scale from metric depth maps of a network, compared with the depths of the reconstruction.

Formats of the files: `estimator.scene_formats.depth_files`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import points_by_view
from estimator.records.network_outputs import (
    DEPTH_ANYTHING_3,
    MAX_TABLETOP_M,
    NETWORK_SD,
    NETWORKS,
    OTHER_NETWORK_SD,
    TABLETOP_SD,
)
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View
from estimator.scene_formats.depth_files import SUFFIXES, DepthMaps, read_depths
from metric_base.arrays import FloatArray, IntArray, evenly_spaced
from metric_base.errors import InputError, Unquoted
from metric_base.statistics import robust_sigma

KIND = "metric_depth"
#: Identifier of the evidence that a scene itself is in metres, and value of `--metric-depth` for it.
SCENE_NAME = "scene"
#: Prior standard deviation of the log scale of one image: a random effect whose variance is estimated from the images.
#: It is replaced by the relative error that the network states, if any.
FRAME_SD = 0.1
#: Weight of this prior, in images.
FRAME_PRIOR_COUNT = 3
#: Focal length in pixels for which a network's depths are metric: the depth is value * focal length of the map / this
#: number. It is 300 for the metric model of Depth Anything 3 and 1000 for Metric3D.
FOCAL_UNITS = {"da3": 300.0, "metric3d": 1000.0}
#: Minimum number of points with a depth in the map for the median of a view.
MIN_POINTS = 20
#: Maximum number of points for this median.
MAX_POINTS = 5000


@dataclass(frozen=True, slots=True)
class MetricDepth:
    """A folder of depth maps with the names of the images, or the scene of a network itself, in metres."""

    folder: Path | None  #: None if the units of the scene are metres by its network.
    png_metres: float = 0.001  #: Metres per unit of a PNG.
    unit: str = "metres"  #: Or one of `FOCAL_UNITS`.
    #: Standard deviation of the log scale that all images share; by default that of the network, see `network_sd`.
    network_sd: float | None = None

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the median over the views of their median ratio; skipped without maps of the views."""
        observed = _with_observations(scene)
        if self.folder is None:
            self._check_metric(scene)
            name, ratios, networks, stated = SCENE_NAME, np.log([scene.file_units]), {""}, list[float]()
        elif not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        else:
            maps = list(self._maps(observed))
            by_view = [view_log_ratio(view, observed, depth) for view, depth, _ in maps]
            stated = [one.relative_error for _, _, one in maps if one.relative_error is not None]
            name, ratios = self.folder.name, np.array([ratio for ratio in by_view if ratio is not None])
            networks = {one.network for _, _, one in maps}
        if not len(ratios):
            return skipped_evidence(KIND, name, "no depth map has the name of a view and points in it")
        scale = math.exp(float(np.median(ratios)))
        sd_network = self.network_sd or network_sd(networks, scale * _median_depth(observed))
        sd_log = math.hypot(
            frame_sd(ratios, float(np.median(stated)) if stated else FRAME_SD) / math.sqrt(len(ratios)), sd_network
        )
        return (ScaleEvidence(KIND, name, scale, sd_log),)

    def _check_metric(self, scene: Scene) -> None:
        """Raise InputError unless the network of a scene, or the user, states that its units are metres.

        The files of most networks do not show whether a metric model wrote them: its error must be named.
        """
        is_metric = next((one.is_metric for one in NETWORKS if one.network == scene.network), None)
        is_stated = self.network_sd is not None or scene.format == "photograph"
        if is_metric or (is_metric is None and is_stated):
            return
        names = ", ".join(one.network for one in NETWORKS if one.is_metric)
        expected = f"the output of a metric network ({names}), or of another metric model and its --depth-error"
        found = f"{scene.network}, whose units are normalised" if is_metric is False else scene.network or scene.format
        raise InputError.at(scene.path, "--metric-depth scene", expected, Unquoted(found))

    def _maps(self, scene: Scene) -> Iterator[tuple[View, FloatArray, DepthMaps]]:
        """Yield the views that have a map, with their depths (h, w) in metres and the maps of the file."""
        assert self.folder is not None
        files = [map_file(self.folder, view.name) for view in scene.views]
        stack = next((self.folder / name for name in DEPTH_ANYTHING_3.files if (self.folder / name).is_file()), None)
        if stack is not None and not any(files):
            views, maps = sorted(scene.views, key=lambda view: view.name), read_depths(stack, self.png_metres)
            if len(maps.values) != len(views):
                raise InputError.at(stack, "maps", f"one for each of the {len(views)} views", len(maps.values))
            for row, view in enumerate(views):
                yield view, self._metres(view, maps, row), maps
            return
        for view, file in zip(scene.views, files, strict=True):
            if file is not None:
                maps = read_depths(file, self.png_metres)
                if len(maps.values) != 1:
                    raise InputError.at(file, "shape", "(h, w), one channel", maps.values.shape)
                yield view, self._metres(view, maps, 0), maps

    def _metres(self, view: View, maps: DepthMaps, row: int) -> FloatArray:
        """Return a map (h, w) in metres, by the focal length in the file or, by default, of the camera of the view."""
        values = np.asarray(maps.values[row])
        if self.unit == "metres":
            return values
        # The first parameter of every camera model is a focal length in pixels.
        focal = view.camera.focal_px * values.shape[1] / view.camera.width
        if maps.focal is not None and len(maps.focal) in {1, len(maps.values)}:
            focal = float(maps.focal[row % len(maps.focal)])
        return np.asarray(values * (focal / FOCAL_UNITS[self.unit]))


def network_sd(networks: Collection[str], median_depth_m: float) -> float:
    """Return the standard deviation of the log scale of networks, for a scene of this median depth in metres."""
    widest = max(NETWORK_SD.get(network, OTHER_NETWORK_SD) for network in networks)
    return TABLETOP_SD if median_depth_m < MAX_TABLETOP_M else widest


def _median_depth(scene: Scene) -> float:
    """Return the median over the views of the median depth of their points, in scene units; infinite without points."""
    medians = []
    for view in scene.views:
        depths = view.to_camera(scene.points[_seen_rows(view, scene)])[:, 2]
        medians += [float(np.median(depths[depths > 0]))] * bool((depths > 0).any())
    return float(np.median(medians)) if medians else math.inf


def _seen_rows(view: View, scene: Scene) -> IntArray:
    """Return the rows (k,) of the points that a view observed, at most `MAX_POINTS`; of all without observations."""
    return evenly_spaced(view.point_index if len(view.point_index) else np.arange(len(scene.points)), MAX_POINTS)


def _with_observations(scene: Scene) -> Scene:
    """Return the scene with the points of its cloud as observed points, if it has no others."""
    if len(scene.points) or scene.dense is None:
        return scene
    points = scene.dense.points
    rows = points_by_view(scene.dense, len(scene.views)) or [np.arange(len(points))] * len(scene.views)
    views = (
        replace(view, keypoints=np.zeros((len(seen), 2)), point_index=seen)
        for view, seen in zip(scene.views, rows, strict=True)
    )
    return replace(scene, points=points, views=tuple(views))


def frame_sd(ratios: FloatArray, prior_sd: float = FRAME_SD) -> float:
    """Return the standard deviation of the log ratios (n,) of the images, shrunk towards that of the prior."""
    sigma = robust_sigma(ratios) if len(ratios) > 1 else 0.0
    freedom = len(ratios) - 1
    return math.sqrt((freedom * sigma**2 + FRAME_PRIOR_COUNT * prior_sd**2) / (freedom + FRAME_PRIOR_COUNT))


def map_file(folder: Path, name: str) -> Path | None:
    """Find the map of a view: for `a/b.jpg`, `a/b.npy` or `b.npy`, `b_depth.npy`, or `b/depth.exr`."""
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts:
        relative = PurePosixPath(relative.name)
    stems = [folder / relative.with_suffix(""), folder / relative.stem]
    paths = [path for stem in stems for path in (stem, stem.with_name(f"{stem.name}_depth"), stem / "depth")]
    files = (path.with_name(path.name + suffix) for path in paths for suffix in SUFFIXES)
    return next((file for file in files if file.is_file()), None)


def view_log_ratio(view: View, scene: Scene, depth: FloatArray) -> float | None:
    """Return the median of ln(metres / units) over the points of a view, by its depth map (h, w).

    None if fewer than `MIN_POINTS` have a depth.
    """
    pixels, depths = pixels_in_view(view, scene.points[_seen_rows(view, scene)])
    height, width = depth.shape
    with np.errstate(invalid="ignore"):
        column = np.floor(pixels[:, 0] * width / view.camera.width)
        row = np.floor(pixels[:, 1] * height / view.camera.height)
        inside = (depths > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    metres = depth[row[inside].astype(int), column[inside].astype(int)]
    is_valid = np.isfinite(metres) & (metres > 0)
    if np.count_nonzero(is_valid) < MIN_POINTS:
        return None
    return float(np.median(np.log(metres[is_valid] / depths[inside][is_valid])))
