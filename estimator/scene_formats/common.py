"""What every export needs: cameras from pinholes with distortion, views from poses, sizes of pictures, points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.reconstructions.ply import read_points
from estimator.records.scene import MAX_COORDINATE, Camera, View
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted
from metric_base.input_files import is_file

#: From axes right, up, back (OpenGL, Blender) to right, down, forward (OpenCV, COLMAP), and the other way.
FLIP = np.diag([1.0, -1.0, -1.0])
#: How far from a rotation a matrix of few digits may be.
ROTATION_TOLERANCE = 1e-3
#: How far a lens that stands in for another model may be off, as a share of the longer side: half a pixel of a camera.
RATIONAL_SHARE = 1e-4
#: Distortion of real lenses is below 10.
MOST_COEFFICIENT = 1e3
#: Rounds of its fit, and the widest tangent of an angle from the axis.
ROUNDS, WIDEST_TANGENT = 4, 4.0
#: Where pictures are, seen from the file that names them.
PICTURE_PLACES = (".", "images", "..", "../images", "../..", "../../images")


def pinhole_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], distortion: Mapping[str, float]
) -> Camera:
    """The simplest of COLMAP's models that holds the numbers.

    size : (width, height) in pixels; focal, centre : (x, y) in pixels; distortion : OpenCV's k1, k2, p1, p2, k3 ... k6,
    those that are missing being zero. FieldError for numbers that no camera has.
    """
    given = {name: value for name, value in distortion.items() if value}
    if not given:
        return make_camera("PINHOLE", size, [*focal, *centre])
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = [given.get(name, 0.0) for name in names]
    if set(given) <= set(names[:4]):
        return make_camera("OPENCV", size, [*focal, *centre, *values[:4]])
    return make_camera("FULL_OPENCV", size, [*focal, *centre, *values])


def brown_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], distortion: Mapping[str, float]
) -> Camera:
    """The camera of Brown's polynomial 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8, with OpenCV's p1 and p2.

    COLMAP has no k4: a rational function (FULL_OPENCV) takes its place, fitted over the picture by least squares in
    P N = 1 + c1 r^2 + c2 r^4 + c3 r^6 with the polynomial P and the denominator N of the same degree, weighted by r / N
    of the round before (Sanathanan and Koerner 1963). FieldError where it is off by more than `RATIONAL_SHARE`.
    """
    radial = [distortion.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")]
    others = {name: distortion.get(name, 0.0) for name in ("p1", "p2")}
    if not radial[3]:
        return pinhole_camera(size, focal, centre, {**others, **dict(zip(("k1", "k2", "k3"), radial, strict=False))})
    if not max(map(abs, radial)) <= MOST_COEFFICIENT:
        raise FieldError("distortion", f"numbers up to {MOST_COEFFICIENT:g}", radial)
    if not min(focal) > 0:
        raise FieldError("focal length", "above 0", list(focal))
    reach = [max(c, side - c) / f for c, side, f in zip(centre, size, focal, strict=True)]
    corner = np.hypot(reach[0], reach[1])
    tangents = np.linspace(0, WIDEST_TANGENT, 4000)
    beyond = np.flatnonzero(tangents * _polynomial(radial, tangents) >= corner)
    if not len(beyond):
        raise FieldError("distortion", "a lens whose picture ends", Unquoted("a polynomial that turns back before it"))
    r = np.linspace(0, tangents[beyond[0]], 400)
    wanted, powers = _polynomial(radial, r), np.stack([r**2, r**4, r**6], axis=1)
    fitted: FloatArray = np.zeros(6)
    for _ in range(ROUNDS):
        weight = r / (1 + powers @ fitted[3:])
        rows = np.hstack([powers, -wanted[:, None] * powers]) * weight[:, None]
        fitted = np.asarray(np.linalg.lstsq(rows, (wanted - 1) * weight, rcond=1e-14)[0], dtype=np.float64)
    ratio = (1 + powers @ fitted[:3]) / (1 + powers @ fitted[3:])
    if not np.abs((ratio - wanted) * r * max(focal)).max() <= RATIONAL_SHARE * max(size):
        raise FieldError("k4", "a polynomial that COLMAP's FULL_OPENCV can follow", radial[3])
    names = ("k1", "k2", "k3", "k4", "k5", "k6")
    return pinhole_camera(size, focal, centre, {**others, **dict(zip(names, fitted.tolist(), strict=True))})


def _polynomial(radial: Sequence[float], r: FloatArray) -> FloatArray:
    """1 + k1 r^2 + k2 r^4 + ... at radii r (n,)."""
    return np.asarray(1 + sum(k * r ** (2 * power) for power, k in enumerate(radial, 1)))


def posed_view(name: str, camera: Camera, rotation: FloatArray, centre: FloatArray) -> View:
    """A view without observations.

    rotation : (3, 3) world to camera, camera axes right, down, forward; centre : (3,) of the camera in the world.
    FieldError where the matrix is no rotation.
    """
    if not (np.abs(rotation) < 2).all() or not (np.abs(centre) < MAX_COORDINATE).all():
        raise FieldError("pose", f"finite numbers below {MAX_COORDINATE:g}", Unquoted("others"))
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise FieldError("pose", "a rotation and a position", Unquoted("a matrix that is no rotation"))
    return View(name, camera, rotation, -rotation @ centre, np.empty((0, 2)), np.empty(0, np.int64))


def observed_views(views: Sequence[View], rows: IntArray, point_rows: IntArray, pixels: FloatArray) -> tuple[View, ...]:
    """The views with their observations: rows (m,) of views, point_rows (m,), pixels (m, 2)."""
    order = np.argsort(rows, kind="stable")
    parts = np.split(order, np.searchsorted(rows[order], np.arange(1, len(views))))
    return tuple(
        replace(view, keypoints=pixels[part], point_index=point_rows[part])
        for view, part in zip(views, parts, strict=True)
    )


def picture_file(file: Path, name: str) -> Path | None:
    """The picture of a name as `file` states it, in the usual places beside and above it, or None."""
    parts = [part for part in name.replace("\\", "/").split("/") if part not in {"", ".", ".."}]
    names = [Path(*parts), Path(parts[-1])] if parts else []
    candidates = (file.parent / place / path for path in names for place in PICTURE_PLACES)
    return next((path for path in candidates if is_file(path)), None)


def checked_image_size(file: Path, name: str) -> tuple[int, int]:
    """(width, height) of a picture that `file` names but whose size it does not state.

    Raises
    ------
    InputError
        The picture is not there, or is none.
    """
    from PIL import Image

    path = picture_file(file, name)
    if path is None:
        expected = f"the picture {Path(name).name!r} beside the file or in images/, for its size is not stated"
        raise InputError.at(file, "pictures", expected, Unquoted("none"))
    try:
        with Image.open(path) as picture:
            width, height = picture.size
            return int(width), int(height)
    except (OSError, ValueError, Image.DecompressionBombError):
        raise InputError.at(path, "picture", "a picture", Unquoted("something else")) from None


def points_beside(file: Path, names: Iterable[str]) -> FloatArray:
    """(n, 3) points of the first of the PLY files beside `file` that is there; none if none is."""
    place = next((path for name in names if is_file(path := file.parent / name)), None)
    if place is None:
        return np.empty((0, 3))
    points = read_points(place)
    return points[(np.abs(points) < MAX_COORDINATE).all(axis=1)]


def number_of(entry: Mapping[str, object], name: str, default: float | None = None) -> float:
    """The finite number of a name, also where it is written as text (as several programs do)."""
    value = entry.get(name, default)
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else np.nan
    except (ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise FieldError(name, "a number", value)
    return number


def matrix_of(values: object, shape: tuple[int, ...], field: str) -> FloatArray:
    """The values as an array of `shape`, such as (3, 4); FieldError if they are not that many finite numbers."""
    try:
        matrix = np.array(cast(Any, values), dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise FieldError(field, f"{' x '.join(map(str, shape))} finite numbers", Unquoted("others"))
    return matrix
