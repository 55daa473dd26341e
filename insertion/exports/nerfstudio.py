"""Write `transforms.json` of nerfstudio: the cameras in metres with +z up, and the points of the scene."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS
from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKeyframe, keyframes_by_camera
from insertion.scene.camera_rays import focal_lengths
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: Name in nerfstudio of each camera model of COLMAP that it supports.
_MODELS = {
    "SIMPLE_PINHOLE": "PINHOLE", "PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "OPENCV", "RADIAL": "OPENCV", "OPENCV": "OPENCV",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE", "RADIAL_FISHEYE": "OPENCV_FISHEYE",
}  # fmt: skip
#: Rotation from +y up to +z up.
_TURN = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
POINTS_FILE = "sparse_pc.ply"


def write_transforms(file: Path, keys: Sequence[CameraKeyframe], pictures: str, points: FloatArray) -> None:
    """Write the file, and the points (n, 3) in the metric frame as `sparse_pc.ply` next to it.

    Parameters
    ----------
    pictures : str
        Folder of the images, relative to that of the file.

    Raises
    ------
    InputError
        nerfstudio does not support a camera model.

    Notes
    -----
    The centre of the first pixel is (0.5, 0.5), as in COLMAP (issue 3048 of nerfstudio).
    """
    lenses = keyframes_by_camera(keys)
    for camera, _ in lenses:
        if camera.model not in _MODELS:
            raise InputError(f"--export: transforms.json: expected one of {', '.join(_MODELS)}; found {camera.model}")
    has_one_camera = len(lenses) == 1
    document: dict[str, Any] = {
        **(_intrinsics(lenses[0][0]) if has_one_camera else {"camera_model": _MODELS[lenses[0][0].model]}),
        "ply_file_path": POINTS_FILE,
        "frames": [
            {
                "file_path": f"{pictures}/{key.name}",
                "transform_matrix": (_TURN @ key.matrix).tolist(),
                "time_s": key.time_s,
                **({} if has_one_camera else _intrinsics(key.camera)),
            }
            for key in keys
        ],
    }
    file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    turned = points @ _TURN[:3, :3].T
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(turned)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file.with_name(POINTS_FILE).write_bytes(header.encode() + np.ascontiguousarray(turned, "<f4").tobytes())


def _intrinsics(camera: Camera) -> dict[str, Any]:
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params.tolist(), strict=True))
    fx, fy, cx, cy = focal_lengths(camera)
    lens: dict[str, Any] = {name: values[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2") if name in values}
    if "k" in values:
        lens["k1"] = values["k"]
    return {
        "camera_model": _MODELS[camera.model],
        "w": camera.width, "h": camera.height,
        "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        **lens,
    }  # fmt: skip
