"""COLMAP models as a scene: binary or text, the old three files or the new five, also under `sparse/0`.

What a COLMAP model's files say, before it is checked and joined into a scene.

A `pycolmap.Reconstruction` in memory as a scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.projection.cameras import make_camera
from estimator.reconstructions.colmap_files import ColmapImage, ColmapModel, read_binary_model, read_text_model
from estimator.records.scene import MAX_COORDINATE, Camera, Scene, View
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file

if TYPE_CHECKING:
    from pycolmap import Reconstruction

#: Where a COLMAP workspace keeps its model, in the order of preference.
MODEL_PLACES = (
    ".", "sparse/0", "sparse", "0", "colmap/sparse/0", "colmap/sparse", "colmap", "dense/sparse", "dense/0/sparse",
)  # fmt: skip
#: A unit quaternion may have lost some digits in a text file; one of another length is not a rotation.
QUATERNION_TOLERANCE = 1e-2
#: COLMAP counts points from 1 and deletes some: while the largest id is at most this many times their number, a
#: table of all ids is small and ten times faster than a search.
MAX_ID_SPREAD = 16
#: What an error names in place of a file.
SOURCE = Path("pycolmap.Reconstruction")
#: What pycolmap answers for an observation without a point.
NO_POINT = np.uint64(2**64 - 1)


def colmap_folder(path: Path) -> Path | None:
    """The folder at or under `path` that holds a COLMAP model, or None."""
    folders = (path / place for place in MODEL_PLACES)
    return next((folder for folder in folders if model_suffix(folder)), None)


def model_suffix(folder: Path) -> str | None:
    """`.bin` or `.txt` where the folder has a model of that kind (any of its three files), binary first."""
    for suffix in (".bin", ".txt"):
        if any((folder / f"{part}{suffix}").is_file() for part in ("images", "points3D")):
            return suffix
    return None


def read_colmap(folder: Path, path: Path | None = None) -> Scene:
    """The model in `folder`; `path` is what the user named.

    Poses are those of `images`, which the new five-file form keeps beside the rigs and frames. InputError where
    anything does not hold together.
    """
    suffix = model_suffix(folder) or ".bin"
    model = read_binary_model(folder) if suffix == ".bin" else read_text_model(folder)
    images_file, points_file = folder / f"images{suffix}", folder / f"points3D{suffix}"
    with in_file(images_file):
        expect(bool(model.images), "images", "at least one registered image", 0)
        _check_unique("image id", [image.id for image in model.images])
        _check_unique("image name", [image.name for image in model.images])
    with in_file(points_file):
        rows_of = _point_rows(model)
    with in_file(images_file):
        views = tuple(_view(image, model, rows_of, suffix) for image in model.images)
    return Scene(
        path=path or folder,
        format="colmap-binary" if suffix == ".bin" else "colmap-text",
        views=views,
        points=model.points,
        model_path=folder,
    )


def _check_unique(field: str, values: Iterable[object]) -> None:
    seen: set[object] = set()
    for value in values:
        if value in seen:
            raise FieldError(field, "each one once", Unquoted(f"{value!r} twice"))
        seen.add(value)


def _point_rows(model: ColmapModel) -> Callable[[IntArray], IntArray]:
    """What maps (m,) point ids to their rows, -1 for ids that are none, after the checks every point must pass."""
    faulty = ~(np.abs(model.points) < MAX_COORDINATE).all(axis=1)
    if faulty.any():
        row = int(faulty.argmax())
        expected = f"finite coordinates below {MAX_COORDINATE:g}"
        raise FieldError(f"point {model.point_ids[row]}", expected, model.points[row].tolist())
    order = np.argsort(model.point_ids, kind="stable")
    ids = model.point_ids[order]
    if (ids[1:] == ids[:-1]).any():
        raise FieldError("point id", "each one once", Unquoted(f"{ids[1:][ids[1:] == ids[:-1]][0]} twice"))
    if len(ids) and (ids[0] < 0 or ids[-1] > MAX_ID_SPREAD * (len(ids) + 1)):
        return partial(_searched_rows, ids, order)
    table = np.full(int(ids[-1]) + 1 if len(ids) else 0, -1, dtype=np.int64)
    table[ids] = order
    return partial(_looked_up_rows, table)


def _looked_up_rows(table: IntArray, ids: IntArray) -> IntArray:
    """(n,) rows of ids (n,) by a table (t,) of the row of each id; -1 where unknown."""
    known = (ids >= 0) & (ids < len(table))
    rows = np.full(len(ids), -1, dtype=np.int64)
    rows[known] = table[ids[known]]
    return rows


def _searched_rows(sorted_ids: IntArray, order: IntArray, ids: IntArray) -> IntArray:
    """(n,) rows of ids (n,) by bisection in sorted ids (m,), whose rows are `order` (m,); -1 where unknown."""
    places = np.minimum(np.searchsorted(sorted_ids, ids), len(sorted_ids) - 1)
    return np.where(sorted_ids[places] == ids, order[places], -1)


def _view(image: ColmapImage, model: ColmapModel, rows_of: Callable[[IntArray], IntArray], suffix: str) -> View:
    """The view of an image; `suffix` is that of the model's files, for errors; rows_of maps (m,) ids to rows (m,)."""
    with at_field(f"image {image.name!r}"):
        _check_pose(image, model, suffix)
        rows, keypoints = _observations(image, rows_of, suffix)
    rotation = Rotation.from_quat(image.quaternion, scalar_first=True).as_matrix()
    return View(image.name, model.cameras[image.camera_id], rotation, image.translation, keypoints, rows)


