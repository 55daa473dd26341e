"""Find and read a reconstruction in any supported format, and join its dense cloud.

Gaussian splats and clouds that are not in the frame of the cameras are refused or not used.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import infer_observations
from estimator.reconstructions.colmap import colmap_folder, model_suffix, read_colmap
from estimator.reconstructions.ply import find_dense_cloud, read_dense_cloud, read_points
from estimator.reconstructions.splats import is_splat
from estimator.records.network_outputs import DEPTH_ANYTHING_3
from estimator.records.scene import DenseCloud, Scene, camera_centres
from metric_base.arrays import FloatArray, IntArray, evenly_spaced
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import folder_entries

if TYPE_CHECKING:
    from pycolmap import Reconstruction

#: File of nerfstudio with the transform from its input to its splats.
NORMALISATION = "dataparser_transforms.json"
#: Number of folders above a splat in which its cameras are searched: `point_cloud/iteration_30000/point_cloud.ply`.
MAX_FOLDERS_ABOVE_SPLAT = 2
#: Minimum fraction of the sparse points, from which training starts, that have a Gaussian near them: 1.00 in the frame
#: of the cameras, at most 0.05 in the normalised frames of nerfstudio and gsplat (four scenes).
MIN_NEAR_FRACTION = 0.5
#: Maximum distance of such a Gaussian, as a fraction of the extent of the sparse points.
MAX_GAUSSIAN_DISTANCE = 0.01
#: Maximum number of Gaussians that are compared with sparse points, evenly spaced in the file.
MAX_COMPARED_GAUSSIANS = 200_000
#: Minimum fraction of the Gaussians that project into an image, for cameras without sparse points. A normalised frame
#: passes, because it has the cameras among the Gaussians, too: a warning states that the frame is not checked.
MIN_SEEN_FRACTION = 0.1
#: Maximum log error of the ratio of the extents of Gaussians and depth maps, of which different parts are dropped.
MAX_LOG_EXTENT_ERROR = 0.7
#: Maximum relative difference of two units that are equal but for errors of the Gaussians.
MIN_UNIT_DIFFERENCE = 0.02
#: Path of a scene in memory.
MEMORY = Path("memory")
RECONSTRUCTION = "reconstruction.json"
#: Maximum number of points with which the order of the images in a visibility file is checked.
MAX_CHECKED_POINTS = 2000
#: Minimum fraction of visible points that project into the image that sees them. Only points at the border do not; with
#: the images in another order, half of the points or fewer do.
MIN_IN_VIEW_FRACTION = 0.95
#: Maximum distance of a point of a cloud from the cameras and sparse points, in multiples of their extent.
MAX_DISTANCE_FACTOR = 100.0
#: Fraction of the sparse points at each end of an axis that is ignored for this extent, because of mismatches.
SPARSE_TAIL_FRACTION = 0.02


def read_scene(
    source: Path | str | Reconstruction,
    dense: Path | str | None = None,
    cameras: Path | None = None,
    focal_px: float | None = None,
) -> Scene:
    """Read a reconstruction.

    Parameters
    ----------
    source : Path, str or pycolmap.Reconstruction
        Folder of a COLMAP model or of an OpenSfM dataset, a file of another program (docs/reference/formats.md), a
        splat (PLY or SPZ), or a reconstruction in memory.
    dense : Path or str, optional
        Dense cloud (PLY), or "none" for no cloud. By default the cloud in the folder of the model, if there is one;
        that of a splat is the splat itself.
    cameras : Path, optional
        Reconstruction with the cameras of a splat. By default the nearest one in the folder of the splat or in the two
        folders above it.
    focal_px : float, optional
        Focal length in pixels of the images of a trajectory, whose file states none; no other source takes it.

    Returns
    -------
    Scene
        In scene units of unknown size. Its `warnings` describe omitted data.

    Raises
    ------
    InputError
        A file cannot be read. The message contains the file, the field, the expected and the actual value.

    Examples
    --------
    >>> import estimator
    >>> scene = estimator.read_scene("data/scenes/demo_room")
    >>> len(scene.views), scene.points.shape[1], scene.dense is not None
    (24, 3, False)
    """
    if isinstance(source, Path | str):
        path = Path(source)
        if is_splat(path):
            scene, dense = _splat_cameras(path, cameras), dense or path
        else:
            scene = _read_sparse(path, focal_px)
        if len(scene.points) and not any(len(view.point_index) for view in scene.views):
            views = infer_observations(scene.views, scene.points)
            warning = f"{path}: it has no observations; points are visible unless a nearer point occludes them"
            scene = replace(scene, views=views, warnings=(*scene.warnings, warning), observed=False)
    else:
        from estimator.reconstructions.colmap import scene_of_reconstruction

        path = MEMORY
        scene = scene_of_reconstruction(source)
        dense = dense or "none"
    if dense is None:
        dense = find_dense_cloud(scene.path, scene.model_path or scene.path) or "none"
    if dense != "none":
        scene = _with_dense_cloud(scene, Path(dense))
    if not len(scene.points) and scene.dense is None:
        from estimator.scene_formats.detection import points_advice

        raise InputError.at(path, "points", points_advice(scene.format), 0)
    return scene


def _read_sparse(path: Path, focal_px: float | None = None) -> Scene:
    """Read the cameras and sparse points of a reconstruction; `focal_px` as for `read_scene`."""
    if focal_px is not None:
        from estimator.scene_formats.trajectory import read_trajectory

        return read_trajectory(path, focal_px)
    if path.is_file() and (path.name == RECONSTRUCTION or model_suffix(path.parent)):
        path = path.parent
    folder = colmap_folder(path)
    if folder is not None:
        return read_colmap(folder, path)
    if (path / RECONSTRUCTION).is_file():
        from estimator.reconstructions.opensfm import read_opensfm  # imports pyarrow, which COLMAP does not need

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


def _splat_cameras(splat: Path, cameras: Path | None) -> Scene:
    """Read the cameras of a splat, with their sparse points, in the frame of the splat.

    nerfstudio trains in a normalised frame, and writes x' = `scale` (`transform` x) to `dataparser_transforms.json`.

    Raises
    ------
    InputError
        There are no cameras, or they have another frame than the splat.
    """
    from estimator.scene_formats.detection import export_file
    from estimator.scene_formats.nerfstudio import read_normalisation

    above = splat.resolve().parents[: MAX_FOLDERS_ABOVE_SPLAT + 1]
    folders = above if cameras is None else (cameras,)
    is_found = (colmap_folder(one) or (one / RECONSTRUCTION).is_file() or export_file(one) for one in folders)
    found = next((one for one, has_cameras in zip(folders, is_found, strict=True) if has_cameras), cameras)
    if found is None:
        expected = "its cameras in its folder or above: a COLMAP model, transforms.json or cameras.json (or --cameras)"
        raise InputError.at(splat, "cameras", expected, Unquoted("none"))
    scene = _read_sparse(found)
    files = (one / NORMALISATION for one in (found, found.parent, *above))
    file = next((one for one in files if one.is_file()), None)
    centres = read_points(splat)
    if file is not None:
        scale, transform = read_normalisation(file)
        scene = _transformed(scene, scale, transform)
        warning = f"{file}: 1 unit of the cameras is {scale:.4g} units of the splat; the scale is that of the splat"
        scene = replace(scene, warnings=(*scene.warnings, warning))
    elif scene.dense is not None and scene.network.startswith(DEPTH_ANYTHING_3.network):
        unit = _unit_of_gaussians(scene.dense.points, centres)
        if abs(unit - 1) > MIN_UNIT_DIFFERENCE:
            warning = f"{splat}: 1 unit of it is {unit:.4g} units of {found} (nested models scale only their depth)"
            scene = replace(_transformed(scene, 1 / unit, np.eye(3, 4)), warnings=(*scene.warnings, warning))
    if splat.suffix.lower() == ".spz":
        # Right, up, back, or the axes of the PLY file from which it was made.
        turned = _transformed(scene, 1.0, np.eye(3, 4) * [[1], [-1], [-1]])
        scene = max(turned, scene, key=lambda one: _same_frame_fraction(one, centres))
    fraction = _same_frame_fraction(scene, centres)
    has_points = len(scene.points) or scene.dense is not None
    if fraction < (MIN_NEAR_FRACTION if has_points else MIN_SEEN_FRACTION):
        expected = f"cameras in the frame of the splat, or {NORMALISATION} next to it (gsplat: normalize_world_space)"
        what = "of their points near a Gaussian" if has_points else "of its Gaussians in the images"
        raise InputError.at(found, "cameras", expected, Unquoted(f"{fraction:.0%} {what}"))
    if has_points:
        return scene
    warning = f"{found}: without points, it is not checked that the cameras have the frame of the splat"
    return replace(scene, warnings=(*scene.warnings, warning))


def _same_frame_fraction(scene: Scene, centres: FloatArray) -> float:
    """Return the fraction of the points of a scene with a Gaussian nearby, by the centres (n, 3) of Gaussians.

    The points are the sparse points, or those of a network; without either, return the fraction of Gaussians in images.
    """
    points = scene.points if scene.dense is None or len(scene.points) else scene.dense.points
    if not len(points):
        centres = evenly_spaced(centres, MAX_CHECKED_POINTS)
        is_seen = [np.isfinite(pixels_in_view(view, centres)[0][:, 0]) for view in scene.views]
        return float(np.any(is_seen, axis=0).mean())
    extent = np.ptp(np.quantile(points, [SPARSE_TAIL_FRACTION, 1 - SPARSE_TAIL_FRACTION], axis=0), axis=0)
    gaussians = cKDTree(evenly_spaced(centres, MAX_COMPARED_GAUSSIANS))
    distances, _ = gaussians.query(evenly_spaced(points, MAX_CHECKED_POINTS))
    return float((distances <= MAX_GAUSSIAN_DISTANCE * np.linalg.norm(extent)).mean())


def _transformed(scene: Scene, scale: float, transform: FloatArray) -> Scene:
    """Return the scene with x' = scale (R x + t) for a transform (R t) (3, 4)."""
    rotation, shift = transform[:, :3], transform[:, 3]
    views = []
    for view in scene.views:
        turned, centre = view.rotation @ rotation.T, scale * (rotation @ view.centre + shift)
        views.append(replace(view, rotation=turned, translation=-turned @ centre))
    points = scale * (scene.points @ rotation.T + shift)
    dense = None if scene.dense is None else DenseCloud(scale * (scene.dense.points @ rotation.T + shift))
    units = scene.file_units / scale
    # The files of the scene have another frame: outputs are written from memory.
    return replace(scene, views=tuple(views), points=points, dense=dense, format="nerfstudio", file_units=units)


