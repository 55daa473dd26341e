"""The bodies of a glTF file: boxes of its vertices after all transforms, skinned meshes in their rest pose."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimator.assets.asset import Asset, Body, Box, Word, body_of
from estimator.gltf.accessors import Accessors
from estimator.gltf.gltf_files import MAX_BYTES, FolderResolver, buffers_of, check_header, gltf_header
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, in_file
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = ["local_transform", "read_gltf"]

#: Fields of `asset.extras` and `extras` that name a model.
_TITLES = ("title", "name", "label", "category", "description")


class _Document:
    """The scene of a file, walked from its roots."""

    def __init__(self, header: dict[str, Any], buffers: list[bytes]) -> None:
        self.header = header
        self.nodes: list[dict[str, Any]] = header.get("nodes", [])
        self._meshes: list[dict[str, Any]] = header.get("meshes", [])
        self._accessors = Accessors(header, buffers)
        self._world = self._world_transforms()

    def roots(self) -> list[int]:
        """The root nodes of the scene that is shown, or of all nodes where no scene is."""
        scenes = self.header.get("scenes", [])
        if scenes:
            scene = scenes[self.header.get("scene", 0)]
            return list(scene.get("nodes", []))
        below = set(itertools.chain.from_iterable(node.get("children", []) for node in self.nodes))
        return [number for number in range(len(self.nodes)) if number not in below]

    def below(self, root: int) -> Iterator[int]:
        """A node and all nodes below it."""
        waiting = [root]
        while waiting:
            number = waiting.pop()
            yield number
            waiting.extend(self.nodes[number].get("children", []))

    def box(self, root: int) -> Box | None:
        """The corners (3,) of the box of all vertices at or below a node, None without any."""
        clouds = [points for number in self.below(root) for points in self._points(number)]
        if not clouds:
            return None
        return np.min([cloud.min(axis=0) for cloud in clouds], axis=0), np.max(
            [cloud.max(axis=0) for cloud in clouds], axis=0
        )

    def words(self, root: int) -> tuple[Word, ...]:
        """Names of nodes, meshes and materials at or below a node."""
        words = []
        for number in self.below(root):
            node = self.nodes[number]
            words.append(Word("node", str(node.get("name", ""))))
            if "mesh" in node:
                mesh = self._meshes[node["mesh"]]
                words.append(Word("mesh", str(mesh.get("name", ""))))
                materials = self.header.get("materials", [])
                used = {part.get("material") for part in mesh.get("primitives", [])} - {None}
                words += [Word("material", str(materials[place].get("name", ""))) for place in sorted(used)]
        return tuple(word for word in words if word.text)

    def _points(self, number: int) -> Iterator[FloatArray]:
        """Vertices (n, 3) of a node's primitives in the scene's frame."""
        node = self.nodes[number]
        if "mesh" not in node:
            return
        joints = self._joint_transforms(node["skin"]) if "skin" in node else None
        for part in self._meshes[node["mesh"]].get("primitives", []):
            attributes = part.get("attributes", {})
            if "POSITION" not in attributes:
                continue
            points = self._positions(attributes["POSITION"])
            if joints is not None and {"JOINTS_0", "WEIGHTS_0"} <= set(attributes) and len(points):
                yield self._skin_points(points, attributes, joints)
            else:
                yield _transform_points(points, self._world[number])

    def _positions(self, accessor: int) -> FloatArray:
        """Vertices (n, 3), or the corners of the stated box where they are compressed."""
        row = self.header["accessors"][accessor]
        if "bufferView" in row or "sparse" in row:
            points = self._accessors.values(accessor, (3,))
        else:
            expect(
                "min" in row and "max" in row, f"accessors[{accessor}]", "vertices, or min and max", Unquoted("none")
            )
            points = np.array(list(itertools.product(*zip(row["min"], row["max"], strict=True))), dtype=float)
        expect(bool(np.isfinite(points).all()), f"accessors[{accessor}]", "finite numbers", Unquoted("others"))
        return np.asarray(points)

    def _skin_points(self, points: FloatArray, attributes: dict[str, int], joints: FloatArray) -> FloatArray:
        """Vertices (n, 3) as the joints (j, 4, 4) hold them, without the node's own transform (glTF 2.0, 3.7.3.3)."""
        weights = self._accessors.values(attributes["WEIGHTS_0"], (4,))  # (n, 4)
        which = self._accessors.values(attributes["JOINTS_0"], (4,)).astype(int)  # (n, 4)
        if len(weights) != len(points) or which.max(initial=0) >= len(joints):
            raise FieldError("skins", "joints and weights for each vertex", Unquoted("others"))
        total = np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        matrices = np.einsum("nw,nwij->nij", weights / total, joints[which])
        return np.asarray(np.einsum("nij,nj->ni", matrices[:, :3, :3], points) + matrices[:, :3, 3])

    def _joint_transforms(self, skin: int) -> FloatArray:
        """(j, 4, 4) of each joint: its place in the scene after the inverse of its place when it was bound."""
        row = self.header["skins"][skin]
        joints = row["joints"]
        world = np.stack([self._world[joint] for joint in joints])
        if "inverseBindMatrices" not in row:
            return world
        inverse = self._accessors.values(row["inverseBindMatrices"], (16,)).reshape(-1, 4, 4).transpose(0, 2, 1)
        expect(len(inverse) >= len(joints), f"skins[{skin}]", f"{len(joints)} inverse matrices", len(inverse))
        return np.asarray(world @ inverse[: len(joints)])

    def _world_transforms(self) -> list[FloatArray]:
        """(4, 4) of each node; the tree is known to have no circle."""
        parents = {child: number for number, node in enumerate(self.nodes) for child in node.get("children", [])}
        world: dict[int, FloatArray] = {}
        for number in range(len(self.nodes)):
            way = [number]
            while way[-1] not in world and way[-1] in parents:
                way.append(parents[way[-1]])
            for step in reversed(way):
                if step not in world:
                    local = local_transform(self.nodes[step])
                    world[step] = world[parents[step]] @ local if step in parents else local
        return [world[number] for number in range(len(self.nodes))]


