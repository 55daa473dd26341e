"""A model's file at another size: written anew with a factor on all lengths, read again and checked.

What states a size is changed and nothing else: a root node of glTF, `metersPerUnit` of USD, the unit of COLLADA, the
vertices of OBJ, STL and PLY, scales, sizes and places of URDF, SDF and MJCF.

A glTF file with its vertices, translations, bindings and movements times a factor, without a node above them.
"""

from __future__ import annotations

import re
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file
from metric_base.files import whole_file
from metric_base.input_files import read_bytes
from models3d.asset import Asset, merge_bodies
from models3d.formats import GLTF_SUFFIXES, ROBOT_SUFFIXES, USD, read_asset
from models3d.gltf.document import CHUNK_HEAD, MAX_BYTES, read_container, write_container

_FLOAT = 5126
#: How far the extents that are read again may be from what they should be: float32 keeps seven digits.
SAME_SHARE = 1e-3
_NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_OBJ_VERTEX = re.compile(rb"^(v[ \t]+)(%b)([ \t]+)(%b)([ \t]+)(%b)" % (_NUMBER, _NUMBER, _NUMBER), re.M)
_STL_VERTEX = re.compile(rb"(vertex\s+)(%b)(\s+)(%b)(\s+)(%b)" % (_NUMBER, _NUMBER, _NUMBER), re.I)
_DAE_UNIT = re.compile(rb"(<unit\b[^>]*\bmeter\s*=\s*[\"'])([^\"']+)([\"'])")
#: Types of PLY's properties, old and new names.
_PLY_KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
#: Attributes and elements that hold lengths, by format; the others of a `pose` are angles.
_LENGTHS = {
    "robot": {"origin": "xyz", "box": "size", "cylinder": "radius length", "sphere": "radius",
              "mesh": "scale"},
    "mujoco": {"body": "pos", "geom": "pos size fromto", "joint": "pos", "site": "pos size", "camera": "pos",
               "light": "pos", "mesh": "scale", "inertial": "pos"},
    "sdf": {"pose": "", "size": "", "radius": "", "length": "", "scale": ""},
}  # fmt: skip


def bake(header: dict[str, Any], binary: bytearray, factor: float) -> bytes:
    """Multiply all lengths of a GLB's record and of its binary chunk (with its head); the chunk's bytes are returned.

    FieldError for a file whose buffers are other files, or whose vertices are no plain 32-bit numbers.
    """
    buffers = header.get("buffers", [])
    whole = len(buffers) <= 1 and all("uri" not in buffer for buffer in buffers)
    expect(
        whole, "buffers", "one buffer in the file itself (without --bake any file goes)", Unquoted(f"{len(buffers)}")
    )
    for number, columns in sorted(_length_accessors(header)):
        with at_field(f"accessors[{number}]"):
            _scale(header, header["accessors"][number], binary, columns, factor)
    for node in header.get("nodes", []):
        if "translation" in node:
            node["translation"] = [value * factor for value in node["translation"]]
        if "matrix" in node:
            node["matrix"][12:15] = [value * factor for value in node["matrix"][12:15]]
    return bytes(binary)


def _length_accessors(header: dict[str, Any]) -> Iterator[tuple[int, tuple[int, ...]]]:
    """The accessors that hold lengths, each once, with the columns that do."""
    columns: dict[int, tuple[int, ...]] = {}
    for mesh in header.get("meshes", []):
        for part in mesh.get("primitives", []):
            for attributes in (part.get("attributes", {}), *part.get("targets", [])):
                if "POSITION" in attributes:
                    columns[attributes["POSITION"]] = (0, 1, 2)
    for skin in header.get("skins", []):
        if "inverseBindMatrices" in skin:
            columns[skin["inverseBindMatrices"]] = (12, 13, 14)
    for animation in header.get("animations", []):
        for channel in animation.get("channels", []):
            if channel.get("target", {}).get("path") == "translation":
                columns[animation["samplers"][channel["sampler"]]["output"]] = (0, 1, 2)
    yield from columns.items()


def _scale(
    header: dict[str, Any], row: dict[str, Any], binary: bytearray, columns: tuple[int, ...], factor: float
) -> None:
    width = 16 if row.get("type") == "MAT4" else 3
    plain = row.get("componentType") == _FLOAT and "sparse" not in row and "bufferView" in row
    expect(plain, "values", "32-bit numbers in a buffer (without --bake any file goes)", Unquoted("others"))
    view = header["bufferViews"][row["bufferView"]]
    start = CHUNK_HEAD + view.get("byteOffset", 0) + row.get("byteOffset", 0)
    stride = view.get("byteStride", 4 * width)
    values = np.ndarray((row["count"], width), "<f4", binary, start, (stride, 4))  # (n, k)
    values[:, list(columns)] *= np.float32(factor)
    for bound in ("min", "max"):
        if bound in row and width == 3:
            row[bound] = [float(np.float32(value) * np.float32(factor)) for value in row[bound]]


