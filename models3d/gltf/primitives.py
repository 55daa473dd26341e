"""The primitives of a glTF file, and the parts that they are in one pose: morphed, then skinned, or moved by a node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import Unquoted, expect
from models3d.gltf.document import TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, GltfDocument, skin_transforms
from models3d.gltf.materials import Materials
from models3d.model import Material, Mesh

#: Values of `primitive.mode` that have faces.
FACES = (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN)


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """A primitive as the file has it.

    points : (n, 3); normals : (n, 3), None where the faces are flat; uv : (n, 2); faces : (m, 3); color : (n, 4) or
    None; which, weights : (n, k) joints and their weights, None without a skin; targets : what each morph target adds
    to the points and to the normals, each (n, 3) or None.
    """

    points: FloatArray
    normals: FloatArray | None
    uv: FloatArray
    faces: IntArray
    material: Material
    color: FloatArray | None
    which: FloatArray | None
    weights: FloatArray | None
    targets: tuple[tuple[FloatArray | None, FloatArray | None], ...]

    def pose(self, matrix: FloatArray, joints: FloatArray | None, morphs: FloatArray) -> Mesh:
        """The part in the frame of the file.

        matrix : (4, 4) of the node; joints : (j, 4, 4) of its skin, which count in its place; morphs : (t,) weights of
        the targets.
        """
        points, normals = self._with_targets(morphs)
        if joints is not None and self.which is not None and self.weights is not None:
            matrix = skin_transforms(self.which, self.weights, joints, len(points))
        matrix = np.broadcast_to(matrix, (len(points), 4, 4)) if matrix.ndim == 2 else matrix
        linear = matrix[:, :3, :3]
        turn = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])  # (n, 3, 3) cofactors: the inverse transpose
        mirrored = np.einsum("ni,ni->n", turn[:, 0], linear[:, 0]) < 0
        inside_out = len(mirrored) > 0 and float(mirrored.mean()) > 0.5  # a mirror turns faces inside out
        faces = self.faces[:, ::-1] if inside_out else self.faces
        moved = np.einsum("nij,nj->ni", linear, points) + matrix[:, :3, 3]
        if normals is None:
            normals = np.zeros_like(moved)
            edges = moved[faces[:, 1:]] - moved[faces[:, :1]]
            normals[faces] = np.cross(edges[:, 0], edges[:, 1])[:, None]
        else:
            normals = np.einsum("nij,nj->ni", turn, normals) * np.where(mirrored, -1.0, 1.0)[:, None]
        return Mesh(moved, _unit(normals), self.uv, faces, self.material, self.color)

    def _with_targets(self, morphs: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Points and normals (n, 3) with the targets by their weights (t,)."""
        points, normals = self.points, self.normals
        for weight, (moved, turned) in zip(morphs, self.targets, strict=False):
            if weight and moved is not None:
                points = points + weight * moved
            if weight and turned is not None and normals is not None:
                normals = normals + weight * turned
        return points, normals


def read_primitive(primitive: dict[str, Any], document: GltfDocument, materials: Materials) -> Primitive:
    """A primitive in its mesh's frame; one without normals has a corner of its own for each of its faces."""
    attributes = primitive["attributes"]
    points = document.accessor(attributes["POSITION"], (3,))
    count = len(points)
    corners = document.indices(primitive["indices"]) if "indices" in primitive else np.arange(count)
    inside = not len(corners) or int(corners.max()) < count
    expect(inside, "indices", f"numbers from 0 to {count - 1}", Unquoted("others"))
    faces = _faces(corners, int(primitive.get("mode", TRIANGLES)))
    material, coordinates = materials.material(primitive.get("material"))
    stated = attributes.get(f"TEXCOORD_{coordinates.number}")
    uv = np.zeros((count, 2)) if stated is None else coordinates(document.accessor(stated, (2,)))
    colour = _colour(document.accessor(attributes["COLOR_0"], (3, 4))) if "COLOR_0" in attributes else None
    normals = document.accessor(attributes["NORMAL"], (3,)) if "NORMAL" in attributes else None
    which, weights = _joints(attributes, document)
    targets = [_target(target, document, count) for target in primitive.get("targets", [])]
    read = Primitive(points, normals, uv, faces, material, colour, which, weights, tuple(targets))
    # glTF 2.0, 3.7.2.1: "When normals are not specified, client implementations MUST calculate flat normals"
    return _with_own_corners(read) if normals is None else read


def _joints(attributes: dict[str, Any], document: GltfDocument) -> tuple[FloatArray | None, FloatArray | None]:
    """(n, k) joints and weights of all sets of four; None without."""
    sets = [k for k in range(len(attributes)) if {f"JOINTS_{k}", f"WEIGHTS_{k}"} <= set(attributes)]
    if not sets:
        return None, None
    which, weights = (
        np.hstack([document.accessor(attributes[f"{name}_{k}"], (4,)) for k in sets]) for name in ("JOINTS", "WEIGHTS")
    )
    expect(bool(np.isfinite(weights).all()), "WEIGHTS_0", "finite numbers", Unquoted("others"))
    return which, weights


def _target(target: dict[str, Any], document: GltfDocument, count: int) -> tuple[FloatArray | None, FloatArray | None]:
    """What a morph target adds to points and normals, (n, 3) each; FieldError for another number of them."""
    added = [document.accessor(target[name], (3,)) if name in target else None for name in ("POSITION", "NORMAL")]
    for values in added:
        sound = values is None or (len(values) == count and bool(np.isfinite(values).all()))
        expect(sound, "targets", f"{count} finite values", Unquoted("others"))
    return added[0], added[1]


def _with_own_corners(read: Primitive) -> Primitive:
    """The primitive with a corner of its own for each face."""
    rows = read.faces.reshape(-1)

    def own(values: FloatArray | None) -> Any:
        """(3 m, k) rows of values (n, k), one for each corner of a face."""
        return None if values is None else values[rows]

    targets = tuple((own(moved), None) for moved, _ in read.targets)
    faces = np.arange(len(rows)).reshape(-1, 3)
    return Primitive(
        read.points[rows], None, read.uv[rows], faces, read.material, own(read.color), own(read.which),
        own(read.weights), targets,
    )  # fmt: skip


def _faces(corners: IntArray, mode: int) -> IntArray:
    """(m, 3) rows of triangles, strips or fans of (n,) corners."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    first, second, third = corners[:-2], corners[1:-1], corners[2:]
    if mode == TRIANGLE_FAN:
        return np.column_stack([np.full_like(second, corners[0]), second, third])
    odd = np.arange(len(third)) % 2 == 1  # every other triangle of a strip is turned over
    return np.column_stack([first, np.where(odd, third, second), np.where(odd, second, third)])


def _colour(values: FloatArray) -> FloatArray:
    """(n, 4) linear colours of (n, 3) or (n, 4) values."""
    opaque = np.ones((len(values), 1))
    return np.clip(values if values.shape[1] == 4 else np.hstack([values, opaque]), 0.0, 1.0)


def _unit(vectors: FloatArray) -> FloatArray:
    """(n, 3) vectors of length 1; those of length 0 stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
