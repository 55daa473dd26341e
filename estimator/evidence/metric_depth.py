"""Depth maps in metres that a network made, against the reconstruction's own depths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.depth_files import SUFFIXES, read_depth
from estimator.evidence.source import silent
from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["MetricDepth"]

KIND = "metric_depth"

#: What a network's metres are worth in a scene unlike those it learned from, natural log, all maps alike: reports of
#: users range from a few per cent to a factor of two, VGGT with MoGe-2 is said to be typically within 10 to 20 %.
NETWORK_SD = 0.15

#: Points with a depth in the map that give the median of a view, at least and at most.
LEAST_POINTS, MOST_POINTS = 20, 5000


@dataclass(frozen=True, slots=True)
class MetricDepth:
    """A folder of depth maps, named as the pictures: `.npy` or `.pfm` in metres, `.png` of 16 bits.

    png_metres : metres of one step of a PNG.
    """

    folder: Path
    png_metres: float = 0.001

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The median over views of each view's median ratio; silent without maps of its views."""
        if not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        ratios = []
        for view in scene.views:
            file = _file(self.folder, view.name)
            if file is not None and (ratio := _log_ratio(view, scene, read_depth(file, self.png_metres))) is not None:
                ratios.append(ratio)
        if not ratios:
            return silent(KIND, self.folder.name, "no depth map has the name of a view and points in it")
        middle = float(np.median(ratios))
        spread = robust_sigma(np.array(ratios)) / math.sqrt(len(ratios))
        return (ScaleEvidence(KIND, self.folder.name, math.exp(middle), math.hypot(spread, NETWORK_SD)),)


def _file(folder: Path, name: str) -> Path | None:
    """The view's map: `a/b.jpg` is `a/b.npy`, else `b.npy`."""
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts:
        relative = PurePosixPath(relative.name)
    stems = (folder / relative, folder / relative.name)
    return next((file for stem in stems for suffix in SUFFIXES if (file := stem.with_suffix(suffix)).is_file()), None)


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