def write_at_scale(path: Path, out: Path, factor: float, *, baked: bool = False) -> None:
    """Write `path` to `out` with all its lengths times `factor`.

    baked : the vertices of a glTF file themselves, not a node above them.

    Raises
    ------
    InputError
        `out` is the input; it is in another folder although the file names files beside it; the format cannot hold it.
    """
    if out.exists() and out.samefile(path):
        raise InputError(f"{out}: --fix: expected another file than the input, found the same")
    before = read_asset(path)
    write = _writer(path, baked)
    with in_file(path):
        beside = out.resolve().parent == path.resolve().parent
        expect(
            beside or not _names_files(path, before), "--fix", "a file in the same folder: the model names others", out
        )
        with whole_file(out, "--fix") as work:
            written = work.with_name(work.name + path.suffix)  # readers know a format by the ending
            try:
                write(path, written, factor)
                _check(before, read_asset(written), factor)
                written.replace(work)
            finally:
                written.unlink(missing_ok=True)


def _writer(path: Path, baked: bool) -> Callable[[Path, Path, float], None]:
    suffix = path.suffix.lower()
    if suffix in GLTF_SUFFIXES:
        return lambda source, work, factor: _write_gltf(source, work, factor, baked)
    if baked:
        raise InputError(f"--bake: expected a glTF file; found {path}")
    if suffix in USD:
        return _write_usd
    if suffix in ROBOT_SUFFIXES:
        return _write_robot
    plain = {".obj": _obj, ".stl": _stl, ".ply": _ply, ".dae": _dae}
    if suffix not in plain:
        raise InputError(f"{path}: --fix: expected a format whose size can be written, found {suffix}")
    change = plain[suffix]
    return lambda source, work, factor: _write(work, change(read_bytes(source, limit=MAX_BYTES), factor))


def _write(work: Path, data: bytes) -> None:
    work.write_bytes(data)


def _check(before: Asset, after: Asset, factor: float) -> None:
    was, now = (merge_bodies(asset.bodies, "").extents_m for asset in (before, after))
    near = np.allclose(now, was * factor, rtol=SAME_SHARE, atol=SAME_SHARE * float(was.max()) * factor)
    expect(bool(near), "--fix", f"{(was * factor).round(6).tolist()} m when read again", Unquoted(str(now.tolist())))


def _names_files(path: Path, asset: Asset) -> bool:
    """Whether the file needs others beside it."""
    if asset.format == "gltf":
        header, _ = read_container(read_bytes(path, limit=MAX_BYTES), compressed=True)
        rows = [*header.get("buffers", []), *header.get("images", [])]
        return any(not str(row.get("uri", "data:")).startswith("data:") for row in rows)
    if asset.format in ("urdf", "robot", "sdf", "mujoco"):
        return b"mesh" in read_bytes(path, limit=MAX_BYTES)
    return path.suffix.lower() == ".obj" and b"mtllib" in read_bytes(path, limit=MAX_BYTES)


def _write_gltf(path: Path, work: Path, factor: float, baked: bool) -> None:
    """Scale a glTF file: its vertices if `baked`, else by a node with a scale above the roots of every scene."""
    data = read_bytes(path, limit=MAX_BYTES)
    header, chunks = read_container(data, compressed=not baked)
    if baked:
        chunks = bake(header, bytearray(chunks), factor)
    else:
        nodes = header.setdefault("nodes", [])
        for scene in header.get("scenes", []):
            nodes.append({"name": "true size", "scale": [factor] * 3, "children": list(scene.get("nodes", []))})
            scene["nodes"] = [len(nodes) - 1]
    work.write_bytes(write_container(header, chunks, binary=data.startswith(b"glTF")))


def _write_usd(path: Path, work: Path, factor: float) -> None:
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    unit = float(UsdGeom.GetStageMetersPerUnit(stage)) * factor
    if path.suffix.lower() == ".usdz":
        _write_usdz(path, work, unit)
        return
    shutil.copyfile(path, work)
    layer = Sdf.Layer.FindOrOpen(str(work))
    layer.pseudoRoot.SetInfo("metersPerUnit", unit)
    layer.Save()


def _write_usdz(path: Path, copy: Path, unit: float) -> None:
    """The package again, its first layer with another unit, the other files as they are."""
    import tempfile
    import zipfile

    from pxr import Sdf, Usd

    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path) as package:
        package.extractall(folder)
        writer = (Sdf.ZipFileWriter if hasattr(Sdf, "ZipFileWriter") else Usd.ZipFileWriter).CreateNew(str(copy))
        for number, name in enumerate(package.namelist()):
            file = Path(folder, name)
            if number == 0:
                layer = Sdf.Layer.FindOrOpen(str(file))
                layer.pseudoRoot.SetInfo("metersPerUnit", unit)
                layer.Save()
            writer.AddFile(str(file), name)
        writer.Save()


