"""nerfstudio's `transforms.json`: the cameras at metric scale, +z up, with the scene's points beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS
from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKeyframe, keyframes_by_camera
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: COLMAP's models that nerfstudio reads, by its own name for them.
_MODELS = {
    "SIMPLE_PINHOLE": "PINHOLE", "PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV", "RADIAL": "OPENCV", "OPENCV": "OPENCV",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE", "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}  # fmt: skip
#: From +y up to +z up.
_TURN = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
POINTS_FILE = "sparse_pc.ply"


def write_transforms(file: Path, keys: Sequence[CameraKeyframe], pictures: str, points: FloatArray) -> None:
    """Write the file, and the points (n, 3) of the metric frame as `sparse_pc.ply` beside it.

    pictures : folder of the pictures, relative to it. nerfstudio counts pixels as COLMAP does: the centre of the first
    is (0.5, 0.5) (its issue 3048). Raises InputError for a camera that it does not know.
    """
    lenses = keyframes_by_camera(keys)
    for camera, _ in lenses:
        if camera.model not in _MODELS:
            raise InputError(f"--export: transforms.json: expected one of {', '.join(_MODELS)}; found {camera.model}")
    alone = len(lenses) == 1
    document: dict[str, Any] = {
        **(_intrinsics(lenses[0][0]) if alone else {"camera_model": _MODELS[lenses[0][0].model]}),
        "ply_file_path": POINTS_FILE,
        "frames": [
            {
                "file_path": f"{pictures}/{key.name}",
                "transform_matrix": (_TURN @ key.matrix).tolist(),
                "time_s": key.time_s,
                **({} if alone else _intrinsics(key.camera)),
            }
            for key in keys
        ],
    }
    file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    _write_points(file.with_name(POINTS_FILE), points @ _TURN[:3, :3].T)


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
        "cx": values["cx"], "cy": values["cy"],
        **lens,
    }  # fmt: skip


def _write_points(file: Path, points: FloatArray) -> None:
    """A binary PLY of (n, 3) points."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    file.write_bytes(header.encode() + b"end_header\n" + np.ascontiguousarray(points, "<f4").tobytes())
