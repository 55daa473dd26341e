"""Read the output of a network as a scene: cameras and a dense cloud. Poses of another convention are refused.

The cloud has the points of the depth maps with their visibility. The declarations in
`estimator.records.network_outputs` name files, arrays and conventions of each network. The depth maps of different
views confirm the convention of the poses, or another one. Cameras have the size of the maps; masks of full-size images
are resampled to it.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.projection.cameras import pixels_in_view, view_rays
from estimator.records.network_outputs import NETWORKS, NetworkOutput
from estimator.records.scene import DenseCloud, Scene, View
from estimator.scene_formats.common import FLIP, IMAGE_FOLDERS, MAX_TANGENT, pinhole_camera, posed_view
from estimator.scene_formats.depth_files import archive_arrays, archive_names, map_stack, read_exr, read_npy
from metric_base.arrays import FloatArray, IntArray, evenly_spaced
from metric_base.errors import FieldError, InputError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.images import IMAGE_SUFFIXES, image_size
from metric_base.input_files import folder_entries, read_text

#: Maximum number of points of the cloud; dense clouds of COLMAP have about as many.
MAX_CLOUD_POINTS = 300_000
#: Fraction of the pixels with the lowest confidence that is dropped; the viewers of the networks drop 20 to 50 %.
LOW_CONFIDENCE_FRACTION = 0.2
#: Maximum relative difference of depth within 3 x 3 pixels. Maps are smooth across the outlines of objects, and points
#: there are on no surface; a floor at 8 m below a camera at 1.5 m changes by 2 % (focal length of 500 pixels).
MAX_EDGE_STEP = 0.04
#: Maximum relative difference between the depth of a point and that of a map in which it is visible.
DEPTH_TOLERANCE = 0.03
#: The same for the comparison of conventions, in which errors of the network are no contradiction.
AGREEMENT_TOLERANCE = 0.1
#: Minimum gain of the fraction of points whose depths agree between views, for which another convention of the poses
#: than the declared one is reported. The declared one has no gain; wrong ones lose half or more of the points.
MIN_AGREEMENT_GAIN = 0.2
#: Maximum number of pairs of views, and of points of each, for this comparison.
N_PAIRS, N_PAIR_POINTS = 24, 400
#: Maximum relative difference between the aspect ratios of an image and of its map; networks round to 14 or 16 pixels.
MAX_ASPECT_DIFFERENCE = 0.05


def network_output(path: Path) -> tuple[Path, NetworkOutput] | None:
    """Return the file at a path or in a folder that identifies the output of a network; None without one.

    Raises
    ------
    InputError
        A folder contains several outputs.
    """
    for network in NETWORKS:
        for pattern in network.files:
            found = [path] if path.is_file() and path.match(pattern) else sorted(path.glob(pattern), key=_number_order)
            required = [text for text in (network.poses, network.depth, network.points, network.intrinsics) if text]
            if not found or not all(_exists(found[0], network, text) for text in required):
                continue
            if len(found) > 1 and "*" not in network.poses:
                names = Unquoted(", ".join(file.name for file in found[:3]))
                raise InputError.at(path, "scene", f"one output of {network.network}, or its file", names)
            return found[0], network
    return None


def read_network(file: Path, network: NetworkOutput) -> Scene:
    """Read the output of a network from the file that identifies it (`network_output`).

    Raises
    ------
    InputError
        A file is missing or damaged, or the poses have another convention than the network.
    """
    poses = _array(file, network, network.poses)
    maps = _array(file, network, network.points or network.depth)
    maps = maps if network.points else map_stack(file, maps)
    intrinsics = _array(file, network, network.intrinsics) if network.intrinsics else None
    confidence = None
    if network.confidence and _exists(file, network, network.confidence):
        confidence = map_stack(file, _array(file, network, network.confidence))
    with in_file(file):
        is_pose = poses.ndim > 1 and poses[0].size in {12, 16} and bool(np.isfinite(poses).all())
        expect(is_pose, network.poses, "finite matrices (n, 3, 4) or (n, 4, 4)", poses.shape)
        poses = poses.reshape(len(poses), -1, 4)[:, :3]
        shape = (len(poses), *maps.shape[1:3])
        expected = f"{len(poses)} maps, as many as poses"
        expect(maps.shape == shape + (3,) * bool(network.points), network.points or network.depth, expected, maps.shape)
        if confidence is not None:
            expect(confidence.shape == shape, network.confidence, f"{shape}, as the maps", confidence.shape)
        names, warnings = image_names(file, network.images, shape)
        declared = (network.is_world_to_camera, False)
        views, depth = _views(names, poses, maps, intrinsics, *declared)
        agreement = {declared: depth_agreement(views, depth)}
        for other in ((is_inverse, is_opengl) for is_inverse in (True, False) for is_opengl in (False, True)):
            if other not in agreement:
                agreement[other] = depth_agreement(*_views(names, poses, maps, intrinsics, *other))
        best = max(agreement, key=lambda convention: agreement[convention])
        if agreement[best] > agreement[declared] + MIN_AGREEMENT_GAIN:
            found = f"{_convention(*best)} ({agreement[best]:.0%} of the depths agree between views)"
            expected = f"poses {_convention(*declared)} ({network.network}; {agreement[declared]:.0%} agree)"
            raise FieldError(network.poses.strip(":"), expected, Unquoted(found))
    cloud = depth_cloud(views, depth, confidence)
    points, name = np.empty((0, 3)), network.network
    return Scene(file.parent, "network", tuple(views), points, cloud, warnings, file.parent, network=name)


def focal_of_points(points: FloatArray) -> float:
    """Return the focal length in pixels of a point map (h, w, 3) in the frame of the camera.

    It is the least-squares solution f of u - c = f x / z, with the principal point c in the middle; not positive if the
    points are behind the camera.
    """
    height, width = points.shape[:2]
    rows, columns = np.indices((height, width)) + 0.5
    with np.errstate(invalid="ignore", divide="ignore"):
        tangents = points[..., :2] / points[..., 2:]
    offsets = np.stack([columns - width / 2, rows - height / 2], axis=-1)
    is_valid = np.isfinite(tangents).all(axis=-1) & (np.abs(tangents) < MAX_TANGENT).all(axis=-1)
    tangents, offsets = tangents[is_valid], offsets[is_valid]
    return float((offsets * tangents).sum() / max(float((tangents**2).sum()), np.finfo(float).tiny))


def depth_cloud(views: Sequence[View], depth: FloatArray, confidence: FloatArray | None = None) -> DenseCloud:
    """Return the points of depth maps (n, h, w) at the size of their cameras, with the views that see each point.

    Pixels at depth edges and the `LOW_CONFIDENCE_FRACTION` with the lowest confidence (n, h, w) are left out. A point
    of one view is visible in another if the map there has the same depth.
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    is_valid = np.isfinite(depth) & (depth > 0)
    if confidence is not None:
        is_low = confidence <= np.quantile(confidence, LOW_CONFIDENCE_FRACTION)
        is_valid &= (confidence > 0) & (~is_low | (confidence == confidence.max()))  # a constant map drops no pixel
    points, own = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for row, view in enumerate(views):
        lows, highs = minimum_filter(depth[row], 3), maximum_filter(depth[row], 3)
        lines, columns = np.nonzero(is_valid[row] & (highs - lows <= MAX_EDGE_STEP * lows))
        pixels = evenly_spaced(np.column_stack([columns, lines]), MAX_CLOUD_POINTS // len(views))
        points.append(_lifted(view, pixels, depth[row]))
        own.append(np.full(len(pixels), row, dtype=np.int64))
    cloud, source = np.concatenate(points), np.concatenate(own)
    seen = [
        np.flatnonzero((source == row) | (np.abs(_log_ratio(view, depth[row], cloud)) < DEPTH_TOLERANCE))
        for row, view in enumerate(views)
    ]
    rows, columns = np.concatenate(seen), np.repeat(np.arange(len(views)), [len(one) for one in seen])
    order = np.argsort(rows, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(cloud)))])
    return DenseCloud(cloud, offsets.astype(np.int64), columns[order].astype(np.int64))