def _write_robot(path: Path, work: Path, factor: float) -> None:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    tree = etree.fromstring(read_bytes(path, limit=MAX_BYTES), parser).getroottree()
    root = tree.getroot()
    _scale_meshes(root)
    lengths = _LENGTHS[str(root.tag)]
    for element in root.iter(*lengths):
        names = lengths[element.tag].split()
        if not names:
            element.text = _times(element.text or "", factor, 3 if element.tag == "pose" else None)
        for name in names:
            if element.get(name) is not None:
                element.set(name, _times(element.get(name), factor))
    tree.write(str(work), xml_declaration=True, encoding="utf-8")


def _scale_meshes(root: Any) -> None:
    """A scale of 1 for each mesh that states none, so that each has one to multiply."""
    from lxml import etree

    for mesh in root.iter("mesh"):
        if root.tag == "sdf":
            if mesh.find("scale") is None:
                etree.SubElement(mesh, "scale").text = "1 1 1"
        elif mesh.get("scale") is None:
            mesh.set("scale", "1 1 1")


def _times(text: str, factor: float, count: int | None = None) -> str:
    """The numbers of a text times a factor, of a pose the first three."""
    values = text.split()
    return " ".join(f"{float(one) * factor:.9g}" if count is None or n < count else one for n, one in enumerate(values))


def _obj(data: bytes, factor: float) -> bytes:
    return _OBJ_VERTEX.sub(lambda match: _scaled_match(match, factor), data)


def _stl(data: bytes, factor: float) -> bytes:
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) != 84 + 50 * count:
        return _STL_VERTEX.sub(lambda match: _scaled_match(match, factor), data)
    rows = np.frombuffer(data, np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("extra", "<u2")]), -1, 84).copy()
    rows["corners"] *= np.float32(factor)
    return data[:84] + rows.tobytes()


def _ply(data: bytes, factor: float) -> bytes:
    """The vertices of a PLY file, which come first in every file that is met."""
    end = data.index(b"end_header")
    start = data.index(b"\n", end) + 1
    header = data[:start].decode("ascii", errors="replace").split("\n")
    elements = [line.split() for line in header if line.startswith(("element", "property", "format"))]
    form = next(words[1] for words in elements if words[0] == "format")
    places = [n for n, words in enumerate(elements) if words[0] == "element"]
    expect(elements[places[0]][1] == "vertex", "element", "vertices first", elements[places[0]][1])
    count = int(elements[places[0]][2])
    stop = places[1] if len(places) > 1 else len(elements)
    properties = [words for words in elements[places[0] + 1 : stop] if words[0] == "property"]
    expect(
        all(len(words) == 3 for words in properties), "property", "numbers, no lists, for vertices", Unquoted("lists")
    )
    names = [words[2] for words in properties]
    if form == "ascii":
        lines = data[start:].split(b"\n")
        for number in range(count):
            values = lines[number].split()
            for axis in "xyz":
                values[names.index(axis)] = f"{float(values[names.index(axis)]) * factor:.9g}".encode()
            lines[number] = b" ".join(values)
        return data[:start] + b"\n".join(lines)
    order = "<" if "little" in form else ">"
    kind = np.dtype([(words[2], order + _PLY_KINDS[words[1]]) for words in properties])
    rows = np.frombuffer(data, kind, count, start).copy()
    for axis in "xyz":
        rows[axis] = rows[axis] * factor
    return data[:start] + rows.tobytes() + data[start + rows.nbytes :]


def _dae(data: bytes, factor: float) -> bytes:
    """Another unit: 1 where the file states none, which is COLLADA's rule."""
    unit = _DAE_UNIT.search(data)
    if unit is not None:
        return data[: unit.start(2)] + f"{float(unit[2]) * factor:.9g}".encode() + data[unit.end(2) :]
    place = data.find(b"<up_axis")
    place = place if place >= 0 else data.find(b"</asset>")
    if place < 0:
        raise FieldError("asset", "a COLLADA file with an asset element", Unquoted("none"))
    return data[:place] + f'<unit name="true" meter="{factor:.9g}"/>'.encode() + data[place:]


def _scaled_match(match: re.Match[bytes], factor: float) -> bytes:
    """A vertex's line with its three numbers (groups 2, 4, 6) times the factor."""
    parts = [match[1], match[2], match[3], match[4], match[5], match[6]]
    for place in (1, 3, 5):
        parts[place] = f"{float(parts[place]) * factor:.9g}".encode()
    return b"".join(parts)