def _check_pose(image: ColmapImage, model: ColmapModel, suffix: str) -> None:
    if image.camera_id not in model.cameras:
        camera = Unquoted(f"{image.camera_id}, which cameras{suffix} lacks")
        raise FieldError("camera id", "a camera of the model", camera)
    pose = np.concatenate([image.quaternion, image.translation])
    if not (np.abs(pose) < MAX_COORDINATE).all():
        raise FieldError("pose", f"finite numbers below {MAX_COORDINATE:g}", pose.tolist())
    if abs(np.linalg.norm(image.quaternion) - 1) > QUATERNION_TOLERANCE:
        raise FieldError("rotation", "a quaternion of length 1", image.quaternion.tolist())


def _observations(
    image: ColmapImage, rows_of: Callable[[IntArray], IntArray], suffix: str
) -> tuple[IntArray, FloatArray]:
    """Rows (k,) of the points that the image observes, and their pixels (k, 2)."""
    seen = image.point_ids >= 0
    ids, keypoints = image.point_ids[seen], image.keypoints[seen]
    rows = rows_of(ids)
    if (rows < 0).any():
        point = Unquoted(f"{ids[rows < 0][0]}, which points3D{suffix} lacks")
        raise FieldError("point id", "a point of the model", point)
    if not np.isfinite(keypoints).all():
        raise FieldError("keypoints", "finite pixels", Unquoted("NaN or infinity"))
    return rows, keypoints


def scene_of_reconstruction(reconstruction: Reconstruction) -> Scene:
    """The scene of a reconstruction; views in the order of their image ids.

    Raises
    ------
    InputError
        It has no registered image, or a camera or a coordinate that no scene can have.
    """
    ids = sorted(reconstruction.reg_image_ids())
    if not ids:
        raise InputError.at(SOURCE, "images", "at least one registered image", 0)
    point_ids = np.array(sorted(reconstruction.points3D), dtype=np.uint64)
    points = np.array([reconstruction.points3D[int(number)].xyz for number in point_ids], dtype=float).reshape(-1, 3)
    if not (np.abs(points) < MAX_COORDINATE).all():
        raise InputError.at(SOURCE, "points", f"finite coordinates below {MAX_COORDINATE:g}", "others")
    cameras = {number: _camera(number, camera) for number, camera in reconstruction.cameras.items()}
    views = tuple(_pycolmap_view(reconstruction.images[number], cameras, point_ids) for number in ids)
    return Scene(path=SOURCE, format="memory", views=views, points=points)


def _camera(number: int, camera: Any) -> Camera:
    size = (int(camera.width), int(camera.height))
    with in_file(SOURCE), at_field(f"camera {number}"):
        return make_camera(camera.model.name, size, np.array(camera.params, dtype=float))


def _pycolmap_view(image: Any, cameras: dict[int, Camera], point_ids: np.ndarray[Any, np.dtype[np.uint64]]) -> View:
    """The view of an image of pycolmap; `point_ids` (n,) are sorted."""
    pose = np.asarray(image.cam_from_world().matrix(), dtype=float)  # (3, 4)
    seen = [(point.xy, point.point3D_id) for point in image.points2D if point.point3D_id != NO_POINT]
    keypoints = np.array([xy for xy, _ in seen], dtype=float).reshape(-1, 2)
    rows = np.searchsorted(point_ids, np.array([number for _, number in seen], dtype=np.uint64))
    return View(image.name, cameras[image.camera_id], pose[:, :3], pose[:, 3], keypoints, rows)
