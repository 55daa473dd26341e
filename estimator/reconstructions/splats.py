"""Read the centres of Gaussian splats, and scale splats: PLY of 3DGS, compressed PLY of SuperSplat, and SPZ.

The PLY of 3DGS (Inria, gsplat, nerfstudio, Brush) stores log scales (`scale_i`) and the logit of the opacity. The
compressed PLY stores the positions of 256 Gaussians as fractions of the box of their chunk, with 11, 10 and 11 bits,
and the opacity in the last byte of the colour. SPZ (github.com/nianticlabs/spz) stores positions of 24 bits in the axes
right, up, back, and log scales in steps of 1/16 from -10: versions 2 and 3 as one gzip stream, version 4 as a stream of
Zstandard for each attribute. Some programs write the axes of their PLY files instead (gsply 0.4).
"""

from __future__ import annotations

import gzip
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, damage_as_field_error, expect
from metric_base.input_files import read_bytes
from metric_base.ply import CHUNK_CORNERS, MAX_HEADER_BYTES, ply_layout, scaled_ply

#: Minimum opacity of a Gaussian whose centre is a point of a surface; fainter ones often float in front of it.
MIN_OPACITY = 0.5
#: Number of Gaussians of a chunk of a compressed PLY.
CHUNK = 256
#: Maximum number of Gaussians of an SPZ file, the limit of its own library.
MAX_SPZ_POINTS = 10_000_000
_SPZ_HEADER = struct.Struct("<4sIIBBBB")
#: Start of version 4: the same, with the number of streams and the position of their table of sizes.
_SPZ_4_HEADER = struct.Struct("<4sIIBBBBI")
_SPZ_4_SIZES = struct.Struct("<QQ")
_SPZ_MAGIC, _GZIP = b"NGSP", b"\x1f\x8b"


def is_splat(path: Path) -> bool:
    """Return True if a file contains Gaussians: SPZ by its suffix, PLY by its properties."""
    if not path.is_file() or path.suffix.lower() not in {".ply", ".spz"}:
        return False
    header = read_bytes(path, most=MAX_HEADER_BYTES).partition(b"end_header")[0]
    return path.suffix.lower() == ".spz" or b" packed_position" in header or b" scale_0" in header


def splat_centres(data: bytes) -> FloatArray | None:
    """Return the centres (n, 3) of the opaque Gaussians of a file.

    Returns
    -------
    (n, 3) ndarray of float or None
        In the axes of the file; None if it contains no Gaussians.

    Raises
    ------
    FieldError
        The file is damaged, or no Gaussian has an opacity of `MIN_OPACITY`.
    """
    if data.startswith((_GZIP, _SPZ_MAGIC)):
        centres, opacity = _spz_centres(data)
    elif b" packed_position" in data[:MAX_HEADER_BYTES].partition(b"end_header")[0]:
        centres, opacity = _compressed_centres(data)
    else:
        layout = ply_layout(data)
        if not {"opacity", "scale_0"} <= set(layout.vertex.names or ()):
            return None
        expect(layout.format != "ascii", "format", "binary PLY (convert the splat)", Unquoted("ASCII"))
        rows = np.frombuffer(data, layout.vertex, layout.count, layout.body + layout.skipped)
        with np.errstate(over="ignore"):
            opacity = 1 / (1 + np.exp(-rows["opacity"].astype(np.float64)))
        centres = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
    is_opaque = opacity >= MIN_OPACITY
    expect(is_opaque.any(), "opacity", f"at least one Gaussian of {MIN_OPACITY:g} or more", Unquoted("none"))
    return centres[is_opaque]


