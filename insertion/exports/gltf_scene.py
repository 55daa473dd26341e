"""The inserted objects and the animated camera as one GLB file, 1 unit = 1 m, +y up.

The objects are written as they are drawn, not copied from their files: a reader that rounds colours, or knows fewer
kinds of accessors than ours, cannot change them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.glb import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Glb
from insertion.exports.metric_frame import CameraKey, MetricFrame, keys_by_camera, object_matrix
from insertion.models.model import Material, Model, Part
from insertion.pipeline.objects import Placed
from insertion.render.pinhole import focal_lengths
from metric_base.arrays import FloatArray

__all__ = ["write_gltf_model", "write_gltf_scene"]

#: Metres between which a camera sees anything.
NEAR_M, FAR_M = 0.01, 1000.0


def write_gltf_scene(file: Path, objects: Sequence[Placed], keys: Sequence[CameraKey], frame: MetricFrame) -> None:
    """Write the file, with an animated camera for each of the cameras that took the pictures.

    glTF knows no lens distortion and no principal point: each is the ideal camera with the same focal lengths, its
    axis through the middle of the picture. The whole camera is in its `extras`.
    """
    document = Glb("insert-object")
    nodes = [_object(document, number, placed, frame) for number, placed in enumerate(objects)]
    for number, (camera, own) in enumerate(keys_by_camera(keys)):
        nodes.append(_animated_camera(document, f"camera{number or ''}", camera, own))
    file.write_bytes(document.data(nodes))


def write_gltf_model(file: Path, model: Model) -> None:
    """Write a model alone, in the pose that it has."""
    document = Glb("insert-object")
    mesh = document.add("meshes", {"primitives": [_primitive(document, part) for part in model.parts]})
    file.write_bytes(document.data([document.add("nodes", {"mesh": mesh})]))


def _object(document: Glb, number: int, placed: Placed, frame: MetricFrame) -> int:
    """The node of an object, whose mesh has the metres of its own file."""
    primitives = [_primitive(document, part) for part in placed.model.parts]
    mesh = document.add("meshes", {"name": placed.request.model.stem, "primitives": primitives})
    matrix = object_matrix(placed, frame)
    return document.add(
        "nodes", {"name": f"object{number}", "mesh": mesh, "matrix": matrix.T.ravel().tolist()}
    )  # by columns


def _primitive(document: Glb, part: Part) -> dict[str, Any]:
    attributes = {
        "POSITION": document.add_values(part.vertices, ARRAY_BUFFER, limits=True),
        "NORMAL": document.add_values(_unit_normals(part.normals), ARRAY_BUFFER),
    }
    if part.material.textures:
        attributes["TEXCOORD_0"] = document.add_values(part.uv, ARRAY_BUFFER)
    if part.color is not None:
        attributes["COLOR_0"] = document.add_values(np.clip(part.color, 0, 1), ARRAY_BUFFER)
    indices = document.add_values(part.faces.ravel().astype(np.uint32), ELEMENT_ARRAY_BUFFER)
    return {"attributes": attributes, "indices": indices, "material": _material(document, part.material)}


def _unit_normals(normals: FloatArray) -> FloatArray:
    """(n, 3) unit normals; one of length 0, which a face without an area has, points up."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.5, normals / np.maximum(lengths, 1e-12), [0.0, 1.0, 0.0])


def _material(document: Glb, material: Material) -> int:
    surface: dict[str, Any] = {
        "baseColorFactor": np.clip(material.base_color, 0, 1).tolist(),
        "metallicFactor": min(material.metallic, 1.0),
        "roughnessFactor": min(material.roughness, 1.0),
    }
    strength = float(material.emissive.max())
    record: dict[str, Any] = {
        "pbrMetallicRoughness": surface,
        "emissiveFactor": (material.emissive / max(1.0, strength)).tolist(),
        "doubleSided": True,  # as it is drawn
    }
    if strength > 1:
        record["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
        document.use("KHR_materials_emissive_strength")
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
    return document.add("materials", record)


def _animated_camera(document: Glb, name: str, camera: Camera, keys: Sequence[CameraKey]) -> int:
    """The node of a camera with its animation, whose times count from the first picture."""
    fx, fy = focal_lengths(camera)[:2]
    lens = document.add("cameras", {
        "type": "perspective", "name": name,
        "perspective": {
            "yfov": 2 * float(np.arctan(camera.height / (2 * fy))),
            "aspectRatio": (camera.width / fx) / (camera.height / fy),
            "znear": NEAR_M, "zfar": FAR_M,
        },
        "extras": {
            "model": camera.model, "width": camera.width, "height": camera.height,
            "params": [float(value) for value in camera.params],
        },
    })  # fmt: skip
    places = np.array([key.matrix[:3, 3] for key in keys])
    turns = _quaternions(keys)
    node = document.add("nodes", {
        "name": name, "camera": lens, "translation": places[0].tolist(), "rotation": turns[0].tolist(),
    })  # fmt: skip
    times = document.add_values(np.array([key.time_s for key in keys]), limits=True)
    moves = [("translation", document.add_values(places)), ("rotation", document.add_values(turns))]
    document.add("animations", {
        "name": name,
        "samplers": [{"input": times, "output": values} for _, values in moves],
        "channels": [
            {"sampler": row, "target": {"node": node, "path": path}} for row, (path, _) in enumerate(moves)
        ],
    })  # fmt: skip
    return node


def _quaternions(keys: Sequence[CameraKey]) -> FloatArray:
    """(n, 4) x, y, z, w, each on the side of the one before, so that a player takes the short way."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(np.array([key.matrix[:3, :3] for key in keys])).as_quat()
    for row in range(1, len(turns)):
        if turns[row] @ turns[row - 1] < 0:
            turns[row] *= -1
    return np.asarray(turns)
