"""A renderable model: triangles with physically based materials, in metres of its file, and its animations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """A metallic-roughness material of glTF 2.0. Textures are (h, w, 4) arrays of uint8, or None."""

    #: (4,) linear RGBA factor.
    base_color: FloatArray
    metallic: float = 1.0
    roughness: float = 1.0
    #: (3,) linear RGB factor.
    emissive: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # made an array below
    #: sRGB colour.
    base_texture: Pixels | None = None
    #: Roughness in the green channel, metalness in the blue one; linear.
    surface_texture: Pixels | None = None
    #: Normals (n + 1) / 2; linear.
    normal_texture: Pixels | None = None
    #: sRGB colour.
    emissive_texture: Pixels | None = None
    #: Threshold of the alpha mode MASK; None in other modes.
    alpha_cutoff: float | None = None
    #: True in the alpha mode BLEND.
    blend: bool = False
    #: Fraction of the light that enters the material, as glass; 0 for other materials.
    transmission: float = 0.0
    #: (3,) linear RGB fraction of this light that leaves it again.
    tint: FloatArray = (1.0, 1.0, 1.0)  # type: ignore[assignment]  # made an array below

    def __post_init__(self) -> None:
        for name in ("base_color", "emissive", "tint"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))

    @property
    def textures(self) -> tuple[Pixels, ...]:
        """The textures that are not None."""
        textures = (self.base_texture, self.surface_texture, self.normal_texture, self.emissive_texture)
        return tuple(pixels for pixels in textures if pixels is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one material."""

    #: (n, 3) metres; +y is up and +z is the front, as in glTF.
    vertices: FloatArray
    #: (n, 3) unit vectors.
    normals: FloatArray
    #: (n, 2) texture coordinates; v increases downwards, as in glTF.
    uv: FloatArray
    #: (m, 3) rows of `vertices`.
    faces: IntArray
    material: Material
    #: (n, 4) linear vertex colours, or None.
    color: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Animation:
    """A named animation of a file."""

    name: str
    duration_s: float
    #: Returns the meshes of the model at a time from 0 to `duration_s`.
    meshes: Callable[[float], tuple[Mesh, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A model in one pose."""

    #: Name of the file.
    name: str
    meshes: tuple[Mesh, ...]
    #: Content of the file that is not represented.
    warnings: tuple[str, ...] = ()
    animations: tuple[Animation, ...] = ()

    def posed(self, animation: Animation, time_s: float) -> Model:
        """Return the model in the pose of an animation, which repeats, at a time."""
        return replace(self, meshes=animation.meshes(time_s % animation.duration_s))

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) lowest and highest corner in metres of the file."""
        used = [mesh.vertices[np.unique(mesh.faces)] for mesh in self.meshes]
        return np.array([np.min([v.min(axis=0) for v in used], axis=0), np.max([v.max(axis=0) for v in used], axis=0)])

    @property
    def extents(self) -> FloatArray:
        """(3,) extents along x, y (up) and z in metres of the file."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @property
    def size_m(self) -> dict[str, float]:
        """Length and width (the longer and the shorter horizontal extent) and height in metres of the file."""
        x, y, z = (float(v) for v in self.extents)
        return {"length": max(x, z), "width": min(x, z), "height": y}
