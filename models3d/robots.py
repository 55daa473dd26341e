"""Boxes of the objects in robot and world descriptions: URDF, SDF and MJCF, in metres with z up, all joints at zero.

Meshes are read from the folder of the file or below it; `package://` and `model://` names are searched there, too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, damage_as_field_error, expect, in_file
from metric_base.input_files import read_bytes
from models3d.asset import Asset, AssetBody, Box, NameText, body_from_box, merge_bodies

#: Maximum size of a description without its meshes, in bytes.
MAX_BYTES = 1 << 26
#: Maximum number of mesh files of a description.
MAX_MESHES = 20_000
#: Maximum depth of the tree of links or bodies.
MAX_DEPTH = 200
#: Reads a mesh file.
MeshReader = Callable[[Path], Asset]


def read_robot(path: Path, read_mesh: MeshReader) -> Asset:
    """Read a URDF, SDF or MJCF file; its root element determines the format.

    Parameters
    ----------
    path : Path
    read_mesh : callable
        Reads the mesh files to which the description refers.

    Raises
    ------
    InputError
        The file is damaged, too large, refers to files outside its folder, or has no visual shape.
    """
    from lxml import etree

    with in_file(path):
        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
        with damage_as_field_error("XML", etree.XMLSyntaxError, str):
            root = etree.fromstring(read_bytes(path, limit=MAX_BYTES), parser)
        meshes = _Meshes(path, read_mesh)
        readers = {"robot": _urdf_bodies, "sdf": _sdf_bodies, "mujoco": _mjcf_bodies}
        expect(root.tag in readers, "content", "a robot (URDF), sdf or mujoco element", str(root.tag))
        with damage_as_field_error("valid numbers and names", (ValueError, TypeError, IndexError, RecursionError), str):
            bodies = tuple(readers[root.tag](root, meshes))
        has_meshes = next(root.iter("mesh"), None) is not None
    name = root.get("name") or root.get("model")
    return Asset(path, str(root.tag), 1.0, "z", bodies, (NameText("robot", name),) if name else (), has_meshes)


class _Meshes:
    """Boxes of the mesh files of a description; each file is read once."""

    def __init__(self, path: Path, read_mesh: MeshReader) -> None:
        self._folder, self._read, self._corners = path.parent.resolve(), read_mesh, dict[Path, FloatArray]()

    def corners(self, name: str, scale: FloatArray, subfolder: str = "") -> FloatArray:
        """Return the corners (8, 3) of the box of a mesh in its frame in metres, times `scale` (3,)."""
        file = self._find(name, subfolder)
        if file not in self._corners:
            expect(len(self._corners) < MAX_MESHES, "mesh", f"at most {MAX_MESHES} files", Unquoted("more"))
            box = merge_bodies(self._read(file).bodies, "")
            self._corners[file] = _box_corners(box.low_m, box.high_m)
        return np.asarray(self._corners[file] * scale)

    def _find(self, name: str, subfolder: str) -> Path:
        """Return the file in the folder. Leading components, such as the name of a package, are optional."""
        parts = [part for part in name.split("://", 1)[-1].replace("\\", "/").split("/") if part]
        for start in range(len(parts)):
            for folder in (self._folder / subfolder, self._folder, self._folder.parent):
                file = folder.joinpath(*parts[start:]).resolve()
                is_inside = file.is_relative_to(self._folder)
                is_inside = is_inside or ("://" in name and file.is_relative_to(folder.resolve()))
                if is_inside and file.is_file():
                    return file
        raise FieldError("mesh", "a file in the folder of the model", name)


def _urdf_bodies(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """Yield one object with all links (wiki.ros.org/urdf/XML)."""
    frames: dict[str, FloatArray] = {}
    joints = {
        joint.find("child").get("link"): joint for joint in root.findall("joint") if joint.find("child") is not None
    }

    def link_frame(link: str, depth: int = 0) -> FloatArray:
        """Return the transform (4, 4) of a link to the root of the robot."""
        expect(depth < MAX_DEPTH, "joint", "links in no circle", link)
        if link not in frames:
            joint = joints.get(link)
            if joint is None or joint.find("parent") is None:
                frames[link] = np.eye(4)
            else:
                parent = link_frame(joint.find("parent").get("link"), depth + 1)
                frames[link] = parent @ origin(joint.find("origin"))
        return frames[link]

    def origin(element: Any) -> FloatArray:
        """Return the transform (4, 4) of an `origin` element: `xyz` in metres and `rpy` in radians."""
        if element is None:
            return np.eye(4)
        return _pose(_numbers(element.get("xyz"), (0, 0, 0)), _numbers(element.get("rpy"), (0, 0, 0)))

    clouds, texts = [], []
    for link in root.findall("link"):
        for visual, corners in _visuals(link, meshes, lambda shape, name: shape.get(name)):
            clouds.append(_transform(corners, link_frame(link.get("name", "")) @ origin(visual.find("origin"))))
        texts.append(NameText("body", link.get("name", "")))
    if clouds:
        yield body_from_box(root.get("name") or "robot", _bounds(clouds), 1.0, tuple(texts))


def _sdf_bodies(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """Yield one object for each model of the file or of its world (sdformat.org)."""

    def pose(element: Any) -> FloatArray:
        """Return the transform (4, 4) of a `pose` element: x, y, z, roll, pitch, yaw."""
        values = _numbers(element.findtext("pose"), (0, 0, 0, 0, 0, 0))
        return _pose(values[:3], values[3:6])

    for model in [*root.findall("model"), *root.findall("world/model")]:
        clouds = []
        for link in model.findall("link"):
            for visual, corners in _visuals(link, meshes, lambda shape, name: shape.findtext(name)):
                clouds.append(_transform(corners, pose(model) @ pose(link) @ pose(visual)))
        if clouds:
            name = model.get("name", "model")
            yield body_from_box(name, _bounds(clouds), 1.0, (NameText("model", name),))


def _mjcf_bodies(root: Any, meshes: _Meshes) -> Iterator[AssetBody]:
    """Yield one object for each body of the world with its descendants (mujoco.readthedocs.io, XML reference)."""
    compiler = root.find("compiler")
    settings = compiler.attrib if compiler is not None else {}
    subfolder = settings.get("meshdir", settings.get("assetdir", ""))
    is_in_degrees = settings.get("angle", "degree") == "degree"
    assets = {mesh.get("name", Path(mesh.get("file", "")).stem): mesh for mesh in root.findall("asset/mesh")}

    def clouds(body: Any, frame: FloatArray, depth: int) -> Iterator[FloatArray]:
        """Yield the corners (8, 3) of all shapes of a body and its descendants; `frame` is that of its parent."""
        expect(depth < MAX_DEPTH, "body", f"at most {MAX_DEPTH} levels", depth)
        frame = frame @ _mjcf_frame(body, is_in_degrees)
        for geom in body.findall("geom"):
            kind = geom.get("type", "mesh" if geom.get("mesh") else "sphere")
            if kind == "mesh":
                expect(geom.get("mesh") in assets, "geom.mesh", "a mesh of the assets", geom.get("mesh"))
                asset = assets[geom.get("mesh")]
                scale = _numbers(asset.get("scale"), (1, 1, 1))
                corners: FloatArray | None = meshes.corners(asset.get("file", ""), scale, subfolder)
            elif geom.get("size") is None:
                continue
            else:
                # `size` is half the sides of a box; of round shapes, the radius and half the length.
                size = _numbers(geom.get("size"), None)
                corners = _shape_corners(kind, {"size": 2 * size, "radius": size, "length": 2 * size[1:]})
            if corners is not None:
                yield _transform(corners, frame @ _mjcf_frame(geom, is_in_degrees))
        for child in body.findall("body"):
            yield from clouds(child, frame, depth + 1)

    for index, body in enumerate(root.findall("worldbody/body")):
        if parts := list(clouds(body, np.eye(4), 0)):
            name = body.get("name", f"body {index}")
            names = [name, *(descendant.get("name", "") for descendant in body.iter("body"))]
            texts = tuple(NameText("body", text) for text in dict.fromkeys(names) if text)
            yield body_from_box(name, _bounds(parts), 1.0, texts)


def _mjcf_frame(element: Any, is_in_degrees: bool) -> FloatArray:
    """Return the transform (4, 4) of `pos` and of `quat`, `euler` or `axisangle`; other rotations are refused."""
    others = [name for name in ("xyaxes", "zaxis", "fromto") if element.get(name) is not None]
    expect(not others, "orientation", "quat, euler or axisangle", Unquoted(", ".join(others)))
    unit = np.pi / 180 if is_in_degrees else 1.0
    frame = np.eye(4)
    frame[:3, 3] = _numbers(element.get("pos"), (0, 0, 0))
    if element.get("quat") is not None:
        frame[:3, :3] = Rotation.from_quat(_numbers(element.get("quat"), None), scalar_first=True).as_matrix()
    elif element.get("euler") is not None:
        frame[:3, :3] = Rotation.from_euler("XYZ", _numbers(element.get("euler"), None) * unit).as_matrix()
    elif element.get("axisangle") is not None:
        x, y, z, angle = _numbers(element.get("axisangle"), None)
        axis = np.array([x, y, z]) / max(float(np.linalg.norm([x, y, z])), 1e-12)
        frame[:3, :3] = Rotation.from_rotvec(axis * float(angle) * unit).as_matrix()
    return frame


def _visuals(link: Any, meshes: _Meshes, value: Callable[[Any, str], str | None]) -> Iterator[tuple[Any, FloatArray]]:
    """Yield the visuals of a link of URDF or SDF that have a box, with its corners (8, 3) in their frame, in metres.

    value : returns a value of a shape by its name, from its attributes (URDF) or elements (SDF).
    """
    for visual in link.findall("visual"):
        shape = next(visual.iterfind("geometry/*"), None)
        if shape is not None and shape.tag == "mesh":
            name = value(shape, "filename") or value(shape, "uri") or ""
            yield visual, meshes.corners(name.strip(), _numbers(value(shape, "scale"), (1, 1, 1)))
        elif shape is not None:
            present = {name: text for name in ("size", "radius", "length") if (text := value(shape, name))}
            corners = _shape_corners(shape.tag, {name: _numbers(text, None) for name, text in present.items()})
            if corners is not None:
                yield visual, corners


def _shape_corners(kind: str, values: dict[str, FloatArray]) -> FloatArray | None:
    """Return the corners (8, 3) of the box of a shape in its frame, in metres; None for a shape without a box.

    values : the sides `size` (3,) of a box, or `radius` (1,) and `length` (1,) of a round shape, without the caps of a
    capsule.
    """
    if kind not in {"box", "ellipsoid", "cylinder", "sphere", "capsule"}:
        return None
    needed = "size" if kind in {"box", "ellipsoid"} else "radius"
    expect(needed in values, kind, f"its {needed}", Unquoted("none"))
    if needed == "size":
        half = values["size"][:3] / 2
    else:
        radius = float(values["radius"][0])
        length = float(values["length"][0]) if kind != "sphere" and "length" in values else 0.0
        half = np.array([radius, radius, length / 2 + (radius if kind != "cylinder" else 0)])
    return _box_corners(-half, half)


def _numbers(text: str | None, default: tuple[float, ...] | None) -> FloatArray:
    """Return the numbers (n,) of a text; ValueError for other texts, and if both text and default are missing."""
    if text is None or not text.strip():
        if default is None:
            raise ValueError("a size is missing")
        return np.array(default, dtype=float)
    values = np.array([float(part) for part in text.split()])
    if not np.isfinite(values).all():
        raise ValueError(f"{text[:60]!r} is not finite")
    is_common_scale = default is not None and len(default) == 3 and len(values) == 1
    return np.repeat(values, 3) if is_common_scale else values


def _pose(position: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the transform (4, 4) with rotations by `angles` (3,) about the fixed axes x, y and z, in radians."""
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    frame[:3, 3] = position
    return frame


def _bounds(clouds: list[FloatArray]) -> Box:
    """Return the lowest and the highest corner (3,) of point sets (n, 3)."""
    points = np.concatenate(clouds)
    return points.min(axis=0), points.max(axis=0)


def _box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the corners (8, 3) of a box between its lowest and highest corner (3,)."""
    return np.array(list(itertools.product(*zip(low, high, strict=True))))


def _transform(points: FloatArray, matrix: FloatArray) -> FloatArray:
    """Apply a transform (4, 4) to points (n, 3)."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
