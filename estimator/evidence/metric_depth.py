"""Depth maps in metres that a network made, against the reconstruction's own depths."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.depth_files import SUFFIXES, DepthMaps, read_depths
from estimator.evidence.source import silent
from estimator.projection.cameras import pixels_in_view
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["FOCAL_UNITS", "MetricDepth", "frame_sd"]

KIND = "metric_depth"

#: What a network's metres are worth in a scene unlike those it learned from, natural log, all maps alike: reports of
#: users range from a few per cent to a factor of two, VGGT with MoGe-2 is said to be typically within 10 to 20 %.
NETWORK_SD = 0.15

#: A network's scale differs from picture to picture besides: a random effect, whose spread is learned from the
#: pictures, with so many pictures' worth of belief in this standard deviation of ln scale before any is seen.
FRAME_SD, FRAME_WORTH = 0.1, 3

#: What a value is: metres, or a focal length in pixels of the map times the value over this number. Depth Anything 3's
#: metric model is made for a focal length of 300 pixels, Metric3D's for one of 1000.
FOCAL_UNITS = {"da3": 300.0, "metric3d": 1000.0}

#: Names of a file with the maps of all views, in the order of their names, as Depth Anything 3 exports it.
STACKS = ("results.npz", "exports/npz/results.npz", "exports/mini_npz/results.npz")

#: Points with a depth in the map that give the median of a view, at least and at most.
LEAST_POINTS, MOST_POINTS = 20, 5000


@dataclass(frozen=True, slots=True)
class MetricDepth:
    """A folder of depth maps, named as the pictures (`depth_files` says in which forms).

    png_metres : metres of one step of a PNG; unit : `metres`, or one of `FOCAL_UNITS`; network_sd : what the network's
    metres are worth, one standard deviation of ln scale, all pictures alike.
    """

    folder: Path
    png_metres: float = 0.001
    unit: str = "metres"
    network_sd: float = NETWORK_SD

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The median over views of each view's median ratio; silent without maps of its views."""
        if not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        seen = [_log_ratio(view, scene, depth) for view, depth in self._maps(scene)]
        ratios = np.array([ratio for ratio in seen if ratio is not None])
        if not len(ratios):
            return silent(KIND, self.folder.name, "no depth map has the name of a view and points in it")
        middle = float(np.median(ratios))
        spread = math.hypot(frame_sd(ratios) / math.sqrt(len(ratios)), self.network_sd)
        return (ScaleEvidence(KIND, self.folder.name, math.exp(middle), spread),)

    def _maps(self, scene: Scene) -> Iterator[tuple[View, FloatArray]]:
        """The views that have a map, each with its metres (h, w)."""
        files = [_file(self.folder, view.name) for view in scene.views]
        stack = next((self.folder / name for name in STACKS if (self.folder / name).is_file()), None)
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
        """(h, w) metres of one of the maps. The focal length is the file's own, else that of the view's camera."""
        values = np.asarray(maps.values[row])
        if self.unit == "metres":
            return values
        # the first parameter of every camera model is a focal length in pixels
        focal = float(view.camera.params[0]) * values.shape[1] / view.camera.width
        if maps.focal is not None and len(maps.focal) in {1, len(maps.values)}:
            focal = float(maps.focal[row % len(maps.focal)])
        return np.asarray(values * (focal / FOCAL_UNITS[self.unit]))


def frame_sd(ratios: FloatArray) -> float:
    """The standard deviation of the pictures' own scales from their log ratios (n,), shrunk to what is usual."""
    own = robust_sigma(ratios) if len(ratios) > 1 else 0.0
    seen = len(ratios) - 1
    return math.sqrt((seen * own**2 + FRAME_WORTH * FRAME_SD**2) / (seen + FRAME_WORTH))


def _file(folder: Path, name: str) -> Path | None:
    """The view's map: `a/b.jpg` is `a/b.npy`, else `b.npy`; or `b_depth.npy`, or `b/depth.exr`."""
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts:
        relative = PurePosixPath(relative.name)
    stems = [folder / relative.with_suffix(""), folder / relative.stem]
    places = [place for stem in stems for place in (stem, stem.with_name(f"{stem.name}_depth"), stem / "depth")]
    files = (place.with_name(place.name + suffix) for place in places for suffix in SUFFIXES)
    return next((file for file in files if file.is_file()), None)


def _log_ratio(view: View, scene: Scene, depth: FloatArray) -> float | None:
    """Median ln(metres / units) over a view's points by its depth (h, w); None if too few are seen."""
    rows = view.point_index if len(view.point_index) else np.arange(len(scene.points))
    rows = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
    pixels, depths = pixels_in_view(view, scene.points[rows])
    height, width = depth.shape
    with np.errstate(invalid="ignore"):
        column = np.floor(pixels[:, 0] * width / view.camera.width)
        line = np.floor(pixels[:, 1] * height / view.camera.height)
        inside = (depths > 0) & (column >= 0) & (column < width) & (line >= 0) & (line < height)
    metres = depth[line[inside].astype(int), column[inside].astype(int)]
    good = np.isfinite(metres) & (metres > 0)
    if np.count_nonzero(good) < LEAST_POINTS:
        return None
    return float(np.median(np.log(metres[good] / depths[inside][good])))
