"""Views as ideal cameras: their pictures without the lens's distortion, at the size that depth is computed in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted

__all__ = ["PinholeView", "pinhole_view"]

#: Longer side in pixels.
SIDE = 640


@dataclass(frozen=True, slots=True, eq=False)
class PinholeView:
    """grey : (h, w) grey levels; colour : (h, w, 3) RGB; matrix : (3, 3) K for OpenCV's pixels; pose as of a `View`."""

    grey: NDArray[np.float32]
    colour: NDArray[np.uint8]
    matrix: FloatArray
    rotation: FloatArray
    translation: FloatArray


def pinhole_view(view: View, pictures: Path) -> PinholeView:
    """The view with the picture of its name in a folder, undistorted by COLMAP's own camera.

    Raises
    ------
    InputError
        The picture cannot be read.
    """
    import cv2

    camera = view.camera
    picture = cv2.imread(str(pictures / view.name), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if picture is None:
        raise InputError.at(pictures / view.name, "picture", "a picture that OpenCV reads", Unquoted("none"))
    factor = min(1.0, SIDE / max(camera.width, camera.height))
    width, height = round(camera.width * factor), round(camera.height * factor)
    focal = float(camera.params[0]) * factor
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.column_stack([(x.ravel() + 0.5 - width / 2) / focal, (y.ravel() + 0.5 - height / 2) / focal])
    pixels = project(camera, np.column_stack([rays, np.ones(len(rays))])) - 0.5
    # the picture may be of another size than its camera
    pixels *= [picture.shape[1] / camera.width, picture.shape[0] / camera.height]
    across = np.nan_to_num(pixels, nan=-1e4).reshape(height, width, 2).astype(np.float32)
    colour = cv2.cvtColor(cv2.remap(picture, across, None, cv2.INTER_LINEAR), cv2.COLOR_BGR2RGB)
    matrix = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1.0]])
    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return PinholeView(grey, np.asarray(colour, dtype=np.uint8), matrix, view.rotation, view.translation)
