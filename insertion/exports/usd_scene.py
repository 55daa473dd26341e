"""The inserted objects and the animated camera as a USD stage, 1 unit = 1 m, +y up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKey, MetricFrame, object_matrix
from insertion.models.model import Material, Part
from insertion.render.pinhole import focal_lengths
from insertion.staging.insert import Placed
from metric_base.pictures import write_picture

__all__ = ["write_usd_scene"]

#: Time codes a second: fine enough for every presentation time of a video.
TIME_CODES = 1000.0
#: A usual width of film in millimetres; USD states focal lengths against it.
APERTURE_MM = 36.0


def write_usd_scene(
    file: Path, objects: Sequence[Placed], keys: Sequence[CameraKey], camera: Camera, frame: MetricFrame
) -> None:
    """Write a `.usda` file, with textures in a folder beside it."""
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(TIME_CODES)
    stage.SetStartTimeCode(keys[0].time_s * TIME_CODES)
    stage.SetEndTimeCode(keys[-1].time_s * TIME_CODES)
    root = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(root.GetPrim())
    _camera(stage, keys, camera)
    for number, placed in enumerate(objects):
        path = f"/World/object{number}"
        _matrix(UsdGeom.Xform.Define(stage, path), object_matrix(placed, frame))
        for row, part in enumerate(placed.model.parts):
            name = f"{path}/part{row}"
            mesh = _mesh(stage, name, part)
            _material(stage, f"{name}_material", part.material, file, f"{placed.request.model.stem}_{row}", mesh)
    stage.GetRootLayer().customLayerData = {"metres_per_unit": 1.0}
    stage.GetRootLayer().Save()
    assert Sdf.Layer.FindOrOpen(str(file)) is not None  # it can be read again


def _camera(stage: Any, keys: Sequence[CameraKey], camera: Camera) -> None:
    from pxr import Gf, UsdGeom

    fx, fy, cx, cy = focal_lengths(camera)
    lens = UsdGeom.Camera.Define(stage, "/World/camera")
    lens.CreateHorizontalApertureAttr(APERTURE_MM)
    lens.CreateVerticalApertureAttr(APERTURE_MM * camera.height / camera.width * fx / fy)
    lens.CreateFocalLengthAttr(APERTURE_MM * fx / camera.width)
    lens.CreateHorizontalApertureOffsetAttr(APERTURE_MM * (camera.width / 2 - cx) / camera.width)
    lens.CreateVerticalApertureOffsetAttr(APERTURE_MM * (cy - camera.height / 2) / camera.width * fx / fy)
    lens.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000.0))
    operation = lens.AddTransformOp()
    for key in keys:
        operation.Set(Gf.Matrix4d(key.matrix.T.tolist()), key.time_s * TIME_CODES)  # USD multiplies rows


def _matrix(form: Any, matrix: np.ndarray) -> None:
    """Add a transform (4, 4), which USD stores by columns."""
    from pxr import Gf

    form.AddTransformOp().Set(Gf.Matrix4d(matrix.T.tolist()))


def _mesh(stage: Any, path: str, part: Part) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(part.vertices.astype("f4")))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(part.faces), 3, "i4")))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(part.faces.astype("i4").ravel()))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(part.normals.astype("f4")))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    # USD counts v upwards, glTF downwards
    uv = (part.uv * [1, -1] + [0, 1]).astype("f4")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
    return mesh


def _material(stage: Any, path: str, material: Material, file: Path, name: str, mesh: Any) -> None:
    from pxr import Gf, Sdf, UsdShade

    bound = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(material.roughness)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(material.metallic)
    colour = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if material.base_texture is None:
        colour.Set(Gf.Vec3f(*(float(v) for v in material.base_color[:3])))
    else:
        colour.ConnectToSource(_texture(stage, path, material, file, name), "rgb")
    bound.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(bound)


def _texture(stage: Any, path: str, material: Material, file: Path, name: str) -> Any:
    from pxr import Gf, Sdf, UsdShade

    folder = file.parent / "textures"
    folder.mkdir(exist_ok=True)
    assert material.base_texture is not None  # asked for
    write_picture(folder / f"{name}.png", material.base_texture[..., [2, 1, 0, 3]])
    reader = UsdShade.Shader.Define(stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image = UsdShade.Shader.Define(stage, f"{path}/image")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"textures/{name}.png")
    image.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("repeat")
    image.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("repeat")
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*(float(v) for v in material.base_color)))
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    return image.ConnectableAPI()
