"""Write Gaussian splats as 3DGS PLY, as the compressed PLY of SuperSplat and as SPZ, and render them."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from estimator.records.scene import Scene, View

__all__ = ["GSPLY", "render", "write_cameras", "write_compressed", "write_splat", "write_spz"]

Array = NDArray[Any]
PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0"),
    *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


#: Files of versions 3 and 4 that `gsply.write_spz` of gsply 0.4.6 wrote, in base 64: 12 Gaussians with the centres
#: (i / 8, -i / 16, 1 + i / 32) and the logit 2.5 of the opacity, in these axes.
GSPLY = {
    3: "H4sIAFEjC2sA/5XMyQlCURSD4Q8VERHxTbbkTgQbsYRTmgW5dR6OXEFw+fwhIYsk69V2M8TM10qwYEBmLBjxShVjnhkVEx6pZso9o/7Mb6lh"
    "zjWjUR4uqVVq54xWyafUseSY0Tn8ED3Y9QD7f/QGWFgVvgABAAA=",
    4: "TkdTUAQAAAAMAAAAAAwABSAAAAAAAAAAAAAAAAAAAABVAAAAAAAAAGwAAAAAAAAAEQAAAAAAAAAMAAAAAAAAABAAAAAAAAAAJAAAAAAAAAAQ"
    "AAAAAAAAACQAAAAAAAAAEwAAAAAAAAAwAAAAAAAAACi1L/0gbGUCAGIGERuwJ60B3d3d3cAwDMNwkmEYhsqN7L2vWTMztqSTGuLDySVOp5ri"
    "c7rFZVRjbBhd48Kn5pjwuceDTQ2yYHORA5faBlwGAQADEAIotS/9IAxFAAAQ7OwBABvAAii1L/0gJD0AAAiAAQBIIAQotS/9ICQ9AAAIcAEA"
    "SCAEKLUv/SAwVQAAIAAAAMABADEvEQ==",
}


def header(*elements: tuple[str, int, str, tuple[str, ...]]) -> bytes:
    """Return the header of a PLY file; an element has a name, a count, a type and properties."""
    lines = ["ply", "format binary_little_endian 1.0"]
    for name, count, kind, properties in elements:
        lines += [f"element {name} {count}", *(f"property {kind} {one}" for one in properties)]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def write_splat(file: Path, centres: Array, opacity: float | Array = 0.9, size: float = 0.05) -> Path:
    """Write Gaussians with centres (n, 3), opacities (n,), sizes in units and random colours and rotations."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(len(centres), len(PROPERTIES)))
    rows[:, :3] = centres
    rows[:, 10] = np.log(opacity / (1 - np.asarray(opacity)))
    rows[:, 11:14] = np.log(size) + 0.3 * rng.normal(size=(len(centres), 3))
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(header(("vertex", len(centres), "float", PROPERTIES)) + rows.astype("<f4").tobytes())
    return file


def write_compressed(file: Path, centres: Array, opacity: float = 0.9, size: float = 0.05) -> Path:
    """Write the same as a compressed PLY with one chunk for 256 Gaussians."""
    chunks, words = [], []
    for start in range(0, len(centres), 256):
        part = centres[start : start + 256]
        low, high = part.min(axis=0), part.max(axis=0)
        chunks.append(np.concatenate([low, high, np.full(3, np.log(size)), np.full(3, np.log(size) + 0.1)]))
        x, y, z = np.round((part - low) / (high - low) * [2047, 1023, 2047]).astype(np.uint32).T
        position = x << np.uint32(21) | y << np.uint32(11) | z
        words.append(np.column_stack([position, position, position, np.full(len(part), round(255 * opacity))]))
    corners = tuple(f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in "xyz")
    packed = tuple(f"packed_{name}" for name in ("position", "rotation", "scale", "color"))
    head = header(("chunk", len(chunks), "float", corners), ("vertex", len(centres), "uint", packed))
    body = np.array(chunks).astype("<f4").tobytes() + np.concatenate(words).astype("<u4").tobytes()
    file.write_bytes(head + body)
    return file