def _lifted(view: View, pixels: IntArray, depth: FloatArray) -> FloatArray:
    """Return the points (k, 3) in the world of pixels (k, 2) of a depth map (h, w) of the size of the camera."""
    rays = view_rays(view.camera, np.asarray(pixels + 0.5, dtype=np.float64))
    local = rays / rays[:, 2:] * depth[pixels[:, 1], pixels[:, 0], None]
    return np.asarray((local - view.translation) @ view.rotation)


def _log_ratio(view: View, depth: FloatArray, points: FloatArray) -> FloatArray:
    """Return ln(map / depth) (k,) of points (k, 3) at their pixels of a depth map (h, w); infinite outside of it."""
    pixels, depths = pixels_in_view(view, points)
    ratio = np.full(len(points), np.inf)
    inside = np.flatnonzero(np.isfinite(pixels[:, 0]) & (depths > 0))
    columns, lines = pixels[inside].astype(np.int64).T
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.log(depth[lines, columns] / depths[inside])
    ratio[inside] = np.nan_to_num(values, nan=np.inf, posinf=np.inf, neginf=np.inf)
    return ratio


def depth_agreement(views: Sequence[View], depth: FloatArray) -> float:
    """Return the mean fraction of points of a view whose depths agree with the map of another, from maps (n, h, w)."""
    n_views = len(views)
    offsets = [offset for offset in (1, 2, 4, 8, 16) if offset < n_views]
    pairs = [(row, row + offset) for offset in offsets for row in range(n_views - offset)]
    fractions = [0.0]
    for first, second in evenly_spaced(np.array(pairs, dtype=np.int64).reshape(-1, 2), N_PAIRS).tolist():
        lines, columns = np.nonzero(np.isfinite(depth[first]) & (depth[first] > 0))
        points = _lifted(views[first], evenly_spaced(np.column_stack([columns, lines]), N_PAIR_POINTS), depth[first])
        agrees = np.abs(_log_ratio(views[second], depth[second], points)) < AGREEMENT_TOLERANCE
        fractions.append(float(agrees.mean()) if len(agrees) else 0.0)
    return float(np.mean(fractions[1:] or fractions))


