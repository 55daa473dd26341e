"""A placed model for the renderer: triangles in the local frame of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from insertion.colour import srgb_to_linear
from insertion.light.environment_map import MIRROR, Environment
from metric_base.arrays import FloatArray, IntArray
from models3d.model import Material, Model

#: Maximum distance of objects with mutual shadows, relative to the sum of their sizes.
SHADING_SIZES = 3.0
#: Maximum fraction of the edges of a closed surface that belong to one triangle: simplified models have small holes.
MAX_OPEN_EDGES = 0.02
#: Decimals of positions that count as one vertex, in sizes of the object.
VERTEX_DECIMALS = 5
#: Number of sample points on a part, for its reflection in other objects and for collisions.
SPOTS = 8000
#: Side of the cells of the collision test, relative to the size of the smaller body; and maximum number of cells that
#: touching bodies have in common.
COLLISION_CELL, TOUCHING_CELLS = 0.04, 3


@dataclass(frozen=True, slots=True, eq=False)
class BodyPart:
    """Triangles in the local frame: vertices, normals (n, 3), uv (n, 2), tint (n, 4), faces (m, 3), material."""

    vertices: FloatArray
    normals: FloatArray
    uv: FloatArray
    tint: FloatArray
    faces: IntArray
    material: Material

    @property
    def is_closed(self) -> bool:
        """Whether nearly every edge joins two triangles, which then enclose a volume."""
        rows = np.unique(self.vertices.round(VERTEX_DECIMALS), axis=0, return_inverse=True)[1].ravel()[self.faces]
        edges = np.sort(np.concatenate([rows[:, [0, 1]], rows[:, [1, 2]], rows[:, [2, 0]]]), axis=1)
        counts = np.unique(edges, axis=0, return_counts=True)[1]
        return float((counts == 1).sum()) < MAX_OPEN_EDGES * len(counts)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A placed model.

    The local frame has the axes of the scene, its origin at the bottom centre `position` (3,), and the unit of length
    `unit` in scene units: x_scene = position + unit * x_local. The rows of `basis` (3, 3) are two horizontal axes and
    up.
    """

    parts: tuple[BodyPart, ...]
    position: FloatArray
    basis: FloatArray
    unit: float

    @property
    def albedo(self) -> FloatArray:
        """Mean linear base colour (3,) of the surface; metals are assumed to reflect the same amount."""
        area = np.array([_area(part) for part in self.parts])
        colours = np.array([_mean_colour(part) for part in self.parts])
        return np.asarray(area @ colours / max(float(area.sum()), 1e-12))

    @property
    def corners(self) -> FloatArray:
        """All vertices (n, 3) in the local frame."""
        return np.concatenate([part.vertices for part in self.parts])

    def parts_of(self, other: Body) -> tuple[BodyPart, ...]:
        """Return the parts of another body in the local frame of this body."""
        scale, offset = other.unit / self.unit, (other.position - self.position) / self.unit
        return tuple(replace(part, vertices=scale * part.vertices + offset) for part in other.parts)

    def is_near(self, other: Body) -> bool:
        """Return whether another body is close enough that one may cast a shadow on the other."""
        apart = float(np.linalg.norm(other.position - self.position))
        return apart < SHADING_SIZES * (self.unit + other.unit)

    def camera(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (3, 3) and translation (3,) from the local frame to the camera, in units of `unit`."""
        return rotation, (rotation @ self.position + translation) / self.unit


def body_of(
    model: Model,
    position: FloatArray,
    basis: FloatArray,
    heading: FloatArray,
    units_per_metre: float,
    bounds: FloatArray | None = None,
) -> Body:
    """Return a model with the centre of its bottom at `position` and its front (+z of the file) along `heading`.

    Parameters
    ----------
    basis : (3, 3) ndarray of float
        Axes of the support; the last row is up.
    heading : (3,) ndarray of float
        Horizontal unit vector in the scene.
    units_per_metre : float
        Scene units per metre of the file: the size factor divided by the scale.
    bounds : (2, 3) ndarray of float, optional
        Corners in the file that define bottom and size; those of the model by default.
    """
    up = basis[2]
    turn = np.column_stack([np.cross(up, heading), up, heading])  # columns: axes x, y, z of the file
    low, high = model.bounds if bounds is None else bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    unit = float((high - low).max())
    parts = tuple(
        BodyPart(
            (part.vertices - foot) / unit @ turn.T,
            part.normals @ turn.T,
            part.uv,
            np.ones((len(part.vertices), 4)) if part.color is None else part.color,
            part.faces,
            part.material,
        )
        for part in model.meshes
    )
    return Body(parts, np.asarray(position, dtype=np.float64), basis, unit * units_per_metre)


def environment_with_objects(environment: Environment, body: Body, others: Sequence[Body]) -> Environment:
    """Return the environment at the centre of a body with other bodies in it, for reflections.

    Each cell of the map has the colour of the nearest sample point of these bodies, as Lambertian surfaces under the
    environment.
    """
    if not others:
        return environment
    corners = body.corners
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    axes = np.concatenate([environment.basis, -environment.basis])
    light = np.array([environment.irradiance(axis) for axis in axes]) / np.pi  # (6, 3)
    places, colours = [], []
    for part in (part for other in others for part in body.parts_of(other)):
        spots, normals = _spread_over(part)
        toward = normals @ axes.T  # (n, 6)
        places.append(spots - middle)
        colours.append(_mean_colour(part) * ((np.maximum(toward, 0) ** 2) @ light))
    away, colour = np.concatenate(places), np.concatenate(colours)
    distance = np.linalg.norm(away, axis=1)
    radiance = environment.radiance.copy()
    height, width = radiance.shape[:2]
    local = away @ environment.basis.T / np.maximum(distance, 1e-9)[:, None]
    row = np.minimum(np.arccos(np.clip(local[:, 2], -1, 1)) / np.pi * height, height - 1).astype(np.int64)
    turn = np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) + 0.5
    column = np.minimum(turn * width, width - 1).astype(np.int64)
    order = np.argsort(-distance)  # the nearest point is written last
    radiance[row[order], column[order]] = colour[order]
    if environment.detail is None:
        return replace(environment, radiance=radiance)
    is_object = np.zeros((height, width, 1), bool)
    is_object[row, column] = True
    detail = np.where(is_object.repeat(MIRROR, axis=0).repeat(MIRROR, axis=1), np.float32(1), environment.detail)
    return replace(environment, radiance=radiance, detail=detail)


def colliding(one: Body, two: Body) -> bool:
    """Return whether two bodies intersect: their surfaces have more cells in common than touching bodies."""
    cell = COLLISION_CELL * min(one.unit, two.unit)
    cells = []
    for body in (one, two):
        spots = np.concatenate([_spread_over(part)[0] for part in body.parts])
        middle = (body.corners.min(axis=0) + body.corners.max(axis=0)) / 2
        spots = middle + (1 - COLLISION_CELL) * (spots - middle)  # bodies whose sides touch do not intersect
        inside = spots @ body.basis[2] * body.unit > cell  # without cells at the floor, on which both may stand
        at = (body.position + body.unit * spots[inside] - one.position) / cell
        cells.append({tuple(row) for row in np.unique(np.floor(at).astype(np.int64), axis=0).tolist()})
    return len(cells[0] & cells[1]) > TOUCHING_CELLS


def _spread_over(part: BodyPart) -> tuple[FloatArray, FloatArray]:
    """Return points (SPOTS, 3) on the triangles of a part, distributed by area, with unit normals."""
    generator = np.random.default_rng(0)
    one, two, three = (part.vertices[part.faces[:, k]] for k in range(3))
    across = np.cross(two - one, three - one)
    area = np.linalg.norm(across, axis=1)
    face = generator.choice(len(area), SPOTS, p=area / area.sum()) if area.sum() > 0 else np.zeros(SPOTS, np.int64)
    first, second = np.sqrt(generator.random(SPOTS))[:, None], generator.random(SPOTS)[:, None]
    at = one[face] * (1 - first) + two[face] * first * (1 - second) + three[face] * first * second
    return at, across[face] / np.maximum(area[face, None], 1e-12)


def _area(part: BodyPart) -> float:
    """Return the area of the triangles of a part."""
    one, two, three = (part.vertices[part.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(two - one, three - one), axis=1).sum() / 2)


def _mean_colour(part: BodyPart) -> FloatArray:
    """Return the mean linear base colour (3,): the factor times the means of vertex colours and texture."""
    colour = part.material.base_color[:3] * part.tint[:, :3].mean(axis=0)
    if part.material.base_texture is not None:
        colour = colour * srgb_to_linear(part.material.base_texture[::8, ::8, :3]).reshape(-1, 3).mean(axis=0)
    return np.asarray(colour, dtype=np.float64)
