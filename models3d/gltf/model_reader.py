"""Read a glTF file as a model for rendering: triangles with materials, at rest and in the poses of its animations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file
from models3d.gltf.animation import GltfAnimation, posed_nodes, read_animation
from models3d.gltf.document import MAX_TRIANGLES, GltfDocument, world_transforms
from models3d.gltf.materials import Materials
from models3d.gltf.primitives import FACES, Primitive, read_primitive
from models3d.model import Animation, Mesh, Model

#: Maximum absolute coordinate of a vertex, in metres.
MAX_METRES = 1e9


def read_model(path: Path) -> Model:
    """Read the default scene of a `.glb` or `.gltf` file.

    Parameters
    ----------
    path : Path
        The file. External buffers and images must be in its folder.

    Returns
    -------
    Model
        One part for each primitive that a node draws, in the frame of the file; points and lines are skipped with a
        warning. The animations that move something are its motions.

    Raises
    ------
    InputError
        The file is missing or damaged, exceeds a limit, requires an unsupported extension, or has no triangle.
    """
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "none"
        raise InputError(f"{path}: expected a glTF file (.glb or .gltf); found {kind}")
    with in_file(path):
        try:
            with np.errstate(all="ignore"):  # infinite and undefined values are rejected in `_check_parts`
                document = GltfDocument.open(path)
                document.check_images()
                materials = Materials(document.header, document.image)
                drawn = [index for index in document.walk(document.roots()) if "mesh" in document.nodes[index]]
                meshes: dict[int, list[Primitive]] = {}
                for mesh in dict.fromkeys(int(document.nodes[index]["mesh"]) for index in drawn):
                    with at_field(f"meshes[{mesh}]"):
                        meshes[mesh] = [
                            read_primitive(record, document, materials)
                            for record in document.header["meshes"][mesh].get("primitives", [])
                            if record.get("mode", 4) in FACES and "POSITION" in record.get("attributes", {})
                        ]

                def posed_parts(nodes: Sequence[Mapping[str, Any]]) -> tuple[Mesh, ...]:
                    """Return the parts of all drawn nodes in the pose of these nodes."""
                    world = world_transforms(nodes)
                    parts: list[Mesh] = []
                    for index in drawn:
                        node = nodes[index]
                        joints = document.joint_transforms(node["skin"], world) if "skin" in node else None
                        weights = node.get("weights", document.header["meshes"][int(node["mesh"])].get("weights", []))
                        morphs = np.asarray(weights, dtype=np.float64)
                        primitives = [row for row in meshes[int(node["mesh"])] if len(row.faces)]
                        parts += [primitive.pose(world[index], joints, morphs) for primitive in primitives]
                    return tuple(parts)

                parts = posed_parts(document.nodes)
                animations = [
                    read_animation(document, index) for index in range(len(document.header.get("animations", [])))
                ]
        except (FieldError, InputError):
            raise
        except (
            ValueError, KeyError, IndexError, TypeError, AttributeError, ArithmeticError, OSError, SyntaxError,
            RecursionError, MemoryError,
        ) as error:  # fmt: skip
            damage = Unquoted(f"{type(error).__name__}: {error}")
            raise FieldError("content", "a readable glTF 2.0 file", damage) from None
        _check_parts(parts)

    def motion(animation: GltfAnimation) -> Animation:
        def parts_at(time_s: float) -> tuple[Mesh, ...]:
            return posed_parts(posed_nodes(document.nodes, animation, time_s))

        return Animation(animation.name, animation.duration_s, parts_at)

    motions = tuple(motion(row) for row in animations if row.channels and row.duration_s > 0)
    modes = {part.get("mode", 4) for mesh in document.header.get("meshes", []) for part in mesh.get("primitives", [])}
    ignored = () if modes <= set(FACES) else ("points and lines are ignored",)
    return Model(path.name, parts, (*ignored, *materials.warnings), motions)


def _check_parts(parts: Sequence[Mesh]) -> None:
    """Raise FieldError unless the parts have finite vertices, attributes for each vertex, and an extent."""
    triangles = sum(len(part.faces) for part in parts)
    expect(triangles > 0, "meshes", "at least one triangle", Unquoted("none"))
    expect(triangles <= MAX_TRIANGLES, "meshes", f"at most {MAX_TRIANGLES} triangles", triangles)
    finite = all((np.abs(part.vertices) < MAX_METRES).all() for part in parts)
    expect(finite, "POSITION", f"finite numbers below {MAX_METRES:g}", Unquoted("others"))
    for part in parts:
        count, material = len(part.vertices), part.material
        inside = not len(part.faces) or (part.faces.min() >= 0 and part.faces.max() < count)
        expect(bool(inside), "indices", f"numbers from 0 to {count - 1}", Unquoted("others"))
        for field, values, columns in (("NORMAL", part.normals, 3), ("TEXCOORD_0", part.uv, 2)):
            shaped = values.shape == (count, columns)
            expect(shaped, field, "a value for each corner", Unquoted("another number of them"))
        for field, values in (("NORMAL", part.normals), ("TEXCOORD_0", part.uv)):
            expect(bool(np.isfinite(values).all()), field, "finite numbers", Unquoted("others"))
        factors = np.array([material.metallic, material.roughness, material.alpha_cutoff or 0.0])
        sound = material.base_color.shape == (4,) and material.emissive.shape == (3,)
        colours = (material.base_color, material.emissive, factors)
        sound = sound and all((np.isfinite(colour) & (colour >= 0)).all() for colour in colours)
        expect(bool(sound), "materials", "colours of four and three numbers from 0", Unquoted("others"))
    corners = np.concatenate([part.vertices for part in parts])
    extent = (corners.max(axis=0) - corners.min(axis=0)).max()
    expect(extent > 0, "POSITION", "a body with an extent", Unquoted("a single point"))
