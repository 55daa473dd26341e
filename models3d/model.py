"""A model to insert: triangles with physically based materials, in the file's own metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """A glTF 2.0 metallic-roughness material.

    base_color : (4,) linear factor; metallic, roughness : factors; emissive : (3,) linear factor. Textures are
    (h, w, 4) uint8 or None: base and emissive in sRGB, `surface` (roughness in green, metallic in blue) and `normal`
    linear. alpha_cutoff : None unless the alpha mode is MASK; blend : whether the alpha mode is BLEND.
    """

    base_color: FloatArray
    metallic: float = 1.0
    roughness: float = 1.0
    emissive: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # made an array below
    base_texture: Pixels | None = None
    surface_texture: Pixels | None = None
    normal_texture: Pixels | None = None
    emissive_texture: Pixels | None = None
    alpha_cutoff: float | None = None
    blend: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_color", np.asarray(self.base_color, dtype=np.float64))
        object.__setattr__(self, "emissive", np.asarray(self.emissive, dtype=np.float64))

    @property
    def textures(self) -> tuple[Pixels, ...]:
        """Those that there are, each (h, w, 4)."""
        stated = (self.base_texture, self.surface_texture, self.normal_texture, self.emissive_texture)
        return tuple(pixels for pixels in stated if pixels is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one material.

    vertices : (n, 3) metres, +y up, +z the front (glTF's axes); normals : (n, 3) unit; uv : (n, 2) with v down, as
    glTF has it; faces : (m, 3) rows of vertices; color : (n, 4) linear vertex colour, or None.
    """

    vertices: FloatArray
    normals: FloatArray
    uv: FloatArray
    faces: IntArray
    material: Material
    color: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Animation:
    """An animation of a file by its name; parts : those of the model at a time from 0 to duration_s, which repeats."""

    name: str
    duration_s: float
    meshes: Callable[[float], tuple[Mesh, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A model: its file's name, its parts, what was left out of the file, and how it may move."""

    name: str
    meshes: tuple[Mesh, ...]
    warnings: tuple[str, ...] = ()
    animations: tuple[Animation, ...] = ()

    def posed(self, animation: Animation, time_s: float) -> Model:
        """The model in the pose of a motion at a time; the motion repeats."""
        return replace(self, meshes=animation.meshes(time_s % animation.duration_s))

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) lowest and highest corner, metres of the file."""
        used = [part.vertices[np.unique(part.faces)] for part in self.meshes]
        return np.array([np.min([v.min(axis=0) for v in used], axis=0), np.max([v.max(axis=0) for v in used], axis=0)])

    @property
    def extents(self) -> FloatArray:
        """(3,) extents along x, y (up) and z, metres of the file."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @property
    def size_m(self) -> dict[str, float]:
        """Length and width (the longer and the shorter horizontal extent) and height, metres of the file."""
        x, y, z = (float(v) for v in self.extents)
        return {"length": max(x, z), "width": min(x, z), "height": y}
