"""The bodies of a glTF file: boxes of its vertices after all transforms, skinned meshes in their rest pose."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimator.asset_files.asset import Asset, AssetBody, Box, Word, body_of
from estimator.gltf.accessors import Accessors
from estimator.gltf.gltf_files import MAX_BYTES, FolderResolver, buffers_of, check_header, gltf_header
from estimator.gltf.nodes import joint_transforms, root_nodes, skin_transforms, world_transforms
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, in_file
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = ["read_gltf"]

#: Fields of `asset.extras` and `extras` that name a model.
_TITLES = ("title", "name", "label", "category", "description")


class _GltfDocument:
    """The scene of a file, walked from its roots."""

    def __init__(self, header: dict[str, Any], buffers: list[bytes]) -> None:
        self.header = header
        self.nodes: list[dict[str, Any]] = header.get("nodes", [])
        self._meshes: list[dict[str, Any]] = header.get("meshes", [])
        self._accessors = Accessors(header, buffers)
        self._world = world_transforms(self.nodes)

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
        joints = None
        if "skin" in node:
            joints = joint_transforms(self.header, self._accessors, node["skin"], self._world)
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
        """Vertices (n, 3) as the joints (j, 4, 4) hold them."""
        which, weights = (self._accessors.values(attributes[name], (4,)) for name in ("JOINTS_0", "WEIGHTS_0"))
        matrices = skin_transforms(which, weights, joints, len(points))
        return np.asarray(np.einsum("nij,nj->ni", matrices[:, :3, :3], points) + matrices[:, :3, 3])


def read_gltf(path: Path) -> Asset:
    """What a `.gltf` or `.glb` file states. Metres and y up are the format's rule (glTF 2.0, 3.4)."""
    with in_file(path):
        header, binary = gltf_header(read_bytes(path, limit=MAX_BYTES), compressed=True)
        check_header(header)
        buffers = buffers_of(header, binary[8:], FolderResolver(path))
        try:
            bodies = tuple(_bodies(_GltfDocument(header, buffers)))
        except FieldError:
            raise
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
            damage = Unquoted(f"{type(error).__name__}: {error}")
            raise FieldError("content", "nodes, meshes and skins that refer to what is there", damage) from None
    return Asset(path, "gltf", 1.0, "y", bodies, _asset_words(header))


def _bodies(document: _GltfDocument) -> Iterator[AssetBody]:
    """One body for each root; a chain of single children counts as its last."""
    roots = root_nodes(document.header)
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
