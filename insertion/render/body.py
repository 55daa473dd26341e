"""A placed model as the renderer takes it: triangles in the object's local frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insertion.colour.encoding import srgb_to_linear
from insertion.models.model import Material, Model
from metric_base.arrays import FloatArray, IntArray

__all__ = ["Body", "BodyPart", "body_of"]


@dataclass(frozen=True, slots=True, eq=False)
class BodyPart:
    """Triangles in the local frame: vertices, normals (n, 3), uv (n, 2), tint (n, 4), faces (m, 3), material."""

    vertices: FloatArray
    normals: FloatArray
    uv: FloatArray
    tint: FloatArray
    faces: IntArray
    material: Material


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A model at its place.

    The local frame has the scene's axes, its origin at the bottom centre `position` (3,) and the length `unit` (scene
    units): x_scene = position + unit * x_local. basis : (3, 3) rows two horizontal axes and up.
    """

    parts: tuple[BodyPart, ...]
    position: FloatArray
    basis: FloatArray
    unit: float

    @property
    def albedo(self) -> FloatArray:
        """(3,) linear, the mean base colour over the surface; metals are taken to reflect as much."""
        area = np.array([_area(part) for part in self.parts])
        colours = np.array([_mean_colour(part) for part in self.parts])
        return np.asarray(area @ colours / max(float(area.sum()), 1e-12))

    @property
    def corners(self) -> FloatArray:
        """(n, 3) all vertices in the local frame."""
        return np.concatenate([part.vertices for part in self.parts])

    def camera(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and translation (3,) from the local frame to the camera, in units of `unit`."""
        return rotation, (rotation @ self.position + translation) / self.unit


def body_of(model: Model, position: FloatArray, basis: FloatArray, heading: FloatArray, units_per_metre: float) -> Body:
    """The model standing with its bottom centre at `position`, its front (+z of the file) along `heading`.

    heading : (3,) horizontal unit direction in the scene; units_per_metre : scene units for one metre of the file,
    which is the size factor divided by the scale.
    """
    up = basis[2]
    turn = np.column_stack([np.cross(up, heading), up, heading])  # columns: where the file's x, y, z point
    low, high = model.bounds
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
        for part in model.parts
    )
    return Body(parts, np.asarray(position, dtype=np.float64), basis, unit * units_per_metre)


def _area(part: BodyPart) -> float:
    """The area of the part's triangles."""
    one, two, three = (part.vertices[part.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(two - one, three - one), axis=1).sum() / 2)


def _mean_colour(part: BodyPart) -> FloatArray:
    """(3,) linear base colour: the factor times the means of the vertices' tint and of the texture."""
    colour = part.material.base_color[:3] * part.tint[:, :3].mean(axis=0)
    if part.material.base_texture is not None:
        colour = colour * srgb_to_linear(part.material.base_texture[::8, ::8, :3]).reshape(-1, 3).mean(axis=0)
    return np.asarray(colour, dtype=np.float64)