def _unit_of_gaussians(points: FloatArray, centres: FloatArray) -> float:
    """Return the factor from Gaussians (n, 3) to the points (m, 3) of the same surfaces, around the origin.

    Depth Anything 3 multiplies depths and positions of cameras by its metric factor, but not its Gaussians, and writes
    the factor to no file (da3.py, `_apply_depth_alignment`; utils/export/gs.py). The factor has the smallest mean
    distance, of at most `MAX_GAUSSIAN_DISTANCE` of the extent, between Gaussians and points.
    """
    tails = [SPARSE_TAIL_FRACTION, 1 - SPARSE_TAIL_FRACTION]
    extents = [float(np.linalg.norm(np.ptp(np.quantile(one, tails, axis=0), axis=0))) for one in (points, centres)]
    sample, radius = evenly_spaced(centres, MAX_CHECKED_POINTS), MAX_GAUSSIAN_DISTANCE * extents[0]
    tree, log_unit = cKDTree(points), float(np.log(extents[0] / max(extents[1], np.finfo(float).tiny)))
    for span, step in ((MAX_LOG_EXTENT_ERROR, 0.01), (0.01, 0.001)):
        grid = log_unit + np.arange(-span, span + step / 2, step)
        distances = [tree.query(np.exp(u) * sample, distance_upper_bound=radius)[0] for u in grid]
        log_unit = float(grid[np.argmin([np.minimum(one, radius).mean() for one in distances])])
    return float(np.exp(log_unit))


