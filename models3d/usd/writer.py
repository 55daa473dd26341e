"""Write meshes and materials of a model to a USD stage: `UsdGeomMesh`, `UsdPreviewSurface`, textures as PNG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

from metric_base.images import write_image
from models3d.model import Material, Mesh

#: Folder of the textures, next to the stage.
TEXTURES = "textures"
#: Scale and bias that convert a normal map, (n + 1) / 2, to normals.
_NORMAL_SCALE, _NORMAL_BIAS = (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0)


def bind_material(stage: Any, mesh: Any, material: Material, folder: Path, name: str) -> None:
    """Define a material below a mesh of the stage and bind it.

    Parameters
    ----------
    stage : Usd.Stage
    mesh : UsdGeom.Mesh
        Result of `write_mesh`.
    material : Material
    folder : Path
        Folder of the stage; textures are written to `textures/` in it.
    name : str
        Prefix of the file names of the textures.
    """
    path = f"{mesh.GetPath()}/material"
    bound = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    images = _Images(stage, path, folder, name)

    base = None
    factor = tuple(float(value) for value in material.base_color)
    if material.base_texture is not None:
        base = images.add("base", material.base_texture, factor, is_srgb=True)
        _connect(surface, "diffuseColor", "Color3f", base, "rgb")
    elif mesh.GetDisplayColorPrimvar().HasValue():
        _connect(surface, "diffuseColor", "Color3f", images.primvar_reader("float3", "displayColor"), "result")
    else:
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*factor[:3]))
    if material.blend or material.alpha_cutoff is not None:
        if base is not None:
            _connect(surface, "opacity", "Float", base, "a")
        else:
            _set(surface, "opacity", factor[3])
    if material.alpha_cutoff is not None:
        _set(surface, "opacityThreshold", material.alpha_cutoff)
    if material.surface_texture is None:
        _set(surface, "roughness", material.roughness)
        _set(surface, "metallic", material.metallic)
    else:  # roughness is the green channel of the texture, metalness the blue one, as in glTF
        image = images.add("surface_map", material.surface_texture, (1.0, material.roughness, material.metallic, 1.0))
        _connect(surface, "roughness", "Float", image, "g")
        _connect(surface, "metallic", "Float", image, "b")
    emissive = tuple(float(value) for value in material.emissive)
    if material.emissive_texture is not None:
        image = images.add("emissive", material.emissive_texture, (*emissive, 1.0), is_srgb=True)
        _connect(surface, "emissiveColor", "Color3f", image, "rgb")
    elif any(emissive):
        surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*emissive))
    if material.normal_texture is not None:
        image = images.add("normal", material.normal_texture, _NORMAL_SCALE, bias=_NORMAL_BIAS)
        _connect(surface, "normal", "Normal3f", image, "rgb")
    bound.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(bound)


def _connect(surface: Any, name: str, kind: str, source: Any, output: str) -> None:
    """Connect an input of a shader to an output of another shader; `kind` is the type of the input."""
    surface.CreateInput(name, getattr(Sdf.ValueTypeNames, kind)).ConnectToSource(source, output)


def _set(surface: Any, name: str, value: float) -> None:
    """Set an input of a shader to a number."""
    surface.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)


class _Images:
    """Texture shaders of a material."""

    def __init__(self, stage: Any, path: str, folder: Path, name: str) -> None:
        self._stage, self._path, self._folder, self._name = stage, path, folder, name

    def primvar_reader(self, kind: str, primvar: str) -> Any:
        """Return a shader that reads a primvar of the mesh; `kind` is `float2` or `float3`."""
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
        is_srgb: bool = False,
        bias: tuple[float, ...] | None = None,
    ) -> Any:
        """Write a texture (h, w, 4) and return a shader that samples it and computes `scale * pixel + bias`."""
        file = f"{TEXTURES}/{self._name}_{use}.png"
        write_image(self._folder / file, pixels[..., [2, 1, 0, 3]])
        image = UsdShade.Shader.Define(self._stage, f"{self._path}/{use}")
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        for wrap in ("wrapS", "wrapT"):
            image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB" if is_srgb else "raw")
        image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
        if bias is not None:
            image.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
        st = self.primvar_reader("float2", "st")
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st, "result")
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        for channel in "rgba":
            image.CreateOutput(channel, Sdf.ValueTypeNames.Float)
        return image.ConnectableAPI()


def write_mesh(stage: Any, path: str, mesh: Mesh) -> Any:
    """Define a `UsdGeom.Mesh` at `path` with the vertices, normals, colours and texture coordinates of a mesh."""
    prim = UsdGeom.Mesh.Define(stage, path)
    points = mesh.vertices.astype("f4")
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, "i4")))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.astype("i4").ravel()))
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(mesh.normals.astype("f4")))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateDoubleSidedAttr(True)
    if mesh.color is not None:
        tint = (mesh.color[:, :3] * mesh.material.base_color[:3]).astype("f4")
        prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(tint))
    # v increases upwards in USD and downwards in glTF
    uv = (mesh.uv * [1, -1] + [0, 1]).astype("f4")
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
    return prim
