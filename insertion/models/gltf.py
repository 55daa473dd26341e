"""glTF 2.0 and GLB files, read by trimesh.

trimesh rounds colour factors to 8 bits, which halves or doubles a dark linear colour. So the materials' own numbers are
read from the file's JSON: each material gets its index as a name before trimesh sees it.
"""

from __future__ import annotations

import io
import json
import logging
import struct
from pathlib import Path
from typing import Any

import numpy as np

from insertion.models.gltf_files import MAX_BYTES, MAX_TRIANGLES, FolderResolver, check_header, check_images
from insertion.models.model import Material, Model, Part, Pixels
from metric_base.arrays import FloatArray
from metric_base.faults import FieldFault, InputFault, Words, in_file
from metric_base.input_files import read_bytes
from metric_base.schema import expect

__all__ = ["read_model"]

_MAGIC, _JSON = 0x46546C67, 0x4E4F534A
#: What may be required of a reader and is not read here: compressed meshes and textures.
_UNREAD = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "KHR_mesh_quantization")
#: Metres from its origin beyond which no part of a thing is.
MAX_METRES = 1e9


def read_model(path: Path) -> Model:
    """The model of a `.glb` or `.gltf` file. Raises InputFault for anything that cannot be read."""
    if not path.is_file():
        raise InputFault(
            f"{path}: expected a glTF file (.glb or .gltf); found {'a folder' if path.is_dir() else 'none'}"
        )
    resolver = FolderResolver(path)
    with in_file(path):
        header, binary = _header(read_bytes(path, limit=MAX_BYTES))
        check_header(header)
        check_images(header, binary[8:], resolver)  # a chunk begins with its length and kind
    try:
        with np.errstate(all="ignore"):  # absurd numbers are refused below
            scene = _trimesh_scene(_number_materials(header), binary, resolver)
            parts = tuple(_parts(scene, header))
    except (
        ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError, ArithmeticError, OSError,
        SyntaxError, RecursionError, MemoryError,
    ) as fault:  # fmt: skip
        raise InputFault(f"{path}: expected a readable glTF 2.0 file; found {type(fault).__name__}: {fault}") from fault
    with in_file(path):
        _check_parts(parts)
    return Model(path.name, parts, tuple(_warnings(header)))


