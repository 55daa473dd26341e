"""Estimate the scale from metric depth maps of a network, compared with the depths of the reconstruction.

Formats of the files: `estimator.scene_formats.depth_files`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.projection.cameras import pixels_in_view
from estimator.records.network_outputs import DEPTH_ANYTHING_3
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View
from estimator.scene_formats.depth_files import SUFFIXES, DepthMaps, read_depths
from metric_base.arrays import FloatArray, evenly_spaced
from metric_base.errors import InputError
from metric_base.statistics import robust_sigma

KIND = "metric_depth"
#: Standard deviation of the log scale of a network that all images share, in scenes unlike its training data: reports
#: of users range from a few per cent to a factor of two; VGGT with MoGe-2 is typically within 10 to 20 %.
NETWORK_SD = 0.15
#: Prior standard deviation of the log scale of one image: a random effect whose variance is estimated from the images.
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
    """A folder of depth maps with the names of the images."""

    folder: Path
    png_metres: float = 0.001  #: Metres per unit of a PNG.
    unit: str = "metres"  #: Or one of `FOCAL_UNITS`.
    network_sd: float = NETWORK_SD  #: Standard deviation of the log scale of the network, which all images share.

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the median over the views of their median ratio; skipped without maps of the views."""
        if not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        by_view = [view_log_ratio(view, scene, depth) for view, depth in self._maps(scene)]
        ratios = np.array([ratio for ratio in by_view if ratio is not None])
        if not len(ratios):
            return skipped_evidence(KIND, self.folder.name, "no depth map has the name of a view and points in it")
        sd_log = math.hypot(frame_sd(ratios) / math.sqrt(len(ratios)), self.network_sd)
        return (ScaleEvidence(KIND, self.folder.name, math.exp(float(np.median(ratios))), sd_log),)

    def _maps(self, scene: Scene) -> Iterator[tuple[View, FloatArray]]:
        """Yield the views that have a map, with their depths (h, w) in metres."""
        files = [_file(self.folder, view.name) for view in scene.views]
        stack = next((self.folder / name for name in DEPTH_ANYTHING_3.files if (self.folder / name).is_file()), None)
        if stack is not None and not any(files):
            views, maps = sorted(scene.views, key=lambda view: view.name), read_depths(stack, self.png_metres)
            if len(maps.values) != len(views):
                raise InputError.at(stack, "maps", f"one for each of the {len(views)} views", len(maps.values))
            for row, view in enumerate(views):
                yield view, self._metres(view, maps, row)
            return
        for view, file in zip(scene.views, files, strict=True):
            if file is not None:
                maps = read_depths(file, self.png_metres)
                if len(maps.values) != 1:
                    raise InputError.at(file, "shape", "(h, w), one channel", maps.values.shape)
                yield view, self._metres(view, maps, 0)

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


def frame_sd(ratios: FloatArray) -> float:
    """Return the standard deviation of the log ratios (n,) of the images, shrunk towards `FRAME_SD`."""
    sigma = robust_sigma(ratios) if len(ratios) > 1 else 0.0
    freedom = len(ratios) - 1
    return math.sqrt((freedom * sigma**2 + FRAME_PRIOR_COUNT * FRAME_SD**2) / (freedom + FRAME_PRIOR_COUNT))


def _file(folder: Path, name: str) -> Path | None:
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
    rows = view.point_index if len(view.point_index) else np.arange(len(scene.points))
    rows = evenly_spaced(rows, MAX_POINTS)
    pixels, depths = pixels_in_view(view, scene.points[rows])
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
