"""The view as one binary glTF file, which Blender and our page open: a node for each box, with what it says."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.geometry.box_edges import EDGES
from estimator.views.scene_view import COLOURS, SceneView
from metric_base.arrays import FloatArray
from metric_base.files import whole_file

__all__ = ["glb_bytes", "write_glb"]

#: What glTF calls them.
_POINTS, _LINES, _TRIANGLES, _FLOAT, _BYTE = 0, 1, 4, 5126, 5121
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942

#: (12, 3) corners of the triangles of a box, seen from outside counter-clockwise, in the order of `corners`.
FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6],
     [1, 3, 5], [3, 7, 5]]
)  # fmt: skip

#: Opacity of a box's faces and of a plane.
FACE_ALPHA, PLANE_ALPHA = 0.16, 0.25


class _Writer:
    """A glTF record and its one buffer, filled piece by piece."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.record: dict[str, Any] = {"materials": [], "accessors": [], "bufferViews": [], "meshes": [], "nodes": []}

    def material(self, colour: Sequence[int], alpha: float = 1.0) -> int:
        linear = [round((value / 255) ** 2.2, 4) for value in colour]
        made: dict[str, Any] = {
            "pbrMetallicRoughness": {"baseColorFactor": [*linear, alpha], "metallicFactor": 0, "roughnessFactor": 1},
            "extensions": {"KHR_materials_unlit": {}},
            "doubleSided": True,
        }
        if alpha < 1:
            made["alphaMode"] = "BLEND"
        self.record["materials"].append(made)
        return len(self.record["materials"]) - 1

    def positions(self, places: FloatArray) -> int:
        """The accessor of places, of any shape (..., 3)."""
        flat = np.ascontiguousarray(places.reshape(-1, 3), dtype="<f4")
        extremes = {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        return self._accessor(flat.tobytes(), {"componentType": _FLOAT, "count": len(flat), "type": "VEC3", **extremes})

    def colours(self, colours: Any) -> int:
        linear = np.round(255 * (np.asarray(colours) / 255) ** 2.2).astype(np.uint8)
        whole = np.column_stack([linear, np.full(len(linear), 255, dtype=np.uint8)])
        kind = {"componentType": _BYTE, "normalized": True, "count": len(whole), "type": "VEC4"}
        return self._accessor(whole.tobytes(), kind)

    def mesh(self, *primitives: dict[str, Any]) -> int:
        self.record["meshes"].append({"primitives": list(primitives)})
        return len(self.record["meshes"]) - 1

    def node(self, name: str, mesh: int, said: Any = None) -> None:
        extras = {} if said is None else {"extras": said}
        self.record["nodes"].append({"name": name, "mesh": mesh, **extras})

    def _accessor(self, data: bytes, kind: dict[str, Any]) -> int:
        self.record["bufferViews"].append({"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)})
        self.buffer += data  # floats and colours both take multiples of four bytes
        self.record["accessors"].append({"bufferView": len(self.record["bufferViews"]) - 1, **kind})
        return len(self.record["accessors"]) - 1


def glb_bytes(view: SceneView) -> bytes:
    """The file; the same view has the same bytes."""
    out = _Writer()
    if len(view.points):
        attributes = {"POSITION": out.positions(view.points), "COLOR_0": out.colours(view.point_colours)}
        material = out.material((255, 255, 255))
        out.node("points", out.mesh({"attributes": attributes, "mode": _POINTS, "material": material}))
    for name, lines in (("cameras", view.cameras), ("up", view.up)):
        if len(lines):
            material = out.material(COLOURS[name.removesuffix("s") if name == "cameras" else name])
            out.node(name, out.mesh(_part(out, lines, _LINES, material)))
    if view.planes:
        material = out.material(COLOURS["plane"], PLANE_ALPHA)
        for number, plane in enumerate(view.planes, 1):
            out.node(f"plane {number}", out.mesh(_part(out, plane[[0, 1, 2, 0, 2, 3]], _TRIANGLES, material)))
    verdicts = sorted({box.verdict for box in view.boxes})
    materials = {one: (out.material(COLOURS[one]), out.material(COLOURS[one], FACE_ALPHA)) for one in verdicts}
    for box in view.boxes:
        line, face = materials[box.verdict]
        parts = _part(out, box.corners[EDGES], _LINES, line), _part(out, box.corners[FACES], _TRIANGLES, face)
        out.node(f"box {box.id}", out.mesh(*parts), dict(box.said))
    return _whole_bytes(out, view)


def write_glb(view: SceneView, path: Path, option: str = "--view-glb") -> None:
    """Write the file whole or not at all; InputError where it cannot be written."""
    with whole_file(path, option) as work:
        work.write_bytes(glb_bytes(view))


def _part(out: _Writer, places: FloatArray, mode: int, material: int) -> dict[str, Any]:
    """A primitive of places (..., 3): points, ends of lines or corners of triangles, one after the other."""
    return {"attributes": {"POSITION": out.positions(places)}, "mode": mode, "material": material}


def _whole_bytes(out: _Writer, view: SceneView) -> bytes:
    record = {
        "asset": {
            "version": "2.0",
            "generator": "metric-tree",
            "extras": {"headline": view.headline, "unit": view.unit},
        },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": list(range(len(out.record["nodes"])))}],
        **{name: rows for name, rows in out.record.items() if rows},
        "buffers": [{"byteLength": len(out.buffer)}],
    }
    text = json.dumps(record, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    whole = 12 + 8 + len(text) + 8 + len(out.buffer)
    return (
        struct.pack("<III", _MAGIC, 2, whole)
        + struct.pack("<II", len(text), _JSON)
        + text
        + struct.pack("<II", len(out.buffer), _BINARY)
        + bytes(out.buffer)
    )
