"""The bodies of robots and worlds: URDF, SDF and MJCF, in metres with z up, each joint at its zero.

Meshes are read from the folder of the file or below it; `package://` and `model://` names are looked up there.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, expect, in_file
from metric_base.input_files import read_bytes
from models3d.asset import Asset, AssetBody, NameText, body_from_box

MAX_BYTES = 1 << 26
#: Most shapes of a file, and most levels of bodies in it.
MAX_SHAPES, MAX_DEPTH = 20_000, 200
#: Reads the file of a mesh, to ask for its box.
MeshReader = Callable[[Path], Asset]


def read_robot(path: Path, read_mesh: MeshReader) -> Asset:
    """What a URDF, SDF or MJCF file states; which of them it is, its first element says."""
    from lxml import etree

    with in_file(path):
        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
        try:
            root = etree.fromstring(read_bytes(path, limit=MAX_BYTES), parser)
        except etree.XMLSyntaxError as error:
            raise FieldError("content", "XML", Unquoted(str(error))) from None
        reader = _Meshes(path, read_mesh)
        kinds = {"robot": _urdf, "sdf": _sdf, "mujoco": _mjcf}
        expect(root.tag in kinds, "content", "a robot (URDF), sdf or mujoco element", str(root.tag))
        try:
            bodies = tuple(kinds[root.tag](root, reader))
        except (ValueError, IndexError, RecursionError) as error:
            raise FieldError("content", "numbers and names as the format has them", Unquoted(str(error))) from None
        expect(bool(bodies), "content", "at least one visual shape", Unquoted("none"))
    name = root.get("name") or root.get("model")
    return Asset(path, str(root.tag), 1.0, "z", bodies, (NameText("robot", name),) if name else ())


class _Meshes:
    """Boxes of the meshes that a file names, each read once."""

    def __init__(self, path: Path, read_mesh: MeshReader) -> None:
        self._folder, self._read, self._known = path.parent.resolve(), read_mesh, dict[Path, FloatArray]()

    def corners(self, name: str, scale: FloatArray, below: str = "") -> FloatArray:
        """(8, 3) corners of a mesh's box in metres of its own frame, times scale (3,)."""
        file = self._file(name, below)
        if file not in self._known:
            expect(len(self._known) < MAX_SHAPES, "mesh", f"at most {MAX_SHAPES} files", Unquoted("more"))
            bodies = self._read(file).bodies
            low = np.min([body.low_m for body in bodies], axis=0)
            high = np.max([body.high_m for body in bodies], axis=0)
            self._known[file] = _box_corners(low, high)
        return np.asarray(self._known[file] * scale)

    def _file(self, name: str, below: str) -> Path:
        """The file in the folder; a package's name is left out where the rest is there."""
        plain = name.split("://", 1)[-1]
        parts = [part for part in plain.replace("\\", "/").split("/") if part]
        for start in range(len(parts)):
            for folder in (self._folder / below, self._folder, self._folder.parent):
                file = folder.joinpath(*parts[start:]).resolve()
                inside = file.is_relative_to(self._folder) or ("://" in name and file.is_relative_to(folder.resolve()))
                if inside and file.is_file():
                    return file
        raise FieldError("mesh", "a file in the folder of the model", name)


