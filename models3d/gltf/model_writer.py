"""Write a renderable model as glTF.

The meshes are written as they are drawn, not copied from the file of the model.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from models3d.gltf.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GltfWriter
from models3d.model import Model


def write_gltf_model(file: Path, model: Model) -> None:
    """Write a model in its current pose as a GLB file."""
    document = GltfWriter("insert-object")
    node = document.add("nodes", {"mesh": add_mesh(document, model)})
    file.write_bytes(document.to_bytes([node]))


def add_mesh(document: GltfWriter, model: Model, name: str | None = None) -> int:
    """Add the meshes of a model as one mesh of glTF, and return its number."""
    primitives: list[dict[str, Any]] = []
    for mesh in model.meshes:
        material = mesh.material
        # A normal of length 0, of a face without an area, is written as an upward one: glTF requires unit vectors.
        lengths = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
        normals = np.where(lengths > 0.5, mesh.normals / np.maximum(lengths, 1e-12), [0.0, 1.0, 0.0])
        attributes = {
            "POSITION": document.add_accessor(mesh.vertices, ARRAY_BUFFER, bounds=True),
            "NORMAL": document.add_accessor(normals, ARRAY_BUFFER),
        }
        if material.textures:
            attributes["TEXCOORD_0"] = document.add_accessor(mesh.uv, ARRAY_BUFFER)
        if mesh.color is not None:
            attributes["COLOR_0"] = document.add_accessor(np.clip(mesh.color, 0, 1), ARRAY_BUFFER)
        indices = document.add_accessor(mesh.faces.ravel().astype(np.uint32), ELEMENT_ARRAY_BUFFER)
        surface: dict[str, Any] = {
            "baseColorFactor": np.clip(material.base_color, 0, 1).tolist(),
            "metallicFactor": min(material.metallic, 1.0),
            "roughnessFactor": min(material.roughness, 1.0),
        }
        strength = float(material.emissive.max())
        record: dict[str, Any] = {
            "pbrMetallicRoughness": surface,
            "emissiveFactor": (material.emissive / max(1.0, strength)).tolist(),
            "doubleSided": True,  # the renderer draws both sides
        }
        if strength > 1:
            record["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            document.use_extension("KHR_materials_emissive_strength")
        for target, field, pixels in (
            (surface, "baseColorTexture", material.base_texture),
            (surface, "metallicRoughnessTexture", material.surface_texture),
            (record, "normalTexture", material.normal_texture),
            (record, "emissiveTexture", material.emissive_texture),
        ):
            if pixels is not None:
                target[field] = {"index": document.add_texture(pixels)}
        if material.alpha_cutoff is not None:
            record |= {"alphaMode": "MASK", "alphaCutoff": material.alpha_cutoff}
        elif material.blend:
            record["alphaMode"] = "BLEND"
        number = document.add("materials", record)
        primitives.append({"attributes": attributes, "indices": indices, "material": number})
    return document.add("meshes", ({} if name is None else {"name": name}) | {"primitives": primitives})
