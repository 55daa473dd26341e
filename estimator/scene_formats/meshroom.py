"""Read `.sfm` files of Meshroom and AliceVision (JSON): views, intrinsics, poses, and the structure with observations.

`rotation` is the rotation from world to camera, by columns. The principal point is relative to the centre of the image
since version 1.2.1 of the format, and to its corner before.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import MAX_COORDINATE, Camera, Scene, View, observed_views
from estimator.scene_formats.common import pinhole_camera, posed_view, read_point_file
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, at_field, expect, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_name, json_object, json_records, matrix_of, number_of

#: First version in which the principal point is relative to the centre (AliceVision, changelog of SfmDataIO).
CENTRED_VERSION = (1, 2, 1)
#: Distortion models of AliceVision, by the names of its versions, with the corresponding parameters of OpenCV.
MODELS = {
    "pinhole": (), "none": (), "radial1": ("k1",), "radialk1": ("k1",), "radial3": ("k1", "k2", "k3"),
    "radialk3": ("k1", "k2", "k3"), "brown": ("k1", "k2", "k3", "p1", "p2"),
}  # fmt: skip
FISHEYES = ("fisheye4", "equidistant")
#: Point clouds for files without points, such as `cameras.sfm`.
PLY_FILES = ("points.ply", "cloud_and_poses.ply")


def read_meshroom(file: Path) -> Scene:
    """Read an `.sfm` file; views without a pose are omitted.

    Raises
    ------
    InputError
        The file is damaged, or COLMAP has no model for a lens.
    """
    with in_file(file):
        document = json_object(read_json(file))
        version = document.get("version")
        try:
            numbers = tuple(int(part) for part in version) if isinstance(version, list) else (0,)
        except (TypeError, ValueError):
            raise FieldError("version", "three numbers", version) from None
        cameras = {}
        for entry in _entries(document, "intrinsics"):
            with at_field(f"intrinsic {entry.get('intrinsicId')}"):
                cameras[str(entry.get("intrinsicId"))] = _camera(entry, numbers >= CENTRED_VERSION)
        poses = {str(entry.get("poseId")): entry for entry in _entries(document, "poses")}
        views: list[View] = []
        row_of: dict[str, int] = {}
        for entry in _entries(document, "views"):
            pose = poses.get(str(entry.get("poseId", entry.get("viewId"))))
            if pose is not None:
                with at_field(f"view {entry.get('viewId')}"):
                    row_of[str(entry.get("viewId"))] = len(views)
                    camera = cameras.get(str(entry.get("intrinsicId")))
                    if camera is None:
                        raise FieldError("intrinsicId", "an intrinsic of the file", entry.get("intrinsicId"))
                    transform = json_object(json_object(pose.get("pose"), "pose").get("transform"), "pose transform")
                    rotation = matrix_of(transform.get("rotation"), (3, 3), "rotation").T  # column by column
                    name = json_name(entry.get("path"), "path")
                    centre = matrix_of(transform.get("center"), (3,), "center")
                    views.append(posed_view(name.replace("\\", "/").rpartition("/")[2], camera, rotation, centre))
        expect(views, "poses", "at least one view with a pose", 0)
        landmarks = _entries(document, "structure") if "structure" in document else []
        points = matrix_of([entry.get("X") for entry in landmarks], (len(landmarks), 3), "structure X")
        points = points if len(points) else read_point_file(file, PLY_FILES)
        observations = _observations(landmarks, row_of)
    points = np.clip(points, -MAX_COORDINATE / 2, MAX_COORDINATE / 2)
    rows, point_rows = observations[:, 0].astype(np.int64), observations[:, 1].astype(np.int64)
    observed = observed_views(views, rows, point_rows, observations[:, 2:])
    return Scene(file.parent, "meshroom", observed, points, model_path=file.parent)


def _entries(document: dict[str, Any], part: str) -> list[dict[str, Any]]:
    """Return the objects of an array of the document."""
    return [entry for _, entry in json_records(document.get(part), part)]


def _camera(entry: dict[str, Any], is_centred: bool) -> Camera:
    """Return the camera of an intrinsic; `is_centred` refers to its principal point."""
    size = (round(number_of(entry, "width")), round(number_of(entry, "height")))
    if "pxFocalLength" in entry:
        value = entry["pxFocalLength"]
        focal = matrix_of(value if isinstance(value, list) else [value, value], (2,), "pxFocalLength")
    else:
        focal_mm, ratio = number_of(entry, "focalLength"), number_of(entry, "pixelRatio", 1.0)
        sensor_mm = number_of(entry, "sensorWidth")
        expect(sensor_mm > 0, "sensorWidth", "millimetres above 0", sensor_mm)
        focal_x = focal_mm * size[0] / sensor_mm
        focal = np.array([focal_x, focal_x * ratio])
    centre = matrix_of(
        entry.get("principalPoint", [0, 0] if is_centred else [side / 2 for side in size]), (2,), "principalPoint"
    )
    centre = centre + np.array(size) / 2 if is_centred else centre
    kind = str(entry.get("distortionType") or entry.get("type", "pinhole")).lower()
    params = entry.get("distortionParams") or []
    values = matrix_of(params, (len(params) if isinstance(params, list) else 0,), "distortionParams").tolist()
    if kind in FISHEYES and len(values) == 4:
        return make_camera("OPENCV_FISHEYE", size, [*focal, *centre, *values])
    if kind not in MODELS or len(values) > len(MODELS[kind]):
        raise FieldError("type", f"one of {', '.join((*MODELS, *FISHEYES))}", kind)
    names = MODELS[kind]
    return pinhole_camera(size, (focal[0], focal[1]), (centre[0], centre[1]), dict(zip(names, values, strict=False)))


def _observations(landmarks: list[dict[str, Any]], row_of: dict[str, int]) -> FloatArray:
    """Return view, point, x, y (m, 4) of the observations in views with a pose."""
    rows = []
    for point, entry in enumerate(landmarks):
        for observation in entry.get("observations") or []:
            with at_field(f"structure[{point}]"):
                view = row_of.get(str(json_object(observation, "observations").get("observationId")))
                if view is not None:
                    rows.append((view, point, *matrix_of(observation.get("x"), (2,), "x").tolist()))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