def write_spz(
    file: Path, centres: Array, opacity: float = 0.9, bits: int = 12, version: int = 2, axes: Any = (1, -1, -1)
) -> Path:
    """Write the centres as SPZ, by default from the axes right, down, forward to those of SPZ: right, up, back."""
    words = np.round(centres * axes * 2**bits).astype("<i4")
    n = len(centres)
    head = struct.pack("<4sIIBBBB", b"NGSP", version, n, 0, bits, 0, 5 * (version == 4))
    streams = [words.view(np.uint8).reshape(n, 3, 4)[..., :3].tobytes(), bytes([round(255 * opacity)]) * n]
    streams += [bytes(k * n) for k in (3, 3, 3 if version == 2 else 4)]
    if version < 4:
        file.write_bytes(gzip.compress(head + b"".join(streams)))
        return file
    packed = [pa.compress(stream, codec="zstd", asbytes=True) for stream in streams]
    sizes = b"".join(struct.pack("<QQ", len(a), len(b)) for a, b in zip(packed, streams, strict=True))
    file.write_bytes(head + struct.pack("<I", 32) + bytes(12) + sizes + b"".join(packed))
    return file


def write_cameras(scene: Scene, file: Path) -> Path:
    """Write views as `cameras.json` of 3D Gaussian Splatting, without lens distortion."""
    entries = []
    for number, view in enumerate(scene.views):
        camera = view.camera
        pose = {"position": view.centre.tolist(), "rotation": view.rotation.T.tolist()}
        fy = camera.params[1] if camera.model == "PINHOLE" else camera.params[0]
        size = {"width": camera.width, "height": camera.height, "fx": camera.params[0], "fy": fy}
        entries.append({"id": number, "img_name": Path(view.name).stem} | pose | size)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(entries), encoding="utf-8")
    return file


def render(file: Path, view: View) -> Array:
    """Return an image (h, w) of the Gaussians of a PLY with isotropic footprints, composed from front to back."""
    data = file.read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    if b"packed_position" in data[:body]:
        rows = _unpacked(data, body)
    else:
        rows = np.frombuffer(data, "<f4", offset=body).reshape(-1, len(PROPERTIES)).astype(float)
    in_camera = view.to_camera(rows[:, :3])
    order = np.argsort(in_camera[:, 2])
    fx, fy, cx, cy = view.camera.params
    x, y = np.meshgrid(np.arange(view.camera.width) + 0.5, np.arange(view.camera.height) + 0.5)
    image, transmitted = np.zeros(x.shape), np.ones(x.shape)
    for row in order[in_camera[order, 2] > 0]:
        u, v = in_camera[row, :2] / in_camera[row, 2] * (fx, fy) + (cx, cy)
        radius = fx * np.exp(rows[row, 11:14].mean()) / in_camera[row, 2]
        alpha = np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * radius**2)) / (1 + np.exp(-rows[row, 10]))
        image += transmitted * alpha * (0.5 + 0.28 * rows[row, 6])
        transmitted *= 1 - alpha
    return image


def _unpacked(data: bytes, body: int) -> Array:
    """Return the Gaussians (n, 18) of a compressed PLY with grey colours."""
    n_chunks, n = (int(line.split()[2]) for line in data[:body].splitlines() if line.startswith(b"element"))
    corners = np.frombuffer(data, "<f4", 12 * n_chunks, body).reshape(-1, 4, 3)[np.arange(n) // 256]
    words = np.frombuffer(data, "<u4", 4 * n, body + 48 * n_chunks).reshape(-1, 4).astype(np.int64)
    rows = np.zeros((n, len(PROPERTIES)))
    for columns, word, row in ((slice(0, 3), words[:, 0], 0), (slice(11, 14), words[:, 2], 2)):
        fraction = np.column_stack([(word >> 21) / 2047, (word >> 11 & 1023) / 1023, (word & 2047) / 2047])
        rows[:, columns] = corners[:, row] * (1 - fraction) + corners[:, row + 1] * fraction
    opacity = (words[:, 3] & 255) / 255
    rows[:, 10] = np.log(opacity / (1 - opacity))
    return rows
