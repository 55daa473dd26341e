"""glTF 2.0 and GLB files: the meshes of the scene's nodes with their materials, at rest and as animations move them.

trimesh, which reads the format too, rounds colours to 8 bits and leaves out vertex colours beside a material, further
texture coordinates, sparse accessors and normalised integers, all in silence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.gltf.accessors import Accessors
from estimator.gltf.animation import moved_nodes, read_animation
from estimator.gltf.gltf_files import (
    MAX_BYTES,
    MAX_TRIANGLES,
    FolderResolver,
    buffers_of,
    check_header,
    check_images,
    gltf_header,
    image_bytes,
)
from estimator.gltf.nodes import joint_transforms, root_nodes, world_transforms
from insertion.models.gltf_materials import Materials
from insertion.models.gltf_primitives import FACES, Primitive, read_primitive
from insertion.models.model import Animation, Model, Part
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = ["read_model"]

#: Metres from its origin beyond which no part of an object is.
MAX_METRES = 1e9


def read_model(path: Path) -> Model:
    """The model of a `.glb` or `.gltf` file. Raises InputError for anything that cannot be read."""
    if not path.is_file():
        raise InputError(
            f"{path}: expected a glTF file (.glb or .gltf); found {'a folder' if path.is_dir() else 'none'}"
        )
    with in_file(path):
        header, binary = gltf_header(read_bytes(path, limit=MAX_BYTES))
        try:
            check_header(header)
            with np.errstate(all="ignore"):  # absurd numbers are refused below
                # a chunk begins with length and kind
                parts, motions, warnings = _read(header, binary[8:], FolderResolver(path))
        except FieldError:
            raise
        except (
            ValueError, KeyError, IndexError, TypeError, AttributeError, ArithmeticError, OSError, SyntaxError,
            RecursionError, MemoryError,
        ) as error:  # fmt: skip
            raise FieldError(
                "content", "a readable glTF 2.0 file", Unquoted(f"{type(error).__name__}: {error}")
            ) from None
        _check_parts(parts)
    return Model(path.name, parts, tuple(warnings), motions)


def _read(
    header: dict[str, Any], binary: bytes, resolver: FolderResolver
) -> tuple[tuple[Part, ...], tuple[Animation, ...], list[str]]:
    """The parts, the motions and what was left out; binary : the buffer that a GLB holds itself."""
    buffers = buffers_of(header, binary, resolver)
    check_images(header, buffers, resolver)
    materials = Materials(header, lambda number: image_bytes(header, number, buffers, resolver))
    document = _Document(header, Accessors(header, buffers), materials)
    parts = document.parts(header.get("nodes", []))
    return parts, document.motions(), [*_warnings(header), *materials.warnings]


def _check_parts(parts: tuple[Part, ...]) -> None:
    triangles = sum(len(part.faces) for part in parts)
    expect(triangles > 0, "meshes", "at least one triangle", Unquoted("none"))
    expect(triangles <= MAX_TRIANGLES, "meshes", f"at most {MAX_TRIANGLES} triangles", triangles)
    finite = all((np.abs(part.vertices) < MAX_METRES).all() for part in parts)
    expect(finite, "POSITION", f"finite numbers below {MAX_METRES:g}", Unquoted("others"))
    for part in parts:
        _check_part(part)
    corners = np.concatenate([part.vertices for part in parts])
    extent = (corners.max(axis=0) - corners.min(axis=0)).max()
    expect(extent > 0, "POSITION", "a body with an extent", Unquoted("a single point"))


def _check_part(part: Part) -> None:
    """FieldError for corners without a normal or a texture coordinate, and for colours of another length."""
    count, material = len(part.vertices), part.material
    inside = not len(part.faces) or (part.faces.min() >= 0 and part.faces.max() < count)
    expect(bool(inside), "indices", f"numbers from 0 to {count - 1}", Unquoted("others"))
    shaped = {"NORMAL": part.normals.shape == (count, 3), "TEXCOORD_0": part.uv.shape == (count, 2)}
    for field, whole in shaped.items():
        expect(whole, field, "a value for each corner", Unquoted("another number of them"))
    values = {"NORMAL": part.normals, "TEXCOORD_0": part.uv}
    for field, numbers in values.items():
        expect(bool(np.isfinite(numbers).all()), field, "finite numbers", Unquoted("others"))
    factors = np.array([material.metallic, material.roughness, material.alpha_cutoff or 0.0])
    sound = material.base_color.shape == (4,) and material.emissive.shape == (3,)
    colours = (material.base_color, material.emissive, factors)
    sound = sound and all((np.isfinite(colour) & (colour >= 0)).all() for colour in colours)
    expect(bool(sound), "materials", "colours of four and three numbers from 0", Unquoted("others"))


def _warnings(header: dict[str, Any]) -> list[str]:
    primitives = [part for mesh in header.get("meshes", []) for part in mesh.get("primitives", [])]
    return ["points and lines are ignored"] if any(part.get("mode", 4) not in FACES for part in primitives) else []


class _Document:
    """The meshes of a file's scene, in the pose that its nodes have."""

    def __init__(self, header: dict[str, Any], accessors: Accessors, materials: Materials) -> None:
        self._header, self._accessors, self._materials = header, accessors, materials
        self._primitives: dict[int, list[Primitive]] = {}
        self._drawn = self._nodes_with_meshes()

    def parts(self, nodes: Sequence[Mapping[str, Any]]) -> tuple[Part, ...]:
        """One part for each primitive of each node, in the frame of the file."""
        world = world_transforms(nodes)
        return tuple(part for number in self._drawn for part in self._parts(nodes[number], number, world))

    def motions(self) -> tuple[Animation, ...]:
        """The animations that move something."""
        nodes = self._header.get("nodes", [])
        read = [
            read_animation(self._header, self._accessors, number)
            for number in range(len(self._header.get("animations", [])))
        ]
        return tuple(
            Animation(one.name, one.duration_s, lambda time_s, one=one: self.parts(moved_nodes(nodes, one, time_s)))  # type: ignore[misc]
            for one in read
            if one.channels and one.duration_s > 0
        )

    def _parts(self, node: Mapping[str, Any], number: int, world: Sequence[FloatArray]) -> Iterator[Part]:
        """The parts of one node; world : (4, 4) of each node."""
        mesh = int(node["mesh"])
        joints = None
        if "skin" in node:
            joints = joint_transforms(self._header, self._accessors, node["skin"], world)
        morphs = np.asarray(node.get("weights", self._header["meshes"][mesh].get("weights", [])), dtype=np.float64)
        for primitive in self._mesh(mesh):
            if len(primitive.faces):
                yield primitive.pose(world[number], joints, morphs)

    def _mesh(self, number: int) -> list[Primitive]:
        if number not in self._primitives:
            stated = self._header["meshes"][number].get("primitives", [])
            with at_field(f"meshes[{number}]"):
                self._primitives[number] = [
                    read_primitive(part, self._accessors, self._materials)
                    for part in stated
                    if part.get("mode", 4) in FACES and "POSITION" in part.get("attributes", {})
                ]
        return self._primitives[number]

    def _nodes_with_meshes(self) -> list[int]:
        """Numbers of the nodes of the scene that draw something; the nodes are trees of bounded depth."""
        nodes, drawn = self._header.get("nodes", []), []
        waiting = root_nodes(self._header)
        while waiting:
            number = waiting.pop()
            drawn += [number] if "mesh" in nodes[number] else []
            waiting += nodes[number].get("children", [])
        return drawn
