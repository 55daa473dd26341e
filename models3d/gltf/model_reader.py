"""Read a glTF file as a model for rendering: triangles with materials, at rest and in the poses of its animations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import InputError, Unquoted, at_field, damage_as_field_error, expect, in_file
from models3d.gltf.animation import GltfAnimation, posed_nodes, read_animation
from models3d.gltf.document import MAX_TRIANGLES, TRIANGLES, GltfDocument, world_transforms
from models3d.gltf.materials import Materials
from models3d.gltf.primitives import FACE_MODES, Primitive, read_primitive
from models3d.model import Animation, Mesh, Model

#: Maximum absolute coordinate of a vertex, in metres.
MAX_METRES = 1e9
#: Errors that damaged files cause in the readers.
_DAMAGE = (
    ValueError, LookupError, TypeError, AttributeError, ArithmeticError, OSError, SyntaxError, RecursionError,
    MemoryError,
)  # fmt: skip


def read_model(path: Path) -> Model:
    """Read the default scene of a `.glb` or `.gltf` file.

    Parameters
    ----------
    path : Path
        The file. External buffers and images must be in its folder.

    Returns
    -------
    Model
        One mesh for each primitive that a node draws, in the frame of the file, with its vertex colours; points and
        lines are skipped with a warning. Animations that do not move anything are omitted.

    Raises
    ------
    InputError
        The file is missing or damaged, exceeds a limit, requires an unsupported extension, or has no triangle.
    """
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "none"
        raise InputError(f"{path}: expected a glTF file (.glb or .gltf); found {kind}")
    # infinite and undefined values are rejected in `_check_meshes`
    with (
        in_file(path),
        damage_as_field_error("a readable glTF 2.0 file", _DAMAGE),
        np.errstate(all="ignore"),
    ):
        document = GltfDocument.open(path)
        document.check_images()
        materials = Materials(document.header, document.image)
        drawn = [index for index in document.walk(document.roots()) if "mesh" in document.nodes[index]]
        primitives: dict[int, list[Primitive]] = {}
        for mesh in dict.fromkeys(int(document.nodes[index]["mesh"]) for index in drawn):
            with at_field(f"meshes[{mesh}]"):
                primitives[mesh] = [
                    read_primitive(record, document, materials)
                    for record in document.header["meshes"][mesh].get("primitives", [])
                    if record.get("mode", TRIANGLES) in FACE_MODES and "POSITION" in record.get("attributes", {})
                ]

        def posed_meshes(nodes: Sequence[Mapping[str, Any]]) -> tuple[Mesh, ...]:
            """Return the meshes of all drawn nodes in the pose of these nodes."""
            world = world_transforms(nodes)
            meshes: list[Mesh] = []
            for index in drawn:
                node = nodes[index]
                joints = document.joint_transforms(node["skin"], world) if "skin" in node else None
                weights = node.get("weights", document.header["meshes"][int(node["mesh"])].get("weights", []))
                morph_weights = np.asarray(weights, dtype=np.float64)
                with_faces = [primitive for primitive in primitives[int(node["mesh"])] if len(primitive.faces)]
                meshes += [primitive.pose(world[index], joints, morph_weights) for primitive in with_faces]
            return tuple(meshes)

        meshes = posed_meshes(document.nodes)
        animations = [read_animation(document, index) for index in range(len(document.header.get("animations", [])))]
        modes = {
            primitive.get("mode", TRIANGLES)
            for mesh in document.header.get("meshes", [])
            for primitive in mesh.get("primitives", [])
        }
        _check_meshes(meshes)

    def meshes_at(animation: GltfAnimation) -> Callable[[float], tuple[Mesh, ...]]:
        return lambda time_s: posed_meshes(posed_nodes(document.nodes, animation, time_s))

    ignored = () if modes <= set(FACE_MODES) else ("points and lines are ignored",)
    return Model(
        path.name,
        meshes,
        (*ignored, *materials.warnings),
        tuple(Animation(a.name, a.duration_s, meshes_at(a)) for a in animations if a.channels and a.duration_s > 0),
    )


def _check_meshes(meshes: Sequence[Mesh]) -> None:
    """Raise FieldError unless the meshes have finite vertices, attributes for each vertex, and an extent."""
    triangles = sum(len(mesh.faces) for mesh in meshes)
    expect(triangles > 0, "meshes", "at least one triangle", Unquoted("none"))
    expect(triangles <= MAX_TRIANGLES, "meshes", f"at most {MAX_TRIANGLES} triangles", triangles)
    finite = all((np.abs(mesh.vertices) < MAX_METRES).all() for mesh in meshes)
    expect(finite, "POSITION", f"finite numbers below {MAX_METRES:g}", Unquoted("others"))
    for mesh in meshes:
        count, material = len(mesh.vertices), mesh.material
        for field, values, columns in (("NORMAL", mesh.normals, 3), ("TEXCOORD_0", mesh.uv, 2)):
            expect(values.shape == (count, columns), field, "a value for each vertex", Unquoted("another number"))
            expect(np.isfinite(values).all(), field, "finite numbers", Unquoted("others"))
        factors = np.array([material.metallic, material.roughness, material.alpha_cutoff or 0.0])
        is_valid = material.base_color.shape == (4,) and material.emissive.shape == (3,)
        colours = (material.base_color, material.emissive, factors)
        is_valid = is_valid and all((np.isfinite(colour) & (colour >= 0)).all() for colour in colours)
        expect(is_valid, "materials", "colours of four and three numbers of at least 0", Unquoted("others"))
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    extent = (corners.max(axis=0) - corners.min(axis=0)).max()
    expect(extent > 0, "POSITION", "an object with an extent", Unquoted("a single point"))