def _views(
    names: Sequence[str],
    poses: FloatArray,
    maps: FloatArray,
    intrinsics: FloatArray | None,
    is_world_to_camera: bool,
    is_opengl: bool,
) -> tuple[list[View], FloatArray]:
    """Return the views and their depth maps (n, h, w) if the poses (n, 3, 4) have this convention.

    Parameters
    ----------
    names : sequence of str
    poses : (n, 3, 4) ndarray of float
    maps : (n, h, w) or (n, h, w, 3) ndarray of float
        Depths, or points in the world.
    intrinsics : ndarray of float, optional
        (3, 3), (n, 3, 3) or (n, 4); None for points.
    is_world_to_camera, is_opengl : bool
    """
    size = (maps.shape[2], maps.shape[1])
    views, depths = [], []
    for row, name in enumerate(names):
        given, translation = poses[row, :, :3], poses[row, :, 3]
        rotation = given if is_world_to_camera else given.T
        centre = -given.T @ translation if is_world_to_camera else translation
        rotation = FLIP @ rotation if is_opengl else rotation
        with at_field(f"view {row}"):
            if intrinsics is None:
                local = (maps[row] - centre) @ rotation.T
                depths.append(local[..., 2])
                focal = abs(focal_of_points(local))
                numbers = [focal, focal, size[0] / 2, size[1] / 2]
            else:
                depths.append(maps[row])
                values = intrinsics if intrinsics.shape == (3, 3) else intrinsics[row % len(intrinsics)]
                expect(values.shape in {(3, 3), (4,)}, "intrinsics", "(3, 3) or (4,) numbers", values.shape)
                numbers = (values if values.shape == (4,) else values[[0, 1, 0, 1], [0, 1, 2, 2]]).tolist()
            camera = pinhole_camera(size, (numbers[0], numbers[1]), (numbers[2], numbers[3]), {})
            views.append(posed_view(name, camera, rotation, centre))
    return views, np.stack(depths)


