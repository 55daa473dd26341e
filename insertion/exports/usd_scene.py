"""Write the inserted objects and the animated camera as a USD stage, in metres with +y up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pxr import Gf, Usd, UsdGeom

from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKeyframe, MetricTransform, keyframes_by_camera, object_matrix
from insertion.placement.placed_object import PlacedObject
from insertion.scene.camera_rays import focal_lengths
from models3d.usd.writer import bind_material, write_mesh

#: Width of the aperture, 36 mm, in tenths of a scene unit (metre), the unit of lenses in UsdGeomCamera.
APERTURE = 0.36
#: Distances of the clipping planes of a camera in metres.
NEAR_M, FAR_M = 0.01, 1000.0


def write_usd_scene(
    file: Path, objects: Sequence[PlacedObject], keys: Sequence[CameraKeyframe], transform: MetricTransform, rate: float
) -> None:
    """Write a `.usda` file with a camera for each camera of the frames, and textures in a folder next to it.

    Time code k is frame k at `rate` frames per second; if the intervals vary, samples are between time codes. USD has
    no lens distortion; each camera has the focal lengths and the principal point of the original.
    """
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(max(key.time_s for key in keys) * rate)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    for index, (camera, camera_keys) in enumerate(keyframes_by_camera(keys)):
        _add_camera(stage, f"/World/camera{index or ''}", camera, camera_keys, rate)
    for number, placed in enumerate(objects, start=1):
        path = f"/World/object{number}"
        matrix = object_matrix(placed, transform).T  # USD multiplies rows
        UsdGeom.Xform.Define(stage, path).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
        for row, part in enumerate(placed.model.meshes):
            mesh = write_mesh(stage, f"{path}/part{row}", part)
            bind_material(stage, mesh, part.material, file.parent, f"object{number}_part{row}")
    stage.GetRootLayer().Save()


def _add_camera(stage: Any, path: str, camera: Camera, keys: Sequence[CameraKeyframe], rate: float) -> None:
    """Add a camera animated by its keyframes, with `rate` time codes per second."""
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
