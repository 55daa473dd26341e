"""Write a model file at another scale: all its lengths times a factor, and everything else unchanged.

The factor is written to the place that defines the scale of the format: a node above the roots of glTF (or, on request,
all its vertices, translations and bind poses), `metersPerUnit` of USD, the unit of COLLADA, the vertices of OBJ, STL
and PLY, and the scales, sizes and positions of URDF, SDF and MJCF. The written file is read again and compared.
"""

from __future__ import annotations

import re
import shutil
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import InputError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.files import inside, whole_file
from metric_base.input_files import read_bytes
from metric_base.ply import scaled_ply
from models3d.asset import Asset, merge_bodies
from models3d.formats import GLTF_SUFFIXES, ROBOT_SUFFIXES, USD_SUFFIXES, read_asset, read_assets
from models3d.gltf.document import CHUNK_HEAD, MAX_BYTES, read_container, write_container

_FLOAT = 5126
#: Maximum relative error of the extents of the written file; 32-bit floats have seven digits.
MAX_EXTENT_ERROR = 1e-3
_NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_OBJ_VERTEX = re.compile(rb"^(v[ \t]+)(%b)([ \t]+)(%b)([ \t]+)(%b)" % (_NUMBER, _NUMBER, _NUMBER), re.M)
_STL_VERTEX = re.compile(rb"(vertex\s+)(%b)(\s+)(%b)(\s+)(%b)" % (_NUMBER, _NUMBER, _NUMBER), re.I)
_DAE_UNIT = re.compile(rb"(<unit\b[^>]*\bmeter\s*=\s*[\"'])([^\"']+)([\"'])")
#: For each root element of a robot description, the elements that contain lengths, with the attributes that do. An
#: empty string stands for the text of the element; of a `pose`, only the first three numbers are lengths.
_LENGTHS = {
    "robot": {"origin": "xyz", "box": "size", "cylinder": "radius length", "sphere": "radius",
              "mesh": "scale"},
    "mujoco": {"body": "pos", "geom": "pos size fromto", "joint": "pos", "site": "pos size", "camera": "pos",
               "light": "pos", "mesh": "scale", "inertial": "pos"},
    "sdf": {"pose": "", "size": "", "radius": "", "length": "", "scale": ""},
}  # fmt: skip


def write_at_scale(asset: Asset, out: Path, factor: float, *, baked: bool = False) -> None:
    """Write the file of an asset with all its lengths times `factor`.

    Parameters
    ----------
    asset : Asset
        Content of the file, as read by `read_asset` or `read_assets`.
    out : Path
        File to write. Its format is that of the input.
    factor : float
    baked : bool, default False
        Change the vertices of a glTF file instead of adding a node above them.

    Raises
    ------
    InputError
        `out` is the input, or is in another folder although the model refers to other files; or the format cannot be
        rescaled.
    """
    path, suffix = asset.file, asset.file.suffix.lower()
    if out.exists() and out.samefile(path):
        raise InputError(f"{out}: --fix: expected another file than the input, found the same")
    if baked and suffix not in GLTF_SUFFIXES:
        raise InputError(f"--bake: expected a glTF file; found {path}")
    if suffix not in (*_RESCALERS, *USD_SUFFIXES):
        raise InputError(f"{path}: --fix: expected a format whose size can be written, found {suffix}")
    rescale = _bake_gltf if baked else _RESCALERS.get(suffix)
    with in_file(path):
        may_move = not asset.has_external_files or out.resolve().parent == path.resolve().parent
        expect(may_move, "--fix", "a file in the same folder: the model refers to other files", out)
        with whole_file(out, "--fix") as work:
            copy = work.with_name(work.name + path.suffix)  # readers recognise a format by its suffix
            try:
                # A separate process, because the original is parsed again.
                ((_, written),) = read_assets([path], partial(_write_copy, copy=copy, factor=factor, rescale=rescale))
                if isinstance(written, InputError):
                    raise written
                before, after = (merge_bodies(content.bodies, "").extents_m for content in (asset, written))
                tolerance = MAX_EXTENT_ERROR * float(before.max()) * factor
                is_right = np.allclose(after, before * factor, rtol=MAX_EXTENT_ERROR, atol=tolerance)
                expected = f"{(before * factor).round(6).tolist()} m when the file is read again"
                expect(is_right, "--fix", expected, Unquoted(str(after.tolist())))
                copy.replace(work)
            finally:
                copy.unlink(missing_ok=True)


