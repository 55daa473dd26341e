"""Read a COLMAP model as a scene: a folder of binary or text files, or a `pycolmap.Reconstruction` in memory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.projection.cameras import make_camera
from estimator.reconstructions.colmap_files import ColmapImage, ColmapModel, read_binary_model, read_text_model
from estimator.records.scene import MAX_COORDINATE, Scene, View
from metric_base.arrays import IntArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, expect, in_file

if TYPE_CHECKING:
    from pycolmap import Reconstruction

#: Folders of a COLMAP workspace that may contain a model, the preferred one first.
MODEL_FOLDERS = (
    ".", "sparse/0", "sparse", "0", "colmap/sparse/0", "colmap/sparse", "colmap", "dense/sparse", "dense/0/sparse",
)  # fmt: skip
#: Maximum error of the length of a unit quaternion, which text files may round.
MAX_QUATERNION_ERROR = 1e-2
#: Name of a reconstruction in memory in messages.
SOURCE = Path("pycolmap.Reconstruction")
#: Point id of pycolmap for an observation without a point.
NO_POINT = np.uint64(2**64 - 1)


def colmap_folder(path: Path) -> Path | None:
    """Return the folder at or below `path` that contains a COLMAP model, or None."""
    folders = (path / name for name in MODEL_FOLDERS)
    return next((folder for folder in folders if model_suffix(folder)), None)


def model_suffix(folder: Path) -> str | None:
    """Return `.bin` or `.txt`, preferably `.bin`, if the folder contains images or points of this kind, or None."""
    for suffix in (".bin", ".txt"):
        if any((folder / f"{part}{suffix}").is_file() for part in ("images", "points3D")):
            return suffix
    return None


def read_colmap(folder: Path, path: Path | None = None) -> Scene:
    """Read the model in a folder, with three files or, since COLMAP 3.12, five.

    Parameters
    ----------
    folder : Path
    path : Path, optional
        Path specified by the user.

    Returns
    -------
    Scene
        Poses are those of `images`, which are present in both versions; rigs and frames are not read.

    Raises
    ------
    InputError
        A file is damaged, or the files contradict each other.
    """
    suffix = model_suffix(folder) or ".bin"
    model = read_binary_model(folder) if suffix == ".bin" else read_text_model(folder)
    images_file, points_file = folder / f"images{suffix}", folder / f"points3D{suffix}"
    with in_file(images_file):
        expect(model.images, "images", "at least one registered image", 0)
        for field, values in (
            ("image id", [image.id for image in model.images]),
            ("image name", [image.name for image in model.images]),
        ):
            known: set[object] = set()
            for value in values:
                expect(value not in known, field, "each one once", Unquoted(f"{value!r} twice"))
                known.add(value)
    with in_file(points_file):
        is_invalid = ~(np.abs(model.points) < MAX_COORDINATE).all(axis=1)
        if is_invalid.any():
            row = int(is_invalid.argmax())
            expected = f"finite coordinates below {MAX_COORDINATE:g}"
            raise FieldError(f"point {model.point_ids[row]}", expected, model.points[row].tolist())
        order = np.argsort(model.point_ids, kind="stable")
        sorted_ids = model.point_ids[order]
        repeated = sorted_ids[1:][sorted_ids[1:] == sorted_ids[:-1]]
        expect(not len(repeated), "point id", "each one once", Unquoted(f"{repeated[:1]} twice"))
    with in_file(images_file):
        views = tuple(_view(image, model, sorted_ids, order, suffix) for image in model.images)
    return Scene(
        path=path or folder,
        format="colmap-binary" if suffix == ".bin" else "colmap-text",
        views=views,
        points=model.points,
        model_path=folder,
    )


def _view(image: ColmapImage, model: ColmapModel, sorted_ids: IntArray, order: IntArray, suffix: str) -> View:
    """Return the view of an image.

    Parameters
    ----------
    image : ColmapImage
    model : ColmapModel
    sorted_ids : (n,) ndarray of int
        Ids of the points, sorted.
    order : (n,) ndarray of int
        Row of each of these points.
    suffix : str
        Suffix of the files of the model, for messages.
    """
    with at_field(f"image {image.name!r}"):
        camera = Unquoted(f"{image.camera_id}, which cameras{suffix} lacks")
        expect(image.camera_id in model.cameras, "camera id", "a camera of the model", camera)
        pose = np.concatenate([image.quaternion, image.translation])
        expect((np.abs(pose) < MAX_COORDINATE).all(), "pose", f"finite numbers below {MAX_COORDINATE:g}", pose.tolist())
        if abs(np.linalg.norm(image.quaternion) - 1) > MAX_QUATERNION_ERROR:
            raise FieldError("rotation", "a quaternion of length 1", image.quaternion.tolist())
        has_point = image.point_ids >= 0
        ids, keypoints = image.point_ids[has_point], image.keypoints[has_point]
        index = np.searchsorted(sorted_ids, ids)
        is_known = index < len(sorted_ids)
        is_known[is_known] = sorted_ids[index[is_known]] == ids[is_known]
        if not is_known.all():
            point = Unquoted(f"{ids[~is_known][0]}, which points3D{suffix} lacks")
            raise FieldError("point id", "a point of the model", point)
        expect(np.isfinite(keypoints).all(), "keypoints", "finite pixels", Unquoted("NaN or infinity"))
    rotation = Rotation.from_quat(image.quaternion, scalar_first=True).as_matrix()
    return View(image.name, model.cameras[image.camera_id], rotation, image.translation, keypoints, order[index])


def scene_of_reconstruction(reconstruction: Reconstruction) -> Scene:
    """Return the scene of a reconstruction in memory, with views in the order of their image ids.

    Raises
    ------
    InputError
        There is no registered image, or a camera or a coordinate is invalid.
    """
    ids = sorted(reconstruction.reg_image_ids())
    if not ids:
        raise InputError.at(SOURCE, "images", "at least one registered image", 0)
    point_ids = np.array(sorted(reconstruction.points3D), dtype=np.uint64)
    points = np.array([reconstruction.points3D[int(key)].xyz for key in point_ids], dtype=float).reshape(-1, 3)
    if not (np.abs(points) < MAX_COORDINATE).all():
        raise InputError.at(SOURCE, "points", f"finite coordinates below {MAX_COORDINATE:g}", "others")
    cameras = {}
    for key, camera in reconstruction.cameras.items():
        with in_file(SOURCE), at_field(f"camera {key}"):
            size = (int(camera.width), int(camera.height))
            cameras[key] = make_camera(camera.model.name, size, np.array(camera.params, dtype=float))
    views = []
    for key in ids:
        image: Any = reconstruction.images[key]
        pose = np.asarray(image.cam_from_world().matrix(), dtype=float)  # (3, 4)
        observed = [(point.xy, point.point3D_id) for point in image.points2D if point.point3D_id != NO_POINT]
        keypoints = np.array([xy for xy, _ in observed], dtype=float).reshape(-1, 2)
        rows = np.searchsorted(point_ids, np.array([point_id for _, point_id in observed], dtype=np.uint64))
        views.append(View(image.name, cameras[image.camera_id], pose[:, :3], pose[:, 3], keypoints, rows))
    return Scene(path=SOURCE, format="memory", views=tuple(views), points=points)