def _compressed_centres(data: bytes) -> tuple[FloatArray, FloatArray]:
    """Return centres (n, 3) and opacities (n,) of a compressed PLY."""
    chunk = ply_layout(data, "chunk", CHUNK_CORNERS)
    layout = ply_layout(data, "vertex", ("packed_position", "packed_color"))
    if layout.format == "ascii" or chunk.count * CHUNK < layout.count:
        expected = f"binary data with one chunk for {CHUNK} Gaussians"
        raise FieldError("chunk", expected, Unquoted(f"{chunk.count} for {layout.count}, {layout.format}"))
    chunks = np.frombuffer(data, chunk.vertex, chunk.count, chunk.body + chunk.skipped)
    rows = np.frombuffer(data, layout.vertex, layout.count, layout.body + layout.skipped)
    corners = np.column_stack([chunks[name] for name in CHUNK_CORNERS]).astype(np.float64)[
        np.arange(layout.count) // CHUNK
    ]
    packed = rows["packed_position"].astype(np.int64)
    fractions = np.column_stack([(packed >> 21) / 2047, (packed >> 11 & 1023) / 1023, (packed & 2047) / 2047])
    return corners[:, :3] * (1 - fractions) + corners[:, 3:] * fractions, (rows["packed_color"] & 255) / 255


def _spz_centres(data: bytes) -> tuple[FloatArray, FloatArray]:
    """Return centres (n, 3) and opacities (n,) of an SPZ file, whose positions are integers of 24 bits."""
    is_gzip = data.startswith(_GZIP)
    damage = damage_as_field_error("a complete SPZ file", (OSError, EOFError, struct.error, zlib.error), str)
    with damage, gzip.GzipFile(fileobj=BytesIO(data)) if is_gzip else BytesIO(data) as stream:
        magic, version, count, _, bits, _, _ = _SPZ_HEADER.unpack(stream.read(_SPZ_HEADER.size))
        is_known = magic == _SPZ_MAGIC and version in ((2, 3) if is_gzip else (4,))
        expect(is_known, "header", "SPZ of version 2, 3 or 4", (magic, version))
        expected = f"1 to {MAX_SPZ_POINTS} Gaussians, and at most 24 fractional bits"
        expect(0 < count <= MAX_SPZ_POINTS and bits <= 24, "header", expected, (count, bits))
        # The first attributes: position 9 bytes, opacity 1 byte.
        content = stream.read(10 * count) if is_gzip else _spz_4_streams(data, (9 * count, count))
    expect(len(content) == 10 * count, "content", f"{count} Gaussians", Unquoted(f"{len(content)} bytes"))
    packed = np.frombuffer(content, np.uint8, 9 * count).reshape(count, 3, 3).astype(np.int32)
    words = packed[..., 0] | packed[..., 1] << 8 | packed[..., 2] << 16
    positions = (words - ((words & 1 << 23) << 1)).astype(np.float64)
    return positions / 2.0**bits, np.frombuffer(content, np.uint8, count, 9 * count) / 255


def _spz_4_streams(data: bytes, n_bytes: tuple[int, ...]) -> bytes:
    """Return the content of the first streams of an SPZ file of version 4, which have these sizes."""
    import pyarrow as pa

    *_, n_streams, place = _SPZ_4_HEADER.unpack_from(data)
    start, parts = place + n_streams * _SPZ_4_SIZES.size, []
    for row, size in enumerate(n_bytes):
        n_packed, n_unpacked = _SPZ_4_SIZES.unpack_from(data, place + row * _SPZ_4_SIZES.size)
        expect(n_unpacked == size, f"stream {row}", f"{size} bytes", n_unpacked)
        parts.append(pa.decompress(data[start : start + n_packed], size, codec="zstd", asbytes=True))
        start += n_packed
    return b"".join(parts)


def scaled_splat(data: bytes, scale: float) -> bytes:
    """Return a PLY file, with Gaussians or without, whose lengths are multiplied by `scale`, as `scaled_ply`.

    Raises
    ------
    FieldError
        The file is damaged, or is SPZ, whose steps of position and scale a factor would coarsen.
    """
    if data.startswith((_GZIP, _SPZ_MAGIC)):
        raise FieldError("format", "PLY (convert the splat to PLY, which stores metres exactly)", Unquoted("SPZ"))
    return scaled_ply(data, scale)
