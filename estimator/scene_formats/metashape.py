"""Read cameras of Agisoft Metashape (File, Export, Export Cameras, Agisoft XML), with points in a PLY file.

The `transform` of a camera leads from the camera, with the axes right, down, forward, to its component. The transform
of the component leads to the chunk, whose frame exported points have. p1 and p2 of Metashape are p2 and p1 of OpenCV
(manual, appendix "Camera models").
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import Camera, Scene, View
from estimator.scene_formats.common import brown_camera, posed_view, read_point_file
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.input_files import read_text
from metric_base.parsing import matrix_of

PLY_FILES = ("points.ply", "sparse_pc.ply", "sparse.ply", "tie_points.ply", "point_cloud.ply")
#: Names of the equidistant fisheye model in versions 1 and 2.
FISHEYES = ("fisheye", "equidistant_fisheye")
#: Maximum skew relative to the focal length, which is a pixel or two; it is ignored, because COLMAP has no skew.
MAX_SKEW = 1e-3
#: Maximum size of a file, in bytes; a camera needs a kilobyte.
MAX_BYTES = 1 << 28


def read_metashape(file: Path) -> Scene:
    """Read a camera file; cameras that are not aligned are omitted.

    Raises
    ------
    InputError
        The file is damaged or of another kind, or COLMAP has no model for a lens.
    """
    with in_file(file):
        text = read_text(file, MAX_BYTES)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise FieldError("XML", "a document without entities", Unquoted("a DOCTYPE"))
        with damage_as_field_error("a valid document", (ET.ParseError, ValueError), str, field="XML"):
            chunk = ET.fromstring(text).find("chunk")  # noqa: S314 - the document has no entities
        if chunk is None:
            raise FieldError("document", "a chunk with cameras", None)
        sensors = {sensor.get("id", ""): sensor for sensor in chunk.iterfind("sensors/sensor")}
        common = _transform(chunk.find("transform"))  # of cameras without a component
        components = {
            part.get("id", ""): _transform(part.find("transform")) for part in chunk.iterfind("components/component")
        }
        views: list[View] = []
        n_cameras = 0
        for entry in chunk.iterfind(".//camera"):
            n_cameras += 1
            if (transform := entry.find("transform")) is not None:
                with at_field(f"camera {entry.get('label')!r}"):
                    sensor = entry.get("sensor_id", "")
                    expect(sensor in sensors, "sensor_id", "a sensor of the file", entry.get("sensor_id"))
                    matrix = matrix_of((transform.text or "").split(), (4, 4), "transform")
                    pose = components.get(entry.get("component_id", ""), common) @ matrix
                    scale = np.cbrt(np.linalg.det(pose[:3, :3]))  # of the component
                    found = Unquoted("another matrix")
                    expect(scale > 0, "transform", "a rotation, a scale above 0 and a position", found)
                    rotation = (pose[:3, :3] / scale).T
                    views.append(posed_view(entry.get("label", ""), _camera(sensors[sensor]), rotation, pose[:3, 3]))
        expect(views, "cameras", "at least one that is aligned", n_cameras)
    points = read_point_file(file, (f"{file.stem}.ply", *PLY_FILES))
    warnings = []
    if missing := n_cameras - len(views):
        warnings.append(f"{file}: {missing} of {n_cameras} cameras are not aligned and omitted")
    return Scene(file.parent, "metashape", tuple(views), points, None, tuple(warnings), file.parent)


def _transform(node: ET.Element | None) -> FloatArray:
    """Return the transform (4, 4) of a component: rotation, scale and translation."""
    matrix = np.eye(4)
    if node is None:
        return matrix
    scale = _number(node, "scale", 1.0)
    if (rotation := node.find("rotation")) is not None:
        matrix[:3, :3] = matrix_of((rotation.text or "").split(), (3, 3), "component rotation")
    if (translation := node.find("translation")) is not None:
        matrix[:3, 3] = matrix_of((translation.text or "").split(), (3,), "component translation")
    matrix[:3, :3] *= scale
    return matrix


def _camera(sensor: ET.Element) -> Camera:
    """Return the camera of a sensor, with its adjusted calibration."""
    resolution = sensor.find("resolution")
    calibrations = [node for node in sensor.iterfind("calibration") if node.find("f") is not None]
    adjusted = [node for node in calibrations if node.get("class") == "adjusted"] or calibrations
    if resolution is None or not adjusted:
        raise FieldError("sensor", "a resolution and an adjusted calibration", None)
    try:
        size = (int(resolution.get("width", "")), int(resolution.get("height", "")))
    except ValueError:
        raise FieldError("resolution", "whole numbers of pixels", Unquoted(str(resolution.attrib))) from None
    node = adjusted[-1]
    focal, skew = _number(node, "f"), _number(node, "b2", 0.0)
    centre = (size[0] / 2 + _number(node, "cx", 0.0), size[1] / 2 + _number(node, "cy", 0.0))
    focals = (focal + _number(node, "b1", 0.0), focal)
    if abs(skew) > MAX_SKEW * focal:
        raise FieldError("b2", f"a skew under {MAX_SKEW:g} of the focal length; fix b2 at 0 and align again", skew)
    radial = {name: _number(node, name, 0.0) for name in ("k1", "k2", "k3", "k4")}
    if sensor.get("type") in FISHEYES:
        return make_camera("OPENCV_FISHEYE", size, [*focals, *centre, *radial.values()])
    expected = "frame or an equidistant fisheye (cut others into perspective views first)"
    expect(sensor.get("type", "frame") == "frame", "sensor type", expected, sensor.get("type"))
    tangential = {"p1": _number(node, "p2", 0.0), "p2": _number(node, "p1", 0.0)}
    return brown_camera(size, focals, centre, radial | tangential)


def _number(node: ET.Element, name: str, default: float | None = None) -> float:
    """Return the number of a child element."""
    text = node.findtext(name)
    if text is None and default is not None:
        return default
    return float(matrix_of([text], (1,), name)[0])