def _header(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file, and the binary chunk that follows it in a GLB; FieldFault where it cannot be read here."""
    if len(data) >= 20 and struct.unpack_from("<I", data)[0] == _MAGIC:
        length, kind = struct.unpack_from("<II", data, 12)
        whole = kind == _JSON and 20 + length <= len(data)
        expect(whole, "chunk 0", f"JSON of {length} bytes", Words(f"a file of {len(data)} bytes"))
        text, binary = data[20 : 20 + length], data[20 + length :]
    else:
        text, binary = data, b""
    try:
        header = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as fault:
        raise FieldFault("content", "glTF 2.0 (.glb or .gltf)", Words(f"neither: {fault}")) from None
    asset = header.get("asset") if isinstance(header, dict) else None
    expect(isinstance(asset, dict), "asset", "the record of a glTF file", asset)
    version = str(header["asset"].get("version"))
    expect(version.startswith("2."), "asset.version", "2.x", version)
    required = header.get("extensionsRequired", [])
    expect(isinstance(required, list), "extensionsRequired", "an array", required)
    unread = [name for name in required if name in _UNREAD]
    expect(not unread, "extensionsRequired", "an uncompressed file", Words(", ".join(unread)))
    return header, binary


def _no_number(word: str) -> float:
    """JSON has no NaN and no Infinity, which Python would read."""
    raise ValueError(f"the word {word}")


def _check_parts(parts: tuple[Part, ...]) -> None:
    triangles = sum(len(part.faces) for part in parts)
    expect(triangles > 0, "meshes", "at least one triangle", Words("none"))
    expect(triangles <= MAX_TRIANGLES, "meshes", f"at most {MAX_TRIANGLES} triangles", triangles)
    finite = all((np.abs(part.vertices) < MAX_METRES).all() for part in parts)
    expect(finite, "POSITION", f"finite numbers below {MAX_METRES:g}", Words("others"))
    for part in parts:
        _check_part(part)
    corners = np.concatenate([part.vertices for part in parts])
    extent = (corners.max(axis=0) - corners.min(axis=0)).max()
    expect(extent > 0, "POSITION", "a body with an extent", Words("a single point"))


def _check_part(part: Part) -> None:
    """FieldFault for corners without a normal or a texture coordinate, and for colours of another length."""
    count, material = len(part.vertices), part.material
    inside = not len(part.faces) or (part.faces.min() >= 0 and part.faces.max() < count)
    expect(bool(inside), "indices", f"numbers from 0 to {count - 1}", Words("others"))
    shaped = {"NORMAL": part.normals.shape == (count, 3), "TEXCOORD_0": part.uv.shape == (count, 2)}
    for field, whole in shaped.items():
        expect(whole, field, "a value for each corner", Words("another number of them"))
    values = {"NORMAL": part.normals, "TEXCOORD_0": part.uv}
    for field, numbers in values.items():
        expect(bool(np.isfinite(numbers).all()), field, "finite numbers", Words("others"))
    factors = np.array([material.metallic, material.roughness, material.alpha_cutoff or 0.0])
    sound = material.base_color.shape == (4,) and material.emissive.shape == (3,)
    colours = (material.base_color, material.emissive, factors)
    sound = sound and all((np.isfinite(colour) & (colour >= 0)).all() for colour in colours)
    expect(bool(sound), "materials", "colours of four and three numbers from 0", Words("others"))


def _warnings(header: dict[str, Any]) -> list[str]:
    lines = []
    if header.get("animations"):
        lines.append(f"{len(header['animations'])} animation(s) are ignored: the object is inserted as it stands")
    if header.get("skins"):
        lines.append("skins are ignored: the mesh is inserted in its bind pose")
    if any(p.get("targets") for mesh in header.get("meshes", []) for p in mesh.get("primitives", [])):
        lines.append("morph targets are ignored")
    return lines


def _number_materials(header: dict[str, Any]) -> dict[str, Any]:
    """The header whose materials are named by their index."""
    materials = [{**material, "name": str(row)} for row, material in enumerate(header.get("materials", []))]
    return {**header, "materials": materials} if materials else header


def _trimesh_scene(header: dict[str, Any], binary: bytes, resolver: FolderResolver) -> Any:
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it quotes the file as it is
    text = json.dumps(header).encode()
    if not binary:
        return trimesh.load_scene(io.BytesIO(text), file_type="gltf", resolver=resolver, process=False)
    text += b" " * (-len(text) % 4)
    total = 20 + len(text) + len(binary)
    data = struct.pack("<IIIII", _MAGIC, 2, total, len(text), _JSON) + text + binary
    return trimesh.load_scene(io.BytesIO(data), file_type="glb", resolver=resolver, process=False)


def _parts(scene: Any, header: dict[str, Any]) -> list[Part]:
    """One part for each mesh of each node, in the frame of the file."""
    parts = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if len(getattr(mesh, "faces", ())):
            parts.append(_part(mesh, np.asarray(transform, dtype=np.float64), header))
    return parts


def _part(mesh: Any, transform: FloatArray, header: dict[str, Any]) -> Part:
    """The part of a mesh in the model's frame, its transform (4, 4)."""
    if "vertex_normals" not in mesh._cache.cache:
        mesh = _with_flat_faces(mesh)
    linear = transform[:3, :3]
    vertices = np.asarray(mesh.vertices, dtype=np.float64) @ linear.T + transform[:3, 3]
    # normals turn with the inverse transpose
    normals = np.asarray(mesh.vertex_normals, dtype=np.float64) @ np.linalg.pinv(linear)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    if np.linalg.det(linear) < 0:  # a mirror turns the faces inside out
        faces = faces[:, ::-1]
    uv = getattr(mesh.visual, "uv", None)
    # trimesh counts v upwards, glTF downwards
    coordinates = np.zeros((len(vertices), 2)) if uv is None else np.asarray(uv, dtype=np.float64) * [1, -1] + [0, 1]
    return Part(vertices, normals, coordinates, faces, _material(mesh, header), _vertex_color(mesh))


def _with_flat_faces(mesh: Any) -> Any:
    """The mesh with a vertex of its own for each corner of each face: without normals in the file, faces are flat.

    glTF 2.0, 3.7.2.1: "When normals are not specified, client implementations MUST calculate flat normals".
    """
    import trimesh

    corners = np.asarray(mesh.faces).reshape(-1)
    visual = mesh.visual
    uv = getattr(visual, "uv", None)
    if getattr(visual, "kind", None) == "texture":
        coordinates = None if uv is None else np.asarray(uv)[corners]
        visual = trimesh.visual.TextureVisuals(uv=coordinates, material=visual.material)
    elif getattr(visual, "kind", None) == "vertex":
        visual = trimesh.visual.ColorVisuals(vertex_colors=np.asarray(visual.vertex_colors)[corners])
    flat = trimesh.Trimesh(
        np.asarray(mesh.vertices)[corners], np.arange(len(corners)).reshape(-1, 3), process=False, visual=visual
    )
    flat.vertex_normals = np.repeat(mesh.face_normals, 3, axis=0)
    return flat


def _vertex_color(mesh: Any) -> FloatArray | None:
    """(n, 4) colours of the vertices in 0 to 1, None without."""
    if getattr(mesh.visual, "kind", None) != "vertex":
        return None
    return np.asarray(mesh.visual.vertex_colors, dtype=np.float64) / 255.0


def _material(mesh: Any, header: dict[str, Any]) -> Material:
    """The mesh's material: numbers from the file's JSON, textures as trimesh decoded them."""
    read = getattr(mesh.visual, "material", None)
    name = getattr(read, "name", None)
    rows = header.get("materials", [])
    row = int(name) if name is not None and str(name).isdigit() and int(name) < len(rows) else None
    if row is None:  # glTF's default material
        return Material(np.ones(4), metallic=0.0, roughness=0.8)
    stated = rows[row]
    surface = stated.get("pbrMetallicRoughness", {})
    glossy = stated.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None and not surface:
        surface = {"baseColorFactor": glossy.get("diffuseFactor", [1, 1, 1, 1]), "metallicFactor": 0.0,
                   "roughnessFactor": 1.0 - glossy.get("glossinessFactor", 1.0)}  # fmt: skip
    mode = stated.get("alphaMode", "OPAQUE")
    return Material(
        np.asarray(surface.get("baseColorFactor", [1, 1, 1, 1]), dtype=np.float64),
        float(surface.get("metallicFactor", 1.0)),
        float(surface.get("roughnessFactor", 1.0)),
        np.asarray(stated.get("emissiveFactor", [0, 0, 0]), dtype=np.float64),
        _pixels(getattr(read, "baseColorTexture", None)),
        _pixels(getattr(read, "metallicRoughnessTexture", None)),
        _pixels(getattr(read, "normalTexture", None)),
        _pixels(getattr(read, "emissiveTexture", None)),
        float(stated.get("alphaCutoff", 0.5)) if mode == "MASK" else None,
        mode == "BLEND",
    )


def _pixels(image: Any) -> Pixels | None:
    """(h, w, 4) uint8 of a PIL image, or None."""
    return None if image is None else np.asarray(image.convert("RGBA"), dtype=np.uint8)