def _urdf(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """One body: all links, each joint at zero (wiki.ros.org/urdf/XML)."""
    frames: dict[str, FloatArray] = {}
    joints = {
        joint.find("child").get("link"): joint for joint in root.findall("joint") if joint.find("child") is not None
    }

    def frame(link: str, depth: int = 0) -> FloatArray:
        expect(depth < MAX_DEPTH, "joint", "links in no circle", link)
        if link not in frames:
            joint = joints.get(link)
            if joint is None or joint.find("parent") is None:
                frames[link] = np.eye(4)
            else:
                frames[link] = frame(joint.find("parent").get("link"), depth + 1) @ _origin(joint.find("origin"))
        return frames[link]

    clouds, words = [], []
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            corners = _urdf_corners(visual.find("geometry"), meshes)
            if corners is not None:
                clouds.append(_transform_points(corners, frame(link.get("name", "")) @ _origin(visual.find("origin"))))
        words.append(NameText("body", link.get("name", "")))
    if clouds:
        points = np.concatenate(clouds)
        yield body_from_box(root.get("name") or "robot", (points.min(axis=0), points.max(axis=0)), 1.0, tuple(words))


def _urdf_corners(geometry: Any, meshes: _Meshes) -> FloatArray | None:
    """Corners (8, 3) of a visual shape's box in metres of its own frame; None for what has no box."""
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        return None
    if shape.tag == "mesh":
        return meshes.corners(shape.get("filename", ""), _numbers(shape.get("scale"), (1, 1, 1)))
    if shape.tag == "box":
        return _half_corners(_numbers(shape.get("size"), None) / 2)
    radius = float(shape.get("radius"))
    half = float(shape.get("length", 0)) / 2 if shape.tag == "cylinder" else radius
    return _half_corners(np.array([radius, radius, half]))


def _sdf(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """Each model of the file or of its world (sdformat.org)."""
    for model in [*root.findall("model"), *root.findall("world/model")]:
        clouds = []
        for link in model.findall("link"):
            for visual in link.findall("visual"):
                corners = _sdf_corners(visual.find("geometry"), meshes)
                if corners is not None:
                    clouds.append(_transform_points(corners, _pose(model) @ _pose(link) @ _pose(visual)))
        if clouds:
            points = np.concatenate(clouds)
            name = model.get("name", "model")
            yield body_from_box(name, (points.min(axis=0), points.max(axis=0)), 1.0, (NameText("model", name),))


def _sdf_corners(geometry: Any, meshes: _Meshes) -> FloatArray | None:
    """Corners (8, 3) of a visual shape's box in metres of its own frame; None for what has no box."""
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        return None
    if shape.tag == "mesh":
        return meshes.corners((shape.findtext("uri") or "").strip(), _numbers(shape.findtext("scale"), (1, 1, 1)))
    if shape.tag == "box":
        return _half_corners(_numbers(shape.findtext("size"), None) / 2)
    if shape.tag in {"cylinder", "sphere", "capsule"}:
        radius = float(shape.findtext("radius"))
        half = float(shape.findtext("length") or 0) / 2 + (radius if shape.tag != "cylinder" else 0)
        return _half_corners(np.array([radius, radius, half]))
    return None  # planes and heightmaps are ground, no object


def _mjcf(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """Each body of the world with those below it (mujoco.readthedocs.io, XML reference)."""
    compiler = root.find("compiler")
    settings = compiler.attrib if compiler is not None else {}
    below = settings.get("meshdir", settings.get("assetdir", ""))
    degrees = settings.get("angle", "degree") == "degree"
    files = {
        mesh.get("name", Path(mesh.get("file", "")).stem): (
            mesh.get("file", ""),
            _numbers(mesh.get("scale"), (1, 1, 1)),
        )
        for mesh in root.findall("asset/mesh")
    }

    def clouds(body: Any, frame: FloatArray, depth: int) -> Iterator[FloatArray]:
        expect(depth < MAX_DEPTH, "body", f"at most {MAX_DEPTH} levels", depth)
        frame = frame @ _mjcf_frame(body, degrees)
        for geom in body.findall("geom"):
            corners = _mjcf_corners(geom, files, meshes, below)
            if corners is not None:
                yield _transform_points(corners, frame @ _mjcf_frame(geom, degrees))
        for child in body.findall("body"):
            yield from clouds(child, frame, depth + 1)

    for number, body in enumerate(root.findall("worldbody/body")):
        points = list(clouds(body, np.eye(4), 0))
        if points:
            cloud = np.concatenate(points)
            name = body.get("name", f"body {number}")
            names = [name, *(one.get("name", "") for one in body.iter("body"))]
            words = tuple(NameText("body", text) for text in dict.fromkeys(names) if text)
            yield body_from_box(name, (cloud.min(axis=0), cloud.max(axis=0)), 1.0, words)


def _mjcf_corners(geom: Any, files: dict[str, Any], meshes: _Meshes, below: str) -> FloatArray | None:
    """Corners (8, 3) of a visual shape's box in metres of its own frame; None for what has no box."""
    kind = geom.get("type", "mesh" if geom.get("mesh") else "sphere")
    if kind == "mesh":
        expect(geom.get("mesh") in files, "geom.mesh", "a mesh of the assets", geom.get("mesh"))
        name, scale = files[geom.get("mesh")]
        return meshes.corners(name, scale, below)
    if kind not in {"box", "ellipsoid", "sphere", "cylinder", "capsule"} or geom.get("size") is None:
        return None
    size = _numbers(geom.get("size"), None)
    if kind in {"box", "ellipsoid"}:
        return _half_corners(size[:3])
    half = size[0] if kind == "sphere" else size[1] + (size[0] if kind == "capsule" else 0)
    return _half_corners(np.array([size[0], size[0], half]))


def _mjcf_frame(element: Any, degrees: bool) -> FloatArray:
    """(4, 4) of `pos` with `quat`, `euler` or `axisangle`; FieldError for a turn in another form."""
    frame = np.eye(4)
    frame[:3, 3] = _numbers(element.get("pos"), (0, 0, 0))
    others = [name for name in ("xyaxes", "zaxis", "fromto") if element.get(name) is not None]
    expect(not others, "orientation", "quat, euler or axisangle", Unquoted(", ".join(others)))
    unit = np.pi / 180 if degrees else 1.0
    if element.get("quat") is not None:
        frame[:3, :3] = _of_quaternion(_numbers(element.get("quat"), None))
    elif element.get("euler") is not None:
        for axis, angle in enumerate(_numbers(element.get("euler"), None) * unit):
            frame[:3, :3] = frame[:3, :3] @ _about(np.eye(3)[axis], float(angle))
    elif element.get("axisangle") is not None:
        x, y, z, angle = _numbers(element.get("axisangle"), None)
        frame[:3, :3] = _about(np.array([x, y, z]), float(angle) * unit)
    return frame


def _origin(element: Any) -> FloatArray:
    """(4, 4) of URDF's `origin`: `xyz` and `rpy` in radians."""
    if element is None:
        return np.eye(4)
    return _frame(_numbers(element.get("xyz"), (0, 0, 0)), _numbers(element.get("rpy"), (0, 0, 0)))


def _pose(element: Any) -> FloatArray:
    """(4, 4) of SDF's `pose`: x, y, z, roll, pitch, yaw."""
    values = _numbers(element.findtext("pose"), (0, 0, 0, 0, 0, 0))
    return _frame(values[:3], values[3:6])


def _frame(place: FloatArray, turn: FloatArray) -> FloatArray:
    """(4, 4) of a place (3,) and of turns (3,) about x, y and z in radians, in this order."""
    frame = np.eye(4)
    roll, pitch, yaw = (float(angle) for angle in turn)
    x, y, z = np.eye(3)
    frame[:3, :3] = _about(z, yaw) @ _about(y, pitch) @ _about(x, roll)
    frame[:3, 3] = place
    return frame


def _about(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) turn about an axis (3,) (Rodrigues)."""
    x, y, z = axis / max(float(np.linalg.norm(axis)), 1e-12)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def _of_quaternion(quaternion: FloatArray) -> FloatArray:
    """(3, 3) of w, x, y, z."""
    w, *axis = quaternion / max(float(np.linalg.norm(quaternion)), 1e-12)
    sine = float(np.linalg.norm(axis))
    return np.eye(3) if sine < 1e-12 else _about(np.array(axis), 2 * float(np.arctan2(sine, w)))


def _numbers(text: str | None, default: tuple[float, ...] | None) -> FloatArray:
    """The numbers (n,) of a text; ValueError for others, and where there is neither a text nor a default."""
    if text is None or not text.strip():
        if default is None:
            raise ValueError("a size is missing")
        return np.array(default, dtype=float)
    values = np.array([float(part) for part in text.split()])
    if not np.isfinite(values).all():
        raise ValueError(f"{text[:60]!r} is not finite")
    return np.repeat(values, 3) if default is not None and len(values) == 1 == len(default) // 3 else values


def _box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """(8, 3) of a box from its lower and upper corner, (3,) each."""
    return np.array(list(itertools.product(*zip(low, high, strict=True))))


def _half_corners(half: FloatArray) -> FloatArray:
    """(8, 3) of a box about the origin with these half sides (3,)."""
    return _box_corners(-half, half)


def _transform_points(points: FloatArray, matrix: FloatArray) -> FloatArray:
    """Points (n, 3) under a transform (4, 4)."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
