"""A made solid as a GLB file that is painted as the synthetic rooms' own renderer paints it: a texture.

The pattern is solid noise (`rooms/shaders/surface.frag`), so a corner's colour depends on where it is in the room.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray
from tests.synthetic.rooms.materials import look_of
from tests.synthetic.rooms.solids import Mesh

__all__ = ["write_painted_glb"]

#: Side of a triangle's square in the texture, in texels; so many of them are beyond the triangle on each side.
CELL, PAD = 96, 3
_OCTAVES = 5


def write_painted_glb(local: Mesh, placed: Mesh, file: Path, number: int, seed: int) -> Path:
    """`local` (z up, front towards -y) as a GLB (y up, front towards +z), painted as object `number` of a room.

    placed : the same mesh where it stands in the room; seed : the room's.
    """
    import trimesh
    from PIL import Image

    across = int(np.ceil(np.sqrt(len(local.faces))))
    texture = np.zeros((across * CELL, across * CELL, 3), np.uint8)
    uv = np.zeros((len(local.faces), 3, 2))
    corner_texels = np.array([[PAD, PAD], [CELL - PAD, PAD], [PAD, CELL - PAD]], dtype=np.float64)
    for row, (face, name) in enumerate(zip(placed.faces, placed.material, strict=True)):
        y, x = (CELL * k for k in divmod(row, across))
        texture[y : y + CELL, x : x + CELL] = _painted_cell(placed.vertices[face], look_of(name, number, seed, 1.0))
        uv[row] = (corner_texels + np.array([x, y])) / (across * CELL)
    uv[..., 1] = 1 - uv[..., 1]  # trimesh counts v upwards
    corners = local.vertices[local.faces].reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1]
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(texture), metallicFactor=0.0, roughnessFactor=0.9
    )
    visual = trimesh.visual.TextureVisuals(uv=uv.reshape(-1, 2), material=material)
    faces = np.arange(len(corners)).reshape(-1, 3)
    solid = trimesh.Trimesh(corners, faces, process=False, visual=visual)
    file.write_bytes(trimesh.Scene(solid).export(file_type="glb"))
    return file


def _painted_cell(corners: FloatArray, look: FloatArray) -> NDArray[np.uint8]:
    """(CELL, CELL, 3) sRGB colours before light of a triangle (3, 3) in the room and of what is around it.

    look : (12,) as `look_of` gives it.
    """
    at = (np.arange(CELL) + 0.5 - PAD) / (CELL - 2 * PAD)
    second, third = np.meshgrid(at, at)
    first, aside, up = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    place = (first + second.reshape(-1, 1) * aside + third.reshape(-1, 1) * up) + look[9:12]
    texel = max(np.linalg.norm(aside), np.linalg.norm(up)) / CELL
    wave, weight, grain = float(look[8]), 0.34, np.zeros(len(place))
    for octave in range(_OCTAVES):
        if wave > 1.5 * texel:
            grain += weight * (_noise(place / wave + 7.3 * octave) * 2 - 1)
        wave, weight = wave / 2, weight * 0.97
    soft = float(np.clip(3 * texel / look[8], 0.03, 1.0))
    patch = _smoothstep(-soft, soft, _noise(place / look[8] * 1.3 + 91.0) - 0.55) * look[7]
    base = look[:3] * (1 - patch[:, None]) + look[3:6] * patch[:, None]
    colour = np.clip(base * (1 + look[6] * grain)[:, None], 0, 1)
    return np.asarray(np.rint(255 * colour), dtype=np.uint8).reshape(CELL, CELL, 3)


def _smoothstep(low: float, high: float, value: FloatArray) -> FloatArray:
    t = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _noise(places: FloatArray) -> FloatArray:
    """(n,) value noise in 0 to 1 at (n, 3) places."""
    whole = np.floor(places).astype(np.int64)
    f = places - whole
    f = f * f * (3 - 2 * f)
    total = np.zeros(len(places))
    for corner in np.ndindex(2, 2, 2):
        share = np.prod(np.where(corner, f, 1 - f), axis=1)
        total += share * _hash(whole + corner)
    return total


def _hash(cells: IntArray) -> FloatArray:
    """(n,) numbers in 0 to 1 of (n, 3) cells, as the shader's integers overflow."""
    x, y, z = (cells[:, k].astype(np.int32).astype(np.uint32) for k in range(3))
    with np.errstate(over="ignore"):
        h = x * np.uint32(0x8DA6B343) ^ y * np.uint32(0xD8163841) ^ z * np.uint32(0xCB1AB31F)
        h ^= h >> np.uint32(13)
        h *= np.uint32(0x5BD1E995)
        h ^= h >> np.uint32(15)
    return np.asarray((h & np.uint32(0xFFFF)) / 65535.0)
