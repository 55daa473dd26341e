"""Simple solids as triangle meshes in a unit cube, and their exact fit to a stated size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["Mesh", "ball", "box", "join", "revolution", "rotate", "stretch_to"]

#: Sides of a body of revolution; a multiple of four, so that its polygon reaches the stated diameter in x and in y.
SIDES = 32


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with a material. vertices : (n, 3); faces : (m, 3) rows of vertices; material : (m,) names."""

    vertices: FloatArray
    faces: IntArray
    material: tuple[str, ...]


def box(x: Sequence[float], y: Sequence[float], z: Sequence[float], material: str) -> Mesh:
    """The box between two corners, each axis given as (low, high)."""
    corners = np.array([[a, b, c] for c in z for b in y for a in x], dtype=float)
    quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(faces), (material,) * len(faces))


def revolution(
    profile: Sequence[tuple[float, float]], material: str, centre: tuple[float, float] = (0.5, 0.5), aspect: float = 1.0
) -> Mesh:
    """The body that a profile of (radius, z) sweeps about a vertical axis; `aspect` is its y over its x radius."""
    angle = np.arange(SIDES) * (2 * np.pi / SIDES)
    ring = np.stack([np.cos(angle), aspect * np.sin(angle)], axis=1)  # (s, 2)
    rings = [np.column_stack([np.asarray(centre) + r * ring, np.full(SIDES, z)]) for r, z in profile]
    ends = [[*centre, profile[0][1]], [*centre, profile[-1][1]]]
    here, there = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = []
    for k in range(len(profile) - 1):
        low, high = k * SIDES, (k + 1) * SIDES
        faces += [
            np.stack([low + here, low + there, high + there], 1),
            np.stack([low + here, high + there, high + here], 1),
        ]
    last = (len(profile) - 1) * SIDES
    bottom, top = len(profile) * SIDES, len(profile) * SIDES + 1
    faces += [np.stack([np.full(SIDES, bottom), there, here], 1)]
    faces += [np.stack([np.full(SIDES, top), last + here, last + there], 1)]
    stacked = np.concatenate(faces)
    return Mesh(np.concatenate([*rings, np.array(ends)]), stacked, (material,) * len(stacked))


def ball(centre: Sequence[float], radii: Sequence[float], material: str) -> Mesh:
    """An ellipsoid with axis-parallel half axes; its 8 rings reach the poles exactly."""
    polar = np.linspace(0, np.pi, 9)
    unit = revolution([(float(np.sin(a)), float(-np.cos(a))) for a in polar], material, (0.0, 0.0))
    return Mesh(np.asarray(centre) + unit.vertices * np.asarray(radii), unit.faces, unit.material)


def join(parts: Iterable[Mesh]) -> Mesh:
    """One mesh of several."""
    kept = list(parts)
    start = np.cumsum([0] + [len(part.vertices) for part in kept])
    faces = [part.faces + first for part, first in zip(kept, start, strict=False)]
    return Mesh(
        np.concatenate([part.vertices for part in kept]),
        np.concatenate(faces),
        tuple(name for part in kept for name in part.material),
    )


def stretch_to(mesh: Mesh, size: FloatArray) -> Mesh:
    """The mesh stretched so that its bounding box is exactly `size` (3,), centred in x and y, standing on z = 0."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    unit = (mesh.vertices - low) / (high - low)  # (n, 3) within 0 .. 1
    return Mesh((unit - [0.5, 0.5, 0.0]) * size, mesh.faces, mesh.material)


def rotate(mesh: Mesh, rotation: FloatArray, offset: FloatArray) -> Mesh:
    """The mesh under x -> rotation @ x + offset."""
    return Mesh(mesh.vertices @ rotation.T + offset, mesh.faces, mesh.material)
