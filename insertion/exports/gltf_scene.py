"""The inserted objects and the animated camera as one GLB file, 1 unit = 1 m, +y up."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKey, MetricFrame, object_matrix
from insertion.render.pinhole import focal_lengths
from insertion.staging.insert import Placed
from metric_base.arrays import FloatArray

__all__ = ["write_gltf_scene"]

_FLOAT = 5126


def write_gltf_scene(
    file: Path, objects: Sequence[Placed], keys: Sequence[CameraKey], camera: Camera, frame: MetricFrame
) -> None:
    """Write the file. glTF knows no lens distortion: the camera is the ideal one with the same focal length."""
    import trimesh

    scene = trimesh.Scene()
    for number, placed in enumerate(objects):
        model = trimesh.load_scene(placed.request.model, process=False)
        for node in model.graph.nodes_geometry:
            transform, name = model.graph[node]
            matrix = object_matrix(placed, frame) @ transform
            scene.add_geometry(model.geometry[name], node_name=f"object{number} {node}", transform=matrix)
    header, binary = _parts(scene.export(file_type="glb"))
    _add_camera(header, binary, keys, camera)
    file.write_bytes(_glb(header, binary))


def _parts(data: bytes) -> tuple[dict[str, Any], bytearray]:
    length = struct.unpack_from("<I", data, 12)[0]
    header = json.loads(data[20 : 20 + length])
    start = 20 + length
    size = struct.unpack_from("<I", data, start)[0]
    return header, bytearray(data[start + 8 : start + 8 + size])


def _glb(header: dict[str, Any], binary: bytearray) -> bytes:
    binary += b"\0" * (-len(binary) % 4)
    header["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    return b"".join([
        struct.pack("<III", 0x46546C67, 2, total),
        struct.pack("<II", len(text), 0x4E4F534A), text,
        struct.pack("<II", len(binary), 0x004E4942), bytes(binary),
    ])  # fmt: skip


def _add_camera(header: dict[str, Any], binary: bytearray, keys: Sequence[CameraKey], camera: Camera) -> None:
    focal_y = focal_lengths(camera)[1]
    header["cameras"] = [{
        "type": "perspective", "name": "recovered camera",
        "perspective": {
            "yfov": 2 * float(np.arctan(camera.height / (2 * focal_y))), "aspectRatio": camera.width / camera.height,
            "znear": 0.01, "zfar": 1000.0,
        },
    }]  # fmt: skip
    node = len(header.setdefault("nodes", []))
    places = np.array([key.matrix[:3, 3] for key in keys])
    turns = _quaternions(keys)
    header["nodes"].append({
        "name": "camera", "camera": 0, "translation": places[0].tolist(), "rotation": turns[0].tolist(),
    })  # fmt: skip
    header["scenes"][header.get("scene", 0)]["nodes"].append(node)
    times = np.array([[key.time_s] for key in keys]) - keys[0].time_s
    rows = [_accessor(header, binary, values) for values in (times, places, turns)]
    header["animations"] = [{
        "name": "recovered camera",
        "samplers": [{"input": rows[0], "output": rows[1]}, {"input": rows[0], "output": rows[2]}],
        "channels": [
            {"sampler": 0, "target": {"node": node, "path": "translation"}},
            {"sampler": 1, "target": {"node": node, "path": "rotation"}},
        ],
    }]  # fmt: skip
    header.setdefault("asset", {"version": "2.0"})["extras"] = {
        "metres_per_unit": 1.0,
        "camera": {"model": camera.model, "params": [float(v) for v in camera.params]},
    }


def _accessor(header: dict[str, Any], binary: bytearray, values: FloatArray) -> int:
    """Append an array of floats of any shape; its number."""
    binary += b"\0" * (-len(binary) % 4)
    data = np.ascontiguousarray(values, dtype="<f4")
    views = header.setdefault("bufferViews", [])
    views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": data.nbytes})
    binary += data.tobytes()
    kinds = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
    header.setdefault("accessors", []).append({
        "bufferView": len(views) - 1, "componentType": _FLOAT, "count": len(data), "type": kinds[data.shape[1]],
        "min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist(),
    })  # fmt: skip
    return len(header["accessors"]) - 1


def _quaternions(keys: Sequence[CameraKey]) -> FloatArray:
    """(n, 4) x, y, z, w, each on the side of the one before, so that a player takes the short way."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(np.array([key.matrix[:3, :3] for key in keys])).as_quat()
    for row in range(1, len(turns)):
        if turns[row] @ turns[row - 1] < 0:
            turns[row] *= -1
    return np.asarray(turns)
