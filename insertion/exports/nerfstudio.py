"""nerfstudio's `transforms.json`: the cameras at metric scale, +z up."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.reconstructions.cameras import CAMERA_MODELS
from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKey
from metric_base.arrays import FloatArray
from metric_base.faults import InputFault

__all__ = ["write_transforms"]

#: COLMAP's models that nerfstudio reads, by its own name for them.
_MODELS = {
    "SIMPLE_PINHOLE": "PINHOLE", "PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV", "RADIAL": "OPENCV", "OPENCV": "OPENCV",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE", "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}  # fmt: skip


def write_transforms(file: Path, keys: Sequence[CameraKey], camera: Camera, pictures: str) -> None:
    """Write the file. pictures : folder of the pictures, relative to it.

    nerfstudio counts pixels as COLMAP's `cx`, `cy` do not: the centre of its first pixel is (0, 0), so half a pixel is
    taken off. Raises InputFault for a camera that it does not know.
    """
    if camera.model not in _MODELS:
        raise InputFault(f"--export: transforms.json: expected one of {', '.join(_MODELS)}; found {camera.model}")
    # from +y up to +z up
    turn = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
    document = _intrinsics(camera) | {
        "metres_per_unit": 1.0,
        "frames": [
            {
                "file_path": f"{pictures}/{key.name}",
                "transform_matrix": (turn @ key.matrix).tolist(),
                "time_s": key.time_s,
            }
            for key in keys
        ],
    }
    file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _frame(key: CameraKey, matrix: FloatArray, pictures: str) -> dict[str, Any]:
    """One frame with its pose, camera to world (4, 4)."""
    return {"file_path": f"{pictures}/{key.name}", "transform_matrix": matrix.tolist(), "time_s": key.time_s}


def _intrinsics(camera: Camera) -> dict[str, Any]:
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params.tolist(), strict=True))
    focal = values.get("f", 0.0)
    lens: dict[str, Any] = {name: values[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2") if name in values}
    if "k" in values:
        lens["k1"] = values["k"]
    return {
        "camera_model": _MODELS[camera.model],
        "w": camera.width, "h": camera.height,
        "fl_x": values.get("fx", focal), "fl_y": values.get("fy", focal),
        "cx": values["cx"] - 0.5, "cy": values["cy"] - 0.5,
        **lens,
    }  # fmt: skip
