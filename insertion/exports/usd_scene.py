"""The inserted objects and the animated camera as a USD stage, 1 unit = 1 m, +y up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKeyframe, MetricTransform, keyframes_by_camera, object_matrix
from insertion.placement.placed_object import PlacedObject
from insertion.scene.camera_rays import focal_lengths
from models3d.usd.writer import bind_material, write_mesh

#: A usual width of video, 36 mm. USD states lenses in tenths of a scene unit (UsdGeomCamera), here of a metre.
APERTURE = 0.36
#: Metres between which a camera sees anything.
NEAR_M, FAR_M = 0.01, 1000.0


def write_usd_scene(
    file: Path, objects: Sequence[PlacedObject], keys: Sequence[CameraKeyframe], transform: MetricTransform, rate: float
) -> None:
    """Write a `.usda` file, with textures in a folder beside it and a camera for each that took the pictures.

    rate : pictures a second. Time code k is picture k; where times vary, samples are between time codes, at their own
    time. USD has no lens distortion; each camera is the ideal one with the same focal lengths and principal point.
    """
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(max(key.time_s for key in keys) * rate)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    for number, (camera, own) in enumerate(keyframes_by_camera(keys)):
        _camera(stage, f"/World/camera{number or ''}", camera, own, rate)
    for number, placed in enumerate(objects):
        path = f"/World/object{number}"
        _set_matrix(UsdGeom.Xform.Define(stage, path), object_matrix(placed, transform))
        for row, part in enumerate(placed.model.meshes):
            mesh = write_mesh(stage, f"{path}/part{row}", part)
            bind_material(stage, mesh, part.material, file.parent, f"object{number}_part{row}")
    stage.GetRootLayer().Save()


def _camera(stage: Any, path: str, camera: Camera, keys: Sequence[CameraKeyframe], rate: float) -> None:
    """A camera moved by its keys; rate : time codes a second."""
    from pxr import Gf, UsdGeom

    fx, fy, cx, cy = focal_lengths(camera)
    lens = UsdGeom.Camera.Define(stage, path)
    lens.CreateHorizontalApertureAttr(APERTURE)
    lens.CreateVerticalApertureAttr(APERTURE * camera.height / camera.width * fx / fy)
    lens.CreateFocalLengthAttr(APERTURE * fx / camera.width)
    lens.CreateHorizontalApertureOffsetAttr(APERTURE * (camera.width / 2 - cx) / camera.width)
    lens.CreateVerticalApertureOffsetAttr(APERTURE * (cy - camera.height / 2) / camera.width * fx / fy)
    lens.CreateClippingRangeAttr(Gf.Vec2f(NEAR_M, FAR_M))
    operation = lens.AddTransformOp()
    for key in keys:
        operation.Set(Gf.Matrix4d(key.matrix.T.tolist()), key.time_s * rate)  # USD multiplies rows


def _set_matrix(form: Any, matrix: np.ndarray) -> None:
    """Add a transform (4, 4), which USD stores by columns."""
    from pxr import Gf

    form.AddTransformOp().Set(Gf.Matrix4d(matrix.T.tolist()))
