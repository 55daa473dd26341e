"""glTF 2.0 and GLB files: the meshes of the scene's nodes with their materials.

trimesh, which reads the format too, rounds colours to 8 bits and leaves out vertex colours beside a material, further
texture coordinates, sparse accessors and normalised integers, all in silence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.gltf.accessors import Accessors
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
from insertion.models.gltf_materials import Materials
from insertion.models.model import Model, Part
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = ["read_model"]

#: How the corners of a primitive make faces, by the file's numbers.
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_FACES = (_TRIANGLES, _STRIP, _FAN)
#: Metres from its origin beyond which no part of a thing is.
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
                parts, warnings = _read(header, binary[8:], FolderResolver(path))  # a chunk begins with length and kind
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
    return Model(path.name, parts, tuple(warnings))


def _read(header: dict[str, Any], binary: bytes, resolver: FolderResolver) -> tuple[tuple[Part, ...], list[str]]:
    """The parts and what was left out; binary : the buffer that a GLB holds itself."""
    buffers = buffers_of(header, binary, resolver)
    check_images(header, buffers, resolver)
    materials = Materials(header, lambda number: image_bytes(header, number, buffers, resolver))
    parts = tuple(_parts(header, Accessors(header, buffers), materials))
    return parts, [*_warnings(header), *materials.warnings]


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
    lines = []
    if header.get("animations"):
        lines.append(f"{len(header['animations'])} animation(s) are ignored: the object is inserted as it stands")
    if header.get("skins"):
        lines.append("skins are ignored: the mesh is inserted in its bind pose")
    primitives = [part for mesh in header.get("meshes", []) for part in mesh.get("primitives", [])]
    if any(part.get("targets") for part in primitives):
        lines.append("morph targets are ignored")
    if any(part.get("mode", _TRIANGLES) not in _FACES for part in primitives):
        lines.append("points and lines are ignored")
    return lines


def _parts(header: dict[str, Any], accessors: Accessors, materials: Materials) -> Iterator[Part]:
    """One part for each primitive of each node of the scene, in the frame of the file."""
    read: dict[int, list[Part]] = {}
    for number, matrix in _placed_meshes(header):
        if number not in read:
            primitives = header["meshes"][number].get("primitives", [])
            with at_field(f"meshes[{number}]"):
                read[number] = [
                    _part(part, accessors, materials)
                    for part in primitives
                    if part.get("mode", _TRIANGLES) in _FACES and "POSITION" in part.get("attributes", {})
                ]
        yield from (_part_in_file(part, matrix) for part in read[number] if len(part.faces))


def _placed_meshes(header: dict[str, Any]) -> Iterator[tuple[int, FloatArray]]:
    """The meshes of the default scene's nodes with their (4, 4) matrices; the nodes are trees of bounded depth."""
    nodes, scenes = header.get("nodes", []), header.get("scenes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    roots = scenes[header.get("scene", 0)].get("nodes", []) if scenes else [k for k in range(len(nodes))
                                                                            if k not in children]  # fmt: skip
    waiting = [(int(root), np.eye(4)) for root in dict.fromkeys(roots)]
    while waiting:
        number, above = waiting.pop()
        node = nodes[number]
        matrix = above @ _node_matrix(node)
        if "mesh" in node:
            yield int(node["mesh"]), matrix
        waiting += [(int(child), matrix) for child in node.get("children", [])]


def _node_matrix(node: dict[str, Any]) -> FloatArray:
    """(4, 4) of a node: its matrix, stored by columns, or its scale, then rotation, then translation."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = (float(value) for value in node.get("rotation", [0, 0, 0, 1]))
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]), dtype=np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64).reshape(3)
    return matrix


def _part(primitive: dict[str, Any], accessors: Accessors, materials: Materials) -> Part:
    """A primitive in its mesh's frame."""
    attributes = primitive["attributes"]
    vertices = accessors.values(attributes["POSITION"], (3,))
    count = len(vertices)
    corners = accessors.indices(primitive["indices"]) if "indices" in primitive else np.arange(count)
    inside = not len(corners) or int(corners.max()) < count
    expect(inside, "indices", f"numbers from 0 to {count - 1}", Unquoted("others"))
    faces = _faces(corners, int(primitive.get("mode", _TRIANGLES)))
    material, coordinates = materials.material(primitive.get("material"))
    stated = attributes.get(f"TEXCOORD_{coordinates.number}")
    uv = np.zeros((count, 2)) if stated is None else coordinates(accessors.values(stated, (2,)))
    colour = _colour(accessors.values(attributes["COLOR_0"], (3, 4))) if "COLOR_0" in attributes else None
    if "NORMAL" in attributes:
        return Part(vertices, accessors.values(attributes["NORMAL"], (3,)), uv, faces, material, colour)
    # glTF 2.0, 3.7.2.1: "When normals are not specified, client implementations MUST calculate flat normals"
    rows = faces.reshape(-1)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    normals = np.repeat(_unit(np.cross(edges[:, 0], edges[:, 1])), 3, axis=0)
    own = None if colour is None else colour[rows]
    return Part(vertices[rows], normals, uv[rows], np.arange(len(rows)).reshape(-1, 3), material, own)


def _faces(corners: IntArray, mode: int) -> IntArray:
    """(m, 3) rows of triangles, strips or fans of (n,) corners."""
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    first, second, third = corners[:-2], corners[1:-1], corners[2:]
    if mode == _FAN:
        return np.column_stack([np.full_like(second, corners[0]), second, third])
    odd = np.arange(len(third)) % 2 == 1  # every other triangle of a strip is turned over
    return np.column_stack([first, np.where(odd, third, second), np.where(odd, second, third)])


def _colour(values: FloatArray) -> FloatArray:
    """(n, 4) linear colours of (n, 3) or (n, 4) values."""
    opaque = np.ones((len(values), 1))
    return np.clip(values if values.shape[1] == 4 else np.hstack([values, opaque]), 0.0, 1.0)


def _part_in_file(part: Part, matrix: FloatArray) -> Part:
    """The part in the frame of the file; matrix (4, 4) of its node."""
    linear = matrix[:3, :3]
    normals = _unit(part.normals @ np.linalg.pinv(linear))  # they turn with the inverse transpose
    faces = part.faces[:, ::-1] if np.linalg.det(linear) < 0 else part.faces  # a mirror turns faces inside out
    return replace(part, vertices=part.vertices @ linear.T + matrix[:3, 3], normals=normals, faces=faces)


def _unit(vectors: FloatArray) -> FloatArray:
    """(n, 3) vectors of length 1; those of length 0 stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