def _write_copy(path: Path, copy: Path, factor: float, rescale: Callable[[bytes, float], bytes] | None) -> Asset:
    """Write the rescaled copy of a file (of USD if `rescale` is None), and return its content."""
    try:
        with in_file(path):
            if rescale is None:
                _write_usd(path, copy, factor)
            else:
                copy.write_bytes(rescale(read_bytes(path, limit=MAX_BYTES), factor))
    except OSError as error:
        words = error.strerror or "an error"
        raise InputError(f"{copy.parent}: --fix: expected a place that can be written, found {words}") from None
    return read_asset(copy)


def _rescale_gltf(data: bytes, factor: float) -> bytes:
    """Add a node with a scale above the roots of every scene."""
    header, chunks = read_container(data, compressed=True)
    nodes = header.setdefault("nodes", [])
    for scene in header.get("scenes", []):
        nodes.append({"name": "true size", "scale": [factor] * 3, "children": list(scene.get("nodes", []))})
        scene["nodes"] = [len(nodes) - 1]
    return write_container(header, chunks, binary=data.startswith(b"glTF"))


def _bake_gltf(data: bytes, factor: float) -> bytes:
    """Multiply the vertices, morph targets, translations and bind poses of a glTF file with one internal buffer."""
    header, content = read_container(data)
    chunks = bytearray(content)
    buffers = header.get("buffers", [])
    is_internal = len(buffers) <= 1 and all("uri" not in buffer for buffer in buffers)
    expected = "one buffer in the file itself (without --bake any file is accepted)"
    expect(is_internal, "buffers", expected, Unquoted(f"{len(buffers)}"))
    damage = (LookupError, TypeError, ValueError)
    with damage_as_field_error("vertices and keyframes within the buffer", damage, field="accessors"):
        for index, columns in sorted(_length_accessors(header).items()):
            with at_field(f"accessors[{index}]"):
                record = header["accessors"][index]
                is_plain = record.get("componentType") == _FLOAT and "sparse" not in record and "bufferView" in record
                expected = "32-bit numbers in a buffer (without --bake any file is accepted)"
                expect(is_plain, "values", expected, Unquoted("others"))
                width = 16 if record.get("type") == "MAT4" else 3
                view = header["bufferViews"][record["bufferView"]]
                start = CHUNK_HEAD + view.get("byteOffset", 0) + record.get("byteOffset", 0)
                stride = view.get("byteStride", 4 * width)
                values = np.ndarray((record["count"], width), "<f4", chunks, start, (stride, 4))
                values[:, columns] *= np.float32(factor)
                for bound in ("min", "max"):
                    if bound in record and width == 3:
                        record[bound] = [float(np.float32(value) * np.float32(factor)) for value in record[bound]]
    for node in header.get("nodes", []):
        if "translation" in node:
            node["translation"] = [value * factor for value in node["translation"]]
        if "matrix" in node:
            node["matrix"][12:15] = [value * factor for value in node["matrix"][12:15]]
    return write_container(header, bytes(chunks), binary=data.startswith(b"glTF"))


def _length_accessors(header: dict[str, Any]) -> dict[int, list[int]]:
    """Return the accessors that contain lengths, each with the columns that do."""
    columns: dict[int, list[int]] = {}
    for mesh in header.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            for attributes in (primitive.get("attributes", {}), *primitive.get("targets", [])):
                if "POSITION" in attributes:
                    columns[attributes["POSITION"]] = [0, 1, 2]
    for skin in header.get("skins", []):
        if "inverseBindMatrices" in skin:
            columns[skin["inverseBindMatrices"]] = [12, 13, 14]
    for animation in header.get("animations", []):
        for channel in animation.get("channels", []):
            if channel.get("target", {}).get("path") == "translation":
                columns[animation["samplers"][channel["sampler"]]["output"]] = [0, 1, 2]
    return columns


