"""Check a reconstruction: degenerate geometry, which determines no sizes, and contradictions to its observations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from estimator.projection.cameras import project
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.objects import SupportPlane
from estimator.records.scene import Scene, SceneProblem, camera_centres
from metric_base.arrays import IntArray
from metric_base.images import image_header

#: Maximum number of observations of a view that are evaluated; 1,000 determine a median to a few per cent.
MAX_OBSERVATIONS = 1000
#: Maximum median reprojection error without a warning, relative to the longer image side. Structure from motion removes
#: observations with an error of more than 4 pixels, 0.4 % of an image of 1,000 pixels; the median of a good model is
#: 10 % of this. Rounded pixels and poses of another run are below this threshold.
MAX_GOOD_ERROR = 0.004
#: Maximum median reprojection error of a usable reconstruction, relative to the longer image side.
MAX_ERROR = 0.02
#: Maximum fraction of observations with an error above `MAX_ERROR` without a warning. A model after bundle adjustment
#: has none; parts with different scales, or shifted parts, have many.
MAX_GOOD_MISSES = 0.02
#: The same for a usable reconstruction.
MAX_MISSES = 0.1
#: Maximum fraction of observed points behind their camera without a warning; none after bundle adjustment.
MAX_GOOD_BEHIND = 0.02
#: The same for a usable reconstruction.
MAX_BEHIND = 0.2
#: Maximum ratio of the 95 % and 5 % quantiles of the depths in a view; above it, the nearest points are at the lens.
MAX_DEPTH_RATIO = 300.0
#: Minimum number of views of a group; views without a common point with the others are ignored.
MIN_GROUP_VIEWS = 2
#: Range of the median distance in metres of the points from the cameras: from close-ups of toys to aerial images. A
#: distance of 3 m becomes 0.003 m or 3,000 m if kilometres or millimetres are read as metres.
MIN_DISTANCE_M, MAX_DISTANCE_M = 0.1, 1000.0
#: Range of the height in metres of level cameras above the floor; cameras that look down may be aircraft. A height of
#: 1.5 m becomes 59 m if inches are read as metres, and 0.06 m beside houses at 1:24 that are read as houses.
MIN_LEVEL_HEIGHT_M, MAX_LEVEL_HEIGHT_M = 0.1, 50.0
#: The same for a warning: cameras of people, vehicles and poles are lower, and aircraft record their positions.
MAX_USUAL_HEIGHT_M = 10.0
#: The same if the only evidence is positions in an assumed unit: a height of 1.5 m becomes 4.9 m if feet are read as
#: metres, and cameras in hands or on cars are at most 3 m above the ground.
MAX_ASSUMED_HEIGHT_M = 4.0
#: Maximum absolute sine of the elevation of level cameras: 30 degrees. Hand-held cameras in rooms look down by less.
MAX_LEVEL_SINE = 0.5
#: Maximum ratio, in either direction, of the focal length of the model and that of EXIF, which is rounded to
#: millimetres and ignores the crop of corrected distortion. An error of 30 % changes the proportions of a scene.
MAX_FOCAL_RATIO = 1.3
#: Number of images whose EXIF is read.
N_PROBED_IMAGES = 5
#: Minimum distance of the cameras from their centre, relative to their distance from the points. With keypoints
#: accurate to half a pixel and a focal length of 500 pixels, the error of depths is then 100 %.
MIN_BASELINE_RATIO = 1e-3
#: Minimum ratio of the smallest and the largest singular value of the points: a hundredth of the noise of a good cloud.
MIN_THICKNESS_RATIO = 1e-4
#: Maximum distance of a point from the median, in median distances; farther points are outliers.
MAX_OUTLIER_DISTANCES = 10.0
#: Minimum number of points that have a shape.
MIN_POINTS = 4
#: Maximum number of points of a cloud from which the shape is computed.
MAX_SHAPE_POINTS = 200_000
_DESCRIPTIONS = {"coincident": "all at one place", "collinear": "all on one line", "coplanar": "all in one plane"}


@dataclass(frozen=True, slots=True)
class ReprojectionStatistics:
    """Agreement of the observations of a scene with its cameras and points; NaN without observations."""

    #: Median reprojection error in pixels.
    median_px: float
    #: Median reprojection error relative to the longer image side.
    median_relative: float
    #: Fraction of observations with a relative error above `MAX_ERROR`.
    misses: float
    #: Fraction of observed points behind their camera.
    behind: float
    #: Median over the views of the ratio of the 95 % and 5 % quantiles of depth.
    depth_ratio: float
    #: Number of groups of views without common points, whose relative scales are undetermined.
    groups: int


def check_reconstruction(scene: Scene) -> tuple[SceneProblem, ...]:
    """Check a reconstruction for degenerate geometry and, otherwise, for large reprojection errors.

    A degenerate reconstruction is a single fatal problem, whose message begins with its code.
    """
    degenerate = degeneracy(scene)
    return (degenerate,) if degenerate is not None else reprojection_problems(reprojection_statistics(scene))


def reprojection_statistics(scene: Scene) -> ReprojectionStatistics:
    """Compute the agreement of the observations of a scene with its geometry.

    The error of an observation x of a point X is |K(R X + t) - x|, with lens distortion.
    """
    errors, relative, is_behind, ratios = [np.empty(0)], [np.empty(0)], [np.empty(0)], []
    for view in scene.views:
        step = max(1, -(-len(view.point_index) // MAX_OBSERVATIONS))
        points = scene.points[view.point_index[::step]]
        if not len(points):
            continue
        points_camera = view.to_camera(points)
        error = np.linalg.norm(project(view.camera, points_camera) - view.keypoints[::step], axis=1)
        error = error[np.isfinite(error)]
        depth = points_camera[:, 2]
        errors.append(error)
        relative.append(error / max(view.camera.width, view.camera.height))
        is_behind.append((depth <= 0).astype(float))
        ahead = depth[depth > 0]
        if len(ahead):
            ratios.append(float(np.quantile(ahead, 0.95) / np.quantile(ahead, 0.05)))
    all_errors, all_relative = np.concatenate(errors), np.concatenate(relative)

    return ReprojectionStatistics(
        float(np.median(all_errors)) if len(all_errors) else np.nan,
        float(np.median(all_relative)) if len(all_relative) else np.nan,
        float(np.mean(all_relative > MAX_ERROR)) if len(all_relative) else np.nan,
        float(np.mean(np.concatenate(is_behind))) if len(is_behind) > 1 else np.nan,
        float(np.median(ratios)) if ratios else np.nan,
        len(view_groups(scene)),
    )


def view_groups(scene: Scene) -> list[IntArray]:
    """Return the indices (k,) of the views of each group that shares no point with the other groups."""
    # A graph with a node for each view and each point.
    n_views, rows = len(scene.views), [view.point_index for view in scene.views]
    of_view = np.repeat(np.arange(n_views), [len(observed) for observed in rows])
    of_point = n_views + np.concatenate([*rows, np.empty(0, dtype=np.int64)]).astype(np.int64)
    size = n_views + len(scene.points)
    graph = csr_array((np.ones(len(of_view), dtype=bool), (of_view, of_point)), shape=(size, size))
    _, component = connected_components(graph, directed=False)
    groups = [np.flatnonzero(component[:n_views] == index) for index in np.unique(component[:n_views])]
    return [group for group in groups if len(group) >= MIN_GROUP_VIEWS]


def scene_of_views(scene: Scene, rows: IntArray) -> Scene:
    """Return the scene with the views `rows` (k,) and the points that they observe, without its dense cloud."""
    kept = np.unique(np.concatenate([scene.views[row].point_index for row in rows]))
    views = [scene.views[row] for row in rows]
    views = [replace(view, point_index=np.searchsorted(kept, view.point_index)) for view in views]
    return replace(scene, views=tuple(views), points=scene.points[kept], dense=None)


def focal_problem(scene: Scene, images: Path | None = None) -> SceneProblem | None:
    """Return a problem if the focal lengths of the model contradict EXIF (median of a few images).

    images : folder of the images, if they are not in or above the folder of the model.
    """
    folders, ratios = image_folders(scene, images), []
    for view in scene.views[:: max(1, len(scene.views) // N_PROBED_IMAGES)][:N_PROBED_IMAGES]:
        file, camera = image_file(folders, view), view.camera
        header = None if file is None else image_header(file)
        if header is not None and header.focal_px is not None and "FISHEYE" not in camera.model:
            resized = np.hypot(camera.width, camera.height) / np.hypot(header.width, header.height)
            ratios.append(camera.focal_px / (header.focal_px * resized))
    ratio = float(np.median(ratios)) if ratios else 1.0
    if 1 / MAX_FOCAL_RATIO <= ratio <= MAX_FOCAL_RATIO:
        return None
    message = f"the focal length of the model is {ratio:.2f} times that of EXIF: depths are wrong, or images cropped"
    return SceneProblem(message, is_doubtful=True)


def implied_position_problem(
    scene: Scene, metres_per_unit: float, floor: SupportPlane | None, max_height_m: float = MAX_USUAL_HEIGHT_M
) -> SceneProblem | None:
    """Return a problem if a scale implies an implausible position of the cameras.

    That is the median distance of the observed points, or the median height of level cameras above the floor, if it is
    given. A height from `max_height_m` to `MAX_LEVEL_HEIGHT_M` is a warning.
    """
    is_doubtful = True
    depths = [view.to_camera(scene.points[view.point_index])[:, 2] for view in scene.views if len(view.point_index)]
    metres = metres_per_unit * float(np.median([np.median(depth) for depth in depths])) if depths else 1.0
    if not MIN_DISTANCE_M <= metres <= MAX_DISTANCE_M:
        expected = f"{MIN_DISTANCE_M:g} to {MAX_DISTANCE_M:g} m are usual"
        implied = f"{metres:.3g} m from the points, {expected}"
    else:
        if floor is None:
            return None
        vertical = floor.basis[2]
        height = metres_per_unit * float(np.median(camera_centres(scene.views) @ vertical - floor.height))
        sine = float(np.median([view.rotation[2] @ vertical for view in scene.views]))
        # Cameras under the floor have no height: it is the lowest plane that was found.
        if height <= 0 or MIN_LEVEL_HEIGHT_M <= height <= max_height_m or abs(sine) > MAX_LEVEL_SINE:
            return None
        is_doubtful = not MIN_LEVEL_HEIGHT_M <= height <= MAX_LEVEL_HEIGHT_M
        implied = f"{height:.3g} m above the floor and look horizontally"
    message = f"the scale implies that the cameras are {implied}: wrong units, or scale models?"
    return SceneProblem(message, is_doubtful=is_doubtful)


def reprojection_problems(statistics: ReprojectionStatistics) -> tuple[SceneProblem, ...]:
    """Return the contradictions between a reconstruction and its observations."""
    problems: list[SceneProblem] = []
    if statistics.median_relative > MAX_GOOD_ERROR:
        message = f"the points miss their own observations by {statistics.median_px:.1f} pixels (median)"
        problems.append(SceneProblem(message, statistics.median_relative > MAX_ERROR))
    elif statistics.misses > MAX_GOOD_MISSES:
        fraction = f"{statistics.misses:.0%} of the observations are more than {MAX_ERROR:.0%} of the image off"
        message = f"{fraction} their points: parts of the model do not fit"
        problems.append(SceneProblem(message, statistics.misses > MAX_MISSES))
    if statistics.behind > MAX_GOOD_BEHIND:
        message = f"{statistics.behind:.0%} of the observed points are behind their camera"
        problems.append(SceneProblem(message, statistics.behind > MAX_BEHIND))
    if statistics.depth_ratio > MAX_DEPTH_RATIO:
        problems.append(SceneProblem(f"the depths in a view span a factor {statistics.depth_ratio:.0f}"))
    if statistics.groups > 1:
        groups = f"{statistics.groups} groups that share no point"
        problems.append(SceneProblem(f"the views fall into {groups}: each may have its own scale"))
    return tuple(problems)


def degeneracy(scene: Scene) -> SceneProblem | None:
    """Return the degeneracy of a scene as a fatal problem, or None.

    With the singular values s1 >= s2 >= s3 of the centred points, including those of a dense cloud, they are coplanar
    if s3 < 1e-4 s1, and collinear if s2 < 1e-4 s1. The cameras are coincident if the distance of their centres is below
    1e-3 of the median distance to the points; those of a network and a single photograph with its depths may be.

    Returns
    -------
    SceneProblem or None
        The message begins with `no_views`, `one_view`, `no_points`, `coincident_cameras`, `coincident_points`,
        `collinear_points` or `coplanar_points`.
    """
    if not scene.views:
        return SceneProblem("no_views: the reconstruction has no views", is_fatal=True)
    has_depths = scene.format in {"network", "photograph"}  # one view has depths, too
    if len(scene.views) == 1 and not has_depths:
        return SceneProblem("one_view: the reconstruction has one view, two are needed", is_fatal=True)
    clouds = [scene.points] if scene.dense is None else [scene.points, scene.dense.points]
    count = sum(map(len, clouds))
    if count < MIN_POINTS:
        message = f"no_points: the reconstruction has {count} points, {MIN_POINTS} needed"
        return SceneProblem(message, is_fatal=True)
    points = np.vstack([cloud[:: 1 + len(cloud) // MAX_SHAPE_POINTS] for cloud in clouds])
    centred = points - np.median(points, axis=0)
    from_median = np.linalg.norm(centred, axis=1)
    median = float(np.median(from_median))
    shape = "coincident"
    if median > np.finfo(float).eps * float(np.abs(points).max()):
        inliers = centred[from_median <= MAX_OUTLIER_DISTANCES * median]
        # Squared singular values (3,), the smallest first.
        scatter = (inliers - inliers.mean(axis=0)).T @ (inliers - inliers.mean(axis=0))
        variances = np.linalg.eigvalsh(scatter / median**2)
        is_thick = np.sqrt(np.maximum(variances, 0.0)) >= MIN_THICKNESS_RATIO * np.sqrt(variances[2])
        shape = "" if is_thick[0] else "coplanar" if is_thick[1] else "collinear"
    if shape:
        message = f"{shape}_points: the points of the reconstruction are {_DESCRIPTIONS[shape]}"
        return SceneProblem(message, is_fatal=True)
    centres = camera_centres(scene.views)
    distance = float(np.median(np.linalg.norm(points - np.median(centres, axis=0), axis=1)))
    spread = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    if not has_depths and spread < MIN_BASELINE_RATIO * distance:
        message = "coincident_cameras: all cameras are at one place, so that depths are unknown"
        return SceneProblem(message, is_fatal=True)
    return None
