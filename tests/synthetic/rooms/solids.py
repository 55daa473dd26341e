"""Simple solids as triangle meshes in a unit cube, and their scaling to an exact size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["Mesh", "ball", "box", "join", "revolution", "rotate", "stretch_to"]

#: Number of sides of a solid of revolution; a multiple of four for the exact diameter along x and y.
N_SIDES = 32


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with materials. vertices : (n, 3); faces : (m, 3) indices of vertices; material : (m,) names."""

    vertices: FloatArray
    faces: IntArray
    material: tuple[str, ...]


def box(x: Sequence[float], y: Sequence[float], z: Sequence[float], material: str) -> Mesh:
    """Return a box with the ranges (low, high) along each axis."""
    corners = np.array([[a, b, c] for c in z for b in y for a in x], dtype=float)
    quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(faces), (material,) * len(faces))


def revolution(
    profile: Sequence[tuple[float, float]], material: str, centre: tuple[float, float] = (0.5, 0.5), aspect: float = 1.0
) -> Mesh:
    """Return the solid of revolution of a profile (radius, z) about a vertical axis; aspect : y over x radius."""
    angle = np.arange(N_SIDES) * (2 * np.pi / N_SIDES)
    ring = np.stack([np.cos(angle), aspect * np.sin(angle)], axis=1)  # (s, 2)
    rings = [np.column_stack([np.asarray(centre) + r * ring, np.full(N_SIDES, z)]) for r, z in profile]
    ends = [[*centre, profile[0][1]], [*centre, profile[-1][1]]]
    current, following = np.arange(N_SIDES), (np.arange(N_SIDES) + 1) % N_SIDES
    faces = []
    for k in range(len(profile) - 1):
        low, high = k * N_SIDES, (k + 1) * N_SIDES
        faces += [
            np.stack([low + current, low + following, high + following], 1),
            np.stack([low + current, high + following, high + current], 1),
        ]
    last = (len(profile) - 1) * N_SIDES
    bottom, top = len(profile) * N_SIDES, len(profile) * N_SIDES + 1
    faces += [np.stack([np.full(N_SIDES, bottom), following, current], 1)]
    faces += [np.stack([np.full(N_SIDES, top), last + current, last + following], 1)]
    stacked = np.concatenate(faces)
    return Mesh(np.concatenate([*rings, np.array(ends)]), stacked, (material,) * len(stacked))


def ball(centre: Sequence[float], radii: Sequence[float], material: str) -> Mesh:
    """Return an axis-aligned ellipsoid of 8 rings with exact poles."""
    polar = np.linspace(0, np.pi, 9)
    unit = revolution([(float(np.sin(a)), float(-np.cos(a))) for a in polar], material, (0.0, 0.0))
    return Mesh(np.asarray(centre) + unit.vertices * np.asarray(radii), unit.faces, unit.material)


def join(parts: Iterable[Mesh]) -> Mesh:
    """Join several meshes."""
    meshes = list(parts)
    start = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + first for mesh, first in zip(meshes, start, strict=False)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces),
        tuple(name for mesh in meshes for name in mesh.material),
    )


def stretch_to(mesh: Mesh, size: FloatArray) -> Mesh:
    """Scale the mesh to a bounding box of exactly `size` (3,), centred in x and y, with its base at z = 0."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    unit = (mesh.vertices - low) / (high - low)  # (n, 3) within 0 .. 1
    return Mesh((unit - [0.5, 0.5, 0.0]) * size, mesh.faces, mesh.material)


def rotate(mesh: Mesh, rotation: FloatArray, offset: FloatArray) -> Mesh:
    """Transform the mesh by x -> rotation @ x + offset."""
    return Mesh(mesh.vertices @ rotation.T + offset, mesh.faces, mesh.material)
