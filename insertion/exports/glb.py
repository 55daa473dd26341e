"""A glTF 2.0 document and its one buffer, put together piece by piece (GLB: Khronos' specification, section 4.4)."""

from __future__ import annotations

import hashlib
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ARRAY_BUFFER", "ELEMENT_ARRAY_BUFFER", "Glb"]

#: What a view of the buffer is for.
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UNSIGNED_INT = 5126, 5125
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Glb:
    """One scene; `add` and its like give the number of what they added."""

    def __init__(self, generator: str) -> None:
        self._header: dict[str, Any] = {"asset": {"version": "2.0", "generator": generator}}
        self._binary = bytearray()
        self._pictures: dict[str, int] = {}

    def add(self, field: str, record: dict[str, Any]) -> int:
        """Append a record to one of the document's arrays, such as `nodes`."""
        rows: list[dict[str, Any]] = self._header.setdefault(field, [])
        rows.append(record)
        return len(rows) - 1

    def use(self, extension: str) -> None:
        """Name an extension that is used."""
        used: list[str] = self._header.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def add_values(self, values: NDArray[Any], target: int | None = None, *, limits: bool = False) -> int:
        """An accessor of (n,) or (n, k) values: floats, or indices where they are integers.

        limits : state the least and the greatest of each column, as positions and times must.
        """
        table = values.reshape(len(values), -1)
        whole = np.issubdtype(table.dtype, np.integer)
        data = np.ascontiguousarray(table, dtype="<u4" if whole else "<f4")
        record: dict[str, Any] = {
            "bufferView": self._add_view(data.tobytes(), target),
            "componentType": _UNSIGNED_INT if whole else _FLOAT,
            "count": len(data),
            "type": _KINDS[data.shape[1]],
        }
        if limits:
            record |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        return self.add("accessors", record)

    def add_texture(self, pixels: NDArray[np.uint8]) -> int:
        """A texture of (h, w, 4) red, green, blue, alpha, stored once however often it is used."""
        import cv2

        key = hashlib.sha256(repr(pixels.shape).encode() + pixels.tobytes()).hexdigest()
        if key not in self._pictures:
            opaque = bool((pixels[..., 3] == 255).all())
            stored = pixels[..., 2::-1] if opaque else pixels[..., [2, 1, 0, 3]]
            data = cv2.imencode(".png", stored)[1].tobytes()
            image = self.add("images", {"bufferView": self._add_view(data, None), "mimeType": "image/png"})
            self._pictures[key] = self.add("textures", {"source": image})
        return self._pictures[key]

    def data(self, scene_nodes: list[int]) -> bytes:
        """The file, its scene made of these nodes."""
        self._binary += b"\0" * (-len(self._binary) % 4)
        header = self._header | {
            "scene": 0,
            "scenes": [{"nodes": scene_nodes}],
            "buffers": [{"byteLength": len(self._binary)}],
        }
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(self._binary)
        return b"".join([
            struct.pack("<III", _MAGIC, 2, total),
            struct.pack("<II", len(text), _JSON), text,
            struct.pack("<II", len(self._binary), _BINARY), bytes(self._binary),
        ])  # fmt: skip

    def _add_view(self, data: bytes, target: int | None) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        record: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._binary += data
        return self.add("bufferViews", record if target is None else record | {"target": target})