def _with_dense_cloud(scene: Scene, path: Path) -> Scene:
    """Return the scene with a dense cloud, without points far from the scene.

    A damaged cloud contains points at any distance; a grid of it would exceed the memory.
    """
    positions = camera_centres(scene.views)
    if len(scene.points):
        inner = np.quantile(scene.points, [SPARSE_TAIL_FRACTION, 1 - SPARSE_TAIL_FRACTION], axis=0)
        positions = np.vstack([positions, inner])
    low, high = positions.min(axis=0), positions.max(axis=0)
    margin = MAX_DISTANCE_FACTOR * float(np.linalg.norm(high - low))
    bounds = np.array([low - margin, high + margin]) if margin > 0 else None
    cloud, warnings = read_dense_cloud(path, len(scene.views), bounds)

    # A visibility file contains positions of images in the model that COLMAP fused, which is in the folder of the
    # cloud. The scene may be another one with the same views in another order: the scene of OpenSfM, or the model
    # before its images were undistorted.
    folder = None if cloud.visible_views is None else colmap_folder(path.parent)
    is_other_model = folder is not None and (scene.model_path is None or folder.resolve() != scene.model_path.resolve())
    if folder is not None and is_other_model and cloud.visible_views is not None:
        row_of = {view.name: row for row, view in enumerate(scene.views)}
        names = [view.name for view in read_colmap(folder).views]
        if set(names) <= set(row_of):
            rows: IntArray = np.array([row_of[name] for name in names], dtype=np.int32)
            if len(cloud.visible_views) and cloud.visible_views.max() >= len(rows):
                expected = f"positions below {len(rows)}, the images of the model beside the cloud"
                raise InputError.at(f"{path}.vis", "image", expected, int(cloud.visible_views.max()))
            cloud = replace(cloud, visible_views=rows[cloud.visible_views], file_views=rows)
    if not _visibility_fits(scene, cloud):
        cloud = replace(cloud, visible_offsets=None, visible_views=None)
        warnings = (*warnings, f"{path}.vis: its points do not project into the images it names; it is not used")
    return replace(scene, dense=cloud, warnings=(*scene.warnings, *warnings))


def _visibility_fits(scene: Scene, cloud: DenseCloud) -> bool:
    """Return True if a sample of the points project into the images of their visibility lists."""
    if cloud.visible_offsets is None or cloud.visible_views is None or not len(cloud.visible_views):
        return True
    n = len(cloud.points)
    selected = np.unique(np.linspace(0, n - 1, min(n, MAX_CHECKED_POINTS)).astype(np.int64))
    starts, counts = cloud.visible_offsets[selected], np.diff(cloud.visible_offsets)[selected]
    points = np.repeat(selected, counts)
    # Index within the list of each point: 0, 1, 2, ...
    steps = np.arange(len(points)) - np.repeat(np.cumsum(counts) - counts, counts)
    views = cloud.visible_views[np.repeat(starts, counts) + steps]
    n_inside = 0
    for row in np.unique(views):
        pixels, _ = pixels_in_view(scene.views[row], cloud.points[points[views == row]])
        n_inside += int(np.isfinite(pixels[:, 0]).sum())
    return n_inside >= MIN_IN_VIEW_FRACTION * len(points)
