"""Functions of several readers: lenses, views with poses, sizes of images, points, and parts of GLB files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.reconstructions.ply import read_points
from estimator.records.scene import MAX_COORDINATE, Camera, View
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, damage_as_field_error, expect
from metric_base.images import image_size
from metric_base.input_files import is_file

#: Conversion between the axes right, up, back (OpenGL, Blender) and right, down, forward (OpenCV, COLMAP).
FLIP = np.diag([1.0, -1.0, -1.0])
#: Maximum deviation of a rotation matrix with few digits from orthogonality.
MAX_ROTATION_ERROR = 1e-3
#: Maximum error of an approximated distortion, relative to the longer side: half a pixel of a camera.
MAX_FIT_ERROR = 1e-4
#: Maximum distortion coefficient; those of real lenses are below 10.
MAX_COEFFICIENT = 1e3
#: Number of iterations of the approximation.
N_FIT_ITERATIONS = 4
#: Maximum tangent of the angle from the optical axis.
MAX_TANGENT = 4.0
#: Folders of the images, relative to the file that contains their names.
IMAGE_FOLDERS = (".", "images", "..", "../images", "../..", "../../images")


def pinhole_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], distortion: Mapping[str, float]
) -> Camera:
    """Return a camera with the simplest COLMAP model that contains the parameters.

    Parameters
    ----------
    size : (width, height)
        In pixels.
    focal, centre : (x, y)
        In pixels.
    distortion : mapping of str to float
        k1, k2, p1, p2, k3 ... k6 of OpenCV; missing ones are zero.

    Raises
    ------
    FieldError
        A parameter is invalid.
    """
    nonzero = {name: value for name, value in distortion.items() if value}
    if not nonzero:
        return make_camera("PINHOLE", size, [*focal, *centre])
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = [nonzero.get(name, 0.0) for name in names]
    if set(nonzero) <= set(names[:4]):
        return make_camera("OPENCV", size, [*focal, *centre, *values[:4]])
    return make_camera("FULL_OPENCV", size, [*focal, *centre, *values])


def brown_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], distortion: Mapping[str, float]
) -> Camera:
    """Return the camera of Brown's polynomial 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8, with p1 and p2 of OpenCV.

    COLMAP has no model with k4. The polynomial P is approximated by a rational function (FULL_OPENCV), by least squares
    in P N = 1 + c1 r^2 + c2 r^4 + c3 r^6 with a denominator N of the same degree, weighted by r / N of the previous
    iteration (Sanathanan and Koerner 1963).

    Raises
    ------
    FieldError
        A parameter is invalid, or the error of the approximation exceeds `MAX_FIT_ERROR`.
    """
    radial = [distortion.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")]
    others = {name: distortion.get(name, 0.0) for name in ("p1", "p2")}
    if not radial[3]:
        return pinhole_camera(size, focal, centre, {**others, **dict(zip(("k1", "k2", "k3"), radial, strict=False))})
    expect(max(map(abs, radial)) <= MAX_COEFFICIENT, "distortion", f"numbers up to {MAX_COEFFICIENT:g}", radial)
    expect(min(focal) > 0, "focal length", "above 0", list(focal))
    reach = [max(c, side - c) / f for c, side, f in zip(centre, size, focal, strict=True)]
    corner = np.hypot(reach[0], reach[1])
    tangents = np.linspace(0, MAX_TANGENT, 4000)
    outside = np.flatnonzero(tangents * _polynomial(radial, tangents) >= corner)
    found = Unquoted("a polynomial that turns back before it")
    expect(len(outside), "distortion", "a polynomial that reaches the corner of the image", found)
    r = np.linspace(0, tangents[outside[0]], 400)
    wanted, powers = _polynomial(radial, r), np.stack([r**2, r**4, r**6], axis=1)
    fitted: FloatArray = np.zeros(6)
    for _ in range(N_FIT_ITERATIONS):
        weight = r / (1 + powers @ fitted[3:])
        rows = np.hstack([powers, -wanted[:, None] * powers]) * weight[:, None]
        fitted = np.asarray(np.linalg.lstsq(rows, (wanted - 1) * weight, rcond=1e-14)[0], dtype=np.float64)
    ratio = (1 + powers @ fitted[:3]) / (1 + powers @ fitted[3:])
    if not np.abs((ratio - wanted) * r * max(focal)).max() <= MAX_FIT_ERROR * max(size):
        raise FieldError("k4", "a polynomial that COLMAP's FULL_OPENCV can follow", radial[3])
    names = ("k1", "k2", "k3", "k4", "k5", "k6")
    return pinhole_camera(size, focal, centre, {**others, **dict(zip(names, fitted.tolist(), strict=True))})


def _polynomial(radial: Sequence[float], r: FloatArray) -> FloatArray:
    """Return 1 + k1 r^2 + k2 r^4 + ... (n,) at radii r (n,)."""
    return np.asarray(1 + sum(k * r ** (2 * power) for power, k in enumerate(radial, 1)))


def posed_view(name: str, camera: Camera, rotation: FloatArray, centre: FloatArray) -> View:
    """Return a view without observations.

    Parameters
    ----------
    name : str
    camera : Camera
    rotation : (3, 3) ndarray of float
        From world to camera, with the axes right, down, forward.
    centre : (3,) ndarray of float
        Camera centre in world coordinates.

    Raises
    ------
    FieldError
        The matrix is not a rotation, or a number is too large.
    """
    if not (np.abs(rotation) < 2).all() or not (np.abs(centre) < MAX_COORDINATE).all():
        raise FieldError("pose", f"finite numbers below {MAX_COORDINATE:g}", Unquoted("others"))
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > MAX_ROTATION_ERROR or np.linalg.det(rotation) < 0:
        raise FieldError("pose", "a rotation and a position", Unquoted("a matrix that is no rotation"))
    return View(name, camera, rotation, -rotation @ centre, np.empty((0, 2)), np.empty(0, np.int64))


def checked_image_size(file: Path, name: str) -> tuple[int, int]:
    """Return width and height of an image whose size is not in `file`.

    Raises
    ------
    InputError
        The image is missing or cannot be read.
    """
    parts = [part for part in name.replace("\\", "/").split("/") if part not in {"", ".", ".."}]
    names = [Path(*parts), Path(parts[-1])] if parts else []
    candidates = (file.parent / folder / path for path in names for folder in IMAGE_FOLDERS)
    path = next((path for path in candidates if is_file(path)), None)
    if path is None:
        expected = f"the image {Path(name).name!r} in its folder or in images/, because its size is not stated"
        raise InputError.at(file, "images", expected, Unquoted("none"))
    return image_size(path)


def read_point_file(file: Path, names: Iterable[str]) -> FloatArray:
    """Return the points (n, 3) of the first of these PLY files in the folder of `file`; empty if none exists."""
    path = next((found for name in names if is_file(found := file.parent / name)), None)
    if path is None:
        return np.empty((0, 3))
    points = read_points(path)
    return points[(np.abs(points) < MAX_COORDINATE).all(axis=1)]


def glb_parts(file: Path) -> list[tuple[FloatArray, FloatArray]]:
    """Return vertices (n, 3) in the frame of the file and texture coordinates (n, 2), if any, of each primitive.

    Raises
    ------
    FieldError
        The file is damaged or too large, or has no vertices.
    """
    from models3d.gltf.document import GltfDocument, world_transforms

    with damage_as_field_error("nodes, meshes and primitives of glTF 2.0"):
        document = GltfDocument.open(file)
        world, parts = world_transforms(document.nodes), []
        for node, matrix in zip(document.nodes, world, strict=True):
            for primitive in document.header["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
                attributes = primitive["attributes"]
                points = document.accessor(attributes["POSITION"], (3,)) @ matrix[:3, :3].T + matrix[:3, 3]
                has_uv = "TEXCOORD_0" in attributes
                parts.append(
                    (points, document.accessor(attributes["TEXCOORD_0"], (2,)) if has_uv else np.empty((0, 2)))
                )
    expect(parts, "meshes", "at least one with vertices", 0)
    return parts
