"""Read the primitives of a glTF file, and pose them: morphed, and then skinned or moved by a node."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import Unquoted, expect
from models3d.gltf.document import TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, GltfDocument, skin_transforms
from models3d.gltf.materials import Materials
from models3d.model import Material, Mesh

#: Values of `primitive.mode` that have faces.
FACE_MODES = (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN)


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """A primitive in the frame of its mesh, before morphing and skinning."""

    #: (n, 3) vertices.
    points: FloatArray
    #: (n, 3), or None for flat faces, whose normals follow from the pose.
    normals: FloatArray | None
    #: (n, 2) texture coordinates.
    uv: FloatArray
    #: (m, 3) rows of `points`.
    faces: IntArray
    material: Material
    #: (n, 4) linear vertex colours, or None.
    color: FloatArray | None
    #: (n, k) joints of each vertex, or None without a skin.
    joint_index: FloatArray | None
    #: (n, k) weights of these joints, or None without a skin.
    weights: FloatArray | None
    #: For each morph target, the displacements (n, 3) of points and normals, or None.
    targets: tuple[tuple[FloatArray | None, FloatArray | None], ...]

    def pose(self, matrix: FloatArray, joints: FloatArray | None, morph_weights: FloatArray) -> Mesh:
        """Return the posed mesh in the frame of the file.

        Parameters
        ----------
        matrix : (4, 4) ndarray of float
            Transform of the node; not applied to a skinned primitive.
        joints : (j, 4, 4) ndarray of float, optional
            Transforms of the joints of the skin (`GltfDocument.joint_transforms`).
        morph_weights : (t,) ndarray of float
            Weights of the morph targets.
        """
        points, normals = self.points, self.normals
        for weight, (moved, tilted) in zip(morph_weights, self.targets, strict=False):
            if weight and moved is not None:
                points = points + weight * moved
            if weight and tilted is not None and normals is not None:
                normals = normals + weight * tilted
        if joints is not None and self.joint_index is not None and self.weights is not None:
            matrix = skin_transforms(self.joint_index, self.weights, joints, len(points))
        matrices = np.broadcast_to(matrix, (len(points), 4, 4)) if matrix.ndim == 2 else matrix
        linear = matrices[:, :3, :3]
        cofactors = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])  # (n, 3, 3), along the inverse transposes
        is_mirrored = np.einsum("ni,ni->n", cofactors[:, 0], linear[:, 0]) < 0
        turns_faces = len(is_mirrored) > 0 and float(is_mirrored.mean()) > 0.5
        faces = self.faces[:, ::-1] if turns_faces else self.faces
        vertices = np.einsum("nij,nj->ni", linear, points) + matrices[:, :3, 3]
        if normals is None:
            normals = np.zeros_like(vertices)
            edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
            normals[faces] = np.cross(edges[:, 0], edges[:, 1])[:, None]
        else:
            normals = np.einsum("nij,nj->ni", cofactors, normals) * np.where(is_mirrored, -1.0, 1.0)[:, None]
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        unit_normals = np.asarray(normals / np.maximum(lengths, 1e-12))
        return Mesh(vertices, unit_normals, self.uv, faces, self.material, self.color)


def read_primitive(primitive: dict[str, Any], document: GltfDocument, materials: Materials) -> Primitive:
    """Read a primitive; without normals, its faces do not share vertices.

    Raises
    ------
    FieldError
        An index does not exist, or an attribute has the wrong number of values or values that are not finite.
    """
    attributes = primitive["attributes"]
    points = document.accessor(attributes["POSITION"], (3,))
    count = len(points)
    corners = document.indices(primitive["indices"]) if "indices" in primitive else np.arange(count)
    is_inside = not len(corners) or (corners.min() >= 0 and corners.max() < count)
    expect(is_inside, "indices", f"numbers from 0 to {count - 1}", Unquoted("others"))
    mode = int(primitive.get("mode", TRIANGLES))
    first, second, third = corners[:-2], corners[1:-1], corners[2:]
    if mode == TRIANGLES:
        faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
    elif mode == TRIANGLE_FAN:
        faces = np.column_stack([np.full_like(second, corners[0]), second, third])
    else:
        is_odd = np.arange(len(third)) % 2 == 1  # every other triangle of a strip has the opposite orientation
        faces = np.column_stack([first, np.where(is_odd, third, second), np.where(is_odd, second, third)])
    material, coordinates = materials.material(primitive.get("material"))
    uv_accessor = attributes.get(f"TEXCOORD_{coordinates.number}")
    uv = np.zeros((count, 2)) if uv_accessor is None else coordinates(document.accessor(uv_accessor, (2,)))
    colour = None
    if "COLOR_0" in attributes:
        colour = document.accessor(attributes["COLOR_0"], (3, 4))
        colour = colour if colour.shape[1] == 4 else np.hstack([colour, np.ones((len(colour), 1))])
        colour = np.clip(colour, 0.0, 1.0)
    normals = document.accessor(attributes["NORMAL"], (3,)) if "NORMAL" in attributes else None
    # Joints and weights (n, k) of all sets of four.
    joint_index = weights = None
    sets = [k for k in range(len(attributes)) if {f"JOINTS_{k}", f"WEIGHTS_{k}"} <= set(attributes)]
    if sets:
        joint_index, weights = (
            np.hstack([document.accessor(attributes[f"{name}_{k}"], (4,)) for k in sets])
            for name in ("JOINTS", "WEIGHTS")
        )
        expect(np.isfinite(weights).all(), "WEIGHTS_0", "finite numbers", Unquoted("others"))
    targets = []
    for target in primitive.get("targets", []):
        added = [document.accessor(target[name], (3,)) if name in target else None for name in ("POSITION", "NORMAL")]
        is_valid = all(values is None or (len(values) == count and np.isfinite(values).all()) for values in added)
        expect(is_valid, "targets", f"{count} finite values", Unquoted("others"))
        targets.append((added[0], added[1]))
    read = Primitive(points, normals, uv, faces, material, colour, joint_index, weights, tuple(targets))
    if normals is not None:
        return read
    # glTF 2.0, 3.7.2.1: "When normals are not specified, client implementations MUST calculate flat normals"
    rows = faces.reshape(-1)
    return replace(
        read,
        points=points[rows],
        uv=uv[rows],
        faces=np.arange(len(rows)).reshape(-1, 3),
        color=None if colour is None else colour[rows],
        joint_index=None if joint_index is None else joint_index[rows],
        weights=None if weights is None else weights[rows],
        targets=tuple((None if moved is None else moved[rows], None) for moved, _ in targets),
    )