def read_gltf(path: Path) -> Asset:
    """What a `.gltf` or `.glb` file states. Metres and y up are the format's rule (glTF 2.0, 3.4)."""
    with in_file(path):
        header, binary = gltf_header(read_bytes(path, limit=MAX_BYTES), compressed=True)
        check_header(header)
        buffers = buffers_of(header, binary[8:], FolderResolver(path))
        document = _Document(header, buffers)
        bodies = tuple(_bodies(document))
    return Asset(path, "gltf", 1.0, "y", bodies, _asset_words(header))


def local_transform(node: dict[str, Any]) -> FloatArray:
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


def _bodies(document: _Document) -> Iterator[Body]:
    """One body for each root; a chain of single children counts as its last."""
    roots = document.roots()
    while len(roots) == 1 and "mesh" not in document.nodes[roots[0]] and document.nodes[roots[0]].get("children"):
        roots = list(document.nodes[roots[0]]["children"])
    for root in roots:
        box = document.box(root)
        if box is not None:
            name = str(document.nodes[root].get("name") or f"node {root}")
            yield body_of(name, box, 1.0, document.words(root))


def _asset_words(header: dict[str, Any]) -> tuple[Word, ...]:
    extras = header["asset"].get("extras")
    texts = [extras.get(field) for field in _TITLES] if isinstance(extras, dict) else []
    words = [Word("title", text) for text in texts if isinstance(text, str)]
    names = [scene.get("name") for scene in header.get("scenes", [])]
    return (*words, *(Word("node", name) for name in names if isinstance(name, str)))


def _transform_points(points: FloatArray, matrix: FloatArray) -> FloatArray:
    """Points (n, 3) under a transform (4, 4)."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
