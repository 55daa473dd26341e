"""What filling plain surfaces adds to the depth of a view, and how true it is.

`python -m benchmarks.insertion.plain_surfaces`: synthetic rooms whose textures are faint, five views with true poses;
printed for the middle one: the share of pixels with
swept and with filled depth, and the median, the 90th percentile and the share above 2 % of their errors.
"""

from __future__ import annotations

import cv2
import numpy as np

from estimator.capture.dense.pinhole_views import PinholeView
from estimator.capture.dense.plane_filling import fill_planes
from estimator.capture.dense.plane_sweep import swept_depth
from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.videos import Lens, SyntheticFrame, orbit, recorded, room

__all__ = ["main"]

LENS = Lens(480, 360, 375.0)
#: Kind, seed and contrast of the textures.
ROOMS = (("sitting room", 7, 1.0), ("sitting room", 7, 0.15), ("kitchen", 1010, 0.15), ("bedroom", 4, 0.05))


def main() -> None:
    """Print a row for each room."""
    for kind, seed, texture in ROOMS:
        world = room(kind, seed, orbit(2.0, 5, seed, degrees=22.0))
        frames = list(recorded(world, LENS, texture=texture))
        views = [_view(frame) for frame in frames]
        swept = swept_depth(views[2], [views[k] for k in (0, 1, 3, 4)], 0.8, 7.0)
        filled = fill_planes(swept, views[2].grey)
        known, new = np.isfinite(swept), np.isfinite(filled) & ~np.isfinite(swept)
        error = np.abs(filled / frames[2].depth - 1)
        print(f"| {kind}, texture {texture:g} | {_cells(known, error)} | {_cells(new, error)} |", flush=True)


def _view(frame: SyntheticFrame) -> PinholeView:
    matrix = np.array([[LENS.focal, 0, LENS.width / 2 - 0.5], [0, LENS.focal, LENS.height / 2 - 0.5], [0, 0, 1.0]])
    grey = cv2.cvtColor(frame.colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return PinholeView(grey, frame.colour, matrix, frame.pose.rotation, frame.pose.translation)


def _cells(chosen: BoolArray, error: FloatArray) -> str:
    """Share of the pixels (h, w) that are chosen, and figures of their errors (h, w)."""
    some = error[chosen]
    low, high = np.quantile(some, [0.5, 0.9])
    return f"{chosen.mean():.0%} | {low:.2%} | {high:.2%} | {(some > 0.02).mean():.1%}"


if __name__ == "__main__":
    main()