def _convention(is_world_to_camera: bool, is_opengl: bool) -> str:
    direction = "from world to camera" if is_world_to_camera else "from camera to world"
    return f"{direction}, axes {'right, up, back' if is_opengl else 'right, down, forward'}"


def image_names(file: Path, images_folder: str, shape: tuple[int, ...]) -> tuple[list[str], tuple[str, ...]]:
    """Return the names of the n images of maps (n, h, w), or numbers if no folder has n images, and warnings.

    The folders are `images_folder` and the usual ones next to `file` and above it.
    """
    n_views, height, width = shape
    folders = [folder / name for folder in file.parents[:4] for name in (images_folder, *IMAGE_FOLDERS[:2])]
    for folder in folders:
        entries = folder_entries(folder) if folder.is_dir() else []
        images = [entry for entry in entries if entry.suffix.lower() in IMAGE_SUFFIXES]
        if len(images) == n_views:
            image_width, image_height = image_size(images[0])
            is_cropped = abs(np.log(image_width * height / image_height / width)) > MAX_ASPECT_DIFFERENCE
            cropped = f"{folder}: the network cropped the images to {width} x {height}: masks must be of cropped images"
            return [image.name for image in images], (cropped,) * bool(is_cropped)
    numbered = f"{file}: no folder {images_folder} with {n_views} images: the views are 000000.png, 000001.png, ..."
    return [f"{row:06d}.png" for row in range(n_views)], (numbered,)


def _number_order(file: Path) -> tuple[list[int], str]:
    """Return the order of a file by the numbers in its name: `frame_10` after `frame_9`."""
    return [int(digits) for digits in re.findall(r"\d+", file.stem)], file.name


def _source(file: Path, network: NetworkOutput, text: str) -> tuple[list[Path], str]:
    """Return the files of a declared quantity, and the name of its array in them; see `NetworkOutput`."""
    pattern, separator, array = text.rpartition(":")
    if not separator:
        return [file], array
    level = next(len(Path(name).parts) for name in network.files if file.match(name))
    return sorted(file.parents[level - 1].glob(pattern.format(stem=file.stem)), key=_number_order), array


def _exists(file: Path, network: NetworkOutput, text: str) -> bool:
    """Return whether a declared quantity exists, without reading it."""
    files, array = _source(file, network, text)
    return bool(files) and (not array or array in archive_names(files[0]))


def _array(file: Path, network: NetworkOutput, text: str) -> FloatArray:
    """Read a declared quantity (n, ...), with the files of single views stacked.

    Raises
    ------
    InputError
        A file is missing or damaged, or the files have different shapes.
    """
    files, array = _source(file, network, text)
    parts: list[FloatArray] = []
    for source in files:
        expected = f"{array or 'numbers'} of {network.network}"
        with in_file(source), damage_as_field_error(expected):
            if source.suffix == ".npz":
                parts.append(archive_arrays(source, (array,))[array])
            elif source.suffix == ".npy":
                parts.append(read_npy(source))
            elif source.suffix == ".zip":
                with zipfile.ZipFile(source) as entries:
                    parts += [read_exr(source, entries.read(name)) for name in sorted(entries.namelist())]
            else:
                parts += [np.array(line.split(), dtype=np.float64) for line in read_text(source).splitlines()]
    if not parts or any(part.shape != parts[0].shape for part in parts):
        found = Unquoted("none" if not parts else "different shapes")
        raise InputError.at(file, text, f"arrays of one shape ({network.network})", found)
    is_of_one_file = len(files) == 1 and files[0].suffix in {".npz", ".npy"} and "*" not in text
    return parts[0] if is_of_one_file else np.stack(parts)
