"""A glTF material as a UsdPreviewSurface, with its textures as PNG files beside the stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.images import write_picture
from models3d.model import Material, Mesh

#: The folder of the textures, beside the stage.
TEXTURES = "textures"
#: A normal map holds (n + 1) / 2.
_NORMAL_SCALE, _NORMAL_BIAS = (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0)


def bind_material(stage: Any, mesh: Any, material: Material, folder: Path, name: str) -> None:
    """Define the material below the mesh and bind it. folder : of the stage; name : begins the textures' names."""
    from pxr import UsdShade

    path = f"{mesh.GetPath()}/material"
    bound = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    images = _Images(stage, path, folder, name)
    _set_colour(surface, material, images, mesh)
    _set_roughness(surface, material, images)
    _set_emission(surface, material, images)
    if material.normal_texture is not None:
        image = images.add("normal", material.normal_texture, _NORMAL_SCALE, bias=_NORMAL_BIAS)
        _connect(surface, "normal", "Normal3f", image, "rgb")
    bound.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(bound)


class _Images:
    """The texture readers of one material."""

    def __init__(self, stage: Any, path: str, folder: Path, name: str) -> None:
        self._stage, self._path, self._folder, self._name = stage, path, folder, name

    def reader(self, kind: str, primvar: str) -> Any:
        """What reads a primvar of the mesh; kind : `float2` or `float3`."""
        from pxr import Sdf, UsdShade

        shader = UsdShade.Shader.Define(self._stage, f"{self._path}/{primvar}")
        shader.CreateIdAttr(f"UsdPrimvarReader_{kind}")
        shader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
        shader.CreateOutput("result", getattr(Sdf.ValueTypeNames, kind.capitalize()))
        return shader.ConnectableAPI()

    def add(
        self,
        use: str,
        pixels: NDArray[np.uint8],
        scale: tuple[float, ...],
        *,
        coded: bool = False,
        bias: tuple[float, ...] | None = None,
    ) -> Any:
        """What reads (h, w, 4) pixels times `scale`, with `bias` added; coded : they are sRGB."""
        from pxr import Gf, Sdf, UsdShade

        file = f"{TEXTURES}/{self._name}_{use}.png"
        write_picture(self._folder / file, pixels[..., [2, 1, 0, 3]])
        image = UsdShade.Shader.Define(self._stage, f"{self._path}/{use}")
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        for wrap in ("wrapS", "wrapT"):
            image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB" if coded else "raw")
        image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
        if bias is not None:
            image.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(self.reader("float2", "st"), "result")
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        for channel in "rgba":
            image.CreateOutput(channel, Sdf.ValueTypeNames.Float)
        return image.ConnectableAPI()


def _connect(surface: Any, name: str, kind: str, source: Any, output: str) -> None:
    from pxr import Sdf

    surface.CreateInput(name, getattr(Sdf.ValueTypeNames, kind)).ConnectToSource(source, output)


def _set(surface: Any, name: str, value: float) -> None:
    from pxr import Sdf

    surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)


def _set_colour(surface: Any, material: Material, images: _Images, mesh: Any) -> None:
    """The colour, and how much is seen through it where the alpha mode is not OPAQUE."""
    from pxr import Gf, Sdf

    image = None
    factor = tuple(float(value) for value in material.base_color)
    if material.base_texture is not None:
        image = images.add("base", material.base_texture, factor, coded=True)
        _connect(surface, "diffuseColor", "Color3f", image, "rgb")
    elif mesh.GetDisplayColorPrimvar().HasValue():
        _connect(surface, "diffuseColor", "Color3f", images.reader("float3", "displayColor"), "result")
    else:
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*factor[:3]))
    if material.blend or material.alpha_cutoff is not None:
        if image is not None:
            _connect(surface, "opacity", "Float", image, "a")
        else:
            _set(surface, "opacity", factor[3])
    if material.alpha_cutoff is not None:
        _set(surface, "opacityThreshold", material.alpha_cutoff)


def _set_roughness(surface: Any, material: Material, images: _Images) -> None:
    """Roughness is the green of the texture, the metallic share its blue, as glTF has them."""
    if material.surface_texture is None:
        _set(surface, "roughness", material.roughness)
        _set(surface, "metallic", material.metallic)
        return
    image = images.add("surface_map", material.surface_texture, (1.0, material.roughness, material.metallic, 1.0))
    _connect(surface, "roughness", "Float", image, "g")
    _connect(surface, "metallic", "Float", image, "b")


def _set_emission(surface: Any, material: Material, images: _Images) -> None:
    from pxr import Gf, Sdf

    factor = tuple(float(value) for value in material.emissive)
    if material.emissive_texture is not None:
        image = images.add("emissive", material.emissive_texture, (*factor, 1.0), coded=True)
        _connect(surface, "emissiveColor", "Color3f", image, "rgb")
    elif any(factor):
        surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*factor))


def write_mesh(stage: Any, path: str, part: Mesh) -> Any:
    """Define a `UsdGeom.Mesh` at `path` with the points, normals, colours and texture coordinates of a part."""
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    points = part.vertices.astype("f4")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(part.faces), 3, "i4")))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(part.faces.astype("i4").ravel()))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(part.normals.astype("f4")))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    if part.color is not None:
        tint = (part.color[:, :3] * part.material.base_color[:3]).astype("f4")
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(tint))
    # USD counts v upwards, glTF downwards
    uv = (part.uv * [1, -1] + [0, 1]).astype("f4")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
    return mesh