def _write_usd(path: Path, copy: Path, factor: float) -> None:
    """Multiply `metersPerUnit`, in a package that of its first layer; all other files of a package are unchanged."""
    import tempfile
    import zipfile

    from pxr import Sdf, Usd, UsdGeom

    unit = float(UsdGeom.GetStageMetersPerUnit(Usd.Stage.Open(str(path)))) * factor

    def set_unit(file: Path) -> None:
        """Write the unit into a layer."""
        layer = Sdf.Layer.FindOrOpen(str(file))
        layer.pseudoRoot.SetInfo("metersPerUnit", unit)
        layer.Save()

    if path.suffix.lower() != ".usdz":
        shutil.copyfile(path, copy)
        set_unit(copy)
        return
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path) as package:
        members = [info for info in package.infolist() if not info.is_dir()]
        n_bytes = sum(info.file_size for info in members)
        expect(n_bytes <= MAX_BYTES, "package", f"at most {MAX_BYTES} bytes unpacked", n_bytes)
        packed = Path(folder, copy.name)  # the writer leaves a temporary file after an error
        writer = (Sdf.ZipFileWriter if hasattr(Sdf, "ZipFileWriter") else Usd.ZipFileWriter).CreateNew(str(packed))
        for index, info in enumerate(members):
            file = inside(Path(folder, "files"), info.filename)
            is_inside = file == Path(folder, "files", info.filename)
            expect(is_inside, "package", "names of files inside the package", info.filename)
            file.parent.mkdir(parents=True, exist_ok=True)
            with package.open(info) as content, file.open("wb") as target:
                shutil.copyfileobj(content, target)
            if index == 0:
                set_unit(file)
            writer.AddFile(str(file), info.filename)
        writer.Save()
        shutil.copyfile(packed, copy)


def _rescale_robot(data: bytes, factor: float) -> bytes:
    """Multiply all lengths of a URDF, SDF or MJCF file, and the scales of its meshes."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    tree = etree.fromstring(data, parser).getroottree()
    root = tree.getroot()
    for mesh in root.iter("mesh"):  # meshes without a scale get one
        if root.tag == "sdf":
            if mesh.find("scale") is None:
                etree.SubElement(mesh, "scale").text = "1 1 1"
        elif mesh.get("scale") is None:
            mesh.set("scale", "1 1 1")

    def multiplied(text: str, n_lengths: int | None = None) -> str:
        """Multiply the first `n_lengths` numbers of a text, or all."""
        numbers = text.split()
        return " ".join(
            f"{float(number) * factor:.9g}" if n_lengths is None or index < n_lengths else number
            for index, number in enumerate(numbers)
        )

    lengths = _LENGTHS[str(root.tag)]
    for element in root.iter(*lengths):
        names = lengths[element.tag].split()
        if not names:
            element.text = multiplied(element.text or "", 3 if element.tag == "pose" else None)
        for name in names:
            if element.get(name) is not None:
                element.set(name, multiplied(element.get(name)))
    return bytes(etree.tostring(tree, xml_declaration=True, encoding="utf-8"))


def _rescale_stl(data: bytes, factor: float) -> bytes:
    """Multiply the vertices of a binary or ASCII STL file."""
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        facet = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", 9), ("attributes", "<u2")])
        rows = np.frombuffer(data, facet, -1, 84).copy()
        rows["vertices"] *= np.float32(factor)
        return data[:84] + rows.tobytes()
    return _rescale_text(data, factor, _STL_VERTEX)


def _rescale_text(data: bytes, factor: float, vertex: re.Pattern[bytes] = _OBJ_VERTEX) -> bytes:
    """Multiply the vertices of a text file; their three numbers are the groups 2, 4 and 6 of the pattern."""

    def scaled(match: re.Match[bytes]) -> bytes:
        parts = list(match.groups())
        parts[1::2] = [f"{float(number) * factor:.9g}".encode() for number in parts[1::2]]
        return b"".join(parts)

    return vertex.sub(scaled, data)


def _rescale_dae(data: bytes, factor: float) -> bytes:
    """Multiply the unit of a COLLADA file; a file without one is in metres."""
    unit = _DAE_UNIT.search(data)
    if unit is not None:
        value = f"{float(unit[2]) * factor:.9g}".encode()
        return data[: unit.start(2)] + value + data[unit.end(2) :]
    position = next((p for tag in (b"<up_axis", b"</asset>") if (p := data.find(tag)) >= 0), -1)
    expect(position >= 0, "asset", "a COLLADA file with an asset element", Unquoted("none"))
    return data[:position] + f'<unit name="true" meter="{factor:.9g}"/>'.encode() + data[position:]


#: The function that returns the bytes of a file at another scale, by the suffix of the file.
_RESCALERS: dict[str, Callable[[bytes, float], bytes]] = {
    **dict.fromkeys(GLTF_SUFFIXES, _rescale_gltf),
    **dict.fromkeys(ROBOT_SUFFIXES, _rescale_robot),
    ".obj": _rescale_text,
    ".stl": _rescale_stl,
    ".ply": partial(scaled_ply, number="{:.9g}".format),
    ".dae": _rescale_dae,
}
