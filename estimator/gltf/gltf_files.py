"""What a glTF file states about itself, checked before it is believed, and the files beside it that it names."""

from __future__ import annotations

import base64
import io
import json
import struct
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from metric_base.errors import FieldError, Unquoted, at_field
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = [
    "MAX_BYTES",
    "MAX_TRIANGLES",
    "FolderResolver",
    "buffers_of",
    "check_header",
    "check_images",
    "gltf_header",
    "image_bytes",
]

#: A larger model is not for insertion in video: at this many triangles one shadow map takes a second.
MAX_TRIANGLES = 2_000_000
#: Largest file, and largest file beside it: triangles take a fifth, textures the rest.
MAX_BYTES = 1 << 29
#: Most pixels of a texture: 8192 x 8192, which takes 268 MB.
MAX_TEXTURE_PIXELS = 1 << 26
#: Most pixels of all textures of a file together.
MAX_PIXELS = 1 << 27
#: Most nodes of a file, and most levels of them.
MAX_NODES, MAX_DEPTH = 100_000, 500
#: Most values of an accessor: three corners of each triangle. Most corners of all meshes that are drawn.
MAX_COUNT, MAX_CORNERS = 3 * MAX_TRIANGLES, 3_000_000
_MAGIC, _JSON = 0x46546C67, 0x4E4F534A
#: What may be required of a reader and is not read here, with what undoes it.
_COMPRESSED = {
    "KHR_draco_mesh_compression": "copy",
    "EXT_meshopt_compression": "copy",
    "KHR_texture_basisu": "ktxdecompress",
}
#: What may be required and is read, or changes only how a surface shines.
_READ = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
_SHINE = "KHR_materials_"
#: Arrays of objects at the top of a file.
_LISTS = (
    "accessors", "animations", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "scenes", "skins",
    "textures",
)  # fmt: skip
#: What pictures a texture may be in (glTF 2.0 has PNG and JPEG; EXT_texture_webp adds WebP).
_PICTURES = ("PNG", "JPEG", "WEBP")


class FolderResolver:
    """The files beside a glTF file, by the names that it gives them; no name leads out of the folder."""

    def __init__(self, file: Path) -> None:
        self._folder = file.parent.resolve()
        self._read: dict[str, bytes] = {}

    def __getitem__(self, name: str) -> bytes:
        """The bytes of a file, read once.

        FieldError for what is not a regular file in the folder; InputError if all files together are too large.
        """
        if name in self._read:
            return self._read[name]
        file = self._folder / unquote(name)
        try:
            inside = file.resolve().is_relative_to(self._folder)
        except (OSError, ValueError, RuntimeError):  # a zero byte, a circle of links
            inside = False
        if not inside:
            raise FieldError("uri", "a file in the folder of the model", name)
        if not file.is_file():
            raise FieldError("uri", "a file beside the model", name)
        self._read[name] = read_bytes(file, limit=MAX_BYTES - sum(map(len, self._read.values())))
        return self._read[name]

    get = __getitem__


