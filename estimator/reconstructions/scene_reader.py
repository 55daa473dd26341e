"""Readers of a scene and its instances, from whatever form they are in, or one clear line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import infer_observations
from estimator.reconstructions.colmap import colmap_folder, model_suffix, read_colmap
from estimator.reconstructions.ply import find_dense_cloud, read_dense_cloud
from estimator.records.scene import DenseCloud, Scene
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import folder_entries

if TYPE_CHECKING:
    from pycolmap import Reconstruction

#: The path of a scene that was never on disk.
MEMORY = Path("memory")
RECONSTRUCTION = "reconstruction.json"
#: How far above the model its instances are looked for: `scene/dense/0/sparse` is the deepest usual place.
LEVELS_UP = 3
#: Points looked at to see whether the visibility file numbers the images as we do.
VISIBILITY_SAMPLE = 2000
#: A point that an image sees projects into it, but for those at its border; with the images in another order
#: about half of them do, or fewer.
MIN_SHARE_IN_VIEW = 0.95
#: Points of a cloud that are farther from the cameras and the sparse points than this many times their extent are no
#: part of the scene; of the sparse points themselves the share at either end may be mismatched.
FAR, SPARSE_TAIL = 100.0, 0.02


def read_scene(source: Path | str | Reconstruction, dense: Path | str | None = None) -> Scene:
    """The scene of a reconstruction.

    Parameters
    ----------
    source : a COLMAP model folder, an OpenSfM dataset folder, or a `pycolmap.Reconstruction` in memory
    dense : a PLY file, "none" to do without, or None to take the one beside the model if there is one

    Returns
    -------
    Scene, in scene units of unknown metric size; its `warnings` say what was left out.

    Raises
    ------
    InputError
        Something cannot be read: the message names the file, the field, what was expected and what was found.

    Examples
    --------
    >>> import estimator
    >>> scene = estimator.read_scene("data/scenes/demo_room")
    >>> len(scene.views), scene.points.shape[1], scene.dense is not None
    (24, 3, False)
    """
    if isinstance(source, Path | str):
        path = Path(source)
        scene = _with_observations(_sparse_scene(path))
    else:
        from estimator.reconstructions.colmap import scene_of_reconstruction

        path = MEMORY
        scene = scene_of_reconstruction(source)
        dense = dense or "none"
    if dense != "none":
        scene = _with_dense(scene, None if dense is None else Path(dense))
    if not len(scene.points) and scene.dense is None:
        from estimator.scene_formats.detection import points_advice

        raise InputError.at(path, "points", points_advice(scene.format), 0)
    return scene


def _sparse_scene(path: Path) -> Scene:
    if path.is_file() and (path.name == RECONSTRUCTION or model_suffix(path.parent)):
        path = path.parent
    folder = colmap_folder(path)
    if folder is not None:
        return read_colmap(folder, path)
    if (path / RECONSTRUCTION).is_file():
        from estimator.reconstructions.opensfm import read_opensfm  # reads tracks with pyarrow, which COLMAP needs not

        return read_opensfm(path)
    from estimator.scene_formats.detection import EXPORT_NAMES, advice_on_file, export_file, read_export

    export = export_file(path)
    if export is not None:
        return read_export(*export)
    expected = f"a reconstruction: images.bin or images.txt (also under sparse/0), {RECONSTRUCTION}, {EXPORT_NAMES}"
    if not path.exists():
        raise InputError.at(path, "scene", expected, Unquoted("no such file or folder"))
    if not path.is_dir():
        raise InputError.at(path, "scene", expected, Unquoted(advice_on_file(path)))
    names = [entry.name for entry in folder_entries(path)]
    raise InputError.at(path, "scene", expected, Unquoted(", ".join(names[:5]) or "an empty folder"))


def _with_observations(scene: Scene) -> Scene:
    """The scene; where no view states an observation, depth order decides which points each view sees."""
    if not len(scene.points) or any(len(view.point_index) for view in scene.views):
        return scene
    warning = f"{scene.path}: it states no observations, so points are projected where no nearer point hides them"
    views = infer_observations(scene.views, scene.points)
    return replace(scene, views=views, warnings=(*scene.warnings, warning), observed=False)


def _with_dense(scene: Scene, file: Path | None) -> Scene:
    place = file or find_dense_cloud(scene.path, scene.model_path or scene.path)
    if place is None:
        return scene
    cloud, warnings = read_dense_cloud(place, len(scene.views), _bounds(scene))
    order = None if cloud.visible_views is None else _model_order(scene, place)
    if cloud.visible_views is not None and order is not None:
        if len(cloud.visible_views) and cloud.visible_views.max() >= len(order):
            expected = f"positions below {len(order)}, the images of the model beside the cloud"
            raise InputError.at(f"{place}.vis", "image", expected, int(cloud.visible_views.max()))
        cloud = replace(cloud, visible_views=order[cloud.visible_views], file_views=order)
    if not _visibility_fits(scene, cloud):
        cloud = replace(cloud, visible_offsets=None, visible_views=None)
        warnings = (*warnings, f"{place}.vis: its points do not project into the images it names; it is not used")
    return replace(scene, dense=cloud, warnings=(*scene.warnings, *warnings))


def _bounds(scene: Scene) -> FloatArray | None:
    """(2, 3) the low and the high corner that points of a cloud lie between, or None where the scene has no extent.

    A damaged cloud has points at any distance, whose grids would take all memory.
    """
    places = np.array([view.centre for view in scene.views])
    if len(scene.points):
        places = np.vstack([places, np.quantile(scene.points, [SPARSE_TAIL, 1 - SPARSE_TAIL], axis=0)])
    low, high = places.min(axis=0), places.max(axis=0)
    reach = FAR * float(np.linalg.norm(high - low))
    return np.array([low - reach, high + reach]) if reach > 0 else None


def _model_order(scene: Scene, cloud_file: Path) -> IntArray | None:
    """(n,) rows of the views in the order that the visibility file counts them, or None where it is our own.

    COLMAP counts the images of the model that it fused, which lies beside the cloud. The scene may be another one
    of the same views in another order: OpenSfM's shots, or the model before its images were undistorted.
    """
    folder = colmap_folder(cloud_file.parent)
    if folder is None or (scene.model_path is not None and folder.resolve() == scene.model_path.resolve()):
        return None
    rows = {view.name: row for row, view in enumerate(scene.views)}
    names = [view.name for view in read_colmap(folder).views]
    return np.array([rows[name] for name in names], dtype=np.int32) if set(names) <= set(rows) else None


def _visibility_fits(scene: Scene, cloud: DenseCloud) -> bool:
    """Whether points project into the images that are said to see them (a sample, evenly spaced)."""
    if cloud.visible_offsets is None or cloud.visible_views is None or not len(cloud.visible_views):
        return True
    n = len(cloud.points)
    chosen = np.unique(np.linspace(0, n - 1, min(n, VISIBILITY_SAMPLE)).astype(np.int64))
    starts, counts = cloud.visible_offsets[chosen], np.diff(cloud.visible_offsets)[chosen]
    points = np.repeat(chosen, counts)
    # positions within the lists: start of each list, then 0, 1, 2, ... along it
    steps = np.arange(len(points)) - np.repeat(np.cumsum(counts) - counts, counts)
    views = cloud.visible_views[np.repeat(starts, counts) + steps]
    seen = 0
    for row in np.unique(views):
        pixels, _ = pixels_in_view(scene.views[row], cloud.points[points[views == row]])
        seen += int(np.isfinite(pixels[:, 0]).sum())
    return seen >= MIN_SHARE_IN_VIEW * len(points)
