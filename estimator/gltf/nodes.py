"""The nodes of a glTF file: where each one is, and what its joints do to a skinned mesh (glTF 2.0, 3.5 and 3.7.3)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator.gltf.accessors import Accessors
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted
from metric_base.schema import expect

__all__ = ["joint_transforms", "local_transform", "root_nodes", "skin_transforms", "world_transforms"]


def root_nodes(header: dict[str, Any]) -> list[int]:
    """The root nodes of the scene that is shown, or of all nodes where no scene is."""
    scenes, nodes = header.get("scenes", []), header.get("nodes", [])
    if scenes:
        return list(dict.fromkeys(scenes[header.get("scene", 0)].get("nodes", [])))
    below = set(itertools.chain.from_iterable(node.get("children", []) for node in nodes))
    return [number for number in range(len(nodes)) if number not in below]


def local_transform(node: Mapping[str, Any]) -> FloatArray:
    """(4, 4) of a node: its matrix, or translation, rotation and scale in this order."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=float)
        expect(matrix.shape == (16,), "matrix", "16 numbers", Unquoted(str(matrix.shape)))
        return matrix.reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=float)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=float)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def world_transforms(nodes: Sequence[Mapping[str, Any]]) -> list[FloatArray]:
    """(4, 4) of each node in the scene's frame; the nodes are known to be trees."""
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", [])}
    world: dict[int, FloatArray] = {}
    for number in range(len(nodes)):
        way = [number]
        while way[-1] not in world and way[-1] in parents:
            way.append(parents[way[-1]])
        for step in reversed(way):
            if step not in world:
                local = local_transform(nodes[step])
                world[step] = world[parents[step]] @ local if step in parents else local
    return [world[number] for number in range(len(nodes))]


def joint_transforms(
    header: dict[str, Any], accessors: Accessors, skin: int, world: Sequence[FloatArray]
) -> FloatArray:
    """(j, 4, 4) of each joint of a skin: its place in `world` after the inverse of its place when it was bound."""
    row = header["skins"][skin]
    joints = row["joints"]
    places = np.stack([world[joint] for joint in joints])
    if "inverseBindMatrices" not in row:
        return places
    inverse = accessors.values(row["inverseBindMatrices"], (16,)).reshape(-1, 4, 4).transpose(0, 2, 1)
    expect(len(inverse) >= len(joints), f"skins[{skin}]", f"{len(joints)} inverse matrices", len(inverse))
    return np.asarray(places @ inverse[: len(joints)])


def skin_transforms(which: FloatArray, weights: FloatArray, joints: FloatArray, count: int) -> FloatArray:
    """(n, 4, 4) of each of `count` vertices as the joints (j, 4, 4) hold it (3.7.3.3).

    which, weights : (n, k) numbers of joints and their weights. The transform of the mesh's own node does not count.
    """
    if not len(which) == len(weights) == count or which.max(initial=0) >= len(joints):
        raise FieldError("skins", "joints and weights for each vertex", Unquoted("others"))
    total = np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    return np.asarray(np.einsum("nw,nwij->nij", weights / total, joints[which.astype(int)]))