def gltf_header(data: bytes, *, compressed: bool = False) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file, and the binary chunk that follows it in a GLB; FieldError where it cannot be read here.

    compressed : meshes may be compressed, for a caller that needs no more than their stated boxes.
    """
    if len(data) >= 20 and struct.unpack_from("<I", data)[0] == _MAGIC:
        length, kind = struct.unpack_from("<II", data, 12)
        whole = kind == _JSON and 20 + length <= len(data)
        expect(whole, "chunk 0", f"JSON of {length} bytes", Unquoted(f"a file of {len(data)} bytes"))
        text, binary = data[20 : 20 + length], data[20 + length :]
    else:
        text, binary = data, b""
    try:
        header = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise FieldError("content", "glTF 2.0 (.glb or .gltf)", Unquoted(f"neither: {error}")) from None
    asset = header.get("asset") if isinstance(header, dict) else None
    expect(isinstance(asset, dict), "asset", "the record of a glTF file", asset)
    version = str(header["asset"].get("version"))
    expect(version.startswith("2."), "asset.version", "2.x", version)
    required = header.get("extensionsRequired", [])
    expect(isinstance(required, list), "extensionsRequired", "an array", required)
    _expect_known([name for name in required if not (compressed and name in _COMPRESSED)])
    return header, binary


def _expect_known(required: Sequence[object]) -> None:
    """FieldError for an extension without which the file cannot be read, and that is not read here."""
    for name in map(str, required):
        undone = _COMPRESSED.get(name)
        if undone is not None:
            how = f"an uncompressed file (npx @gltf-transform/cli {undone} IN.glb OUT.glb makes one)"
            expect(False, "extensionsRequired", how, Unquoted(name))
        known = name in _READ or name.startswith(_SHINE)
        expect(known, "extensionsRequired", f"{', '.join(_READ)} or {_SHINE}...", Unquoted(name))


def _no_number(word: str) -> float:
    """JSON has no NaN and no Infinity, which Python would read."""
    raise ValueError(f"the word {word}")


def check_header(header: dict[str, Any]) -> None:
    """FieldError where a count, a stride or the tree of nodes is none that a model has."""
    for field in _LISTS:
        rows = header.get(field, [])
        expect(isinstance(rows, list), field, "an array", Unquoted(type(rows).__name__))
        for number, row in enumerate(rows):
            expect(isinstance(row, dict), f"{field}[{number}]", "an object", row)
    for number, row in enumerate(header.get("accessors", [])):
        with at_field(f"accessors[{number}]"):
            _expect_count(row, "count", 1, MAX_COUNT)
            _expect_count(row, "byteOffset", 0, MAX_BYTES)
    for number, row in enumerate(header.get("bufferViews", [])):
        with at_field(f"bufferViews[{number}]"):
            _expect_count(row, "byteOffset", 0, MAX_BYTES)
            _expect_count(row, "byteLength", 1, MAX_BYTES)
            _expect_count(row, "byteStride", 4, 252)
    _check_nodes(header)


def _expect_count(row: dict[str, Any], field: str, low: int, high: int) -> None:
    value = row.get(field, low)
    sound = isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    expect(sound, field, f"a whole number from {low} to {high}", value)


def _check_nodes(header: dict[str, Any]) -> None:
    """The nodes are trees, as the standard asks: no node is below itself or below two others."""
    nodes = header.get("nodes", [])
    expect(len(nodes) <= MAX_NODES, "nodes", f"at most {MAX_NODES}", len(nodes))
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in _indices(node.get("children", []), f"nodes[{number}].children", len(nodes)):
            expect(
                child not in parents, f"nodes[{child}]", "one parent", Unquoted(f"{parents.get(child)} and {number}")
            )
            parents[child] = number
    drawn = [_drawn(header, node) for node in nodes]
    triangles, corners = (sum(counts[part] for counts in drawn) for part in (0, 1))
    expect(triangles <= MAX_TRIANGLES, "meshes", f"at most {MAX_TRIANGLES} triangles", triangles)
    expect(corners <= MAX_CORNERS, "meshes", f"at most {MAX_CORNERS} corners", corners)
    depths: dict[int, int] = {}
    for number in range(len(nodes)):
        way = [number]
        while way[-1] in parents and way[-1] not in depths:
            expect(
                len(way) <= MAX_DEPTH, f"nodes[{number}]", f"at most {MAX_DEPTH} levels, in no circle", Unquoted("more")
            )
            way.append(parents[way[-1]])
        for step in reversed(way):
            depths.setdefault(step, depths[parents[step]] + 1 if step in parents else 0)
        expect(depths[number] <= MAX_DEPTH, f"nodes[{number}]", f"at most {MAX_DEPTH} levels", depths[number])


def _indices(values: object, field: str, count: int) -> Iterator[int]:
    expect(isinstance(values, list), field, "an array", values)
    assert isinstance(values, list)
    for value in values:
        expect(isinstance(value, int) and 0 <= value < count, field, f"numbers from 0 to {count - 1}", value)
        yield value


def _drawn(header: dict[str, Any], node: dict[str, Any]) -> tuple[int, int]:
    """How many triangles and corners a node draws, at most: a mesh may be drawn by many nodes."""
    meshes, accessors = header.get("meshes", []), header.get("accessors", [])
    if "mesh" not in node:
        return 0, 0
    (mesh,) = _indices([node["mesh"]], "mesh", len(meshes))
    triangles = corners = 0
    for part in meshes[mesh].get("primitives", []):
        attributes = part.get("attributes", {}) if isinstance(part, dict) else None
        expect(isinstance(attributes, dict), f"meshes[{mesh}].primitives", "objects with attributes", part)
        assert isinstance(attributes, dict)
        corner, index = (_count(accessors, place) for place in (attributes.get("POSITION"), part.get("indices")))
        corners += corner
        triangles += (index or corner) // (3 if part.get("mode", 4) == 4 else 1)
    return triangles, corners


def _count(accessors: list[dict[str, Any]], place: object) -> int:
    """The count of an accessor; 0 where there is none of this number."""
    return accessors[place].get("count", 0) if isinstance(place, int) and 0 <= place < len(accessors) else 0


def buffers_of(header: dict[str, Any], binary: bytes, resolver: FolderResolver) -> list[bytes]:
    """The buffers of a file; binary : the one that a GLB holds itself, empty without."""
    buffers = []
    for number, buffer in enumerate(header.get("buffers", [])):
        with at_field(f"buffers[{number}]"):
            buffers.append(_data(buffer["uri"], resolver) if "uri" in buffer else binary)
    return buffers


def image_bytes(header: dict[str, Any], number: int, buffers: list[bytes], resolver: FolderResolver) -> bytes:
    """The encoded picture of an image."""
    image = header["images"][number]
    with at_field(f"images[{number}]"):
        if "uri" in image:
            return _data(image["uri"], resolver)
        return _view(image, header.get("bufferViews", []), buffers)


def check_images(header: dict[str, Any], buffers: list[bytes], resolver: FolderResolver) -> None:
    """FieldError for a picture of a texture that cannot be read, or has too many pixels.

    KTX2 pictures that stand beside a PNG or JPEG (KHR_texture_basisu) are not looked at.
    """
    total = 0
    for number, image in enumerate(header.get("images", [])):
        if image.get("mimeType") == "image/ktx2":
            continue
        data = image_bytes(header, number, buffers, resolver)
        with at_field(f"images[{number}]"):
            width, height = _picture_size(data)
            pixels = width * height
            expect(
                pixels <= MAX_TEXTURE_PIXELS, "size", f"at most {MAX_TEXTURE_PIXELS:,} pixels", Unquoted(f"{pixels:,}")
            )
            total += pixels
    expect(total <= MAX_PIXELS, "images", f"at most {MAX_PIXELS:,} pixels in all", Unquoted(f"{total:,}"))


def _view(image: dict[str, Any], views: list[dict[str, Any]], buffers: list[bytes]) -> bytes:
    (number,) = _indices([image.get("bufferView")], "bufferView", len(views))
    view = views[number]
    (place,) = _indices([view.get("buffer")], "buffer", len(buffers))
    start = view.get("byteOffset", 0)
    return buffers[place][start : start + view.get("byteLength", 0)]


def _data(uri: object, resolver: FolderResolver) -> bytes:
    """What an address holds: the data in itself, or a file in the model's folder."""
    expect(isinstance(uri, str), "uri", "a text", uri)
    head, comma, text = str(uri).partition("base64,")
    if not comma:
        return resolver[head]
    try:
        return base64.b64decode(text)
    except ValueError as error:
        raise FieldError("uri", "data in base64", Unquoted(str(error))) from None


def _picture_size(data: bytes) -> tuple[int, int]:
    from PIL import Image

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_PICTURES) as picture:
            width, height = picture.size
            return width, height
    except Image.DecompressionBombError:
        raise FieldError("size", f"at most {MAX_TEXTURE_PIXELS:,} pixels", Unquoted("far more")) from None
    except (OSError, ValueError, SyntaxError) as error:
        raise FieldError("picture", "a PNG, JPEG or WebP", Unquoted(type(error).__name__)) from None
